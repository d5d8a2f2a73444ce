//! Warnings about curves that can be fitted, but should be looked at.

use super::noise::deviate;
use crate::{
    Curve, DataSet, Fit, FreeParameter, JointOptions, Law, LawKind, OgdenTerm, Options, Sigma, Test, Warning, fit,
    fit_together,
};

fn curve(law: &Law, test: Test, stretch: &[f64], sigma: &Sigma) -> Curve {
    let noisy = |(i, l): (usize, &f64)| law.nominal_stress(test, *l).unwrap() * (1.0 + 0.01 * deviate(i + 1));
    Curve {
        name: format!("{}.csv", test.name()),
        test,
        stretch: stretch.to_vec(),
        stress_pa: stretch.iter().enumerate().map(noisy).collect(),
        sigma: sigma.clone(),
    }
}

fn fitted(curves: &[Curve], kind: LawKind) -> Fit {
    fit(curves, kind, &Options::default()).unwrap()
}

fn stretches() -> Vec<f64> {
    (1..=15).map(|i| 1.0 + 0.2 * f64::from(i)).collect()
}

fn laws() -> Vec<Law> {
    vec![
        Law::NeoHookean { shear_modulus: 50e3 },
        Law::Gent {
            shear_modulus: 50e3,
            jm: 60.0,
        },
        Law::Ogden(vec![OgdenTerm {
            shear_modulus: 40e3,
            alpha: 1.3,
        }]),
    ]
}

#[test]
fn true_stresses_are_noticed() {
    for law in laws() {
        for sigma in [
            Sigma::StatedFraction(0.01),
            Sigma::UnstatedRelative,
            Sigma::UnstatedAbsolute,
        ] {
            let [one, two] = [Test::Uniaxial, Test::PureShear].map(|test| curve(&law, test, &stretches(), &sigma));
            let mut labelled = one.clone();
            labelled
                .stress_pa
                .iter_mut()
                .zip(&labelled.stretch)
                .for_each(|(stress, l)| *stress *= l);
            for others in [vec![], vec![two.clone()]] {
                let alone = others.is_empty();
                let right = fitted(&[vec![one.clone()], others.clone()].concat(), law.kind());
                assert_eq!(right.warnings, [], "{law:?}");
                // A term of Ogden's law with a larger exponent has almost the true stresses; small ones, which tell
                // them apart, hardly count in absolute residuals.
                if matches!(law, Law::Ogden(_)) && sigma == Sigma::UnstatedAbsolute && alone {
                    continue;
                }
                let wrong = fitted(&[vec![labelled.clone()], others].concat(), law.kind());
                let [Warning::TrueStress { curve, power, gain }] = &wrong.warnings[..] else {
                    panic!(
                        "{law:?} {sigma:?}: {:?} {:?}",
                        wrong.warnings, wrong.estimate.sum_of_squares
                    );
                };
                assert_eq!(curve, "uniaxial.csv");
                assert!((power - 1.0).abs() < 0.05 && *gain > 10.0, "{power} {gain}");
            }
        }
    }
}

/// The same in a joint fit.
#[test]
fn true_stresses_are_noticed_in_joint_fits() {
    let law = Law::Gent {
        shear_modulus: 50e3,
        jm: 60.0,
    };
    let mut curve = curve(&law, Test::Uniaxial, &stretches(), &Sigma::UnstatedRelative);
    let stretch = curve.stretch.clone();
    curve
        .stress_pa
        .iter_mut()
        .zip(stretch)
        .for_each(|(stress, l)| *stress *= l);
    let free = [
        FreeParameter::positive("shear_modulus", 40e3, 1.0, 1e9),
        FreeParameter::positive("jm", 80.0, 1.0, 1e9),
    ];
    let sets = [DataSet::Curve(LawKind::Gent, curve)];
    let fit = fit_together(&free, &sets, &JointOptions::default()).unwrap();
    assert!(
        matches!(fit.warnings[..], [Warning::TrueStress { .. }]),
        "{:?}",
        fit.warnings
    );
}

/// A law that is too simple is no reason to suspect the data.
#[test]
fn a_law_that_is_too_simple_is_no_reason() {
    let gent = Law::Gent {
        shear_modulus: 50e3,
        jm: 30.0,
    };
    let curves = Test::ALL.map(|test| curve(&gent, test, &stretches()[..12], &Sigma::StatedFraction(0.01)));
    for kind in [LawKind::NeoHookean, LawKind::MooneyRivlin] {
        let fit = fitted(&curves, kind);
        assert!(fit.estimate.sum_of_squares > 100.0);
        assert_eq!(fit.warnings, [], "{kind:?}");
    }
}

#[test]
fn compression_and_equal_stretches_are_listed() {
    let law = Law::NeoHookean { shear_modulus: 50e3 };
    let sigma = Sigma::StatedFraction(0.01);
    let pressed = curve(&law, Test::Uniaxial, &[0.7, 1.2, 0.9, 1.5], &sigma);
    let one = curve(&law, Test::PureShear, &[2.0; 4], &sigma);
    let fit = fitted(&[pressed, one], LawKind::NeoHookean);
    let expected = [
        Warning::Compression {
            curve: "uniaxial.csv".to_owned(),
            rows: vec![1, 3],
        },
        Warning::OneStretch {
            curve: "pure shear.csv".to_owned(),
            stretch: 2.0,
            rows: 4,
        },
    ];
    assert_eq!(fit.warnings, expected);
    let messages: Vec<String> = fit.warnings.iter().map(ToString::to_string).collect();
    let expected = [
        "uniaxial.csv: 2 rows are in compression, the first is row 1",
        "pure shear.csv: all 4 rows have the stretch 2, and determine one number",
    ];
    assert_eq!(messages, expected);
}
