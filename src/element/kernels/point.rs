//! Operators at a quadrature point.

use crate::energy::{MODULI, MaterialPoint, tangent_from};
use crate::kinematics::Tensor;
use crate::lanes::Value;
#[cfg(doc)]
use crate::memory::Memory;
use crate::memory::{self, MODULI_WITH_MEMORY};

/// An operator at a quadrature point: converts the gradients of M fields to a stress.
pub(super) trait Point<const M: usize>: Copy {
    /// Whether a separate kernel with AVX-512 is compiled.
    const WIDEST: bool = false;
    /// Whether this is the stress of a material at the first field: then [`Point::admissible`] is evaluated.
    const IS_STRESS: bool = false;
    /// Whether the stress at rest of a material is subtracted.
    const FROM_REST: bool = Self::IS_STRESS;
    /// Returns a number that must be positive at the gradient of the first field.
    #[inline(always)]
    fn admissible<V: Value>(self, gradient: Tensor<V>) -> V {
        gradient[0][0]
    }
    /// Number of stored moduli that are read.
    const STORED_MODULI: usize = 0;
    /// Whether the numbers of a [`Memory`] are read, as the first stored numbers.
    const READS_MEMORY: bool = false;
    fn stress<V: Value>(self, gradients: [Tensor<V>; M], active: V, stored: [V; MODULI_WITH_MEMORY]) -> Tensor<V>;
}

/// The stress of a material at a field.
pub(super) struct StressAt<'a, L>(pub(super) &'a L);

/// The tangent of a material at the first field along the second.
pub(super) struct TangentAt<'a, L>(pub(super) &'a L);

/// The tangent from stored moduli.
#[derive(Clone, Copy)]
pub(super) struct TangentFrom;

/// The stress at rest of bare and of active points.
#[derive(Clone, Copy)]
pub(super) struct StressAtRest(pub(super) [Tensor<f64>; 2]);

/// The tangent at rest, from the moduli of bare and of active points.
#[derive(Clone, Copy)]
pub(super) struct TangentAtRest(pub(super) [[f64; MODULI]; 2]);

/// The tangent of a material and a [`Memory`] from stored moduli.
#[derive(Clone, Copy)]
pub(super) struct TangentWithMemory;

/// The stress of a [`Memory`] at a field.
#[derive(Clone, Copy)]
pub(super) struct MemoryStress;

/// The mean stress of a material in a step from the first field by the second.
pub(super) struct StressBetween<'a, L>(pub(super) &'a L);

/// The mean stress of a [`Memory`] in a step from the first field by the second.
#[derive(Clone, Copy)]
pub(super) struct MemoryBetween;

/// The derivative of the tangent of relaxed branches with respect to the first field, along the second and times the
/// second.
#[derive(Clone, Copy)]
pub(super) struct RelaxedTangentDerivative;

impl Point<2> for RelaxedTangentDerivative {
    #[inline(always)]
    fn stress<V: Value>(
        self,
        [gradient, change]: [Tensor<V>; 2],
        _active: V,
        _stored: [V; MODULI_WITH_MEMORY],
    ) -> Tensor<V> {
        memory::relaxed_tangent_derivative(gradient, change)
    }
}

impl<L> Clone for StressAt<'_, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L> Copy for StressAt<'_, L> {}

impl<L> Clone for StressBetween<'_, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L> Copy for StressBetween<'_, L> {}

impl<L> Clone for TangentAt<'_, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L> Copy for TangentAt<'_, L> {}

impl<L: MaterialPoint> Point<1> for StressAt<'_, L> {
    const WIDEST: bool = true;
    const IS_STRESS: bool = true;
    #[inline(always)]
    fn admissible<V: Value>(self, gradient: Tensor<V>) -> V {
        self.0.admissible(gradient)
    }
    #[inline(always)]
    fn stress<V: Value>(self, [gradient]: [Tensor<V>; 1], active: V, _stored: [V; MODULI_WITH_MEMORY]) -> Tensor<V> {
        self.0.stress(gradient, active)
    }
}

