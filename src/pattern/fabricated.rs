//! Electrodes as they are made: wider than drawn, one beside the other, with holes.

use super::coverage::{Coverage, CoverageError};
use super::membrane::Membrane;
use super::parts::{Part, Parts};
use super::raster::Pattern;

/// Distances in cells that are due to rounding.
const ROUNDING: f64 = 1e-9;

/// How electrodes differ from those drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaskOffsets {
    /// By how much they are wider at each edge, mm; narrower if negative.
    pub wider_mm: f64,
    /// Where the upper electrode lies against the lower one, mm.
    pub shift_mm: [f64; 2],
}

/// A pattern as it is fabricated.
#[derive(Clone, Debug, PartialEq)]
pub enum Fabricated {
    /// The overlap of both electrodes.
    Pattern(Pattern),
    /// Electrodes of two groups touch.
    ShortCircuit,
    /// Electrodes of two groups lie in one cell, which no simulation resolves.
    SharedCell,
}

/// An electrode, made wider or narrower by a square, as a mitred offset of its edges does.
struct Layer<'a> {
    pattern: &'a Pattern,
    /// Half the side of the square in cells along x and y.
    reach: [f64; 2],
    is_wider: bool,
}

impl Layer<'_> {
    /// Returns the group at a place in cells; `None` if two groups touch there. Beyond the sides of the membrane the
    /// electrodes continue.
    fn group(&self, place: [f64; 2]) -> Option<u8> {
        let sides = self.pattern.raster().sides();
        let [x, y] = [0, 1].map(|axis| {
            let last = sides[axis] as f64 - 1.0;
            let cell = |at: f64| at.floor().clamp(0.0, last) as usize;
            cell(place[axis] - self.reach[axis])..=cell(place[axis] + self.reach[axis])
        });
        let mut group = None;
        for of_cell in y.flat_map(|y| x.clone().map(move |x| (x, y))) {
            let own = self.pattern.group(of_cell.0, of_cell.1);
            match (group, self.is_wider) {
                (None | Some(0), true) | (None, false) => group = Some(own),
                (Some(known), true) if own != 0 && own != known => return None,
                // Between two groups nothing is left of either.
                (Some(known), false) if own != known => return Some(0),
                _ => {}
            }
        }
        group
    }
}

/// Returns a pattern of whole cells as it is fabricated, without the cells in `lost`, `[y][x]`. Only free membrane has
/// electrodes that are not drawn.
///
/// # Errors
/// When shares of cells are not those of a covered pattern.
pub fn fabricated(
    pattern: &Pattern,
    parts: Option<&Parts>,
    membrane: Membrane,
    offsets: &MaskOffsets,
    lost: &[bool],
) -> Result<Fabricated, CoverageError> {
    let raster = membrane.raster;
    let [columns, rows] = raster.sides();
    let cell_mm = membrane.cell_mm();
    let layer = Layer {
        pattern,
        reach: cell_mm.map(|mm| offsets.wider_mm.abs() / mm),
        is_wider: offsets.wider_mm >= 0.0,
    };
    let shift: [f64; 2] = std::array::from_fn(|axis| offsets.shift_mm[axis] / cell_mm[axis]);
    let around = std::array::from_fn(|axis| (layer.reach[axis] + shift[axis].abs()).ceil() as usize);
    let cuts: [Vec<f64>; 2] = std::array::from_fn(|axis| cuts(layer.reach[axis], shift[axis]));
    let (mut groups, mut shares) = (vec![0; raster.cells()], vec![0.0; raster.cells()]);
    let mut is_shared = false;
    for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
        let at = y * columns + x;
        let own = pattern.group(x, y);
        let is_fixed = parts.is_some_and(|parts| parts.at(x, y) != Part::Membrane);
        if lost[at] || (own == 0 && is_fixed) {
            continue;
        }
        if is_uniform(pattern, [x, y], around) {
            groups[at] = own;
            shares[at] = f64::from(u8::from(own != 0));
            continue;
        }
        for (low_y, high_y) in intervals(&cuts[1]) {
            for (low_x, high_x) in intervals(&cuts[0]) {
                let middle = [x as f64 + 0.5 * (low_x + high_x), y as f64 + 0.5 * (low_y + high_y)];
                let above = std::array::from_fn(|axis| middle[axis] - shift[axis]);
                let (Some(lower), Some(upper)) = (layer.group(middle), layer.group(above)) else {
                    return Ok(Fabricated::ShortCircuit);
                };
                if lower == 0 || upper == 0 {
                    continue;
                }
                if lower != upper {
                    return Ok(Fabricated::ShortCircuit);
                }
                let area = (high_x - low_x) * (high_y - low_y);
                is_shared |= ![0, lower].contains(&groups[at]);
                groups[at] = lower;
                shares[at] += area;
            }
        }
    }
    if is_shared {
        return Ok(Fabricated::SharedCell);
    }
    let shares: Vec<f64> = shares.into_iter().map(|share: f64| share.min(1.0)).collect();
    Coverage::new(raster, &groups, &shares).map(|coverage| Fabricated::Pattern(Pattern::of_coverage(coverage)))
}

/// Returns whether all cells at most so many cells away are alike.
fn is_uniform(pattern: &Pattern, cell: [usize; 2], around: [usize; 2]) -> bool {
    let sides = pattern.raster().sides();
    let [mut x, y] = [0, 1].map(|axis| {
        let first = cell[axis].saturating_sub(around[axis]);
        first..=(cell[axis] + around[axis]).min(sides[axis] - 1)
    });
    let own = pattern.group(cell[0], cell[1]);
    x.all(|x| y.clone().all(|y| pattern.group(x, y) == own))
}

/// Returns where within a cell an edge of either electrode can lie, in order.
fn cuts(reach: f64, shift: f64) -> Vec<f64> {
    let edges = [reach, -reach, shift + reach, shift - reach];
    let inside = edges.map(|edge| edge.rem_euclid(1.0));
    let mut sorted: Vec<f64> = inside.into_iter().chain([0.0, 1.0]).collect();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// Returns the intervals between places, without empty ones and those that rounding makes.
fn intervals(cuts: &[f64]) -> impl Iterator<Item = (f64, f64)> {
    let all = cuts.iter().copied().zip(cuts.iter().copied().skip(1));
    all.filter(|(low, high)| high - low > ROUNDING)
}
