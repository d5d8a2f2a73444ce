//! Fields of displacements at scattered points with a simple model, for which all is known.

use super::noise::Normal;
use crate::{
    Correlation, DataSet, FieldData, FieldImage, FitError, FreeParameter, JointOptions, Motion, NumberData, Sigma,
    Simulated, Simulation, Verdict, Warning, fit_together,
};
use std::cell::Cell;

/// The side of the membrane in mm.
const SIDE: f64 = 50.0;

/// A displacement that depends on κ = (V + V₀)²/μ alone, as that of a membrane, with its derivative with respect to κ.
pub fn displacement([x, y]: [f64; 2], kappa: f64) -> ([f64; 2], [f64; 2]) {
    let [s, t] = [x, y].map(|x| std::f64::consts::PI * x / SIDE);
    let shape = [
        (2.0 * s).sin() * t.sin(),
        0.6 * s.sin() * (2.0 * t).sin() + 0.2 * t.cos(),
    ];
    let (size, slope) = (kappa + 0.4 * kappa * kappa, 1.0 + 0.8 * kappa);
    (shape.map(|u| size * u), shape.map(|u| slope * u))
}

/// κ of voltages in kV and a modulus in Pa, and its derivatives with respect to ln μ and V₀ in V.
pub fn kappa(volts: f64, modulus: f64, offset: f64) -> (f64, [f64; 2]) {
    let value = ((volts + offset) / 1e3).powi(2) / (modulus / 1e3);
    (value, [-value / modulus, 2.0 * value / (volts + offset)])
}

/// Simulates images at voltages; no state beyond κ = 1.
pub fn simulate(images: &[(Vec<[f64; 2]>, f64)], values: &[f64]) -> Option<Simulated> {
    let mut simulated = Simulated {
        values: Vec::new(),
        by_parameter: vec![Vec::new(); 2],
    };
    for (points, volts) in images {
        let (kappa, by) = kappa(*volts, values[0], values[1]);
        if kappa > 1.0 {
            return None;
        }
        for point in points {
            let (u, slope) = displacement(*point, kappa);
            simulated.values.extend(u);
            for (column, by) in simulated.by_parameter.iter_mut().zip(by) {
                column.extend(slope.map(|slope| slope * by));
            }
        }
    }
    Some(simulated)
}

/// Turns a displaced point about the origin and moves it.
pub fn moved(point: [f64; 2], u: [f64; 2], rotation: f64, by: [f64; 2]) -> [f64; 2] {
    let [x, y] = [point[0] + u[0], point[1] + u[1]];
    let (sine, cosine) = rotation.sin_cos();
    [
        cosine * x - sine * y + by[0] - point[0],
        sine * x + cosine * y + by[1] - point[1],
    ]
}

pub fn raster(count: usize) -> Vec<[f64; 2]> {
    let at = |i: usize| SIDE * (i as f64 + 0.5) / count as f64;
    (0..count * count).map(|i| [at(i % count), at(i / count)]).collect()
}

pub fn parameters() -> [FreeParameter; 2] {
    [
        FreeParameter::positive("shear_modulus", 60e3, 1e3, 1e6),
        FreeParameter::signed("voltage_offset", 0.0, -500.0, 500.0, 1e3),
    ]
}

pub const MODULUS: f64 = 41.3e3;
pub const OFFSET: f64 = -120.0;
const MOTIONS: [(f64, [f64; 2]); 3] = [(0.01, [0.3, -0.2]), (-0.02, [-0.1, 0.4]), (0.005, [1.0, 0.6])];

/// Three images at voltages, with motions and normal noise of 5 µm.
fn images(voltages: &[f64], noise: f64, seed: u64) -> Vec<FieldImage> {
    let mut normal = Normal::new(seed);
    let image = |(i, volts): (usize, &f64)| {
        let points = raster(20);
        let (rotation, by) = MOTIONS[i];
        let kappa = kappa(*volts, MODULUS, OFFSET).0;
        let measured: Vec<[f64; 2]> = points
            .iter()
            .map(|point| {
                let u = moved(*point, displacement(*point, kappa).0, rotation, by);
                u.map(|u| u + noise * normal.next())
            })
            .collect();
        FieldImage::new(
            format!("{volts} V"),
            &points,
            &measured,
            Some(&vec![5e-3; points.len()]),
        )
        .unwrap()
    };
    voltages.iter().enumerate().map(image).collect()
}

