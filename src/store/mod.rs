//! The content-addressed store: immutable HDF5 artifacts named by the digest of what they say, records of the actions
//! that made them, locks, the check of the whole, and the collection of what nothing needs.

mod action;
mod ancestry;
mod artifact;
mod atomic;
mod checkpoint;
mod copy;
mod costs;
mod create;
mod element_type;
mod entries;
mod error;
mod fsck;
mod gc;
mod grid;
mod header;
mod history;
mod index;
mod inspect;
mod layout;
mod links;
mod listing;
mod lock;
mod lockfile;
mod logs;
mod marker;
mod marker_repair;
mod memos;
mod object;
mod open;
mod pins;
mod plain;
mod provenance;
mod quarantine;
mod reach;
mod read;
mod record;
mod row_file;
mod scales;
mod stamp;
mod standalone;
mod texts;
mod totals;
mod verified;
mod write;

pub use action::Action;
pub use ancestry::Ancestor;
pub use artifact::Artifact;
pub use checkpoint::Checkpoints;
pub use copy::Copied;
pub use costs::Cost;
pub use element_type::ElementType;
pub use error::StoreError;
pub use fsck::{Absence, Damage, Report};
pub use gc::{Collection, Judged, Retention};
pub use grid::{Grid, write_grid};
pub use history::{Command, Ended, Run, RunStage, Runs, RunsOf};
pub use inspect::{Condition, Effort};
pub use listing::Content;
pub use lock::Guard;
pub use lockfile::{LockFile, LockedStage};
pub use logs::log_name;
pub use object::{Data, Dataset, Object, ObjectError, TEXT_WIDTH};
pub use open::{Store, Stored};
pub use pins::Pin;
pub use plain::write_file;
pub use provenance::Provenance;
pub use record::{Lookup, Record};
pub use row_file::RowFile;
pub use standalone::write_standalone;
pub use totals::Totals;

#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod tests;
