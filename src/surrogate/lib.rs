//! Networks that predict the displacement of a pattern, their training and their metrics.

mod calibration;
mod checkpoint;
mod encode;
mod evaluation;
mod example;
mod examples;
mod header;
mod labels;
mod layers;
mod loss;
mod metrics;
mod monitor;
mod networks;
mod onnx;
mod optimizer;
mod options;
mod outcome;
mod parameters;
mod predict;
mod schedule;
mod start;
mod step;
#[cfg(test)]
mod testing;
mod train;
mod trained_for;
mod weights;

pub use calibration::{
    COVERAGE, Calibration, CalibrationError, CalibrationParts, DifficultyParts, FALSE_ALARM, Interval, LEAST,
    NoveltyParts, ObjectiveIntervals, Observed,
};
pub use evaluation::{Coverage, Judge, Judged, OBJECTIVES, PatternScore, Score};
pub use example::{Example, Label, LabelError};
pub use examples::{Collector, Examples, LabelledRow, LeftOut, NoExamples, Origin, SPLIT_SEED, Why};
pub use header::Record;
pub use labels::{Implausible, implausible};
pub use metrics::Metrics;
pub use monitor::Monitor;
pub use networks::{Constants, ConstantsError, NetworkKind};
pub use options::{OptimizerKind, TrainOptions};
pub use outcome::{Ending, EpochReport, TrainError, Trained};
pub use predict::Surrogate;
pub use train::{train, update};
pub use trained_for::SceneError;
pub use weights::{LoadError, annotated};
