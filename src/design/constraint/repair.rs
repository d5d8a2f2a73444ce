//! A pattern nearby that keeps the constraints.

use super::blocks;
use super::morphology::{closed, components, dilated, eroded, grown, met, opened, spread};
use super::raster::RasterConstraints;
use deaflow_pattern::Bits;

/// How often widths and connections are mended in turn before it is done on blocks instead.
const ROUNDS: usize = 4;

/// What mending cell by cell gives, or on blocks of the least width where that fails.
pub(super) fn repaired(raster: &RasterConstraints, given: &Bits) -> Option<Bits> {
    let start = given.and(&raster.allowed);
    if given.is_empty() {
        return Some(given.clone());
    }
    let by_cells = mended(raster, &start);
    let found = by_cells.or_else(|| match raster.feature {
        [1, 1] => None,
        _ => blocks::repaired(raster, &start),
    });
    found.filter(|bits| !bits.is_empty())
}

/// Mends widths and connections in turn; none where that does not end, as strips may come too near to other electrodes.
fn mended(raster: &RasterConstraints, start: &Bits) -> Option<Bits> {
    let mut bits = start.clone();
    for _ in 0..ROUNDS {
        bits = connected(raster, &regular(raster, &bits));
        if bits.is_empty() || raster.is_regular(&bits) {
            return (!bits.is_empty() && raster.holds(&bits)).then_some(bits);
        }
    }
    None
}

/// Closes narrow gaps and removes thin electrodes. A gap that cannot be closed so is widened until it is wide enough.
fn regular(raster: &RasterConstraints, bits: &Bits) -> Bits {
    let n = raster.feature;
    if n == [1; 2] || raster.is_regular(bits) {
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
            bits = opened(&bits.without(&gaps), n);
        }
    }
}

/// Keeps the largest pieces, led out and as many as allowed; joins another one, or leads it out, by the shortest strip that is
/// not larger than the piece, and drops it where there is none.
pub(super) fn connected(raster: &RasterConstraints, bits: &Bits) -> Bits {
    if raster.islands.is_none() && raster.leads.is_none() {
        return bits.clone();
    }
    let most = raster.islands.unwrap_or(usize::MAX);
    let (mut kept, mut count) = (bits.without(bits), 0);
    for piece in components(bits) {
        if spread(&piece).meets(&kept) {
            // A strip of a larger piece has gone through it or along it.
            kept = kept.or(&piece);
            continue;
        }
        if count < most && raster.is_led(&piece) {
            kept = kept.or(&piece);
            count += 1;
            continue;
        }
        let leads = raster.leads.as_ref().filter(|_| count < most);
        let Some(strip) = strip(raster, &piece, &kept, leads) else {
            continue;
        };
        if strip.without(bits).count() <= piece.count() {
            count += usize::from(!spread(&strip).meets(&kept));
            kept = kept.or(&piece).or(&strip);
        }
    }
    kept
}

/// The shortest way of a square of the least width from a piece to what is kept or to a lead, through the room.
fn strip(raster: &RasterConstraints, piece: &Bits, kept: &Bits, leads: Option<&Bits>) -> Option<Bits> {
    let n = raster.feature;
    let places = eroded(&raster.allowed, n);
    let mut goal = eroded(kept, n);
    if let Some(leads) = leads {
        goal = goal.or(&met(leads, n).and(&places));
    }
    let mut waves = vec![eroded(piece, n)];
    loop {
        let last = &waves[waves.len() - 1];
        let arrived = last.and(&goal);
        if !arrived.is_empty() {
            return Some(dilated(&way(&waves, &arrived), n));
        }
        let next = spread(last).and(&places).or(last);
        if next == *last {
            return None;
        }
        waves.push(next);
    }
}

/// One of the shortest ways back through the waves from where they arrived: from the lowest, then leftmost place, always to
/// the lowest, then leftmost one of the wave before.
fn way(waves: &[Bits], arrived: &Bits) -> Bits {
    let mut at = arrived.first();
    let mut way = at.clone();
    for wave in waves.iter().rev().skip(1) {
        at = spread(&at).and(wave).first();
        way = way.or(&at);
    }
    way
}
