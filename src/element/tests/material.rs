//! Homogeneous states of a free membrane: properties of the law without a mesh.

use crate::energy::{MaterialPoint, NeoHookean};
use crate::kinematics::Tensor;

/// P₁₁/μ of the active membrane at F = diag(a, b).
fn stress(kappa: f64, a: f64, b: f64) -> f64 {
    let material = NeoHookean::new(1.0, kappa);
    let f = [[a, 0.0], [0.0, b]];
    material.stress([[a - 1.0, 0.0], [0.0, b - 1.0]], 1.0)[0][0] + material.self_stress(f)[0][0]
}

/// κ at which P₁₁/μ is `dead`: the stress is linear in κ.
fn kappa_at(dead: f64, a: f64, b: f64) -> f64 {
    let (without, with) = (stress(0.0, a, b), stress(1.0, a, b));
    (without - dead) / (without - with)
}

/// The tangent along equal stretching, in the direction of P₁₁.
fn stiffness(kappa: f64, stretch: f64) -> f64 {
    let material = NeoHookean::new(1.0, kappa);
    let at = |s: f64| -> Tensor<f64> { [[s, 0.0], [0.0, s]] };
    let null = material.self_stress(at(stretch + 1.0))[0][0] - material.self_stress(at(stretch))[0][0];
    material.tangent(at(stretch - 1.0), 1.0, at(1.0))[0][0] + null
}

/// Critical stretch of a membrane under an equal dead load, and √κ there.
fn pull_in(dead: f64, mut low: f64, mut high: f64) -> (f64, f64) {
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if stiffness(kappa_at(dead, middle, middle), middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    (low, kappa_at(dead, low, low).sqrt())
}

#[test]
fn a_free_membrane_pulls_in_where_the_closed_form_says() {
    // λ = 2^(1/3) from d/dλ (λ⁻² − λ⁻⁸) = 0; √κ = 0.687364818499 there.
    let (stretch, field) = pull_in(0.0, 1.0, 2.0);
    assert!((stretch - 2f64.cbrt()).abs() < 1e-11);
    assert!((field - 0.687_364_818_499).abs() < 1e-12);
}

#[test]
fn a_membrane_under_dead_load_pulls_in_where_the_closed_form_says() {
    // −2λ⁶ + 3sλ⁵ + 8 = 0 with s = λp − λp⁻⁵.
    for (prestretch, stretch, field) in [
        (1.5_f64, 2.141_318_385_02, 0.276_527_501_678),
        (2.0, 2.970_421_939_71, 0.195_072_513_714),
        (3.0, 4.496_004_500_76, 0.128_452_939_352),
    ] {
        let dead = prestretch - prestretch.powi(-5);
        let found = pull_in(dead, prestretch, 2.0 * prestretch);
        assert!((found.0 - stretch).abs() < 1e-10, "{found:?}");
        assert!((found.1 - field).abs() < 1e-11, "{found:?}");
    }
}

#[test]
fn pure_shear_runs_away_at_the_closed_form_field() {
    // κ = λp⁻² (1 − λ₁⁻⁴ λp⁻²) where the stress along x vanishes and λ₂ = λp: monotone, towards 1/λp².
    let prestretch = 3.0_f64;
    let mut last = 0.0;
    for stretch in [0.8_f64, 1.0, 1.7, 3.0, 10.0, 100.0] {
        let kappa = kappa_at(0.0, stretch, prestretch);
        let closed = prestretch.powi(-2) * (1.0 - stretch.powi(-4) * prestretch.powi(-2));
        assert!((kappa - closed).abs() < 1e-13, "{stretch}: {kappa} {closed}");
        assert!(kappa > last && kappa < prestretch.powi(-2));
        last = kappa;
    }
}
