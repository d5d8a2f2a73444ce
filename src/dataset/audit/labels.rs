//! The first pass over a dataset: every label is compared with a simulation.
//!
//! If the mesh of the dataset is coarse, each label is solved again on that mesh and must agree. Otherwise each label
//! is compared with Newton's solution on one biquadratic element per cell. The difference is the discretisation error,
//! which is similar for similar patterns. A label whose difference is an outlier is a suspect and is solved again on
//! its own mesh. Both ways find wrong labels, and neither gives false alarms.

use std::collections::BTreeMap;

use super::diagnosis::{Fault, diagnose, fit};
use super::error::AuditError;
use super::facts::CheckedRow;
use super::rows::{Columns, Discretisation};
use crate::Device;
use deaflow_field::{Field, Mesh, SimulatorKind, Simulators};
use deaflow_pattern::Pattern;

/// Largest cost of a solution in the first pass, in solutions with one bilinear element per cell.
const MAX_COST: u64 = 5;

/// The mesh of the first pass if the dataset's own mesh costs more.
pub const SCREEN: Mesh = Mesh::biquadratic(1);

/// The mesh that decides if the dataset declares no mesh.
pub const REFERENCE: Mesh = Mesh::biquadratic(4);

/// Displacements below this, in mm, are rounding errors.
const ROUNDING: f64 = 1e-8;

/// Largest difference between a label and its solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Relative to the largest displacement.
    pub relative: f64,
    /// Absolute, in mm.
    pub absolute: f64,
    /// Upper bound of `absolute`, relative to the largest displacement.
    pub part: f64,
}

impl Tolerance {
    /// Returns the tolerance in mm of a field with the largest displacement `peak`.
    #[must_use]
    pub fn of(&self, peak: f64) -> f64 {
        self.relative * peak + self.absolute.min(self.part * peak) + ROUNDING
    }
}

/// Result of the check of a label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LabelCheck {
    /// Not checked: the row has no pattern or no field.
    Absent,
    /// The label agrees with the solution on its own mesh.
    Agrees,
    /// The label differs from that solution, by this many mm.
    Wrong(Fault, f64),
    /// There is no stable solution on its own mesh.
    NoSolution,
    /// The row claims to have no field, but its pattern has a stable solution.
    Stable,
    /// The label was compared with an estimate only.
    Compared {
        /// Ratio of the stored to the estimated field.
        ratio: f64,
        /// Residual after the ratio, relative to the stored field.
        residual: f64,
    },
}

/// Checks labels.
pub struct LabelChecker<'a> {
    /// The device.
    pub device: &'a Device,
    /// Simulators.
    pub simulators: &'a dyn Simulators,
    /// Mesh and method of the fields.
    pub discretisation: Discretisation,
    /// The tolerance.
    pub tolerance: Tolerance,
    /// Whether the mesh was identified rather than declared.
    pub is_identified: bool,
}

/// A label that was solved again.
#[derive(Clone, Copy, Debug)]
pub struct SolvedLabel {
    /// The result.
    pub label: LabelCheck,
    /// The ratio of the stored field to the solution, and the result if this ratio is an outlier; `None` without a
    /// solution.
    pub if_outlier: Option<(f64, LabelCheck)>,
}

