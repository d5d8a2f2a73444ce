//! The content of the artifacts of each kind: path, unit, axes and description of every array.
//!
//! Each kind has a struct, which one macro declares, writes as an object of the store and reads back. A view reads
//! single arrays, which may be too large to be read together. Opening an artifact checks the lengths along shared axes.

mod attribute;
mod declared;
mod element;
mod error;
mod macros;
mod part;
mod view;
mod writer;

mod accuracy;
mod audit;
mod balanced;
mod calibration;
mod catalogue;
mod designs;
mod dropped;
mod evaluation;
mod frequency_responses;
mod fronts;
mod histories;
mod inflation_paths;
mod inflations;
mod intervals;
mod kind;
mod labelled;
mod load_paths;
mod measured;
mod observations;
mod patterns;
mod quantities;
mod rank;
mod samples;
mod solutions;
mod solve_file;
mod table;
mod training;
mod vibrations;
mod yields;

#[cfg(test)]
mod tests;

pub use accuracy::{Accuracy, FamilyErrors, Mismatches, PatternErrors, ReferenceErrors};
pub use attribute::{Attribute, Json, Lines};
pub use audit::{AreaHistogram, Audit, DisplacementHistogram, ResimulatedRows, WrongRows};
pub use balanced::{BalanceCounts, Balanced, BalancedView, Histograms};
pub use calibration::{Calibration, CalibrationView, Difficulty, Novelty};
pub use catalogue::{ContentOfKind, catalogue};
pub use declared::Declared;
pub use designs::{
    Candidates, Components, DesignRows, DesignRowsView, Designs, DesignsView, GENOME_UNITS, GradientSteps,
    HeightChanges, History, PredictedStates, SimulatedStates, Verification, VerificationView, predicted_rows,
};
pub use dropped::DroppedRows;
pub use element::{Packed, PerCell, PerUnit, Row, SingleField};
pub use error::{AttributeError, ElementError, Fault};
pub use evaluation::{Coverage, CoverageView, Evaluation, PatternScores, Scores};
pub use frequency_responses::FrequencyResponses;
pub use fronts::{FrontObjectives, FrontObjectivesView, Fronts, FrontsView};
pub use histories::Histories;
pub use inflation_paths::InflationPaths;
pub use inflations::Inflations;
pub use intervals::{DesignInterval, DesignIntervals, ObjectiveIntervals, PredictionIntervals};
pub use kind::ArtifactKind;
pub use labelled::Labelled;
pub use load_paths::LoadPaths;
pub use measured::{
    ComparedEffects, ComparedFiles, ComparedFilesView, ComparedRows, ComparedRowsView, Comparison, FitCandidates,
    FittedParameters, FittedParametersView, FittedScene, MeasuredFiles, MeasuredRows, Measurements,
};
pub use observations::{Meshes, NO_STATE, Observations, rotations, translations};
pub use part::LongTexts;
pub use patterns::named_patterns;
pub use quantities::{MeasuredQuantity, Quantities};
pub use rank::{DesignRank, best_design, best_of_targets, is_met};
pub use samples::{CoveredCells, DrawnElectrodes, FROM_FILE, SAMPLED, SampleRows, Samples};
pub use solutions::{SOLVED, Solutions, SolutionsView, SolvedHistories, Unstable};
pub use solve_file::{CellFields, SolveFile};
pub use table::Table;
pub use training::{ALL_FAMILIES, Curves, LeftOutLabels, Metrics, Training};
pub use vibrations::Vibrations;
pub use view::{Stored, StoredAttribute, files};
pub use yields::{DesignDevices, DeviceBatches, DeviceBatchesView, Yields, YieldsView};
