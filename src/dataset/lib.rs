//! From solved samples to a training set: the deformation histogram, balancing, augmentation and the split; and the audit of
//! any such set.

pub mod audit;
mod balance;
mod device;
mod histogram;
pub mod import;
mod level;
mod orbits;
mod split;

pub use balance::{BalanceError, BalanceOptions, Balanced, BalancedRow, Candidate, SymmetryGroup, balance};
pub use device::{Device, is_overlong};
pub use histogram::{Bins, BinsError, Histogram, Place};
pub use split::Split;
