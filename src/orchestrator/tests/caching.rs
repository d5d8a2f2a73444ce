//! What runs, and above all what does not.

use super::*;

#[test]
fn everything_is_built_once_and_nothing_twice() {
    let lab = Laboratory::new();
    assert_eq!(
        lab.run(&[]),
        [
            "start small (35): not built yet",
            "chunk small 0",
            "chunk small 1",
            "chunk small 2",
            "chunk small 3",
            "built small built 4+0: not built yet",
            "start large (20): not built yet",
            "chunk large 0",
            "chunk large 1",
            "built large built 2+0: not built yet",
            "start halved (55): not built yet",
            "chunk halved 0",
            "chunk halved 1",
            "chunk halved 2",
            "chunk halved 3",
            "chunk halved 4",
            "chunk halved 5",
            "built halved built 6+0: not built yet",
            "start total (1): not built yet",
            "built total built 1+0: not built yet",
        ]
    );
    let reused = ["reused small", "reused large", "reused halved", "reused total"];
    assert_eq!(lab.run(&[]), reused);
    let (outcome, _) = lab.run_text(PIPELINE, &[]);
    let total = lab.store().artifact(&outcome.stages[3].digest.unwrap()).unwrap();
    // ⌊i/2⌋ summed over 0…34 and 100…119.
    assert_eq!(total.u64s("numbers").unwrap().1, [289 + 1090]);
}

#[test]
fn comments_order_of_keys_and_names_of_stages_change_nothing() {
    let lab = Laboratory::new();
    lab.run(&[]);
    let rewritten = "
# A comment.
name: toy
stages:
  sum: { needs: [half], kind: sum }
  half: { by: 2.0, needs: [few, many], kind: divide }   # another
  many: { offset: 100, count: 20, kind: count }
  few: { count: 35, kind: count, offset: 0 }
version: 1
";
    let (_, log) = lab.run_text(rewritten, &[]);
    assert_eq!(log, ["reused many", "reused few", "reused half", "reused sum"]);
}

#[test]
fn a_tweak_builds_what_depends_on_it_and_says_why() {
    let lab = Laboratory::new();
    lab.run(&[]);
    let tweak = ["stages.halved.by=3"];
    let expected = [
        "small reused 0+4",
        "large reused 0+2",
        "halved stale 6+0: parameter changed: by from 2 to 3",
        "total stale 1+0: input changed: halved",
    ];
    assert_eq!(lab.plan(&tweak), expected);
    let log = lab.run(&tweak);
    assert_eq!(log[..2], ["reused small", "reused large"]);
    assert_eq!(log[2], "start halved (55): parameter changed: by from 2 to 3");
    assert_eq!(log.last().unwrap(), "built total built 1+0: input changed: halved");
    assert_eq!(
        lab.run(&[]),
        ["reused small", "reused large", "reused halved", "reused total"],
        "set back"
    );
    assert_eq!(
        lab.plan(&["stages.total.power=2"])[2..],
        [
            "halved reused 0+6",
            "total stale 1+0: parameter changed: power from 1 to 2",
        ]
    );
}

#[test]
fn a_plan_builds_nothing() {
    let lab = Laboratory::new();
    let expected = [
        "small stale 4+0: not built yet",
        "large stale 2+0: not built yet",
        "halved stale 6+0: not built yet",
        "total stale 1+0: not built yet",
    ];
    assert_eq!(lab.plan(&[]), expected);
    assert_eq!(lab.plan(&[]), expected);
    let empty = |name| {
        std::fs::read_dir(lab.store().root().join(name))
            .unwrap()
            .next()
            .is_none()
    };
    assert!(empty("objects") && empty("records") && empty("runs"));
}

