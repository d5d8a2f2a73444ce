use super::*;
use crate::energy::{Compound, Decaying, Elasticity, Isotropic, MaterialPoint, NeoHookeanEnergy, Stiff, Stiffened};
use deaflow_base::Decimal;
use deaflow_scene::laws::{Gent, StiffeningLaw};

fn field<M: Elasticity>(prestretch: f64, kappa: f64, elasticity: M) -> TensionField<Compound<M>> {
    let dielectric = Decaying::ideal(prestretch, kappa);
    TensionField::new(Compound::new(prestretch, elasticity, dielectric, Stiff { ratio: 0.0 }))
}

fn neo(prestretch: f64) -> NeoHookeanEnergy {
    NeoHookeanEnergy::new(prestretch)
}

fn stiff(jm: f64, prestretch: f64) -> Stiffened {
    let gent = Gent {
        jm: Decimal::from_f64(jm).unwrap(),
    };
    Stiffened::new(&gent.form(1.0), prestretch).unwrap()
}

#[test]
fn a_wrinkled_strip_has_the_closed_form_width_energy_and_stress() {
    // H11 at λ₁ = 1.5: w = λ₁^(−½)(1 − κλ₁²)^(−¼), W = ½μ(λ₁² + 2λ₁⁻¹s − 3), P₁ = μ(λ₁ − λ₁⁻²s − κ/s), s = √(1 − κλ₁²).
    for (kappa, width, energy, stress) in [
        (0.1, 0.870_219_768_6, 0.211_893_895_39, 0.995_145_036_2),
        (0.0, 0.816_496_580_9, 0.291_666_666_67, 1.055_555_555_56),
    ] {
        let neo = field(1.0, kappa, neo(1.0));
        let nearly_neo = field(1.0, kappa, stiff(1e13, 1.0));
        let strips = [neo.strip(2.25, 1.0), nearly_neo.strip(2.25, 1.0)];
        let energies = [
            neo.flat.energy(&strips[0].at, 1.0),
            nearly_neo.flat.energy(&strips[1].at, 1.0),
        ];
        for (strip, found) in strips.iter().zip(energies) {
            assert!((strip.at.area / 1.5 - width).abs() < 1e-10);
            assert!((found - energy).abs() < 1e-10, "{found}");
            assert!((strip.stress - stress).abs() < 1e-10);
        }
    }
}

#[test]
fn a_thousandth_of_the_flat_energy_is_left_to_wrinkled_and_slack_membrane() {
    // W/μ at κ = 0.1: flat ½(λ₁² + λ₂² + J⁻² − 3 − κJ²), wrinkled ½(λ₁² + 2λ₁⁻¹s − 3), slack the flat one at equal
    // stretches λ with λ⁻² − λ⁻⁸ = κ, 1.018417469132: −0.05181180781512 there. By mpmath.
    for prestretch in [1.0, 1.2] {
        let field = field(prestretch, 0.1, neo(prestretch));
        for (l1, l2, energy) in [
            (1.5, 1.1, 0.277_529_729_109_3),
            (1.5, 0.5, 0.212_292_765_382_1),
            (0.9, 0.8, -0.051_596_409_834_47),
        ] {
            let [first, second] = [l1, l2].map(|l: f64| (l / prestretch).powi(2));
            let found = field.energy(&Invariants::of_squares(first, second), 1.0) * prestretch * prestretch;
            assert!((found - energy).abs() < 1e-11, "{prestretch} {l1} {l2}: {found}");
        }
    }
}

#[test]
fn natural_widths_of_stiffening_membranes_are_found() {
    for (jm, kappa) in [(30.0, 0.05), (30.0, 0.4), (8.0, 0.02), (8.0, 1.0), (70.0, 0.01)] {
        let field = field(1.5, kappa, stiff(jm, 1.5));
        for step in 0..30 {
            let first = 0.9 + 0.1 * f64::from(step);
            let inside = |x: f64| field.flat.admissible(&Invariants::of_squares(first, x)) > 0.0;
            let [uniaxial, _] = field.flat.natural_width(first, 1.0);
            if inside(uniaxial) {
                let strip = field.strip(first, 1.0);
                let across = strip.across.abs();
                assert!(across < 1e-10 * strip.lateral, "{jm} {kappa} {first}: {across:e}");
                assert!(inside(strip.at.area * strip.at.area / first));
            }
        }
    }
}

#[test]
fn stress_is_continuous_from_taut_to_wrinkled_to_slack() {
    let material = Isotropic::new(field(1.2, 0.1, neo(1.2)));
    let flat = material.potential.flat;
    let stress = |l1: f64, l2: f64| material.stress([[l1 - 1.0, 0.0], [0.0, l2 - 1.0]], 1.0);
    let gap = |a: [[f64; 2]; 2], b: [[f64; 2]; 2]| {
        (0..4)
            .map(|i| (a[i / 2][i % 2] - b[i / 2][i % 2]).abs())
            .fold(0.0, f64::max)
    };
    let width = flat.natural_width(1.1 * 1.1, 1.0)[1].sqrt();
    assert!(gap(stress(1.1, width * (1.0 + 1e-9)), stress(1.1, width * (1.0 - 1e-9))) < 1e-7);
    let unloaded = material.potential.unloaded(1.0).area.sqrt();
    let loose = |by: f64| stress(unloaded * (1.0 + by), 0.9 * unloaded);
    assert!(gap(loose(1e-9), loose(-1e-9)) < 1e-7);
    assert!(gap(loose(1e-3), loose(-1e-3)) > 1e-4);
}

#[test]
fn a_strip_loses_ellipticity_where_its_tension_falls_with_its_length() {
    // dP₁/dλ₁ = 1 + 2λ₁⁻³s + κλ₁⁻¹/s − κ²λ₁/s³; at κ = 0.16 there is no natural width from λ₁ = 2.5 on.
    let kappa = 0.16;
    let material = Isotropic::new(field(1.0, kappa, neo(1.0)));
    for step in 0..40 {
        let l1 = 1.3 + 0.04 * f64::from(step);
        let s = (1.0 - kappa * l1 * l1).sqrt();
        let slope = 1.0 + 2.0 * l1.powi(-3) * s + kappa / l1 / s - kappa * kappa * l1 / s.powi(3);
        let margin = material.ellipticity([[l1, 0.0], [0.0, 0.45]], 1.0);
        assert_eq!(margin > 0.0, slope > 0.0, "{l1}: {margin} {slope}");
    }
}
