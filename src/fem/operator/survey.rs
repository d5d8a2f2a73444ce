//! Passes over the quadrature points that leave no forces: margins of stability, and moduli to be kept.

use std::marker::PhantomData;

use pulp::{Simd, WithSimd};

use super::{Margins, Precision, View, gather, per_side, sides};
use crate::fem::element::Element;
use crate::fem::energy::{MODULI, Material};
use crate::fem::kinematics::{Tensor, deformation};
use crate::fem::lanes::{Value, Wide};
use crate::field::Mesh;

/// One pass over the quadrature points that finds the smallest margins.
pub(super) struct Survey<'a, E, L, T, const N: usize> {
    pub mesh: Mesh,
    pub material: &'a L,
    pub activity: View<'a, T>,
    pub u: &'a [T],
    pub element: PhantomData<E>,
}

impl<E: Element<N>, L: Material, T: Precision, const N: usize> WithSimd for Survey<'_, E, L, T, N> {
    type Output = Margins;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Margins {
        let mut ellipticity = Wide::<S, T>::splat(simd, f64::INFINITY);
        let (mut convexity, mut tension) = (ellipticity, ellipticity);
        for row in 0..self.mesh.elements() {
            for first in (0..self.mesh.elements()).step_by(T::lanes::<S>()) {
                let nodal = gather::<E, S, T, N>(simd, self.mesh, self.u, first, row);
                let active = Wide::load(simd, &self.activity.values[row * self.mesh.part() + first..]);
                for gradient in gradients::<E, S, T, N>(simd, self.activity, &nodal, first, row) {
                    let f = deformation(gradient);
                    ellipticity = ellipticity.min(self.material.ellipticity(f, active));
                    convexity = convexity.min(self.material.convexity(f, active));
                    if L::WRINKLES {
                        tension = tension.min(self.material.tension(f, active));
                    }
                }
            }
        }
        Margins {
            ellipticity: ellipticity.smallest(),
            convexity: convexity.smallest(),
            tension: tension.smallest(),
        }
    }
}

/// Gradients at the points of elements.
#[inline(always)]
fn gradients<E: Element<N>, S: Simd, T: Precision, const N: usize>(
    simd: S,
    activity: View<'_, T>,
    nodal: &[[Wide<S, T>; N]; 2],
    first: usize,
    row: usize,
) -> [Tensor<Wide<S, T>>; N] {
    let mut gradients = E::gradients(nodal);
    if let Some(sizes) = activity.sizes {
        per_side(&mut gradients, sides(simd, sizes, first, row));
    }
    gradients
}

/// Where the moduli of point `q` of N lie, of the elements from `first` on of a row: a register for each.
#[inline(always)]
pub(super) fn place(mesh: Mesh, first: usize, row: usize, lanes: usize, points: usize, q: usize) -> usize {
    ((row * mesh.part() + first) * points + q * lanes) * MODULI
}

/// One pass over the quadrature points that stores their moduli.
pub(super) struct Store<'a, E, L, T, const N: usize> {
    pub survey: Survey<'a, E, L, T, N>,
    pub moduli: &'a mut [T],
}

impl<E: Element<N>, L: Material, T: Precision, const N: usize> WithSimd for Store<'_, E, L, T, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Survey {
            mesh,
            material,
            activity,
            u,
            ..
        } = self.survey;
        let lanes = T::lanes::<S>();
        for row in 0..mesh.elements() {
            for first in (0..mesh.elements()).step_by(lanes) {
                let nodal = gather::<E, S, T, N>(simd, mesh, u, first, row);
                let active = Wide::load(simd, &activity.values[row * mesh.part() + first..]);
                let gradients = gradients::<E, S, T, N>(simd, activity, &nodal, first, row);
                for (q, gradient) in gradients.into_iter().enumerate() {
                    let start = place(mesh, first, row, lanes, N, q);
                    for (at, value) in material.moduli(gradient, active).into_iter().enumerate() {
                        value.store(&mut self.moduli[start + at * lanes..]);
                    }
                }
            }
        }
    }
}