/// Fits images, and returns also how many times the model was evaluated.
fn fitted(images: Vec<FieldImage>, voltages: &[f64], motion: Motion) -> Result<crate::JointFit, FitError> {
    let all: Vec<_> = images
        .iter()
        .map(|image| image.points().to_vec())
        .zip(voltages.iter().copied())
        .collect();
    let evaluate = |values: &[f64]| Ok(simulate(&all, values));
    let names = ["shear_modulus", "voltage_offset"].map(String::from).to_vec();
    let data = FieldData {
        name: "dic".to_owned(),
        images,
        motion,
        correlation: Correlation::Independent,
        simulation: Simulation {
            parameters: names,
            evaluate: &evaluate,
        },
    };
    fit_together(&parameters(), &[DataSet::Field(data)], &JointOptions::default())
}

#[test]
fn motions_and_parameters_are_found_again() {
    let voltages = [3e3, 4e3, 5e3];
    let fit = fitted(images(&voltages, 0.0, 1), &voltages, Motion::Fitted).unwrap();
    for (parameter, value) in fit.estimate.parameters.iter().zip([MODULUS, OFFSET]) {
        assert!((parameter.value / value - 1.0).abs() < 1e-9, "{parameter:?}");
    }
    let field = fit.sets[0].field.as_ref().unwrap();
    for (image, (rotation, by)) in field.images.iter().zip(MOTIONS) {
        assert!((image.rotation - rotation).abs() < 1e-10);
        assert!(
            (0..2).all(|c| (image.translation_mm[c] - by[c]).abs() < 1e-9),
            "{image:?}"
        );
    }
    assert!(field.statistics.largest_mm < 1e-9 && field.statistics.r_squared > 1.0 - 1e-15);
    assert!(fit.estimate.iterations < 12, "{}", fit.estimate.iterations);
    assert_eq!(
        (fit.estimate.points, fit.estimate.degrees_of_freedom),
        (2400, 2400 - 2 - 9)
    );
}

/// The covariance is that of all 11 numbers fitted at once: JᵀJ with the columns of the motions.
#[test]
fn standard_errors_are_those_of_a_fit_with_all_motions() {
    let voltages = [3e3, 4e3, 5e3];
    let images = images(&voltages, 5e-3, 2);
    let fit = fitted(images.clone(), &voltages, Motion::Fitted).unwrap();
    let field = fit.sets[0].field.as_ref().unwrap();
    let values: Vec<f64> = fit
        .estimate
        .parameters
        .iter()
        .map(|parameter| parameter.value)
        .collect();
    let (count, sigma) = (11, 5e-3);
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for (i, (image, result)) in images.iter().zip(&field.images).enumerate() {
        let (kappa, by) = kappa(voltages[i], values[0], values[1]);
        let (sine, cosine) = result.rotation.sin_cos();
        for point in image.points() {
            let (u, slope) = displacement(*point, kappa);
            let turned = [cosine * slope[0] - sine * slope[1], sine * slope[0] + cosine * slope[1]];
            let [x, y] = [point[0] + u[0], point[1] + u[1]];
            let turning = [-sine * x - cosine * y, cosine * x - sine * y];
            for c in 0..2 {
                let mut row = vec![0.0; count];
                row[0] = turned[c] * by[0] * values[0] / sigma;
                row[1] = turned[c] * by[1] / sigma;
                row[2 + 3 * i] = turning[c] / sigma;
                row[3 + 3 * i + c] = 1.0 / sigma;
                rows.push(row);
            }
        }
    }
    let gram = deaflow_linalg::Mat::from_fn(count, count, |i, j| rows.iter().map(|row| row[i] * row[j]).sum::<f64>());
    let covariance = deaflow_linalg::inverse(&gram);
    for (i, parameter) in fit.estimate.parameters.iter().enumerate() {
        let known = covariance[(i, i)].sqrt();
        assert!(
            (parameter.standard_error.unwrap() / known - 1.0).abs() < 1e-4,
            "{known} {parameter:?}"
        );
    }
    assert_eq!(fit.independent_errors[0], fit.estimate.parameters[0].standard_error);
    let chi2 = field.statistics.chi2_per_dof.unwrap();
    assert!((0.9..1.1).contains(&chi2), "{chi2}");
    assert!((field.statistics.chi2.unwrap() / fit.estimate.sum_of_squares - 1.0).abs() < 1e-12);
    assert_eq!(fit.verdict, Verdict::Determined);
}

