//! Pipelines, scenes, values of `--set`, lock files, objectives and constraints.

use std::fs;
use std::path::{Path, PathBuf};

use bolero::check;
use deaflow::base::{Document, InputError, Node, NodeValue, Override};
use deaflow::design::{ConstraintParameters, Objective};
use deaflow::orchestrator::Pipeline;
use deaflow::pattern::Membrane;
use deaflow::scene::Scene;
use deaflow::stage::registry;
use deaflow::store::LockFile;
use miette::Diagnostic as _;

use super::checked::{check_message, checked};
use super::mutate::Seeds;

const YAML: &[&str] = &[
    "[",
    "]",
    "{",
    "}",
    ": ",
    ":",
    "- ",
    "? ",
    "&a ",
    "*a",
    "!!str ",
    "!x",
    "\n",
    "\n  ",
    "\t",
    "\"",
    "'",
    "#",
    "|\n",
    ">-\n",
    "%YAML 1.2\n",
    "---\n",
    "...\n",
    "1e5",
    "0x",
    ".nan",
    "-.inf",
    "~",
    "é",
    "\u{feff}",
    "<<: ",
    "\\u12",
    ", ",
    "\r\n",
    " mm",
    " kV",
    "1e308",
    "-1",
    "0",
    "true",
    "auto",
    "effects: ",
    "kind: ",
    "needs: ",
    "rounds: ",
    "\u{1b}[2J",
];

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

fn yaml_in(name: &str) -> Vec<Vec<u8>> {
    let entries = fs::read_dir(folder(name)).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<PathBuf> = entries
        .filter(|path| path.extension().is_some_and(|e| e == "yaml"))
        .collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).unwrap()).collect()
}

fn refused(error: &InputError) {
    check_message(&error.to_string());
    if let Some(help) = error.help() {
        check_message(&help.to_string());
    }
}

fn root(text: &str) -> Option<Node> {
    // Beside the pipelines, so that files which they name are found.
    Document::from_text(&folder("pipelines/fuzzed.yaml"), text)
        .inspect_err(refused)
        .ok()
        .map(|document| document.root)
}

