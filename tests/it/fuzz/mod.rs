//! Every format that is read, broken at random: read or refused, never a panic, and never long. Where there is a
//! writer, what was read and written is read as the same.
//!
//! Some hundred inputs each are tried here; CONTRIBUTING.md says how to try more. What has been found stands in
//! `corpus`, in a folder for each format, and is tried first.

mod checked;
mod documents;
mod mutate;
mod patterns;
mod store;
mod values;
