//! How often intervals of 95 % contain the truth, over synthetic data with normal noise.

use super::fields::{MODULUS, OFFSET, displacement, kappa, moved, parameters, raster, simulate};
use super::noise::Normal;
use crate::data_set::Prepared;
use crate::{
    Correlation, Curve, DataSet, Elastomer, FieldData, FieldImage, FreeParameter, HistoryCurve, JointFit, JointOptions,
    Law, LawKind, Load, Motion, Profiles, SheetCurve, Sigma, Simulation, Test, ViscousLaw, fit_together,
};

/// Data sets of each kind.
const SETS: usize = 40;

fn options() -> JointOptions {
    JointOptions {
        profiles: Profiles::Never,
        ..JointOptions::default()
    }
}

/// Returns how many intervals hold the truth.
fn covered(fit: &JointFit, truth: &[f64]) -> Vec<bool> {
    let parameters = fit.estimate.parameters.iter().zip(truth);
    parameters
        .map(|(parameter, truth)| {
            let (low, high) = parameter.interval.unwrap();
            (low..=high).contains(truth)
        })
        .collect()
}

/// Asserts that each parameter is covered as often as 95 % allows: 34 to 40 of 40, which has the probability 0.997.
fn check(name: &str, fits: &[Vec<bool>]) {
    for i in 0..fits[0].len() {
        let count = fits.iter().filter(|covered| covered[i]).count();
        assert!(count >= 34, "{name}, parameter {i}: {count} of {}", fits.len());
    }
}

fn values(set: &DataSet<'_>, values: &[f64], zero: f64) -> Vec<f64> {
    let prepared = Prepared::new(set, &|_| true).unwrap();
    let rows = prepared.residuals(values).unwrap();
    rows.into_iter().map(|row| zero + row.0).collect()
}

/// A law with a sheet under voltage, which share the modulus and the limit; σ stated for the half of the sets.
#[test]
fn of_a_law_and_a_sheet() {
    let law = LawKind::Gent;
    let truth = [45e3, 80.0, 4.7];
    let stretch: Vec<f64> = (1..=12).map(|i| 1.0 + 0.35 * f64::from(i)).collect();
    let mut sheet = SheetCurve {
        name: "sheet".to_owned(),
        law,
        test: Test::Equibiaxial,
        load: Load::Prestretch(2.0),
        thickness_m: 1e-3,
        voltage_v: (0..10).map(|i| 1e3 * f64::from(i)).collect(),
        stretch: vec![1.0; 10],
        sigma: Sigma::UnstatedAbsolute,
    };
    let exact = values(&DataSet::Sheet(sheet.clone()), &[45e3, 80.0, 4.7, 0.0], 1.0);
    let elastomer = Law::Gent {
        shear_modulus: truth[0],
        jm: truth[1],
    };
    let free = [
        FreeParameter::positive("shear_modulus", 40e3, 1.0, 1e9),
        FreeParameter::positive("jm", 100.0, 1.0, 1e9),
        FreeParameter::positive("relative_permittivity", 4.0, 1.0, 100.0),
    ];
    let mut normal = Normal::new(11);
    let mut all = Vec::new();
    for at in 0..SETS {
        let stresses = stretch
            .iter()
            .map(|l| elastomer.nominal_stress(Test::Uniaxial, *l).unwrap());
        let measured: Vec<f64> = stresses.map(|stress| stress * (1.0 + 0.02 * normal.next())).collect();
        sheet.stretch = exact.iter().map(|l| l * (1.0 + 0.02 * normal.next())).collect();
        let sigma = if at % 2 == 0 {
            Sigma::StatedFraction(0.02)
        } else {
            Sigma::UnstatedRelative
        };
        sheet.sigma = sigma.clone();
        let curve = Curve {
            name: "pull".to_owned(),
            test: Test::Uniaxial,
            stretch: stretch.clone(),
            stress_pa: measured,
            sigma,
        };
        let fit = fit_together(
            &free,
            &[DataSet::Curve(law, curve), DataSet::Sheet(sheet.clone())],
            &options(),
        );
        all.push(covered(&fit.unwrap(), &truth));
    }
    check("law and sheet", &all);
}

/// A ramp and the relaxation after it, with a branch of the finite law.
#[test]
fn of_relaxation_after_a_ramp() {
    let truth = [20e3, 40e3, 3.0];
    let time_s: Vec<f64> = (0..20).map(|i| 0.2 * 200_f64.powf(f64::from(i) / 19.0)).collect();
    let mut curve = HistoryCurve {
        name: "ramp".to_owned(),
        elastomer: Elastomer {
            law: LawKind::NeoHookean,
            branches: 1,
            viscous: ViscousLaw::Finite,
        },
        test: Test::Uniaxial,
        history: vec![(0.0, 1.0), (2.0, 2.0)],
        stress_pa: vec![1.0; time_s.len()],
        time_s,
        sigma: Sigma::UnstatedAbsolute,
    };
    let exact = values(&DataSet::History(curve.clone()), &truth, 1.0);
    curve.sigma = Sigma::Stated(exact.iter().map(|stress| 0.01 * stress).collect());
    let free = [
        FreeParameter::positive("shear_modulus", 25e3, 1.0, 1e9),
        FreeParameter::positive("branch_modulus_1", 30e3, 1.0, 1e9),
        FreeParameter::positive("branch_time_1", 2.0, 1e-3, 1e3),
    ];
    let mut normal = Normal::new(12);
    let fit = |_| {
        let mut curve = curve.clone();
        curve.stress_pa = exact
            .iter()
            .map(|stress| stress * (1.0 + 0.01 * normal.next()))
            .collect();
        let fit = fit_together(&free, &[DataSet::History(curve)], &options()).unwrap();
        covered(&fit, &truth)
    };
    check("relaxation", &(0..SETS).map(fit).collect::<Vec<_>>());
}

