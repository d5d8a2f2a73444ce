//! Stresses along histories of stretch, against closed forms and published numbers, and fits of branches to them.

use super::noise::deviate;
use crate::data_set::Prepared;
use crate::{
    DataSet, Elastomer, FitError, HistoryCurve, LawKind, Options, Profiles, Relaxation, Sigma, Test, ViscousLaw,
    fit_histories, fit_relaxation,
};

fn curve(elastomer: Elastomer, test: Test, history: &[(f64, f64)], time_s: &[f64]) -> HistoryCurve {
    HistoryCurve {
        name: "history".to_owned(),
        elastomer,
        test,
        history: history.to_vec(),
        time_s: time_s.to_vec(),
        stress_pa: vec![0.0; time_s.len()],
        sigma: Sigma::UnstatedAbsolute,
    }
}

fn elastomer(law: LawKind, viscous: ViscousLaw, branches: usize) -> Elastomer {
    Elastomer { law, branches, viscous }
}

/// Returns the stresses of a curve at values of its parameters.
fn stresses(curve: &HistoryCurve, values: &[f64]) -> Vec<f64> {
    let set = DataSet::History(curve.clone());
    let prepared = Prepared::new(&set, &|_| true).unwrap();
    let rows = prepared.residuals(values).unwrap().into_iter();
    rows.zip(&curve.stress_pa).map(|(row, stress)| row.0 + stress).collect()
}

/// The branches of two scenes after a sudden uniaxial stretch to 1.5: the table in docs/time.md, from integration of
/// the elastic stretch and from the scenes by finite elements; in kPa.
#[test]
fn published_branches_relax_as_scenes_do() {
    let hossain = [56.4e3, 0.82, 31.5e3, 10.7, 19.8e3, 500.0];
    let known = [
        (ViscousLaw::Finite, [61.368, 29.527, 17.235]),
        (ViscousLaw::Linear, [68.726, 33.545, 18.659]),
    ];
    for (law, known) in known {
        let step = [(0.0, 1.0), (0.0, 1.5)];
        let curve = curve(
            elastomer(LawKind::NeoHookean, law, 3),
            Test::Uniaxial,
            &step,
            &[1.0, 10.0, 60.0],
        );
        let found = stresses(&curve, &[&[13.7e3][..], &hossain].concat());
        let spring = 13.7e3 * Test::Uniaxial.shear(1.5);
        for (found, known) in found.iter().zip(known) {
            assert!(
                ((found - spring) / 1e3 - known).abs() <= 5.1e-4,
                "{law:?}: {}, not {known}",
                found - spring
            );
        }
    }
}

/// In pure shear A₃ follows a square of time on a ramp, which has a closed form; A₁ is integrated by Simpson's rule
/// here.
#[test]
fn a_ramp_of_the_linear_law_is_exact() {
    let (rate, tau) = (0.3, 1.7);
    let times = [0.4, 3.0, 6.0, 14.0];
    let curve = curve(
        elastomer(LawKind::NeoHookean, ViscousLaw::Linear, 1),
        Test::PureShear,
        &[(0.0, 1.0), (20.0, 1.0 + 20.0 * rate)],
        &times,
    );
    let found = stresses(&curve, &[1.0, 1.0, tau]);
    for (t, found) in times.into_iter().zip(found) {
        let stretch = 1.0 + rate * t;
        // Of (1 + at)²: the square less its derivatives times −τ, and a decaying part.
        let steady = |t: f64| {
            let l = 1.0 + rate * t;
            l * l - 2.0 * rate * tau * l + 2.0 * (rate * tau).powi(2)
        };
        let third = steady(t) + (1.0 - steady(0.0)) * (-t / tau).exp();
        let (count, mut integral) = (20_000, 0.0);
        for i in 0..=count {
            let s = t * f64::from(i) / f64::from(count);
            let weight = if i == 0 || i == count {
                1.0
            } else {
                f64::from(2 + 2 * (i % 2))
            };
            integral += weight * ((s - t) / tau).exp() / (1.0 + rate * s).powi(2);
        }
        let first = (-t / tau).exp() + integral * t / f64::from(3 * count) / tau;
        let known = Test::PureShear.shear(stretch) + first * stretch - third / stretch.powi(3);
        assert!((found / known - 1.0).abs() < 1e-12, "{t}: {found}, not {known}");
    }
}

