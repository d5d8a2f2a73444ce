//! Changes a pattern to a valid pattern near it.

use super::blocks;
use super::connect::connected;
use super::morphology::{closed, grown, opened};
use super::raster::RasterConstraints;
use deaflow_pattern::Bits;

/// Maximum number of repairs of widths and connections before the repair on blocks.
const ROUNDS: usize = 4;

/// Repairs cell by cell, or on blocks of the minimum width if that fails.
pub(super) fn repaired(raster: &RasterConstraints, given: &Bits) -> Option<Bits> {
    let start = raster.with_kept_in(&given.and(&raster.allowed));
    if start.is_empty() && given.is_empty() {
        return Some(given.clone());
    }
    let found = repaired_by_cells(raster, &start).or_else(|| match raster.feature {
        [1, 1] => None,
        _ => blocks::repaired(raster, &start),
    });
    found.filter(|bits| !bits.is_empty())
}

/// Repairs widths and connections in turn. `None` if this does not converge: strips may come too close to other
/// electrodes.
fn repaired_by_cells(raster: &RasterConstraints, start: &Bits) -> Option<Bits> {
    let mut bits = start.clone();
    for _ in 0..ROUNDS {
        bits = connected(raster, &with_min_widths(raster, &bits));
        if bits.is_empty() || raster.has_min_widths(&bits) {
            return (!bits.is_empty() && raster.satisfied_by(&bits)).then_some(bits);
        }
    }
    None
}

/// Closes narrow gaps and removes thin electrodes. A gap that cannot be closed is widened to the minimum width.
fn with_min_widths(raster: &RasterConstraints, bits: &Bits) -> Bits {
    let n = raster.feature;
    if n == [1; 2] || raster.has_min_widths(bits) {
        return bits.clone();
    }
    let mut bits = opened(&closed(bits, n).and(&raster.allowed), n);
    loop {
        let mut gaps = closed(&bits, n).without(&bits);
        if gaps.is_empty() {
            return bits;
        }
        let before = bits.clone();
        while bits == before {
            gaps = grown(&gaps);
            bits = opened(&raster.with_kept_in(&bits.without(&gaps)), n);
        }
    }
}
