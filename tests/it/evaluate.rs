//! A model is judged on what it never saw: beside estimates, by family, with intervals; and judgements that mean
//! nothing are refused.

use serde_json::Value;

use super::common::{Transcript, Workspace, snapshot, snapshots::without_numbers};

const FRESH: &str = "stages.blobs={ kind: sample, family: blobs, count: 6, seed: 12 }";
const SOLVED: &str = "stages.fresh={ kind: solve, needs: [blobs], elements_per_cell: 1 }";
const MORE: &str = "stages.more={ kind: sample, family: small-grid, count: 90, seed: 14 }";
const UNSEEN: &str = "stages.unseen={ kind: solve, needs: [more], elements_per_cell: 1 }";
const INTERVALS: &str = "stages.intervals={ kind: calibrate, needs: [surrogate, unseen], seed: 1 }";
const EVALUATED: &str = "stages.evaluated={ kind: evaluate, needs: [surrogate, intervals, fresh, balanced], estimates: [linear, \"chord:1\"] }";

/// A pipeline with more stages, run until one of them.
fn arguments<'a>(pipeline: &'a str, until: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec!["run", pipeline, "--until", until, "--json"];
    more.iter().for_each(|stage| arguments.extend(["--set", stage]));
    arguments
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn a_balanced_set_without_test_rows_is_named_as_the_cause() {
    let workspace = Workspace::tiny();
    let few = [
        "stages.small.count=2",
        "stages.large.count_per_units=1",
        "stages.large.units=[5]",
        "stages.balanced.target=4",
        "stages.judged={ kind: evaluate, needs: [balanced], estimates: [linear] }",
    ];
    let ended = workspace.run(&arguments("tiny.yaml", "judged", &few));
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    for part in ["only its test rows are used", "one in ten is for tests"] {
        assert!(ended.stderr.contains(part), "{}", ended.stderr);
    }
}

