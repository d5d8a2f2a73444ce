//! Loads nodal values of neighbouring elements into registers; converts gradients and stresses to the sides of
//! elements.

use pulp::Simd;

use crate::element::Element;
use crate::fitted::MappedView;
use crate::kinematics::Tensor;
use crate::lanes::{Real, Value, WIDEST, Wide};
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

/// Returns 0 for elements of a grid whose cell is mapped, which are at rest and without forces, and 1 for others.
#[inline(always)]
pub(super) fn unmapped<S: Simd, T: Real>(
    simd: S,
    layout: NodeLayout,
    mapped: Option<MappedView<'_, T>>,
    [first, row]: [usize; 2],
) -> Wide<S, T> {
    match mapped {
        Some(mapped) => Wide::load(simd, &mapped.unmapped[row * layout.part() + first..]),
        None => Wide::splat(simd, 1.0),
    }
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

/// Multiplies derivatives along x and y by factors: those on elements with sides 1 by the inverse sides of elements.
#[inline(always)]
pub(crate) fn scale_gradients<V: Value, const N: usize>(gradients: &mut [Tensor<V>; N], [along, across]: [V; 2]) {
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

/// Writes the gradients at the points of mapped elements, from element `first` of a row.
#[inline(always)]
pub(super) fn write_mapped_gradients<S: Simd, T: Real, const N: usize>(
    simd: S,
    layout: NodeLayout,
    mapped: MappedView<'_, T>,
    vector: &[T],
    [first, row]: [usize; 2],
    gradients: &mut [Tensor<Wide<S, T>>; N],
) {
    let (lanes, part, plane) = (T::lanes::<S>(), layout.part(), layout.vector_len() / 2);
    let row = row - layout.rows();
    let mut nodal = [[Wide::splat(simd, 0.0); N]; 2];
    let mut values = [T::default(); WIDEST];
    for node in 0..N {
        let places = &mapped.nodes[(row * N + node) * part + first..][..lanes];
        for (c, component) in nodal.iter_mut().enumerate() {
            for (value, &at) in values.iter_mut().zip(places) {
                *value = vector[at as usize + c * plane];
            }
            component[node] = Wide::load(simd, &values);
        }
    }
    for (q, gradient) in gradients.iter_mut().enumerate() {
        *gradient = [[Wide::splat(simd, 0.0); 2]; 2];
        for node in 0..N {
            let line = ((row * N + q) * N + node) * 2;
            let slope = [0, 1].map(|axis| Wide::load(simd, &mapped.slopes[(line + axis) * part + first..]));
            for (row, component) in gradient.iter_mut().zip(&nodal) {
                for (entry, slope) in row.iter_mut().zip(slope) {
                    *entry = component[node].madd(slope, *entry);
                }
            }
        }
    }
}

/// Returns the nodal forces of the stresses at the points of mapped elements, from element `first` of a row.
#[inline(always)]
pub(super) fn mapped_forces<S: Simd, T: Real, const N: usize>(
    simd: S,
    layout: NodeLayout,
    mapped: MappedView<'_, T>,
    [first, row]: [usize; 2],
    stresses: &[Tensor<Wide<S, T>>; N],
) -> [[Wide<S, T>; N]; 2] {
    let (part, row) = (layout.part(), row - layout.rows());
    let mut forces = [[Wide::splat(simd, 0.0); N]; 2];
    for (q, stress) in stresses.iter().enumerate() {
        let area = Wide::load(simd, &mapped.areas[(row * N + q) * part + first..]);
        let stress = stress.map(|row| row.map(|entry| entry * area));
        for node in 0..N {
            let line = ((row * N + q) * N + node) * 2;
            let slope = [0, 1].map(|axis| Wide::load(simd, &mapped.slopes[(line + axis) * part + first..]));
            for (force, row) in forces.iter_mut().zip(stress) {
                force[node] = row[0].madd(slope[0], row[1].madd(slope[1], force[node]));
            }
        }
    }
    forces
}

/// Adds the forces of mapped elements, one by one, to those of their nodes.
#[inline(always)]
pub(super) fn scatter<S: Simd, T: Real, const N: usize>(
    layout: NodeLayout,
    mapped: MappedView<'_, T>,
    [first, row]: [usize; 2],
    forces: &[[Wide<S, T>; N]; 2],
    out: &mut [T],
) {
    let (lanes, part, plane) = (T::lanes::<S>(), layout.part(), layout.vector_len() / 2);
    let row = row - layout.rows();
    let mut values = [[[T::default(); WIDEST]; N]; 2];
    for (values, forces) in values.iter_mut().zip(forces) {
        values
            .iter_mut()
            .zip(forces)
            .for_each(|(values, force)| force.store(values));
    }
    for lane in 0..lanes {
        for node in 0..N {
            let at = mapped.nodes[(row * N + node) * part + first + lane] as usize;
            for (c, values) in values.iter().enumerate() {
                let sum = out[at + c * plane].to_f64() + values[node][lane].to_f64();
                out[at + c * plane] = T::from_f64(sum);
            }
        }
    }
}
