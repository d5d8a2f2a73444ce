//! Displacements measured at scattered points, as by digital image correlation.

mod correlation;
mod image;
mod model;
mod motion;
mod statistics;

pub use correlation::Correlation;
pub use image::FieldImage;
pub(crate) use model::{CorrelatedNoise, FieldModel};
pub use model::{FieldData, FieldResult};
pub use motion::Motion;
pub use statistics::{FieldStatistics, ImageResult};
