//! Data of the user: patterns to be solved and verified, and patterns with fields as labels.

use std::path::Path;

use deaflow::base::Document;
use deaflow::orchestrator::{Environment, Outcome, Pipeline, RunOptions, run};
use deaflow::stage::registry;
use deaflow::store::Store;
use serde_json::Value;

use super::common::bounded::pipe;
use super::common::{Transcript, Workspace, csv, files, scene_file, snapshot};

const STAGES: &str = "  own:      { kind: patterns, files: [FILES] }
  solved:   { kind: solve, needs: [own], elements_per_cell: 1 }
";

const DESIGNED: &str = "  found:    { kind: design, method: adjoint, units: 20, starts: 1, seed: 1, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5, case: I }
  own:      { kind: patterns, files: [half.csv, left.csv] }
  verified: { kind: verify, needs: [found, own], elements_per_cell: 1 }
";

const LABELLED: &str = "  labels:   { kind: import, files: [FILES] }
";

fn pipeline(stages: &str) -> String {
    format!("version: 1\nname: own\nscene: scene.yaml\nstages:\n{stages}")
}

fn workspace(stages: &str) -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("own.yaml", &pipeline(stages));
    workspace
}

/// Cells of some patterns, no two alike.
fn cells(n: usize) -> Vec<u8> {
    let cell = |i: usize| u8::from((i % 2500 / 50 * 7 + i % 50 + 3 * (i / 2500)) % 50 < 20);
    (0..n * 2500).map(cell).collect()
}

/// Fields that are zero on the frame.
fn fields(n: usize) -> Vec<f64> {
    let value = |i: usize| {
        let (x, y) = (i / 2 % 51, i / 102 % 51);
        let on_frame = [x, y].iter().any(|&place| place == 0 || place == 50);
        if on_frame {
            0.0
        } else {
            ((i * 37 % 101) as f64 - 50.0) / 64.0
        }
    };
    (0..n * 5202).map(value).collect()
}

fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    [
        b"\x93NUMPY\x01\x00",
        &(text.len() as u16).to_le_bytes()[..],
        text.as_bytes(),
        data,
    ]
    .concat()
}

pub fn npz(path: &Path, cells: &[u8], fields: &[f64]) {
    let n = cells.len() / 2500;
    let mut archive = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::STORE);
    let bytes: Vec<u8> = fields.iter().flat_map(|value| value.to_le_bytes()).collect();
    for (name, array) in [
        ("patterns.npy", npy("|u1", &format!("({n}, 50, 50)"), cells)),
        (
            "displacement.npy",
            npy("<f8", &format!("({}, 51, 51, 2)", fields.len() / 5202), &bytes),
        ),
    ] {
        archive.start_file(name, stored).unwrap();
        std::io::Write::write_all(&mut archive, &array).unwrap();
    }
    archive.finish().unwrap();
}

