//! Fronts: the best designs for each active area or charge, in place of a single one.

mod hypervolume;
mod objectives;

pub use hypervolume::{FrontPoint, hypervolume};
pub use objectives::{Cost, Front, FrontMethod, FrontObjective, LeastArea, LeastCharge, Pareto};
