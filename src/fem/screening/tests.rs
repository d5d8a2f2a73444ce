//! Scenes with known answers.

mod agreement;

use std::path::Path;

use super::*;
use crate::effects::{EFFECTS, Verdict};
use crate::{MembraneSolver, SetupError, SolveOptions, WorkLimit};
use deaflow_base::{Decimal, Declared, Density, ElectricField, Frequency, Length, Parameter, Resistance, Stress, Time};
use deaflow_field::{Mesh, Outcome};
use deaflow_pattern::{Coverage, Pattern, Raster};
use deaflow_scene::effects::names;
use deaflow_scene::laws::{Gent, Ogden, OgdenTerm, Yeoh};
use deaflow_scene::{
    Branch, Breakdown, ConstantStrength, Edge, Effects, Electrode, Leads, On, PermittivityDecay, PermittivityReference,
    Scene, Stiffening, Viscoelasticity, ViscousLaw,
};

fn decimal(text: &str) -> Decimal {
    text.parse().unwrap()
}

fn row(scene: &Scene, name: &str) -> Row {
    let effect = *EFFECTS.iter().find(|effect| effect.name() == name).unwrap();
    let mut rows = screen_for(&[effect], scene, &reference_patterns(scene)).unwrap().rows;
    rows.remove(0)
}

/// The reference patterns without the search for critical voltages.
fn compared() -> Vec<TestPattern> {
    let without_search = |pattern| TestPattern {
        find_critical_voltage: false,
        ..pattern
    };
    reference_patterns(&Scene::vhb4910())
        .into_iter()
        .map(without_search)
        .collect()
}

fn gent(jm: &str) -> Stiffening {
    Stiffening::Gent(Gent { jm: decimal(jm) })
}

#[test]
fn numbers_of_the_scene_are_the_closed_forms() {
    let mut scene = Scene::vhb4910();
    scene.drive.frequency = Some(Frequency::literal("100 Hz"));
    scene.properties.density = Some(Density::literal("960"));
    scene.properties.sheet_resistance = Some(Resistance::literal("50 kOhm"));
    // One as fast as the force, and one far slower, which is a spring.
    let branch = |modulus, time| Branch {
        modulus: Stress::literal(modulus),
        time: Time::literal(time),
    };
    scene.properties.viscoelasticity = Some(Viscoelasticity {
        law: ViscousLaw::Linear,
        branches: vec![branch("30 kPa", "1 ms"), branch("15 kPa", "500 s")],
    });
    let screening = screen(&scene, &compared()).unwrap();
    // V² swings at 200 Hz. ωτ = 0.4π: 4 · 30e3/(45e3 · 9) · ωτ/√(1 + ω²τ²), and half of that without the factor; f₁ =
    // 216.506 Hz · √(45/25); 2π 100 · 2 · 50e3 · ε 9/1e-3 / (π/0.1)².
    let turn = 0.4 * std::f64::consts::PI;
    let permittivity = 4.7 * 8.854_187_812_8e-12;
    let expected = [
        (
            names::VISCOELASTICITY,
            0.296_296_296_296 * (turn / (1.0 + turn * turn).sqrt() + 0.5),
        ),
        (names::INERTIA, 200.0 / (216.506_350_946 * 1.8_f64.sqrt())),
        (
            names::RESISTANCE,
            2.0 * std::f64::consts::PI * 100.0 * 100e3 * permittivity * 9e3 * (0.1 / std::f64::consts::PI).powi(2),
        ),
    ];
    for (name, number) in expected {
        let row = screening.rows.iter().find(|row| row.effect == name).unwrap();
        assert!(
            (row.assessment.number.unwrap() / number - 1.0).abs() < 1e-9,
            "{row:?} {number}"
        );
        assert_eq!(
            row.assessment.verdict == Verdict::Significant,
            number > row.assessment.threshold,
            "{row:?}"
        );
    }
}

