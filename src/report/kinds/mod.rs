//! One presenter for each stage kind, in one table.

pub mod accuracy;
pub mod audit;
pub mod balance;
pub mod design;
pub mod evaluate;
pub mod solve;
pub mod table;
pub mod train;
pub mod verify;

use super::html::Page;
use super::presenter::Presenter;
use deaflow_content::SOLVED;

/// All presenters, in the order of what they say at the end of a run.
pub const PRESENTERS: &[&dyn Presenter] = &[
    &evaluate::Evaluate,
    &design::Design,
    &verify::Verify,
    &train::Train,
    &audit::Audit,
    &balance::Balance,
    &solve::Solve(SOLVED[0]),
    &solve::Solve(SOLVED[1]),
    &accuracy::Accuracy,
    &table::Table,
];

/// The kinds that have sections of a page, in the order of these; kinds that are not among them come last.
const PAGE_ORDER: &[&str] = &[
    "table", "verify", "design", "audit", "balance", "solve", "import", "train", "evaluate",
];

/// All presenters, in the order of their sections.
pub fn by_section() -> Vec<&'static dyn Presenter> {
    let place = |presenter: &&dyn Presenter| PAGE_ORDER.iter().position(|kind| *kind == presenter.kind());
    let mut presenters = PRESENTERS.to_vec();
    presenters.sort_by_key(|presenter| place(presenter).unwrap_or(PAGE_ORDER.len()));
    presenters
}

/// Opens the section that several kinds share.
fn dataset(page: &mut Page) {
    page.open(
        "Dataset",
        "How far the membrane moves in each sample: the largest displacement of the pattern.",
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_one_presenter_and_one_place_on_the_page() {
        let mut kinds = PRESENTERS.iter().map(|presenter| presenter.kind()).collect::<Vec<_>>();
        kinds.sort_unstable();
        kinds.dedup();
        assert_eq!(kinds.len(), PRESENTERS.len());
        assert!(PAGE_ORDER.iter().all(|kind| kinds.contains(kind)));
        assert_eq!(by_section()[0].kind(), "table");
        assert_eq!(by_section()[9].kind(), "accuracy");
    }
}
