//! Fronts: designs of which no other is better in all of several objectives, in place of a single one.

mod hypervolume;
mod objectives;

pub use hypervolume::{FrontPoint, hypervolume, hypervolume_of};
pub use objectives::{Cost, Front, FrontMethod, FrontObjective, LeastArea, LeastCharge, OtherObjective, Pareto};
