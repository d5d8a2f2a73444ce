mod lists;
mod motions;

use std::fmt::Write as _;
use std::path::Path;

use super::curve::Noise;
use super::{Data, Device, MeasuredFile, MeasuredSet, SceneFit, compare, fit_scene, read_sets};
use deaflow_base::{InputError, Stream};
use deaflow_fem::{MembraneSolver, SolveOptions};
use deaflow_field::{Mesh, Order};
use deaflow_fit::{CreepCurve, DataSet, Elastomer, LawKind, Load, SheetCurve, Sigma, Test, Verdict, simulate};
use deaflow_pattern::{Pattern, Raster};
use deaflow_scene::Scene;

const SIZE: f64 = 50.0;
const CELLS: usize = 20;

fn scene(modulus: &str) -> Scene {
    Scene::from_text(&format!(
        "geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: {CELLS} }}
material: {{ model: neo-hookean, shear_modulus: {modulus}, relative_permittivity: 4.7 }}
drive: {{ voltage: 4 kV }}
effects: {{}}
"
    ))
    .unwrap()
}

fn options() -> SolveOptions {
    SolveOptions {
        mesh: Mesh::new(1, Order::Biquadratic),
        tolerance: 1e-11,
    }
}

fn half() -> Pattern {
    Pattern::from_fn(Raster::new(CELLS, CELLS).unwrap(), |x, y| {
        x < CELLS / 2 && (2..13).contains(&y)
    })
}

/// A camera that moves the field by a translation in mm and turns it by an angle.
#[derive(Clone, Copy)]
struct Camera {
    moved: [f64; 2],
    angle: f64,
}

const STILL: Camera = Camera {
    moved: [0.0; 2],
    angle: 0.0,
};

/// Writes a field of random points at a true modulus and voltage, with noise of a standard deviation in mm.
fn field(volts: f64, points: usize, seed: u64, sigma: f64, deformed: bool, camera: Camera) -> String {
    let scene = scene("41.3 kPa").at_voltage(volts);
    let solver = MembraneSolver::new(&scene, options()).unwrap();
    let solution = solver.solve(&half());
    let mut stream = Stream::new(seed, "measured field", 0);
    let mut text = "x_mm,y_mm,ux_mm,uy_mm\n".to_owned();
    for _ in 0..points {
        let at = [0, 1].map(|_| stream.range(2.0, SIZE - 2.0));
        let weights = solver.grid().weights_at(at).unwrap();
        let u = solver.displacement_at(&weights, &solution.displacement);
        let placed = [0, 1].map(|c: usize| at[c] + u[c]);
        let (sine, cosine) = camera.angle.sin_cos();
        let seen = [
            cosine * placed[0] - sine * placed[1] + camera.moved[0] - at[0] + sigma * stream.normal(),
            sine * placed[0] + cosine * placed[1] + camera.moved[1] - at[1] + sigma * stream.normal(),
        ];
        let at = if deformed {
            [at[0] + seen[0], at[1] + seen[1]]
        } else {
            at
        };
        writeln!(text, "{},{},{},{}", at[0], at[1], seen[0], seen[1]).unwrap();
    }
    text
}

/// Reads a list of files in a folder with `half.csv`.
fn sets(folder: &Path, list: &str, device: &Device, scene: &Scene) -> Result<Vec<MeasuredSet>, InputError> {
    let path = folder.join("measured.yaml");
    std::fs::write(&path, list).unwrap();
    read_sets(&MeasuredFile::load(&path)?, device, scene, Noise::Relative)
}

