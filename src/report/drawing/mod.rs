//! Drawings as SVG for pages and as PNG for figure files: charts, membranes, and sheets of several of them.

mod axis;
mod chart;
mod error;
mod labels;
mod membrane;
mod path;
mod raster;
mod sheet;
mod sides;

pub use axis::{Axis, EMPTY, extent};
pub use chart::{Chart, Colour, LARGE, LETTER, MAX_NAMED, Mark, Series, THOUSAND};
pub use error::FigureError;
pub use membrane::{Background, DeformedMembrane, direction, exaggeration, viridis};
pub use path::number;
pub use raster::{DRAWING_STYLE, PAGE_STYLE, image, with_texts};
pub use sheet::Sheet;
pub use sides::{LEGEND, described};
