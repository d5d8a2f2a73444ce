//! Membranes in time: viscoelastic creep, and whatever the voltage does.

mod accurate;
mod coefficients;
mod history;
mod march;
mod modes;
mod motion;
mod solver;
#[cfg(test)]
mod tests;
mod viscous;

pub use accurate::AccurateHistory;
pub use history::{History, HistoryRequest};
pub use march::Instant;
pub use modes::{MOST_MODES, Vibration};
pub use solver::{HistoryOptions, HistorySolver};
