//! Pipelines that are refused, and where the caret stands.

use miette::Diagnostic;

use super::*;

/// Message, the underlined text, and the advice.
fn refusal(text: &str, sets: &[&str]) -> (String, String, String) {
    let lab = Laboratory::new();
    let document = Document::from_text(Path::new("toy.yaml"), text).unwrap();
    let sets: Vec<Override> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    let error = Pipeline::read(document, &sets, &lab.registry)
        .err()
        .expect("must be refused");
    (
        error.to_string(),
        underlined(&error),
        Diagnostic::help(&error).map_or_else(String::new, |help| help.to_string()),
    )
}

fn underlined(error: &InputError) -> String {
    let label = error.labels().unwrap().next().unwrap();
    let source = error.source_code().unwrap();
    let contents = source.read_span(label.inner(), 0, 0).unwrap();
    String::from_utf8(contents.data().to_vec()).unwrap()
}

fn with_stages(stages: &str) -> String {
    format!("version: 1\nname: toy\nstages:\n{stages}")
}

#[test]
fn each_mistake_is_named_underlined_and_set_right() {
    let one = "  a: { kind: count, count: 3 }\n";
    let cases = [
        (
            "  a: { kind: coumt, count: 3 }\n".to_owned(),
            "`kind` cannot be \"coumt\"",
            "coumt",
            "did you mean `count`?",
        ),
        (
            "  a: { count: 3 }\n".to_owned(),
            "`kind` is missing in stage `a`",
            "a",
            "count, divide, sum",
        ),
        (
            format!("{one}  b: {{ kind: sum, needs: [aa] }}\n"),
            "no stage is named `aa`",
            "aa",
            "did you mean `a`?",
        ),
        (
            format!("{one}  b: {{ kind: sum, needs: [a, a] }}\n"),
            "`a` is listed twice",
            "a",
            "name it once, in `needs` or in another key",
        ),
        (
            format!("{one}  b: {{ kind: sum, needs: a }}\n"),
            "`needs` must be a list, found \"a\"",
            "a",
            "",
        ),
        (
            format!("{one}  b: {{ kind: sum }}\n"),
            "stage `b` needs 1 to 2 stages of kind count or divide or sum, found 0",
            "b",
            "a",
        ),
        (
            format!("{one}  b: {{ kind: sum, need: [a] }}\n"),
            "unknown key `need` in a `sum` stage",
            "need",
            "did you mean `needs`?",
        ),
        (
            format!("{one}  b: {{ kind: count, count: 1, needs: [a] }}\n"),
            "a `count` stage has no `needs`",
            "a",
            "",
        ),
        (
            format!("{one}  s: {{ kind: sum, needs: [a] }}\n  d: {{ kind: divide, needs: [s], by: 2 }}\n"),
            "a `divide` stage needs count or divide, but `s` is of kind sum",
            "s",
            "allowed: a, d",
        ),
        (
            "  a: { kind: count, cuont: 3 }\n".to_owned(),
            "unknown key `cuont` in a `count` stage",
            "cuont",
            "did you mean `count`?",
        ),
        (
            "  a: { kind: count, count: 0 }\n".to_owned(),
            "`count` must be an integer from 1 to 100000, found 0",
            "0",
            "",
        ),
        (
            "  a b: { kind: count, count: 3 }\n".to_owned(),
            "a stage cannot be named \"a b\"",
            "a b",
            "letters, digits",
        ),
        ("  a: 3\n".to_owned(), "`stages.a` must be a mapping, found 3", "3", ""),
        ("  {}\n".to_owned(), "the pipeline has no stages", "{", ""),
    ];
    for (stages, message, caret, help) in cases {
        let (found, under, advice) = refusal(&with_stages(&stages), &[]);
        assert_eq!((found.as_str(), under.as_str()), (message, caret));
        assert!(advice.contains(help), "{found}: {advice}");
    }
}

#[test]
fn circles_are_shown_stage_by_stage() {
    let own = with_stages("  a: { kind: sum, needs: [a] }\n");
    let (message, caret, _) = refusal(&own, &[]);
    assert_eq!(
        (message.as_str(), caret.as_str()),
        ("the stages need each other in a cycle: `a` needs `a`", "a")
    );
    let circle = "  x: { kind: count, count: 1 }
  a: { kind: sum, needs: [b] }
  b: { kind: sum, needs: [x, c] }
  c: { kind: sum, needs: [b] }
";
    let (message, caret, _) = refusal(&with_stages(circle), &[]);
    assert_eq!(
        message,
        "the stages need each other in a cycle: `b` needs `c` needs `b`"
    );
    assert_eq!(caret, "c");
}

#[test]
fn the_frame_of_a_pipeline_is_checked_too() {
    let stages = "stages: { a: { kind: count, count: 1 } }\n";
    let cases = [
        (
            format!("version: 2\nname: toy\n{stages}"),
            "`version` is 2: this deaflow reads version 1",
        ),
        (format!("version: 1\n{stages}"), "`name` is missing in the pipeline"),
        (
            format!("version: 1\nname: toy\nstage: 1\n{stages}"),
            "unknown key `stage` in the pipeline",
        ),
        (
            "version: 1\nname: toy\n".to_owned(),
            "`stages` is missing in the pipeline",
        ),
        (
            format!("version: 1\nname: toy\nscene: {{ drvie: 1 }}\n{stages}"),
            "unknown key `drvie` in the scene",
        ),
        (
            format!("version: 1\nname: toy\nscene: no.yaml\n{stages}"),
            "the scene file no.yaml does not exist",
        ),
    ];
    for (text, message) in cases {
        assert_eq!(refusal(&text, &[]).0, message);
    }
}

#[test]
fn overrides_are_held_to_the_same_rules_and_underlined_in_themselves() {
    let (message, caret, _) = refusal(PIPELINE, &["stages.small.count=0"]);
    assert_eq!(
        (message.as_str(), caret.as_str()),
        ("`count` must be an integer from 1 to 100000, found 0", "0")
    );
    let (message, caret, _) = refusal(PIPELINE, &["scene.drive.voltage=10000"]);
    assert_eq!(
        (message.as_str(), caret.as_str()),
        ("`voltage` must be an integer from 0 to 9000, found 10000", "10000")
    );
    assert_eq!(refusal(PIPELINE, &["stages.small.needs=[total]"]).1, "total");
    // A misspelt key is underlined itself, not its value.
    assert_eq!(refusal(PIPELINE, &["stages.small.cuont=3"]).1, "cuont");
    assert_eq!(refusal(PIPELINE, &["stages.smal.count=3"]).1, "smal");
}

#[test]
fn a_scene_in_a_file_is_found_beside_the_pipeline_and_can_be_overridden() {
    let lab = Laboratory::new();
    let folder = lab.folder.path();
    std::fs::create_dir(folder.join("scenes")).unwrap();
    std::fs::write(folder.join("scenes/s.yaml"), "drive:\n  voltage: 99999\n").unwrap();
    let path = folder.join("toy.yaml");
    std::fs::write(&path, PIPELINE.replace("{ drive: { voltage: 5 } }", "scenes/s.yaml")).unwrap();
    let error = Pipeline::load(&path, &[], &lab.registry).err().unwrap();
    assert_eq!(underlined(&error), "99999");
    let set = [Override::parse("scene.drive.voltage=7").unwrap()];
    assert!(Pipeline::load(&path, &set, &lab.registry).is_ok());
}
