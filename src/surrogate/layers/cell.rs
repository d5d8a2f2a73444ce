//! Between corners and cells: what every cell sees of its neighbours and of the displacement, and the forces of its stress.
//!
//! A displacement on the four corners of a cell is a translation and three modes of each component: its derivatives along
//! x and y, and the hourglass, which has none at the centre of the cell.

use candle_core::{CpuStorage, CustomOp1, CustomOp2, Layout, Result, Shape, Tensor, bail};
use pulp::Arch;

use super::storage::values;
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
/// Channels of [`features`].
pub(crate) const FEATURES: usize = NEIGHBOURS + 2 * MODES + 1;

/// Signs of the modes on the corners of a cell, lower left, lower right, upper left, upper right: ∂x, ∂y, hourglass.
pub(crate) const SIGNS: [[f32; 4]; 3] = [[-1.0, 1.0, -1.0, 1.0], [-1.0, -1.0, 1.0, 1.0], [1.0, -1.0, -1.0, 1.0]];

/// What the local law of the network sees of patterns (n, 50, 50), ±½ per cell, and displacements (n, 2, 49, 49) on the inner
/// corners: the 3 × 3 cells around each cell, in rows from the lower left, 0 outside the frame; the modes of the
/// displacement times `strain`; the same with the sign of the cell; and 1. The result is (n, 22, 2500).
pub(crate) fn features(patterns: &Tensor, displacement: &Tensor, strain: f64) -> Result<Tensor> {
    if displacement.device().is_cpu() {
        let strain = strain as f32;
        return displacement.contiguous()?.apply_op2(patterns, Features { strain });
    }
    composed_features(patterns, displacement, strain)
}

/// The forces on the inner corners, (n, 2, 49, 49), of stresses (n, 6, 2500), one for each mode: the transpose of the modes, so
/// that stresses do the work that displacements do against forces.
pub(crate) fn forces(stresses: &Tensor) -> Result<Tensor> {
    if stresses.device().is_cpu() {
        return stresses.contiguous()?.apply_op1(Forces);
    }
    composed_forces(stresses)
}

/// [`features`] from candle's operations, for devices other than the CPU.
fn composed_features(patterns: &Tensor, displacement: &Tensor, strain: f64) -> Result<Tensor> {
    let n = patterns.dim(0)?;
    let padded = patterns.pad_with_zeros(1, 1, 1)?.pad_with_zeros(2, 1, 1)?;
    let mut channels = Vec::with_capacity(FEATURES);
    for at in 0..NEIGHBOURS {
        let shifted = padded.narrow(1, at / 3, CELLS)?.narrow(2, at % 3, CELLS)?;
        channels.push(shifted.reshape((n, 1, AREA))?);
    }
    let modes = (composed_modes(displacement)? * strain)?;
    let sign = (patterns.reshape((n, 1, AREA))? * 2.0)?;
    let signed = modes.broadcast_mul(&sign)?;
    channels.extend([modes, signed, sign.ones_like()?]);
    Tensor::cat(&channels, 1)
}

/// [`forces`] from candle's operations, for devices other than the CPU.
fn composed_forces(stresses: &Tensor) -> Result<Tensor> {
    let n = stresses.dim(0)?;
    let stresses = stresses.reshape((n, 3, 2, CELLS, CELLS))?;
    let at_corner = |corner: usize| -> Result<Tensor> {
        let mut sum = Tensor::zeros((n, 2, CELLS, CELLS), stresses.dtype(), stresses.device())?;
        for (mode, signs) in SIGNS.iter().enumerate() {
            sum = (sum + (stresses.narrow(1, mode, 1)?.squeeze(1)? * f64::from(signs[corner] / 2.0))?)?;
        }
        let (row, column) = (corner / 2, corner % 2);
        sum.pad_with_zeros(2, row, 1 - row)?
            .pad_with_zeros(3, column, 1 - column)
    };
    let all = (((at_corner(0)? + at_corner(1)?)? + at_corner(2)?)? + at_corner(3)?)?;
    all.narrow(2, 1, INNER)?.narrow(3, 1, INNER)
}

