//! The full pass: every label is compared with a simulation.
//!
//! Where the mesh of a dataset is coarse, each label is solved again on that mesh and has to come out the same, which
//! leaves no room for a wrong one. Where that is too dear, each label is compared with Newton's solution on one
//! biquadratic element per cell. That differs by the discretisation error, which is much alike among patterns that are
//! alike: a label whose difference is an outlier among its like is a suspect, and solved again on its own mesh. So a
//! wrong label is found in either way, and what is found is never a false alarm.

use std::collections::BTreeMap;

use super::diagnosis::{Fault, diagnose, fit};
use super::error::AuditError;
use super::facts::CheckedRow;
use super::rows::{Columns, Discretisation};
use crate::Device;
use deaflow_field::{Field, Mesh, SimulatorKind, Simulators};
use deaflow_pattern::Pattern;

/// What a solution of the full pass may cost, in solutions with one bilinear element per cell.
const CHEAP: u64 = 5;

/// The mesh of the full pass where the dataset's own is dearer.
pub const SCREEN: Mesh = Mesh::biquadratic(1);

/// The mesh that has the last word where nothing is declared.
pub const REFERENCE: Mesh = Mesh::biquadratic(4);

/// Displacements below this are rounding, in mm.
const ROUNDING: f64 = 1e-8;

/// How far a label may be from the solution that it should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Part of the largest displacement.
    pub relative: f64,
    /// In mm.
    pub absolute: f64,
    /// Part of the largest displacement that `absolute` does not exceed.
    pub part: f64,
}

impl Tolerance {
    /// In mm, for a field with this largest displacement.
    #[must_use]
    pub fn of(&self, peak: f64) -> f64 {
        self.relative * peak + self.absolute.min(self.part * peak) + ROUNDING
    }
}

/// What is known of a label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LabelCheck {
    /// Nothing: the row has no pattern or no field.
    Absent,
    /// It is what its own mesh gives.
    Agrees,
    /// It is not; by so many mm.
    Wrong(Fault, f64),
    /// Its own mesh gives no stable solution.
    NoSolution,
    /// The row claims no field, and its pattern has a stable solution.
    Stable,
    /// How it compares with the estimate: its ratio to that, and the part of it that no ratio explains.
    Compared {
        /// Stored over estimated.
        ratio: f64,
        /// Relative to the stored field.
        rest: f64,
    },
}

/// By what labels are judged.
pub struct Judge<'a> {
    /// The device.
    pub device: &'a Device,
    /// Simulators.
    pub simulators: &'a dyn Simulators,
    /// How the fields were found.
    pub declared: Discretisation,
    /// How exactly.
    pub tolerance: Tolerance,
    /// Whether how they were found was found out.
    pub found_out: bool,
}

/// A label solved again.
#[derive(Clone, Copy, Debug)]
pub struct Solved {
    /// What comes of it.
    pub label: LabelCheck,
    /// The stored field over the solution, and the label if that ratio were wrong; `None` without a solution.
    pub otherwise: Option<(f64, LabelCheck)>,
}

