//! Datasets: the histogram of displacements, balancing, augmentation, splits, import and audit.

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
pub use histogram::{BinIndex, Bins, BinsError, Histogram};
pub use split::Split;
