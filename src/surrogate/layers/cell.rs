//! Between corners and cells: what every cell sees of its neighbours and of the displacement, and the forces of its stress.
//!
//! A displacement on the four corners of a cell is a translation and three modes of each component: its derivatives along
//! x and y, and the hourglass, which has none at the centre of the cell.

use pulp::Arch;

use crate::field::CORNERS;
use crate::pattern::CELLS;

/// Corners along a side without the frame.
const INNER: usize = CORNERS - 2;
/// Cells of an image.
const AREA: usize = CELLS * CELLS;
/// Cells in the neighbourhood of a cell, itself among them.
pub(crate) const NEIGHBOURS: usize = 9;
/// Modes of the displacement on a cell: ∂u/∂x, ∂v/∂x, ∂u/∂y, ∂v/∂y and the hourglasses of u and v.
pub(crate) const MODES: usize = 6;
/// Channels of the features of a cell, what the local law of the network sees: the 3 × 3 cells around it, in rows from the lower
/// left, ±½ each and 0 outside the frame; the modes of the displacement times a factor; the same with the sign of the cell; and 1.
pub(crate) const FEATURES: usize = NEIGHBOURS + 2 * MODES + 1;

/// Signs of the modes on the corners of a cell, lower left, lower right, upper left, upper right: ∂x, ∂y, hourglass.
pub(crate) const SIGNS: [[f32; 4]; 3] = [[-1.0, 1.0, -1.0, 1.0], [-1.0, -1.0, 1.0, 1.0], [1.0, -1.0, -1.0, 1.0]];

/// Three planes of numbers, one for each mode of a component.
type Planes<'a> = [&'a mut [f32]; 3];

/// The modes of one component (49 × 49) times a factor, on all cells.
#[inline(always)]
fn modes_of(component: &[f32], factor: f32, [along, up, hourglass]: Planes<'_>) {
    let half = 0.5 * factor;
    let mut lines = [[0.0f32; CORNERS]; 2];
    for row in 0..CELLS {
        let [below, above] = &mut lines;
        std::mem::swap(below, above);
        match component.get(row * INNER..(row + 1) * INNER) {
            Some(line) => above[1..=INNER].copy_from_slice(line),
            None => above.fill(0.0),
        }
        let cells = row * CELLS..(row + 1) * CELLS;
        let (along, up, hourglass) = (&mut along[cells.clone()], &mut up[cells.clone()], &mut hourglass[cells]);
        for column in 0..CELLS {
            let (a, b) = (below[column], below[column + 1]);
            let (c, d) = (above[column], above[column + 1]);
            along[column] = half * ((b - a) + (d - c));
            up[column] = half * ((c - a) + (d - b));
            hourglass[column] = half * ((a - b) + (d - c));
        }
    }
}

/// Adds the forces of the stresses of one component, a plane for each mode, to its 49 × 49 corners.
#[inline(always)]
fn forces_of([along, up, hourglass]: [&[f32]; 3], component: &mut [f32]) {
    // Forces of a row of cells on the corners below and above it.
    let mut lines = [[0.0f32; CORNERS]; 2];
    for row in 0..CELLS {
        let cells = row * CELLS..(row + 1) * CELLS;
        let (along, up, hourglass) = (&along[cells.clone()], &up[cells.clone()], &hourglass[cells]);
        let [below, above] = &mut lines;
        above.fill(0.0);
        for column in 0..CELLS {
            let (x, y, h) = (along[column], up[column], hourglass[column]);
            below[column] += h - x - y;
            above[column] += y - x - h;
        }
        for column in 0..CELLS {
            let (x, y, h) = (along[column], up[column], hourglass[column]);
            below[column + 1] += x - y - h;
            above[column + 1] += x + y + h;
        }
        if let Some(inner) = row.checked_sub(1) {
            let line = &mut component[inner * INNER..][..INNER];
            line.iter_mut()
                .zip(&below[1..])
                .for_each(|(to, from)| *to += 0.5 * from);
        }
        std::mem::swap(below, above);
    }
}

/// The planes of the modes of a component among those of both.
#[inline(always)]
fn planes_of(modes: &mut [f32], component: usize) -> Planes<'_> {
    let (along, rest) = modes.split_at_mut(2 * AREA);
    let (up, hourglass) = rest.split_at_mut(2 * AREA);
    [along, up, hourglass].map(|planes| &mut planes[component * AREA..][..AREA])
}

/// [`planes_of`], to read.
#[inline(always)]
fn planes(modes: &[f32], component: usize) -> [&[f32]; 3] {
    [0, 1, 2].map(|mode| &modes[(2 * mode + component) * AREA..][..AREA])
}

/// The modes (6, 2500) of a displacement (2, 49, 49).
pub(crate) fn write_modes(displacement: &[f32], factor: f32, modes: &mut [f32]) {
    Arch::new().dispatch(
        #[inline(always)]
        || {
            for (k, component) in displacement.chunks_exact(INNER * INNER).enumerate() {
                modes_of(component, factor, planes_of(modes, k));
            }
        },
    );
}