/// The modes of displacements from candle's operations, for devices other than the CPU: (n, 6, 2500).
fn composed_modes(displacement: &Tensor) -> Result<Tensor> {
    let n = displacement.dim(0)?;
    let padded = displacement.pad_with_zeros(2, 1, 1)?.pad_with_zeros(3, 1, 1)?;
    let corner = |at: usize| padded.narrow(2, at / 2, CELLS)?.narrow(3, at % 2, CELLS);
    let corners = [corner(0)?, corner(1)?, corner(2)?, corner(3)?];
    let mode = |signs: &[f32; 4]| -> Result<Tensor> {
        let mut sum = (&corners[0] * f64::from(signs[0] / 2.0))?;
        for (corner, sign) in corners.iter().zip(signs).skip(1) {
            sum = (sum + (corner * f64::from(sign / 2.0))?)?;
        }
        sum.reshape((n, 2, AREA))
    };
    Tensor::cat(&[mode(&SIGNS[0])?, mode(&SIGNS[1])?, mode(&SIGNS[2])?], 1)
}

struct Features {
    strain: f32,
}

/// The gradient of [`Features`] with respect to the displacement, from (dy, patterns).
struct FeaturesGradient {
    strain: f32,
}

struct Forces;

/// The modes of displacements: the transpose of [`Forces`].
struct Modes;

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

/// Adds the forces of stresses (6, 2500) to forces (2, 49, 49).
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

/// Those of the [`features`] of an image (22, 2500) that do not depend on the displacement.
pub(crate) fn write_surroundings(pattern: &[f32], features: &mut [f32]) {
    let around = &mut features[..NEIGHBOURS * AREA];
    around.fill(0.0);
    neighbours(pattern, around);
    features[(FEATURES - 1) * AREA..].fill(1.0);
}

/// Those of the [`features`] of an image that do.
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

fn check(layout: &Layout, expected: &[usize]) -> Result<usize> {
    match layout.dims() {
        [n, rest @ ..] if rest == expected => Ok(*n),
        dims => bail!("expected images of {expected:?}, found {dims:?}"),
    }
}

impl CustomOp2 for Features {
    fn name(&self) -> &'static str {
        "cell-features"
    }

    fn cpu_fwd(&self, u: &CpuStorage, lu: &Layout, p: &CpuStorage, lp: &Layout) -> Result<(CpuStorage, Shape)> {
        let n = check(lu, &[2, INNER, INNER])?;
        check(lp, &[CELLS, CELLS])?;
        let (u, p) = (values(u, lu)?, values(p, lp)?);
        let mut y = vec![0.0; n * FEATURES * AREA];
        let images = u.chunks_exact(2 * INNER * INNER).zip(p.chunks_exact(AREA));
        for ((u, p), y) in images.zip(y.chunks_exact_mut(FEATURES * AREA)) {
            write_surroundings(p, y);
            write_strains(p, u, self.strain, y);
        }
        Ok((CpuStorage::F32(y), (n, FEATURES, AREA).into()))
    }

    fn bwd(&self, u: &Tensor, p: &Tensor, _: &Tensor, grad: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
        if !u.track_op() {
            return Ok((None, None));
        }
        let strain = self.strain;
        let du = grad.contiguous()?.apply_op2_no_bwd(p, &FeaturesGradient { strain })?;
        Ok((Some(du), None))
    }
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

impl CustomOp2 for FeaturesGradient {
    fn name(&self) -> &'static str {
        "cell-features-gradient"
    }

    fn cpu_fwd(&self, g: &CpuStorage, lg: &Layout, p: &CpuStorage, lp: &Layout) -> Result<(CpuStorage, Shape)> {
        let n = check(lg, &[FEATURES, AREA])?;
        check(lp, &[CELLS, CELLS])?;
        let (g, p) = (values(g, lg)?, values(p, lp)?);
        let (mut u, mut stresses) = (vec![0.0; n * 2 * INNER * INNER], vec![0.0; MODES * AREA]);
        let images = g.chunks_exact(FEATURES * AREA).zip(p.chunks_exact(AREA));
        for ((g, p), u) in images.zip(u.chunks_exact_mut(2 * INNER * INNER)) {
            add_strain_forces(p, g, self.strain, &mut stresses, u);
        }
        Ok((CpuStorage::F32(u), (n, 2, INNER, INNER).into()))
    }
}

impl CustomOp1 for Forces {
    fn name(&self) -> &'static str {
        "cell-forces"
    }

    fn cpu_fwd(&self, s: &CpuStorage, ls: &Layout) -> Result<(CpuStorage, Shape)> {
        let (n, s) = (check(ls, &[MODES, AREA])?, values(s, ls)?);
        let mut f = vec![0.0; n * 2 * INNER * INNER];
        for (s, f) in s.chunks_exact(MODES * AREA).zip(f.chunks_exact_mut(2 * INNER * INNER)) {
            add_forces(s, f);
        }
        Ok((CpuStorage::F32(f), (n, 2, INNER, INNER).into()))
    }

    fn bwd(&self, _: &Tensor, _: &Tensor, grad: &Tensor) -> Result<Option<Tensor>> {
        grad.contiguous()?.apply_op1_no_bwd(&Modes).map(Some)
    }
}

