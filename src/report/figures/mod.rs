//! Figures of finished runs, as PNG files. They take plain numbers and know no artifacts.

mod accuracy;
mod agreement;
mod audit;
mod axes;
mod canvas;
mod curves;
mod deformation;
mod evaluation;
mod evolution;
mod gallery;
mod histogram;
mod labels;
mod membrane;
mod path;
mod rounds;

pub use accuracy::{Cost, FamilyCosts, draw_accuracy, pareto_front};
pub(in crate::report) use axes::Axis;
pub(in crate::report) use labels::{Labels, Spot};

pub use agreement::{Case, draw_agreement};
pub use audit::{Audited, Counts, draw_audit};
pub use canvas::FigureError;
pub use curves::{Training, draw_training};
pub use deformation::{FamilyDeformation, draw_deformation};
pub use evaluation::{Evaluated, EvaluatedPredictor, draw_evaluation};
pub use evolution::{Evolution, draw_evolution};
pub use gallery::draw_gallery;
pub use histogram::{Histogram, draw_histogram};
pub use membrane::{Membrane, draw_membrane};
pub use path::{Branch, Limit, draw_paths};
pub use rounds::{Round, draw_rounds};

#[cfg(test)]
mod tests;