/// Adds the forces of stresses (6, 2500), one for each mode, to forces (2, 49, 49): the transpose of [`write_modes`], so that
/// stresses do the work that displacements do against forces.
pub(crate) fn add_forces(stresses: &[f32], forces: &mut [f32]) {
    Arch::new().dispatch(
        #[inline(always)]
        || {
            for (k, component) in forces.chunks_exact_mut(INNER * INNER).enumerate() {
                forces_of(planes(stresses, k), component);
            }
        },
    );
}

/// The transpose of [`write_strains`]: adds to a gradient with respect to a displacement what one with respect to the features makes
/// of it. `stresses` (6, 2500) is overwritten.
pub(crate) fn add_strain_forces(
    pattern: &[f32],
    features: &[f32],
    strain: f32,
    stresses: &mut [f32],
    displacement: &mut [f32],
) {
    let (modes, signed) = features[NEIGHBOURS * AREA..].split_at(MODES * AREA);
    let planes = modes.chunks_exact(AREA).zip(signed.chunks_exact(AREA));
    for (stress, (mode, signed)) in stresses.chunks_exact_mut(AREA).zip(planes) {
        let each = stress.iter_mut().zip(mode).zip(signed).zip(pattern);
        each.for_each(|(((stress, mode), signed), p)| *stress = strain * (mode + 2.0 * p * signed));
    }
    add_forces(stresses, displacement);
}

/// Those of the features of an image (22, 2500) that do not depend on the displacement.
pub(crate) fn write_surroundings(pattern: &[f32], features: &mut [f32]) {
    let around = &mut features[..NEIGHBOURS * AREA];
    around.fill(0.0);
    neighbours(pattern, around);
    features[(FEATURES - 1) * AREA..].fill(1.0);
}

/// Those of the features of an image that do.
pub(crate) fn write_strains(pattern: &[f32], displacement: &[f32], strain: f32, features: &mut [f32]) {
    let modes = &mut features[NEIGHBOURS * AREA..];
    let (modes, signed) = modes.split_at_mut(MODES * AREA);
    write_modes(displacement, strain, modes);
    Arch::new().dispatch(
        #[inline(always)]
        || {
            for (signed, mode) in signed.chunks_exact_mut(AREA).zip(modes.chunks_exact(AREA)) {
                let each = signed.iter_mut().zip(mode).zip(pattern);
                each.for_each(|((signed, mode), p)| *signed = 2.0 * p * mode);
            }
        },
    );
}

/// The 3 × 3 cells around each cell, plane by plane.
fn neighbours(p: &[f32], around: &mut [f32]) {
    for (at, plane) in around.chunks_exact_mut(AREA).enumerate() {
        let (down, left) = (at / 3, at % 3);
        for (row, line) in plane.chunks_exact_mut(CELLS).enumerate() {
            let Some(from) = (row + down).checked_sub(1).filter(|&from| from < CELLS) else {
                continue;
            };
            let from = &p[from * CELLS..][..CELLS];
            match left {
                0 => line[1..].copy_from_slice(&from[..CELLS - 1]),
                1 => line.copy_from_slice(from),
                _ => line[..CELLS - 1].copy_from_slice(&from[1..]),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surrogate::layers::plain::{self, numbers};

    const IMAGE: usize = 2 * INNER * INNER;

    fn flat(x: &candle_core::Tensor) -> Vec<f32> {
        x.flatten_all().unwrap().to_vec1().unwrap()
    }

    fn dot(a: &[f32], b: &[f32]) -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    }

    fn modes(displacement: &[f32]) -> Vec<f32> {
        let mut modes = vec![0.0; MODES * AREA];
        write_modes(displacement, 1.0, &mut modes);
        modes
    }

    fn forces(stresses: &[f32]) -> Vec<f32> {
        let mut forces = vec![0.0; IMAGE];
        add_forces(stresses, &mut forces);
        forces
    }

    fn features(pattern: &[f32], displacement: &[f32], strain: f32) -> Vec<f32> {
        let mut features = vec![f32::NAN; FEATURES * AREA];
        write_surroundings(pattern, &mut features);
        write_strains(pattern, displacement, strain, &mut features);
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
        // Beyond the frame there are no cells, and on it nothing moves.
        assert_eq!(
            [at(0, 0, 5), at(4, 0, 5), at(5, 0, 5), at(8, 49, 49)],
            [0.0, 0.5, 0.5, 0.0]
        );
        assert_eq!(at(NEIGHBOURS, 0, 20), 10.0 * 0.5 * ((2.0 + 60.0) + (2.0 + 63.0)));
    }

    #[test]
    fn they_are_those_of_plain_operations() {
        let (p, u) = (numbers(&[1, CELLS, CELLS], 1), numbers(&[1, 2, INNER, INNER], 2));
        assert_eq!(modes(&flat(&u)), flat(&plain::modes(&u).unwrap()));
        let expected = plain::features(&p, &u, 2.0).unwrap();
        assert_eq!(expected.dims(), [1, FEATURES, AREA]);
        assert_eq!(features(&flat(&p), &flat(&u), 2.0), flat(&expected));
        let s = numbers(&[1, MODES, AREA], 5);
        assert_eq!(forces(&flat(&s)), flat(&plain::forces(&s).unwrap()));
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
        add_strain_forces(&p, &along, 2.0, &mut stresses, &mut back);
        assert_eq!(dot(&change, &along), dot(&u, &back));
    }
}
