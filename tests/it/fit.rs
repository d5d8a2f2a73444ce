//! `deaflow fit` on measured curves.

use std::path::Path;

use serde_json::Value;

use super::common::{Workspace, scene_file};

fn with_data() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/fit/tests/treloar");
    for name in ["uniaxial.csv", "equibiaxial.csv", "pure-shear.csv"] {
        std::fs::copy(folder.join(name), workspace.path(name)).unwrap();
    }
    workspace
}

const TRELOAR: [&str; 3] = [
    "uniaxial=uniaxial.csv",
    "equibiaxial=equibiaxial.csv",
    "pure-shear=pure-shear.csv",
];

fn fitted(workspace: &Workspace, arguments: &[&str]) -> Value {
    let ended = workspace.run(&[&["fit", "scene.yaml", "--json"], arguments].concat());
    assert_eq!(ended.code, Some(0), "{arguments:?}: {}", ended.stderr);
    ended.json()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

#[test]
fn laws_are_fitted_to_the_data_of_treloar_and_written_as_a_scene() {
    let workspace = with_data();
    let found = fitted(&workspace, &[&TRELOAR[..], &["-o", "fitted.yaml"]].concat());
    assert_eq!(found["chosen"], "ogden:3");
    let law = |name: &str| {
        let laws = found["laws"].as_array().unwrap();
        laws.iter().find(|law| law["law"] == name).unwrap().clone()
    };
    for (name, modulus, rss) in [
        ("neo-hookean", 388_262.065_6, 2.643_379_187),
        ("gent", 338_805.315_7, 1.465_316_534),
    ] {
        let law = law(name);
        assert!(
            (number(&law["parameters"][0]["value"]) / modulus - 1.0).abs() < 1e-8,
            "{law}"
        );
        assert!((number(&law["sum_of_squares"]) / rss - 1.0).abs() < 1e-8, "{law}");
    }
    let uniaxial = number(&law("gent")["left_out"]["uniaxial"]);
    assert!((uniaxial - 0.252).abs() < 5e-4, "{uniaxial}");
    // The scene can be used, and has the fitted law.
    let text = std::fs::read_to_string(workspace.path("fitted.yaml")).unwrap();
    assert!(
        text.starts_with("# The elastomer is fitted") && text.contains("model: ogden"),
        "{text}"
    );
    assert!(workspace.path("fitted.png").exists());
    // It is read again, and the same fit of it changes nothing.
    let ended = workspace.run(&[&["fit", "fitted.yaml"], &TRELOAR[..], &["-o", "again.yaml"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let again = std::fs::read_to_string(workspace.path("again.yaml")).unwrap();
    assert_eq!(text, again);
    // The neo-Hookean law replaces a law that stiffens.
    let ended = workspace.run(&[
        "fit",
        "fitted.yaml",
        TRELOAR[0],
        "--law",
        "neo-hookean",
        "-o",
        "plain.yaml",
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let plain = std::fs::read_to_string(workspace.path("plain.yaml")).unwrap();
    assert!(!plain.contains("strain_stiffening"), "{plain}");
}

#[test]
fn a_fitted_law_replaces_the_law_that_the_scene_knows() {
    let workspace = with_data();
    workspace.write(
        "known.yaml",
        "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 1.2, cells: 10 }
material: { model: neo-hookean, shear_modulus: 300 kPa, relative_permittivity: 2.8 }
drive: { voltage: 5 kV }
effects: {}
properties: { strain_stiffening: { model: arruda-boyce, locking_stretch: 3 }, density: 960 kg/m3 }
",
    );
    let fit = |law: &str| {
        let ended = workspace.run(&["fit", "known.yaml", TRELOAR[0], "--law", law, "-o", "fitted.yaml"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        std::fs::read_to_string(workspace.path("fitted.yaml")).unwrap()
    };
    let gent = fit("gent");
    assert!(!gent.contains("arruda") && gent.contains("density"), "{gent}");
    assert_eq!(gent.matches("model: gent").count(), 2, "effects and properties: {gent}");
    let plain = fit("neo-hookean");
    assert!(!plain.contains("stiffening") && plain.contains("density"), "{plain}");
    // The same with free numbers of a law; without them the scene keeps what it knows.
    let known = std::fs::read_to_string(workspace.path("known.yaml")).unwrap();
    let on = known.replace("effects: {}", "effects: { strain_stiffening: { model: gent, jm: 90 } }");
    workspace.write("on.yaml", &on);
    for (free, laws) in [("jm", ["gent", "gent"]), ("shear_modulus", ["gent", "arruda-boyce"])] {
        let ended = workspace.run(&["fit", "on.yaml", TRELOAR[0], "--free", free, "-o", "freed.yaml"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let freed = std::fs::read_to_string(workspace.path("freed.yaml")).unwrap();
        let models = freed
            .split("strain_stiffening")
            .filter_map(|part| part.split_once("model: "));
        let models: Vec<&str> = models
            .filter_map(|(_, rest)| rest.split([',', ' ', '}']).next())
            .collect();
        assert_eq!(models[1..], laws, "{free}: {freed}");
    }
    // The same in a pipeline, whose stage and artifact have the fitted scene.
    workspace.write(
        "chain.yaml",
        "version: 1
name: chain
scene: known.yaml
stages:
  pulled: { kind: measure, files: [ { file: uniaxial.csv, test: uniaxial, sigma: 3 % } ] }
  fitted: { kind: fit, needs: [pulled], laws: [gent] }
",
    );
    let ended = workspace.run(&["run", "chain.yaml"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let ended = workspace.run(&["export", "scene", "chain.yaml:fitted", "-o", "exported.yaml"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let exported = std::fs::read_to_string(workspace.path("exported.yaml")).unwrap();
    assert!(!exported.contains("arruda"), "{exported}");
    assert_eq!(exported.matches("model: gent").count(), 2, "{exported}");
}

#[test]
fn units_strains_and_true_stresses_are_converted() {
    let workspace = with_data();
    let rows: Vec<(f64, f64)> = (1..9)
        .map(|k| (1.0 + 0.1 * f64::from(k), 0.05 * f64::from(k)))
        .collect();
    let table = |header: &str, row: &dyn Fn(f64, f64) -> String| {
        let lines: Vec<String> = rows.iter().map(|(stretch, mpa)| row(*stretch, *mpa)).collect();
        format!("{header}\n{}\n", lines.join("\n"))
    };
    workspace.write(
        "a.csv",
        &table("stretch,nominal_stress_MPa", &|l, p| format!("{l},{p}")),
    );
    workspace.write(
        "b.csv",
        &table("Strain_%;nominal_stress_kPa", &|l, p| {
            format!("{};{}", 100.0 * (l - 1.0), 1e3 * p).replace('.', ",")
        }),
    );
    workspace.write(
        "c.csv",
        &table("strain true_stress_N/mm2", &|l, p| format!("{} {}", l - 1.0, p * l)),
    );
    let modulus = |file: &str, more: &[&str]| {
        let test = format!("uniaxial={file}");
        let found = fitted(&workspace, &[&[test.as_str(), "--law", "gent"], more].concat());
        number(&found["laws"][0]["parameters"][0]["value"])
    };
    let known = modulus("a.csv", &[]);
    for file in ["b.csv", "c.csv"] {
        assert!((modulus(file, &[]) / known - 1.0).abs() < 1e-9, "{file}");
    }
    // The law does not reach the prestretch of 3: that is said, and a scene with it is not written.
    let ended = workspace.run(&["fit", "scene.yaml", "uniaxial=a.csv", "--law", "gent"]);
    assert!(
        ended.code == Some(0) && ended.stderr.contains("limiting stretch"),
        "{}",
        ended.stderr
    );
    let ended = workspace.run(&["fit", "scene.yaml", "uniaxial=a.csv", "--law", "gent", "-o", "x.yaml"]);
    assert!(
        ended.code == Some(2) && !workspace.path("x.yaml").exists(),
        "{}",
        ended.stderr
    );
    assert!((modulus("a.csv", &["--sigma", "3 %"]) / known - 1.0).abs() < 1e-9);
    assert!((modulus("a.csv", &["--sigma", "2 kPa"]) / modulus("a.csv", &["--absolute"]) - 1.0).abs() < 1e-9);
}

#[test]
fn relaxation_gives_branches() {
    let workspace = with_data();
    let stress = |t: f64| 20.0 + 30.0 * (-t / 0.8_f64).exp() + 10.0 * (-t / 12.0_f64).exp();
    let rows: Vec<String> = (0..40)
        .map(|k| {
            let t = 0.02 * 1.25_f64.powi(k);
            format!("{t},2,{}", stress(t) * (2.0 - 0.25) * (1.0 + 1e-3 * f64::from(k).sin()))
        })
        .collect();
    workspace.write(
        "relax.csv",
        &format!("time_s,stretch,nominal_stress_kPa\n{}\n", rows.join("\n")),
    );
    let found = fitted(&workspace, &["uniaxial=relax.csv", "-o", "creeping.yaml"]);
    assert_eq!(found["chosen"], 2);
    let values = found["relaxation"][0]["parameters"].as_array().unwrap();
    let values: Vec<f64> = values.iter().map(|one| number(&one["value"])).collect();
    for (found, known) in values.iter().zip([20e3, 30e3, 0.8, 10e3, 12.0]) {
        assert!((found / known - 1.0).abs() < 0.02, "{values:?}");
    }
    let text = std::fs::read_to_string(workspace.path("creeping.yaml")).unwrap();
    assert!(
        text.contains("viscoelasticity") && workspace.path("creeping.png").exists(),
        "{text}"
    );
    let ended = workspace.run(&["fit", "creeping.yaml", "uniaxial=relax.csv"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    // A fast ramp is nearly a step; the rows say how the specimen is stretched.
    let ramp = format!(
        "time_s,stretch,nominal_stress_kPa\n0.0001,2,{}\n{}\n",
        stress(0.0) * 1.75,
        rows.join("\n")
    );
    workspace.write("ramp.csv", &ramp.replace("0.0001,2,", "0.0001,1.99999,"));
    let found = fitted(&workspace, &["uniaxial=ramp.csv", "--law", "neo-hookean"]);
    let again = found["relaxation"][0]["parameters"].as_array().unwrap();
    for (found, known) in again.iter().zip(&values) {
        assert!((number(&found["value"]) / known - 1.0).abs() < 0.02, "{found}");
    }
}

#[test]
fn curves_that_cannot_be_fitted_are_refused_with_the_reason() {
    let workspace = with_data();
    for (name, text) in [
        ("no-unit.csv", "stretch,nominal_stress\n1.1,2\n1.2,3\n"),
        ("other-unit.csv", "stretch,nominal_stress_psi\n1.1,2\n1.2,3\n"),
        ("force.csv", "displacement_mm,force_N\n1.1,2\n1.2,3\n"),
        ("one.csv", "stretch,nominal_stress_kPa\n1.1,2\n"),
        ("flat.csv", "stretch,nominal_stress_kPa\n1,0\n1,0\n"),
        ("word.csv", "stretch,nominal_stress_kPa\n1.1,2\n1.2,many\n"),
        ("negative.csv", "stretch,nominal_stress_kPa\n1.1,-2\n1.2,-3\n1.3,-4\n"),
        ("back.csv", "time_s,stretch,nominal_stress_kPa\n2,1.1,2\n1,1.2,3\n"),
    ] {
        workspace.write(name, text);
    }
    for (arguments, says) in [
        (&["uniaxial.csv"][..], "name the test, as in uniaxial=uniaxial.csv"),
        (&["biaxial=uniaxial.csv"], "biaxial is no test"),
        (&["uniaxial=missing.csv"], "missing.csv"),
        (&["uniaxial=no-unit.csv"], "the column `nominal_stress` has no unit"),
        (&["uniaxial=other-unit.csv"], "`nominal_stress_psi` has an unknown unit"),
        (&["uniaxial=force.csv"], "there is no column `stretch`"),
        (
            &["uniaxial=one.csv", "--law", "gent"],
            "1 points cannot determine 2 parameters",
        ),
        (&["uniaxial=flat.csv"], "all stretches are 1"),
        (&["uniaxial=word.csv"], "line 3"),
        (&["uniaxial=negative.csv"], "wrong sign"),
        (&["uniaxial=back.csv"], "the time is before that of the row above"),
        (&["uniaxial=uniaxial.csv", "--law", "hooke"], "allowed: neo-hookean"),
        (&["uniaxial=uniaxial.csv", "--sigma", "0 %"], "is not positive"),
        (&["uniaxial=uniaxial.csv", "-o", "scene.yaml"], "scene.yaml"),
        (&["uniaxial=uniaxial.csv", "-o", "uniaxial.csv"], "uniaxial.csv"),
    ] {
        let ended = workspace.run(&[&["fit", "scene.yaml"], arguments].concat());
        let flat = ended.stderr.replace("\n  │ ", " ");
        assert!(
            ended.code == Some(2) && flat.contains(says),
            "{arguments:?}: {:?} {}",
            ended.code,
            ended.stderr
        );
    }
    // Two points for three parameters: other laws are fitted, and this one says why it is not.
    workspace.write("two.csv", "stretch,nominal_stress_kPa\n1.5,20\n2,35\n");
    let found = fitted(
        &workspace,
        &["uniaxial=two.csv", "--law", "yeoh", "--law", "neo-hookean"],
    );
    assert_eq!(found["chosen"], "neo-hookean");
    assert!(
        found["laws"].to_string().contains("2 points cannot determine 3"),
        "{found}"
    );
}

const DEVICE: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 20 }
material: { model: neo-hookean, shear_modulus: 60 kPa, relative_permittivity: 4.7 }
drive: { voltage: 4 kV }
effects: {}
";

/// Simulates measurements at 41.3 kPa and a supply that shows 0.12 kV too much, with noise of 5 µm.
fn with_device() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("device.yaml", DEVICE);
    let half = (0..20).map(|_| format!("{}\n", [["1"; 10], ["0"; 10]].concat().join(",")));
    workspace.write("half.csv", &half.collect::<String>());
    let points: String = (0..81)
        .map(|k| format!("{},{},0,0\n", 5 + k % 9 * 5, 5 + k / 9 * 5))
        .collect();
    workspace.write("zeros.csv", &format!("x_mm,y_mm,ux_mm,uy_mm\n{points}"));
    let mut list = "files:\n".to_owned();
    for kilovolts in [3, 4, 5] {
        let actual = f64::from(kilovolts) - 0.12;
        workspace.write(
            "truth.yaml",
            &format!("files: [ {{ file: zeros.csv, test: field, pattern: half.csv, voltage: {actual} kV }} ]"),
        );
        let modulus = "material.shear_modulus=41.3 kPa";
        let ended = workspace.run(&[
            "compare",
            "device.yaml",
            "truth.yaml",
            "--set",
            modulus,
            "-o",
            "truth.csv",
        ]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let table = std::fs::read_to_string(workspace.path("truth.csv")).unwrap();
        let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|line| line.split(',').collect()).collect();
        let mut field = "x_mm,y_mm,ux_um,uy_um\n".to_owned();
        for (number, pair) in rows.chunks_exact(2).enumerate() {
            let noise = |c: usize| 5.0 * 2.0_f64.sqrt() * (2.3 * ((2 * number + c + 1) as f64).powi(2)).sin();
            let seen = [0, 1].map(|c: usize| 1e3 * pair[c][10].parse::<f64>().unwrap() + noise(c));
            field += &format!("{},{},{},{}\n", pair[0][2], pair[0][3], seen[0], seen[1]);
        }
        workspace.write(&format!("dic-{kilovolts}.csv"), &field);
        list += &format!(
            "  - {{ file: dic-{kilovolts}.csv, test: field, pattern: half.csv, voltage: {kilovolts} kV, sigma: 5 um }}\n"
        );
    }
    workspace.write("measured.yaml", &list);
    workspace
}

#[test]
fn fields_of_a_device_give_its_modulus_and_the_offset_of_the_supply() {
    let workspace = with_device();
    let free = ["--free", "shear_modulus", "--free", "voltage_offset"];
    let arguments = [
        &["fit", "device.yaml", "measured.yaml", "--json", "-o", "known.yaml"],
        &free[..],
    ]
    .concat();
    let found = workspace.run(&arguments);
    assert_eq!(found.code, Some(0), "{}", found.stderr);
    let found = found.json();
    for (at, truth) in [(0, 41.3e3), (1, -120.0)] {
        let parameter = &found["parameters"][at];
        let interval = [0, 1].map(|end| number(&parameter["interval"][end]));
        let width = interval[1] - interval[0];
        assert!(
            (number(&parameter["value"]) - truth).abs() < width && width < 0.5 * truth.abs(),
            "{parameter}"
        );
    }
    assert_eq!(
        (&found["verdict"], &found["compared"][2]["points"]),
        (&"determined".into(), &81.into())
    );
    assert!(
        found["warnings"].to_string().contains("add −0.1"),
        "{}",
        found["warnings"]
    );
    // The mesh of the truth is that of the first fit.
    assert!(number(&found["mesh_shift"]) < 1.0, "{}", found["mesh_shift"]);
    let text = std::fs::read_to_string(workspace.path("known.yaml")).unwrap();
    assert!(
        text.starts_with("# Fitted by `deaflow fit` to dic-3.csv (field)"),
        "{text}"
    );
    // Without the offset, the fitted scene is at a voltage that is too high.
    let compared = workspace
        .run(&["compare", "known.yaml", "measured.yaml", "--json"])
        .json();
    let chi2 = |compared: &Value| number(&compared["chi2_per_dof"]);
    assert!(
        chi2(&found["compared"][0]) < 1.3 && chi2(&compared["compared"][0]) > 2.0,
        "{compared}"
    );
    let offset = format!("{} V", found["parameters"][1]["value"]);
    let corrected = [
        "compare",
        "known.yaml",
        "measured.yaml",
        "--json",
        "--effects",
        "--voltage-offset",
        offset.as_str(),
    ];
    let corrected = workspace.run(&corrected).json();
    assert!(
        (chi2(&corrected["compared"][0]) - chi2(&found["compared"][0])).abs() < 0.01,
        "{corrected}"
    );
    let fringe = corrected["effects"]
        .as_array()
        .unwrap()
        .iter()
        .find(|one| one["effect"] == "fringe_field");
    assert!(number(&fringe.unwrap()["rms"][2]) < 0.01, "{corrected}");
    let people = workspace.run(&["compare", "known.yaml", "measured.yaml", "-o", "seen.csv"]);
    assert!(
        people.stdout.contains("motion of the camera") && people.stdout.contains("χ²/dof"),
        "{}",
        people.stdout
    );
    let table = std::fs::read_to_string(workspace.path("seen.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 3 * 81 * 2);
    assert!(workspace.path("known.png").exists() && workspace.path("seen.png").exists());
}

#[test]
fn a_fit_to_a_device_says_what_it_lacks() {
    let workspace = with_device();
    workspace.write(
        "one.yaml",
        "files: [ { file: dic-4.csv, test: field, pattern: half.csv, voltage: 4 kV, sigma: 5 um } ]",
    );
    workspace.write("odd.yaml", "files: [ { file: dic-4.csv, test: field } ]");
    workspace.write(
        "far.yaml",
        "files: [ { file: dic-4.csv, test: field, pattern: half.csv, voltage: 9 kV } ]",
    );
    let free = ["--free", "shear_modulus"];
    for (arguments, says) in [
        (&["one.yaml"][..], "needs free parameters"),
        (&["one.yaml", "--free", "shear"], "no such number"),
        (&["odd.yaml", free[0], free[1]], "pattern"),
        (&["far.yaml", free[0], free[1]], "no state to start from at 9.000 kV"),
        (&["none.yaml", free[0], free[1]], "none.yaml"),
        (&["one.yaml", free[0], free[1], "-o", "dic-4.csv"], "dic-4.csv"),
        (&["field=dic-4.csv", free[0], free[1]], "field is no test of a specimen"),
    ] {
        let ended = workspace.run(&[&["fit", "device.yaml"], arguments].concat());
        let flat = ended.stderr.replace("\n  │ ", " ");
        assert!(
            ended.code == Some(2) && flat.contains(says),
            "{arguments:?}: {:?} {}",
            ended.code,
            ended.stderr
        );
    }
    // What is read is not overwritten, neither by the table nor by the figure next to it.
    for name in ["dic-4.csv", "half.csv", "one.yaml"] {
        let before = std::fs::read(workspace.path(name)).unwrap();
        let ended = workspace.run(&["compare", "device.yaml", "one.yaml", "-o", name]);
        assert_eq!(ended.code, Some(2), "{name}: {}", ended.stderr);
        assert!(std::fs::read(workspace.path(name)).unwrap() == before, "{name}");
    }
    let both = ["--free", "shear_modulus", "--free", "voltage_offset"];
    let ended = workspace.run(&[&["fit", "device.yaml", "one.yaml"], &both[..]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(ended.stderr.contains("do not determine"), "{}", ended.stderr);
}

/// Curves of specimens are fitted with a device, and are shown with the fitted law, not with that of the first scene.
#[test]
fn a_curve_and_a_field_are_fitted_together() {
    let workspace = with_device();
    let rows = [1.2, 1.5, 2.0, 2.5].map(|l: f64| format!("{l},{}\n", 41.3 * (l - l.powi(-2))));
    workspace.write("ut.csv", &format!("stretch,nominal_stress_kPa\n{}", rows.concat()));
    let arguments = [
        "fit",
        "device.yaml",
        "measured.yaml",
        "uniaxial=ut.csv",
        "--sigma",
        "1 %",
        "--json",
    ];
    let free = ["--free", "shear_modulus", "--free", "voltage_offset"];
    let ended = workspace.run(&[&arguments[..], &free[..]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let found = ended.json();
    let modulus = &found["parameters"][0];
    assert!((number(&modulus["value"]) / 41.3e3 - 1.0).abs() < 0.02, "{modulus}");
    let curve = &found["compared"][3];
    assert!(
        curve["file"] == "ut.csv" && number(&curve["r_squared"]) > 0.99,
        "{curve}"
    );
    let refused = workspace.run(&[&arguments[..], &free[..], &["--law", "gent"]].concat());
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
}

/// A displacement beyond every stable state: the search ends at the edge of pull-in.
#[test]
fn a_fit_that_does_not_converge_has_an_exit_code_of_its_own() {
    let workspace = Workspace::new();
    workspace.write("device.yaml", &DEVICE.replace("cells: 20", "cells: 6"));
    let half = (0..6).map(|_| "1,1,1,0,0,0\n");
    workspace.write("half.csv", &half.collect::<String>());
    workspace.write("far.csv", "voltage_kV,displacement_mm\n3,2\n4,9\n4.5,16\n");
    workspace.write(
        "far.yaml",
        "files: [ { file: far.csv, test: voltage-displacement, pattern: half.csv, point: [25 mm, 25 mm], direction: 0 deg } ]",
    );
    let arguments = [
        "fit",
        "device.yaml",
        "far.yaml",
        "--free",
        "shear_modulus",
        "--elements-per-cell",
        "1",
    ];
    let ended = workspace.run(&[&arguments[..], &["--json", "-o", "far-fitted.yaml"]].concat());
    assert_eq!(ended.code, Some(7), "{} {}", ended.stdout, ended.stderr);
    let found = ended.json();
    assert_eq!(
        (&found["converged"], &found["verdict"]),
        (&false.into(), &"the search did not converge".into())
    );
    assert!(ended.stderr.contains("did not converge"), "{}", ended.stderr);
    let text = std::fs::read_to_string(workspace.path("far-fitted.yaml")).unwrap();
    assert!(text.contains("# the search did not converge."), "{text}");
    assert!(workspace.path("far-fitted.png").exists());
}

/// Stresses of a Gent law with noise of 2 %, which do not determine the four parameters of ogden:2.
const STIFFENING: &str = "\
stretch,nominal_stress_kPa
1.25,27.60
1.5,48.38
1.75,64.73
2.0,85.28
2.25,103.10
2.5,127.55
2.75,143.60
3.0,166.66
3.25,200.01
3.5,229.61
3.75,274.76
4.0,319.80
";

#[test]
fn a_law_with_undetermined_parameters_gives_way_to_one_that_is_almost_as_good() {
    let workspace = with_data();
    workspace.write("stiffening.csv", STIFFENING);
    let fit = |law: &str| {
        let arguments = [
            "uniaxial=stiffening.csv",
            "--sigma",
            "2 %",
            "--law",
            "ogden:2",
            "--law",
            law,
        ];
        fitted(&workspace, &arguments)
    };
    let found = fit("arruda-boyce");
    let verdict = found["laws"][0]["verdict"].as_str().unwrap();
    assert!(
        found["laws"][0]["law"] == "ogden:2" && verdict.starts_with("the data do not determine"),
        "{found}"
    );
    let above = number(&found["laws"][1]["aicc"]) - number(&found["laws"][0]["aicc"]);
    assert!((6.0..7.0).contains(&above), "{above}");
    assert_eq!(found["chosen"], "arruda-boyce");
    let reason = found["reason"].as_str().unwrap();
    assert!(
        reason.starts_with("AICc of ogden:2 is less by 6.069, but the data do not determine"),
        "{reason}"
    );
    // One that is much worse is not chosen.
    let clear = fit("neo-hookean");
    assert_eq!(
        (&clear["chosen"], &clear["reason"]),
        (&Value::from("ogden:2"), &Value::Null)
    );
    // A stage chooses the same.
    workspace.write(
        "p.yaml",
        "version: 1\nname: p\nscene: scene.yaml\nstages:\n  \
         pulled: { kind: measure, files: [{ file: stiffening.csv, test: uniaxial, sigma: 2 % }] }\n  \
         law: { kind: fit, needs: [pulled], laws: [ogden:2, arruda-boyce] }\n",
    );
    let ended = workspace.run(&["run", "p.yaml", "-v"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(ended.stdout.contains("law: arruda-boyce: "), "{}", ended.stdout);
}

/// Stresses of Gent's law (30 kPa, jm 60) with noise of 2 %: one test up to a stretch of 4.
const TENSILE: &str = "\
strain_%,nominal_stress_kPa
10.0,8.38
30.7,21.19
51.4,32.82
72.1,42.07
92.9,51.06
113.6,59.86
134.3,67.26
155.0,77.24
175.7,85.69
196.4,99.02
217.1,105.94
237.9,115.76
258.6,126.98
279.3,138.44
300.0,150.81
";

#[test]
fn of_laws_that_fit_equally_well_that_with_the_fewest_parameters_is_chosen() {
    let workspace = with_data();
    workspace.write("tensile.csv", TENSILE);
    let found = fitted(&workspace, &["uniaxial=tensile.csv", "--sigma", "1 %"]);
    assert_eq!(found["laws"][0]["law"], "ogden:2");
    assert_eq!(found["chosen"], "gent");
    assert_eq!(
        found["reason"],
        "AICc of ogden:2 is less by 0.3723, and gent has fewer parameters"
    );
    let jm = &found["laws"][1]["parameters"][1]["interval"];
    assert!(number(&jm[0]) < 60.0 && 60.0 < number(&jm[1]), "{jm}");
    // At the equibiaxial prestretch of 3 of the scene: 2g (3^α − 3^−2α)/3α by hand for the first term of Ogden's law.
    let doubt = |found: &Value| {
        let warnings = found["warnings"].as_array().unwrap().iter();
        let mut texts = warnings.filter_map(Value::as_str);
        texts
            .find(|text| text.contains("differ by a factor"))
            .map(str::to_owned)
    };
    let warning = doubt(&found).unwrap_or_else(|| panic!("{found}"));
    assert!(
        warning.contains("3.000 × 3.000: yeoh 118.3 kPa, ogden:2 4.882e6 kPa"),
        "{warning}"
    );
    assert_eq!(doubt(&fitted(&workspace, &TRELOAR)), None);
}

#[test]
fn a_device_is_fitted_with_the_edges_of_its_drawing() {
    let workspace = Workspace::new();
    workspace.write(
        "scene.yaml",
        "geometry: { side: 52 mm, thickness: 1 mm, prestretch: 3, cells: 26 }\nmaterial: { model: neo-hookean, \
         shear_modulus: 45 kPa, relative_permittivity: 4.7 }\ndrive: { voltage: 4 kV }\n",
    );
    workspace.write(
        "disc.svg",
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"52mm\" height=\"52mm\" viewBox=\"0 0 52 52\"><circle \
         cx=\"26\" cy=\"26\" r=\"10\"/></svg>",
    );
    let mesh = ["--elements-per-cell", "1", "--order", "2"];
    let point = [
        "--point",
        "36 mm, 26 mm",
        "--direction",
        "0",
        "--edges",
        "fitted",
        "--json",
    ];
    let row = |voltage: &str| {
        let of = ["solve", "scene.yaml", "disc.svg", "--voltage", voltage];
        let solved = workspace.run(&[&of[..], &point, &mesh].concat());
        assert_eq!(solved.code, Some(0), "{solved}");
        format!(
            "{},{}\n",
            &voltage[..3],
            number(&solved.json()["patterns"][0]["along_mm"])
        )
    };
    let rows: String = ["3.0 kV", "4.0 kV", "5.0 kV"].map(row).concat();
    workspace.write("vd.csv", &format!("voltage_kV,displacement_mm\n{rows}"));
    let entry = |more: &str| {
        format!(
            "{{ file: vd.csv, test: voltage-displacement, pattern: disc.svg, point: [36 mm, 26 mm], direction: 0 deg, \
             sigma: 0.005 mm{more} }}"
        )
    };
    let fit = |more: &str| {
        workspace.write("measured.yaml", &format!("files:\n  - {}\n", entry(more)));
        let of = ["measured.yaml", "--free", "shear_modulus=10 kPa..100 kPa", "--json"];
        let ended = workspace.run(&[&["fit", "scene.yaml"], &of[..], &mesh].concat());
        assert_eq!(ended.code, Some(0), "{ended}");
        (number(&ended.json()["parameters"][0]["value"]), ended.stderr)
    };
    let (followed, silent) = fit(", edges: fitted");
    assert!((followed / 45e3 - 1.0).abs() < 1e-4, "{followed}");
    assert!(!silent.contains("add `edges: fitted`"), "{silent}");
    let (of_cells, warned) = fit("");
    assert!((of_cells / 45e3 - 1.0).abs() > 2e-3, "{of_cells}");
    assert!(warned.contains("add `edges: fitted`"), "{warned}");
    // A stage keeps the drawn edges, and its key depends on them.
    let run = |more: &str| {
        let pipeline = format!(
            "version: 1\nname: p\nscene: scene.yaml\nstages:\n  seen: {{ kind: measure, files: [{}] }}\n  fitted: {{ kind: \
             fit, needs: [seen], free: {{ shear_modulus: 10 kPa..100 kPa }}, elements_per_cell: 1, order: 2 }}\n",
            entry(more)
        );
        workspace.write("p.yaml", &pipeline);
        let ended = workspace.run(&["run", "p.yaml", "--json"]);
        assert_eq!(ended.code, Some(0), "{ended}");
        number(&ended.json()["fits"][0]["parameters"][0]["value"])
    };
    assert!((run(", edges: fitted") / followed - 1.0).abs() < 1e-5);
    assert!((run("") / of_cells - 1.0).abs() < 1e-5);
}
