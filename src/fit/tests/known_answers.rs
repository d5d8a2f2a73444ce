//! Fits against the answers of an independent program (closed forms and scipy's trust-region method, in Python).

use super::noise::deviate;
use crate::{
    Candidate, Curve, Fit, Law, LawKind, OgdenTerm, Options, Profiles, Relaxation, Sigma, Test, Verdict, compare, fit,
    fit_relaxation,
};

/// The data of Treloar (Trans. Faraday Soc. 40 (1944) 59), digitised by C. Zhao: github
/// Chongran-Zhao/Calibration-Hyperelasticity, data/Treloar_1944/{UT,ET,PS}.txt at commit 27d9953; in Pa.
fn treloar(sigma: &Sigma) -> Vec<Curve> {
    let tables = [
        (Test::Uniaxial, include_str!("treloar/uniaxial.csv")),
        (Test::Equibiaxial, include_str!("treloar/equibiaxial.csv")),
        (Test::PureShear, include_str!("treloar/pure-shear.csv")),
    ];
    let curve = |(test, table): (Test, &str)| {
        let rows = table.lines().skip(1).map(|line| line.split_once(',').unwrap());
        let rows: Vec<(f64, f64)> = rows.map(|(a, b)| (a.parse().unwrap(), b.parse().unwrap())).collect();
        Curve {
            name: test.name().to_owned(),
            test,
            stretch: rows.iter().map(|row| row.0).collect(),
            stress_pa: rows.iter().map(|row| 1e6 * row.1).collect(),
            sigma: sigma.clone(),
        }
    };
    tables.map(curve).to_vec()
}

/// Asserts that a number agrees with a known one to about the last digit in which that is given.
fn assert_near(number: f64, known: f64, relative: f64) {
    assert!((number / known - 1.0).abs() <= relative, "{number}, not {known}");
}

fn candidate(candidates: &[Candidate], kind: LawKind) -> &Candidate {
    candidates.iter().find(|candidate| candidate.kind == kind).unwrap()
}

/// Known answers for a law: parameters, sum of squares, Akaike's criterion and the errors at tests left out; in MPa.
struct Known {
    kind: LawKind,
    values: &'static [f64],
    sum_of_squares: f64,
    aicc: f64,
    left_out: Option<[f64; 3]>,
}

#[test]
fn treloar_with_relative_residuals() {
    let known = [
        Known {
            kind: LawKind::Ogden(3),
            values: &[0.0076756, -2.157651, 0.4022731, 1.243385, 0.0027831, 5.105915],
            sum_of_squares: 0.2894478187,
            aicc: -259.6449,
            left_out: Some([0.076, 0.176, 0.097]),
        },
        Known {
            kind: LawKind::Gent,
            values: &[0.3388053157, 113.2846845],
            sum_of_squares: 1.465316534,
            aicc: -183.6859,
            left_out: Some([0.252, 0.222, 0.181]),
        },
        Known {
            kind: LawKind::NeoHookean,
            values: &[0.3882620656],
            sum_of_squares: 2.643379187,
            aicc: -154.6664,
            left_out: Some([0.283, 0.189, 0.178]),
        },
    ];
    check_treloar(&Sigma::UnstatedRelative, 1.0, &known);
}

#[test]
fn treloar_with_absolute_residuals() {
    let known = [
        Known {
            kind: LawKind::Ogden(3),
            values: &[0.0055368, -2.262099, 0.3481787, 1.891594, 4.457916e-6, 8.447780],
            sum_of_squares: 0.2084900248,
            aicc: -277.0334,
            left_out: None,
        },
        Known {
            kind: LawKind::Gent,
            values: &[0.2744833302, 84.30458735],
            sum_of_squares: 1.002873517,
            aicc: -203.7836,
            left_out: None,
        },
        Known {
            kind: LawKind::NeoHookean,
            values: &[0.527860252],
            sum_of_squares: 21.16828675,
            aicc: -44.4028,
            left_out: None,
        },
    ];
    check_treloar(&Sigma::UnstatedAbsolute, 1e6, &known);
}