#[test]
fn missing_data_are_unknown_and_inapplicable_effects_are_not_significant() {
    let screening = screen(&Scene::vhb4910(), &compared()).unwrap();
    let verdict = |name: &str| {
        screening
            .rows
            .iter()
            .find(|row| row.effect == name)
            .unwrap()
            .assessment
            .verdict
    };
    for name in [names::STIFFENING, names::ELECTRODE, names::PERMITTIVITY] {
        assert_eq!(verdict(name), Verdict::NoData);
    }
    for name in [
        names::VISCOELASTICITY,
        names::INERTIA,
        names::RESISTANCE,
        names::CHARGE,
        names::INCLUSION,
    ] {
        assert_eq!(verdict(name), Verdict::NotSignificant);
    }
    // Rigid inclusions are bodies of the geometry, not a named effect.
    assert_eq!(screening.rows.len(), Effects::keys().len() + 1);
    assert!(screening.rows.iter().all(|row| row.status == Status::Off));
}

#[test]
fn wrinkling_is_significant_without_prestretch() {
    assert_eq!(
        row(&Scene::vhb4910(), names::WRINKLING).assessment.verdict,
        Verdict::NotSignificant
    );
    // Without prestretch any expansion compresses the rest of the membrane.
    let slack = Scene::with_values(50.0, 1.0, 1.0, 45e3, 4.7, 500.0);
    assert_eq!(row(&slack, names::WRINKLING).assessment.verdict, Verdict::Significant);
    // At rest it is free of stress.
    let rest = row(&slack.at_voltage(0.0), names::WRINKLING);
    assert_eq!(
        (rest.assessment.verdict, rest.assessment.number.unwrap().abs() < 1e-12),
        (Verdict::NotSignificant, true)
    );
}

#[test]
fn the_distance_to_pull_in_grows_with_the_voltage_squared() {
    // The single cell becomes unstable first, at 4.489 kV at 25 kPa on eight elements per cell; two meshes are accurate
    // to 1.2 %.
    let soft = |voltage| Scene::with_values(50.0, 1.0, 3.0, 25e3, 4.7, voltage);
    let [low, high] = [2e3, 4e3].map(|v| row(&soft(v), names::STABILITY).assessment.number.unwrap());
    assert!((high / low - 4.0).abs() < 1e-9);
    let limit = 2e3 / low.sqrt();
    assert!((limit / 4.489e3 - 1.0).abs() < 1.2e-2, "{limit}");
    // Far from it the critical voltage is not searched for.
    let far = row(&soft(1e3), names::STABILITY);
    assert_eq!(
        (far.assessment.number, far.assessment.verdict),
        (None, Verdict::NotSignificant)
    );
    assert_eq!(
        row(&soft(3e3), names::STABILITY).assessment.verdict,
        Verdict::NotSignificant
    );
    assert_eq!(
        row(&soft(4e3), names::STABILITY).assessment.verdict,
        Verdict::Significant
    );
}

#[test]
fn breakdown_compares_the_true_field() {
    // A fully active membrane at rest has E = V λp²/H = 47.25 MV/m; no pattern has much more.
    let mut scene = Scene::vhb4910();
    scene.properties.dielectric_breakdown = Some(Breakdown::Constant(ConstantStrength {
        field: ElectricField::literal("47.25 MV/m"),
    }));
    let number = row(&scene, names::BREAKDOWN).assessment.number.unwrap();
    assert!((1.0..1.6).contains(&number), "{number}");
}

#[test]
fn auto_turns_on_significant_effects_with_data() {
    let mut scene = Scene::vhb4910();
    scene.auto = true;
    scene.properties.strain_stiffening = Some(gent("125"));
    scene.properties.electrode_stiffness = Some(Electrode {
        shear_modulus: Stress::literal("1 kPa"),
        thickness: Length::literal("1 um"),
    });
    let screening = screen(&scene, &compared()).unwrap();
    let effects = &screening.scene.effects;
    assert_eq!(effects.strain_stiffening, Some(gent("125")));
    assert_eq!(effects.electrode_stiffness, None);
    assert!(effects.fringe_field.is_some() && effects.wrinkling.is_none() && !screening.scene.auto);
    assert_eq!(screening.warnings(), Vec::<String>::new());
    assert_eq!(resolve(&scene).unwrap(), screening.scene);
}

