//! What `deaflow solve` computes besides equilibria in the plane, for patterns that are given as arrays: the Python
//! package calls this.

use super::equilibrium;
use super::history::{self, OutputTimes, SimulatedHistories};
use super::inflation::SpatialEquilibria;
use super::inflation_path::InflatedPaths;
use super::modes::{self, Modes};
use super::path::{self, Paths};
use super::response::{self, Frequencies, Responses};
use super::simulation::Computation;
use crate::CliError;
use deaflow_fem::PathParameter;
use deaflow_store::Object;

/// What to compute of each pattern.
#[derive(Clone, Debug, PartialEq)]
pub enum Analysis {
    /// The equilibrium of a scene under pressure or with motions out of the plane.
    SpatialEquilibrium,
    /// The motion in time, kept at some times: `--history`.
    History(OutputTimes),
    /// The path from rest past the critical voltage, load, displacement, pressure or volume: `--path`.
    Path(PathParameter),
    /// The lowest natural frequencies with their modes: `--modes`.
    Modes {
        /// The number of modes, in the plane and out of it, from 1 to [`deaflow_fem::MOST_MODES`].
        count: usize,
        /// Whether the mass is lumped at the nodes.
        lumped: bool,
    },
    /// The response to a small alternating voltage: `--response`.
    Response(Frequencies),
}

/// What an analysis found.
pub struct Analysed {
    /// The arrays of the file that the command writes.
    pub arrays: Object,
    /// Warnings about the model, one line each.
    pub warnings: Vec<String>,
}

impl Analysis {
    /// Analyses patterns.
    ///
    /// # Errors
    /// When the scene, the patterns and the parameters do not allow this analysis, or a pattern cannot be simulated.
    pub fn run(&self, computation: &Computation<'_>) -> Result<Analysed, CliError> {
        computation.check(match self {
            Self::SpatialEquilibrium => &equilibrium::FORM,
            Self::History(_) => &history::FORM,
            Self::Path(_) => &path::FORM,
            Self::Modes { .. } => &modes::FORM,
            Self::Response(_) => &response::FORM,
        })?;
        let (arrays, warnings) = match self {
            Self::SpatialEquilibrium => {
                let found = SpatialEquilibria::find(computation)?;
                (found.content.object(), found.warnings)
            }
            Self::History(times) => {
                let content = SimulatedHistories::follow(computation, times, None)?.content;
                let warnings = content.warnings.0.clone();
                (content.object(), warnings)
            }
            Self::Path(parameter) if computation.scene.loads.is_some() => {
                let found = InflatedPaths::follow(computation, *parameter)?;
                (found.content.object(), found.warnings)
            }
            Self::Path(parameter) => {
                let found = Paths::follow(computation, *parameter, None)?;
                (found.content.object(), found.warnings)
            }
            Self::Modes { count, lumped } => {
                let found = Modes::find(computation, *count, *lumped)?;
                (found.content.object(), found.warnings)
            }
            Self::Response(frequencies) => {
                let found = Responses::find(computation, frequencies)?;
                (found.content.object(), found.warnings)
            }
        };
        Ok(Analysed { arrays, warnings })
    }
}
