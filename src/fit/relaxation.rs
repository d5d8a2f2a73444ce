//! Relaxation after steps: a neo-Hookean elastomer with linear viscous branches.
//!
//! After a sudden step to a stretch that is held,
//!
//! ```text
//! P(t) = (μ + Σ Gᵢ e^(−t/τᵢ))(λ₁ − λ₃²/λ₁)
//! ```
//!
//! which is linear in the moduli: times on a grid give the starts, by linear least squares with positive moduli.

use crate::curve::{Curve, FitError, Points, Sigma};
use crate::deformation::Test;
use crate::fit::{CurveResiduals, Options, Outlier, Verdict, outliers};
use crate::solution::{Coordinate, Estimate, Model, Solution, check_points};
use crate::starts::{best_combinations, coordinates, neo_hookean_modulus};

/// The times from which combinations are made.
const GRID: usize = 12;
/// The best combinations from which searches start.
const STARTS: usize = 12;
/// The name of the model in errors.
const NAME: &str = "viscoelastic";

/// The stress after a step to a stretch that is held.
#[derive(Clone, Debug, PartialEq)]
pub struct Relaxation {
    /// The name of the curve.
    pub name: String,
    /// How the specimen was stretched.
    pub test: Test,
    /// The stretch after the step.
    pub stretch: f64,
    /// The times since the step in s.
    pub time_s: Vec<f64>,
    /// The nominal stresses in Pa.
    pub stress_pa: Vec<f64>,
    /// The noise.
    pub sigma: Sigma,
}

/// A fitted viscoelastic elastomer.
#[derive(Clone, Debug)]
pub struct RelaxationFit {
    /// The parameters: `shear_modulus` at equilibrium, then `g_1`, `tau_1`, `g_2`, … with rising times.
    pub estimate: Estimate,
    /// The residuals.
    pub residuals: Vec<CurveResiduals>,
    /// Points far from the model.
    pub outliers: Vec<Outlier>,
    /// What the data determine.
    pub verdict: Verdict,
}

impl RelaxationFit {
    /// Returns the number of branches.
    #[must_use]
    pub fn branches(&self) -> usize {
        self.estimate.parameters.len() / 2
    }

    /// Returns the nominal stress in Pa at a time in s after a step to a stretch.
    #[must_use]
    pub fn stress(&self, test: Test, stretch: f64, time_s: f64) -> f64 {
        let values: Vec<f64> = self
            .estimate
            .parameters
            .iter()
            .map(|parameter| parameter.value)
            .collect();
        let (modulus, branches) = values.split_at(1);
        let branches = branches
            .chunks_exact(2)
            .map(|branch| branch[0] * (-time_s / branch[1]).exp());
        (modulus[0] + branches.sum::<f64>()) * test.shear(stretch)
    }
}

/// Fits the model with up to `most_branches` branches, and returns the fits in the order of Akaike's criterion, the
/// best first.
///
/// # Errors
/// When a curve is not valid, the bounds are not, or there are too few points even without branches.
pub fn fit_relaxation(
    curves: &[Relaxation],
    most_branches: usize,
    options: &Options,
) -> Result<Vec<RelaxationFit>, FitError> {
    let (points, times) = points(curves)?;
    let mut fits = Vec::new();
    for branches in 0..=most_branches {
        match fit_branches(&points, &times, curves, branches, options) {
            Err(FitError::TooFewPoints { .. }) if branches > 0 => break,
            fit => fits.push(fit?),
        }
    }
    fits.sort_by(|a, b| a.estimate.information.aicc.total_cmp(&b.estimate.information.aicc));
    Ok(fits)
}

/// Returns the points, and their times in the order of the points.
fn points(curves: &[Relaxation]) -> Result<(Points, Vec<f64>), FitError> {
    let mut times = Vec::new();
    let mut held = Vec::new();
    for curve in curves {
        let (first, second) = ((curve.stress_pa.len(), "stresses"), (curve.time_s.len(), "times"));
        if first.0 != second.0 {
            let curve = curve.name.clone();
            return Err(FitError::Lengths { curve, first, second });
        }
        if let Some(row) = curve.time_s.iter().position(|t| !(t.is_finite() && *t >= 0.0)) {
            let (curve, row) = (curve.name.clone(), row + 1);
            return Err(FitError::Time { curve, row });
        }
        if curve.stretch != 1.0 {
            times.extend(&curve.time_s);
        }
        held.push(Curve {
            name: curve.name.clone(),
            test: curve.test,
            stretch: vec![curve.stretch; curve.time_s.len()],
            stress_pa: curve.stress_pa.clone(),
            sigma: curve.sigma.clone(),
        });
    }
    Ok((Points::new(&held)?, times))
}