/// A motion that is ignored goes into the parameters, and shows in χ².
#[test]
fn a_motion_that_is_ignored_shows() {
    let voltages = [3e3, 4e3, 5e3];
    let fit = fitted(images(&voltages, 5e-3, 3), &voltages, Motion::None).unwrap();
    assert!((fit.estimate.parameters[0].value / MODULUS - 1.0).abs() > 0.01);
    let field = fit.sets[0].field.as_ref().unwrap();
    assert!(field.statistics.chi2_per_dof.unwrap() > 100.0);
}

/// One voltage determines κ alone: one combination of the modulus and the offset.
#[test]
fn one_voltage_determines_one_combination() {
    let fit = fitted(images(&[4e3], 5e-3, 4), &[4e3], Motion::Fitted).unwrap();
    let Verdict::NotDetermined(names) = &fit.verdict else {
        panic!("{}", fit.verdict);
    };
    assert_eq!(names.len(), 1, "{names:?}");
    assert!(
        fit.estimate
            .parameters
            .iter()
            .all(|parameter| parameter.standard_error.is_none())
    );
    assert!(fit.estimate.directions[0].standard_error.is_infinite());
}

#[test]
fn statistics_follow_their_definitions() {
    let points = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [f64::NAN, 1.0], [1.0, 1.0]];
    let measured = [[0.1, 0.0], [0.2, 0.0], [0.0, 0.3], [0.0, 0.0], [0.0, f64::NAN]];
    let image = FieldImage::new("a", &points, &measured, Some(&[0.1, 0.2, 0.1, 0.1, 0.1])).unwrap();
    assert_eq!((image.dropped(), image.rows()), (2, &[1, 2, 3][..]));
    let result = image
        .compare(&[[0.0, 0.0], [0.2, 0.1], [0.0, 0.1]], Motion::None, 1)
        .unwrap();
    let s = &result.statistics;
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a}, not {b}");
    near(s.mean_mm[0], 0.1 / 3.0);
    near(s.mean_mm[1], 0.1 / 3.0);
    near(s.rms_mm, f64::sqrt(0.06 / 6.0));
    near(s.largest_mm, 0.2);
    assert_eq!((s.largest_at.0.as_str(), s.largest_at.1), ("a", 3));
    near(s.r_squared, 1.0 - 0.06 / (0.02 + 0.06));
    near(s.chi2.unwrap(), 1.0 + 0.25 + 4.0);
    near(s.chi2_per_dof.unwrap(), 5.25 / 5.0);
    let moved = image
        .compare(&[[0.1, -0.7], [0.2, -0.7], [0.0, -0.4]], Motion::Fitted, 0)
        .unwrap();
    near(moved.rotation, 0.0);
    near(moved.translation_mm[1], 0.7);
}

#[test]
fn dropped_rows_are_counted() {
    let (points, voltages) = (raster(20), [4e3, 5e3]);
    let mut all = images(&voltages, 5e-3, 6);
    let mut measured = all[1].measured().to_vec();
    measured[17] = [f64::NAN; 2];
    all[1] = FieldImage::new("5 kV", &points, &measured, all[1].sigma()).unwrap();
    let fit = fitted(all, &voltages, Motion::Fitted).unwrap();
    let (image, rows) = ("5 kV".to_owned(), 1);
    assert_eq!(fit.warnings, [Warning::Dropped { image, rows }]);
    assert_eq!(fit.warnings[0].to_string(), "5 kV: 1 row with NaN was dropped");
    assert_eq!(fit.sets[0].points, 2 * 799);
}

#[test]
fn one_point_far_away_is_named() {
    let (points, voltages) = (raster(20), [4e3]);
    let original = &images(&voltages, 5e-3, 5)[0];
    let mut measured = original.measured().to_vec();
    measured[136][1] += 10.0 * 5e-3;
    let image = FieldImage::new("4 kV", &points, &measured, original.sigma()).unwrap();
    let fit = fitted(vec![image], &voltages, Motion::Fitted).unwrap();
    assert_eq!(fit.outliers.len(), 1, "{:?}", fit.outliers);
    assert_eq!((fit.outliers[0].curve.as_str(), fit.outliers[0].row), ("4 kV", 137));
}

