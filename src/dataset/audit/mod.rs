//! Audit: checks a dataset against its declarations and against simulations.
//!
//! The audit reads every row once, checks its values and compares its label with a simulation. It simulates some
//! random rows on a finer mesh too. A correct dataset has no findings; the summary describes it. Memory is bounded:
//! the audit keeps some hundred bytes per row.

mod claims;
mod confidence;
mod diagnosis;
mod distribution;
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
mod symmetric;
mod values;
mod verdicts;

pub use confidence::excluded_above;
pub use diagnosis::Fault;
pub use distribution::{DeclaredBalance, Distribution};
pub use error::AuditError;
pub use finding::{EXAMPLES, Finding, Severity, sort};
pub use labels::{LabelCheck, REFERENCE, SCREEN};
pub use report::{Report, Resimulation, Summary};
pub use resimulate::Resimulated;
pub use rows::{Batch, Columns, Dataset, Discretisation, Families, NO_NUMBER, RowSource, SourceSample};
pub use run::{Options, audit, work};

#[cfg(test)]
mod tests;
