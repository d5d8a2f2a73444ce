//! Figures of finished runs: pages and PNG files have the same drawings. They are drawn from plain numbers, without
//! artifacts.

mod accuracy;
mod audit;
mod curves;
mod deformation;
mod evaluation;
mod evolution;
mod fit;
mod front;
mod histogram;
mod history;
mod measured;
mod membrane;
mod path;
mod response;
mod rounds;
mod training;
mod verification;
mod yields;

pub(crate) use accuracy::accuracy_charts;
pub(crate) use curves::curves_chart;
pub(crate) use deformation::deformation_charts;
pub(crate) use front::front_charts;
pub(crate) use membrane::membranes_charts;
pub(crate) use rounds::rounds_charts;
pub(crate) use yields::reached_chart;

pub use super::drawing::{Background, DeformedMembrane, FigureError};
pub use accuracy::{Cost, FamilyCosts, accuracy_sheet, pareto_front};
pub use audit::{AuditFigure, Counts};
pub use curves::{Curve, Curves, curves_sheet};
pub use deformation::{FamilyDeformation, deformation_sheet};
pub use evaluation::{EvaluationFigure, PredictorErrors};
pub use evolution::{Evolution, evolution_sheet};
pub use fit::{ComparedCurve, FittedCurve, compared_laws_sheet, fit_sheet};
pub use front::{FrontAxis, FrontDesign, FrontFigure, front_sheet};
pub use histogram::Histogram;
pub use history::{Motion, histories_sheet};
pub use measured::{MeasuredFigure, measured_charts, measured_sheet};
pub use membrane::{membrane_sheet, membranes_sheet};
pub use path::{Branch, FirstFailure, Limit, PathAxes, paths_sheet};
pub use response::{Response, responses_sheet};
pub use rounds::{Round, rounds_sheet};
pub use training::Training;
pub use verification::{VerifiedPattern, agreement_sheet, gallery_sheet};
pub use yields::{DesignYields, yields_sheet};

#[cfg(test)]
mod tests;
