//! Simulates the devices of a pattern.

use std::ops::Range;

use deaflow_base::words;
use deaflow_fem::{MembraneSolver, SetupError, SolveOptions, WorkLimit, check_covered_cells};
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_scene::{Scene, Tolerances};
use rayon::prelude::*;

use crate::device::{self, SOURCES, Source};
use crate::error::ToleranceError;
use crate::mask::{Made, made};
use crate::sampling;

words! {
    /// Why a device fails.
    pub enum Failure {
        /// It has no stable state.
        Unstable = "unstable",
        /// Electrodes of two groups touch.
        ShortCircuit = "short-circuit",
        /// The limit of work was reached.
        Unsolved = "not-solved",
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

impl Device {
    /// Returns a deviation in units of the standard deviation.
    #[must_use]
    pub fn deviation(&self, source: Source) -> f64 {
        self.deviations[source as usize]
    }
}

/// The devices of a scene with tolerances.
pub struct Study {
    scene: Scene,
    tolerances: Tolerances,
    options: SolveOptions,
    limit: WorkLimit,
    seed: u64,
}

impl Study {
    /// Prepares the devices of a scene in one state with its effects decided.
    ///
    /// # Errors
    /// If nothing varies, or a tolerance is not simulated in the scene.
    pub fn new(
        scene: Scene,
        tolerances: Tolerances,
        options: SolveOptions,
        limit: WorkLimit,
        seed: u64,
    ) -> Result<Self, ToleranceError> {
        device::check(&scene, &tolerances)?;
        let study = Self {
            scene,
            tolerances,
            options,
            limit,
            seed,
        };
        if study.varying().is_empty() && study.lost_cells() == 0.0 {
            return Err(ToleranceError::None);
        }
        if study.cuts_cells() {
            let tolerance = study.of_electrodes().unwrap_or_default();
            check_covered_cells(&study.scene).map_err(|error| match error {
                SetupError::Coverage { with } => ToleranceError::Setting { tolerance, with },
                other => other.into(),
            })?;
        }
        Ok(study)
    }

    /// Returns by what devices differ, besides lost cells.
    #[must_use]
    pub fn varying(&self) -> Vec<Source> {
        let all = Source::ALL.into_iter();
        all.filter(|source| source.varies(&self.tolerances)).collect()
    }

    fn lost_cells(&self) -> f64 {
        self.tolerances.lost_cells.as_ref().map_or(0.0, |share| share.to_f64())
    }

    /// Returns the first tolerance that changes the electrodes.
    fn of_electrodes(&self) -> Option<&'static str> {
        let is_lossy = self.lost_cells() > 0.0;
        match self.cuts_cells() {
            true if Source::Mask.varies(&self.tolerances) => Some("mask"),
            true => Some("misregistration"),
            false => is_lossy.then_some("lost_cells"),
        }
    }

    /// Returns whether electrodes cover parts of cells.
    fn cuts_cells(&self) -> bool {
        let sources = [Source::Mask, Source::MisregistrationX, Source::MisregistrationY];
        sources.into_iter().any(|source| source.varies(&self.tolerances))
    }

    /// Refuses a pattern whose electrodes are not those of whole cells, if they vary.
    ///
    /// # Errors
    /// If the pattern is refused.
    pub fn check(&self, pattern: &Pattern) -> Result<(), ToleranceError> {
        let is_drawn = pattern.coverage().is_some() || pattern.electrodes().is_some();
        match self.of_electrodes().filter(|_| is_drawn) {
            Some(tolerance) => Err(ToleranceError::Cells { tolerance }),
            None => Ok(()),
        }
    }

    /// Simulates some of the devices of a pattern; `value` is the displacement in mm of a field, and `done` is called
    /// after each device.
    ///
    /// # Errors
    /// If a device cannot be simulated.
    pub fn devices(
        &self,
        pattern: &Pattern,
        range: Range<u32>,
        value: impl Fn(&Field) -> f64 + Sync,
        done: impl Fn() + Sync,
    ) -> Result<Vec<Device>, ToleranceError> {
        range
            .into_par_iter()
            .map(|index| {
                let deviations = sampling::deviations(self.seed, index);
                let value = self.device(pattern, index, &deviations)?.map(|field| value(&field));
                done();
                Ok(Device { deviations, value })
            })
            .collect()
    }

    /// Simulates the pattern as drawn in the scene.
    ///
    /// # Errors
    /// If it cannot be simulated.
    pub fn nominal(&self, pattern: &Pattern) -> Result<Result<Field, Failure>, ToleranceError> {
        self.simulate(&self.scene, pattern)
    }

    fn device(
        &self,
        pattern: &Pattern,
        index: u32,
        deviations: &[f64; SOURCES],
    ) -> Result<Result<Field, Failure>, ToleranceError> {
        let pattern = match self.of_electrodes() {
            None => pattern.clone(),
            Some(_) => {
                let membrane = self.scene.membrane();
                let lost = sampling::lost(self.seed, index, membrane.raster.cells(), self.lost_cells());
                let offsets = device::offsets(&self.tolerances, deviations);
                match made(pattern, self.scene.parts().as_deref(), membrane, &offsets, &lost)? {
                    Made::Pattern(pattern) => pattern,
                    Made::ShortCircuit => return Ok(Err(Failure::ShortCircuit)),
                }
            }
        };
        match device::scene(&self.scene, &self.tolerances, deviations) {
            Some(scene) => self.simulate(&scene, &pattern),
            None => Ok(Err(Failure::Unstable)),
        }
    }

    fn simulate(&self, scene: &Scene, pattern: &Pattern) -> Result<Result<Field, Failure>, ToleranceError> {
        let scene = scene.with_electrodes_of(pattern);
        let solver = MembraneSolver::new(&scene, self.options)?.within(self.limit);
        let solution = solver.solve(pattern);
        let failure = match solution.outcome.bracket() {
            Some(_) => Failure::Unstable,
            None => Failure::Unsolved,
        };
        Ok(solver.simulation(pattern, &solution).stroke().ok_or(failure))
    }
}
