//! Membranes in time: viscoelastic creep and time-dependent voltages.

mod accurate;
mod amplitude;
mod bodies;
mod coefficients;
mod creep;
mod equilibrium;
mod extrapolation;
mod feed;
mod finite;
mod frequency;
mod history;
mod leads;
mod march;
mod modes;
mod motion;
mod pass;
mod smoothing;
mod solver;
mod supply;
mod swing;
#[cfg(test)]
mod tests;
mod trace;
mod transient;
mod viscous;

pub use accurate::AccurateHistory;
pub use creep::{ThreeSolves, settings as creep_settings};
pub use frequency::{AtFrequency, FrequencyResponse, FrequencySolver, at_bias, at_peak};
pub use history::{History, HistoryRequest, USUAL_ERROR as USUAL_TIME_ERROR, check as history_check, refusal};
pub use modes::{MOST_MODES, Transverse, Vibration};
pub use pass::Instant;
pub use solver::{HistoryOptions, HistorySolver, StepEstimates};
pub use swing::Swing;
pub use transient::StepEstimate;
