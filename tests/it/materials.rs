//! Materials in files of their own: the same scene as with the values written out, and the library in
//! `pipelines/materials`.

use std::path::{Path, PathBuf};

use deaflow::base::{Declared, Document};
use deaflow::fit::{Law, OgdenTerm, Stability, Test};
use deaflow::scene::{Material, Properties, Scene, Stiffening};

use super::common::{Workspace, files};

const MATERIAL: &str = "material: { model: neo-hookean, shear_modulus: 60 kPa, relative_permittivity: 4.7 }
properties: { strain_stiffening: { model: gent, jm: 110 }, density: 960 kg/m3 }
";

/// A pipeline with the sections of a material, each on a line.
fn pipeline(sections: &str) -> String {
    let sections = sections.trim_end().replace('\n', "\n  ");
    format!(
        "version: 1
name: acrylic
scene:
  geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }}
  drive: {{ voltage: 4 kV }}
  effects: {{ strain_stiffening: {{}} }}
  {sections}
stages:
  small:  {{ kind: sample, family: small-grid, count: 2, seed: 1 }}
  solved: {{ kind: solve, needs: [small], elements_per_cell: 1 }}
"
    )
}

fn workspace() -> Workspace {
    let workspace = Workspace::new();
    std::fs::create_dir(workspace.path("materials")).unwrap();
    workspace.write("materials/acrylic.yaml", MATERIAL);
    workspace.write("written.yaml", &pipeline(MATERIAL));
    workspace.write("named.yaml", &pipeline("material: { from: materials/acrylic.yaml }"));
    workspace
}

#[test]
fn a_material_in_a_file_builds_nothing_that_its_values_have_built() {
    let workspace = workspace();
    let written = workspace.stages(&["run", "written.yaml"]);
    let named = workspace.stages(&["run", "named.yaml"]);
    assert_eq!(written.with("built"), ["small", "solved"]);
    assert_eq!(named.with("built"), [""; 0]);
    assert_eq!(named.digests(), written.digests());
    // The name of the file is in no key.
    std::fs::rename(workspace.path("materials"), workspace.path("elastomers")).unwrap();
    workspace.write("moved.yaml", &pipeline("material: { from: elastomers/acrylic.yaml }"));
    assert_eq!(workspace.stages(&["run", "moved.yaml"]).with("built"), [""; 0]);
}

#[test]
fn values_of_the_command_line_replace_those_of_a_file() {
    let workspace = workspace();
    let set = |file: &str, set: &str| workspace.stages(&["run", file, "--set", set]);
    workspace.stages(&["run", "written.yaml"]);
    for change in [
        "scene.material.shear_modulus=80 kPa",
        "scene.properties.strain_stiffening.jm=90",
    ] {
        assert_eq!(set("written.yaml", change).with("built"), ["solved"], "{change}");
        assert_eq!(set("named.yaml", change).with("built"), [""; 0], "{change}");
    }
    let softer = MATERIAL.replace("60 kPa", "50 kPa");
    workspace.write("materials/softer.yaml", &softer);
    workspace.write("soft.yaml", &pipeline(&softer));
    let named = set("named.yaml", "scene.material.from=materials/softer.yaml").digests();
    assert_eq!(named, workspace.stages(&["run", "soft.yaml"]).digests());
}

#[test]
fn a_sweep_compares_materials() {
    let workspace = workspace();
    workspace.write("materials/softer.yaml", &MATERIAL.replace("60 kPa", "50 kPa"));
    let swept = pipeline("material: { from: \"materials/${elastomer}.yaml\" }")
        .replace("solved: {", "solved: { foreach: { elastomer: [acrylic, softer] },");
    workspace.write("swept.yaml", &swept);
    let built = workspace.stages(&["run", "swept.yaml"]);
    assert_eq!(built.names().len(), 3, "{:?}", built.names());
    let one = workspace.stages(&["run", "written.yaml"]);
    assert_eq!(one.with("built"), [""; 0]);
    assert_eq!(built.digests()["solved@elastomer=acrylic"], one.digests()["solved"]);
}

