//! Access to the values of a tensor inside an operation.

use candle_core::{CpuStorage, Layout, Result, bail};

/// Returns the values of a contiguous f32 tensor.
pub(super) fn values<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    match layout.contiguous_offsets() {
        Some((from, to)) => Ok(&storage.as_slice::<f32>()?[from..to]),
        None => bail!("the operation needs a contiguous tensor"),
    }
}