/// Patterns and fields as `deaflow solve` writes them.
pub fn solved(workspace: &Workspace, n: usize) -> (Vec<u8>, Vec<f64>) {
    std::fs::write(
        workspace.path("p.npy"),
        npy("|u1", &format!("({n}, 50, 50)"), &cells(n)),
    )
    .unwrap();
    let ended = workspace.run(&["solve", "scene.yaml", "p.npy", "-o", "solved.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("solved.h5")).unwrap();
    let fields = file.dataset("displacement").unwrap().read_raw().unwrap();
    (cells(n), fields)
}

#[test]
fn the_same_patterns_in_another_file_are_the_same_artifact_and_one_pattern_changes_one_chunk() {
    let workspace = workspace(STAGES);
    let files = |names: &str| format!("stages.own.files=[{names}]");
    let run = |names: &str| workspace.stages(&["run", "own.yaml", "--set", &files(names)]);
    std::fs::write(workspace.path("a.npy"), npy("|u1", "(70, 50, 50)", &cells(70))).unwrap();
    let first = run("a.npy");
    assert_eq!((first.chunks("own"), first.chunks("solved")), ((2, 0), (2, 0)));
    std::fs::write(
        workspace.path("b.npy"),
        npy("<f4", "(69, 50, 50)", &singles(&cells(69))),
    )
    .unwrap();
    let last = &cells(70)[69 * 2500..];
    workspace.write("last.csv", &csv(|x, y| last[y * 50 + x] == 1));
    let again = run("b.npy, last.csv");
    assert_eq!(again.digests(), first.digests());
    assert!(again.with("built").is_empty());
    workspace.write("last.csv", &csv(|x, _| x < 25));
    let changed = run("b.npy, last.csv");
    assert_eq!((changed.chunks("own"), changed.chunks("solved")), ((1, 1), (1, 1)));
}

fn singles(cells: &[u8]) -> Vec<u8> {
    cells.iter().flat_map(|&cell| f32::from(cell).to_le_bytes()).collect()
}

#[test]
fn files_without_valid_patterns_are_refused_before_any_work() {
    let workspace = workspace(STAGES);
    let mut two = cells(3);
    two[2500 + 50 * 3 + 4] = 2;
    std::fs::write(workspace.path("two.npy"), npy("|u1", "(3, 50, 50)", &two)).unwrap();
    std::fs::create_dir(workspace.path("folder.npy")).unwrap();
    pipe(&workspace.path("pipe.npy"));
    std::os::unix::fs::symlink("/dev/zero", workspace.path("zero.npy")).unwrap();
    std::os::unix::fs::symlink("pipe.npy", workspace.path("link.npy")).unwrap();
    let mut printed = Transcript::default();
    for name in [
        "two.npy",
        "none.npy",
        "folder.npy",
        "pipe.npy",
        "link.npy",
        "zero.npy",
        "../own.npy",
        "/etc/passwd",
        "scene.yaml",
    ] {
        let refused = workspace.refused(&["run", "own.yaml", "--set", &format!("stages.own.files=[{name}]")]);
        assert!(refused.contains(name), "{name}: {refused}");
        let is_placed = refused.contains("[1][y=3][x=4]") && refused.contains('2');
        assert!(name != "two.npy" || is_placed, "{refused}");
        printed.add(name, refused);
    }
    let empty = workspace.refused(&["run", "own.yaml", "--set", "stages.own.files=[]"]);
    assert!(empty.contains("`files`"), "{empty}");
    printed.add("no file", empty);
    snapshot!(printed);
    assert!(files(&workspace.path("store")).is_empty(), "no work was done");
}

#[test]
fn an_own_pattern_stands_beside_the_designs_of_each_target() {
    let workspace = workspace(DESIGNED);
    workspace.write("half.csv", &csv(|_, y| y < 25));
    workspace.write("left.csv", &csv(|x, _| x < 10));
    let ended = workspace.run(&["run", "own.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let rows = &ended.json()["results"][0]["rows"];
    let of = |role: &str| -> Vec<Value> {
        rows.as_array()
            .unwrap()
            .iter()
            .filter(|row| row["role"] == role)
            .cloned()
            .collect()
    };
    let (own, optimum) = (of("own"), of("optimum"));
    assert_eq!((own.len(), optimum.len()), (2, 1), "{rows}");
    for row in &own {
        assert!(
            row["predicted_mm"].is_null() && row["difference_mm"].is_null(),
            "nothing has predicted it: {row}"
        );
        assert!(row["simulated_mm"].as_f64().unwrap() < optimum[0]["simulated_mm"].as_f64().unwrap());
        assert!(row["ratio_to_optimum"].as_f64().unwrap() < 1.0);
        assert_eq!((&row["case"], &row["name"]), (&optimum[0]["case"], &optimum[0]["name"]));
    }
    assert_eq!(
        (own[0]["area"].as_f64(), own[1]["area"].as_f64()),
        (Some(0.5), Some(0.2))
    );
    assert_eq!(
        (&own[0]["status"], &own[1]["status"]),
        (&"met".into(), &"area 0.2000, wanted 0.5".into())
    );
    let text = workspace.run(&["run", "own.yaml", "-v"]).stdout;
    let line = text.lines().find(|line| line.contains("2: own")).unwrap();
    for part in ["20.0 %", "0.2000", "0.5"] {
        assert!(line.contains(part), "{line}");
    }
    snapshot!(line);
    let report = workspace.run(&["report", "own.yaml", "-o", "report"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let table = std::fs::read_to_string(workspace.path("report/data/designs.csv")).unwrap();
    assert_eq!(
        table.lines().filter(|line| line.contains(",own,")).count(),
        2,
        "{table}"
    );
    let about = std::fs::read(workspace.path("report/data/csv-metadata.json")).unwrap();
    let about: Value = serde_json::from_slice(&about).unwrap();
    let tables = about["tables"].as_array().unwrap();
    assert_eq!(tables.len(), table.lines().count(), "{about}");
    let verified = workspace.run(&["show", "own.yaml:verified", "--json"]).json()["digest"].clone();
    for table in tables {
        let file = workspace.path("report/data").join(table["url"].as_str().unwrap());
        assert!(
            file.is_file()
                && table["dc:source"]
                    .as_str()
                    .unwrap()
                    .contains(verified.as_str().unwrap())
        );
    }
    let page = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    assert!(page.contains("Own pattern 2"), "the page shows it");
}

#[test]
fn patterns_alone_are_not_verified() {
    let workspace =
        workspace("  own:      { kind: patterns, files: [half.csv] }\n  verified: { kind: verify, needs: [own] }\n");
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let said = workspace.refused(&["run", "own.yaml"]);
    for part in ["1 to 1000", "design", "0", "`own`"] {
        assert!(said.contains(part), "{said}");
    }
    snapshot!(said);
}

#[test]
fn imported_labels_are_audited_balanced_and_used_in_training_and_evaluation() {
    let workspace = workspace(LABELLED);
    let (cells, fields) = solved(&workspace, 24);
    npz(&workspace.path("a.npz"), &cells[..20 * 2500], &fields[..20 * 5202]);
    npz(&workspace.path("b.npz"), &cells[20 * 2500..], &fields[20 * 5202..]);
    let stages = [
        "stages.labels.files=[a.npz]",
        "stages.fresh={ kind: import, files: [b.npz] }",
        "stages.audited={ kind: audit, needs: [labels], samples: 4, seed: 1 }",
        "stages.balanced={ kind: balance, needs: [labels, audited], bins: 5, range: [0 mm, 2.5 mm], target: 80, seed: 1 }",
        "stages.model={ kind: train, needs: [balanced], network: qin2024, epochs: 1, seed: 1 }",
        "stages.judged={ kind: evaluate, needs: [model, fresh] }",
    ];
    let arguments: Vec<&str> = stages.iter().flat_map(|stage| ["--set", stage]).collect();
    let made = workspace.stages(&[&["run", "own.yaml"], &arguments[..]].concat());
    assert_eq!(made.names().len(), 6);
    let again = workspace.stages(&[&["run", "own.yaml"], &arguments[..]].concat());
    assert!(again.with("built").is_empty());
    // The file of `deaflow solve` holds the same numbers.
    let files = "stages.labels.files=[solved.h5]";
    let of_h5 = workspace.stages(&["run", "own.yaml", "--set", files]);
    npz(&workspace.path("all.npz"), &cells, &fields);
    let of_npz = workspace.stages(&["run", "own.yaml", "--set", "stages.labels.files=[all.npz]"]);
    let of_both = workspace.stages(&["run", "own.yaml", "--set", "stages.labels.files=[a.npz, b.npz]"]);
    assert_eq!(of_npz.digests(), of_h5.digests());
    assert_eq!(of_both.digests(), of_h5.digests());
    let other = workspace.refused(&["run", "own.yaml", "--set", files, "--set", "scene.drive.voltage=5 kV"]);
    for part in ["drive.voltage", "5250 V", "5000 V"] {
        assert!(other.contains(part), "{other}");
    }
}

#[test]
fn an_audit_says_whether_imported_labels_agree_with_the_model() {
    let workspace = workspace(LABELLED);
    let (cells, mut fields) = solved(&workspace, 6);
    npz(&workspace.path("a.npz"), &cells, &fields);
    let audit = |file: &str| {
        let set = format!("stages.labels.files=[{file}]");
        workspace.stages(&["run", "own.yaml", "--set", &set]);
        workspace.run(&["audit", "own.yaml:labels", "--set", &set, "--samples", "all", "--json"])
    };
    let sound = audit("a.npz");
    assert_eq!(sound.code, Some(0), "{}{}", sound.stdout, sound.stderr);
    assert_eq!(sound.json()["provenance"]["from_files"], true);
    fields[3 * 5202..4 * 5202].iter_mut().for_each(|value| *value *= 1.2);
    npz(&workspace.path("b.npz"), &cells, &fields);
    let wrong = audit("b.npz");
    assert_ne!(wrong.code, Some(0), "{}", wrong.stdout);
    let findings = &wrong.json()["findings"];
    let errors = findings
        .as_array()
        .unwrap()
        .iter()
        .filter(|finding| finding["severity"] == "error");
    assert!(
        errors
            .clone()
            .any(|finding| finding["examples"].as_array().unwrap().contains(&3.into())),
        "{findings}"
    );
    assert!(errors.count() > 0);
}

#[test]
fn files_without_valid_labels_are_refused_before_any_work() {
    let workspace = workspace(LABELLED);
    npz(&workspace.path("sound.npz"), &cells(3), &fields(3));
    npz(&workspace.path("short.npz"), &cells(3), &fields(2));
    let mut moving = fields(3);
    moving[5202] = 0.25;
    npz(&workspace.path("frame.npz"), &cells(3), &moving);
    pipe(&workspace.path("pipe.npz"));
    std::os::unix::fs::symlink("/dev/zero", workspace.path("zero.h5")).unwrap();
    let sound = std::fs::read(workspace.path("sound.npz")).unwrap();
    std::fs::write(workspace.path("cut.npz"), &sound[..sound.len() / 2]).unwrap();
    let made = |name: &str| hdf5::File::create(workspace.path(name)).unwrap();
    made("scene.h5")
        .new_dataset::<u8>()
        .shape([3, 50, 50])
        .create("patterns")
        .unwrap();
    let mut printed = Transcript::default();
    for (name, parts) in [
        ("short.npz", &["short.npz", "3", "2"][..]),
        ("frame.npz", &["frame.npz", "row 1", "2.500e-1 mm", "[y=0][x=0]"]),
        ("sound.npz, frame.npz", &["frame.npz", "row 1"]),
        ("cut.npz", &["cut.npz"]),
        ("pipe.npz", &["pipe.npz"]),
        ("zero.h5", &["zero.h5"]),
        ("scene.h5", &["`displacement`", "patterns"]),
        ("scene.h5:/patterns", &["scene.h5"]),
        ("scene.yaml", &["`.yaml`"]),
    ] {
        let refused = workspace.refused(&["run", "own.yaml", "--set", &format!("stages.labels.files=[{name}]")]);
        for part in parts {
            assert!(refused.contains(part), "{name}: {part}: {refused}");
        }
        printed.add(name, refused);
    }
    let no_scene = pipeline("  labels: { kind: import, files: [sound.npz] }\n").replace("scene: scene.yaml\n", "");
    workspace.write("without.yaml", &no_scene);
    printed.add("no scene", workspace.refused(&["run", "without.yaml"]));
    snapshot!(printed);
    assert!(files(&workspace.path("store")).is_empty(), "no work was done");
}

/// A file that changes between the reading of the pipeline and the building of a stage.
#[test]
fn nothing_is_built_under_a_key_that_is_not_its_own() {
    let workspace = workspace("");
    npz(&workspace.path("a.npz"), &cells(3), &fields(3));
    workspace.write("a.csv", &csv(|x, _| x < 25));
    let stages = "  own: { kind: patterns, files: [a.csv] }\n  labels: { kind: import, files: [a.npz] }\n";
    let text = pipeline(stages).replace("scene: scene.yaml", &format!("scene: {{ {} }}", flow()));
    let path = workspace.path("own.yaml");
    let read = || Pipeline::read(Document::from_text(&path, &text).unwrap(), &[], &registry()).unwrap();
    let store = Store::open(&workspace.path("made")).unwrap();
    let built = |pipeline: &Pipeline| {
        run(
            pipeline,
            &store,
            &RunOptions::default(),
            &Environment::system(),
            &|_| {},
        )
        .unwrap()
    };
    let before = read();
    let mut other = fields(3);
    other[2 * 52] = 0.125;
    npz(&workspace.path("a.npz"), &cells(3), &other);
    workspace.write("a.csv", &csv(|x, _| x < 10));
    let outcome = built(&before);
    let failure = outcome
        .failures
        .iter()
        .find(|failure| failure.stage == "labels")
        .unwrap();
    snapshot!(failure.error);
    let own = outcome.stages.iter().find(|stage| stage.name == "own").unwrap();
    let cells = store.artifact(&own.digest.unwrap()).unwrap().read("patterns").unwrap();
    let deaflow::store::Data::U8(cells) = cells.data else {
        panic!("cells")
    };
    assert_eq!(
        cells.iter().filter(|cell| **cell == 1).count(),
        1250,
        "what was read was built"
    );
    let after = built(&read());
    assert!(after.failures.is_empty() && after.stages.iter().all(|stage| stage.outcome == Outcome::Built));
}

/// The scene on one line.
fn flow() -> String {
    scene_file().lines().collect::<Vec<_>>().join(", ")
}

#[test]
fn the_corners_that_are_shown_are_read_again() {
    let workspace = workspace(&LABELLED.replace("FILES", "corners.csv"));
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let ended = workspace.run(&["solve", "scene.yaml", "half.csv", "-o", "out.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let shown = workspace.run(&["show", "out.h5", "--corners"]).stdout;
    assert_eq!(shown.lines().count(), 1 + 51 * 51, "{shown:.200}");
    // The middle of the membrane, whose upper right cell is bare.
    let middle = shown.lines().nth(1 + 25 * 51 + 25).unwrap();
    assert!(middle.starts_with("0,25,25,") && middle.ends_with(",0"), "{middle}");
    assert!(
        shown.lines().nth(1 + 50).unwrap().ends_with(","),
        "no cell is right of the frame"
    );
    workspace.write("corners.csv", &shown);
    let ended = workspace.run(&["run", "own.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let again = workspace.run(&["show", "own.yaml:labels", "--corners"]);
    assert_eq!(again.stdout, shown, "{}", again.stderr);
    let none = workspace.run(&["show", "own.yaml:labels", "--corners", "--csv"]);
    assert_eq!(none.code, Some(2), "{}", none.stderr);
}

#[test]
fn rows_that_an_audit_found_or_a_user_marked_are_dropped() {
    let workspace = workspace(&LABELLED.replace("FILES", "a.npz"));
    let (cells, mut fields) = solved(&workspace, 24);
    let wrong = [3, 7];
    for row in wrong {
        fields[row * 5202..(row + 1) * 5202]
            .iter_mut()
            .for_each(|value| *value *= 1.2);
    }
    npz(&workspace.path("a.npz"), &cells, &fields);
    let audit = "stages.audited={ kind: audit, needs: [labels], samples: 0, seed: 1, fail_on: never }";
    let balance = "stages.balanced={ kind: balance, needs: [labels], without: [audited], bins: 5, \
                   range: [0 mm, 2.5 mm], target: 80, symmetry: none, seed: 1 }";
    let checked = "stages.checked={ kind: audit, needs: [balanced], samples: 0, seed: 1 }";
    let made = workspace.stages(&["run", "own.yaml", "--set", audit, "--set", balance, "--set", checked]);
    let digests = made.digests();
    let object = |digest: &str| {
        let objects = files(&workspace.path("store/objects"));
        let found = objects.into_iter().find(|file| file.to_string_lossy().contains(digest));
        hdf5::File::open(found.unwrap()).unwrap()
    };
    let integers = |file: &hdf5::File, path: &str| file.dataset(path).unwrap().read_raw::<u64>().unwrap();
    let balanced = object(&digests["balanced"]);
    assert_eq!(integers(&balanced, "dropped/row"), [3, 7]);
    assert_eq!(integers(&balanced, "dropped/input"), [0, 0]);
    let kept = integers(&balanced, "source");
    assert_eq!(kept.len(), 22);
    assert!(wrong.iter().all(|row| !kept.contains(&(*row as u64))), "{kept:?}");
    // Nothing is wrong with what is left.
    let mut found = integers(&object(&digests["audited"]), "wrong/row");
    found.sort_unstable();
    found.dedup();
    assert_eq!(found, [3, 7]);
    assert!(integers(&object(&digests["checked"]), "wrong/row").is_empty());
    let shown = workspace.run(&["show", "balanced", "--json"]);
    let without = shown.json()["attributes"]["without"]
        .as_str()
        .unwrap_or_default()
        .to_owned();
    assert!(
        without.starts_with("2 rows dropped\naudit ") && without.contains("scale 2"),
        "{without}"
    );
    // What a stage leaves out, and the content of a file, are differences of two runs.
    let all = balance.replace(" without: [audited],", "");
    workspace.stages(&["run", "own.yaml", "--set", audit, "--set", &all]);
    let told = workspace.run(&["diff"]).stdout;
    assert!(told.contains("stages.balanced.without"), "{told}");
    let before = fields[9 * 5202..10 * 5202].to_vec();
    fields[9 * 5202..10 * 5202].iter_mut().for_each(|value| *value *= 1.1);
    npz(&workspace.path("a.npz"), &cells, &fields);
    let plan = workspace.run(&["plan", "own.yaml"]).stdout;
    assert!(plan.contains("file changed: a.npz"), "{plan}");
    let told = workspace.run(&["diff", "own.yaml"]).stdout;
    assert!(told.contains("stages.labels.files"), "{told}");
    fields[9 * 5202..10 * 5202].copy_from_slice(&before);
    npz(&workspace.path("a.npz"), &cells, &fields);
    // Rows that a user has marked, beside those of the audit.
    workspace.write("marked.txt", &format!("# rows of {}\n5\n3\n", digests["labels"]));
    let train = |without: &str| {
        format!(
            "stages.model={{ kind: train, needs: [labels], without: [{without}], network: qin2024, epochs: 1, \
             seed: 1 }}"
        )
    };
    let model = train("audited, marked.txt");
    let made = workspace.stages(&["run", "own.yaml", "--set", audit, "--set", &model]);
    let trained = object(&made.digests()["model"]);
    assert_eq!(integers(&trained, "dropped/row"), [3, 5, 7]);
    let again = workspace.stages(&["run", "own.yaml", "--set", audit, "--set", &model]);
    assert!(again.with("built").is_empty());
    // Another list of rows is another training.
    workspace.write("marked.txt", &format!("# rows of {}\n5\n", digests["labels"]));
    let other = workspace.stages(&["plan", "own.yaml", "--set", audit, "--set", &train("marked.txt")]);
    assert!(!other.with("build").is_empty() || !other.with("stale").is_empty());
    // Lists and audits of other datasets, and what cannot be read.
    workspace.write("marked.txt", "5\n");
    let refused = workspace.refused(&["plan", "own.yaml", "--set", &train("marked.txt")]);
    assert!(refused.contains("line 1 is not \"# rows of DIGEST\""), "{refused}");
    workspace.write("marked.txt", &format!("# rows of {}\nfive\n", digests["labels"]));
    let refused = workspace.refused(&["plan", "own.yaml", "--set", &train("marked.txt")]);
    assert!(refused.contains("line 2: \"five\" is not a row number"), "{refused}");
    let refused = workspace.refused(&["plan", "own.yaml", "--set", &train("labels")]);
    assert!(refused.contains("`labels` is listed twice"), "{refused}");
}

#[test]
fn an_audit_of_another_dataset_is_refused_with_its_position() {
    let workspace = workspace(&LABELLED.replace("FILES", "a.npz"));
    let (cells, fields) = solved(&workspace, 4);
    npz(&workspace.path("a.npz"), &cells, &fields);
    let stages = |fail_on: &str, needs: &str| {
        pipeline(&format!(
            "  labels: {{ kind: import, files: [a.npz] }}
  audited: {{ kind: audit, needs: [labels], fail_on: {fail_on} }}
  balanced: {{ kind: balance, needs: [labels], bins: 5, range: [0 mm, 2.5 mm], target: 80, seed: 1 }}
  model:
    kind: train
    needs: [{needs}]
    without: [audited]
    network: qin2024
    epochs: 1
    seed: 1
"
        ))
    };
    workspace.write("own.yaml", &stages("never", "balanced"));
    let refused = workspace.refused(&["plan", "own.yaml"]);
    assert!(
        refused.contains("`audited` audits `labels`, which stage `model` does not read"),
        "{refused}"
    );
    assert!(refused.contains("own.yaml:11:15"), "{refused}");
    workspace.write("own.yaml", &stages("error", "labels"));
    let refused = workspace.refused(&["plan", "own.yaml"]);
    assert!(refused.contains("add `fail_on: never` to `audited`"), "{refused}");
    workspace.write("own.yaml", &stages("never", "labels, audited"));
    let refused = workspace.refused(&["plan", "own.yaml"]);
    assert!(refused.contains("`audited` is listed twice"), "{refused}");
    workspace.write("own.yaml", &stages("never", "labels"));
    assert_eq!(workspace.run(&["plan", "own.yaml"]).code, Some(0));
}

#[test]
fn marked_rows_of_another_dataset_are_refused_by_plan_with_their_position() {
    let workspace = workspace("");
    let (cells, fields) = solved(&workspace, 4);
    npz(&workspace.path("a.npz"), &cells, &fields);
    let write = |without: &str| {
        workspace.write(
            "own.yaml",
            &pipeline(&format!(
                "  labels: {{ kind: import, files: [a.npz] }}
  audited: {{ kind: audit, needs: [labels], samples: 0, fail_on: never }}
  balanced:
    kind: balance
    needs: [labels]
    without: [{without}]
    bins: 5
    range: [0 mm, 2.5 mm]
    target: 80
    seed: 1
"
            )),
        );
    };
    let other = "00112233".repeat(8);
    workspace.write("marked.txt", &format!("# rows of {other}\n1\n"));
    write("audited, marked.txt");
    // The digest of the labels is not known before they are built.
    assert_eq!(workspace.run(&["plan", "own.yaml"]).code, Some(0));
    let digests = workspace.stages(&["run", "own.yaml", "--until", "labels"]).digests();
    for command in ["plan", "run"] {
        let refused = workspace.refused(&[command, "own.yaml"]);
        let said = "the file marked.txt lists rows of the dataset 001122330011, which is not an input";
        for part in [said, "own.yaml:10:24", &digests["labels"][..12]] {
            assert!(refused.contains(part), "{command}: {part}: {refused}");
        }
    }
    workspace.write("marked.txt", &format!("# rows of {}\n1\n", digests["labels"]));
    assert_eq!(workspace.run(&["plan", "own.yaml"]).code, Some(0));
    workspace.write("marked.txt", &format!("# rows of {}\n1\n1000\n", digests["labels"]));
    let refused = workspace.refused(&["plan", "own.yaml"]);
    for part in [
        "the file marked.txt lists row 1000 of the dataset",
        "which has 4 rows",
        "own.yaml:10:24",
    ] {
        assert!(refused.contains(part), "{part}: {refused}");
    }
    workspace.write("marked.txt", &format!("# rows of {}\n3\n", digests["labels"]));
    assert_eq!(workspace.run(&["plan", "own.yaml"]).code, Some(0));
    for (twice, position, message) in [
        (
            "marked.txt, ./marked.txt",
            "own.yaml:10:27",
            "the file ./marked.txt is listed twice",
        ),
        ("audited, audited", "own.yaml:10:24", "`audited` is listed twice"),
    ] {
        write(twice);
        let refused = workspace.refused(&["plan", "own.yaml"]);
        assert!(refused.contains(position) && refused.contains(message), "{refused}");
    }
    workspace.write(
        "own.yaml",
        &pipeline("  labels: { kind: import, files: [a.npz, ./a.npz] }\n"),
    );
    let refused = workspace.refused(&["plan", "own.yaml"]);
    assert!(refused.contains("the file ./a.npz is listed twice"), "{refused}");
}
