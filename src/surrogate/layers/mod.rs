//! The layers that networks are built from.

mod activate;
mod cell;
mod channels;
mod conv;
mod correct;
mod gemm;
mod green;
mod mix;
mod storage;
mod window;

pub(crate) use activate::{add_bias, bias_and_activate};
pub(crate) use cell::{FEATURES, MODES, NEIGHBOURS, SIGNS, features, forces};
pub(crate) use channels::{map_channels, multiply_halves};
pub(crate) use conv::{convolve, convolve_transposed};
pub(crate) use correct::{Law, Scale, Workspace, correct};
pub(crate) use gemm::{Matrix, multiply};
pub(crate) use green::{green, green_tables};
pub(crate) use mix::mix;
