//! The artifact of a yield stage.

use super::error::Fault;
use super::macros::arrays;
use super::part::LongTexts;
use deaflow_field::OutcomeKind;
use deaflow_pattern::{Pattern, Role};
use deaflow_scene::{Effects, Scene, Tolerances};
use deaflow_store::StoreError;

arrays! {
    /// Simulated devices of designs and patterns. Displacements of devices that fail are 0.
    pub struct Yields, YieldsView {
        /// The designs: a row for each batch of devices of a design, in the order of the devices.
        batches: DeviceBatches = group("designs"),
        /// How each device ended: `converged`, `unstable`, `short-circuit`, `shared-cell`,
        /// `breakdown` or `not-solved`.
        outcome: Vec<String> = array("outcome", "", [device]),
        /// Displacement along the target directions.
        displacement: Vec<f64> = array("displacement", "mm", [device]),
        /// Deviations of voltage, shear modulus, thickness, permittivity, prestretch, mask, and misregistration along x
        /// and y, in units of the standard deviation.
        deviations: Vec<[f64; 8]> = array("deviations", "1", [device, source]),
        /// The scene.
        scene: Scene = attribute("scene"),
        /// The simulated effects; missing for several batches.
        effects: Option<Effects> = attribute("effects"),
        /// The tolerances.
        tolerances: Tolerances = attribute("tolerances"),
        /// The displacement that devices have to reach in mm, if there is one.
        wanted: Option<f64> = attribute("wanted_mm"),
        /// The same as a share of the displacement of each pattern as drawn.
        wanted_share: Option<f64> = attribute("wanted_share"),
    }
}

arrays! {
    /// Batches of devices.
    #[derive(Default)]
    pub struct DeviceBatches, DeviceBatchesView {
        /// Label of the stage that designed it.
        case: Vec<String> = array("case", "", [batch]),
        /// Name of the target; of a pattern from a file its number in the stage.
        name: Vec<String> = array("name", "", [batch]),
        /// Origin of the pattern, as in designs.
        role: Vec<Role> = array("role", "", [batch]),
        /// Number of the design of the target.
        member: Vec<u64> = array("member", "1", [batch]),
        /// Units along a side in the search.
        units: Vec<u64> = array("units", "1", [batch]),
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [batch, y, x]),
        /// The objective in YAML.
        objective: LongTexts = array("objective", "", [batch]),
        /// Number of devices.
        devices: Vec<u64> = array("devices", "1", [batch]),
        /// How the simulation of the pattern as drawn ended.
        drawn_outcome: Vec<String> = array("drawn_outcome", "", [batch]),
        /// Displacement of the pattern as drawn.
        drawn: Vec<f64> = array("drawn", "mm", [batch]),
    }
}

/// A design, or a pattern from a file, with its devices.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignDevices {
    /// Label of the stage that designed it.
    pub case: String,
    /// Name of the target; of a pattern from a file its number.
    pub name: String,
    /// Origin of the pattern.
    pub role: Role,
    /// Number of the design of the target.
    pub member: u64,
    /// Units along a side in the search.
    pub units: u64,
    /// The pattern.
    pub pattern: Pattern,
    /// Displacement of the pattern as drawn in mm; `None` without a stable state.
    pub drawn: Option<f64>,
    /// How each device ended.
    pub outcome: Vec<String>,
    /// Displacement of each device in mm, 0 for those that fail.
    pub displacement: Vec<f64>,
    /// Deviations of each device.
    pub deviations: Vec<[f64; 8]>,
}

impl YieldsView<'_> {
    /// Reads each design with the devices of all its batches.
    ///
    /// # Errors
    /// If the artifact cannot be read, or its numbers of devices are not those of its batches.
    pub fn designs(&self) -> Result<Vec<DesignDevices>, StoreError> {
        let batches = self.batches().read()?;
        let (outcomes, displacements) = (self.outcome().read()?, self.displacement().read()?);
        let deviations = self.deviations().read()?;
        let mut found: Vec<DesignDevices> = Vec::new();
        let mut first = 0_usize;
        for batch in 0..batches.patterns.len() {
            let all = usize::try_from(batches.devices[batch])
                .ok()
                .and_then(|count| first.checked_add(count));
            let Some(end) = all.filter(|end| *end <= outcomes.len()) else {
                let fault = Fault::Length {
                    path: "outcome".to_owned(),
                    axis: "device".to_owned(),
                    found: outcomes.len(),
                    other: "designs/devices".to_owned(),
                    expected: first.saturating_add(batches.devices[batch] as usize),
                };
                return Err(fault.of(self.artifact().digest()));
            };
            let is_same = |one: &DesignDevices| {
                (&one.case, &one.name, one.role) == (&batches.case[batch], &batches.name[batch], batches.role[batch])
                    && (one.member, one.units) == (batches.member[batch], batches.units[batch])
                    && one.pattern == batches.patterns[batch]
            };
            let at = found.iter().position(is_same).unwrap_or_else(|| {
                found.push(DesignDevices {
                    case: batches.case[batch].clone(),
                    name: batches.name[batch].clone(),
                    role: batches.role[batch],
                    member: batches.member[batch],
                    units: batches.units[batch],
                    pattern: batches.patterns[batch].clone(),
                    drawn: (batches.drawn_outcome[batch] == OutcomeKind::Converged.name())
                        .then_some(batches.drawn[batch]),
                    outcome: Vec::new(),
                    displacement: Vec::new(),
                    deviations: Vec::new(),
                });
                found.len() - 1
            });
            let design = &mut found[at];
            design.outcome.extend_from_slice(&outcomes[first..end]);
            design.displacement.extend_from_slice(&displacements[first..end]);
            design.deviations.extend_from_slice(&deviations[first..end]);
            first = end;
        }
        Ok(found)
    }
}
