//! The audit: whether a dataset is what it says it is.
//!
//! Every row is read once, checked for values that cannot be, and its label compared with a simulation; some random rows
//! are simulated on a finer mesh too. A sound dataset gives no finding; what only describes it stands in the summary.
//! Memory is bounded: of a row some hundred bytes are kept.

mod claims;
mod confidence;
mod diagnosis;
mod error;
mod facts;
mod finding;
mod identify;
mod images;
mod kinds;
mod labels;
mod recheck;
mod report;
mod resimulate;
mod rows;
mod run;
mod spread;
mod symmetric;
mod values;
mod verdicts;

pub use claims::{Families, Origin};
pub use confidence::excluded_above;
pub use diagnosis::Fault;
pub use error::AuditError;
pub use finding::{EXAMPLES, Finding, Severity, sort};
pub use labels::{LabelCheck, REFERENCE, SCREEN};
pub use report::{Report, Resimulation, Summary};
pub use resimulate::Resimulated;
pub use rows::{Batch, Columns, Dataset, Discretisation, NO_NUMBER, RowSource};
pub use run::{Options, audit};
pub use spread::{Level, Spread};

#[cfg(test)]
mod tests;