/// Fits in Pa are compared with known answers in MPa; `unit` is that of the residuals.
fn check_treloar(sigma: &Sigma, unit: f64, known: &[Known]) {
    let kinds: Vec<LawKind> = known.iter().rev().map(|known| known.kind).collect();
    let candidates = compare(&treloar(sigma), &kinds, &Options::default()).unwrap();
    let order: Vec<LawKind> = candidates.iter().map(|candidate| candidate.kind).collect();
    assert!(order.iter().rev().eq(&kinds), "{order:?}");
    for known in known {
        let found = candidate(&candidates, known.kind);
        let fit = found.fit.as_ref().unwrap();
        assert_eq!(fit.verdict, Verdict::Determined, "{:?}", known.kind);
        for (parameter, value) in fit.estimate.parameters.iter().zip(known.values) {
            let modulus = ["shear_modulus", "g_1", "g_2", "g_3"].contains(&parameter.name.as_str());
            let digits = if matches!(known.kind, LawKind::Ogden(_)) {
                2e-5
            } else {
                1e-9
            };
            assert_near(parameter.value, if modulus { 1e6 * value } else { *value }, digits);
        }
        assert_near(fit.estimate.sum_of_squares, unit * unit * known.sum_of_squares, 5e-10);
        let aicc = fit.estimate.information.aicc - 2.0 * fit.estimate.points as f64 * unit.ln();
        assert!((aicc - known.aicc).abs() < 1e-4, "{aicc}, not {}", known.aicc);
        for ((_, error), known) in found.left_out.iter().zip(known.left_out.into_iter().flatten()) {
            assert!(
                (error.unwrap() - known).abs() <= 5.1e-4,
                "{:?}, not {known}",
                found.left_out
            );
        }
    }
}

/// Ogden's own fit (Proc. R. Soc. A 326 (1972) 565) to the same tests: μ = 6.3, 0.012 and −0.1 kg/cm², α = 1.3, 5, −2.
#[test]
fn the_terms_of_ogden_are_near_the_best_ones() {
    let terms = [(6.3, 1.3), (0.012, 5.0), (-0.1, -2.0)].map(|(mu, alpha)| OgdenTerm {
        shear_modulus: 0.5 * 98066.5 * mu * alpha,
        alpha,
    });
    let law = Law::Ogden(terms.to_vec());
    let sum = |curves: Vec<Curve>, relative: bool| -> f64 {
        let of_curve = |curve: &Curve| -> f64 {
            let points = curve.stretch.iter().zip(&curve.stress_pa);
            let residual = |(stretch, data): (&f64, &f64)| {
                let difference = law.nominal_stress(curve.test, *stretch).unwrap() - data;
                (difference / if relative { *data } else { 1e6 }).powi(2)
            };
            points.map(residual).sum()
        };
        curves.iter().map(of_curve).sum()
    };
    assert_near(sum(treloar(&Sigma::UnstatedRelative), true), 0.35996, 1e-4);
    assert_near(sum(treloar(&Sigma::UnstatedAbsolute), false), 2.98896, 1e-4);
}

/// Returns the stresses of a law with noise of 2 %; the deviates run through all curves.
fn noisy(law: &Law, tests: &[(Test, Vec<f64>)]) -> Vec<Curve> {
    let mut index = 0;
    let curve = |(test, stretch): &(Test, Vec<f64>)| {
        let truth: Vec<f64> = stretch.iter().map(|l| law.nominal_stress(*test, *l).unwrap()).collect();
        let measured = truth.iter().map(|stress| {
            index += 1;
            stress * (1.0 + 0.02 * deviate(index))
        });
        Curve {
            name: test.name().to_owned(),
            test: *test,
            stretch: stretch.clone(),
            stress_pa: measured.collect(),
            sigma: Sigma::Stated(truth.iter().map(|stress| 0.02 * stress.abs()).collect()),
        }
    };
    tests.iter().map(curve).collect()
}

fn even(count: usize, from: f64, to: f64) -> Vec<f64> {
    (0..count)
        .map(|i| from + (to - from) * i as f64 / (count - 1) as f64)
        .collect()
}

fn gent(jm: f64) -> Law {
    Law::Gent {
        shear_modulus: 50e3,
        jm,
    }
}

fn with_profiles(profiles: Profiles) -> Options {
    Options {
        profiles,
        ..Options::default()
    }
}

