//! Solutions of a drawn pattern at rising voltages, and what limits the voltage before the loss of stability: the
//! breakdown field, and compression, under which a real membrane wrinkles.

use rayon::prelude::*;

use super::solve::{START_VOLTAGE, SketchSolution};
use crate::cache::{CriticalVoltage, PreparedSolver, SimulationSetup, VoltageLimits};
use crate::http::ApiError;
use crate::state::ServerState;
use deaflow_fem::effects::{breakdown_ratio, breakdown_strength_or_default};
use deaflow_fem::{CellState, Method};
use deaflow_field::{Field, Simulation};
use deaflow_pattern::Pattern;

/// Steps of the voltage.
const STEPS: usize = 24;

/// The compression from which a membrane wrinkles, relative to the median of the larger principal stress. Free edges of
/// strips in tension are under a smaller one.
const WRINKLES: f64 = 0.01;

/// A solution at one voltage.
pub struct RisingPoint {
    /// The voltage, V.
    pub voltage: f64,
    /// Outcome and field.
    pub simulation: Simulation,
    /// The largest electric field relative to the breakdown field: that of the scene, or of the usual acrylic
    /// elastomer.
    pub breakdown: Option<f64>,
    /// The largest compression relative to [`WRINKLES`].
    compression: Option<f64>,
}

impl RisingPoint {
    /// Simulates a pattern at a voltage in V.
    fn new(
        setup: &SimulationSetup,
        prepared: &PreparedSolver,
        pattern: &Pattern,
        voltage: f64,
    ) -> Result<Self, ApiError> {
        // The effects stay as they are: screening at another voltage could select others.
        let scene = prepared
            .scene
            .at_voltage(voltage)
            .with_effects(prepared.scene.effects.clone());
        let own = SimulationSetup { scene, ..setup.clone() };
        let prepared = PreparedSolver::new(&own)?;
        let solution = SketchSolution::new(&own, &prepared, pattern)?;
        let cells = solution.cells(&prepared, pattern)?;
        let strength = breakdown_strength_or_default(&own.scene);
        let breakdown = |cells: &Vec<CellState>| breakdown_ratio(&strength, own.scene.thickness_mm(), cells);
        Ok(Self {
            voltage,
            breakdown: cells.as_ref().map(breakdown),
            compression: cells.as_deref().map(compression),
            simulation: solution.simulation,
        })
    }

    /// Returns the field; `None` without a stable state.
    pub fn field(&self) -> Option<&Field> {
        self.simulation.field.as_ref()
    }
}

/// Simulates a pattern at rising voltages up to `last` in V, as long as it is stable.
///
/// # Errors
/// If the scene cannot be simulated.
pub fn rising(
    setup: &SimulationSetup,
    prepared: &PreparedSolver,
    pattern: &Pattern,
    last: f64,
) -> Result<Vec<RisingPoint>, ApiError> {
    // Not 0: the ratios of several groups are kept.
    let voltage = |step: usize| (last * step as f64 / STEPS as f64).max(START_VOLTAGE);
    let at = |step: usize| RisingPoint::new(setup, prepared, pattern, voltage(step));
    let mut all: Vec<RisingPoint> = (0..=STEPS).into_par_iter().map(at).collect::<Result<_, _>>()?;
    // Beyond the first voltage without a stable state there is none on this mesh.
    let stable = all.iter().take_while(|point| point.field().is_some()).count();
    all.truncate(stable);
    Ok(all)
}

/// Returns the voltage at which a sweep ends, V: the critical one, or the highest stable one of the mesh if that is
/// lower; without a critical voltage, the requested one.
pub fn last_voltage(setup: &SimulationSetup, critical: Option<CriticalVoltage>) -> f64 {
    critical.map_or(setup.scene.voltage_v(), |found| found.voltage.min(found.bracket[0]))
}

/// Returns the largest compression of a cell relative to that from which it wrinkles; negative if all are in tension.
fn compression(cells: &[CellState]) -> f64 {
    let mut larger: Vec<f64> = cells.iter().map(|cell| cell.stresses[0]).collect();
    larger.sort_by(f64::total_cmp);
    let median = larger.get(larger.len() / 2).map_or(0.0, |median| median.abs());
    let most = cells
        .iter()
        .map(|cell| -cell.stresses[1])
        .fold(f64::NEG_INFINITY, f64::max);
    if median > 0.0 { most / (WRINKLES * median) } else { 0.0 }
}

