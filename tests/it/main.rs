//! One binary for all tests of behaviour: linking is the dear part.

mod accuracy;
mod audit;
mod cli;
mod collect;
mod common;
mod golden;
mod h5py;
mod keeping;
mod layering;
mod rebuild;
mod reproducible;
mod schema;
mod screen;
mod solve;
