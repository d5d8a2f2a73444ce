//! Pipelines from measurements to a fitted scene, and measured beside simulated numbers.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use super::common::{Stages, Workspace, files};

const SCENE: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 1.2, cells: 10 }
material: { model: neo-hookean, shear_modulus: 300 kPa, relative_permittivity: 2.8 }
drive: { voltage: 5 kV }
effects: {}
";

/// A fit of two laws to two tests of rubber, and a stage that is solved with the fitted scene.
const CHAIN: &str = "version: 1
name: chain
scene: scene.yaml
stages:
  pulled: { kind: measure, files: [
    { file: uniaxial.csv, test: uniaxial, sigma: 3 % },
    { file: equibiaxial.csv, test: equibiaxial, sigma: 3 % } ] }
  fitted: { kind: fit, needs: [pulled], laws: [gent] }
  small:  { kind: sample, family: small-grid, count: 3, seed: 1 }
  solved: { kind: solve, needs: [small], elements_per_cell: 1, scene: { from: fitted } }
  beside: { kind: compare, needs: [pulled, fitted] }
";

fn with_data() -> Workspace {
    let workspace = Workspace::new();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/fit/tests/treloar");
    for name in ["uniaxial.csv", "equibiaxial.csv", "pure-shear.csv"] {
        std::fs::copy(folder.join(name), workspace.path(name)).unwrap();
    }
    workspace.write("scene.yaml", SCENE);
    workspace.write("chain.yaml", CHAIN);
    workspace
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

fn outcome<'a>(stages: &'a Stages, name: &str) -> &'a Value {
    &stages.stage(name)["outcome"]
}

#[test]
fn a_stage_is_built_with_the_scene_of_a_fit_and_again_if_that_changes() {
    let workspace = with_data();
    let plan = workspace.stages(&["plan", "chain.yaml"]);
    assert_eq!(plan.stage("solved")["why"], "input changed: fitted");
    let ended = workspace.run(&["run", "chain.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let run = ended.json();
    // As the command fits.
    let command = workspace.run(&[
        "fit",
        "scene.yaml",
        "uniaxial=uniaxial.csv",
        "equibiaxial=equibiaxial.csv",
        "--law",
        "gent",
        "--sigma",
        "3 %",
        "--json",
        "-o",
        "fitted.yaml",
    ]);
    let command = command.json();
    let (fit, known) = (&run["fits"][0], &command["laws"][0]);
    for at in [0, 1] {
        let (own, other) = (&fit["parameters"][at], &known["parameters"][at]);
        assert_eq!(own["value"], other["value"]);
        for end in [0, 1] {
            let interval = match &other["profile"] {
                Value::Null => &other["interval"],
                profile => profile,
            };
            assert_eq!(own["interval"][end], interval[end], "{own}");
        }
    }
    assert_eq!(run["fits"][0]["chosen"], "gent");
    let chi2 = &run["comparisons"][0]["files"][0]["chi2_per_dof"];
    assert!(number(chi2) > 1.0, "{chi2}");
    // The stage has the key of one in a pipeline with the fitted scene.
    let direct = "version: 1
name: direct
scene: fitted.yaml
stages:
  small:  { kind: sample, family: small-grid, count: 3, seed: 1 }
  solved: { kind: solve, needs: [small], elements_per_cell: 1 }
";
    workspace.write("direct.yaml", direct);
    let same = workspace.stages(&["run", "direct.yaml"]);
    assert_eq!(outcome(&same, "solved"), "reused");
    // Another list of laws with the same best one makes the same scene.
    workspace.write(
        "chain.yaml",
        &CHAIN.replace("laws: [gent]", "laws: [gent, neo-hookean]"),
    );
    let again = workspace.stages(&["run", "chain.yaml"]);
    assert_eq!(again.with("built"), ["fitted", "beside"]);
    // One more file changes the scene, and what used it says by which parameter.
    let more = "    { file: pure-shear.csv, test: pure-shear, sigma: 3 % },\n    { file: uniaxial.csv";
    let more = CHAIN.replace("    { file: uniaxial.csv", more);
    workspace.write("chain.yaml", &more);
    let plan = workspace.stages(&["plan", "chain.yaml"]);
    assert_eq!(plan.stage("solved")["why"], "input changed: fitted");
    let fitted = workspace.stages(&["run", "chain.yaml", "--until", "fitted"]);
    assert_eq!(outcome(&fitted, "fitted"), "built");
    let explained = workspace.run(&["explain", "chain.yaml", "solved"]);
    let says = "parameter changed: scene.material.shear_modulus from ";
    assert!(explained.stdout.contains(says), "{}", explained.stdout);
    let last = workspace.stages(&["run", "chain.yaml"]);
    assert_eq!(last.with("built"), ["solved", "beside"]);
    let last = workspace.stages(&["run", "chain.yaml"]);
    assert_eq!(last.with("reused").len(), 5);
}

const DEVICE: &str = "version: 1
name: device
scene:
  geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }
  material: { model: neo-hookean, shear_modulus: 60 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 4 kV }
  effects: {}
stages:
  seen:   { kind: measure, files: [ { file: centre.csv, test: voltage-displacement, pattern: half.csv,
                                      point: [25 mm, 25 mm], direction: 0 deg, sigma: 5 um } ] }
  fitted: { kind: fit, needs: [seen], free: { shear_modulus: 1 kPa..1 MPa, voltage_offset: auto } }
  beside: { kind: compare, needs: [seen, fitted] }
  before: { kind: compare, needs: [seen], effects: true }
";

fn with_device() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("device.yaml", DEVICE);
    let half = (0..10).map(|_| format!("{}\n", [["1"; 5], ["0"; 5]].concat().join(",")));
    workspace.write("half.csv", &half.collect::<String>());
    workspace.write(
        "centre.csv",
        "voltage_kV,displacement_mm\n1,0.055\n1.5,0.147\n2,0.275\n2.5,0.433\n3,0.650\n3.5,0.911\n4,1.198\n4.5,1.563\n",
    );
    workspace
}

