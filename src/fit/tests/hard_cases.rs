//! Curves that do not determine a law, and curves that cannot be fitted.

use crate::{
    Curve, Fit, FitError, Law, LawKind, OgdenTerm, Options, Relaxation, Sigma, Test, Verdict, compare, fit,
    fit_relaxation,
};

const NEO_HOOKEAN: Law = Law::NeoHookean { shear_modulus: 20e3 };

/// Returns the stresses of a law without noise.
fn exact(law: &Law, test: Test, stretch: &[f64], sigma: Sigma) -> Curve {
    Curve {
        name: format!("{}.csv", test.name()),
        test,
        stretch: stretch.to_vec(),
        stress_pa: stretch.iter().map(|l| law.nominal_stress(test, *l).unwrap()).collect(),
        sigma,
    }
}

fn uniaxial(stretch: &[f64]) -> Curve {
    exact(&NEO_HOOKEAN, Test::Uniaxial, stretch, Sigma::StatedFraction(0.02))
}

fn fitted(curve: Curve, kind: LawKind) -> Result<Fit, FitError> {
    fit(&[curve], kind, &Options::default())
}

fn refused(curve: Curve) -> FitError {
    fitted(curve, LawKind::NeoHookean).unwrap_err()
}

#[test]
fn two_points_do_not_determine_three_parameters() {
    let error = fitted(uniaxial(&[1.0, 1.5, 2.0]), LawKind::Yeoh).unwrap_err();
    assert_eq!(
        error.to_string(),
        "2 points cannot determine 3 parameters of the law `yeoh`"
    );
}

#[test]
fn as_many_points_as_parameters_leave_no_error_to_estimate() {
    let law = Law::Yeoh {
        shear_modulus: 20e3,
        c2: -300.0,
        c3: 20.0,
    };
    let stretch = [1.3, 2.0, 3.0];
    for (sigma, known) in [(Sigma::StatedFraction(0.01), true), (Sigma::UnstatedRelative, false)] {
        let fit = fitted(exact(&law, Test::Uniaxial, &stretch, sigma), LawKind::Yeoh).unwrap();
        assert_eq!(
            (fit.estimate.degrees_of_freedom, fit.estimate.information.aicc),
            (0, f64::INFINITY)
        );
        for (parameter, value) in fit.estimate.parameters.iter().zip([20e3, -300.0, 20.0]) {
            assert!((parameter.value / value - 1.0).abs() < 1e-9, "{parameter:?}");
            assert_eq!(parameter.standard_error.is_some(), known);
        }
    }
}

/// Five times the same point determine one combination of two parameters.
#[test]
fn equal_points_determine_one_parameter() {
    let one = fitted(uniaxial(&[2.0; 5]), LawKind::NeoHookean).unwrap();
    assert!((one.estimate.parameters[0].value / 20e3 - 1.0).abs() < 1e-12);
    assert!((one.estimate.parameters[0].standard_error.unwrap() - 0.02 / f64::sqrt(5.0)).abs() < 1e-10);
    let two = fitted(uniaxial(&[2.0; 5]), LawKind::MooneyRivlin).unwrap();
    assert!(
        two.estimate
            .parameters
            .iter()
            .all(|parameter| parameter.standard_error.is_none())
    );
    assert_eq!(
        two.estimate
            .directions
            .iter()
            .filter(|direction| direction.determined)
            .count(),
        1
    );
}

#[test]
fn an_outlier_is_listed_by_its_row() {
    let stretch: Vec<f64> = (0..20).map(|i| 1.0 + 0.1 * f64::from(i)).collect();
    let mut curve = uniaxial(&stretch);
    let sigma: Vec<f64> = curve.stress_pa.iter().map(|stress| 0.02 * stress + 1.0).collect();
    curve.stress_pa[7] += 10.0 * sigma[7];
    curve.sigma = Sigma::Stated(sigma);
    let fit = fitted(curve, LawKind::NeoHookean).unwrap();
    assert_eq!(fit.estimate.points, 19);
    assert_eq!(fit.residuals[0].residuals.len(), 20);
    assert_eq!(fit.outliers.len(), 1, "{:?}", fit.outliers);
    assert_eq!(
        (fit.outliers[0].curve.as_str(), fit.outliers[0].row),
        ("uniaxial.csv", 8)
    );
    assert!((-10.0..-9.0).contains(&fit.outliers[0].deviations));
}

#[test]
fn compression_determines_a_law_too() {
    let law = Law::Gent {
        shear_modulus: 20e3,
        jm: 30.0,
    };
    let curves = [
        exact(
            &law,
            Test::Uniaxial,
            &[0.3, 0.5, 0.7, 0.9, 1.5, 3.0],
            Sigma::UnstatedRelative,
        ),
        exact(&law, Test::PureShear, &[0.4, 0.6, 0.8], Sigma::UnstatedRelative),
    ];
    let fit = fit(&curves, LawKind::Gent, &Options::default()).unwrap();
    assert!(
        (fit.estimate.parameters[0].value / 20e3 - 1.0).abs() < 1e-9,
        "{:?}",
        fit.estimate.parameters
    );
    assert!(
        (fit.estimate.parameters[1].value / 30.0 - 1.0).abs() < 1e-9,
        "{:?}",
        fit.estimate.parameters
    );
    assert!(fit.stability.is_stable() && fit.stability.falling.is_empty());
}

