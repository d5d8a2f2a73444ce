//! Joins the pieces of a pattern, or connects them to leads, by strips of the minimum width.

use super::morphology::{dilated, eroded, met, spread};
use super::raster::RasterConstraints;
use deaflow_pattern::Bits;

/// Keeps the largest pieces that have a lead, up to the maximum number. Any other piece is joined to them, or to a
/// lead, by the shortest strip that is not larger than the piece; without such a strip it is removed. Pieces with cells
/// that are always active come first, and their strips may have any length.
pub(super) fn connected(raster: &RasterConstraints, bits: &Bits) -> Bits {
    if raster.islands.is_none() && raster.leads.is_none() {
        return bits.clone();
    }
    let most = raster.islands.unwrap_or(usize::MAX);
    let (mut kept, mut count) = (bits.without(bits), 0);
    let mut pieces = bits.components();
    pieces.sort_by_key(|piece| !raster.is_kept(piece));
    for piece in pieces {
        if spread(&piece).meets(&kept) {
            // The strip of a larger piece crosses or touches it.
            kept = kept.or(&piece);
            continue;
        }
        if count < most && raster.has_lead(&piece) {
            kept = kept.or(&piece);
            count += 1;
            continue;
        }
        let leads = raster.leads.as_ref().filter(|_| count < most);
        let Some(strip) = strip(raster, &piece, &kept, leads) else {
            continue;
        };
        if raster.is_kept(&piece) || strip.without(bits).count() <= piece.count() {
            count += usize::from(!spread(&strip).meets(&kept));
            kept = kept.or(&piece).or(&strip);
        }
    }
    kept
}

/// The shortest path of a square of the minimum width from a piece to the kept pieces or to a lead, within the allowed
/// cells.
fn strip(raster: &RasterConstraints, piece: &Bits, kept: &Bits, leads: Option<&Bits>) -> Option<Bits> {
    let n = raster.feature;
    let positions = eroded(&raster.allowed, n);
    let mut goal = eroded(kept, n);
    if let Some(leads) = leads {
        goal = goal.or(&met(leads, n).and(&positions));
    }
    let mut fronts = vec![eroded(piece, n)];
    loop {
        let last = &fronts[fronts.len() - 1];
        let arrived = last.and(&goal);
        if !arrived.is_empty() {
            return Some(dilated(&backtracked(&fronts, &arrived), n));
        }
        let next = spread(last).and(&positions).or(last);
        if next == *last {
            return None;
        }
        fronts.push(next);
    }
}

/// One of the shortest paths back through the search fronts. Ties are resolved in favour of the lowest, then leftmost
/// position.
fn backtracked(fronts: &[Bits], arrived: &Bits) -> Bits {
    let mut at = arrived.first();
    let mut path = at.clone();
    for front in fronts.iter().rev().skip(1) {
        at = spread(&at).and(front).first();
        path = path.or(&at);
    }
    path
}
