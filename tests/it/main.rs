//! One binary for all tests of behaviour: linking is the dear part.

mod accuracy;
mod audit;
mod cli;
mod collect;
mod common;
mod damage;
mod dataset;
mod full_disk;
mod golden;
mod h5py;
mod hostile;
mod hostile_files;
mod keeping;
mod killed;
mod layering;
mod model;
mod moved;
mod read_only;
mod rebuild;
mod reproducible;
mod reuse;
mod schema;
mod screen;
mod solve;
mod training;
mod two_runs;
