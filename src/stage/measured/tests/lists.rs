//! Numbers in lists as free parameters: prestretch along one axis, the load of a body, branches.

use std::fmt::Write as _;

use super::{SIZE, folder, half, options, sets, value};
use crate::measured::{Device, MeasuredSet, SceneFit, fit_scene};
use deaflow_base::InputError;
use deaflow_fem::MembraneSolver;
use deaflow_fit::{CreepCurve, DataSet, Elastomer, LawKind, Load, Sigma, Test, Verdict, simulate};
use deaflow_scene::Scene;

/// A scene with two numbers of the prestretch, and a body with a load.
fn scene(prestretch: f64, load: f64, effects: &str) -> Scene {
    let body = "disc: { centre: [40 mm, 25 mm], radius: 4 mm }";
    Scene::from_text(&format!(
        "geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: [3, {prestretch}], cells: 20, \
         bodies: [ {{ {body}, load: [{load} N, 0.01 N] }} ] }}
material: {{ model: neo-hookean, shear_modulus: 41.3 kPa, relative_permittivity: 4.7 }}
drive: {{ voltage: 4 kV }}
effects: {effects}
"
    ))
    .unwrap()
}

fn fitted(scene: &Scene, file: (&str, String), list: &str, free: &[&str]) -> Result<SceneFit, InputError> {
    let folder = folder(&[file]);
    let free: Vec<String> = free.iter().map(|key| (*key).to_owned()).collect();
    let device = Device::new(scene, &free, options())?;
    let sets: Vec<MeasuredSet> = sets(folder.path(), list, &device, scene)?;
    fit_scene(&device, &sets, false)
}

#[test]
fn prestretch_along_one_axis_and_the_load_of_a_body_are_fitted() {
    let truth = scene(2.8, 0.02, "{}");
    let solver = MembraneSolver::new(&truth, options()).unwrap();
    let solution = solver.solve(&half());
    let mut text = "x_mm,y_mm,ux_mm,uy_mm\n".to_owned();
    for at in (0..121).map(|k| [k % 11, k / 11].map(|i| SIZE * (0.05 + 0.09 * f64::from(i)))) {
        let Some(weights) = solver.grid().weights_at(at) else {
            continue;
        };
        let u = solver.displacement_at(&weights, &solution.displacement);
        writeln!(text, "{},{},{},{}", at[0], at[1], u[0], u[1]).unwrap();
    }
    let list = "files: [ { file: dic.csv, test: field, pattern: half.csv, voltage: 4 kV } ]";
    let free = ["prestretch.1=2..4", "geometry.bodies.0.load.0"];
    let found = fitted(&scene(2.9, 0.03, "{}"), ("dic.csv", text.clone()), list, &free).unwrap();
    for (at, known) in [(0, 2.8), (1, 0.02)] {
        assert!(
            (value(&found, at).0 / known - 1.0).abs() < 1e-5,
            "{at}: {:?}",
            value(&found, at)
        );
    }
    assert_eq!(found.fit.verdict, Verdict::Determined);
    let [along, across] = found.scene.prestretch();
    assert!(along == 3.0 && (across - 2.8).abs() < 1e-4, "{along} {across}");
    for (free, part) in [
        (
            "prestretch",
            "name one number of it, counted from 0, as in prestretch.0",
        ),
        ("prestretch.2", "numbers in lists"),
        ("load", "it is a list"),
    ] {
        let error = fitted(&truth, ("dic.csv", text.clone()), list, &[free]).err().unwrap();
        assert!(format!("{error:?} {error}").contains(part), "{free}: {error:?}");
    }
}

#[test]
fn branches_of_the_scene_are_fitted_to_creep() {
    let creep = CreepCurve {
        name: "truth".to_owned(),
        elastomer: Elastomer {
            branches: 1,
            ..Elastomer::elastic(LawKind::NeoHookean)
        },
        test: Test::Equibiaxial,
        load: Load::Stress(10e3),
        voltage_v: 0.0,
        thickness_m: 1e-3,
        time_s: vec![0.0, 0.3, 1.0, 3.0, 10.0, 40.0],
        stretch: vec![1.0; 6],
        sigma: Sigma::UnstatedAbsolute,
    };
    let times = creep.time_s.clone();
    let known = [
        ("shear_modulus", 20e3),
        ("branch_modulus_1", 40e3),
        ("branch_time_1", 3.0),
    ];
    let known = known.map(|(name, value)| (name.to_owned(), value));
    let truth = simulate(&DataSet::Creep(creep), &known).unwrap();
    let rows = times.iter().zip(truth).map(|(t, stretch)| format!("{t},{stretch}\n"));
    let text = format!("time_s,stretch\n{}", rows.collect::<String>());
    let branches = "{ viscoelasticity: { branches: [ { modulus: 30 kPa, time: 5 s } ] } }";
    let start = scene(2.8, 0.02, branches);
    let list = "files: [ { file: c.csv, test: creep, load: 10 kPa } ]";
    let free = ["shear_modulus", "branches.0.modulus", "branches.0.time"];
    let found = fitted(&start, ("c.csv", text.clone()), list, &free).unwrap();
    for (at, (name, known)) in known.iter().enumerate() {
        assert!(
            (found.fit.estimate.parameters[at].value / known - 1.0).abs() < 1e-5,
            "{name}: {:?}",
            value(&found, at)
        );
    }
    assert_eq!(found.fit.verdict, Verdict::Determined);
    assert!(found.scene.to_text().contains("time: 3"), "{}", found.scene.to_text());
    // The sheet has the thickness of the scene.
    let error = fitted(&start, ("c.csv", text), list, &["thickness"]).err().unwrap();
    assert!(error.to_string().contains("cannot be fitted to c.csv"), "{error}");
}