fn fit_branches(
    points: &Points,
    times: &[f64],
    curves: &[Relaxation],
    branches: usize,
    options: &Options,
) -> Result<RelaxationFit, FitError> {
    check_points(times.len(), 1 + 2 * branches, NAME)?;
    let model = Branches::new(points, times, branches, options)?;
    let no_start = FitError::NoStart { law: NAME };
    let solution = Solution::new(&model, &model.starts(branches)).ok_or(no_start)?;
    let estimate = solution.estimate(options.profiles);
    let mut residuals = model.residuals(&solution.values()).unwrap_or_default().into_iter();
    let mut of_curve = |curve: &Relaxation| CurveResiduals {
        name: curve.name.clone(),
        residuals: if curve.stretch == 1.0 {
            vec![0.0; curve.time_s.len()]
        } else {
            residuals
                .by_ref()
                .take(curve.time_s.len())
                .map(|(residual, _)| residual)
                .collect()
        },
    };
    let residuals: Vec<CurveResiduals> = curves.iter().map(&mut of_curve).collect();
    Ok(RelaxationFit {
        outliers: outliers(&residuals, solution.spread()),
        residuals,
        verdict: Verdict::of(&estimate),
        estimate,
    })
}

/// The model and its points.
struct Branches<'a> {
    times: &'a [f64],
    /// (λ₁ − λ₃²/λ₁)/σ and the stress/σ of each point.
    rows: Vec<(f64, f64)>,
    stated: bool,
    coordinates: Vec<Coordinate>,
}

impl<'a> Branches<'a> {
    fn new(points: &Points, times: &'a [f64], branches: usize, options: &Options) -> Result<Self, FitError> {
        let modulus = neo_hookean_modulus(points)?;
        let numbered = (1..=branches).flat_map(|i| [format!("g_{i}"), format!("tau_{i}")]);
        let names = std::iter::once("shear_modulus".to_owned()).chain(numbered).collect();
        let rows = points.counted();
        let rows = rows.map(|row| (row.test.shear(row.stretch) / row.scale, row.stress / row.scale));
        Ok(Self {
            times,
            rows: rows.collect(),
            stated: points.stated,
            coordinates: coordinates(NAME, names, modulus, options)?,
        })
    }

    /// Returns the best combinations of times between half of the first and twice the last time of the data.
    fn starts(&self, branches: usize) -> Vec<Vec<f64>> {
        let positive = || self.times.iter().copied().filter(|t| *t > 0.0);
        let last = positive().max_by(f64::total_cmp).unwrap_or(1.0);
        let (from, to) = (0.5 * positive().fold(last, f64::min), 2.0 * last);
        let part = |i: usize| i as f64 / (GRID - 1) as f64;
        let grid: Vec<f64> = (0..GRID).map(|i| from * (to / from).powf(part(i))).collect();
        let column = |time: f64| -> Vec<f64> {
            let rows = self.rows.iter().zip(self.times);
            rows.map(|((factor, _), t)| factor * (-t / time).exp()).collect()
        };
        let columns: Vec<Vec<f64>> = grid.iter().map(|time| column(*time)).collect();
        let data: Vec<f64> = self.rows.iter().map(|(_, stress)| *stress).collect();
        let best = best_combinations(&[column(f64::INFINITY)], &columns, branches, &data, STARTS);
        let parameters = |(chosen, moduli): (Vec<usize>, Vec<f64>)| {
            let pairs = chosen.iter().zip(&moduli[1..]).flat_map(|(i, g)| [*g, grid[*i]]);
            std::iter::once(moduli[0]).chain(pairs).collect()
        };
        best.into_iter().map(parameters).collect()
    }
}

impl Model for Branches<'_> {
    fn coordinates(&self) -> &[Coordinate] {
        &self.coordinates
    }

    fn residuals(&self, values: &[f64]) -> Option<Vec<(f64, Vec<f64>)>> {
        let (modulus, branches) = values.split_first()?;
        let row = |((factor, stress), t): (&(f64, f64), &f64)| {
            let mut total = *modulus;
            let mut gradient = vec![*factor];
            for branch in branches.chunks_exact(2) {
                let decay = (-t / branch[1]).exp();
                total += branch[0] * decay;
                gradient.extend([factor * decay, factor * branch[0] * decay * t / (branch[1] * branch[1])]);
            }
            (factor * total - stress, gradient)
        };
        Some(self.rows.iter().zip(self.times).map(row).collect())
    }

    fn data(&self) -> f64 {
        self.rows.iter().map(|(_, stress)| stress * stress).sum()
    }

    fn stated(&self) -> bool {
        self.stated
    }

    fn pairs_from(&self) -> Option<usize> {
        Some(1)
    }
}
