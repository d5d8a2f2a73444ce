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
        ("steps.csv", "time_s,stretch,nominal_stress_kPa\n1,1.1,2\n2,1.2,3\n"),
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
        (&["uniaxial=steps.csv"], "that after a sudden step"),
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