fn folder(files: &[(&str, String)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let rows = (0..CELLS).map(|y| {
        let cell = |x: usize| if half().is_active(x, y) { "1" } else { "0" };
        (0..CELLS).map(cell).collect::<Vec<_>>().join(",")
    });
    std::fs::write(folder.path().join("half.csv"), rows.collect::<Vec<_>>().join("\n")).unwrap();
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

fn fitted(files: &[(&str, String)], list: &str, free: &[&str], start: &str) -> Result<SceneFit, InputError> {
    let (folder, scene) = (folder(files), scene(start));
    let free: Vec<String> = free.iter().map(|key| (*key).to_owned()).collect();
    let device = Device::new(&scene, &free, options())?;
    let sets = sets(folder.path(), list, &device, &scene)?;
    fit_scene(&device, &sets, false)
}

fn value(found: &SceneFit, at: usize) -> (f64, f64) {
    let parameter = &found.fit.estimate.parameters[at];
    let error = parameter.standard_error.unwrap();
    (
        parameter.value,
        if parameter.logarithmic {
            error * parameter.value
        } else {
            error
        },
    )
}

#[test]
fn a_field_without_noise_gives_back_its_modulus() {
    let files = [("dic.csv", field(4000.0, 200, 1, 0.0, false, STILL))];
    let list = "files: [ { file: dic.csv, test: field, pattern: half.csv, voltage: 4 kV } ]";
    let found = fitted(&files, list, &["shear_modulus"], "60 kPa").unwrap();
    let modulus = found.fit.estimate.parameters[0].value;
    assert!((modulus / 41.3e3 - 1.0).abs() < 1e-7, "{modulus}");
    assert!(found.fit.estimate.converged && found.fit.estimate.iterations < 15);
    assert!((found.scene.shear_modulus_pa() / 41.3e3 - 1.0).abs() < 1e-6);
}

#[test]
fn fields_at_three_voltages_give_modulus_and_voltage_offset_beside_motions_of_the_camera() {
    let sigma = 0.005;
    let cameras = [[0.05, -0.02], [-0.1, 0.03], [0.0, 0.2]].map(|moved| Camera {
        moved,
        angle: 5e-3 * moved[0],
    });
    // The supply shows 0.12 kV more than there is.
    let image = |number: usize| {
        let shown = 3000.0 + 1000.0 * number as f64;
        field(
            shown - 120.0,
            300,
            10 + number as u64,
            sigma,
            number == 1,
            cameras[number],
        )
    };
    let files = [("a.csv", image(0)), ("b.csv", image(1)), ("c.csv", image(2))];
    let list = "files:
  - { file: a.csv, test: field, pattern: half.csv, voltage: 3 kV, sigma: 5 um }
  - { file: b.csv, test: field, pattern: half.csv, voltage: 4 kV, sigma: 5 um, coordinates: deformed }
  - { file: c.csv, test: field, pattern: half.csv, voltage: 5 kV, sigma: 0.005 mm }
";
    let found = fitted(
        &files,
        list,
        &["shear_modulus=1 kPa..1 MPa", "voltage_offset"],
        "60 kPa",
    )
    .unwrap();
    for (at, truth) in [(0, 41.3e3), (1, -120.0)] {
        let (value, error) = value(&found, at);
        assert!(
            (value - truth).abs() < 3.5 * error && error < 0.05 * truth.abs(),
            "{value} ± {error}"
        );
    }
    let estimate = &found.fit.estimate;
    let chi2 = estimate.sum_of_squares / estimate.degrees_of_freedom as f64;
    assert!((chi2 - 1.0).abs() < 0.12, "{chi2}");
    for (set, camera) in found.fit.sets.iter().zip(&cameras) {
        let image = &set.field.as_ref().unwrap().images[0];
        assert!((image.rotation - camera.angle).abs() < 1e-4, "{}", image.rotation);
    }
    // The middle of the membrane, about which nothing is turned, is moved by the camera alone.
    assert_eq!(found.fit.verdict, Verdict::Determined);
}

#[test]
fn one_voltage_does_not_determine_modulus_and_voltage_offset() {
    let files = [("dic.csv", field(4000.0, 200, 3, 0.005, false, STILL))];
    let list = "files: [ { file: dic.csv, test: field, pattern: half.csv, voltage: 4 kV, sigma: 5 um } ]";
    let found = fitted(&files, list, &["shear_modulus", "voltage_offset"], "45 kPa").unwrap();
    assert!(
        matches!(found.fit.verdict, Verdict::NotDetermined(_)),
        "{:?}",
        found.fit.verdict
    );
}

#[test]
fn a_point_against_the_voltage_gives_the_modulus() {
    let truth = scene("41.3 kPa");
    let mut text = "voltage_kV,displacement [um]\n".to_owned();
    for step in 1..=8 {
        let volts = 500.0 * f64::from(step);
        let solver = MembraneSolver::new(&truth.at_voltage(volts), options()).unwrap();
        let solution = solver.solve(&half());
        let u = solver.displacement_at(&solver.grid().weights_at([25.0, 25.0]).unwrap(), &solution.displacement);
        writeln!(text, "{},{}", 1e-3 * volts, 1e3 * -u[0]).unwrap();
    }
    let list = "files: [ { file: v.csv, test: voltage-displacement, pattern: half.csv, point: [25 mm, 25 mm], \
                direction: 180 deg, sigma: 0.01 mm } ]";
    let found = fitted(&[("v.csv", text)], list, &["material.shear_modulus"], "60 kPa").unwrap();
    let (modulus, _) = value(&found, 0);
    assert!((modulus / 41.3e3 - 1.0).abs() < 1e-6, "{modulus}");
}

/// Pixels of a picture whose y axis points downwards, and a table that is turned by a quarter.
#[test]
fn other_coordinates_give_the_same_field() {
    let (plain, scene) = (field(4000.0, 50, 4, 0.0, false, STILL), scene("45 kPa"));
    let rows = || {
        plain
            .lines()
            .skip(1)
            .map(|line| line.split(',').map(|v| v.parse::<f64>().unwrap()).collect::<Vec<_>>())
    };
    let mut pixels = "x_px,y_px,ux_px,uy_px\n".to_owned();
    let mut turned = "x [cm];y [cm];ux [cm];uy [cm]\n".to_owned();
    for row in rows() {
        let [x, y, ux, uy] = row[..] else { unreachable!() };
        writeln!(
            pixels,
            "{},{},{},{}",
            x / 0.02,
            (SIZE - y) / 0.02,
            ux / 0.02,
            -uy / 0.02
        )
        .unwrap();
        writeln!(
            turned,
            "{};{};{};{}",
            y / 10.0,
            (SIZE - x) / 10.0,
            uy / 10.0,
            -ux / 10.0
        )
        .unwrap();
    }
    let folder = folder(&[
        ("plain.csv", plain.clone()),
        ("pixels.csv", pixels),
        ("turned.csv", turned),
    ]);
    let list = "files:
  - { file: plain.csv, test: field, pattern: half.csv }
  - { file: pixels.csv, test: field, pattern: half.csv, scale: 20 um/px, y: down, origin: [0 mm, 50 mm] }
  - { file: turned.csv, test: field, pattern: half.csv, turn: 90 deg, origin: [50 mm, 0 mm] }
";
    let device = Device::new(&scene, &[], options()).unwrap();
    let sets = sets(folder.path(), list, &device, &scene).unwrap();
    let images: Vec<_> = sets
        .iter()
        .map(|set| match &set.data {
            Data::Field(field) => field.image(),
            other => panic!("{other:?}"),
        })
        .collect();
    for image in &images[1..] {
        let pairs = |of: fn(&deaflow_fit::FieldImage) -> &[[f64; 2]]| {
            let pairs = of(images[0]).iter().flatten().zip(of(image).iter().flatten());
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        assert!(pairs(|image| image.points()) < 1e-11 && pairs(|image| image.measured()) < 1e-11);
    }
}

/// The known answer of an independent program for a sheet under a dead load, whose noise is √2 sin(2.3 i²) σ.
#[test]
fn a_sheet_under_voltage_gives_modulus_and_permittivity() {
    let sheet = |voltage_v: Vec<f64>| SheetCurve {
        name: "truth".to_owned(),
        law: LawKind::NeoHookean,
        test: Test::Equibiaxial,
        load: Load::Stress(45e3 * (3.0 - 3.0_f64.powi(-5))),
        thickness_m: 1e-3,
        stretch: vec![1.0; voltage_v.len()],
        voltage_v,
        sigma: Sigma::UnstatedAbsolute,
    };
    let kilovolts = [0.0, 1.0, 2.0, 2.5, 3.0, 3.5, 3.8, 4.0];
    let truth = sheet(kilovolts.iter().map(|kv| 1e3 * kv).collect());
    let known = [("shear_modulus", 45e3), ("relative_permittivity", 4.7)].map(|(name, value)| (name.to_owned(), value));
    let truth = simulate(&DataSet::Sheet(truth), &known).unwrap();
    let mut text = "voltage_kV,stretch,sigma\n".to_owned();
    for (i, (kv, stretch)) in kilovolts.iter().zip(&truth).enumerate() {
        let z = 2.0_f64.sqrt() * (2.3 * ((i + 1) as f64).powi(2)).sin();
        writeln!(text, "{kv},{},{}", stretch * (1.0 + 0.002 * z), 0.002 * stretch).unwrap();
    }
    let load = 45.0 * (3.0 - 3.0_f64.powi(-5));
    let list = format!("files: [ {{ file: s.csv, test: voltage-stretch, sheet: equibiaxial, load: {load} kPa }} ]");
    let free = ["shear_modulus", "relative_permittivity"];
    let found = fitted(&[("s.csv", text.clone())], &list, &free, "60 kPa").unwrap();
    for (at, known) in [(0, 44.944_987e3), (1, 4.678_023_1)] {
        assert!(
            (value(&found, at).0 / known - 1.0).abs() < 1e-7,
            "{at}: {:?}",
            value(&found, at)
        );
    }
    assert!(found.mesh.is_none() && found.fit.verdict == Verdict::Determined);
    // A force over the undeformed width and thickness is the same load.
    let list = format!(
        "files: [ {{ file: s.csv, test: voltage-stretch, force: {} N, width: 10 mm }} ]",
        1e-2 * load
    );
    let same = fitted(&[("s.csv", text.clone())], &list, &free, "60 kPa").unwrap();
    assert!((value(&same, 0).0 / value(&found, 0).0 - 1.0).abs() < 1e-9);
    // Held at a prestretch, the sheet determines the ratio alone.
    let list = "files: [ { file: s.csv, test: voltage-stretch } ]";
    let ratio = fitted(&[("s.csv", text)], list, &free, "60 kPa").unwrap();
    assert!(
        matches!(ratio.fit.verdict, Verdict::NotDetermined(_)),
        "{:?}",
        ratio.fit.verdict
    );
}

#[test]
fn creep_of_a_sheet_is_fitted_with_the_branches_of_the_scene() {
    let branches = "effects: { viscoelasticity: { branches: [ { modulus: 40 kPa, time: 3 s } ] } }";
    let scene = |modulus: &str| Scene::from_text(&scene(modulus).to_yaml().replace("effects: {}", branches)).unwrap();
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
        time_s: vec![0.0, 1.0, 3.0, 10.0, 40.0],
        stretch: vec![1.0; 5],
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
    let rows: String = times
        .iter()
        .zip(truth)
        .map(|(t, stretch)| format!("{t},{stretch}\n"))
        .collect();
    let folder = folder(&[("c.csv", format!("time_s,stretch\n{rows}"))]);
    let scene = scene("30 kPa");
    let device = Device::new(&scene, &["shear_modulus".to_owned()], options()).unwrap();
    let sets = sets(
        folder.path(),
        "files: [ { file: c.csv, test: creep, load: 10 kPa } ]",
        &device,
        &scene,
    )
    .unwrap();
    let found = fit_scene(&device, &sets, true).unwrap();
    assert!((value(&found, 0).0 / 20e3 - 1.0).abs() < 1e-8, "{:?}", value(&found, 0));
    let compared = compare(&device, &sets[0], &[20e3]).unwrap().agreement;
    assert!(
        compared.rms < 1e-9 && compared.r_squared.unwrap() > 1.0 - 1e-12,
        "{compared:?}"
    );
}

/// A table whose y axis points downwards, without a word about it.
#[test]
fn a_field_in_a_wrong_orientation_is_noted() {
    let (plain, scene) = (field(4000.0, 60, 6, 0.005, false, STILL), scene("90 kPa"));
    let (mut mirrored, mut turned) = (
        "x_mm,y_mm,ux_mm,uy_mm\n".to_owned(),
        "x_mm,y_mm,ux_mm,uy_mm\n".to_owned(),
    );
    for line in plain.lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        let [x, y, ux, uy] = row[..] else { unreachable!() };
        writeln!(mirrored, "{},{},{},{}", SIZE - x, y, -ux, uy).unwrap();
        writeln!(turned, "{},{},{},{}", SIZE - y, x, -uy, ux).unwrap();
    }
    let folder = folder(&[("plain.csv", plain), ("mirrored.csv", mirrored), ("turned.csv", turned)]);
    let device = Device::new(&scene, &["shear_modulus".to_owned()], options()).unwrap();
    let note = |name: &str| {
        let list = format!("files: [ {{ file: {name}.csv, test: field, pattern: half.csv, voltage: 4 kV }} ]");
        sets(folder.path(), &list, &device, &scene).unwrap()[0].notes.join("; ")
    };
    assert_eq!(note("plain"), "");
    // Half an electrode is its own mirror image from left to right but for the sign of the displacement.
    assert!(
        note("mirrored").starts_with("mirrored from left to right"),
        "{}",
        note("mirrored")
    );
    assert!(note("turned").starts_with("turned by 270°"), "{}", note("turned"));
}

#[test]
fn what_cannot_be_fitted_is_refused_or_noted() {
    let plain = field(4000.0, 30, 5, 0.0, false, STILL);
    let outside = plain.clone() + "60,10,0,0\n30,10,NaN,0\n31,11,,\n";
    let twice = plain.clone() + plain.lines().nth(1).unwrap();
    let files = [
        ("dic.csv", outside),
        ("px.csv", plain.replace("_mm", "_px")),
        ("twice.csv", twice),
        ("v.csv", "voltage,u\n1,2\n".to_owned()),
    ];
    let (folder, scene) = (folder(&files), scene("45 kPa"));
    let device = Device::new(&scene, &["shear_modulus".to_owned()], options()).unwrap();
    let sets_of = |list: &str| sets(folder.path(), &format!("files: [ {list} ]"), &device, &scene);
    let found = sets_of("{ file: dic.csv, test: field, pattern: half.csv }").unwrap();
    assert!(found[0].notes[0].starts_with("2 of 33 rows"), "{:?}", found[0].notes);
    assert!(found[0].notes[1].starts_with("1 of 33 points"), "{:?}", found[0].notes);
    let twice = sets_of("{ file: twice.csv, test: field, pattern: half.csv }").unwrap();
    assert!(
        twice[0].notes[0].starts_with("2 of 31 rows are at the points of others"),
        "{:?}",
        twice[0].notes
    );
    let Data::Field(field) = &found[0].data else { panic!() };
    assert_eq!((field.image().points().len(), field.image().dropped()), (30, 3));
    for (list, part) in [
        ("{ file: px.csv, test: field, pattern: half.csv }", "unknown unit"),
        ("{ file: dic.csv, test: field }", "pattern"),
        (
            "{ file: dic.csv, test: field, pattern: half.csv, sigma: 3 % }",
            "a length",
        ),
        (
            "{ file: dic.csv, test: field, pattern: half.csv, point: [1 mm, 1 mm] }",
            "`point` does not belong",
        ),
        (
            "{ file: dic.csv, test: field, pattern: half.csv, scale: 20 um }",
            "21.3 um/px",
        ),
        (
            "{ file: dic.csv, test: field, pattern: half.csv, sigma: -1 mm }",
            "sigma",
        ),
        (
            "{ file: v.csv, test: voltage-displacement, pattern: half.csv, point: [1 mm, 1 mm], direction: 0 deg }",
            "has no unit",
        ),
        (
            "{ file: v.csv, test: voltage-displacement, pattern: half.csv, point: [1 mm, 90 mm], direction: 0 deg }",
            "",
        ),
    ] {
        let error = sets_of(list).unwrap_err();
        let text = format!("{error:?} {error}");
        assert!(text.contains(part), "{list}: {text}");
    }
    for (free, part) in [
        ("shear_modulos", "did you mean"),
        ("shear_modulus=1 kPa", "no `..`"),
        ("shear_modulus=2 kPa..1 kPa", "not in order"),
        ("shear_modulus=1 kV..2 kV", "kV"),
    ] {
        let error = Device::new(&scene, &[free.to_owned()], options()).err().unwrap();
        assert!(format!("{error:?} {error}").contains(part), "{free}: {error:?}");
    }
    let softest = fitted(
        &[("dic.csv", plain)],
        "files: [ { file: dic.csv, test: field, pattern: half.csv, voltage: 9 kV } ]",
        &["shear_modulus"],
        "45 kPa",
    );
    let message = softest.err().unwrap().to_string();
    assert!(message.contains("no state to start from at 9.000 kV"), "{message}");
}
