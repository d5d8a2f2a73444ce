//! Fits of viscous branches to the stress along histories of stretch, such as relaxation after sudden steps.
//!
//! ```text
//! P(t) = P_law(λ(t)) + Σ Gᵢ pᵢ(t),   after a sudden step pᵢ = e^(−t/τᵢ)(λ₁ − λ₃²/λ₁) with the linear law
//! ```
//!
//! which is linear in the moduli: times on a grid give the starts, by linear least squares with positive moduli.

use crate::curve::{Curve, FitError, Points, Row, Sigma, noise_kind, scales};
use crate::deformation::Test;
use crate::elastomer::{Elastomer, Number, Response};
use crate::fit::{CurveResiduals, Options, Outlier, Verdict, outliers};
use crate::history::{HistoryCurve, Stressed};
use crate::law::{Law, LawKind};
use crate::solution::{Coordinate, Estimate, Model, Solution, check_points};
use crate::starts::{best_combinations, coordinates, neo_hookean_modulus, springs};

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
    /// The elastomer.
    pub elastomer: Elastomer,
    /// The parameters: those of the law at equilibrium, then the modulus and the time of each branch with rising times.
    /// After [`fit_relaxation`] they are `shear_modulus`, `g_1`, `tau_1`, `g_2`, …; after [`fit_histories`] those of
    /// [`Elastomer::parameters`].
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
        self.elastomer.branches
    }

    /// Returns the nominal stress in Pa at a time in s after a sudden step to a stretch; not a number where the model
    /// has no value.
    #[must_use]
    pub fn stress(&self, test: Test, stretch: f64, time_s: f64) -> f64 {
        let stresses = self.stresses(test, &[(0.0, 1.0), (0.0, stretch)], &[time_s]);
        stresses.map_or(f64::NAN, |stresses| stresses[0])
    }

    /// Returns the nominal stresses in Pa at times in s along a history of times in s and stretches, as in
    /// [`HistoryCurve::history`].
    ///
    /// # Errors
    /// When the history is not valid, or the model has no value at one of its stretches.
    pub fn stresses(&self, test: Test, history: &[(f64, f64)], time_s: &[f64]) -> Result<Vec<f64>, FitError> {
        let curve = HistoryCurve {
            name: self.elastomer.law.name().to_owned(),
            elastomer: self.elastomer,
            test,
            history: history.to_vec(),
            time_s: time_s.to_vec(),
            stress_pa: vec![0.0; time_s.len()],
            sigma: Sigma::UnstatedAbsolute,
        };
        let parameters = self.estimate.parameters.iter();
        let values: Vec<f64> = parameters.map(|parameter| parameter.value).collect();
        let numbers = curve.response()?.respond(&values);
        let numbers = numbers.ok_or(FitError::NoStart {
            law: self.elastomer.law.name(),
        })?;
        Ok(numbers.into_iter().map(|(stress, _)| stress).collect())
    }
}

/// Fits a neo-Hookean elastomer with up to `most_branches` linear branches to relaxation after sudden steps, and
/// returns the fits in the order of Akaike's criterion, the best first.
///
/// # Errors
/// When a curve is not valid, the bounds are not, or there are too few points even without branches.
pub fn fit_relaxation(
    curves: &[Relaxation],
    most_branches: usize,
    options: &Options,
) -> Result<Vec<RelaxationFit>, FitError> {
    check_steps(curves)?;
    let history = |curve: &Relaxation| HistoryCurve {
        name: curve.name.clone(),
        elastomer: Elastomer::elastic(LawKind::NeoHookean),
        test: curve.test,
        history: vec![(0.0, 1.0), (0.0, curve.stretch)],
        time_s: curve.time_s.clone(),
        stress_pa: curve.stress_pa.clone(),
        sigma: curve.sigma.clone(),
    };
    let histories: Vec<HistoryCurve> = curves.iter().map(history).collect();
    fit_numbers_of_branches(&histories, most_branches, ["g", "tau"], options)
}

/// Fits an elastomer with up to `most_branches` branches to stresses along histories of stretch, and returns the fits
/// in the order of Akaike's criterion, the best first. All curves name the same law and viscous law; the number of
/// branches in them does not matter.
///
/// # Errors
/// When a curve is not valid, the bounds are not, or there are too few points even without branches.
pub fn fit_histories(
    curves: &[HistoryCurve],
    most_branches: usize,
    options: &Options,
) -> Result<Vec<RelaxationFit>, FitError> {
    fit_numbers_of_branches(curves, most_branches, ["branch_modulus", "branch_time"], options)
}

