//! Simulates the devices of a pattern.

use std::ops::Range;

use deaflow_base::words;
use deaflow_fem::{MembraneSolver, SetupError, SolveOptions, WorkLimit, check_covered_cells};
use deaflow_field::Field;
use deaflow_pattern::{Fabricated, Pattern, fabricated};
use deaflow_scene::{Effects, Scene, Tolerances};
use rayon::prelude::*;

use crate::device::{self, SOURCES, Source};
use crate::error::ToleranceError;
use crate::sampling;
use crate::starts::Starts;

words! {
    /// Why a device fails.
    pub enum Failure {
        /// It has no stable state.
        Unstable = "unstable",
        /// Electrodes of two groups touch.
        ShortCircuit = "short-circuit",
        /// Electrodes of two groups lie in one cell.
        SharedCell = "shared-cell",
        /// The electric field exceeds the breakdown field, if that effect is simulated.
        Breakdown = "breakdown",
        /// The limit of work was reached.
        Unsolved = "not-solved",
    }
}

impl Failure {
    /// Returns what is wrong with devices that fail so, after their number.
    #[must_use]
    pub fn description(self) -> &'static str {
        match self {
            Self::Unstable => "have no stable state",
            Self::ShortCircuit => "have a short circuit between groups",
            Self::SharedCell => "have two groups in one cell and are not simulated (use smaller cells)",
            Self::Breakdown => "have a field beyond breakdown",
            Self::Unsolved => "need more than the limit of work",
        }
    }
}

/// One device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Device {
    /// Its standard normal deviations, in the order of [`Source::ALL`].
    pub deviations: [f64; SOURCES],
    /// Its displacement in mm.
    pub value: Result<f64, Failure>,
}

/// The outcome of a device that does not fail.
pub const CONVERGED: &str = "converged";

impl Device {
    /// Returns how it ended, as a word: [`CONVERGED`] or why it failed.
    #[must_use]
    pub fn outcome(&self) -> &'static str {
        self.value.map_or_else(Failure::name, |_| CONVERGED)
    }

    /// Returns the devices of an artifact from their outcomes, displacements and deviations; `None` if an outcome is
    /// unknown or the numbers of rows differ.
    #[must_use]
    pub fn of_rows(outcomes: &[String], displacements: &[f64], deviations: &[[f64; SOURCES]]) -> Option<Vec<Self>> {
        if [displacements.len(), deviations.len()] != [outcomes.len(); 2] {
            return None;
        }
        let rows = outcomes.iter().zip(displacements).zip(deviations);
        rows.map(|((outcome, mm), deviations)| {
            let value = match outcome.as_str() {
                CONVERGED => Ok(*mm),
                other => Err(Failure::from_name(other)?),
            };
            Some(Self {
                deviations: *deviations,
                value,
            })
        })
        .collect()
    }

    /// Returns a deviation in units of the standard deviation.
    #[must_use]
    pub fn deviation(&self, source: Source) -> f64 {
        self.deviations[source as usize]
    }
}

/// The devices of a scene with tolerances.
pub struct Study {
    /// The states of each device; the voltages of all deviate by the same factor.
    states: Vec<Scene>,
    tolerances: Tolerances,
    options: SolveOptions,
    limit: WorkLimit,
    seed: u64,
}

impl Study {
    /// Prepares the devices of a scene, given in each of its states with its effects decided.
    ///
    /// # Errors
    /// If nothing varies, or a tolerance is not simulated in the scene.
    pub fn new(
        states: Vec<Scene>,
        tolerances: Tolerances,
        options: SolveOptions,
        limit: WorkLimit,
        seed: u64,
    ) -> Result<Self, ToleranceError> {
        // Critical voltages would take most of the time, and no device is judged by them.
        let without_critical_voltages = |scene: Scene| {
            scene.with_effects(Effects {
                electromechanical_stability: None,
                ..scene.effects.clone()
            })
        };
        let study = Self {
            states: states.into_iter().map(without_critical_voltages).collect(),
            tolerances,
            options,
            limit,
            seed,
        };
        let mut states = study.states.iter();
        states.try_for_each(|scene| check_tolerances(scene, &study.tolerances))?;
        Ok(study)
    }

    /// Returns by what devices differ, besides lost cells.
    #[must_use]
    pub fn varying(&self) -> Vec<Source> {
        Source::varying(&self.tolerances)
    }

    /// Refuses a pattern whose electrodes are not those of whole cells, if they vary.
    ///
    /// # Errors
    /// If the pattern is refused.
    pub fn check(&self, pattern: &Pattern) -> Result<(), ToleranceError> {
        let is_drawn = pattern.coverage().is_some() || pattern.electrodes().is_some();
        match of_electrodes(&self.tolerances).filter(|_| is_drawn) {
            Some(tolerance) => Err(ToleranceError::Cells { tolerance }),
            None => Ok(()),
        }
    }