#[test]
fn auto_turns_on_the_resistance_of_electrodes_that_are_wired() {
    let mut scene = Scene::with_values(50.0, 10.0, 1.5, 45e3, 4.7, 100.0);
    scene.auto = true;
    scene.drive.frequency = Some(Frequency::literal("100 kHz"));
    scene.properties.sheet_resistance = Some(Resistance::literal("50 kOhm"));
    let effect = *EFFECTS
        .iter()
        .find(|effect| effect.name() == names::RESISTANCE)
        .unwrap();
    let decided = |scene: &Scene| screen_for(&[effect], scene, &compared()).unwrap();
    let unwired = decided(&scene);
    assert_eq!((unwired.rows[0].status, unwired.warnings().len()), (Status::Off, 1));
    scene.leads = Some(Leads::Edges(vec![Edge::Left]));
    let wired = decided(&scene);
    assert_eq!((wired.rows[0].status, wired.warnings().len()), (Status::On, 0));
    assert_eq!(wired.warnings_of_equilibrium().len(), 1);
    assert!(wired.scene.effects.electrode_resistance.is_some());
    // An incompatible effect was on before it.
    scene.effects.fringe_field = Some(On {});
    assert_eq!(decided(&scene).rows[0].status, Status::Off);
}

#[test]
fn bodies_of_the_geometry_are_rigid_inclusions() {
    let text = "{ geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10, \
                bodies: [{ rectangle: [[20 mm, 20 mm], [30 mm, 30 mm]] }] }, material: { model: neo-hookean, \
                shear_modulus: 45 kPa, relative_permittivity: 4.7 }, drive: { voltage: 1 kV } }";
    let effect = *EFFECTS.iter().find(|effect| effect.name() == names::INCLUSION).unwrap();
    let found = screen_for(&[effect], &Scene::from_text(text).unwrap(), &[]).unwrap();
    assert_eq!(
        (found.rows[0].status, found.rows[0].assessment.verdict),
        (Status::On, Verdict::Significant)
    );
    assert!(found.warnings().is_empty());
}

#[test]
fn auto_leaves_out_a_fringe_field_too_wide_for_the_theory() {
    let mut scene = Scene::with_values(50.0, 10.0, 1.5, 45e3, 4.7, 100.0);
    scene.auto = true;
    let screening = screen(&scene, &compared()).unwrap();
    assert!(screening.scene.effects.fringe_field.is_none());
    assert!(screening.warnings()[0].starts_with("fringe field is off; switched on, it could not be simulated"));
}

#[test]
fn a_significant_effect_that_is_off_is_a_warning_with_its_number() {
    let warnings = screen(&Scene::vhb4910(), &compared()).unwrap().warnings();
    let rest = warnings[0].strip_prefix("fringe field is off; ").unwrap();
    let (_, change) = rest.split_once("displacement of `one hole` would ").unwrap();
    let (_, size) = change.split_once(" by ").unwrap();
    let size = size.strip_suffix(" % (threshold 2 %)").unwrap();
    let size = size.trim_start_matches(|c: char| !c.is_ascii_digit());
    assert!(size.parse::<f64>().unwrap() > 2.0, "{warnings:?}");
}

fn yeoh(c2: f64, c3: f64) -> Stiffening {
    let [c2, c3] = [c2, c3].map(|c| Stress::from_f64(c).unwrap());
    Stiffening::Yeoh(Yeoh { c2, c3 })
}

fn ogden(modulus: f64, terms: &[(f64, &str)]) -> Stiffening {
    let term = |&(share, alpha): &(f64, &str)| OgdenTerm {
        mu: Stress::from_f64(share * modulus).unwrap(),
        alpha: decimal(alpha),
    };
    Stiffening::Ogden(Ogden {
        terms: terms.iter().map(term).collect(),
    })
}

fn scene_of(name: &str) -> Scene {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines/scenes");
    Scene::load(&folder.join(name)).unwrap()
}

/// Returns the change of the largest displacement of the half-active membrane, and the verdict of all patterns.
fn half_of(scene: &Scene, name: &str) -> (f64, Verdict) {
    let row = row(scene, name);
    let half = row.comparisons.iter().find(|one| one.pattern == "half plane").unwrap();
    (half.displacement.unwrap().change, row.assessment.verdict)
}

