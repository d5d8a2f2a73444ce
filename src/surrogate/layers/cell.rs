//! Maps between corners and cells: the features of a cell from its neighbours and the displacement, and the forces of
//! its stress.
//!
//! A displacement of the four corners of a cell is a translation and three modes of each component: the derivatives
//! along x and y, and the hourglass mode, whose derivatives vanish at the centre of the cell.

use crate::corners::inner_corners;
use deaflow_fem::registers::dispatch;
use deaflow_pattern::Raster;

/// Largest number of corners in a row.
const MAX_CORNERS: usize = Raster::MOST + 1;
/// Cells in the neighbourhood of a cell, including itself.
pub(crate) const NEIGHBOURS: usize = 9;
/// Modes of the displacement on a cell: ∂u/∂x, ∂v/∂x, ∂u/∂y, ∂v/∂y and the hourglasses of u and v.
pub(crate) const MODES: usize = 6;
/// Features of a cell, the input of the local law: the 3 × 3 cells around it in rows from the lower left, ±½ each and 0
/// outside the raster; the modes of the displacement times a factor; the same with the sign of the cell; and 1.
pub(crate) const FEATURES: usize = NEIGHBOURS + 2 * MODES + 1;

/// Signs of the modes on the corners of a cell, lower left, lower right, upper left, upper right: ∂x, ∂y, hourglass.
pub(crate) const SIGNS: [[f32; 4]; 3] = [[-1.0, 1.0, -1.0, 1.0], [-1.0, -1.0, 1.0, 1.0], [1.0, -1.0, -1.0, 1.0]];

/// Three planes of values, one for each mode of a component.
type Planes<'a> = [&'a mut [f32]; 3];

/// Runs a kernel with the vector instructions of the machine. The compiler specialises it for the paper's raster.
#[inline(always)]
fn dispatch_on(raster: Raster, kernel: impl FnOnce(Raster)) {
    dispatch(
        #[inline(always)]
        || match raster {
            Raster::PAPER => kernel(Raster::PAPER),
            other => kernel(other),
        },
    );
}

/// Computes the modes of one component, given at the inner corners, times a factor on all cells.
#[inline(always)]
fn modes_of(raster: Raster, component: &[f32], factor: f32, [along, up, hourglass]: Planes<'_>) {
    let [columns, rows] = raster.sides();
    let (half, inner) = (0.5 * factor, columns - 1);
    let mut lines = [[0.0f32; MAX_CORNERS]; 2];
    let [below, above] = &mut lines;
    let (mut below, mut above) = (&mut below[..=columns], &mut above[..=columns]);
    for row in 0..rows {
        std::mem::swap(&mut below, &mut above);
        match component.get(row * inner..(row + 1) * inner) {
            Some(line) => above[1..columns].copy_from_slice(line),
            None => above.fill(0.0),
        }
        let cells = row * columns..(row + 1) * columns;
        let (along, up, hourglass) = (&mut along[cells.clone()], &mut up[cells.clone()], &mut hourglass[cells]);
        for column in 0..columns {
            let (a, b) = (below[column], below[column + 1]);
            let (c, d) = (above[column], above[column + 1]);
            along[column] = half * ((b - a) + (d - c));
            up[column] = half * ((c - a) + (d - b));
            hourglass[column] = half * ((a - b) + (d - c));
        }
    }
}

/// Adds the forces of the stresses of one component, a plane for each mode, at its inner corners.
#[inline(always)]
fn forces_of(raster: Raster, [along, up, hourglass]: [&[f32]; 3], component: &mut [f32]) {
    let [columns, rows] = raster.sides();
    let inner = columns - 1;
    // Forces of a row of cells on the corners below and above it.
    let mut lines = [[0.0f32; MAX_CORNERS]; 2];
    let [below, above] = &mut lines;
    let (mut below, mut above) = (&mut below[..=columns], &mut above[..=columns]);
    for row in 0..rows {
        let cells = row * columns..(row + 1) * columns;
        let (along, up, hourglass) = (&along[cells.clone()], &up[cells.clone()], &hourglass[cells]);
        above.fill(0.0);
        for column in 0..columns {
            let (x, y, h) = (along[column], up[column], hourglass[column]);
            below[column] += h - x - y;
            above[column] += y - x - h;
        }
        for column in 0..columns {
            let (x, y, h) = (along[column], up[column], hourglass[column]);
            below[column + 1] += x - y - h;
            above[column + 1] += x + y + h;
        }
        if let Some(line) = row.checked_sub(1) {
            let line = component[line * inner..][..inner].iter_mut();
            line.zip(&below[1..]).for_each(|(to, from)| *to += 0.5 * from);
        }
        std::mem::swap(&mut below, &mut above);
    }
}

