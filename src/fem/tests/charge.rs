//! Prescribed charges. The numbers of the half-active square are those of an independent program (sparse Newton
//! iteration on the energy, 50² bilinear elements).

use super::*;
use deaflow_field::Charged;

fn charged(drive: &str, cells: usize) -> Scene {
    Scene::from_text(&format!(
        "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: {cells} }}, \
         material: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {{ charge: \
         {drive} }} }}"
    ))
    .unwrap()
}

fn solved(scene: &Scene, pattern: &Pattern) -> (Outcome, Option<Field>, Option<Charged>) {
    let options = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-11,
    };
    let found = MembraneSolver::new(scene, options)
        .unwrap()
        .simulate(std::slice::from_ref(pattern))
        .remove(0);
    (found.outcome, found.field, found.observation.charged)
}

fn largest_component(field: &Field) -> f64 {
    field
        .values()
        .iter()
        .fold(0.0, |largest, value| f64::max(largest, value.abs()))
}

#[test]
fn a_conducting_electrode_has_the_known_voltage_and_the_equilibrium_of_it() {
    for (charge, volts, moved) in [
        ("0.5 uC", 1062.9959010338828, 0.0794275118919807),
        ("1000 nC", 2097.071805532093, 0.31195953670818727),
        ("1.5e-6 C", 3078.1761102975156, 0.6823235211595328),
    ] {
        let scene = charged(&format!("{{ total: {charge} }}"), 50);
        let (outcome, field, found) = solved(&scene, &half());
        let (field, found) = (field.unwrap(), found.unwrap());
        assert_eq!(outcome, Outcome::Converged);
        let voltage = found.voltage.unwrap();
        assert!((voltage / volts - 1.0).abs() < 1e-9, "{voltage} {volts}");
        assert!((largest_component(&field) / moved - 1.0).abs() < 1e-7);
        assert_eq!((found.negative_at_voltage, found.negative_at_charge), (0, 0));
        let (_, at_voltage, none) = solved(&scene.at_voltage(voltage), &half());
        assert!(field.max_difference(&at_voltage.unwrap()) < 1e-9 && none.is_none());
    }
}

#[test]
fn sprayed_charge_moves_the_membrane_as_it_should_and_never_pulls_in() {
    // q = D₀/√(με) for the undeformed area of the electrode, a ninth of half of the square.
    let of = |q: f64| q * (45e3 * 4.7 * 8.854_187_812_8e-12_f64).sqrt() * 0.05 * 0.05 / 18.0;
    for (q, moved) in [
        (3.0, 0.10273243056745333),
        (12.0, 1.4285582071478735),
        (25.0, 4.643852449854332),
    ] {
        let (outcome, field, found) = solved(&charged(&format!("{{ immobile: {} C }}", of(q)), 50), &half());
        assert_eq!((outcome, found.unwrap().voltage), (Outcome::Converged, None));
        let found = largest_component(&field.unwrap());
        assert!((found / moved - 1.0).abs() < 1e-7, "{found} {moved}");
    }
    let block = Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, y| {
        (3..7).contains(&x) && (3..7).contains(&y)
    });
    let (outcome, ..) = solved(&charged("{ immobile: 5 uC }", 10), &block);
    assert_eq!(outcome, Outcome::Converged);
}

#[test]
fn past_the_fold_a_voltage_would_snap_and_a_charge_does_not() {
    let block = Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, y| {
        (3..7).contains(&x) && (3..7).contains(&y)
    });
    let mut before = (0.0, 0.0);
    for charge in [1.0, 2.0, 3.0, 4.0] {
        let (outcome, field, found) = solved(&charged(&format!("{{ total: {charge} uC }}"), 10), &block);
        assert_eq!(outcome, Outcome::Converged);
        let found = found.unwrap();
        let now = (found.voltage.unwrap(), field.unwrap().max_magnitude());
        assert!(now.0 > before.0 && now.1 > before.1, "{now:?} {before:?}");
        assert_eq!((found.negative_at_voltage, found.negative_at_charge), (0, 0));
        before = now;
    }
    // The last stable state is past the fold: there one eigenvalue is negative at fixed voltage, and none at fixed
    // charge. Beyond it the charge concentrates: a second direction becomes unstable at fixed charge too.
    let (outcome, field, found) = solved(&charged("{ total: 5 uC }", 10), &block);
    let found = found.unwrap();
    assert!(
        matches!(outcome, Outcome::PullIn { .. }) && field.is_none(),
        "{outcome}"
    );
    assert_eq!((found.negative_at_voltage, found.negative_at_charge), (1, 0));
    assert!(found.charge > 4e-6 && found.charge < 5e-6);
}

#[test]
fn a_pattern_without_electrodes_holds_no_charge() {
    let bare = Pattern::from_fn(Raster::new(10, 10).unwrap(), |_, _| false);
    for drive in ["{ total: 2 uC }", "{ immobile: 2 uC }"] {
        let (outcome, field, _) = solved(&charged(drive, 10), &bare);
        assert_eq!((outcome, field.unwrap().max_magnitude()), (Outcome::Converged, 0.0));
    }
}