#[test]
fn a_parameter_at_a_bound_has_no_interval() {
    let law = Law::Gent {
        shear_modulus: 20e3,
        jm: 30.0,
    };
    let curve = exact(
        &law,
        Test::Uniaxial,
        &[1.2, 1.6, 2.0, 3.0, 4.0],
        Sigma::StatedFraction(0.02),
    );
    let options = Options {
        bounds: vec![("jm".to_owned(), 40.0, 100.0)],
        ..Options::default()
    };
    let fit = fit(&[curve], LawKind::Gent, &options).unwrap();
    let jm = &fit.estimate.parameters[1];
    assert_eq!(
        (jm.value, jm.at_bound, jm.standard_error, jm.profile),
        (40.0, true, None, None)
    );
    assert!(fit.estimate.parameters[0].standard_error.is_some());
}

/// A law that stiffens, fitted to an elastomer that softens: its limit runs away.
#[test]
fn a_parameter_without_influence_reduces_the_law() {
    let softens = Law::Ogden(vec![OgdenTerm {
        shear_modulus: 20e3,
        alpha: 1.5,
    }]);
    let curve = exact(
        &softens,
        Test::Uniaxial,
        &[1.2, 1.6, 2.0, 2.5, 3.0],
        Sigma::StatedFraction(0.02),
    );
    for kind in [LawKind::Gent, LawKind::ArrudaBoyce] {
        let fit = fitted(curve.clone(), kind).unwrap();
        assert_eq!(fit.verdict.to_string(), "reduces to neo-hookean", "{fit:?}");
    }
    let two = fitted(curve, LawKind::Ogden(2)).unwrap();
    assert_eq!(two.verdict.to_string(), "reduces to ogden with terms: 1", "{two:?}");
}

/// Between the points of a cubic polynomial that falls and rises the law is unstable.
#[test]
fn an_unstable_law_is_named() {
    let law = Law::Yeoh {
        shear_modulus: 50e3,
        c2: -1800.0,
        c3: 60.0,
    };
    let curves = Test::ALL.map(|test| exact(&law, test, &[1.2, 1.5, 2.0, 3.0, 4.0], Sigma::StatedFraction(0.02)));
    let fit = fit(&curves, LawKind::Yeoh, &Options::default()).unwrap();
    assert!(matches!(fit.verdict, Verdict::Unstable(..)), "{}", fit.verdict);
    assert_eq!(fit.stability.falling.len(), 3, "{:?}", fit.stability);
}

#[test]
fn a_comparison_keeps_laws_that_cannot_be_fitted_last() {
    let curves = [
        uniaxial(&[1.5, 2.0]),
        exact(&NEO_HOOKEAN, Test::PureShear, &[1.5], Sigma::StatedFraction(0.02)),
    ];
    let kinds = [LawKind::Ogden(3), LawKind::NeoHookean];
    let candidates = compare(&curves, &kinds, &Options::default()).unwrap();
    assert_eq!(candidates[0].kind, LawKind::NeoHookean);
    assert!(candidates[0].left_out.iter().all(|(_, error)| error.unwrap() < 1e-9));
    assert!(candidates[1].fit.is_err() && candidates[1].left_out.iter().all(|(_, error)| error.is_none()));
}

#[test]
fn curves_that_are_not_valid_are_refused_by_name_and_row() {
    let changed = |change: fn(&mut Curve)| {
        let mut curve = uniaxial(&[1.2, 1.5, 2.0]);
        change(&mut curve);
        refused(curve).to_string()
    };
    let messages = [
        changed(|curve| curve.stress_pa[1] = f64::NAN),
        changed(|curve| curve.stretch[2] = -0.5),
        changed(|curve| curve.stretch[2] = f64::INFINITY),
        changed(|curve| curve.stress_pa.truncate(2)),
        changed(|curve| curve.sigma = Sigma::Stated(vec![1.0])),
        changed(|curve| curve.sigma = Sigma::Stated(vec![1.0, 0.0, 1.0])),
        changed(|curve| curve.stress_pa[0] = 0.0),
        changed(|curve| curve.stretch = vec![1.0; 3]),
        changed(|curve| curve.stress_pa.iter_mut().for_each(|stress| *stress *= -1.0)),
    ];
    let expected = [
        "curve `uniaxial.csv`, row 2: the stress is not a finite number",
        "curve `uniaxial.csv`, row 3: the stretch -0.5 is not positive",
        "curve `uniaxial.csv`, row 3: the stretch is not a finite number",
        "curve `uniaxial.csv` has 3 stretches, but 2 stresses",
        "curve `uniaxial.csv` has 3 stretches, but 1 standard deviations",
        "curve `uniaxial.csv`, row 2: the standard deviation 0 Pa is not positive",
        "curve `uniaxial.csv`, row 1: a stress of zero has no relative error; state its standard deviation in Pa",
        "all stretches are 1: the curves say nothing about a law",
        "the stresses have the wrong sign: they must be positive where the stretch is above 1",
    ];
    assert_eq!(messages, expected);
}