/// Returns the planes of the modes of a component.
#[inline(always)]
fn planes_of(area: usize, modes: &mut [f32], component: usize) -> Planes<'_> {
    let (along, rest) = modes.split_at_mut(2 * area);
    let (up, hourglass) = rest.split_at_mut(2 * area);
    [along, up, hourglass].map(|planes| &mut planes[component * area..][..area])
}

/// Returns the planes of [`planes_of`], read-only.
#[inline(always)]
fn planes(area: usize, modes: &[f32], component: usize) -> [&[f32]; 3] {
    [0, 1, 2].map(|mode| &modes[(2 * mode + component) * area..][..area])
}

/// Writes the modes (6, cells) of a displacement (2, inner corners).
pub(crate) fn write_modes(raster: Raster, displacement: &[f32], factor: f32, modes: &mut [f32]) {
    dispatch_on(
        raster,
        #[inline(always)]
        |raster| {
            for (k, component) in displacement.chunks_exact(inner_corners(raster)).enumerate() {
                modes_of(raster, component, factor, planes_of(raster.cells(), modes, k));
            }
        },
    );
}

/// Adds the forces of stresses (6, cells), one for each mode, to forces (2, inner corners). It is the transpose of
/// [`write_modes`], so the work of the stresses equals that of the forces.
pub(crate) fn add_forces(raster: Raster, stresses: &[f32], forces: &mut [f32]) {
    dispatch_on(
        raster,
        #[inline(always)]
        |raster| {
            for (k, component) in forces.chunks_exact_mut(inner_corners(raster)).enumerate() {
                forces_of(raster, planes(raster.cells(), stresses, k), component);
            }
        },
    );
}

/// Adds a gradient with respect to the features to the gradient with respect to the displacement: the transpose of
/// [`write_strains`]. `stresses` (6, cells) is overwritten.
pub(crate) fn add_strain_forces(
    raster: Raster,
    pattern: &[f32],
    features: &[f32],
    strain: f32,
    stresses: &mut [f32],
    displacement: &mut [f32],
) {
    let area = raster.cells();
    let (modes, signed) = features[NEIGHBOURS * area..].split_at(MODES * area);
    let planes = modes.chunks_exact(area).zip(signed.chunks_exact(area));
    for (stress, (mode, signed)) in stresses.chunks_exact_mut(area).zip(planes) {
        let each = stress.iter_mut().zip(mode).zip(signed).zip(pattern);
        each.for_each(|(((stress, mode), signed), p)| *stress = strain * (mode + 2.0 * p * signed));
    }
    add_forces(raster, stresses, displacement);
}

/// Writes the features (22, cells) that do not depend on the displacement.
pub(crate) fn write_surroundings(raster: Raster, pattern: &[f32], features: &mut [f32]) {
    let area = raster.cells();
    let around = &mut features[..NEIGHBOURS * area];
    around.fill(0.0);
    neighbours(raster, pattern, around);
    features[(FEATURES - 1) * area..].fill(1.0);
}

/// Writes the features (22, cells) that depend on the displacement.
pub(crate) fn write_strains(raster: Raster, pattern: &[f32], displacement: &[f32], strain: f32, features: &mut [f32]) {
    let area = raster.cells();
    let modes = &mut features[NEIGHBOURS * area..];
    let (modes, signed) = modes.split_at_mut(MODES * area);
    write_modes(raster, displacement, strain, modes);
    dispatch(
        #[inline(always)]
        || {
            for (signed, mode) in signed.chunks_exact_mut(area).zip(modes.chunks_exact(area)) {
                let each = signed.iter_mut().zip(mode).zip(pattern);
                each.for_each(|((signed, mode), p)| *signed = 2.0 * p * mode);
            }
        },
    );
}

