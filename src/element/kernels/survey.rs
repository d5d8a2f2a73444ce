//! Passes over the quadrature points without forces: margins of stability, moduli, metrics.

use std::marker::PhantomData;

use pulp::{Simd, WithSimd};

use super::gather::{add_rest, gather, scale_gradients, sides, unmapped, write_mapped_gradients};
use crate::activity::View;
use crate::element::Element;
use crate::energy::{MODULI, Margins, MaterialPoint};
use crate::kinematics::{Tensor, deformation, determinant};
use crate::lanes::{Real, Value, Wide};
use crate::layout::NodeLayout;
use crate::memory::{self, MODULI_WITH_MEMORY};
use crate::precision::Precision;

/// One pass over the quadrature points for the smallest margins.
pub(super) struct Survey<'a, E, L, T, const N: usize> {
    pub layout: NodeLayout,
    pub material: &'a L,
    pub activity: View<'a, T>,
    /// f at rest.
    pub rest: [f64; 2],
    pub u: &'a [T],
    pub element: PhantomData<E>,
}

impl<E: Element<N>, L: MaterialPoint, T: Precision, const N: usize> WithSimd for Survey<'_, E, L, T, N> {
    type Output = Margins<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Margins<f64> {
        let mut ellipticity = Wide::<S, T>::splat(simd, f64::INFINITY);
        let (mut convexity, mut tension) = (ellipticity, ellipticity);
        for row in 0..self.layout.element_rows() {
            for first in (0..self.layout.columns()).step_by(T::lanes::<S>()) {
                for (q, &gradient) in self.gradients(simd, first, row).iter().enumerate() {
                    let active = self
                        .activity
                        .within_electrode(simd, self.layout.part(), [first, row], q);
                    let f = deformation(gradient);
                    let mut margins = self.material.margins(f, active);
                    if let Some((numbers, weight)) = self.activity.memory {
                        let number =
                            |at| Wide::load(simd, &numbers[memory::line(self.layout, N, row, q, at) + first..]);
                        let [elliptic, convex] =
                            memory::margins([number(0), number(1), number(2), number(3)], weight, f);
                        // Only the sign of the convexity of a material has a meaning, so the two cannot be added.
                        margins.ellipticity = margins.ellipticity + elliptic;
                        margins.convexity = margins.convexity.min(convex.choose(active.constant(1e30), convex));
                    }
                    ellipticity = ellipticity.min(margins.ellipticity);
                    convexity = convexity.min(margins.convexity);
                    if L::WRINKLES {
                        tension = tension.min(margins.tension);
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

impl<E: Element<N>, L, T: Precision, const N: usize> Survey<'_, E, L, T, N> {
    /// Returns f − I at the points of elements.
    #[inline(always)]
    fn gradients<S: Simd>(&self, simd: S, first: usize, row: usize) -> [Tensor<Wide<S, T>>; N] {
        if let Some(mapped) = self.activity.mapped.filter(|_| row >= self.layout.rows()) {
            let mut gradients = [[[Wide::splat(simd, 0.0); 2]; 2]; N];
            write_mapped_gradients(simd, self.layout, mapped, self.u, [first, row], &mut gradients);
            add_rest(&mut gradients, self.rest);
            return gradients;
        }
        let nodal = gather::<E, S, T, N>(simd, self.layout, self.u, first, row);
        match self.activity.sides {
            None => E::gradients(&nodal),
            Some(all) if self.activity.is_uniform => {
                let factors = [all[0][0].to_f64().recip(), all[1][0].to_f64().recip()];
                E::gradients_on(&nodal, factors, [self.rest[0] - 1.0, self.rest[1] - 1.0])
            }
            Some(all) => {
                let mut gradients = E::gradients(&nodal);
                let unmapped = unmapped(simd, self.layout, self.activity.mapped, [first, row]);
                let sides = sides(simd, all, first, row);
                scale_gradients(&mut gradients, sides.map(|side| side.recip() * unmapped));
                add_rest(&mut gradients, self.rest);
                gradients
            }
        }
    }
}

/// Returns the index of the `moduli` of point `q` of `points`, of the elements from `first` on of a row: a register for
/// each modulus.
#[inline(always)]
pub(super) fn moduli_offset(
    layout: NodeLayout,
    [first, row]: [usize; 2],
    lanes: usize,
    [points, q]: [usize; 2],
    moduli: usize,
) -> usize {
    ((row * layout.part() + first) * points + q * lanes) * moduli
}

/// One pass over the quadrature points that stores their moduli: of the material, or of material and memory.
pub(super) struct Store<'a, E, L, T, const N: usize> {
    pub survey: Survey<'a, E, L, T, N>,
    pub moduli: &'a mut [T],
}

impl<E: Element<N>, L: MaterialPoint, T: Precision, const N: usize> WithSimd for Store<'_, E, L, T, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Survey {
            layout,
            material,
            activity,
            ..
        } = self.survey;
        let lanes = T::lanes::<S>();
        for row in 0..layout.element_rows() {
            for first in (0..layout.columns()).step_by(lanes) {
                for (q, &gradient) in self.survey.gradients(simd, first, row).iter().enumerate() {
                    let active = activity.at(simd, [first, row], q);
                    let moduli = material.moduli(gradient, active);
                    if let Some((numbers, _)) = activity.memory {
                        let number = |at| Wide::load(simd, &numbers[memory::line(layout, N, row, q, at) + first..]);
                        let numbers = [number(0), number(1), number(2), number(3)];
                        let both = memory::moduli_with_memory(moduli, numbers, gradient);
                        let start = moduli_offset(layout, [first, row], lanes, [N, q], MODULI_WITH_MEMORY);
                        for (at, &value) in both.iter().enumerate() {
                            value.store(&mut self.moduli[start + at * lanes..]);
                        }
                    } else {
                        let start = moduli_offset(layout, [first, row], lanes, [N, q], MODULI);
                        for (at, &value) in moduli.iter().enumerate() {
                            value.store(&mut self.moduli[start + at * lanes..]);
                        }
                    }
                }
            }
        }
    }
}

