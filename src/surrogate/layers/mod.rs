//! Layers of the networks: candle-nn's interfaces with own operations.

mod activate;
mod cell;
mod conv;
mod correct;
mod gemm;
mod green;
mod inner;
mod mix;
#[cfg(test)]
mod plain;
mod storage;
mod window;

pub(crate) use cell::{FEATURES, MODES, NEIGHBOURS, SIGNS};
pub(crate) use conv::{Conv2d, ConvTranspose2d};
pub(crate) use correct::{DeviceOperator, Scale, StressLaw, Workspace, correct};
pub(crate) use gemm::{Matrix, multiply};
pub(crate) use green::{Green, Supports};
pub(crate) use mix::Mixing;