/// The elastic stretch l of a finite branch falls by dl/dt = −(l³ − 1)/(3τ), so that t is an integral over l.
#[test]
fn relaxation_of_the_finite_law_is_exact() {
    let time = |from: f64, to: f64| {
        // By partial fractions, −3∫dl/(l³ − 1).
        let part = |l: f64| {
            let angle = ((2.0 * l + 1.0) / 3.0_f64.sqrt()).atan();
            -(l - 1.0).ln() + 0.5 * (l * l + l + 1.0).ln() + 3.0_f64.sqrt() * angle
        };
        part(to) - part(from)
    };
    let (stretch, tau) = (4.0, 2.5);
    for elastic in [3.9, 3.0, 2.0, 1.3, 1.01] {
        let t = tau * time(stretch, elastic);
        let step = [(0.0, 1.0), (0.0, stretch)];
        let elastomer = elastomer(LawKind::NeoHookean, ViscousLaw::Finite, 1);
        let found = stresses(&curve(elastomer, Test::Uniaxial, &step, &[t]), &[1.0, 1.0, tau])[0];
        let known = Test::Uniaxial.shear(stretch) + (elastic * elastic - 1.0 / elastic) / stretch;
        assert!((found / known - 1.0).abs() < 1e-11, "{elastic}: {found}, not {known}");
    }
}

/// A ramp that becomes shorter tends to the sudden step, in proportion to its time.
#[test]
fn a_step_is_the_limit_of_ramps() {
    for law in [ViscousLaw::Linear, ViscousLaw::Finite] {
        let at = |history: &[(f64, f64)]| {
            let elastomer = elastomer(LawKind::Gent, law, 1);
            stresses(
                &curve(elastomer, Test::Equibiaxial, history, &[1.0]),
                &[20e3, 60.0, 40e3, 0.8],
            )[0]
        };
        let step = at(&[(0.0, 1.0), (0.0, 2.0)]);
        let [one, two] = [1e-3, 5e-4].map(|time| at(&[(0.0, 1.0), (time, 2.0)]) - step);
        assert!(
            (one / two - 2.0).abs() < 0.01 && (one / step).abs() < 1e-2,
            "{law:?}: {one} {two}"
        );
    }
}

/// Ramps with noise of 1 %: the number of branches, their values and the law at equilibrium are found from no start
/// given.
#[test]
fn branches_are_found_along_ramps() {
    let history = [(0.0, 1.0), (1.0, 2.0), (30.0, 2.0), (31.0, 3.0)];
    let time_s: Vec<f64> = (1..20)
        .map(|i| 0.05 * 1.4_f64.powi(i))
        .chain((0..10).map(|i| 31.0 + f64::from(i * i)))
        .collect();
    let all = [15e3, 40.0, 30e3, 0.8, 20e3, 12.0];
    let options = Options {
        profiles: Profiles::Never,
        bounds: vec![("jm".to_owned(), 5.0, 1e3)],
        ..Options::default()
    };
    // The finite law takes longer.
    for (law, branches, most) in [(ViscousLaw::Linear, 2, 3), (ViscousLaw::Finite, 1, 1)] {
        let truth = &all[..2 + 2 * branches];
        let elastomer = elastomer(LawKind::Gent, law, branches);
        let mut curve = curve(elastomer, Test::Uniaxial, &history, &time_s);
        let exact = stresses(&curve, truth);
        let measured = exact.iter().enumerate();
        curve.stress_pa = measured
            .map(|(i, stress)| stress * (1.0 + 0.01 * deviate(i + 1)))
            .collect();
        curve.sigma = Sigma::Stated(exact.iter().map(|stress| 0.01 * stress).collect());
        let fits = fit_histories(std::slice::from_ref(&curve), most, &options).unwrap();
        // One branch more may seem to gain a little; fewer do not do.
        let best = fits[0].estimate.information.aicc;
        let above = |count: usize| {
            let fit = fits.iter().find(|fit| fit.branches() == count).unwrap();
            (fit, fit.estimate.information.aicc - best)
        };
        let (fit, excess) = above(branches);
        let fewer = (0..branches).all(|fewer| above(fewer).1 > 100.0);
        assert!(excess < 4.0 && fewer, "{law:?}");
        let (names, values): (Vec<_>, Vec<_>) = fit
            .estimate
            .parameters
            .iter()
            .map(|p| (p.name.clone(), p.value))
            .unzip();
        assert_eq!(names, curve.elastomer.parameters());
        for (value, truth) in values.iter().zip(truth) {
            assert!((value / truth - 1.0).abs() < 0.25, "{law:?}: {values:?}");
        }
        let again = fit.stresses(curve.test, &history, &time_s).unwrap();
        let known = fit.residuals[0].residuals.iter();
        for (i, residual) in known.enumerate() {
            let found = (again[i] - curve.stress_pa[i]) / (0.01 * exact[i]);
            assert!((found - residual).abs() < 1e-8, "{found}, not {residual}");
        }
    }
}