impl Judge<'_> {
    /// The mesh of a row, where it is known.
    #[must_use]
    pub fn mesh(&self, columns: &Columns, index: usize) -> Option<Mesh> {
        match self.declared {
            Discretisation::Mesh(mesh) | Discretisation::Estimates(mesh) => Some(mesh),
            Discretisation::PerRow => columns.mesh.as_ref().map(|meshes| meshes[index]),
            Discretisation::Unknown => None,
        }
    }

    /// What a label is solved again by, so that it has to come out the same.
    #[must_use]
    pub fn own(&self, mesh: Option<Mesh>) -> SimulatorKind {
        mesh.map_or(SimulatorKind::Newton(REFERENCE), SimulatorKind::AsDeclared)
    }

    fn in_full_pass(&self, mesh: Option<Mesh>) -> SimulatorKind {
        let estimates = matches!(self.declared, Discretisation::Estimates(_));
        match mesh {
            Some(mesh) if estimates || mesh.cost() <= CHEAP => SimulatorKind::AsDeclared(mesh),
            _ => SimulatorKind::Newton(SCREEN),
        }
    }

    /// The full pass over some rows, the first of which is row `start` of the dataset.
    ///
    /// # Errors
    /// When a simulator cannot be set up.
    pub fn pass(&self, rows: &[CheckedRow], start: usize, columns: &Columns) -> Result<Vec<LabelCheck>, AuditError> {
        let mut labels = vec![LabelCheck::Absent; rows.len()];
        let mut groups: BTreeMap<Option<Mesh>, Vec<usize>> = BTreeMap::new();
        for (at, _) in rows.iter().enumerate().filter(|(_, row)| row.usable().is_some()) {
            groups.entry(self.mesh(columns, start + at)).or_default().push(at);
        }
        for (mesh, members) in groups {
            let wanted = self.in_full_pass(mesh);
            let pairs: Vec<(&Pattern, &Field)> = members.iter().filter_map(|&at| rows[at].usable()).collect();
            let found = self.against(wanted, &pairs)?;
            for ((at, (_, stored)), truth) in members.into_iter().zip(pairs).zip(found) {
                labels[at] = match (wanted, truth) {
                    (SimulatorKind::Newton(_), truth) => self.compared(stored, truth.as_ref()),
                    (_, truth) => self.verdict(stored, truth.as_ref()),
                };
            }
        }
        Ok(labels)
    }

    /// A label solved again as it was made, on this mesh. Of a row that claims no field the pattern is solved: where rows may
    /// stand on several meshes, a stable solution has to be stable on the mesh that has the last word as well.
    ///
    /// # Errors
    /// When a simulator cannot be set up.
    pub fn again(&self, row: &CheckedRow, mesh: Option<Mesh>) -> Result<Solved, AuditError> {
        let plain = |label| Solved { label, otherwise: None };
        let Some((pattern, stored)) = row.usable() else {
            let is_stable = match &row.pattern {
                Some(pattern) if row.claims_none => self.is_stable(pattern, mesh)?,
                _ => false,
            };
            return Ok(plain(if is_stable {
                LabelCheck::Stable
            } else {
                LabelCheck::Absent
            }));
        };
        let truth = self.against(self.own(mesh), &[(pattern, stored)])?.pop().flatten();
        let label = self.verdict(stored, truth.as_ref());
        let otherwise = truth.map(|truth| {
            let inner = self.device.inside(stored);
            let off = inner.max_difference(&self.device.inside(&truth));
            let fault = diagnose(&inner, &truth, self.device.symmetries);
            (fit(&inner, &truth).0, LabelCheck::Wrong(fault, off))
        });
        Ok(Solved { label, otherwise })
    }

    fn is_stable(&self, pattern: &Pattern, mesh: Option<Mesh>) -> Result<bool, AuditError> {
        let mut wanted = vec![self.own(mesh)];
        if self.found_out || self.declared == Discretisation::PerRow {
            wanted.push(SimulatorKind::Newton(REFERENCE));
        }
        for wanted in wanted {
            let found = self
                .simulators
                .simulator(wanted)?
                .simulate(std::slice::from_ref(pattern));
            if found.iter().all(|simulation| simulation.field.is_none()) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn against(&self, wanted: SimulatorKind, pairs: &[(&Pattern, &Field)]) -> Result<Vec<Option<Field>>, AuditError> {
        let patterns: Vec<Pattern> = pairs.iter().map(|(pattern, _)| (*pattern).clone()).collect();
        let simulations = self.simulators.simulator(wanted)?.simulate(&patterns);
        Ok(simulations.into_iter().map(|simulation| simulation.field).collect())
    }

    /// The frame has a check of its own, so it does not count here.
    fn verdict(&self, stored: &Field, truth: Option<&Field>) -> LabelCheck {
        let Some(truth) = truth else {
            return LabelCheck::NoSolution;
        };
        let stored = self.device.inside(stored);
        let off = stored.max_difference(&self.device.inside(truth));
        if off <= self.tolerance.of(truth.max_magnitude()) {
            return LabelCheck::Agrees;
        }
        LabelCheck::Wrong(diagnose(&stored, truth, self.device.symmetries), off)
    }

    /// A field beside an estimate of it.
    fn compared(&self, stored: &Field, estimate: Option<&Field>) -> LabelCheck {
        let Some(estimate) = estimate else {
            return LabelCheck::Compared { ratio: 0.0, rest: 1.0 };
        };
        if stored.max_magnitude().max(estimate.max_magnitude()) <= ROUNDING {
            return LabelCheck::Agrees;
        }
        let (ratio, rest) = fit(&self.device.inside(stored), estimate);
        LabelCheck::Compared { ratio, rest }
    }
}