#[test]
fn commands_that_take_a_scene_read_its_material() {
    let workspace = workspace();
    let rest = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }
drive: { voltage: 3 kV }
effects: { strain_stiffening: {} }
";
    workspace.write("written-scene.yaml", &format!("{rest}{MATERIAL}"));
    let named = format!("{rest}material: {{ from: materials/acrylic.yaml }}\n");
    workspace.write("named-scene.yaml", &named);
    workspace.write("half.csv", &half());
    let moved = |scene: &str| {
        let solved = workspace.run(&["solve", scene, "half.csv", "--json"]);
        assert_eq!(solved.code, Some(0), "{}", solved.stderr);
        solved.json()["patterns"].clone()
    };
    assert_eq!(moved("named-scene.yaml"), moved("written-scene.yaml"));
    // The file of a material is an input like the scene.
    let refused = workspace.run(&["solve", "named-scene.yaml", "half.csv", "-o", "materials/acrylic.yaml"]);
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    let bad = MATERIAL.replace("60 kPa", "60 kV");
    workspace.write("materials/acrylic.yaml", &bad);
    let refused = workspace.run(&["solve", "named-scene.yaml", "half.csv"]);
    assert_eq!(refused.code, Some(2));
    assert!(
        refused.stderr.contains("materials/acrylic.yaml:1"),
        "{}",
        refused.stderr
    );
}

fn half() -> String {
    let row = |_| "1,1,1,1,1,0,0,0,0,0\n";
    (0..10).map(row).collect()
}

/// The library of materials, by name.
fn library() -> Vec<(String, PathBuf)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/materials");
    let found = files(&folder).into_iter();
    let named = found.map(|file| (file.file_stem().unwrap().to_string_lossy().into_owned(), file));
    let named: Vec<_> = named.collect();
    assert!(named.len() >= 10, "{named:?}");
    named
}

/// The scene of a material of the library; a permittivity that its source does not have is 3.
fn scene(file: &Path) -> Scene {
    let root = Document::load(file).unwrap().root;
    let mut material = root.peek("material").unwrap().clone();
    if material.peek("relative_permittivity").is_none() {
        let three = Document::from_text(Path::new("permittivity"), "3").unwrap().root;
        material.put("relative_permittivity", three);
    }
    let properties = root
        .peek("properties")
        .map(|node| Properties::read_with(node, &[]).unwrap());
    Scene {
        material: Material::read_with(&material, &[]).unwrap(),
        properties: properties.unwrap_or_default(),
        ..Scene::with_values(50.0, 1.0, 1.2, 1e3, 3.0, 1.0)
    }
}

#[test]
fn every_material_of_the_library_can_be_simulated() {
    let workspace = Workspace::new();
    std::fs::create_dir(workspace.path("materials")).unwrap();
    workspace.write("half.csv", &half());
    for (name, file) in library() {
        let of_file = scene(&file);
        std::fs::copy(&file, workspace.path(&format!("materials/{name}.yaml"))).unwrap();
        let given = Document::load(&file).unwrap().root;
        let known = given.peek("material").unwrap().peek("relative_permittivity").is_some();
        let permittivity = if known { "" } else { ", relative_permittivity: 3" };
        // A field at which half of an elastomer moves by some hundredths of a millimetre.
        let volts = 0.1 * (of_file.shear_modulus_pa() / of_file.permittivity()).sqrt() * 1e-3;
        let effects: String = [
            ("strain_stiffening", of_file.properties.strain_stiffening.is_some()),
            ("viscoelasticity", of_file.properties.viscoelasticity.is_some()),
            (
                "dielectric_breakdown",
                of_file.properties.dielectric_breakdown.is_some(),
            ),
        ]
        .into_iter()
        .filter(|(_, is_known)| *is_known)
        .map(|(effect, _)| format!("{effect}: {{}}, "))
        .collect();
        workspace.write(
            "scene.yaml",
            &format!(
                "geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 1.2, cells: 10 }}
material: {{ from: materials/{name}.yaml{permittivity} }}
drive: {{ voltage: {volts:.0} V }}
effects: {{ {effects} }}
"
            ),
        );
        let solved = workspace.run(&["solve", "scene.yaml", "half.csv", "--json"]);
        assert_eq!(solved.code, Some(0), "{name}: {}{}", solved.stdout, solved.stderr);
        let pattern = &solved.json()["patterns"][0];
        assert_eq!(pattern["outcome"], "converged", "{name}: {pattern}");
        assert!(
            pattern["max_displacement_mm"].as_f64().unwrap() > 1e-3,
            "{name}: {pattern}"
        );
    }
}

