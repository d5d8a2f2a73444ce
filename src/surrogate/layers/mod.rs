//! The layers that networks are built from.

mod activate;
mod conv;
mod gemm;
mod mix;
mod storage;
mod window;

pub(crate) use activate::{add_bias, bias_and_activate};
pub(crate) use conv::{convolve, convolve_transposed};
pub(crate) use gemm::{Matrix, multiply};
pub(crate) use mix::mix;
