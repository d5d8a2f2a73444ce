//! The kinds of stages, one file each: declared parameters, key, and one call into a domain crate.

pub mod accuracy;
pub mod audit;
mod balance;
pub mod calibrate;
mod compare;
mod design;
pub mod designs;
pub mod direct;
mod drive_check;
mod evaluate;
mod files;
mod fit;
mod import;
mod labelled;
mod measure;
pub mod measured;
mod model;
mod needed;
mod patterns;
mod registry;
mod results;
mod sample;
mod scene;
pub mod solution;
mod solve;
mod table;
mod train;
mod verify;
mod without;
mod yields;

pub use drive_check::weak_drive_warning;
pub use registry::registry;
pub use results::{unit as result_unit, words_of as result_words};
