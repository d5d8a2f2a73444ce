//! The audit: of a stage, which is cached and can stop a pipeline, and of a file from elsewhere; faults that are
//! planted are found, and sound datasets give no finding.

use std::path::Path;

use serde_json::Value;

use super::common::bounded::pipe;
use super::common::{Ended, Transcript, Workspace, files, snapshot};
use super::h5py::python;

const SCENE: &str = "geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 5.25 kV }
effects: {}
";

/// A film of silicone, thinner and smaller, with stiffening and electrodes that weigh.
const FILM: &str = "geometry: { side: 20 mm, thickness: 20 um, prestretch: 1.3, cells: 50 }
material: { model: neo-hookean, shear_modulus: 0.59 MPa, relative_permittivity: 2.8 }
drive: { voltage: 1 kV }
effects: { strain_stiffening: { model: gent, jm: 30.04 } }
";

const PIPELINE: &str = "version: 1
name: audited
scene: scene.yaml
stages:
  small:     { kind: sample, family: small-grid, count: 20, seed: 1 }
  large:     { kind: sample, family: large-grid, units: [2, 3, 5], count_per_units: 6, seed: 2 }
  bezier:    { kind: sample, family: bezier, count: 12, seed: 3 }
  solved:    { kind: solve, needs: [small, large, bezier], elements_per_cell: 1 }
  balanced:  { kind: balance, needs: [solved], bins: 10, range: [0 mm, 2.5 mm], target: 60, symmetry: d4, seed: 4 }
  audited:   { kind: audit, needs: [balanced], samples: 4, seed: 7 }
  surrogate: { kind: train, needs: [balanced, audited], network: qin2024, epochs: 1, seed: 5 }
";

fn workspace() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", SCENE);
    workspace.write("film.yaml", FILM);
    workspace.write("p.yaml", PIPELINE);
    workspace
}

fn checks(found: &Value) -> Vec<(String, Vec<u64>)> {
    let findings = found["findings"].as_array().unwrap_or_else(|| panic!("{found}"));
    let rows = |f: &Value| {
        f["examples"]
            .as_array()
            .unwrap()
            .iter()
            .map(|i| i.as_u64().unwrap())
            .collect()
    };
    findings
        .iter()
        .map(|f| (f["check"].as_str().unwrap().to_owned(), rows(f)))
        .collect()
}

/// The checks, without their rows.
fn names(ended: &Ended) -> Vec<String> {
    checks(&ended.json()).into_iter().map(|(name, _)| name).collect()
}

#[test]
fn a_stage_is_audited_cached_and_shown() {
    let workspace = workspace();
    let missing = workspace.run(&["audit", "p.yaml:balanced"]);
    assert_eq!(missing.code, Some(2), "{}", missing.stderr);
    workspace.stages(&["run", "p.yaml", "--until", "balanced"]);
    for stage in ["solved", "balanced"] {
        let name = format!("p.yaml:{stage}");
        let ended = workspace.run(&["audit", &name, "--samples", "5", "--json"]);
        assert_eq!(ended.code, Some(0), "{}\n{}", ended.stdout, ended.stderr);
        let found = ended.json();
        assert_eq!(checks(&found), [], "{stage}");
        assert_eq!(
            found["summary"]["compared"], 0,
            "one bilinear element is cheap: all are solved again"
        );
        assert_eq!(found["summary"]["solved_again"], found["summary"]["samples"]);
        assert_eq!(found["provenance"]["seeds"], serde_json::json!(["1", "2", "3"]));
        assert_eq!(found["summary"]["resimulated"]["samples"], 5);
        let excluded = found["summary"]["resimulated"]["excluded_above"].as_f64().unwrap();
        assert!(excluded > 0.3 && excluded < 1.0 - 0.05_f64.powf(0.2), "{excluded}");
        let again = workspace.run(&["audit", &name, "--samples", "5", "--json"]);
        assert!(again.stderr.contains("reused"), "{}", again.stderr);
        assert_eq!(again.json(), found);
        let artifact = found["artifact"].as_str().unwrap();
        let shown = workspace.run(&["show", artifact, "--json"]).json();
        assert_eq!(shown["provenance"]["kind"], "audit");
        assert!(shown["attributes"]["findings"].as_str().unwrap().starts_with('['));
    }
    let ended = workspace.run(&["audit", "p.yaml:balanced", "-o", "out"]);
    snapshot!(ended);
    let page = std::fs::read_to_string(workspace.path("out/audit.html")).unwrap();
    assert!(page.contains("<svg class=\"chart\"") && !page.contains("http") && !page.contains("src="));
    let no_dataset = workspace.run(&["audit", "p.yaml:small"]);
    assert_eq!(no_dataset.code, Some(2), "{}", no_dataset.stderr);
    // What the pipeline would make now is not what is there.
    let stale = workspace.run(&["audit", "p.yaml:balanced", "--set", "stages.balanced.seed=9", "--json"]);
    assert_eq!((stale.code, names(&stale)), (Some(5), vec!["stale".to_owned()]));
    let stale = workspace.run(&["audit", "p.yaml:solved", "--set", "scene.drive.voltage=5 kV", "--json"]);
    assert_eq!((stale.code, names(&stale)), (Some(5), vec!["stale".to_owned()]));
}