/// Normal noise of the correlation exp(−d²/2ℓ²) at the points of a raster: white noise on a finer grid, smoothed by a
/// Gaussian of ℓ/√2 along x and y.
struct Smoothed {
    count: usize,
    weights: Vec<Vec<f64>>,
}

impl Smoothed {
    fn new(count: usize, side: f64, length: f64) -> Self {
        let spacing = 0.5 * length;
        let nodes = (side / spacing) as usize + 16;
        let weights = (0..count).map(|i| {
            let x = side * (i as f64 + 0.5) / count as f64;
            let weights: Vec<f64> = (0..nodes)
                .map(|node| (-((x - spacing * (node as f64 - 8.0)) / length).powi(2)).exp())
                .collect();
            let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
            weights.into_iter().map(|w| w / norm).collect()
        });
        Self {
            count,
            weights: weights.collect(),
        }
    }

    fn draw(&self, normal: &mut Normal) -> Vec<f64> {
        let nodes = self.weights[0].len();
        let white: Vec<Vec<f64>> = (0..nodes)
            .map(|_| (0..nodes).map(|_| normal.next()).collect())
            .collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        // A row for each x of the raster, along y of the grid.
        let along: Vec<Vec<f64>> = self
            .weights
            .iter()
            .map(|weights| white.iter().map(|line| dot(line, weights)).collect())
            .collect();
        let at = |i: usize| dot(&along[i % self.count], &self.weights[i / self.count]);
        (0..self.count * self.count).map(at).collect()
    }
}

/// Overlapping subsets: noise of 5 µm that is correlated over 2.5 mm at points 2.5 mm apart. Intervals for independent
/// noise hold the truth in about 0.57 of all cases.
#[test]
fn of_fields_with_correlated_noise() {
    let (points, voltages, sigma) = (raster(20), [3e3, 4e3, 5e3], 5e-3);
    let smoothed = Smoothed::new(20, 50.0, 2.5);
    let all: Vec<_> = voltages.iter().map(|volts| (points.clone(), *volts)).collect();
    let evaluate = |values: &[f64]| Ok(simulate(&all, values));
    let mut normal = Normal::new(13);
    let (mut naive, mut corrected, mut total, mut lengths) = (0, 0, 0, Vec::new());
    for set in 0..100 {
        let image = |volts: &f64| {
            let kappa = kappa(*volts, MODULUS, OFFSET).0;
            let noise = [smoothed.draw(&mut normal), smoothed.draw(&mut normal)];
            let measured: Vec<[f64; 2]> = points
                .iter()
                .enumerate()
                .map(|(at, point)| {
                    let u = moved(*point, displacement(*point, kappa).0, 0.01, [0.2, 0.1]);
                    [u[0] + sigma * noise[0][at], u[1] + sigma * noise[1][at]]
                })
                .collect();
            let stated = vec![sigma; points.len()];
            // Without a stated standard deviation the residuals tell it.
            FieldImage::new("image", &points, &measured, (set % 2 == 0).then_some(&stated[..])).unwrap()
        };
        let data = FieldData {
            name: "dic".to_owned(),
            images: voltages.iter().map(image).collect(),
            motion: Motion::Fitted,
            correlation: Correlation::default(),
            simulation: Simulation {
                parameters: ["shear_modulus", "voltage_offset"].map(String::from).to_vec(),
                evaluate: &evaluate,
            },
        };
        let fit = fit_together(&parameters(), &[DataSet::Field(data)], &options()).unwrap();
        lengths.push(fit.sets[0].field.as_ref().unwrap().correlation_length_mm.unwrap());
        for (i, truth) in [MODULUS.ln(), OFFSET].into_iter().enumerate() {
            let parameter = &fit.estimate.parameters[i];
            let value = if i == 0 { parameter.value.ln() } else { parameter.value };
            let within = |error: Option<f64>| usize::from((value - truth).abs() <= 1.96 * error.unwrap());
            naive += within(fit.independent_errors[i]);
            corrected += within(parameter.standard_error);
            total += 1;
        }
    }
    let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
    let [naive, corrected] = [naive, corrected].map(|count| f64::from(count as u32) / f64::from(total));
    println!("naive {naive}, corrected {corrected}, length {mean}");
    assert!((mean / 2.5 - 1.0).abs() < 0.05, "{mean}");
    assert!((0.45..0.70).contains(&naive), "{naive}");
    assert!((0.90..=0.99).contains(&corrected), "{corrected}");
}
