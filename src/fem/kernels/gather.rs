//! Loads nodal values of neighbouring elements into registers; converts gradients and stresses to the sides of
//! elements.

use pulp::Simd;

use crate::element::Element;
use crate::kinematics::Tensor;
use crate::lanes::{Real, Value, Wide};
use crate::layout::NodeLayout;

/// Returns the widths of the elements of a register, and their height.
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

/// Returns the stress of the bare membrane at rest along x and y; an isotropic material has no shear stress there.
pub(crate) fn stress_at_rest(stress: impl Fn(Tensor<f64>) -> Tensor<f64>, [along, across]: [f64; 2]) -> [f64; 2] {
    let [[xx, _], [_, yy]] = stress([[along - 1.0, 0.0], [0.0, across - 1.0]]);
    [xx, yy]
}

/// Converts (∇u) D to f − I with f = (I + ∇u) D; at rest f = D.
#[inline(always)]
pub(crate) fn add_rest<V: Value, const N: usize>(gradients: &mut [Tensor<V>; N], [along, across]: [f64; 2]) {
    for gradient in gradients {
        gradient[0][0] = gradient[0][0] + gradient[0][0].constant(along - 1.0);
        gradient[1][1] = gradient[1][1] + gradient[1][1].constant(across - 1.0);
    }
}

/// Converts gradients on elements with sides 1 to elements with the given sides.
#[inline(always)]
pub(crate) fn scale_gradients<V: Value, const N: usize>(gradients: &mut [Tensor<V>; N], [width, height]: [V; 2]) {
    let (along, across) = (width.recip(), height.recip());
    for gradient in gradients {
        for row in gradient {
            *row = [row[0] * along, row[1] * across];
        }
    }
}

/// Converts stresses on elements with the given sides to stresses that give the same forces on elements with sides 1.
#[inline(always)]
pub(crate) fn scale_stresses<V: Value, const N: usize>(stresses: &mut [Tensor<V>; N], [width, height]: [V; 2]) {
    for stress in stresses {
        for row in stress {
            *row = [row[0] * height, row[1] * width];
        }
    }
}

/// Returns the nodal values of the elements of a register, from element `first` of a row; zeros beyond the last
/// element.
#[inline(always)]
pub(super) fn gather<E: Element<N>, S: Simd, T: Real, const N: usize>(
    simd: S,
    layout: NodeLayout,
    vector: &[T],
    first: usize,
    row: usize,
) -> [[Wide<S, T>; N]; 2] {
    let (degree, lanes) = (E::DEGREE, T::lanes::<S>());
    let remaining = layout.columns() - first;
    let mut nodal = [[Wide::splat(simd, 0.0); N]; 2];
    for (c, component) in nodal.iter_mut().enumerate() {
        for (node, value) in component.iter_mut().enumerate() {
            let (column, rise) = (node % (degree + 1), node / (degree + 1));
            // The degree is a constant after inlining, so no division remains.
            let start = layout.index_in(c, first + column / degree, column % degree, row * degree + rise);
            *value = if remaining >= lanes {
                Wide::load(simd, &vector[start..])
            } else {
                Wide::load_part(simd, &vector[start..start + remaining])
            };
        }
    }
    nodal
}
