//! One presenter for each stage kind, in one table.

pub mod accuracy;
pub mod audit;
pub mod balance;
pub mod compare;
pub mod design;
pub mod evaluate;
pub mod fit;
mod front;
pub mod measure;
pub mod solve;
pub mod table;
pub mod train;
pub mod verify;
pub mod yields;

use super::html::Page;
use super::presenter::Presenter;
use deaflow_content::SOLVED;

/// All presenters, in the order of their texts at the end of a run.
pub const PRESENTERS: &[&dyn Presenter] = &[
    &evaluate::EvaluatePresenter,
    &design::DesignPresenter,
    &verify::VerifyPresenter,
    &yields::YieldPresenter,
    &train::TrainPresenter,
    &compare::ComparePresenter,
    &fit::FitPresenter,
    &measure::MeasurePresenter,
    &audit::AuditPresenter,
    &balance::BalancePresenter,
    &solve::SolvePresenter(SOLVED[0]),
    &solve::SolvePresenter(SOLVED[1]),
    &accuracy::AccuracyPresenter,
    &table::TablePresenter,
];

/// The order of the sections of a page; other kinds come last.
const PAGE_ORDER: &[&str] = &[
    "table", "verify", "yield", "design", "compare", "fit", "measure", "audit", "balance", "solve", "import", "train",
    "evaluate",
];

/// Returns all presenters in the order of their sections.
pub fn by_section() -> Vec<&'static dyn Presenter> {
    let place = |presenter: &&dyn Presenter| PAGE_ORDER.iter().position(|kind| *kind == presenter.kind());
    let mut presenters = PRESENTERS.to_vec();
    presenters.sort_by_key(|presenter| place(presenter).unwrap_or(PAGE_ORDER.len()));
    presenters
}

/// Starts the section that several kinds share.
fn dataset(page: &mut Page) {
    page.open(
        "Dataset",
        "How far the membrane moves in each sample: the largest displacement over the membrane.",
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
        assert_eq!(by_section()[13].kind(), "accuracy");
    }
}