/// The model of the caller may give no derivatives for what is fixed; its errors end the fit, at once.
#[test]
fn simulations_that_fail_end_the_fit() {
    let calls = Cell::new(0);
    let names = || ["shear_modulus", "voltage_offset"].map(String::from).to_vec();
    let run = |by_offset: Vec<f64>, fails_at: usize, numbers: usize| {
        calls.set(0);
        let evaluate = |values: &[f64]| {
            calls.set(calls.get() + 1);
            if calls.get() == fails_at {
                return Err("out of memory".to_owned());
            }
            let at = |volts: f64| kappa(volts, values[0], values[1]);
            let volts = [2e3, 4e3, 5e3];
            Ok(Some(Simulated {
                values: volts[..numbers].iter().map(|v| at(*v).0).collect(),
                by_parameter: vec![volts.iter().map(|v| at(*v).1[0]).collect(), by_offset.clone()],
            }))
        };
        let data = NumberData {
            name: "tip".to_owned(),
            measured: vec![0.1, 0.4, 0.6],
            sigma: Sigma::Stated(vec![0.01; 3]),
            simulation: Simulation {
                parameters: names(),
                evaluate: &evaluate,
            },
        };
        let options = JointOptions {
            fixed: vec![("voltage_offset".to_owned(), 0.0)],
            ..JointOptions::default()
        };
        let [free, _] = parameters();
        fit_together(&[free], &[DataSet::Numbers(data)], &options)
    };
    let fit = run(Vec::new(), 0, 3).unwrap();
    // κ = V²/μ, by least squares.
    let known = (4.0 * 4.0 + 16.0 * 16.0 + 25.0 * 25.0) / (0.1 * 4.0 + 0.4 * 16.0 + 0.6 * 25.0);
    assert!((fit.estimate.parameters[0].value / 1e3 / known - 1.0).abs() < 1e-9);
    let failed = run(Vec::new(), 3, 3).unwrap_err();
    assert_eq!(failed.to_string(), "the simulation of `tip` failed: out of memory");
    assert_eq!(calls.get(), 3);
    let short = run(Vec::new(), 0, 2).unwrap_err();
    assert_eq!(short.to_string(), "the simulation of `tip` returned 2 numbers, not 3");
    let column = run(vec![1.0], 0, 3).unwrap_err();
    assert_eq!(
        column.to_string(),
        "the simulation of `tip` returned 1 derivatives, not 3"
    );
}

#[test]
fn images_that_are_not_valid_are_refused() {
    let points = raster(2);
    let u = vec![[0.1, 0.2]; 4];
    let message = |points: &[[f64; 2]], u: &[[f64; 2]], sigma: Option<&[f64]>| {
        FieldImage::new("a", points, u, sigma).unwrap_err().to_string()
    };
    let infinite = vec![[0.1, f64::INFINITY]; 4];
    let found = [
        message(&points, &u[..3], None),
        message(&points, &u, Some(&[1.0; 3])),
        message(&points, &u, Some(&[1.0, 0.0, 1.0, 1.0])),
        message(&points, &infinite, None),
        message(&points, &[[f64::NAN; 2]; 4], None),
        FieldImage::new("a", &points, &u, None)
            .unwrap()
            .compare(&u[..2], Motion::None, 0)
            .unwrap_err()
            .to_string(),
    ];
    let expected = [
        "curve `a` has 4 points, but 3 displacements",
        "curve `a` has 4 points, but 3 standard deviations",
        "`a`, row 2: the standard deviation 0 is not positive",
        "curve `a`, row 1: the point, displacement or standard deviation is not a finite number",
        "`a` has no points",
        "the simulation of `a` returned 2 displacements, not 4",
    ];
    assert_eq!(found, expected);
    let mixed = [
        FieldImage::new("a", &points, &u, None).unwrap(),
        FieldImage::new("b", &points, &u, Some(&[1.0; 4])).unwrap(),
    ];
    let error = fitted(mixed.to_vec(), &[3e3, 4e3], Motion::Fitted).unwrap_err();
    assert!(matches!(error, FitError::MixedImages { .. }), "{error}");
}