#[test]
fn laws_with_nearly_the_same_stress_at_rest_are_significant_by_their_tangent() {
    // 2ψ′ at rest equals that of the neo-Hookean law within 2 %, but the displacements differ.
    let mut thin = scene_of("thin-film.yaml");
    thin.auto = false;
    let (change, verdict) = half_of(&thin, names::STIFFENING);
    assert!(change < -0.04 && change > -0.12, "{change}");
    assert_eq!(verdict, Verdict::Significant);
    let invariant = 2.0 * 9.0 + 1.0 / 81.0 - 3.0;
    let laws = [
        (yeoh(-1.5 * 45.0 * invariant, 45.0), -0.8..-0.4),
        (ogden(45e3, &[(0.04622, "4"), (1.81511, "1")]), -0.45..-0.15),
    ];
    for (law, expected) in laws {
        let mut scene = Scene::vhb4910();
        scene.properties.strain_stiffening = Some(law);
        let (change, verdict) = half_of(&scene, names::STIFFENING);
        assert!(expected.contains(&change), "{change}");
        assert_eq!(verdict, Verdict::Significant);
    }
}

#[test]
fn electrodes_and_permittivity_are_judged_by_the_displacement() {
    // χ = 0.015 is below 2 % and stiffens by 4χ; s/2 = 0.01995 is below 2 %, and permittivity falls with the strain
    // too.
    let mut scene = Scene::vhb4910();
    scene.properties.electrode_stiffness = Some(Electrode {
        shear_modulus: Stress::literal("0.675 MPa"),
        thickness: Length::literal("1 um"),
    });
    scene.properties.stretch_dependent_permittivity = Some(PermittivityDecay {
        exponent: decimal("0.0399"),
        reference: PermittivityReference::Prestretched,
    });
    for name in [names::ELECTRODE, names::PERMITTIVITY] {
        let (change, verdict) = half_of(&scene, name);
        assert!((-0.08..-0.02).contains(&change), "{name}: {change}");
        assert_eq!(verdict, Verdict::Significant, "{name}");
    }
}

fn warned(scene: &Scene, pattern: Pattern) -> Vec<String> {
    let tests = TestPattern::some_of(&[pattern], "pattern");
    ScreenedScene::for_patterns(scene, &tests, WorkLimit::default())
        .unwrap()
        .warnings
}

fn one_cell() -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (25, 25))
}

fn half() -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, _| x < 25)
}

#[test]
fn warnings_are_about_the_given_patterns_alone() {
    // A fringe field moves the edge of half a membrane by a few micrometres in fifty millimetres.
    let half_alone = warned(&Scene::vhb4910(), half());
    assert!(!half_alone.iter().any(|w| w.starts_with("fringe")), "{half_alone:?}");
    let cell = warned(&Scene::vhb4910(), one_cell());
    assert!(cell[0].contains("of `pattern 0`"), "{cell:?}");
    // The stability of the patterns is known from their own results, be they stable or not, and no other pattern is
    // mentioned.
    for scene in [5250.0, 6300.0].map(|volts| Scene::vhb4910().at_voltage(volts)) {
        for warnings in [warned(&scene, half()), warned(&scene, one_cell())] {
            let is_other = |w: &String| w.contains("electromechanical") || w.contains("one ");
            assert!(!warnings.iter().any(is_other), "{warnings:?}");
        }
    }
    let some = TestPattern::some_of(&vec![half(); 10], "sample");
    let names: Vec<&str> = some.iter().map(|test| test.name.as_str()).collect();
    assert_eq!(names, ["sample 0", "sample 2", "sample 5", "sample 7"]);
}

#[test]
fn a_fringe_field_is_judged_on_whole_cells() {
    // A column that is covered by less than half is bare as a whole cell.
    let share = |cell: usize| match cell % 50 {
        0..25 => 1.0,
        25 => 0.45,
        _ => 0.0,
    };
    let shares: Vec<f64> = (0..2500).map(share).collect();
    let groups: Vec<u8> = shares.iter().map(|share| u8::from(*share > 0.0)).collect();
    let covered = Pattern::of_coverage(Coverage::new(Raster::PAPER, &groups, &shares).unwrap());
    let scene = Scene::vhb4910();
    let other = scene.with_effects(Effects {
        fringe_field: Some(On {}),
        ..scene.effects.clone()
    });
    let difference = |pattern: &Pattern| {
        let tests = TestPattern::some_of(std::slice::from_ref(pattern), "pattern");
        let mut comparer = comparer::Comparer::new(&tests, examine::Purpose::Warnings, WorkLimit::default());
        let with = comparer.prepare(&scene, &other).unwrap();
        let found = comparer.compare(&with, true).unwrap().remove(0);
        found.displacement.unwrap().difference
    };
    let of_cells = difference(&half());
    assert!(of_cells > 0.0 && of_cells < 0.02, "{of_cells}");
    assert_eq!(difference(&covered), of_cells);
}