/// Stresses and moduli of a material at an undisplaced point: bare, then active.
pub struct MaterialAtRest {
    /// Stresses without the self-stress.
    pub stresses: [Tensor<f64>; 2],
    /// [`MaterialPoint::moduli`].
    pub moduli: [[f64; MODULI]; 2],
}

/// Evaluates a material at rest with the registers of the kernels, so that the numbers are the same bits.
pub(super) struct EvaluateAtRest<'a, L, T> {
    pub material: &'a L,
    pub precision: PhantomData<T>,
}

impl<L: MaterialPoint, T: Precision> WithSimd for EvaluateAtRest<'_, L, T> {
    type Output = MaterialAtRest;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> MaterialAtRest {
        let rest = [[Wide::<S, T>::splat(simd, 0.0); 2]; 2];
        let mut at_rest = MaterialAtRest {
            stresses: [[[0.0; 2]; 2]; 2],
            moduli: [[0.0; MODULI]; 2],
        };
        for (at, active) in [0.0, 1.0].into_iter().enumerate() {
            let active = Wide::<S, T>::splat(simd, active);
            let stress = self.material.stress(rest, active);
            for (to, row) in at_rest.stresses[at].iter_mut().zip(stress) {
                *to = [row[0].smallest(), row[1].smallest()];
            }
            for (to, modulus) in at_rest.moduli[at].iter_mut().zip(self.material.moduli(rest, active)) {
                *to = modulus.smallest();
            }
        }
        at_rest
    }
}

/// One pass over the quadrature points that writes c⁻¹ and j².
pub(super) struct Metrics<'a, E, L, const N: usize> {
    pub survey: Survey<'a, E, L, f64, N>,
    pub values: &'a mut [f64],
}

impl<E: Element<N>, L: MaterialPoint, const N: usize> WithSimd for Metrics<'_, E, L, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let layout = self.survey.layout;
        for row in 0..layout.element_rows() {
            for first in (0..layout.columns()).step_by(f64::lanes::<S>()) {
                for (q, &gradient) in self.survey.gradients(simd, first, row).iter().enumerate() {
                    let [[a, b], [c, d]] = deformation(gradient);
                    let j = determinant([[a, b], [c, d]]);
                    let square = j * j;
                    let inverse = square.recip();
                    let numbers = [
                        inverse * b.madd(b, d * d),
                        -(inverse * a.madd(b, c * d)),
                        inverse * a.madd(a, c * c),
                        square,
                    ];
                    for (at, number) in numbers.into_iter().enumerate() {
                        number.store(&mut self.values[memory::line(layout, N, row, q, at) + first..]);
                    }
                }
            }
        }
    }
}
