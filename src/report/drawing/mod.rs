//! Drawings as SVG, for pages as they are and for figures as PNG: charts, membranes, and sheets of several of them.

mod axis;
mod chart;
mod error;
mod labels;
mod membrane;
mod path;
mod raster;
mod sheet;

pub use axis::Axis;
pub use chart::{Chart, Colour, Mark, Series, THOUSAND};
pub use error::FigureError;
pub use membrane::{Ground, Membrane, direction, exaggeration, viridis};
pub use path::number;
pub use raster::{DRAWING_STYLE, PAGE_STYLE, with_texts};
pub use sheet::Sheet;