/// A document with the constructs of YAML that pipelines rarely use.
const DOCUMENT: &str = "\
version: 1
scene:
  drive: &drive { voltage: 5.25 kV, \"other\": 'it''s' }
stages: # é
  small: { kind: sample, units: [2, 3], count: 60, again: *drive }
  block: |
    text
     more
  ? key
  : - 1e-5
    - ~
";

#[test]
fn trees() {
    let seeds = Seeds::new("yaml", [DOCUMENT.as_bytes().to_vec()], YAML);
    let read = checked(&seeds, |bytes| {
        let text = String::from_utf8_lossy(bytes);
        // The same text can be a value of `--set`.
        if let Ok(set) = Override::parse(&format!("stages.small.count={text}")) {
            let mut root = root(DOCUMENT).unwrap();
            set.apply(&mut root).unwrap();
        }
        match Document::from_text(Path::new("t.yaml"), &text) {
            Ok(document) => check_node(&document.root, &text),
            Err(error) => check_position(&error, &text),
        }
        root(&text).is_some()
    });
    check!().with_iterations(600).for_each(read);
}

fn check_node(node: &Node, text: &str) {
    assert!(node.position().starts_with("t.yaml:"));
    check_position(&node.error("refused"), text);
    assert!(node.found().len() <= 10 * text.len() + 20);
    if let Err(error) = node.fields("it", &["version"]) {
        check_message(&error.to_string());
    }
    match node.value() {
        NodeValue::List(items) => items.iter().for_each(|item| check_node(item, text)),
        NodeValue::Map(entries) => entries.iter().for_each(|(key, value)| {
            check_node(key, text);
            check_node(value, text);
        }),
        _ => {}
    }
}

/// Checks that the underlined range consists of entire characters of the text.
fn check_position(error: &InputError, text: &str) {
    let label = error.labels().unwrap().next().unwrap();
    let range = label.offset()..label.offset() + label.len();
    assert!(text.get(range.clone()).is_some(), "{range:?} in {text:?}");
}

#[test]
fn pipelines() {
    let seeds = Seeds::new("pipeline", yaml_in("pipelines"), YAML);
    let read = checked(&seeds, move |bytes| {
        let text = String::from_utf8_lossy(bytes);
        let Ok(document) = Document::from_text(&folder("pipelines/fuzzed.yaml"), &text).inspect_err(refused) else {
            return false;
        };
        let read = Pipeline::read(document, &[], &registry()).inspect_err(refused);
        if let Ok(pipeline) = &read {
            for stage in &pipeline.stages {
                check_message(&format!("{:.100}", stage.stage().parameters().to_string()));
            }
            assert!(pipeline.selection(None).is_ok());
        }
        read.is_ok()
    });
    check!().with_iterations(150).for_each(read);
}

#[test]
fn scenes() {
    let seeds = Seeds::new("scene", yaml_in("pipelines/scenes"), YAML);
    let read = checked(&seeds, |bytes| {
        let Ok(scene) = Scene::from_text(&String::from_utf8_lossy(bytes)).inspect_err(refused) else {
            return false;
        };
        let again = Scene::from_text(&scene.to_text()).unwrap();
        assert_eq!(again, scene, "{}", scene.to_text());
        assert!(scene.kappa() >= 0.0 && scene.prestretched_thickness_mm() > 0.0);
        true
    });
    check!().with_iterations(600).for_each(read);
}

#[test]
fn values_of_the_command_line() {
    let sets = [
        "stages.surrogate.epochs=2",
        "scene.drive.voltage=\"5.25 kV\"",
        "scene.effects={ strain_stiffening: { model: gent, jm: 30 } }",
        "stages.design.generations=10",
    ];
    let seeds = Seeds::new("set", sets.map(|text| text.as_bytes().to_vec()), YAML);
    let file = folder("pipelines/quickstart.yaml");
    let text = fs::read_to_string(&file).unwrap();
    let read = checked(&seeds, move |bytes| {
        let Ok(set) = Override::parse(&String::from_utf8_lossy(bytes)).inspect_err(refused) else {
            return false;
        };
        let document = Document::from_text(&file, &text).unwrap();
        Pipeline::read(document, &[set], &registry())
            .inspect_err(refused)
            .is_ok()
    });
    check!().with_iterations(300).for_each(read);
}

#[test]
fn lock_files() {
    let digest = |of: &str| deaflow::base::Digest::of(of.as_bytes()).to_string();
    let valid = format!(
        "version: 1\npipeline: \"p\"\ntarget: \"x86_64-linux\"\nstages:\n  \"a b\":\n    key: \"{}\"\n    artifact: \"{}\"\n",
        digest("key"),
        digest("artifact")
    );
    let seeds = Seeds::new("lock", [valid.into_bytes()], YAML);
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("p.yaml.lock");
    let read = checked(&seeds, move |bytes| {
        fs::write(&path, bytes).unwrap();
        let read = LockFile::read(&path).inspect_err(refused);
        if let Ok(lock) = &read {
            fs::write(&path, lock.text()).unwrap();
            assert_eq!(&LockFile::read(&path).unwrap(), lock, "{}", lock.text());
        }
        read.is_ok()
    });
    check!().with_iterations(400).for_each(read);
}

#[test]
fn objectives() {
    let valid = [
        "{ point: [25 mm, 25 mm], direction: 45 deg }",
        "{ point: [12.5 mm, 25 mm], direction: 0 deg, value: 0.5 mm }",
        "{ points: [{ point: [37.5 mm, 37.5 mm], direction: 225 deg, weight: 2 }, { point: [1 mm, 2 mm], direction: 10 deg }] }",
        "{ points: [{ point: [3 mm, 3 mm], displacement: [0.1 mm, -0.2 mm] }] }",
        "{ field: fields/pinch.csv }",
    ];
    let seeds = Seeds::new("objective", valid.map(|text| text.as_bytes().to_vec()), YAML);
    let read = checked(&seeds, |bytes| {
        let Some(node) = root(&String::from_utf8_lossy(bytes)) else {
            return false;
        };
        let read = Objective::read(&node).inspect_err(refused);
        if let Ok(objective) = &read {
            let text = objective.to_text();
            let again = Objective::read(&root(&text).unwrap()).unwrap_or_else(|e| panic!("{text}: {e}"));
            assert_eq!(again.to_text(), text);
            if let Err(error) = objective.goal(&Scene::vhb4910(), Some(0.5), 1.0) {
                check_message(&error.to_string());
            }
        }
        read.is_ok()
    });
    check!().with_iterations(600).for_each(read);
}

#[test]
fn constraints() {
    let valid = [
        "{ min_feature: 2 mm, islands: 3, leads: [left] }",
        "{ keep_out: [{ rectangle: [[0 mm, 0 mm], [10 mm, 10 mm]] }, { disc: { centre: [25 mm, 25 mm], radius: 5 mm } }] }",
        "{ breakdown_margin: 1.5, pull_in_margin: 1.2 }",
        "{}",
    ];
    let seeds = Seeds::new("constraint", valid.map(|text| text.as_bytes().to_vec()), YAML);
    let read = checked(&seeds, |bytes| {
        let Some(node) = root(&String::from_utf8_lossy(bytes)) else {
            return false;
        };
        let read = ConstraintParameters::read(&node, Membrane::square(50.0)).inspect_err(refused);
        if let Ok(constraints) = &read {
            let text = constraints.to_text();
            let again = ConstraintParameters::read(&root(&text).unwrap(), Membrane::square(50.0))
                .unwrap_or_else(|e| panic!("{text}: {e}"));
            assert_eq!(again.to_text(), text);
        }
        read.is_ok()
    });
    check!().with_iterations(600).for_each(read);
}

#[test]
fn wanted_fields() {
    let seeds = Seeds::new(
        "field",
        [fs::read(folder("pipelines/fields/pinch.csv")).unwrap()],
        &[
            "\n", ",", "\"", "x_mm", "1e308", "nan", "inf", "-0", "\r", "é", "#", ";",
        ],
    );
    let place = tempfile::tempdir().unwrap();
    let pipeline = place.path().join("p.yaml");
    let read = checked(&seeds, move |bytes| {
        fs::write(pipeline.with_file_name("f.csv"), bytes).unwrap();
        let document = Document::from_text(&pipeline, "{ field: f.csv }").unwrap();
        Objective::read(&document.root).inspect_err(refused).is_ok()
    });
    check!().with_iterations(600).for_each(read);
}