    /// Simulates some of the devices of a pattern; `value` is the displacement in mm of the fields in all states, and
    /// `done` is called after each device.
    ///
    /// # Errors
    /// If a device cannot be simulated.
    pub fn devices(
        &self,
        pattern: &Pattern,
        range: Range<u32>,
        value: impl Fn(&[Field]) -> f64 + Sync,
        done: impl Fn() + Sync,
    ) -> Result<Vec<Device>, ToleranceError> {
        let deviation = device::deviation_of_drive(&self.tolerances);
        let starts: Vec<Option<Starts>> = self
            .states
            .iter()
            .map(|state| Starts::new(state, pattern, deviation, |scene| self.solver(scene)))
            .collect::<Result<_, SetupError>>()?;
        range
            .into_par_iter()
            .map(|index| {
                let deviations = sampling::deviations(self.seed, index);
                let found = self.device((pattern, &starts), index, &deviations)?;
                let value = found.map(|fields| value(&fields));
                done();
                Ok(Device { deviations, value })
            })
            .collect()
    }

    /// Simulates the pattern as drawn in all states.
    ///
    /// # Errors
    /// If it cannot be simulated.
    pub fn nominal(&self, pattern: &Pattern) -> Result<Result<Vec<Field>, Failure>, ToleranceError> {
        in_all(self.states.iter().map(|scene| self.simulate(scene, pattern, None)))
    }

    fn device(
        &self,
        (drawn, starts): (&Pattern, &[Option<Starts>]),
        index: u32,
        deviations: &[f64; SOURCES],
    ) -> Result<Result<Vec<Field>, Failure>, ToleranceError> {
        let pattern = match (of_electrodes(&self.tolerances), self.states.first()) {
            (Some(_), Some(any)) => {
                let membrane = any.membrane();
                let lost = sampling::lost(self.seed, index, membrane.raster.cells(), lost_cells(&self.tolerances));
                let offsets = device::offsets(&self.tolerances, deviations);
                match fabricated(drawn, any.parts().as_deref(), membrane, &offsets, &lost)? {
                    Fabricated::Pattern(pattern) => pattern,
                    Fabricated::ShortCircuit => return Ok(Err(Failure::ShortCircuit)),
                    Fabricated::SharedCell => return Ok(Err(Failure::SharedCell)),
                }
            }
            _ => drawn.clone(),
        };
        let states = self.states.iter().zip(starts);
        in_all(states.map(
            |(state, starts)| match device::scene(state, &self.tolerances, deviations) {
                Some(scene) => {
                    let start = starts.as_ref().map(|starts| starts.at(&scene));
                    self.simulate(&scene, &pattern, start.as_deref())
                }
                None => Ok(Err(Failure::Unstable)),
            },
        ))
    }

    fn solver(&self, scene: &Scene) -> Result<MembraneSolver, SetupError> {
        Ok(MembraneSolver::new(scene, self.options)?.within(self.limit))
    }

    /// Simulates a pattern, from a displacement near its equilibrium if one is known.
    fn simulate(
        &self,
        scene: &Scene,
        pattern: &Pattern,
        start: Option<&[f64]>,
    ) -> Result<Result<Field, Failure>, ToleranceError> {
        let solver = self.solver(&scene.with_electrodes_of(pattern))?;
        let near = start.and_then(|start| solver.solve_near(pattern, start));
        let solution = near.unwrap_or_else(|| solver.solve(pattern));
        let failure = match solution.outcome.bracket() {
            Some(_) => Failure::Unstable,
            None => Failure::Unsolved,
        };
        let simulation = solver.simulation(pattern, &solution);
        match simulation.observation.breakdown_ratio {
            Some(ratio) if ratio > 1.0 => Ok(Err(Failure::Breakdown)),
            _ => Ok(simulation.stroke().ok_or(failure)),
        }
    }
}

/// Returns the fields of all states, up to the first in which a device fails.
fn in_all(
    states: impl Iterator<Item = Result<Result<Field, Failure>, ToleranceError>>,
) -> Result<Result<Vec<Field>, Failure>, ToleranceError> {
    let mut fields = Vec::new();
    for found in states {
        match found? {
            Ok(field) => fields.push(field),
            Err(failure) => return Ok(Err(failure)),
        }
    }
    Ok(Ok(fields))
}

/// Refuses tolerances that are not simulated in a scene.
///
/// # Errors
/// If nothing varies, or a tolerance is not simulated in the scene.
pub fn check_tolerances(scene: &Scene, tolerances: &Tolerances) -> Result<(), ToleranceError> {
    if Source::varying(tolerances).is_empty() && lost_cells(tolerances) == 0.0 {
        return Err(ToleranceError::None);
    }
    device::check(scene, tolerances)?;
    match of_electrodes(tolerances).filter(|_| cuts_cells(tolerances)) {
        None => Ok(()),
        Some(tolerance) => check_covered_cells(scene).map_err(|error| match error {
            SetupError::Coverage { with } => ToleranceError::Setting { tolerance, with },
            other => other.into(),
        }),
    }
}

fn lost_cells(tolerances: &Tolerances) -> f64 {
    tolerances.lost_cells.as_ref().map_or(0.0, |share| share.to_f64())
}

/// Returns the first tolerance that changes the electrodes.
fn of_electrodes(tolerances: &Tolerances) -> Option<&'static str> {
    let is_lossy = lost_cells(tolerances) > 0.0;
    match cuts_cells(tolerances) {
        true if Source::Mask.varies(tolerances) => Some("mask"),
        true => Some("misregistration"),
        false => is_lossy.then_some("lost_cells"),
    }
}

/// Returns whether electrodes cover parts of cells.
fn cuts_cells(tolerances: &Tolerances) -> bool {
    let sources = [Source::Mask, Source::MisregistrationX, Source::MisregistrationY];
    sources.into_iter().any(|source| source.varies(tolerances))
}