#[test]
fn more_samples_build_only_the_new_chunks() {
    let lab = Laboratory::new();
    lab.run(&["stages.small.count=30"]);
    let more = ["stages.small.count=50"];
    assert_eq!(
        lab.plan(&more),
        [
            "small stale 2+3: parameter changed: count from 30 to 50",
            "large reused 0+2",
            "halved stale 2+5: input changed: small",
            "total stale 1+0: input changed: halved",
        ]
    );
    let log = lab.run(&more);
    let chunks: Vec<&String> = log.iter().filter(|line| line.starts_with("chunk")).collect();
    assert_eq!(
        chunks,
        ["chunk small 3", "chunk small 4", "chunk halved 3", "chunk halved 4"]
    );
    assert_eq!(log[0], "start small (20): parameter changed: count from 30 to 50");
    // Fewer samples again need no work at all, not even where the very number is new.
    let fewer = lab.run(&["stages.small.count=40"]);
    assert!(!fewer.iter().any(|line| line.starts_with("chunk")), "{fewer:?}");
    assert!(fewer.contains(&"built small built 0+4: parameter changed: count from 50 to 40".into()));
}

#[test]
fn equal_content_stops_the_wave() {
    let lab = Laboratory::new();
    let even = "
version: 1
name: toy
stages:
  small: { kind: count, count: 20 }
  coarse: { kind: divide, needs: [small], by: 100 }
  total: { kind: sum, needs: [coarse] }
";
    lab.run_text(even, &[]);
    // 0…19 and 1…20 are all 0 after division by 100.
    let (_, log) = lab.run_text(even, &["stages.small.offset=1"]);
    assert_eq!(log[0], "start small (20): parameter changed: offset from 0 to 1");
    assert_eq!(log[4], "start coarse (20): input changed: small");
    assert_eq!(log.last().unwrap(), "reused total");
}

#[test]
fn a_new_recipe_rebuilds_and_says_so() {
    let lab = Laboratory::new();
    lab.run(&[]);
    let lab = Laboratory::with_recipe(lab.folder, 2);
    assert_eq!(
        lab.plan(&[])[..3],
        [
            "small stale 4+0: recipe changed: from 1 to 2",
            "large stale 2+0: recipe changed: from 1 to 2",
            "halved stale 6+0: input changed: small",
        ]
    );
    assert_eq!(
        lab.run(&[]).last().unwrap(),
        "reused total",
        "the content has not changed"
    );
}

#[test]
fn an_input_taken_away_is_named() {
    let lab = Laboratory::new();
    lab.run(&[]);
    assert_eq!(
        lab.plan(&["stages.halved.needs=[small]"])[2],
        "halved stale 0+4: no longer needed: large"
    );
    assert_eq!(
        lab.plan(&["stages.halved.needs=[large, small]"])[2],
        "halved stale 0+6: order of needs changed"
    );
}

#[test]
fn until_leaves_out_what_is_not_needed() {
    let lab = Laboratory::new();
    let pipeline = lab.pipeline(PIPELINE, &[]);
    let options = RunOptions {
        until: Some("large"),
        ..RunOptions::default()
    };
    let run = run(&pipeline, &lab.store(), &options, &environment(), &|_| ()).unwrap();
    assert_eq!(
        run.stages.iter().map(summary).collect::<Vec<_>>(),
        ["large built 2+0: not built yet"]
    );
    let error = plan(&pipeline, &lab.store(), Some("larg"), &environment()).unwrap_err();
    assert_eq!(error.to_string(), "no stage `larg` in toy.yaml");
}

#[test]
fn unstable_samples_are_counted_whether_built_or_reused() {
    let lab = Laboratory::new();
    // Multiples of 7 in 0…34 and in 100…119.
    assert_eq!(lab.run_text(PIPELINE, &[]).0.unstable, 5 + 3);
    assert_eq!(lab.run_text(PIPELINE, &[]).0.unstable, 5 + 3);
}

