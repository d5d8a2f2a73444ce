//! Numbers that need a solution: compression, field, and the distance to the loss of stability.

use rayon::prelude::*;

use super::{Row, Trial, Verdict, known, open, voltage};
use crate::fem::effects::breakdown::breakdown_ratio;
use crate::fem::{MembraneSolver, Order, SetupError, SolveOptions, Survey, cell_states};
use crate::pattern::Pattern;
use crate::scene::effects::names;
use crate::scene::{BreakdownLaw, Effects, Scene};

/// A mesh on which the loss of stability comes out a few per cent high; bilinear elements of the same size would place that
/// of a single cell 12 % too high.
const MESH: SolveOptions = SolveOptions {
    elements_per_cell: 1,
    order: Order::Biquadratic,
    tolerance: 1e-8,
};

/// Voltages up to so many times that at which the base model with electrodes everywhere loses stability are searched for
/// the end of the stable branch.
const REACH: f64 = 3.0;

/// What was found with one pattern.
struct Found {
    /// Largest −σ/μ over the cells.
    compression: f64,
    /// Largest E/E_B over the cells.
    field: f64,
    /// The voltage at which stability is lost; `None` where it is not within reach.
    limit: Option<f64>,
}

/// The rows of the effects that need a solution.
pub fn rows(scene: &Scene, patterns: &[Trial]) -> Result<Vec<Row>, SetupError> {
    let breakdown = breakdown_law(scene);
    let solver = MembraneSolver::new(scene, MESH)?;
    let top = (REACH * uniform_limit(scene)).max(scene.voltage_v());
    let search = MembraneSolver::new(&scene.at_voltage(top), MESH)?;
    let found: Result<Vec<Found>, SetupError> = patterns
        .par_iter()
        .map(|trial| examine(scene, &solver, &search, trial, &breakdown))
        .collect();
    let found = found?;
    let names: Vec<&str> = patterns.iter().map(|trial| trial.name.as_str()).collect();
    Ok(vec![
        wrinkling(&names, &found),
        stability(&names, &found, scene),
        breaking(&names, &found, scene),
    ])
}

/// Turns on what the rows call for.
pub fn turn_on(effects: &mut Effects, scene: &Scene, rows: &[Row]) {
    for row in rows.iter().filter(|row| row.verdict == Verdict::CalledFor) {
        match row.effect {
            names::WRINKLING => effects.wrinkling = true,
            names::STABILITY => effects.electromechanical_stability = true,
            names::BREAKDOWN => effects.dielectric_breakdown = Some(breakdown_law(scene)),
            _ => {}
        }
    }
}

/// The law of the scene, or that of the acrylic elastomer that most such membranes are made of.
fn breakdown_law(scene: &Scene) -> BreakdownLaw {
    let named = scene.effects.dielectric_breakdown.clone();
    named
        .or_else(|| scene.properties.dielectric_breakdown.clone())
        .unwrap_or(BreakdownLaw::Huang)
}

/// Where the base model, active everywhere, loses stability: κ = λp⁻² + 3λp⁻⁸, in V.
fn uniform_limit(scene: &Scene) -> f64 {
    let stretch = scene.prestretch();
    let kappa = stretch.powi(-2) + 3.0 * stretch.powi(-8);
    1e-3 * scene.thickness_mm() * (kappa * scene.shear_modulus_pa() / scene.permittivity()).sqrt()
}

fn examine(
    scene: &Scene,
    solver: &MembraneSolver,
    search: &MembraneSolver,
    trial: &Trial,
    breakdown: &BreakdownLaw,
) -> Result<Found, SetupError> {
    let pattern = &trial.pattern;
    let solution = solver.solve(pattern);
    // Where there is no stable state at the scene's voltage, the last one before speaks.
    let reached = solution.outcome.bracket().map(|[stable, _]| scene.at_voltage(stable));
    let scene = reached.as_ref().unwrap_or(scene);
    let states = cell_states(scene, solver.mesh(), pattern, &solution.displacement)?;
    Ok(Found {
        compression: -Survey::of(&states, scene.shear_modulus_pa()).smallest_stress,
        field: breakdown_ratio(breakdown, scene.thickness_mm(), &states),
        limit: if trial.to_the_limit {
            limit(search, pattern)
        } else {
            None
        },
    })
}

/// The voltage at which stability is lost, if it is within reach.
fn limit(search: &MembraneSolver, pattern: &Pattern) -> Option<f64> {
    let [stable, _] = search.solve(pattern).outcome.bracket()?;
    (stable > 0.0).then_some(stable)
}

/// The pattern with the largest of some numbers, and that number.
fn worst<'a>(patterns: &[&'a str], numbers: impl Iterator<Item = f64>) -> Option<(&'a str, f64)> {
    let pairs = patterns.iter().copied().zip(numbers);
    pairs.max_by(|a, b| a.1.total_cmp(&b.1))
}

fn wrinkling(patterns: &[&str], found: &[Found]) -> Row {
    let (effect, quantity) = (names::WRINKLING, "−min σ/μ");
    match worst(patterns, found.iter().map(|f| f.compression)) {
        None => open(effect, quantity, Verdict::Unknown, 0.0, "no patterns".to_owned()),
        Some((pattern, number)) => {
            let change = format!("largest for `{pattern}`; cells under pressure wrinkle");
            known(effect, quantity.to_owned(), number, 0.0, change)
        }
    }
}

fn stability(patterns: &[&str], found: &[Found], scene: &Scene) -> Row {
    const THRESHOLD: f64 = 0.6;
    let (effect, quantity) = (names::STABILITY, "κ/κ(critical)");
    let limits = patterns
        .iter()
        .zip(found)
        .filter_map(|(name, f)| Some((name, f.limit?)));
    match limits.min_by(|a, b| a.1.total_cmp(&b.1)) {
        Some((pattern, limit)) => {
            let change = format!("`{pattern}` is lost at {}", voltage(limit));
            let ratio = (scene.voltage_v() / limit).powi(2);
            known(effect, quantity.to_owned(), ratio, THRESHOLD, change)
        }
        None => {
            let change = format!("no loss of stability up to {REACH:.0} times the limit of the base model");
            open(effect, quantity, Verdict::NotCalledFor, THRESHOLD, change)
        }
    }
}

fn breaking(patterns: &[&str], found: &[Found], scene: &Scene) -> Row {
    const THRESHOLD: f64 = 0.8;
    let effect = names::BREAKDOWN;
    let given = scene.effects.dielectric_breakdown.is_some() || scene.properties.dielectric_breakdown.is_some();
    let quantity = if given {
        "max E/E_B"
    } else {
        "max E/E_B (Huang's law assumed)"
    };
    match worst(patterns, found.iter().map(|f| f.field)) {
        None => open(effect, quantity, Verdict::Unknown, THRESHOLD, "no patterns".to_owned()),
        Some((pattern, number)) => {
            let change = format!("largest for `{pattern}`; no displacement");
            known(effect, quantity.to_owned(), number, THRESHOLD, change)
        }
    }
}