/// The tests and the range of stretch in the comment of a material, as in `# Test: uniaxial; stretch 1 to 3; …`.
fn range(file: &Path) -> (Vec<Test>, f64, f64) {
    let text = std::fs::read_to_string(file).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix("# Test: "));
    let line = line.unwrap_or_else(|| panic!("{}: no line of tests", file.display()));
    let tests = [
        ("uniaxial", Test::Uniaxial),
        ("equibiaxial", Test::Equibiaxial),
        ("pure shear", Test::PureShear),
    ];
    let (named, rest) = line.split_once("; stretch ").unwrap();
    let named = tests.into_iter().filter(|(name, _)| named.contains(name));
    let numbers = rest.split(';').next().unwrap();
    let (low, high) = numbers.split_once(" to ").unwrap();
    let high = high.split([' ', ',']).next().unwrap();
    (
        named.map(|(_, test)| test).collect(),
        low.parse().unwrap(),
        high.parse().unwrap(),
    )
}

fn law(scene: &Scene) -> Law {
    let shear_modulus = scene.shear_modulus_pa();
    match &scene.properties.strain_stiffening {
        None => Law::NeoHookean { shear_modulus },
        Some(Stiffening::Gent(gent)) => Law::Gent {
            shear_modulus,
            jm: gent.jm.to_f64(),
        },
        Some(Stiffening::Yeoh(yeoh)) => Law::Yeoh {
            shear_modulus,
            c2: yeoh.c2.value(),
            c3: yeoh.c3.value(),
        },
        Some(Stiffening::ArrudaBoyce(chains)) => Law::ArrudaBoyce {
            shear_modulus,
            locking_stretch: chains.locking_stretch.to_f64(),
        },
        Some(Stiffening::MooneyRivlin(law)) => Law::MooneyRivlin {
            shear_modulus,
            c2: law.c2.value(),
        },
        Some(Stiffening::Ogden(ogden)) => {
            let term = |term: &deaflow::scene::laws::OgdenTerm| OgdenTerm {
                shear_modulus: 0.5 * term.mu.value() * term.alpha.to_f64(),
                alpha: term.alpha.to_f64(),
            };
            Law::Ogden(ogden.terms.iter().map(term).collect())
        }
    }
}

#[test]
fn every_law_of_the_library_is_stable_over_its_range_of_stretch() {
    for (name, file) in library() {
        let (tests, low, high) = range(&file);
        assert!(!tests.is_empty() && low <= high, "{name}");
        let reached: Vec<(Test, f64)> = match tests.as_slice() {
            // The largest stretch is that of the uniaxial test; the others reach less.
            [Test::Uniaxial, _, ..] => vec![
                (Test::Uniaxial, low),
                (Test::Uniaxial, high),
                (Test::Equibiaxial, high.min(4.45)),
                (Test::PureShear, high.min(4.96)),
            ],
            all => all.iter().flat_map(|test| [(*test, low), (*test, high)]).collect(),
        };
        let stability = Stability::new(&law(&scene(&file)), &reached, 1.0);
        assert!(stability.is_stable(), "{name}: {:?}", stability.unstable_at);
    }
}

/// The same test must find a law that is not stable.
#[test]
fn an_unstable_law_is_found() {
    let law = Law::Yeoh {
        shear_modulus: 50e3,
        c2: -2.5e3,
        c3: 60.0,
    };
    let reached = [(Test::Equibiaxial, 1.0), (Test::Equibiaxial, 2.0)];
    assert!(!Stability::new(&law, &reached, 1.0).is_stable());
}
