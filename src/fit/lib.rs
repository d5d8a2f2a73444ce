//! Least-squares fits of elastomer laws to measurements.
//!
//! A test stretches a specimen uniformly and records the nominal stress: force per undeformed area. [`fit()`] finds the
//! parameters of a law that agree best with one or several [`Curve`]s, and states how well the data determine each of
//! them. [`compare()`] ranks several laws, and [`fit_relaxation()`] and [`fit_histories()`] fit the branches of a
//! viscoelastic elastomer. Laws and parameters are those of scenes; stresses are in Pa.
//!
//! [`fit_together()`] fits parameters that sets of different kinds share: curves of stress, histories of stretch,
//! creep, sheets under voltage, and numbers or fields of displacements that the caller simulates.

mod balance;
mod branch;
mod collocation;
mod compare;
mod creep;
mod curve;
mod data_set;
mod deformation;
mod elastomer;
mod field;
mod fit;
mod history;
mod law;
mod least_squares;
mod parameter;
mod profile;
mod relaxation;
mod sheet;
mod simulation;
mod solution;
mod stability;
mod starts;
mod statistics;
#[cfg(test)]
mod tests;
mod together;
mod warning;

pub use balance::Load;
pub use branch::ViscousLaw;
pub use compare::{Candidate, compare};
pub use creep::CreepCurve;
pub use curve::{Curve, FitError, Sigma};
pub use data_set::DataSet;
pub use deformation::Test;
pub use elastomer::Elastomer;
pub use field::{Correlation, FieldData, FieldImage, FieldResult, FieldStatistics, ImageResult, Motion};
pub use fit::{CurveResiduals, Fit, Options, Outlier, Verdict, fit};
pub use history::HistoryCurve;
pub use law::{Law, LawKind, OgdenTerm};
pub use parameter::{FreeParameter, ParameterScale};
pub use relaxation::{Relaxation, RelaxationFit, fit_histories, fit_relaxation};
pub use sheet::SheetCurve;
pub use simulation::{Evaluate, NumberData, Simulated, Simulation};
pub use solution::{Estimate, Parameter, Profiles};
pub use stability::Stability;
pub use statistics::{Direction, Information};
pub use together::{JointFit, JointOptions, SetResult, fit_together, simulate};
pub use warning::Warning;
