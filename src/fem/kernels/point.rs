//! What an operator does at a quadrature point.

use crate::energy::{MODULI, MaterialPoint, tangent_from};
use crate::kinematics::Tensor;
use crate::lanes::Value;
#[cfg(doc)]
use crate::memory::Memory;
use crate::memory::{self, MODULI_WITH_MEMORY};

/// What happens at a quadrature point: from the gradients of M fields to a stress.
pub(super) trait Point<const M: usize>: Copy {
    /// Whether it is worth a kernel of its own for registers of 512 bits.
    const WIDEST: bool = false;
    /// Whether this is the stress of the first field: then [`Point::watched`] is wanted, and the stress at rest is taken away.
    const WATCHED: bool = false;
    /// What has to stay positive at the gradient of the first field.
    #[inline(always)]
    fn watched<V: Value>(self, gradient: Tensor<V>) -> V {
        gradient[0][0]
    }
    /// How many stored numbers are wanted.
    const STORED: usize = 0;
    /// Whether the numbers of a [`Memory`] are wanted, as the first of them.
    const REMEMBERS: bool = false;
    fn stress<V: Value>(self, gradients: [Tensor<V>; M], active: V, stored: [V; MODULI_WITH_MEMORY]) -> Tensor<V>;
}

/// The stress at one field.
pub(super) struct StressAt<'a, L>(pub(super) &'a L);

/// The tangent at the first field along the second.
pub(super) struct TangentAt<'a, L>(pub(super) &'a L);

/// The same from stored moduli.
#[derive(Clone, Copy)]
pub(super) struct TangentFrom;

/// The stress at rest, where the law says the same of all that is bare, and of all that is active.
#[derive(Clone, Copy)]
pub(super) struct StressAtRest(pub(super) [Tensor<f64>; 2]);

/// The tangent at rest, by the moduli of what is bare and of what is active.
#[derive(Clone, Copy)]
pub(super) struct TangentAtRest(pub(super) [[f64; MODULI]; 2]);

/// The same of a law and a [`Memory`] together.
#[derive(Clone, Copy)]
pub(super) struct TangentOfBoth;

/// The stress of a [`Memory`] at one field.
#[derive(Clone, Copy)]
pub(super) struct MemoryStress;

/// The mean stress of a step from the first field by the second.
pub(super) struct StressBetween<'a, L>(pub(super) &'a L);

/// The mean stress of a [`Memory`] in a step from the first field by the second.
#[derive(Clone, Copy)]
pub(super) struct MemoryBetween;

/// How the tangent of a [`Memory`] that follows the first field changes with it, along the second field and times it.
#[derive(Clone, Copy)]
pub(super) struct FollowingTangent;

impl Point<2> for FollowingTangent {
    #[inline(always)]
    fn stress<V: Value>(
        self,
        [gradient, change]: [Tensor<V>; 2],
        _active: V,
        _stored: [V; MODULI_WITH_MEMORY],
    ) -> Tensor<V> {
        memory::tangent_that_follows(gradient, change)
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
    const WATCHED: bool = true;
    #[inline(always)]
    fn watched<V: Value>(self, gradient: Tensor<V>) -> V {
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
    const STORED: usize = MODULI;
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
        let [bare, covered] = self.0;
        let mut stress = [[active; 2]; 2];
        for (i, row) in stress.iter_mut().enumerate() {
            for (k, entry) in row.iter_mut().enumerate() {
                *entry = active.choose(active.constant(covered[i][k]), active.constant(bare[i][k]));
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
        let [bare, covered] = self.0;
        let mut moduli = [active; MODULI];
        for (at, modulus) in moduli.iter_mut().enumerate() {
            *modulus = active.choose(active.constant(covered[at]), active.constant(bare[at]));
        }
        tangent_from(gradient, moduli, change)
    }
}

impl Point<2> for TangentOfBoth {
    const WIDEST: bool = true;
    const STORED: usize = MODULI_WITH_MEMORY;
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
    const REMEMBERS: bool = true;
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
    const REMEMBERS: bool = true;
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