#[test]
fn a_device_is_fitted_and_compared_with_the_offset_of_the_fit() {
    let workspace = with_device();
    let ended = workspace.run(&["run", "device.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let run = ended.json();
    let [modulus, offset] = [0, 1].map(|at: usize| number(&run["fits"][0]["parameters"][at]["value"]));
    assert!(
        (38e3..44e3).contains(&modulus) && (-250.0..0.0).contains(&offset),
        "{run}"
    );
    let chi2 = |name: &str| {
        let all = run["comparisons"].as_array().unwrap();
        let one = all.iter().find(|one| one["stage"] == name).unwrap();
        number(&one["files"][0]["chi2_per_dof"])
    };
    assert!(chi2("beside") < 2.0 && chi2("before") > 100.0, "{run}");
    let effects = &run["comparisons"].to_string();
    assert!(effects.contains("fringe_field"), "{effects}");
    assert!(run.to_string().contains("a scene has no voltage offset"), "{run}");
    let report = workspace.run(&["report", "device.yaml", "-o", "report", "--json"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    // A measured number that changes is measured again, and what needs it.
    let text = std::fs::read_to_string(workspace.path("centre.csv")).unwrap();
    workspace.write("centre.csv", &text.replace("1.563", "1.564"));
    let plan = workspace.stages(&["plan", "device.yaml"]);
    assert_eq!(plan.with("stale").len(), 4);
    // A comment in another dialect of the table changes nothing.
    workspace.write("centre.csv", &text.replace(',', ";"));
    let plan = workspace.stages(&["plan", "device.yaml"]);
    assert_eq!(plan.with("reused").len(), 4);
}

#[test]
fn stages_of_measurements_are_refused_with_the_reason() {
    let workspace = with_data();
    for (from, to, says) in [
        (
            "scene: { from: fitted }",
            "scene: { from: small }",
            "which makes no scene",
        ),
        (
            "scene: { from: fitted }",
            "scene: { from: fited }",
            "did you mean `fitted`?",
        ),
        ("scene: { from: fitted }", "scene: { of: fitted }", "unknown key `of`"),
        ("scene: { from: fitted }", "scene: other.yaml", "must be a mapping"),
        (
            "count: 3, seed: 1 }",
            "count: 3, seed: 1, scene: { from: fitted } }",
            "unknown key `scene`",
        ),
        (
            "needs: [pulled], laws",
            "needs: [pulled], scene: { from: fitted }, laws",
            "in a cycle",
        ),
        ("laws: [gent]", "laws: [hooke]", "allowed: neo-hookean, gent"),
        ("laws: [gent]", "free: { shear: auto }", "no such number"),
        ("laws: [gent]", "free: { shear_modulus: 3 kPa..1 kPa }", "not in order"),
        (
            "laws: [gent]",
            "free: { shear_modulus: auto }, laws: [gent]",
            "laws are compared without `free`",
        ),
        ("test: uniaxial", "test: unaxial", "did you mean `uniaxial`"),
        ("file: uniaxial.csv", "file: missing.csv", "missing.csv"),
        ("file: equibiaxial.csv", "file: uniaxial.csv", "listed twice"),
        (
            "needs: [pulled, fitted]",
            "needs: [fitted]",
            "needs 1 to 1000 stages of kind measure",
        ),
        (
            "needs: [pulled, fitted]",
            "needs: [pulled, fitted], voltage_offset: 1 V",
            "that of the fit",
        ),
        (
            "needs: [pulled, fitted]",
            "needs: [pulled, fitted], scene: { from: fitted }",
            "that of the fit",
        ),
    ] {
        let text = CHAIN.replace(from, to);
        assert_ne!(text, CHAIN, "{from}");
        workspace.write("chain.yaml", &text);
        let ended = workspace.run(&["plan", "chain.yaml"]);
        let flat = ended.stderr.replace("\n  │ ", " ");
        assert!(
            ended.code == Some(2) && flat.contains(says),
            "{to}: {:?} {}",
            ended.code,
            ended.stderr
        );
    }
    // A pipeline reads no files outside of its folder.
    std::fs::create_dir(workspace.path("sub")).unwrap();
    workspace.write("sub/scene.yaml", SCENE);
    workspace.write(
        "sub/chain.yaml",
        &CHAIN.replace("file: uniaxial.csv", "file: ../uniaxial.csv"),
    );
    let ended = workspace.run(&["plan", "sub/chain.yaml"]);
    assert!(
        ended.code == Some(2) && ended.stderr.contains("outside"),
        "{}",
        ended.stderr
    );
    let workspace = with_device();
    let text = DEVICE.replace(
        "free: { shear_modulus: 1 kPa..1 MPa, voltage_offset: auto }",
        "branches: 1",
    );
    workspace.write("device.yaml", &text);
    let ended = workspace.run(&["plan", "device.yaml"]);
    assert!(
        ended.code == Some(2) && ended.stderr.contains("needs free parameters"),
        "{}",
        ended.stderr
    );
}

#[test]
fn branches_are_fitted_after_the_law_and_the_chain_ends_in_one_scene() {
    let workspace = with_data();
    let stress = |t: f64| 200.0 + 300.0 * (-t / 0.8_f64).exp() + 100.0 * (-t / 12.0_f64).exp();
    let rows: Vec<String> = (0..40)
        .map(|k| {
            let t = 0.02 * 1.25_f64.powi(k);
            format!("{t},2,{}", stress(t) * (2.0 - 0.25))
        })
        .collect();
    let table = format!("time_s,stretch,nominal_stress_kPa\n{}\n", rows.join("\n"));
    workspace.write("relaxation.csv", &table);
    let chain = CHAIN
        .replace(
            "  small:",
            "  held:   { kind: measure, files: [ { file: relaxation.csv, test: uniaxial, sigma: 1 % } ] }
  slow:   { kind: fit, needs: [held], scene: { from: fitted }, laws: [neo-hookean] }
  small:",
        )
        .replace(
            "scene: { from: fitted } }\n  beside",
            "scene: { from: slow } }\n  beside",
        );
    workspace.write("chain.yaml", &chain);
    let ended = workspace.run(&["run", "chain.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let run = ended.json();
    let slow = run["fits"]
        .as_array()
        .unwrap()
        .iter()
        .find(|fit| fit["stage"] == "slow")
        .unwrap();
    assert_eq!(slow["chosen"], "2", "{slow}");
    for (at, (name, truth)) in [
        (0, ("shear_modulus", 200e3)),
        (1, ("branch_modulus_1", 300e3)),
        (2, ("branch_time_1", 0.8)),
    ] {
        let parameter = &slow["parameters"][at];
        assert_eq!(parameter["name"], name);
        assert!((number(&parameter["value"]) / truth - 1.0).abs() < 1e-3, "{parameter}");
    }
    let explained = workspace.run(&["explain", "chain.yaml", "solved"]);
    assert_eq!(explained.code, Some(0), "{}", explained.stderr);
}

#[test]
fn sweeps_and_fits_go_together() {
    let workspace = with_data();
    let chain = CHAIN
        .replace(
            "scene: scene.yaml",
            &format!("scene:\n  {}", SCENE.trim_end().replace('\n', "\n  ")),
        )
        .replace(
            "{ kind: fit, needs: [pulled], laws: [gent] }",
            "{ kind: fit, foreach: { law: [gent, yeoh] }, needs: [pulled], laws: [\"${law}\"] }",
        );
    workspace.write("chain.yaml", &chain);
    let stages = workspace.stages(&["run", "chain.yaml"]);
    for name in ["solved@law=gent", "solved@law=yeoh", "beside@law=gent"] {
        assert_eq!(outcome(&stages, name), "built", "{:?}", stages.names());
    }
    let [gent, yeoh] = ["gent", "yeoh"].map(|law| stages.stage(&format!("solved@law={law}"))["digest"].clone());
    assert_ne!(gent, yeoh);
    // A sweep of the scene gives each fit its own.
    let swept = CHAIN
        .replace(
            "scene: scene.yaml",
            &format!(
                "scene:\n  {}",
                SCENE.trim_end().replace('\n', "\n  ").replace("5 kV", "\"${voltage}\"")
            ),
        )
        .replace("{ kind: fit,", "{ kind: fit, foreach: { voltage: [3 kV, 4 kV] },");
    workspace.write("chain.yaml", &swept);
    let stages = workspace.stages(&["run", "chain.yaml"]);
    let [low, high] = ["3", "4"].map(|at| stages.stage(&format!("solved@voltage={at}kV"))["digest"].clone());
    assert!(low != high && low.is_string(), "{low}");
}

#[test]
fn rows_beyond_pull_in_are_counted_and_not_compared() {
    let workspace = with_device();
    let text = std::fs::read_to_string(workspace.path("centre.csv")).unwrap();
    workspace.write("centre.csv", &format!("{text}15,9\n"));
    let (_, scene) = DEVICE.split_once("scene:\n").unwrap();
    let (scene, _) = scene.split_once("stages:\n").unwrap();
    let lines: Vec<&str> = scene.lines().map(str::trim_start).collect();
    workspace.write("scene.yaml", &lines.join("\n"));
    workspace.write(
        "measured.yaml",
        "files: [ { file: centre.csv, test: voltage-displacement, pattern: half.csv, point: [25 mm, 25 mm], \
         direction: 0 deg } ]",
    );
    let compare = ["compare", "scene.yaml", "measured.yaml"];
    let ended = workspace.run(&[&compare[..], &["-o", "compared.csv", "--json"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let found = &ended.json()["compared"][0];
    assert_eq!(
        (&found["points"], &found["without_equilibrium"][0]),
        (&8.into(), &9.into())
    );
    let table = std::fs::read_to_string(workspace.path("compared.csv")).unwrap();
    assert_eq!(table.lines().count(), 9, "{table}");
    let ended = workspace.run(&compare);
    let says = "no stable equilibrium at 1 row, the first of them row 9";
    assert!(ended.stdout.contains(says), "{}", ended.stdout);
    // A file without a row that can be compared is refused, with the reason.
    workspace.write("centre.csv", "voltage_kV,displacement_mm\n15,9\n16,9\n");
    let ended = workspace.run(&compare);
    assert!(
        ended.code == Some(2) && ended.stderr.contains("no equilibrium at 15.00 kV"),
        "{}",
        ended.stderr
    );
    // In a pipeline likewise.
    workspace.write("centre.csv", &format!("{text}15,9\n"));
    let ended = workspace.run(&["run", "device.yaml", "--until", "before", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = &ended.json()["comparisons"][0]["files"][0];
    assert_eq!((&file["points"], &file["without_equilibrium"]), (&8.into(), &1.into()));
}

#[test]
fn a_damaged_or_lost_fit_is_made_again_before_its_scene_is_read() {
    let workspace = with_data();
    let first = workspace.stages(&["run", "chain.yaml"]);
    let digest = first.stage("fitted")["digest"].as_str().unwrap().to_owned();
    let object = || {
        let all = files(&workspace.path("store/objects"));
        all.into_iter().find(|file| file.to_string_lossy().contains(&digest))
    };
    let finer = |elements: &str| {
        let set = format!("stages.solved.elements_per_cell={elements}");
        workspace.stages(&["run", "chain.yaml", "--set", &set])
    };
    let path = object().unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..].iter_mut().for_each(|byte| *byte ^= 0x5a);
    let mut permissions = std::fs::metadata(&path).unwrap().permissions();
    std::os::unix::fs::PermissionsExt::set_mode(&mut permissions, 0o644);
    std::fs::set_permissions(&path, permissions).unwrap();
    std::fs::write(&path, &bytes).unwrap();
    let repaired = finer("2");
    assert_eq!(repaired.with("built"), ["fitted", "solved"]);
    std::fs::remove_file(object().unwrap()).unwrap();
    let plan = workspace.stages(&["plan", "chain.yaml", "--set", "stages.solved.elements_per_cell=3"]);
    assert_eq!(plan.stage("solved")["outcome"], "stale");
    assert_eq!(finer("3").with("built"), ["fitted", "solved"]);
    assert_eq!(finer("1").with("reused").len(), 5);
}

#[test]
fn curves_are_compared_with_a_law_of_ogden_as_with_others() {
    let workspace = with_data();
    let chain = CHAIN.replace("laws: [gent]", "laws: ['ogden:2']").replace(
        "  beside:",
        "  again:  { kind: compare, needs: [pulled], scene: { from: fitted } }\n  beside:",
    );
    workspace.write("chain.yaml", &chain);
    let ended = workspace.run(&["run", "chain.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let run = ended.json();
    let fitted: Vec<f64> = (0..2)
        .map(|file| number(&run["fits"][0]["files"][file]["rms"]))
        .collect();
    let compared = run["comparisons"].as_array().unwrap();
    assert_eq!(compared.len(), 2);
    for one in compared {
        for (file, rms) in fitted.iter().enumerate() {
            // The scene has rounded numbers.
            let own = number(&one["files"][file]["rms"]);
            assert!((own / rms - 1.0).abs() < 1e-3, "{own} {rms}");
        }
    }
}

#[test]
fn a_fitted_scene_has_every_block_of_the_scene() {
    let workspace = with_data();
    let all = "states: { on: { voltage: 5 kV }, off: { voltage: 0 V } }
loads: { pressure: 10 Pa }
leads: [left]
properties: { density: 960 kg/m3 }
tolerances: { thickness: 3 %, shear_modulus: { relative: 20 %, distribution: lognormal }, mask: 0.1 mm }
";
    workspace.write("all.yaml", &format!("{SCENE}{all}"));
    let blocks = |file: &str| {
        let text = std::fs::read_to_string(workspace.path(file)).unwrap();
        let named = text.lines().filter_map(|line| line.split_once(": "));
        let known = named.filter(|(key, _)| !key.starts_with('#') && !key.contains(' '));
        known
            .map(|(key, value)| (key.to_owned(), value.to_owned()))
            .collect::<BTreeMap<_, _>>()
    };
    // None is missing here: the schema has no other.
    let schema = workspace.run(&["schema", "scene"]).json();
    let names: Vec<&String> = schema["properties"].as_object().unwrap().keys().collect();
    let given = blocks("all.yaml");
    assert_eq!(given.keys().collect::<Vec<_>>(), names);
    let fit = |scene: &str, more: &[&str]| {
        let ended = workspace.run(&[&["fit", scene, "uniaxial=uniaxial.csv", "-o", "own.yaml"], more].concat());
        assert_eq!(ended.code, Some(0), "{ended}");
        blocks("own.yaml")
    };
    let fitted = fit("all.yaml", &["--law", "gent"]);
    assert_eq!(fitted.keys().collect::<Vec<_>>(), names);
    // What a fit does not change is the same when it is fitted again.
    std::fs::copy(workspace.path("own.yaml"), workspace.path("fitted.yaml")).unwrap();
    assert_eq!(fit("fitted.yaml", &["--law", "gent"]), fitted);

    // The same with numbers of a scene, and by stages: patterns need no leads, and fits one state without pressure.
    let rest = all
        .lines()
        .filter(|line| ["properties", "tolerances"].iter().any(|block| line.starts_with(block)));
    let rest: String = rest.map(|line| format!("{line}\n")).collect();
    workspace.write("scene.yaml", &format!("{SCENE}{rest}"));
    let freed = fit("scene.yaml", &["--free", "shear_modulus"]);
    assert_eq!(freed["tolerances"], fitted["tolerances"]);
    let chain = CHAIN.replace(
        "  small:",
        "  again: { kind: fit, needs: [pulled], free: { jm: auto }, scene: { from: fitted } }\n  small:",
    );
    workspace.write("chain.yaml", &chain);
    let run = workspace.run(&["run", "chain.yaml"]);
    assert_eq!(run.code, Some(0), "{run}");
    for stage in ["fitted", "again"] {
        let stage = format!("chain.yaml:{stage}");
        let ended = workspace.run(&["export", "scene", &stage, "-o", "exported.yaml", "--json"]);
        assert_eq!(ended.code, Some(0), "{ended}");
        let exported = blocks("exported.yaml");
        assert_eq!(exported["tolerances"], fitted["tolerances"]);
        assert!(exported.contains_key("properties"), "{exported:?}");
        let text = ended.json()["scene"].to_string();
        assert!(
            text.contains("tolerances: { ") || text.contains("tolerances: {"),
            "{text}"
        );
    }
    // Other tolerances are of another fitted scene, which is simulated alike.
    workspace.write(
        "scene.yaml",
        &format!("{SCENE}{rest}").replace("thickness: 3 %", "thickness: 4 %"),
    );
    let plan = workspace.stages(&["plan", "chain.yaml"]);
    let why = plan.stage("fitted")["why"].as_str().unwrap().to_owned();
    assert!(why.contains("scene.tolerances.thickness from 3 % to 4 %"), "{why}");
    workspace.run(&["run", "chain.yaml", "--until", "fitted"]);
    let plan = workspace.stages(&["plan", "chain.yaml"]);
    assert_eq!(outcome(&plan, "solved"), "reused");
    // A yield takes them.
    let yields = "  own: { kind: patterns, files: [own.csv] }
  made: { kind: yield, needs: [own], point: [25 mm, 25 mm], direction: 0 deg, samples: 2, seed: 1,
          scene: { from: fitted } }
";
    workspace.write("own.csv", &"1,1,1,1,1,0,0,0,0,0\n".repeat(10));
    workspace.write("chain.yaml", &format!("{CHAIN}{yields}"));
    let made = workspace.run(&["run", "chain.yaml", "--until", "made"]);
    assert_eq!(made.code, Some(0), "{made}");
    workspace.write("scene.yaml", SCENE);
    let refused = workspace.run(&["plan", "chain.yaml"]);
    assert!(refused.stderr.contains("no device differs from another"), "{refused}");
}

#[test]
fn curves_are_compared_by_the_names_of_their_tests() {
    let workspace = with_data();
    workspace.write("list.yaml", "files: [{ file: uniaxial.csv, test: uniaxial }]\n");
    let compare = |measured: &str| workspace.run(&["compare", "scene.yaml", measured, "--json"]);
    let named = compare("uniaxial=uniaxial.csv");
    assert_eq!(named.code, Some(0), "{named}");
    assert_eq!(named.json()["compared"], compare("list.yaml").json()["compared"]);
    // Specimens have no mesh.
    assert_eq!(named.json()["mesh"], Value::Null);
    let told = workspace
        .run(&["compare", "scene.yaml", "uniaxial=uniaxial.csv"])
        .stdout;
    assert!(!told.contains("mesh"), "{told}");
    for (given, says) in [
        ("uniaxial.csv", "uniaxial=uniaxial.csv"),
        ("x=uniaxial.csv", "allowed: uniaxial"),
    ] {
        let refused = workspace.run(&["compare", "scene.yaml", given]);
        assert!(refused.code == Some(2) && refused.stderr.contains(says), "{refused}");
    }
}

#[test]
fn what_a_file_of_measurements_cannot_have_is_refused_when_it_is_read() {
    let workspace = with_data();
    let header = "stretch,nominal_stress_kPa,sigma_kPa\n";
    for (rows, says) in [
        ("", "the file has no rows"),
        ("1.5,NaN,1\n2,40,1\n", "row 1: a number is not finite"),
        ("1.5,20,1\n-2,40,1\n", "row 2: the stretch -2 is not positive"),
        ("1.5,20,1\n2,40,0\n", "row 2: the standard deviation is not positive"),
    ] {
        workspace.write("uniaxial.csv", &format!("{header}{rows}"));
        let ended = workspace.run(&["plan", "chain.yaml"]);
        assert!(
            ended.code == Some(2) && ended.stderr.contains(says) && ended.stderr.contains("chain.yaml:6"),
            "{says}: {}",
            ended.stderr
        );
    }
    let workspace = with_data();
    // One file by two paths, in one stage and in two.
    workspace.write(
        "chain.yaml",
        &CHAIN.replace("file: equibiaxial.csv", "file: ./uniaxial.csv"),
    );
    let ended = workspace.run(&["plan", "chain.yaml"]);
    assert!(ended.stderr.contains("listed twice"), "{}", ended.stderr);
    let twice = CHAIN
        .replace(
            "  fitted:",
            "  again:  { kind: measure, files: [ { file: uniaxial.csv, test: uniaxial, sigma: 3 % } ] }\n  fitted:",
        )
        .replace("needs: [pulled], laws", "needs: [pulled, again], laws");
    workspace.write("chain.yaml", &twice);
    let ended = workspace.run(&["plan", "chain.yaml"]);
    let says = "`again` and `pulled` read the same file";
    assert!(ended.code == Some(2) && ended.stderr.contains(says), "{}", ended.stderr);
    // Percent and strains have one key.
    workspace.write("chain.yaml", CHAIN);
    workspace.stages(&["run", "chain.yaml", "--until", "pulled"]);
    let table = std::fs::read_to_string(workspace.path("uniaxial.csv")).unwrap();
    let strains = table.lines().skip(1).map(|line| {
        let (stretch, stress) = line.split_once(',').unwrap();
        format!("{},{stress}\n", stretch.parse::<f64>().unwrap())
    });
    workspace.write(
        "uniaxial.csv",
        &format!(
            "stretch;nominal_stress_MPa\n{}",
            strains.collect::<String>().replace(',', ";")
        ),
    );
    let plan = workspace.stages(&["plan", "chain.yaml"]);
    assert_eq!(plan.stage("pulled")["outcome"], "reused");
}

#[test]
fn a_fitted_scene_keeps_the_properties_of_the_elastomer_and_its_warnings() {
    let workspace = with_device();
    let known = "  properties: { strain_stiffening: { model: gent, jm: 60 }, \
                 electrode_stiffness: { shear_modulus: 50 kPa, thickness: 0.02 mm } }\n";
    let with = DEVICE
        .replace("  effects: {}\n", &format!("  effects: {{}}\n{known}"))
        .replace(
            "  beside:",
            "  small:  { kind: sample, family: small-grid, count: 2, seed: 1 }
  solved: { kind: solve, needs: [small], elements_per_cell: 1, scene: { from: fitted } }
  beside:",
        );
    workspace.write("device.yaml", &with);
    let ended = workspace.run(&["run", "device.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}{}", ended.stdout, ended.stderr);
    let run = ended.json();
    let compared = run["comparisons"].to_string();
    for effect in ["strain_stiffening", "electrode_stiffness", "fringe_field"] {
        assert!(compared.contains(effect), "{effect}: {compared}");
    }
    assert!(run.to_string().contains("strain stiffening is off"), "{run}");
    let exported = workspace.run(&["export", "scene", "fitted", "-o", "fitted.yaml"]);
    assert_eq!(exported.code, Some(0), "{}", exported.stderr);
    let text = std::fs::read_to_string(workspace.path("fitted.yaml")).unwrap();
    assert!(text.contains("properties") && text.contains("jm: 60"), "{text}");
    let sampled = workspace.run(&["export", "scene", "small", "-o", "none.yaml"]);
    assert!(
        sampled.code == Some(2) && sampled.stderr.contains("has no scene"),
        "{}",
        sampled.stderr
    );
    // A verification in another scene than that of the search is warned of.
    let more = format!(
        "{with}  design: {{ kind: design, method: adjoint, starts: 1, seed: 1, scene: {{ from: fitted }},
            objective: {{ point: [25 mm, 25 mm], direction: 0 deg }} }}
  verified: {{ kind: verify, needs: [design], elements_per_cell: 1 }}
"
    );
    workspace.write("device.yaml", &more);
    let plan = workspace.run(&["plan", "device.yaml"]);
    let says = "verified: its scene is that of the pipeline, but the scene of `design`";
    assert!(
        plan.code == Some(0) && plan.stderr.contains(says) | plan.stdout.contains(says),
        "{}{}",
        plan.stdout,
        plan.stderr
    );
}

#[test]
fn a_strip_on_rollers_has_the_known_modulus_and_offset() {
    // Its left half is active; 45 kPa, −0.1 kV and noise of 0.01 mm.
    let workspace = Workspace::new();
    workspace.write(
        "strip.yaml",
        "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 2, sides: { top: roller, bottom: roller } }\n\
         material: { model: neo-hookean, shear_modulus: 60 kPa, relative_permittivity: 4.7 }\ndrive: { voltage: 4 kV }\n\
         effects: {}\n",
    );
    workspace.write("half.csv", "1,0\n1,0\n");
    workspace.write(
        "moved.csv",
        "voltage_kV,displacement_mm\n1.0,0.0947528968\n1.5,0.2078912988\n2.0,0.3933058483\n2.5,0.6003152587\n\
         3.0,0.9143282400\n3.5,1.2706803984\n4.0,1.6763519806\n4.5,2.1868433974\n5.0,2.7505855137\n5.5,3.4268311958\n\
         6.0,4.2263247255\n",
    );
    workspace.write(
        "measured.yaml",
        "files:\n  - { file: moved.csv, test: voltage-displacement, pattern: half.csv, point: [25 mm, 25 mm], direction: 0 \
         deg, sigma: 0.01 mm }\n",
    );
    let ended = workspace.run(&[
        "fit",
        "strip.yaml",
        "measured.yaml",
        "--free",
        "shear_modulus",
        "--free",
        "voltage_offset",
        "--json",
        "-o",
        "fitted.yaml",
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let parameters = &ended.json()["parameters"];
    for (at, value, error) in [(0, 45172.198, 0.005_727_7), (1, -89.078_94, 14.141_3)] {
        let found = &parameters[at];
        assert!((number(&found["value"]) - value).abs() < 2e-3, "{found}");
        assert!((number(&found["standard_error"]) / error - 1.0).abs() < 1e-4, "{found}");
    }
}