/// Checks curves after sudden steps.
fn check_steps(curves: &[Relaxation]) -> Result<(), FitError> {
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
        held.push(Curve {
            name: curve.name.clone(),
            test: curve.test,
            stretch: vec![curve.stretch; curve.time_s.len()],
            stress_pa: curve.stress_pa.clone(),
            sigma: curve.sigma.clone(),
        });
    }
    Points::new(&held).map(|_| ())
}

fn fit_numbers_of_branches(
    curves: &[HistoryCurve],
    most_branches: usize,
    names: [&str; 2],
    options: &Options,
) -> Result<Vec<RelaxationFit>, FitError> {
    check_kinds(curves)?;
    let mut fits = Vec::new();
    for branches in 0..=most_branches {
        match fit_branches(curves, branches, names, options) {
            Err(FitError::TooFewPoints { .. }) if branches > 0 => break,
            fit => fits.push(fit?),
        }
    }
    fits.sort_by(|a, b| a.estimate.information.aicc.total_cmp(&b.estimate.information.aicc));
    Ok(fits)
}

/// Refuses curves of different elastomers or kinds of noise.
fn check_kinds(curves: &[HistoryCurve]) -> Result<(), FitError> {
    let Some(first) = curves.first() else {
        return Err(FitError::NotStretched);
    };
    for curve in curves {
        let names = || (curve.name.clone(), first.name.clone());
        let kind = |curve: &HistoryCurve| (curve.elastomer.law, curve.elastomer.viscous);
        if kind(curve) != kind(first) {
            let (curve, first) = names();
            return Err(FitError::MixedElastomers { curve, first });
        }
        if noise_kind(&curve.sigma) != noise_kind(&first.sigma) {
            let (curve, first) = names();
            return Err(FitError::MixedSigma { curve, first });
        }
    }
    Ok(())
}

/// Returns whether a curve says something: one that is never stretched has no stress.
fn counts(curve: &HistoryCurve) -> bool {
    curve.history.iter().any(|(_, stretch)| *stretch != 1.0)
}

fn fit_branches(
    curves: &[HistoryCurve],
    branches: usize,
    names: [&str; 2],
    options: &Options,
) -> Result<RelaxationFit, FitError> {
    let with_branches = |curve: &HistoryCurve| {
        let mut curve = curve.clone();
        curve.elastomer.branches = branches;
        curve
    };
    let counted: Vec<HistoryCurve> = curves.iter().filter(|curve| counts(curve)).map(with_branches).collect();
    let model = Branches::new(&counted, names, options)?;
    let no_start = FitError::NoStart { law: NAME };
    let solution = Solution::new(&model, &model.starts()).ok_or(no_start)?;
    let estimate = solution.estimate(options.profiles);
    let mut residuals = solution.residuals().iter().copied();
    let mut of_curve = |curve: &HistoryCurve| CurveResiduals {
        name: curve.name.clone(),
        residuals: if counts(curve) {
            residuals.by_ref().take(curve.time_s.len()).collect()
        } else {
            vec![0.0; curve.time_s.len()]
        },
    };
    let residuals: Vec<CurveResiduals> = curves.iter().map(&mut of_curve).collect();
    Ok(RelaxationFit {
        elastomer: model.elastomer,
        outliers: outliers(&residuals, solution.spread()),
        residuals,
        verdict: Verdict::of(&estimate),
        estimate,
    })
}

/// The model and its points.
struct Branches<'a> {
    elastomer: Elastomer,
    curves: &'a [HistoryCurve],
    histories: Vec<Stressed<'a>>,
    /// Of all curves, one after the other.
    points: Points,
    coordinates: Vec<Coordinate>,
}

impl<'a> Branches<'a> {
    fn new(curves: &'a [HistoryCurve], [modulus, time]: [&str; 2], options: &Options) -> Result<Self, FitError> {
        let Some(first) = curves.first() else {
            return Err(FitError::NotStretched);
        };
        let elastomer = first.elastomer;
        let mut names = elastomer.law.parameters();
        if names.is_empty() {
            return Err(FitError::NoTerms {
                law: elastomer.law.name(),
            });
        }
        let numbered = (1..=elastomer.branches).flat_map(|i| [format!("{modulus}_{i}"), format!("{time}_{i}")]);
        names.extend(numbered);
        let histories: Vec<Stressed<'a>> = curves.iter().map(HistoryCurve::response).collect::<Result<_, _>>()?;
        let mut rows = Vec::new();
        for (index, (curve, history)) in curves.iter().zip(&histories).enumerate() {
            let scales = scales(&curve.name, "stress", &curve.stress_pa, &curve.sigma)?;
            rows.extend(scales.into_iter().enumerate().map(|(at, scale)| Row {
                curve: index,
                test: curve.test,
                stretch: history.stretch(curve.time_s[at]),
                stress: curve.stress_pa[at],
                scale,
            }));
        }
        check_points(rows.len(), names.len(), NAME)?;
        let stated = noise_kind(&first.sigma) == 0;
        let points = Points { rows, stated };
        let modulus = neo_hookean_modulus(&points)?;
        Ok(Self {
            elastomer,
            curves,
            histories,
            points,
            coordinates: coordinates(NAME, names, modulus, options)?,
        })
    }