impl<L: MaterialPoint> Point<2> for TangentAt<'_, L> {
    const WIDEST: bool = true;
    #[inline(always)]
    fn stress<V: Value>(
        self,
        [gradient, change]: [Tensor<V>; 2],
        active: V,
        _stored: [V; MODULI_WITH_MEMORY],
    ) -> Tensor<V> {
        self.0.tangent(gradient, active, change)
    }
}

impl Point<2> for TangentFrom {
    const WIDEST: bool = true;
    const STORED_MODULI: usize = MODULI;
    #[inline(always)]
    fn stress<V: Value>(
        self,
        [gradient, change]: [Tensor<V>; 2],
        _active: V,
        stored: [V; MODULI_WITH_MEMORY],
    ) -> Tensor<V> {
        let [i, j, ii, ij, jj, ..] = stored;
        tangent_from(gradient, [i, j, ii, ij, jj], change)
    }
}

impl Point<1> for StressAtRest {
    const WIDEST: bool = true;
    #[inline(always)]
    fn stress<V: Value>(self, _gradients: [Tensor<V>; 1], active: V, _stored: [V; MODULI_WITH_MEMORY]) -> Tensor<V> {
        let [bare, coated] = self.0;
        let mut stress = [[active; 2]; 2];
        for (i, row) in stress.iter_mut().enumerate() {
            for (k, entry) in row.iter_mut().enumerate() {
                *entry = active.choose(active.constant(coated[i][k]), active.constant(bare[i][k]));
            }
        }
        stress
    }
}

impl Point<2> for TangentAtRest {
    const WIDEST: bool = true;
    #[inline(always)]
    fn stress<V: Value>(
        self,
        [gradient, change]: [Tensor<V>; 2],
        active: V,
        _stored: [V; MODULI_WITH_MEMORY],
    ) -> Tensor<V> {
        let [bare, coated] = self.0;
        let mut moduli = [active; MODULI];
        for (at, modulus) in moduli.iter_mut().enumerate() {
            *modulus = active.choose(active.constant(coated[at]), active.constant(bare[at]));
        }
        tangent_from(gradient, moduli, change)
    }
}

impl Point<2> for TangentWithMemory {
    const WIDEST: bool = true;
    const STORED_MODULI: usize = MODULI_WITH_MEMORY;
    #[inline(always)]
    fn stress<V: Value>(
        self,
        [gradient, change]: [Tensor<V>; 2],
        _active: V,
        stored: [V; MODULI_WITH_MEMORY],
    ) -> Tensor<V> {
        memory::tangent_from(gradient, stored, change)
    }
}

impl Point<1> for MemoryStress {
    const READS_MEMORY: bool = true;
    #[inline(always)]
    fn stress<V: Value>(
        self,
        [gradient]: [Tensor<V>; 1],
        _active: V,
        [xx, xy, yy, normal, ..]: [V; MODULI_WITH_MEMORY],
    ) -> Tensor<V> {
        memory::stress([xx, xy, yy, normal], gradient)
    }
}

impl<L: MaterialPoint> Point<2> for StressBetween<'_, L> {
    const FROM_REST: bool = true;
    #[inline(always)]
    fn stress<V: Value>(
        self,
        [gradient, change]: [Tensor<V>; 2],
        active: V,
        _stored: [V; MODULI_WITH_MEMORY],
    ) -> Tensor<V> {
        self.0.stress_between(gradient, active, change)
    }
}

impl Point<2> for MemoryBetween {
    const READS_MEMORY: bool = true;
    #[inline(always)]
    fn stress<V: Value>(
        self,
        [gradient, change]: [Tensor<V>; 2],
        _active: V,
        [xx, xy, yy, normal, ..]: [V; MODULI_WITH_MEMORY],
    ) -> Tensor<V> {
        memory::stress_between([xx, xy, yy, normal], gradient, change)
    }
}