#[test]
fn settings_that_are_not_valid_are_refused() {
    let with = |bounds: (&str, f64, f64), kind| {
        let (name, lower, upper) = bounds;
        let bounds = vec![(name.to_owned(), lower, upper)];
        fit(
            &[uniaxial(&[1.2, 1.5, 2.0])],
            kind,
            &Options {
                bounds,
                ..Options::default()
            },
        )
        .unwrap_err()
    };
    assert!(matches!(
        with(("jm", 1.0, 2.0), LawKind::Yeoh),
        FitError::UnknownParameter { .. }
    ));
    assert!(matches!(
        with(("jm", -1.0, 2.0), LawKind::Gent),
        FitError::Bounds { .. }
    ));
    assert!(matches!(
        with(("jm", 0.01, 0.02), LawKind::Gent),
        FitError::NoStart { .. }
    ));
    assert!(matches!(
        fitted(uniaxial(&[2.0]), LawKind::Ogden(0)),
        Err(FitError::NoTerms { .. })
    ));
    assert!(matches!(
        fit(&[], LawKind::NeoHookean, &Options::default()),
        Err(FitError::NotStretched)
    ));
    let mixed = [
        uniaxial(&[2.0]),
        exact(&NEO_HOOKEAN, Test::PureShear, &[2.0], Sigma::UnstatedRelative),
    ];
    let mixed = fit(&mixed, LawKind::NeoHookean, &Options::default());
    assert!(matches!(mixed, Err(FitError::MixedSigma { .. })));
}

/// Up to a stretch of 1.01 no limit below some ten thousand shows, whatever the fit says.
#[test]
fn small_stretches_do_not_determine_a_limit() {
    let stretch: Vec<f64> = (1..=10).map(|i| 1.0 + 1e-3 * f64::from(i)).collect();
    let mut curve = uniaxial(&stretch);
    for (i, stress) in curve.stress_pa.iter_mut().enumerate() {
        *stress *= 1.0 + 1e-3 * (i as f64 - 4.0);
    }
    let fit = fitted(curve, LawKind::Gent).unwrap();
    let jm = &fit.estimate.parameters[1];
    assert!(jm.profile.unwrap().1.is_infinite(), "{jm:?}");
    assert_eq!(
        fit.verdict.to_string(),
        "the data do not determine jm",
        "{:?}",
        fit.estimate.directions
    );
}

/// One branch of 2 `unit`, at eight times from 0 on.
fn relaxation(unit: f64) -> Relaxation {
    let time: Vec<f64> = (0..8).map(f64::from).collect();
    Relaxation {
        name: "step.csv".to_owned(),
        test: Test::PureShear,
        stretch: 2.0,
        stress_pa: time.iter().map(|t| 1e3 * (1.0 + (-t / 2.0).exp())).collect(),
        time_s: time.iter().map(|t| t * unit).collect(),
        sigma: Sigma::UnstatedRelative,
    }
}

#[test]
fn relaxation_in_pure_shear_is_found_again() {
    for unit in [1e-4, 1.0, 1e5] {
        let fits = fit_relaxation(&[relaxation(unit)], 1, &Options::default()).unwrap();
        assert_eq!(fits[0].branches(), 1);
        let known = [1e3 / 1.875, 1e3 / 1.875, 2.0 * unit];
        for (parameter, value) in fits[0].estimate.parameters.iter().zip(known) {
            assert!((parameter.value / value - 1.0).abs() < 1e-9, "{parameter:?}");
        }
    }
    // Eight points are enough for up to three branches.
    assert_eq!(
        fit_relaxation(&[relaxation(1.0)], 9, &Options::default())
            .unwrap()
            .len(),
        4
    );
}

#[test]
fn relaxation_that_is_not_valid_is_refused() {
    let changed = |change: fn(&mut Relaxation)| {
        let mut curve = relaxation(1.0);
        change(&mut curve);
        fit_relaxation(&[curve], 1, &Options::default())
            .unwrap_err()
            .to_string()
    };
    let messages = [
        changed(|curve| curve.time_s[2] = -1.0),
        changed(|curve| curve.time_s.truncate(3)),
        changed(|curve| curve.stretch = 1.0),
        changed(|curve| curve.stress_pa[0] = f64::NAN),
    ];
    let expected = [
        "curve `step.csv`, row 3: the time is not a number from 0 on",
        "curve `step.csv` has 8 stresses, but 3 times",
        "all stretches are 1: the curves say nothing about a law",
        "curve `step.csv`, row 1: the stress is not a finite number",
    ];
    assert_eq!(messages, expected);
}
