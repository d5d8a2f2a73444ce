//! Random changes of inputs in every format: an input is read or rejected in short time, without a panic. If the
//! program also writes the format, what it read and wrote must be read as the same value.
//!
//! Some hundred inputs of each format are tried; CONTRIBUTING.md shows how to try more. Inputs that found a bug are in
//! `corpus`, with a folder for each format, and are tried first.

mod checked;
mod documents;
mod mutate;
mod patterns;
mod store;
mod values;