impl CustomOp1 for Modes {
    fn name(&self) -> &'static str {
        "cell-modes"
    }

    fn cpu_fwd(&self, u: &CpuStorage, lu: &Layout) -> Result<(CpuStorage, Shape)> {
        let (n, u) = (check(lu, &[2, INNER, INNER])?, values(u, lu)?);
        let mut modes = vec![0.0; n * MODES * AREA];
        for (u, modes) in u
            .chunks_exact(2 * INNER * INNER)
            .zip(modes.chunks_exact_mut(MODES * AREA))
        {
            write_modes(u, 1.0, modes);
        }
        Ok((CpuStorage::F32(modes), (n, MODES, AREA).into()))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;

    fn numbers(dims: &[usize], salt: usize) -> Tensor {
        let count = dims.iter().product();
        let values: Vec<f32> = (0..count).map(|i| ((i * 31 + salt) * 17 % 11) as f32 - 5.0).collect();
        Tensor::from_vec(values, dims, &Device::Cpu).unwrap()
    }

    fn flat(x: &Tensor) -> Vec<f32> {
        x.flatten_all().unwrap().to_vec1().unwrap()
    }

    fn dot(a: &Tensor, b: &Tensor) -> f64 {
        let pairs = flat(a).into_iter().zip(flat(b));
        pairs.map(|(a, b)| f64::from(a) * f64::from(b)).sum()
    }

    const DISPLACEMENT: [usize; 4] = [2, 2, INNER, INNER];

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
        let u: Vec<f32> = (0..2 * INNER * INNER).map(value).collect();
        let u = Tensor::from_vec(u, (1, 2, INNER, INNER), &Device::Cpu).unwrap();
        let p = (numbers(&[1, CELLS, CELLS], 3).ones_like().unwrap() * 0.5).unwrap();
        let found = flat(&features(&p, &u, 10.0).unwrap());
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
    fn other_devices_would_compute_the_same() {
        let (p, u) = (numbers(&[2, CELLS, CELLS], 1), numbers(&DISPLACEMENT, 2));
        let modes = composed_modes(&u).unwrap();
        assert_eq!(flat(&u.apply_op1_no_bwd(&Modes).unwrap()), flat(&modes));
        let found = features(&p, &u, 2.0).unwrap();
        assert_eq!(found.dims(), [2, FEATURES, AREA]);
        assert_eq!(flat(&found), flat(&composed_features(&p, &u, 2.0).unwrap()));
        let s = numbers(&[2, MODES, AREA], 5);
        assert_eq!(flat(&forces(&s).unwrap()), flat(&composed_forces(&s).unwrap()));
    }

    #[test]
    fn forces_are_the_transpose_of_the_modes() {
        let (u, s) = (numbers(&DISPLACEMENT, 1), numbers(&[2, MODES, AREA], 2));
        let modes = u.apply_op1_no_bwd(&Modes).unwrap();
        assert_eq!(dot(&modes, &s), dot(&u, &forces(&s).unwrap()));
    }

    #[test]
    fn gradients_are_those_of_linear_maps() {
        let p = numbers(&[2, CELLS, CELLS], 1);
        let u = Var::from_tensor(&numbers(&DISPLACEMENT, 2)).unwrap();
        let zero = u.zeros_like().unwrap();
        let along = numbers(&DISPLACEMENT, 4);
        let y = features(&p, &u, 2.0).unwrap();
        let c = numbers(y.dims(), 3);
        let grads = (&y * &c).unwrap().sum_all().unwrap().backward().unwrap();
        let slope = (features(&p, &along, 2.0).unwrap() - features(&p, &zero, 2.0).unwrap()).unwrap();
        assert_eq!(dot(grads.get(&u).unwrap(), &along), dot(&c, &slope));

        let s = Var::from_tensor(&numbers(&[2, MODES, AREA], 2)).unwrap();
        let f = forces(&s).unwrap();
        let c = numbers(f.dims(), 3);
        let grads = (&f * &c).unwrap().sum_all().unwrap().backward().unwrap();
        let along = numbers(&[2, MODES, AREA], 5);
        assert_eq!(dot(grads.get(&s).unwrap(), &along), dot(&c, &forces(&along).unwrap()));
    }
}