#[test]
fn effects_without_data_are_named_in_one_line() {
    let expected = "not checked, no data: strain stiffening, electrode stiffness, stretch dependent permittivity";
    assert_eq!(
        warned(&Scene::vhb4910(), half()).last().map(String::as_str),
        Some(expected)
    );
    let known = Scene::from_text(&format!(
        "{}properties: {{ strain_stiffening: {{ model: gent, jm: 120 }} }}\n",
        Scene::vhb4910().to_yaml()
    ));
    let expected = "not checked, no data: electrode stiffness, stretch dependent permittivity";
    let found = warned(&known.unwrap(), half());
    assert_eq!(found.last().map(String::as_str), Some(expected));
    // Where nothing is checked, nothing is said about what is not.
    let without = ScreenedScene::for_patterns(&Scene::vhb4910(), &[], WorkLimit::default()).unwrap();
    assert_eq!(without.warnings, Vec::<String>::new());
}

#[test]
fn known_solutions_are_judged_instead_of_others_on_a_coarse_mesh() {
    let scene = Scene::vhb4910();
    let tests = TestPattern::some_of(&[half()], "pattern");
    let no_work = WorkLimit::default().part(0.0);
    let unknown = "field of `pattern 0` is unknown: a solution for this check reached its work limit";
    let without = ScreenedScene::for_patterns(&scene, &tests, no_work).unwrap();
    assert!(
        without.warnings.iter().any(|w| w.contains(unknown)),
        "{:?}",
        without.warnings
    );
    let solver = MembraneSolver::new(&observing_breakdown(&scene), SolveOptions::default()).unwrap();
    let solved = solver.simulation(&half(), &solver.solve(&half()));
    let solved = [examined("pattern 0", &scene, &half(), &solved)];
    let with = ScreenedScene::for_solutions(&scene, &tests, &solved, no_work).unwrap();
    assert!(
        !with.warnings.iter().any(|w| w.contains("breakdown")),
        "{:?}",
        with.warnings
    );
    // Nothing that was not solved is said to be unstable.
    assert!(
        !with.warnings.iter().any(|w| w.contains("unstable")),
        "{:?}",
        with.warnings
    );
}

#[test]
fn breakdown_is_warned_of_while_it_is_not_observed() {
    // 47.25 MV/m at rest, 51 · 3^0.63 = 101.9 MV/m.
    let at = |volts| Scene::vhb4910().at_voltage(volts);
    let names_breakdown = |scene: &Scene| {
        warned(scene, half())
            .iter()
            .any(|w| w.starts_with("dielectric breakdown"))
    };
    assert_eq!([5250.0, 9000.0].map(|volts| names_breakdown(&at(volts))), [false, true]);
    let observed = at(9000.0).with_effects(Effects {
        dielectric_breakdown: Some(Breakdown::Constant(ConstantStrength {
            field: ElectricField::literal("60 MV/m"),
        })),
        ..Effects::default()
    });
    assert!(!names_breakdown(&observed));
}

#[test]
fn warnings_of_a_fringe_field_are_those_of_the_table() {
    let hole = Pattern::from_fn(Raster::PAPER, |x, y| (x, y) != (25, 25));
    for volts in [5250.0, 6050.0] {
        let scene = Scene::vhb4910().at_voltage(volts);
        for pattern in [one_cell(), half(), hole.clone()] {
            let tests = TestPattern::some_of(std::slice::from_ref(&pattern), "pattern");
            let effect = *EFFECTS.iter().find(|effect| effect.name() == names::FRINGE).unwrap();
            let expected = screen_for(&[effect], &scene, &tests).unwrap().warnings();
            let found = warned(&scene, pattern);
            let found = found.into_iter().filter(|warning| warning.starts_with("fringe"));
            assert_eq!(found.collect::<Vec<_>>(), expected, "{volts} V");
        }
    }
}

