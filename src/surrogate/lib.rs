//! Surrogates: networks that predict the displacement field of a pattern; their training, metrics and calibration.

mod calibration;
mod checkpoint;
mod corners;
mod encode;
mod evaluation;
mod example;
mod examples;
mod header;
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
mod plausibility;
mod predict;
mod scene_check;
mod schedule;
mod step;
#[cfg(test)]
mod testing;
mod train;
mod warm_start;
mod weights;

pub use calibration::{
    COVERAGE, Calibration, CalibrationError, CalibrationParts, CalibrationSample, DifficultyParts, FALSE_ALARM,
    Interval, MIN_PATTERNS, NoveltyParts, ObjectiveIntervals,
};
pub use corners::{Corners, HeldSides};
pub use evaluation::{Coverage, OBJECTIVES, PatternScore, RowScores, Score, Scorer};
pub use example::{Example, Label, LabelError};
pub use examples::{Collector, Examples, LabelledRow, LeftOut, LeftOutReason, NoExamples, RowKind, SPLIT_SEED};
pub use header::TrainingRecord;
pub use metrics::Metrics;
pub use monitor::Monitor;
pub use networks::{Constants, ConstantsError, NetworkKind};
pub use options::{OptimizerKind, TrainOptions};
pub use outcome::{Ending, EpochReport, TrainError, Trained};
pub use predict::Surrogate;
pub use scene_check::SceneError;
pub use train::{train, update};
pub use weights::{LoadError, annotated};
