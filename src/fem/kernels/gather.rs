//! Nodal values of neighbouring elements in registers, and the conversion of gradients and stresses to the sides of elements.

use pulp::Simd;

use crate::element::Element;
use crate::kinematics::Tensor;
use crate::lanes::{Real, Value, Wide};
use crate::layout::NodeLayout;

/// The widths of as many elements as a register holds, and their height.
#[inline(always)]
pub(super) fn sides<S: Simd, T: Real>(
    simd: S,
    [widths, heights]: [&[T]; 2],
    first: usize,
    row: usize,
) -> [Wide<S, T>; 2] {
    [
        Wide::load(simd, &widths[first..]),
        Wide::splat(simd, heights[row].to_f64()),
    ]
}

/// The stress at rest of what is not active. The law is isotropic, so it has no shear.
pub(crate) fn stress_at_rest(stress: impl Fn(Tensor<f64>) -> Tensor<f64>, [along, across]: [f64; 2]) -> [f64; 2] {
    let [[xx, _], [_, yy]] = stress([[along - 1.0, 0.0], [0.0, across - 1.0]]);
    [xx, yy]
}

/// (∇u) D as f − I, which at rest is D − I.
#[inline(always)]
pub(crate) fn from_rest<V: Value, const N: usize>(gradients: &mut [Tensor<V>; N], [along, across]: [f64; 2]) {
    for gradient in gradients {
        gradient[0][0] = gradient[0][0] + gradient[0][0].constant(along - 1.0);
        gradient[1][1] = gradient[1][1] + gradient[1][1].constant(across - 1.0);
    }
}

/// Gradients on elements of sides 1 as gradients on elements of these sides.
#[inline(always)]
pub(crate) fn per_side<V: Value, const N: usize>(gradients: &mut [Tensor<V>; N], [width, height]: [V; 2]) {
    let (along, across) = (width.recip(), height.recip());
    for gradient in gradients {
        for row in gradient {
            *row = [row[0] * along, row[1] * across];
        }
    }
}

/// Stresses of which the forces on an element of sides 1 are those of the given stresses on an element of these sides.
#[inline(always)]
pub(crate) fn on_sides<V: Value, const N: usize>(stresses: &mut [Tensor<V>; N], [width, height]: [V; 2]) {
    for stress in stresses {
        for row in stress {
            *row = [row[0] * height, row[1] * width];
        }
    }
}

/// The nodal values of as many elements as a register holds, from element `first` of a row; beyond the last element zero.
#[inline(always)]
pub(super) fn gather<E: Element<N>, S: Simd, T: Real, const N: usize>(
    simd: S,
    layout: NodeLayout,
    vector: &[T],
    first: usize,
    row: usize,
) -> [[Wide<S, T>; N]; 2] {
    let (degree, lanes) = (E::DEGREE, T::lanes::<S>());
    let real = layout.columns() - first;
    let mut nodal = [[Wide::splat(simd, 0.0); N]; 2];
    for (c, component) in nodal.iter_mut().enumerate() {
        for (node, value) in component.iter_mut().enumerate() {
            let (column, rise) = (node % (degree + 1), node / (degree + 1));
            // The degree is known where this is compiled, so nothing is divided.
            let start = layout.index_in(c, first + column / degree, column % degree, row * degree + rise);
            *value = if real >= lanes {
                Wide::load(simd, &vector[start..])
            } else {
                Wide::load_part(simd, &vector[start..start + real])
            };
        }
    }
    nodal
}