#[test]
fn an_effect_that_is_on_is_compared_with_the_scene_without_it() {
    let mut off = Scene::vhb4910();
    off.properties.strain_stiffening = Some(gent("125"));
    let on = off.with_effects(Effects {
        strain_stiffening: Some(gent("125")),
        ..Effects::default()
    });
    let [off, on] = [off, on].map(|scene| row(&scene, names::STIFFENING));
    assert_eq!((off.status, on.status), (Status::Off, Status::On));
    assert_eq!(off.comparisons, on.comparisons);
    assert!(off.warning().is_some() && on.warning().is_none());
}

#[test]
fn an_effect_that_makes_a_membrane_stable_is_significant() {
    // A single cell is unstable at 6.1 kV, but not with stiffening.
    let mut scene = Scene::vhb4910().at_voltage(6300.0);
    scene.properties.strain_stiffening = Some(gent("30"));
    let row = row(&scene, names::STIFFENING);
    let cell = row.comparisons.iter().find(|one| one.pattern == "one cell").unwrap();
    let found = cell.displacement.unwrap();
    assert!(
        cell.is_decisive() && found.voltage < 6100.0 && found.change < -0.02,
        "{cell:?}"
    );
    assert_eq!(row.assessment.verdict, Verdict::Significant);
    let change = &row.assessment.change;
    assert!(change.starts_with("the stability of "), "{change}");
}

#[test]
fn an_effect_that_cannot_be_simulated_with_its_data_is_a_warning() {
    let mut scene = Scene::vhb4910();
    scene.properties.strain_stiffening = Some(gent("10"));
    let beyond = row(&scene, names::STIFFENING);
    assert_eq!(
        (beyond.assessment.number, beyond.assessment.verdict),
        (None, Verdict::Significant)
    );
    assert!(beyond.warning().unwrap().contains("beyond its limiting stretch"));
    scene.auto = true;
    assert!(matches!(
        screen(&scene, &compared()),
        Err(SetupError::LimitingStretch { .. })
    ));
}

#[test]
fn a_screening_does_not_depend_on_threads() {
    let mut scene = Scene::vhb4910();
    scene.auto = true;
    scene.properties.strain_stiffening = Some(gent("125"));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| screen(&scene, &compared()).unwrap())
    };
    assert_eq!(with(1), with(3));
}

/// Formats a number as in the table in docs/effects.md.
fn shown(row: &Row) -> String {
    let digits = |number: f64| match number.abs() {
        small if small < 1e-3 => format!("{number:.5}"),
        small if small < 0.1 => format!("{number:.4}"),
        _ => format!("{number:.3}"),
    };
    match (row.assessment.number, row.assessment.verdict) {
        (Some(number), Verdict::Significant) => format!("**{}**", digits(number)),
        (Some(number), Verdict::NotSignificant) => digits(number),
        (None, Verdict::Significant) => "**–**".to_owned(),
        (None, Verdict::NotSignificant) => "–".to_owned(),
        (_, Verdict::Unknown | Verdict::NoData | Verdict::WorkLimit) => "?".to_owned(),
    }
}

/// The scenes of the table in docs/effects.md, a column each.
const SCENES: [&str; 5] = [
    "vhb4910",
    "thin-film",
    "low-prestretch",
    "near-pull-in",
    "stiff-electrodes",
];

/// Compares columns of the table in docs/effects.md with screenings.
fn is_documented(columns: &[usize]) {
    let page = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/effects.md")).unwrap();
    for column in columns {
        let name = SCENES[*column];
        let scene = scene_of(&format!("{name}.yaml"));
        let rows = screen(&scene, &reference_patterns(&scene)).unwrap().rows;
        for row in &rows {
            let start = format!("| {} | ", row.effect);
            let written = page
                .lines()
                .filter(|line| line.starts_with(&start) && line.matches('|').count() == SCENES.len() + 2);
            let written: Vec<&str> = written.filter_map(|line| line.split(" | ").nth(1 + column)).collect();
            let written: Vec<&str> = written.iter().map(|cell| cell.trim_end_matches(" |")).collect();
            assert_eq!(written, [shown(row)], "{} of {name}", row.effect);
        }
        let on = rows.iter().filter(|row| row.status == Status::On);
        let on = match on.map(|row| row.effect).collect::<Vec<_>>() {
            none if none.is_empty() => "none".to_owned(),
            some => some.join(", "),
        };
        assert!(page.contains(&format!("| {name} | {on} |")), "{name}: {on}");
    }
}