/// Finds what limits the voltage of a pattern before it loses stability. The breakdown field is that of the scene, and
/// wrinkles are no limit if the scene simulates them.
///
/// # Errors
/// If the scene cannot be simulated.
pub fn voltage_limits(
    state: &ServerState,
    setup: &SimulationSetup,
    prepared: &PreparedSolver,
    pattern: &Pattern,
    critical: Option<CriticalVoltage>,
) -> Result<VoltageLimits, ApiError> {
    let last = last_voltage(setup, critical);
    let is_simulated = setup.method == Method::Newton && prepared.scene.drive.charge.is_none();
    if !is_simulated || last <= START_VOLTAGE || pattern.active_cells() == 0 {
        return Ok(VoltageLimits::default());
    }
    // They depend on the voltage only by the end of the search.
    let scene = prepared
        .scene
        .at_voltage(last)
        .with_effects(prepared.scene.effects.clone());
    let key = (SimulationSetup { scene, ..setup.clone() }, pattern.clone());
    let found = state.voltage_limits.get_or_insert(&key, || {
        let scene = &key.0.scene;
        let at = |voltage: f64| RisingPoint::new(&key.0, prepared, pattern, voltage);
        let end = at(last)?;
        let limit = |is_known: bool, ratio: fn(&RisingPoint) -> Option<f64>| match is_known {
            true => search(ratio(&end), last, |voltage| Ok(ratio(&at(voltage)?))),
            false => Ok(None),
        };
        Ok::<_, ApiError>(VoltageLimits {
            breakdown: limit(scene.breakdown_strength().is_some(), |point| point.breakdown)?,
            wrinkling: limit(scene.effects.wrinkling.is_none(), |point| point.compression)?,
        })
    })?;
    Ok(*found)
}

/// Solutions of a search, at most, and how near to 1 its ratio comes.
const MAX_SOLUTIONS: usize = 12;
const NEAR: f64 = 1e-3;

/// Finds the voltage in V at which a ratio that rises with it reaches 1, given that at the last voltage; `None` if it
/// stays below. By the false position method, with the Illinois rule.
fn search(
    at_last: Option<f64>,
    last: f64,
    ratio: impl Fn(f64) -> Result<Option<f64>, ApiError>,
) -> Result<Option<f64>, ApiError> {
    let Some(at_last) = at_last.filter(|ratio| *ratio >= 1.0) else {
        return Ok(None);
    };
    let Some(at_first) = ratio(START_VOLTAGE)? else {
        return Ok(None);
    };
    if at_first >= 1.0 {
        return Ok(Some(START_VOLTAGE));
    }
    // Whether the lower end stayed in the last step.
    let mut stays = None;
    let (mut low, mut high) = ((START_VOLTAGE, at_first - 1.0), (last, at_last - 1.0));
    for _ in 0..MAX_SOLUTIONS {
        let voltage = high.0 - high.1 * (high.0 - low.0) / (high.1 - low.1);
        let Some(off) = ratio(voltage)?.map(|ratio| ratio - 1.0) else {
            return Ok(None);
        };
        if off.abs() < NEAR {
            return Ok(Some(voltage));
        }
        // An end that stays twice counts half, so that it moves too.
        if off < 0.0 {
            low = (voltage, off);
            high.1 *= if stays == Some(false) { 0.5 } else { 1.0 };
        } else {
            high = (voltage, off);
            low.1 *= if stays == Some(true) { 0.5 } else { 1.0 };
        }
        stays = Some(off >= 0.0);
    }
    Ok(Some(high.0))
}

/// Finds the voltage at which a ratio reaches 1, between two solutions.
pub fn crossing(points: &[RisingPoint], ratio: impl Fn(&RisingPoint) -> Option<f64>) -> Option<f64> {
    let at = points
        .iter()
        .position(|point| ratio(point).is_some_and(|ratio| ratio >= 1.0))?;
    let to = &points[at];
    let Some(from) = at.checked_sub(1).map(|before| &points[before]) else {
        return Some(to.voltage);
    };
    let (low, high) = (ratio(from)?, ratio(to)?);
    Some(from.voltage + (1.0 - low) / (high - low) * (to.voltage - from.voltage))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_is_followed_to_one_in_few_solutions() {
        let count = std::cell::Cell::new(0);
        // Rising as the electric field of a thinning membrane, and as a compression that begins late.
        for ratio in [
            |v: f64| (v / 5000.0).powi(3),
            |v: f64| (v - 4000.0) / 1000.0 - 20.0 * (5000.0 - v) / 5000.0,
        ] {
            count.set(0);
            let at = |voltage: f64| {
                count.set(count.get() + 1);
                Ok(Some(ratio(voltage)))
            };
            let found = search(Some(ratio(7000.0)), 7000.0, at).unwrap().unwrap();
            assert!(
                (found - 5000.0).abs() < 10.0 && count.get() <= 8,
                "{found} V by {}",
                count.get()
            );
            assert_eq!(search(Some(0.9), 7000.0, at).unwrap(), None);
        }
    }
}