#[test]
fn damage_and_lost_origins_are_findings() {
    let workspace = workspace();
    let digests = workspace.stages(&["run", "p.yaml", "--until", "balanced"]).digests();
    let objects = files(&workspace.path("store/objects"));
    let of = |stage: &str| {
        objects
            .iter()
            .find(|f| f.to_string_lossy().contains(&digests[stage]))
            .unwrap()
    };
    std::fs::remove_file(of("bezier")).unwrap();
    let ended = workspace.run(&["audit", "p.yaml:balanced", "--samples", "2", "--json"]);
    assert_eq!(
        (ended.code, names(&ended)),
        (Some(5), vec!["provenance".to_owned()]),
        "{}",
        ended.stderr
    );
    assert!(!of("bezier").exists(), "an audit builds nothing that is missing");
    let again = workspace.run(&["audit", "p.yaml:balanced", "--samples", "2", "--json"]);
    assert_eq!(names(&again), ["provenance"], "and finds it missing every time");
    let mut bytes = std::fs::read(of("balanced")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(of("balanced"), bytes).unwrap();
    let ended = workspace.run(&["audit", "p.yaml:balanced", "--json"]);
    assert_eq!(
        (ended.code, names(&ended)),
        (Some(5), vec!["integrity".to_owned()]),
        "{}",
        ended.stderr
    );
}

#[test]
fn an_audit_with_errors_stops_what_waits_for_it() {
    let workspace = workspace();
    let strict = ["--set", "stages.audited.accuracy=1e-6 mm"];
    let run = |more: &[&str]| workspace.run(&[&["run", "p.yaml", "--json"], more].concat());
    let ended = run(&strict);
    assert_eq!(ended.code, Some(5), "{}", ended.stderr);
    assert!(ended.stderr.contains("accuracy (4)"), "{}", ended.stderr);
    let outcome = |ended: &Ended, stage: &str| {
        let document = ended.json();
        let stages = document["stages"].as_array().unwrap();
        let found = stages.iter().find(|s| s["name"] == stage);
        found.map(|s| s["outcome"].as_str().unwrap().to_owned())
    };
    assert_eq!(outcome(&ended, "audited").as_deref(), Some("built"));
    assert_eq!(outcome(&ended, "surrogate").as_deref(), Some("skipped"));
    assert!(ended.stderr.contains("`audited`"), "{}", ended.stderr);
    let ended = run(&[&strict[..], &["--keep-going"]].concat());
    assert_eq!(ended.code, Some(5));
    assert_eq!(outcome(&ended, "surrogate").as_deref(), Some("skipped"));
    let shown = workspace.run(&["show", "audited", "--json"]).json();
    assert!(
        shown["attributes"]["findings"]
            .as_str()
            .unwrap()
            .contains("\"accuracy\""),
        "{shown}"
    );
    // People read a table of the findings, not JSON.
    let shown = workspace.run(&["show", "audited"]).stdout;
    let table = ["severity", "accuracy", "random samples on a finer mesh"];
    assert!(
        table.iter().all(|text| shown.contains(text)) && !shown.contains("{\"check\""),
        "{shown}"
    );
    // A stage is named with its pipeline too, by the name that the file has.
    assert_eq!(workspace.run(&["show", "audited:audited"]).stdout, shown);
    assert_eq!(workspace.run(&["show", "other:audited"]).code, Some(2));
    // The second time the audit is there already, and stops all the same.
    assert_eq!(run(&strict).code, Some(5));
    let ended = run(&[&strict[..], &["--set", "stages.audited.fail_on=never"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let line = ended.json()["audits"][0].as_str().unwrap().to_owned();
    assert!(
        line.starts_with("audited: errors in ") && line.contains(": accuracy, 4 rows (on a finer mesh"),
        "{line}"
    );
    assert_eq!(
        outcome(&ended, "audited").as_deref(),
        Some("reused"),
        "whether it stops is no part of what it finds"
    );
    assert_eq!(outcome(&ended, "surrogate").as_deref(), Some("built"));
    // However many results come before it, a run ends with the errors.
    let table = |name: &str| format!("stages.{name}={{ kind: table, needs: [balanced], columns: [rows] }}");
    let (one, two) = (table("one"), table("two"));
    let never = ["--set", "stages.audited.fail_on=never", "--set", &one, "--set", &two];
    let ended = workspace.run(&[&["run", "p.yaml"], &strict[..], &never].concat());
    assert!(ended.stdout.contains("audited: errors in "), "{ended}");
    // A surrogate is none the other for the audit that it waited for.
    let ended = run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(outcome(&ended, "audited").as_deref(), Some("built"));
    assert_eq!(outcome(&ended, "surrogate").as_deref(), Some("reused"));
    let alone = run(&["--set", "stages.surrogate.needs=[balanced]"]);
    assert_eq!(outcome(&alone, "surrogate").as_deref(), Some("reused"));
}

fn reals(path: &Path, dataset: &str) -> Vec<f64> {
    hdf5::File::open(path)
        .unwrap()
        .dataset(dataset)
        .unwrap()
        .read_raw()
        .unwrap()
}

const FIELD: usize = 51 * 51 * 2;

/// Patterns of several families as a file, solved by the command in a scene.
fn solved(workspace: &Workspace, scene: &str, out: &str, more: &[&str]) {
    let names: Vec<String> = (0..24)
        .map(|k: usize| {
            let cell = move |x: usize, y: usize| match k % 4 {
                0 => (x * 7 + y * 11 + x * y * (k + 1)) % 13 < 6,
                1 => (x / 10 * 3 + y / 10 * (5 + k)) % 7 < 3,
                2 => (x as f64 - 20.0 - k as f64 / 3.0).hypot(y as f64 - 22.0) < 8.0 + k as f64 / 2.0,
                _ => (y + k) % (k + 3) < (k + 3) / 2 && x > k,
            };
            let row = |y| {
                (0..50)
                    .map(|x| u8::from(cell(x, y)).to_string())
                    .collect::<Vec<_>>()
                    .join(",")
                    + "\n"
            };
            let name = format!("pattern-{k}.csv");
            workspace.write(&name, &(0..50).map(row).collect::<String>());
            name
        })
        .collect();
    let mut arguments = vec!["solve", scene];
    arguments.extend(names.iter().map(String::as_str));
    arguments.extend(["-o", out]);
    arguments.extend(more);
    let ended = workspace.run(&arguments);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
}

fn rewrite(path: &Path, change: impl Fn(&mut [f64])) {
    // In a file that nobody has opened before: a program that another test starts just now inherits what HDF5 has open
    // here, and with it the lock.
    let folder = tempfile::tempdir().unwrap();
    let aside = folder.path().join("aside.h5");
    std::fs::copy(path, &aside).unwrap();
    let file = hdf5::File::open_rw(&aside).unwrap();
    let dataset = file.dataset("displacement").unwrap();
    let mut values = dataset.read_raw::<f64>().unwrap();
    change(&mut values);
    dataset.write_raw(&values).unwrap();
    file.close().unwrap();
    std::fs::copy(&aside, path).unwrap();
}

#[test]
fn sound_files_give_no_finding_in_any_scene_and_by_any_method() {
    let workspace = workspace();
    for (scene, usual) in [("scene.yaml", "0.02 mm"), ("film.yaml", "0.008 mm")] {
        for method in [
            &["--elements-per-cell", "1"][..],
            &["--elements-per-cell", "1", "--method", "chord:1"],
            &["--accuracy", usual],
        ] {
            solved(&workspace, scene, "out.h5", method);
            let ended = workspace.run(&["audit", "out.h5", "--scene", scene, "--samples", "2", "--json"]);
            assert_eq!(checks(&ended.json()), [], "{scene} {method:?}");
            assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        }
    }
    let other = workspace.run(&["audit", "out.h5", "--scene", "scene.yaml", "--samples", "0", "--json"]);
    assert_eq!(other.code, Some(5));
    assert!(names(&other).contains(&"provenance".to_owned()), "{}", other.stdout);
    let unsaid = workspace.run(&["audit", "out.h5"]);
    assert_eq!(unsaid.code, Some(2), "{}", unsaid.stderr);
    assert!(unsaid.stderr.contains("--scene"), "{}", unsaid.stderr);
}

#[test]
fn a_file_that_was_solved_where_the_screening_decides_is_of_that_scene() {
    let workspace = workspace();
    let open = FILM.split("effects:").next().unwrap().to_owned() + "effects: auto\n";
    workspace.write("open.yaml", &open);
    solved(&workspace, "open.yaml", "out.h5", &["--elements-per-cell", "1"]);
    let ended = workspace.run(&["audit", "out.h5", "--scene", "open.yaml", "--samples", "0", "--json"]);
    assert_eq!(checks(&ended.json()), [], "{}", ended.stdout);
    let other = workspace.run(&["audit", "out.h5", "--scene", "film.yaml", "--samples", "0", "--json"]);
    assert!(names(&other).contains(&"provenance".to_owned()), "{}", other.stdout);
}

#[test]
fn a_loose_solver_hides_no_wrong_label() {
    let workspace = workspace();
    let loose = ["--elements-per-cell", "1", "--tolerance", "1e-3"];
    solved(&workspace, "scene.yaml", "out.h5", &loose);
    let audit = || workspace.run(&["audit", "out.h5", "--scene", "scene.yaml", "--samples", "0", "--json"]);
    let declared = ("declared".to_owned(), vec![]);
    assert!(
        checks(&audit().json()).contains(&declared),
        "a tolerance above the usual is told"
    );
    for by in [0.9905, 1.03] {
        solved(&workspace, "scene.yaml", "out.h5", &loose);
        rewrite(&workspace.path("out.h5"), |all| {
            all[9 * FIELD..10 * FIELD].iter_mut().for_each(|u| *u *= by);
        });
        let ended = audit();
        let found = checks(&ended.json());
        let names_it = |(check, rows): &(String, Vec<u64>)| check == "scale" && rows.contains(&9);
        assert!(found.iter().any(names_it), "{by}: {found:?}");
        assert_eq!(ended.code, Some(5));
    }
    // All of them, which nothing stands out from; and estimates.
    for method in [&loose[..], &["--elements-per-cell", "1", "--method", "chord:3"]] {
        solved(&workspace, "scene.yaml", "out.h5", method);
        rewrite(&workspace.path("out.h5"), |all| {
            all.iter_mut().for_each(|u| *u *= 0.9905)
        });
        let ended = audit();
        let scale = |f: &Value| f["check"] == "scale" && f["count"].as_u64() >= Some(20);
        let found = ended.json();
        assert!(
            found["findings"].as_array().unwrap().iter().any(scale),
            "{}",
            ended.stdout
        );
    }
}

/// Has another program write a file.
fn h5py(workspace: &Workspace, script: &str) {
    let script = format!("import h5py, numpy as np\n{script}\n");
    let ended = workspace.dressed(&python()).args(["-c", &script]).output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
}

/// Writes one of the file's own texts anew.
fn restate(path: &Path, attribute: &str, text: &str) {
    let folder = tempfile::tempdir().unwrap();
    let aside = folder.path().join("aside.h5");
    std::fs::copy(path, &aside).unwrap();
    let file = hdf5::File::open_rw(&aside).unwrap();
    file.delete_attr(attribute).unwrap();
    let value: hdf5::types::VarLenUnicode = text.parse().unwrap();
    let new = file.new_attr::<hdf5::types::VarLenUnicode>();
    new.create(attribute).unwrap().write_scalar(&value).unwrap();
    file.close().unwrap();
    std::fs::copy(&aside, path).unwrap();
}

#[test]
fn a_file_that_states_other_effects_is_reported_in_every_scene() {
    let workspace = workspace();
    let open = FILM.split("effects:").next().unwrap().to_owned() + "effects: auto\n";
    workspace.write("open.yaml", &open);
    let audit = |scene: &str| workspace.run(&["audit", "out.h5", "--scene", scene, "--samples", "0", "--json"]);
    // Screening calls for nothing in the open scene.
    for (scene, other) in [
        ("film.yaml", "{}"),
        ("open.yaml", "{ strain_stiffening: { model: gent, jm: 30.04 } }"),
    ] {
        solved(&workspace, scene, "out.h5", &["--elements-per-cell", "1"]);
        assert_eq!(checks(&audit(scene).json()), [], "{scene}");
        restate(&workspace.path("out.h5"), "effects", other);
        let ended = audit(scene);
        assert!(
            names(&ended).contains(&"provenance".to_owned()),
            "{scene}: {}",
            ended.stdout
        );
        assert_eq!(ended.code, Some(5), "{scene}");
        restate(&workspace.path("out.h5"), "effects", "{ strain_stiffening: maybe }");
        assert!(
            names(&audit(scene)).contains(&"provenance".to_owned()),
            "{scene}: no effects"
        );
    }
    restate(&workspace.path("out.h5"), "solver", "{ method: prayer }");
    assert!(
        names(&audit("open.yaml")).contains(&"provenance".to_owned()),
        "no solver"
    );
}

#[test]
fn an_error_that_a_file_declares_for_itself_is_bounded() {
    let workspace = workspace();
    solved(&workspace, "scene.yaml", "out.h5", &["--accuracy", "0.02 mm"]);
    h5py(
        &workspace,
        "file = h5py.File('out.h5', 'r+'); file['discretisation_error'][...] = 10.0; file.close()",
    );
    let ended = workspace.run(&["audit", "out.h5", "--scene", "scene.yaml", "--samples", "2", "--json"]);
    let declared = checks(&ended.json()).into_iter().find(|(check, _)| check == "declared");
    assert_eq!(declared.map(|(_, rows)| rows.len()), Some(20), "{}", ended.stdout);
    let allowed = ended.json()["summary"]["resimulated"]["allowed"].as_f64().unwrap();
    assert!(allowed <= 0.02 + 1e-12, "{allowed}");
    let strict = [
        "audit",
        "out.h5",
        "--scene",
        "scene.yaml",
        "--samples",
        "2",
        "--accuracy",
        "1e-6 mm",
        "--json",
    ];
    assert!(names(&workspace.run(&strict)).contains(&"accuracy".to_owned()));
}

#[test]
fn a_pipe_is_refused_and_not_waited_on() {
    let workspace = workspace();
    pipe(&workspace.path("pipe.h5"));
    let mut printed = Transcript::default();
    for file in ["pipe.h5", "/dev/zero", "."] {
        printed.add(file, workspace.refused(&["audit", file, "--scene", "scene.yaml"]));
    }
    snapshot!(printed);
    pipe(&workspace.path("scene-pipe.yaml"));
    workspace.write("none.h5", "");
    workspace.refused(&["audit", "none.h5", "--scene", "scene-pipe.yaml"]);
}

#[test]
fn lengths_that_no_file_holds_are_refused_before_they_are_read() {
    let workspace = workspace();
    solved(&workspace, "scene.yaml", "own.h5", &["--elements-per-cell", "1"]);
    let audit = || {
        let start = std::time::Instant::now();
        let ended = workspace.run(&[
            "audit",
            "foreign.h5",
            "--scene",
            "scene.yaml",
            "--samples",
            "0",
            "--json",
        ]);
        assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
        assert_eq!(
            (ended.code, names(&ended)),
            (Some(5), vec!["shape".to_owned()]),
            "{}",
            ended.stderr
        );
        ended.stdout
    };
    h5py(
        &workspace,
        "file = h5py.File('foreign.h5', 'w'); n = 10**9\n\
         file.create_dataset('patterns', shape=(n, 50, 50), chunks=(1, 50, 50), dtype='u1')\n\
         file.create_dataset('displacement', shape=(n, 51, 51, 2), chunks=(1, 51, 51, 2), dtype='f8')\n\
         file.close()",
    );
    assert!(audit().contains("1000000000"));
    for column in ["split", "family", "max_displacement", "orbit", "source", "bin", "order"] {
        let script = format!(
            "own, file = h5py.File('own.h5'), h5py.File('foreign.h5', 'w')\n\
             for name in ['patterns', 'displacement']: file[name] = own[name][:3]\n\
             file.create_dataset('{column}', shape=(10**12,), chunks=(1024,), dtype='u1')\n\
             file.close()"
        );
        h5py(&workspace, &script);
        assert!(audit().contains(&format!("`{column}` has 1000000000000")), "{column}");
    }
}

#[test]
fn what_columns_claim_of_their_rows_is_checked_in_a_file_of_its_own() {
    let workspace = workspace();
    let digests = workspace.stages(&["run", "p.yaml", "--until", "balanced"]).digests();
    let objects = files(&workspace.path("store/objects"));
    let balanced = objects
        .iter()
        .find(|f| f.to_string_lossy().contains(&digests["balanced"]))
        .unwrap();
    let audit = |change: &str| {
        let script = format!(
            "source, out = h5py.File({balanced:?}), h5py.File('claims.h5', 'w')\n\
             names = ['patterns', 'displacement', 'split', 'orbit', 'source', 'symmetry', 'bin', 'max_displacement', 'histogram/edges']\n\
             data = {{name: source[name][()] for name in names}}\n\
             data['family'] = np.array([f.decode() if isinstance(f, bytes) else f for f in source['family'][()]], dtype='S16')\n\
             last = len(data['bin']) - 1\n\
             {change}\n\
             [out.create_dataset(name, data=value) for name, value in data.items()]\n"
        );
        h5py(&workspace, &script);
        let ended = workspace.run(&[
            "audit",
            "claims.h5",
            "--scene",
            "scene.yaml",
            "--samples",
            "0",
            "--json",
        ]);
        let found = ended.json();
        let findings = found["findings"].as_array().unwrap().clone();
        findings
            .iter()
            .map(|f| (f["check"].as_str().unwrap().to_owned(), f["message"].to_string()))
            .collect::<Vec<_>>()
    };
    assert_eq!(audit(""), []);
    let finds = |change: &str, what: &str| {
        let found = audit(change);
        let is_it = |(check, message): &(String, String)| check == "derived" && message.contains(what);
        assert!(found.iter().any(is_it), "{change}: {found:?}");
    };
    finds("data['bin'][last] += 1", "`bin`");
    finds(
        "del data['histogram/edges']; data['bin'][np.argmax(data['max_displacement'])] = 0",
        "`bin`",
    );
    finds("data['symmetry'][3] = 8", "`symmetry`");
    finds("data['source'][:] = np.roll(data['source'], 5)", "`source`");
    finds(
        "n = np.bincount(data['source'].astype(int)); s = int(np.argmax(n)); i = int(np.argmax(data['source'] == s)); \
         data['symmetry'][i] = (data['symmetry'][i] + 1) % 8",
        "`symmetry`",
    );
    finds("data['family'][:] = b'no-such-family'", "`family`");
    finds(
        "names = data['family'].copy(); data['family'][names == b'small-grid'] = b'bezier'",
        "`family`",
    );
}

#[test]
fn what_stands_in_other_files_is_not_audited() {
    let workspace = workspace();
    let digests = workspace.stages(&["run", "p.yaml", "--until", "solved"]).digests();
    let objects = files(&workspace.path("store/objects"));
    let solved = objects
        .iter()
        .find(|f| f.to_string_lossy().contains(&digests["solved"]))
        .unwrap();
    std::fs::copy(solved, workspace.path("copied.h5")).unwrap();
    let ended = workspace.run(&["audit", "copied.h5", "--scene", "scene.yaml"]);
    assert_eq!(ended.code, Some(2), "{}\n{}", ended.stdout, ended.stderr);
    let mut printed = Transcript::default();
    printed.add("chunks elsewhere", ended);
    let path = workspace.path("linked.h5");
    let file = hdf5::File::create(&path).unwrap();
    for name in ["patterns", "displacement"] {
        file.link_external("elsewhere.h5", name, name).unwrap();
    }
    file.close().unwrap();
    let ended = workspace.run(&["audit", "linked.h5", "--scene", "scene.yaml"]);
    assert_eq!(ended.code, Some(2), "{}\n{}", ended.stdout, ended.stderr);
    printed.add("external links", ended);
    snapshot!(printed);
}

#[test]
fn each_fault_that_is_planted_in_a_file_is_found_and_named() {
    type Fault = (&'static str, fn(&mut [f64]));
    let faults: [Fault; 6] = [
        ("sign", |u| u.iter_mut().for_each(|u| *u = -*u)),
        ("scale", |u| u.iter_mut().for_each(|u| *u *= 1.03)),
        ("rotation", |u| u.chunks_mut(2).for_each(|u| u[0] = -u[0])),
        ("boundary", |u| u[20] = 0.003),
        ("finite", |u| u[2 * 51 * 20] = f64::NAN),
        ("label", |u| {
            u.iter_mut().enumerate().for_each(|(i, u)| *u += 1e-3 * (i % 7) as f64)
        }),
    ];
    let workspace = workspace();
    solved(&workspace, "scene.yaml", "sound.h5", &["--elements-per-cell", "1"]);
    for (check, fault) in faults {
        std::fs::copy(workspace.path("sound.h5"), workspace.path("bad.h5")).unwrap();
        rewrite(&workspace.path("bad.h5"), |all| fault(&mut all[9 * FIELD..10 * FIELD]));
        let ended = workspace.run(&["audit", "bad.h5", "--scene", "scene.yaml", "--samples", "0", "--json"]);
        assert_eq!(ended.code, Some(5), "{check}: {}", ended.stderr);
        let found = checks(&ended.json());
        assert!(found.contains(&(check.to_owned(), vec![9])), "{check}: {found:?}");
        assert!(found.iter().all(|(_, rows)| rows == &[9]), "{check}: {found:?}");
    }
    assert!(reals(&workspace.path("bad.h5"), "displacement").len() == 24 * FIELD);
    let ended = workspace.run(&[
        "audit",
        "bad.h5",
        "--scene",
        "scene.yaml",
        "--samples",
        "2",
        "-o",
        "page",
    ]);
    assert!(ended.stdout.contains("label"), "{}", ended.stdout);
    for file in ["audit.html", "audit.png", "label-9.png"] {
        assert!(workspace.path("page").join(file).exists(), "{file}");
    }
    // A figure that cannot be written does not stop the others or the page.
    std::fs::create_dir_all(workspace.path("again/label-9.png")).unwrap();
    let arguments = [
        "audit",
        "bad.h5",
        "--scene",
        "scene.yaml",
        "--samples",
        "0",
        "-o",
        "again",
    ];
    let ended = workspace.run(&arguments);
    assert_eq!(ended.code, Some(5), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("there is no figure again/label-9.png"),
        "{}",
        ended.stderr
    );
    assert!(workspace.path("again/audit.html").exists() && workspace.path("again/audit.png").exists());
}

/// A file as somebody else would write it: single precision, nothing declared, splits of their own.
fn foreign(workspace: &Workspace, from: &str, splits: &[&str], short: usize) {
    let (cells, fields) = (
        reals(&workspace.path(from), "patterns"),
        reals(&workspace.path(from), "displacement"),
    );
    let n = splits.len();
    let path = workspace.path("foreign.h5");
    if path.exists() {
        std::fs::remove_file(&path).unwrap();
    }
    let file = hdf5::File::create(&path).unwrap();
    let cells: Vec<u8> = cells[..n * 2500].iter().map(|&c| c as u8).collect();
    let fields: Vec<f32> = fields[..(n - short) * FIELD].iter().map(|&u| u as f32).collect();
    let texts: Vec<hdf5::types::VarLenUnicode> = splits.iter().map(|s| s.parse().unwrap()).collect();
    let new = |name: &str, shape: &[usize]| file.new_dataset::<u8>().shape(shape).create(name).unwrap();
    new("patterns", &[n, 50, 50]).write_raw(&cells).unwrap();
    let displacement = file
        .new_dataset::<f32>()
        .shape([n - short, 51, 51, 2])
        .create("displacement")
        .unwrap();
    displacement.write_raw(&fields).unwrap();
    let split = file
        .new_dataset::<hdf5::types::VarLenUnicode>()
        .shape([n])
        .create("split")
        .unwrap();
    split.write_raw(&texts).unwrap();
}

#[test]
fn a_file_that_declares_nothing_is_still_compared_with_its_mesh() {
    let workspace = workspace();
    solved(&workspace, "film.yaml", "own.h5", &["--elements-per-cell", "2"]);
    let splits: Vec<&str> = (0..24).map(|i| if i < 16 { "train" } else { "test" }).collect();
    let audit = || {
        workspace.run(&[
            "audit",
            "foreign.h5",
            "--scene",
            "film.yaml",
            "--samples",
            "2",
            "--json",
        ])
    };
    foreign(&workspace, "own.h5", &splits, 0);
    let ended = audit();
    assert_eq!(checks(&ended.json()), [], "{}", ended.stderr);
    assert_eq!(
        ended.json()["summary"]["made_by"],
        "elements_per_cell: 2, order: 1 (found out)"
    );
    // A mirrored pattern with its mirrored field in another part: right in itself, and leaked.
    let path = workspace.path("own.h5");
    let aside = workspace.path("aside.h5");
    std::fs::copy(&path, &aside).unwrap();
    std::fs::rename(&aside, &path).unwrap();
    let file = hdf5::File::open_rw(&path).unwrap();
    let (patterns, displacement) = (file.dataset("patterns").unwrap(), file.dataset("displacement").unwrap());
    let (mut cells, mut fields) = (
        patterns.read_raw::<u8>().unwrap(),
        displacement.read_raw::<f64>().unwrap(),
    );
    for (y, x) in (0..50).flat_map(|y| (0..50).map(move |x| (y, x))) {
        cells[20 * 2500 + y * 50 + x] = cells[4 * 2500 + y * 50 + (49 - x)];
    }
    for (y, x) in (0..51).flat_map(|y| (0..51).map(move |x| (y, x))) {
        let (to, from) = (20 * FIELD + 2 * (y * 51 + x), 4 * FIELD + 2 * (y * 51 + 50 - x));
        (fields[to], fields[to + 1]) = (-fields[from], fields[from + 1]);
    }
    patterns.write_raw(&cells).unwrap();
    displacement.write_raw(&fields).unwrap();
    file.close().unwrap();
    foreign(&workspace, "own.h5", &splits, 0);
    let ended = audit();
    assert_eq!(
        (ended.code, checks(&ended.json())),
        (Some(5), vec![("leak".to_owned(), vec![4, 20])])
    );
    foreign(&workspace, "own.h5", &splits, 3);
    let ended = audit();
    assert_eq!((ended.code, names(&ended)), (Some(5), vec!["shape".to_owned()]));
}