#[test]
fn reports_are_written_as_documented() {
    let lab = Laboratory::new();
    let (outcome, _) = lab.run_text(PIPELINE, &[]);
    let json = serde_json::to_value(&outcome.stages[3]).unwrap();
    assert_eq!(json["name"], "total");
    assert_eq!(json["kind"], "sum");
    assert_eq!(json["outcome"], "built");
    assert_eq!(json["chunks_built"], 1);
    assert_eq!(json["chunks_reused"], 0);
    assert_eq!(json["digest"], outcome.stages[3].digest.unwrap().to_string());
    assert_eq!(json["why"], "not built yet");
    assert!(json["seconds"].as_f64().unwrap() > 0.0);
    assert!(json["size"].as_u64().unwrap() > 512);
}

#[test]
fn provenance_leads_back_to_the_seeds() {
    let lab = Laboratory::new();
    let digests = lab.digests(&[]);
    let store = lab.store();
    let total = store.artifact(&digests[3].unwrap()).unwrap().provenance().unwrap();
    assert_eq!((total["kind"].as_str(), total["host"].as_str()), ("sum", "laboratory"));
    assert_eq!(total["inputs"], digests[2].unwrap().to_string());
    assert_eq!(total["parameters"], "{padding: 0, power: 1}");
    let run = &store.runs().unwrap().next().unwrap().unwrap();
    assert_eq!(run.stage("total").unwrap().artifact, digests[3].unwrap());
    assert_eq!(total["action"], run.stage("total").unwrap().key.to_string());
}

#[test]
fn an_explanation_names_everything_that_changed() {
    let lab = Laboratory::new();
    lab.run(&[]);
    let explained = |text: &str, stage: &str| {
        let pipeline = lab.pipeline(text, &[]);
        explain(&pipeline, &lab.store(), stage).unwrap()
    };
    let fresh = explained(PIPELINE, "halved");
    assert_eq!((fresh.reasons.len(), fresh.report.outcome), (0, Outcome::Reused));
    assert_eq!((fresh.causes.len(), fresh.last.as_ref().unwrap().is_same), (0, true));
    assert_eq!(fresh.last.unwrap().artifact, fresh.report.digest.unwrap());
    let tweaked = PIPELINE.replace("by: 2", "by: 3").replace("count: 35", "count: 36");
    assert_ne!(tweaked, PIPELINE);
    let stale = explained(&tweaked, "halved");
    let reasons: Vec<String> = stale.reasons.iter().map(ToString::to_string).collect();
    assert_eq!(reasons, ["parameter changed: by from 2 to 3", "input changed: small"]);
    assert_eq!(stale.inputs[0], ("small".to_owned(), None));
    assert!(stale.inputs[1].1.is_some());
    let causes: Vec<String> = stale
        .causes
        .iter()
        .map(|(name, why)| format!("{name}: {}", why[0]))
        .collect();
    assert_eq!(causes, ["small: parameter changed: count from 35 to 36"]);
    assert!(!stale.last.unwrap().is_same);
    // The last run of all had other parameters; it is the one before that did what is asked about.
    lab.run_text(&tweaked, &[]);
    let back = explained(PIPELINE, "halved");
    assert_eq!(back.last.unwrap().artifact, back.report.digest.unwrap());
}

#[test]
fn what_lies_before_a_stage_that_is_reused_explains_nothing() {
    let lab = Laboratory::new();
    let digests = lab.digests(&[]);
    for at in [0, 3] {
        std::fs::remove_file(lab.object(&digests[at].unwrap())).unwrap();
    }
    let pipeline = lab.pipeline(PIPELINE, &[]);
    let found = explain(&pipeline, &lab.store(), "total").unwrap();
    let reasons: Vec<String> = found.reasons.iter().map(ToString::to_string).collect();
    assert_eq!((reasons, found.causes.len()), (vec!["artifact missing".to_owned()], 0));
    let small = explain(&pipeline, &lab.store(), "small").unwrap();
    assert_eq!(small.reasons.len(), 1);
}