impl LabelChecker<'_> {
    /// Returns the mesh of a row, if it is known.
    #[must_use]
    pub fn mesh(&self, columns: &Columns, index: usize) -> Option<Mesh> {
        match self.discretisation {
            Discretisation::Mesh(mesh) | Discretisation::Estimates(mesh) => Some(mesh),
            Discretisation::PerRow => columns.mesh.as_ref().map(|meshes| meshes[index]),
            Discretisation::Unknown => None,
        }
    }

    fn own_simulator(mesh: Option<Mesh>) -> SimulatorKind {
        mesh.map_or(SimulatorKind::Newton(REFERENCE), SimulatorKind::AsDeclared)
    }

    fn first_simulator(&self, mesh: Option<Mesh>) -> SimulatorKind {
        let estimates = matches!(self.discretisation, Discretisation::Estimates(_));
        match mesh {
            Some(mesh) if estimates || mesh.cost() <= MAX_COST => SimulatorKind::AsDeclared(mesh),
            _ => SimulatorKind::Newton(SCREEN),
        }
    }

    /// Makes the first pass over rows. The first is row `start` of the dataset.
    ///
    /// # Errors
    /// When a simulator cannot be set up.
    pub fn first_pass(
        &self,
        rows: &[CheckedRow],
        start: usize,
        columns: &Columns,
    ) -> Result<Vec<LabelCheck>, AuditError> {
        let mut labels = vec![LabelCheck::Absent; rows.len()];
        let mut groups: BTreeMap<Option<Mesh>, Vec<usize>> = BTreeMap::new();
        for (at, _) in rows.iter().enumerate().filter(|(_, row)| row.usable().is_some()) {
            groups.entry(self.mesh(columns, start + at)).or_default().push(at);
        }
        for (mesh, members) in groups {
            let simulator = self.first_simulator(mesh);
            let pairs: Vec<(&Pattern, &Field)> = members.iter().filter_map(|&at| rows[at].usable()).collect();
            let patterns: Vec<Pattern> = pairs.iter().map(|(pattern, _)| (*pattern).clone()).collect();
            let found = self.simulate(simulator, &patterns)?;
            for ((at, (_, stored)), found) in members.into_iter().zip(pairs).zip(found) {
                labels[at] = match simulator {
                    SimulatorKind::Newton(_) => self.compare(stored, found.as_ref()),
                    SimulatorKind::AsDeclared(_) => self.check(stored, found.as_ref()),
                };
            }
        }
        Ok(labels)
    }

    /// Solves a label again on its mesh. If the row claims to have no field, the pattern is solved. If rows may have
    /// several meshes, a solution counts as stable only if it is also stable on the reference mesh.
    ///
    /// # Errors
    /// When a simulator cannot be set up.
    pub fn solve_again(&self, row: &CheckedRow, mesh: Option<Mesh>) -> Result<SolvedLabel, AuditError> {
        let Some((pattern, stored)) = row.usable() else {
            let label = match &row.pattern {
                Some(pattern) if row.claims_none && self.is_stable(pattern, mesh)? => LabelCheck::Stable,
                _ => LabelCheck::Absent,
            };
            return Ok(SolvedLabel {
                label,
                if_outlier: None,
            });
        };
        let found = self.solve(Self::own_simulator(mesh), pattern)?;
        let label = self.check(stored, found.as_ref());
        let if_outlier = found.map(|found| {
            let ratio = fit(&self.device.with_fixed_frame(stored), &found).0;
            (ratio, self.wrong(stored, &found))
        });
        Ok(SolvedLabel { label, if_outlier })
    }

    fn is_stable(&self, pattern: &Pattern, mesh: Option<Mesh>) -> Result<bool, AuditError> {
        let needs_reference = self.is_identified || self.discretisation == Discretisation::PerRow;
        Ok(self.solve(Self::own_simulator(mesh), pattern)?.is_some()
            && (!needs_reference || self.solve(SimulatorKind::Newton(REFERENCE), pattern)?.is_some()))
    }

    /// Simulates patterns; `None` for each pattern without a stable solution.
    fn simulate(&self, simulator: SimulatorKind, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, AuditError> {
        let simulations = self.simulators.simulator(simulator)?.simulate(patterns);
        Ok(simulations.into_iter().map(|simulation| simulation.field).collect())
    }

    /// Simulates a pattern; `None` without a stable solution.
    ///
    /// # Errors
    /// When a simulator cannot be set up.
    pub fn solve(&self, simulator: SimulatorKind, pattern: &Pattern) -> Result<Option<Field>, AuditError> {
        Ok(self.simulate(simulator, std::slice::from_ref(pattern))?.pop().flatten())
    }

    /// Checks a label against the solution on its own mesh, without the frame, which has its own check.
    fn check(&self, stored: &Field, found: Option<&Field>) -> LabelCheck {
        let Some(found) = found else {
            return LabelCheck::NoSolution;
        };
        match self.difference(stored, found) <= self.tolerance.of(found.max_magnitude()) {
            true => LabelCheck::Agrees,
            false => self.wrong(stored, found),
        }
    }

    /// Returns the largest difference without the frame, in mm.
    fn difference(&self, stored: &Field, found: &Field) -> f64 {
        let [stored, found] = [stored, found].map(|field| self.device.with_fixed_frame(field));
        stored.max_difference(&found)
    }

    /// Diagnoses the difference between a label and its solution.
    fn wrong(&self, stored: &Field, found: &Field) -> LabelCheck {
        let fault = diagnose(&self.device.with_fixed_frame(stored), found, self.device.symmetries);
        LabelCheck::Wrong(fault, self.difference(stored, found))
    }

    /// Compares a label with an estimate.
    fn compare(&self, stored: &Field, estimate: Option<&Field>) -> LabelCheck {
        let Some(estimate) = estimate else {
            return LabelCheck::Compared {
                ratio: 0.0,
                residual: 1.0,
            };
        };
        if stored.max_magnitude().max(estimate.max_magnitude()) <= ROUNDING {
            return LabelCheck::Agrees;
        }
        let (ratio, residual) = fit(&self.device.with_fixed_frame(stored), estimate);
        LabelCheck::Compared { ratio, residual }
    }
}