/// Both ways to state a sudden step give one fit.
#[test]
fn steps_are_fitted_alike_by_both_functions() {
    let time_s: Vec<f64> = (0..12).map(|i| 0.1 * 2_f64.powi(i)).collect();
    let stress_pa: Vec<f64> = time_s
        .iter()
        .enumerate()
        .map(|(i, t)| 1e4 * (1.0 + (-t / 3.0).exp()) * (1.0 + 0.01 * deviate(i + 1)))
        .collect();
    let sigma = Sigma::UnstatedRelative;
    let mut history = curve(
        Elastomer::elastic(LawKind::NeoHookean),
        Test::Uniaxial,
        &[(0.0, 1.0), (0.0, 2.0)],
        &time_s,
    );
    (history.stress_pa, history.sigma) = (stress_pa.clone(), sigma.clone());
    let relaxation = Relaxation {
        name: history.name.clone(),
        test: Test::Uniaxial,
        stretch: 2.0,
        time_s,
        stress_pa,
        sigma,
    };
    let one = fit_histories(&[history], 1, &Options::default()).unwrap();
    let other = fit_relaxation(&[relaxation], 1, &Options::default()).unwrap();
    assert_eq!(one[0].estimate.sum_of_squares, other[0].estimate.sum_of_squares);
    assert_eq!(one[0].estimate.parameters[1].name, "branch_modulus_1");
    assert_eq!(other[0].estimate.parameters[1].name, "g_1");
    let stress = one[0].stress(Test::Uniaxial, 2.0, 1.0);
    let values: Vec<f64> = one[0].estimate.parameters.iter().map(|p| p.value).collect();
    let known = (values[0] + values[1] * (-1.0 / values[2]).exp()) * Test::Uniaxial.shear(2.0);
    assert!((stress / known - 1.0).abs() < 1e-14);
}

#[test]
fn histories_that_are_not_valid_are_refused() {
    let changed = |change: fn(&mut HistoryCurve)| {
        let elastic = Elastomer::elastic(LawKind::NeoHookean);
        let mut curve = curve(elastic, Test::Uniaxial, &[(0.0, 1.0), (1.0, 2.0)], &[0.5, 1.0, 2.0]);
        curve.stress_pa = vec![1e3, 2e3, 2e3];
        change(&mut curve);
        fit_histories(&[curve], 0, &Options::default()).unwrap_err().to_string()
    };
    let found = [
        changed(|curve| curve.history.clear()),
        changed(|curve| curve.history[1].0 = -1.0),
        changed(|curve| curve.history[1].1 = 0.0),
        changed(|curve| curve.time_s[0] = -0.5),
        changed(|curve| curve.time_s.truncate(1)),
        changed(|curve| curve.history[1].1 = 1.0),
        changed(|curve| curve.elastomer.law = LawKind::Ogden(0)),
    ];
    let expected = [
        "all stretches are 1: the curves say nothing about a law",
        "`history`, row 2 of the history: the times must not fall, and all numbers must be finite",
        "curve `history`, row 2: the stretch 0 is not positive",
        "`history`, row 1: the time is before the first one of the history",
        "curve `history` has 3 stresses, but 1 times",
        "all stretches are 1: the curves say nothing about a law",
        "the law `ogden` has no terms",
    ];
    assert_eq!(found, expected);
    let elastic = Elastomer::elastic(LawKind::NeoHookean);
    let one = curve(elastic, Test::Uniaxial, &[(0.0, 1.0), (1.0, 2.0)], &[0.5, 1.0]);
    let mut other = one.clone();
    other.elastomer.viscous = ViscousLaw::Finite;
    let error = fit_histories(&[one, other], 0, &Options::default()).unwrap_err();
    assert!(matches!(error, FitError::MixedElastomers { .. }), "{error}");
}
