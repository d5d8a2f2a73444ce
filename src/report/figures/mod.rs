//! Figures of finished runs: what a page shows and what stands in a PNG are the same drawings. They take plain numbers and
//! know no artifacts.

mod accuracy;
mod audit;
mod curves;
mod deformation;
mod evaluation;
mod evolution;
mod histogram;
mod history;
mod membrane;
mod path;
mod response;
mod rounds;
mod training;
mod verification;

pub(crate) use accuracy::accuracy_charts;
pub(crate) use curves::curves_chart;
pub(crate) use deformation::deformation_charts;
pub(crate) use rounds::rounds_charts;

pub use super::drawing::{FigureError, Ground, Membrane};
pub use accuracy::{Cost, FamilyCosts, draw_accuracy, pareto_front};
pub use audit::{Audited, Counts, draw_audit};
pub use curves::{Curve, Curves, draw_curves};
pub use deformation::{FamilyDeformation, draw_deformation};
pub use evaluation::{Evaluated, EvaluatedPredictor, draw_evaluation};
pub use evolution::{Evolution, draw_evolution};
pub use histogram::{Histogram, draw_histogram};
pub use history::{Motion, draw_histories};
pub use membrane::{draw_membrane, membrane_drawing};
pub use path::{Branch, Limit, draw_paths};
pub use response::{Response, draw_responses};
pub use rounds::{Round, draw_rounds};
pub use training::{Training, draw_training};
pub use verification::{Case, draw_agreement, draw_gallery};

#[cfg(test)]
mod tests;
