//! The designs of a pipeline with all that is known of each: what was predicted, what was simulated, and what each is
//! compared with.

mod compare;
mod found;
mod membranes;
mod names;
mod objective;
mod read;

#[cfg(test)]
pub(super) use compare::tests;

use std::sync::Arc;

use super::drawing::{Ground, Membrane};
use super::intervals::NetworkInterval;

pub use compare::Compared;
use deaflow_pattern::Pattern;
pub use deaflow_pattern::Role;
use deaflow_scene::Scene;
pub use found::{Extreme, Found};
pub(super) use membranes::membranes;
pub use objective::{Aim, Objective, Way, is_to_be_met};
pub use read::designs;

/// Of less than a micrometre a difference is no share: nothing may be what is wanted.
pub(super) const LEAST_MM: f64 = 1e-3;

/// Area fractions that differ by no more are equal: two cells of 50 × 50.
pub(super) const SAME_AREA: f64 = 1e-3;

/// The role in tables and files: both intuitive designs have the same word.
pub(super) fn role_word(role: Role) -> &'static str {
    match role {
        Role::IntuitiveEqualArea => Role::Intuitive.name(),
        other => other.name(),
    }
}

/// The role as a title.
pub(super) fn role_title(role: Role) -> &'static str {
    match role {
        Role::Refined => "Refined",
        Role::Ga => "Genetic algorithm",
        Role::Optimum => "Optimum",
        Role::Intuitive => "Intuitive, own area",
        Role::IntuitiveEqualArea => "Intuitive, equal area",
        Role::Own => "Own pattern",
    }
}

/// One pattern.
#[derive(Clone, Debug)]
pub struct Design {
    /// A name that no other design of the report has, and that a file can have.
    pub name: String,
    /// The case that it belongs to; empty where the pipeline names none.
    pub case: String,
    /// Name of the target.
    pub target: String,
    /// What it is among the patterns of the target.
    pub role: Role,
    /// Its place among the different designs of the target, from 0.
    pub member: u64,
    /// Units along the membrane that could be chosen one by one.
    pub units: u64,
    /// What it is for.
    pub objective: Objective,
    /// The area fraction that was asked for, or `free`.
    pub area_target: String,
    /// Its area fraction.
    pub area: f64,
    /// Its constraints in YAML; `{}` where there are none.
    pub constraints: String,
    /// `met`, or which constraints are not; empty where nothing is known.
    pub status: String,
    /// The scene that it was designed or verified in, without time and properties.
    pub scene: Arc<Scene>,
    /// The membrane that it is drawn on.
    pub ground: Ground,
    /// The electrode.
    pub pattern: Pattern,
    /// Predicted displacement in mm at the corners of cells, `[y][x][component]`; none where nothing was predicted.
    pub predicted: Option<Vec<f64>>,
    /// The same as simulated; none where it was not, or there is no stable solution.
    pub simulated: Option<Vec<f64>>,
    /// Of a device in several states, the displacement in each: as simulated, or as predicted where it was not.
    pub states: Vec<StateField>,
    /// Predicted mean displacement along the wanted directions, mm; none where the evaluator has no field.
    pub predicted_mm: Option<f64>,
    /// The same as simulated.
    pub simulated_mm: Option<f64>,
    /// Estimated error of the simulation, mm.
    pub error_mm: Option<f64>,
    /// How far it is from what is wanted, mm, where a displacement or an angle is to be met and it was simulated.
    pub distance_mm: Option<f64>,
    /// What a calibrated network says, where one was asked.
    pub interval: Option<NetworkInterval>,
    /// How the simulation ended; none where there was none.
    pub outcome: Option<String>,
    /// What it is compared with.
    pub compared: Compared,
}

/// The displacement in one of several states of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct StateField {
    /// The name of the state.
    pub name: String,
    /// In mm at the corners of cells, `[y][x][component]`.
    pub field: Vec<f64>,
}

impl Design {
    /// Whether both belong to the same target of the same case, and may be compared: they are for the same objective and area, in the same
    /// scene.
    #[must_use]
    pub fn is_beside(&self, other: &Self) -> bool {
        let is_same_target = self.case == other.case && self.target == other.target;
        let is_for_the_same = || self.objective == other.objective && self.area_target == other.area_target;
        is_same_target && is_for_the_same() && (Arc::ptr_eq(&self.scene, &other.scene) || self.scene == other.scene)
    }

    /// The membrane as simulated, or as predicted where it was not, in one of several states or in the only one; none where no finite field is
    /// known.
    #[must_use]
    pub fn membrane(&self, state: Option<&StateField>) -> Option<Membrane> {
        let field = match state {
            Some(state) => &state.field,
            None => self.simulated.as_ref().or(self.predicted.as_ref())?,
        };
        let is_in = |aim: &&Aim| state.is_none_or(|state| aim.state.as_ref() == Some(&state.name));
        let points = self
            .objective
            .points()
            .iter()
            .filter(is_in)
            .map(|aim| aim.point)
            .collect();
        Membrane::new(self.pattern.cells(), field, self.ground.clone(), points).ok()
    }

    /// The membrane in all states, or in the only one.
    #[must_use]
    pub fn membranes(&self) -> Vec<Membrane> {
        match &self.states[..] {
            [] => self.membrane(None).into_iter().collect(),
            states => states.iter().filter_map(|state| self.membrane(Some(state))).collect(),
        }
    }

    /// Predicted less simulated, a share of what is simulated; none where that is less than a micrometre.
    #[must_use]
    pub fn prediction_error(&self) -> Option<f64> {
        let simulated = self.simulated_mm.filter(|mm| mm.abs() > LEAST_MM)?;
        Some((self.predicted_mm? - simulated) / simulated.abs())
    }

    /// Its mask, relative to the folder of the table; none of what was not searched.
    #[must_use]
    pub fn mask_file(&self) -> Option<String> {
        self.role.is_found().then(|| format!("masks/{}.dxf", self.name))
    }

    /// The file of its pattern, seen from the table of designs.
    #[must_use]
    pub fn pattern_file(&self) -> String {
        format!("patterns/{}.csv", self.name)
    }
}
