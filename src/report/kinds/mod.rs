//! One presenter for each stage kind.

pub mod accuracy;
pub mod audit;
pub mod balance;
pub mod design;
pub mod evaluate;
pub mod solve;
pub mod train;
pub mod verify;

use super::html::Page;

/// Opens the section that several kinds share.
fn dataset(page: &mut Page) {
    page.open(
        "Dataset",
        "How far the membrane moves in each sample: the largest displacement of the pattern.",
    );
}