#[test]
fn two_columns_of_the_table_of_the_documentation_are_true() {
    is_documented(&[0, 2]);
}

#[test]
#[ignore = "takes minutes"]
fn the_table_of_five_scenes_is_that_of_the_documentation() {
    is_documented(&[0, 1, 2, 3, 4]);
}

/// A single cell at several times its critical voltage without stiffening, whose stable states are far away.
fn far_beyond() -> Scene {
    let mut scene = Scene::vhb4910().at_voltage(16e3);
    scene.properties.strain_stiffening = Some(yeoh(-150.0, 4.0));
    scene.properties.electrode_stiffness = Some(Electrode {
        shear_modulus: Stress::literal("1 MPa"),
        thickness: Length::literal("1 um"),
    });
    scene
}

#[test]
fn a_pattern_that_takes_too_much_work_ends_with_a_typed_outcome() {
    let scene = far_beyond();
    let scene = scene.with_effects(Effects {
        strain_stiffening: scene.properties.strain_stiffening.clone(),
        ..Effects::default()
    });
    let cell = Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (25, 25));
    let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::biquadratic(1))).unwrap();
    for limit in [0.2, 0.5].map(WorkLimit::of_seconds) {
        let solution = solver.solve_within(&cell, limit);
        assert_eq!(solution.outcome, Outcome::WorkLimit);
        // The last step may exceed it by a hundred iterations and a factorisation.
        assert!(limit.is_spent(solution.work) && !limit.is_spent(solution.work.saturating_sub(2000)));
        // The same limit gives the same state.
        assert_eq!(solver.solve_within(&cell, limit), solution);
    }
    // The limit is one of time, not of the membrane: with more work, or at a lower voltage, the simulation converges.
    let waited = solver.solve_within(&cell, WorkLimit::of_seconds(20.0));
    assert_eq!(waited.outcome, Outcome::Converged);
    let lower = MembraneSolver::new(&scene.at_voltage(5e3), SolveOptions::on(Mesh::biquadratic(1))).unwrap();
    assert_eq!(lower.solve(&cell).outcome, Outcome::Converged);
}

#[test]
fn a_membrane_that_does_not_move_takes_no_more_work_than_others() {
    // All active: rest is an equilibrium at any voltage; the work is that of checking stability at each load.
    let solver = MembraneSolver::new(&Scene::vhb4910().at_voltage(1e6), SolveOptions::default()).unwrap();
    let full = Pattern::from_fn(Raster::PAPER, |_, _| true);
    let limit = WorkLimit::of_seconds(0.1);
    let solution = solver.solve_within(&full, limit);
    assert_eq!(solution.outcome, Outcome::WorkLimit);
    assert!(
        limit.is_spent(solution.work) && !limit.is_spent(solution.work.saturating_sub(2000)),
        "{}",
        solution.work
    );
    assert!(solution.last_stable < 1e6);
    assert!(solver.solve(&full).outcome.bracket().is_some());
}

#[test]
fn a_screening_far_beyond_the_critical_voltage_ends_with_unknown_effects() {
    let scene = far_beyond();
    let cell = [TestPattern::new(
        "one cell",
        Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (25, 25)),
    )];
    let rows = screen(&scene, &cell).unwrap().rows;
    let row = |name: &str| rows.iter().find(|row| row.effect == name).unwrap();
    // Stiffening is compared below the critical voltage without it.
    assert_eq!(row(names::STIFFENING).assessment.verdict, Verdict::Significant);
    let on = scene.with_effects(Effects {
        strain_stiffening: scene.properties.strain_stiffening.clone(),
        ..Effects::default()
    });
    let rows = screen(&on, &cell).unwrap().rows;
    let row = |name: &str| rows.iter().find(|row| row.effect == name).unwrap();
    assert_eq!(row(names::WRINKLING).assessment.verdict, Verdict::WorkLimit);
    assert_eq!(row(names::WRINKLING).assessment.number, None);
    assert!(row(names::WRINKLING).warning().unwrap().contains("work limit"));
    assert_eq!(row(names::STABILITY).assessment.verdict, Verdict::WorkLimit);
    assert!(
        row(names::STABILITY)
            .warning()
            .unwrap()
            .contains("`one cell` was not found")
    );
}