/// Writes the 3 × 3 cells around each cell, plane by plane.
fn neighbours(raster: Raster, p: &[f32], around: &mut [f32]) {
    let [columns, rows] = raster.sides();
    for (at, plane) in around.chunks_exact_mut(raster.cells()).enumerate() {
        let (down, left) = (at / 3, at % 3);
        for (row, line) in plane.chunks_exact_mut(columns).enumerate() {
            let Some(from) = (row + down).checked_sub(1).filter(|&from| from < rows) else {
                continue;
            };
            let from = &p[from * columns..][..columns];
            match left {
                0 => line[1..].copy_from_slice(&from[..columns - 1]),
                1 => line.copy_from_slice(from),
                _ => line[..columns - 1].copy_from_slice(&from[1..]),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::plain::{self, numbers};
    use deaflow_field::CORNERS;
    use deaflow_pattern::CELLS;

    const INNER: usize = CORNERS - 2;
    const AREA: usize = CELLS * CELLS;
    const IMAGE: usize = 2 * INNER * INNER;

    fn flat(x: &candle_core::Tensor) -> Vec<f32> {
        x.flatten_all().unwrap().to_vec1().unwrap()
    }

    fn dot(a: &[f32], b: &[f32]) -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    }

    fn modes(displacement: &[f32]) -> Vec<f32> {
        let mut modes = vec![0.0; MODES * AREA];
        write_modes(Raster::PAPER, displacement, 1.0, &mut modes);
        modes
    }

    fn forces(stresses: &[f32]) -> Vec<f32> {
        let mut forces = vec![0.0; IMAGE];
        add_forces(Raster::PAPER, stresses, &mut forces);
        forces
    }

    fn features(pattern: &[f32], displacement: &[f32], strain: f32) -> Vec<f32> {
        let mut features = vec![f32::NAN; FEATURES * AREA];
        write_surroundings(Raster::PAPER, pattern, &mut features);
        write_strains(Raster::PAPER, pattern, displacement, strain, &mut features);
        features
    }

    #[test]
    fn a_bilinear_displacement_has_the_modes_of_its_derivatives() {
        // u = 2x + 3y, v = x·y in cells, on the inner corners: corner (i, j) stands at (i + 1, j + 1).
        let value = |at: usize| {
            let (x, y) = ((at % INNER + 1) as f32, (at / INNER % INNER + 1) as f32);
            if at / (INNER * INNER) == 0 {
                2.0 * x + 3.0 * y
            } else {
                x * y
            }
        };
        let u: Vec<f32> = (0..IMAGE).map(value).collect();
        let found = features(&[0.5; AREA], &u, 10.0);
        let at = |channel: usize, x: usize, y: usize| found[channel * AREA + y * CELLS + x];
        let (x, y) = (7, 20);
        let modes = [20.0, 10.0 * 20.5, 30.0, 10.0 * 7.5, 0.0, 5.0];
        for (mode, expected) in modes.into_iter().enumerate() {
            assert_eq!(at(NEIGHBOURS + mode, x, y), expected, "{mode}");
            assert_eq!(at(NEIGHBOURS + MODES + mode, x, y), expected, "{mode}");
        }
        assert_eq!(at(FEATURES - 1, x, y), 1.0);
        // Outside the raster there are no cells, and the edges do not move.
        assert_eq!(
            [at(0, 0, 5), at(4, 0, 5), at(5, 0, 5), at(8, 49, 49)],
            [0.0, 0.5, 0.5, 0.0]
        );
        assert_eq!(at(NEIGHBOURS, 0, 20), 10.0 * 0.5 * ((2.0 + 60.0) + (2.0 + 63.0)));
    }

    #[test]
    fn they_equal_plain_operations() {
        let (p, u) = (numbers(&[1, CELLS, CELLS], 1), numbers(&[1, 2, INNER, INNER], 2));
        assert_eq!(modes(&flat(&u)), flat(&plain::modes(&u).unwrap()));
        let expected = plain::features(&p, &u, 2.0).unwrap();
        assert_eq!(expected.dims(), [1, FEATURES, AREA]);
        assert_eq!(features(&flat(&p), &flat(&u), 2.0), flat(&expected));
        let s = numbers(&[1, MODES, AREA], 5);
        assert_eq!(forces(&flat(&s)), flat(&plain::forces(Raster::PAPER, &s).unwrap()));
    }

    #[test]
    fn forces_are_the_transpose_of_the_modes() {
        let (u, s) = (flat(&numbers(&[IMAGE], 1)), flat(&numbers(&[MODES * AREA], 2)));
        assert_eq!(dot(&modes(&u), &s), dot(&u, &forces(&s)));
    }

    #[test]
    fn forces_of_strains_are_the_transpose_of_strains() {
        let (p, u) = (flat(&numbers(&[AREA], 1)), flat(&numbers(&[IMAGE], 2)));
        let along = flat(&numbers(&[FEATURES * AREA], 3));
        let (at, still) = (features(&p, &u, 2.0), features(&p, &[0.0; IMAGE], 2.0));
        let change: Vec<f32> = at.iter().zip(&still).map(|(a, b)| a - b).collect();
        let (mut back, mut stresses) = (vec![0.0; IMAGE], vec![0.0; MODES * AREA]);
        add_strain_forces(Raster::PAPER, &p, &along, 2.0, &mut stresses, &mut back);
        assert_eq!(dot(&change, &along), dot(&u, &back));
    }
}
