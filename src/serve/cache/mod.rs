//! What a server holds in memory between requests: solvers that are set up, tables of artifacts, and the run that was begun here.

mod at_work;
mod bench;
mod child;
mod judged;
mod kept;
mod table;
mod totals;

pub use at_work::at_work;
pub use bench::{Bench, Benches, Critical, Setting};
pub use child::Runner;
pub use kept::{Kept, lock};
pub use table::Tables;
pub use totals::StoreTotals;