#[test]
fn a_model_is_compared_with_estimates() {
    let workspace = Workspace::tiny();
    let stages = [FRESH, SOLVED, MORE, UNSEEN, INTERVALS, EVALUATED];
    let ended = workspace.run(&arguments("tiny.yaml", "evaluated", &stages));
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let evaluation = &document["evaluations"][0];
    let names: Vec<&str> = evaluation["predictors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|p| p["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["surrogate", "linear", "chord:1"]);
    let families: Vec<&str> = evaluation["families"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| f.as_str().unwrap())
        .collect();
    assert!(
        families.contains(&"blobs") && families.ends_with(&["all"]),
        "{families:?}"
    );
    let blobs = families.iter().position(|family| *family == "blobs").unwrap();
    let errors: Vec<Vec<f64>> = evaluation["predictors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|p| numbers(&p["rmse_mm"]))
        .collect();
    // A network that has hardly learned loses to the linear response, and that to a chord step.
    assert!(
        errors[0][blobs] > errors[1][blobs] && errors[1][blobs] > errors[2][blobs],
        "{errors:?}"
    );
    assert_eq!(evaluation["predictors"][0]["samples"][blobs], 6);
    let tested = evaluation["predictors"][0]["samples"][families.len() - 1]
        .as_u64()
        .unwrap();
    assert!(
        (7..40).contains(&tested),
        "of the balanced set only test rows count: {tested}"
    );
    let coverage = &evaluation["calibrations"][0];
    assert_eq!(coverage["name"], "intervals");
    assert!(
        numbers(&coverage["field"])
            .iter()
            .all(|share| (0.0..=1.0).contains(share))
    );
    assert_eq!(numbers(&coverage["unlike"])[blobs], 1.0, "blobs are unlike small grids");
    assert_eq!(
        (&coverage["unflagged"][blobs], &coverage["calibrated"][blobs]),
        (&0.into(), &0.into())
    );
    let small = families.iter().position(|family| *family == "small-grid").unwrap();
    assert_eq!(coverage["calibrated"][small], 90);
    let trained = &evaluation["predictors"][0]["trained"];
    assert_eq!((&trained[blobs], &trained[small]), (&false.into(), &true.into()));
    assert_eq!(
        evaluation["predictors"][1]["trained"][small], false,
        "an estimate learns nothing"
    );
    // The text names the families on which the errors and the intervals were measured.
    let mut for_people = arguments("tiny.yaml", "evaluated", &stages);
    for_people.retain(|argument| *argument != "--json");
    for_people.push("-v");
    let text = workspace.run(&for_people).stdout;
    assert!(text.contains("small-grid") && text.contains("blobs"), "{text}");
    snapshot!(without_numbers(&text), "text");
    assert!(document["figures"].to_string().contains("evaluation.png"));

    // Another name of the model is another name in the report, and no other artifact.
    let digest = |document: &Value| {
        let stages = document["stages"].as_array().unwrap();
        stages.iter().find(|s| s["name"] == "evaluated").unwrap()["digest"].clone()
    };
    let text = std::fs::read_to_string(workspace.path("tiny.yaml")).unwrap();
    let renamed = |text: &str| {
        let name = |before: &str, after: &str| (format!("{before}surrogate{after}"), format!("{before}model{after}"));
        let places = [name("  ", ":"), name("[", "]"), name("[", ",")];
        places
            .iter()
            .fold(text.to_owned(), |text, (from, to)| text.replace(from, to))
    };
    workspace.write("renamed.yaml", &renamed(&text));
    let renamed: Vec<String> = stages.iter().map(|stage| renamed(stage)).collect();
    let renamed: Vec<&str> = renamed.iter().map(String::as_str).collect();
    let again = workspace.run(&arguments("renamed.yaml", "evaluated", &renamed)).json();
    assert_eq!(again["evaluations"][0]["predictors"][0]["name"], "model");
    assert_eq!(digest(&again), digest(&document));

    let ended = |code: i32, until: &str, stages: &[&str]| {
        let ended = workspace.run(&arguments("tiny.yaml", until, stages));
        assert_eq!(ended.code, Some(code), "{}", ended.stdout);
        ended.json()["error"]["message"].to_string()
    };
    let said = |until: &str, stages: &[&str]| ended(1, until, stages);
    // What the file already says is refused before any work.
    let refused = |until: &str, stages: &[&str]| ended(2, until, stages);
    let nothing = "stages.evaluated={ kind: evaluate, needs: [fresh] }";
    let mut printed = Transcript::default();
    printed.add("no model", refused("evaluated", &[FRESH, SOLVED, nothing]));
    let no_labels = "stages.evaluated={ kind: evaluate, needs: [surrogate] }";
    printed.add("no labels", refused("evaluated", &[no_labels]));
    let other = "stages.evaluated={ kind: evaluate, needs: [intervals, fresh], estimates: [linear] }";
    let message = refused("evaluated", &[FRESH, SOLVED, MORE, UNSEEN, INTERVALS, other]);
    printed.add("a calibration of another model", message);
    let guessed = "stages.fresh={ kind: solve, needs: [blobs], method: linear }";
    let message = said(
        "evaluated",
        &[
            FRESH,
            guessed,
            "stages.evaluated={ kind: evaluate, needs: [surrogate, fresh] }",
        ],
    );
    printed.add("estimates as labels", message);

    let few = "stages.more={ kind: sample, family: small-grid, count: 20, seed: 14 }";
    let message = refused("intervals", &[few, UNSEEN, INTERVALS]);
    assert!(message.contains("80") && message.contains("20"), "{message}");
    printed.add("too few patterns", message);
    let strangers = "stages.more={ kind: sample, family: stripes, count: 90, seed: 14 }";
    let message = refused("intervals", &[strangers, UNSEEN, INTERVALS]);
    assert!(message.contains('0') && message.contains("small-grid"), "{message}");
    printed.add("other families", message);
    let seen = "stages.surrogate={ kind: train, needs: [unseen], network: qin2024, epochs: 1, seed: 5 }";
    let message = refused("intervals", &[MORE, UNSEEN, seen, INTERVALS]);
    printed.add("patterns of the training", message);
    snapshot!(printed);
}
