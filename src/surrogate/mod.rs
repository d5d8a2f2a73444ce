//! Networks that predict the displacement of a pattern, their training and their metrics.

mod encode;
mod example;
mod layers;
mod loss;
mod metrics;
mod networks;
mod optimizer;
mod options;
mod parameters;
mod predict;
mod schedule;
mod step;
#[cfg(test)]
mod testing;
mod train;
mod weights;

pub use example::Example;
pub use metrics::Metrics;
pub use networks::{Constants, NetworkKind};
pub use options::TrainOptions;
pub use predict::Surrogate;
pub use train::{EpochReport, TrainError, Trained, train};
pub use weights::LoadError;