#[test]
fn two_tests_determine_a_gent_law() {
    let tests = [
        (Test::Uniaxial, even(13, 1.2, 6.0)),
        (Test::Equibiaxial, even(9, 1.1, 4.0)),
    ];
    let curves = noisy(&gent(60.0), &tests);
    let kinds = [LawKind::NeoHookean, LawKind::Yeoh, LawKind::Gent];
    let candidates = compare(&curves, &kinds, &with_profiles(Profiles::All)).unwrap();
    let fits: Vec<&Fit> = candidates
        .iter()
        .map(|candidate| candidate.fit.as_ref().unwrap())
        .collect();
    for (fit, (kind, aicc)) in fits.iter().zip([
        (LawKind::Gent, 30.550647),
        (LawKind::Yeoh, 32.971536),
        (LawKind::NeoHookean, 2437.181),
    ]) {
        assert_eq!(fit.law.kind(), kind);
        assert!(
            (fit.estimate.information.aicc - aicc).abs() < 1e-3_f64.min(1e-6 * aicc),
            "{kind:?}: {:?}",
            fit.estimate.information
        );
    }
    let fit = fits[0];
    assert_near(fit.estimate.parameters[0].value, 50.117487e3, 1e-8);
    assert_near(fit.estimate.parameters[1].value, 60.305284, 1e-8);
    assert_near(fit.estimate.parameters[0].standard_error.unwrap(), 0.00593605, 1e-6);
    assert_near(fit.estimate.parameters[1].standard_error.unwrap(), 0.01247799, 1e-6);
    assert_near(fit.estimate.sum_of_squares, 25.919068, 2e-8);
    let (low, high) = fit.estimate.parameters[1].profile.unwrap();
    assert_near(low, 58.894837, 1e-8);
    assert_near(high, 61.838884, 1e-8);
    assert!(fit.outliers.is_empty() && fit.verdict == Verdict::Determined);
}

/// The largest I₁ − 3 is 4: the limit of 100 can be known from below only.
#[test]
fn small_stretches_leave_the_interval_of_a_gent_law_open() {
    let curves = noisy(&gent(100.0), &[(Test::Uniaxial, even(15, 1.1, 2.5))]);
    let fit = fit(&curves, LawKind::Gent, &with_profiles(Profiles::All)).unwrap();
    assert_near(fit.estimate.parameters[0].value, 50.536798e3, 1e-8);
    assert_near(fit.estimate.parameters[1].value, 248.64126, 2e-8);
    assert_near(fit.estimate.sum_of_squares, 15.719268, 3e-8);
    let [modulus, limit] = [0, 1].map(|i| fit.estimate.parameters[i].profile.unwrap());
    assert_near(modulus.0, 49.723021e3, 1e-8);
    assert_near(modulus.1, 51.303810e3, 1e-8);
    assert_near(limit.0, 85.143052, 1e-8);
    assert_eq!(limit.1, f64::INFINITY);
    assert_eq!(fit.verdict.to_string(), "the data bound jm on one side at most");
}

/// Uniaxial steps to 2 and 3; μ = 15 kPa with branches of 30 kPa and 0.8 s, and of 20 kPa and 12 s.
#[test]
fn relaxation_has_two_branches() {
    let time_s: Vec<f64> = (0..25).map(|i| 0.05 * 2000_f64.powf(f64::from(i) / 24.0)).collect();
    let mut index = 0;
    let curves = [2.0, 3.0].map(|stretch: f64| {
        let relaxed = |t: &f64| {
            let modulus = 15e3 + 30e3 * (-t / 0.8).exp() + 20e3 * (-t / 12.0).exp();
            modulus * (stretch - stretch.powi(-2))
        };
        let truth: Vec<f64> = time_s.iter().map(relaxed).collect();
        let measured = truth.iter().map(|stress| {
            index += 1;
            stress * (1.0 + 0.01 * deviate(index))
        });
        Relaxation {
            name: format!("step to {stretch}"),
            test: Test::Uniaxial,
            stretch,
            time_s: time_s.clone(),
            stress_pa: measured.collect(),
            sigma: Sigma::Stated(truth.iter().map(|stress| 0.01 * stress).collect()),
        }
    });
    let fits = fit_relaxation(&curves, 3, &Options::default()).unwrap();
    let order: Vec<usize> = fits.iter().map(|fit| fit.branches()).collect();
    assert_eq!(order, [2, 3, 1, 0]);
    // With three branches the independent program ended in a local minimum: 67.010828, times of 0.80, 3.86 and 12.9 s.
    for (fit, aicc) in fits.iter().zip([62.957528, 66.264486, 5601.410]) {
        let found = fit.estimate.information.aicc;
        assert!((found - aicc).abs() < 1e-7 * aicc.max(10.0), "{found}, not {aicc}");
    }
    let values = [14.937645e3, 30.494843e3, 0.82823964, 19.46648e3, 12.371668];
    let errors = [0.0042330, 0.0099296, 0.0239331, 0.0128814, 0.0213614];
    for (parameter, (value, error)) in fits[0].estimate.parameters.iter().zip(values.into_iter().zip(errors)) {
        assert_near(parameter.value, value, 5e-8);
        assert_near(parameter.standard_error.unwrap(), error, 1.3e-5);
    }
    assert_near(fits[0].estimate.sum_of_squares, 51.593892, 1e-8);
    assert_eq!(fits[0].residuals[1].residuals.len(), 25);
}