    /// Returns the best combinations of times between half of the first and twice the last time of the data, for each
    /// of some springs.
    fn starts(&self) -> Vec<Vec<f64>> {
        let from_start = |curve: &'a HistoryCurve| curve.time_s.iter().map(|time| time - curve.history[0].0);
        let positive = || self.curves.iter().flat_map(from_start).filter(|t| *t > 0.0);
        let last = positive().max_by(f64::total_cmp).unwrap_or(1.0);
        let (from, to) = (0.5 * positive().fold(last, f64::min), 2.0 * last);
        let part = |i: usize| i as f64 / (GRID - 1) as f64;
        let grid: Vec<f64> = (0..GRID).map(|i| from * (to / from).powf(part(i))).collect();
        let scaled = |stresses: Vec<f64>| -> Vec<f64> {
            let rows = stresses.into_iter().zip(&self.points.rows);
            rows.map(|(stress, row)| stress / row.scale).collect()
        };
        let column = |time: &f64| -> Option<Vec<f64>> {
            let branches: Option<Vec<_>> = self.histories.iter().map(|history| history.branch(*time)).collect();
            Some(scaled(
                branches?.concat().into_iter().map(|(stress, _)| stress).collect(),
            ))
        };
        let times = grid.iter().filter_map(|time| Some((*time, column(time)?)));
        let (grid, columns): (Vec<f64>, Vec<Vec<f64>>) = times.unzip();
        let data: Vec<f64> = self.points.rows.iter().map(|row| row.stress / row.scale).collect();
        let springs = springs(self.elastomer.law, &self.points);
        let count = STARTS.div_ceil(springs.len().max(1));
        let of_spring = |terms: &Vec<Law>| -> Option<Vec<Vec<f64>>> {
            let stress = |law: &Law| {
                let rows = self.points.rows.iter();
                let stresses: Option<Vec<f64>> = rows.map(|row| law.nominal_stress(row.test, row.stretch)).collect();
                stresses.map(scaled)
            };
            let always: Option<Vec<Vec<f64>>> = terms.iter().map(stress).collect();
            let best = best_combinations(&always?, &columns, self.elastomer.branches, &data, count);
            let parameters = |(chosen, moduli): (Vec<usize>, Vec<f64>)| {
                let (own, branches) = moduli.split_at(terms.len());
                let springs = terms
                    .iter()
                    .zip(own)
                    .flat_map(|(law, modulus)| law.with_modulus(*modulus));
                let pairs = chosen.iter().zip(branches).flat_map(|(i, g)| [*g, grid[*i]]);
                springs.chain(pairs).collect()
            };
            Some(best.into_iter().map(parameters).collect())
        };
        springs.iter().filter_map(of_spring).flatten().collect()
    }
}

impl Model for Branches<'_> {
    fn coordinates(&self) -> &[Coordinate] {
        &self.coordinates
    }

    fn residuals(&self, values: &[f64]) -> Option<Vec<Number>> {
        let numbers: Option<Vec<Vec<Number>>> = self.histories.iter().map(|history| history.respond(values)).collect();
        let rows = numbers?.into_iter().flatten().zip(&self.points.rows);
        let residual = |((stress, gradient), row): (Number, &Row)| {
            let gradient = gradient.into_iter().map(|slope| slope / row.scale).collect();
            ((stress - row.stress) / row.scale, gradient)
        };
        Some(rows.map(residual).collect())
    }

    fn data(&self) -> f64 {
        self.points
            .rows
            .iter()
            .map(|row| (row.stress / row.scale).powi(2))
            .sum()
    }

    fn stated(&self) -> bool {
        self.points.stated
    }

    fn pairs_from(&self) -> Option<usize> {
        Some(self.elastomer.law.parameters().len())
    }
}
