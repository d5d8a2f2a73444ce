//! What an operator does at a quadrature point.

use crate::fem::energy::{MODULI, Material};
use crate::fem::kinematics::Tensor;
use crate::fem::lanes::Value;

/// What happens at a quadrature point: from the gradients of M fields to a stress.
pub(super) trait Point<const M: usize>: Copy {
    /// Whether this is the stress of the first field: then [`Point::watched`] is wanted, and the stress at rest is taken away.
    const WATCHED: bool;
    /// What has to stay positive at the gradient of the first field.
    fn watched<V: Value>(self, gradient: Tensor<V>) -> V;
    /// Whether stored moduli are wanted.
    const STORED: bool = false;
    fn stress<V: Value>(self, gradients: [Tensor<V>; M], active: V, moduli: [V; MODULI]) -> Tensor<V>;
}

/// The stress at one field.
pub(super) struct StressAt<'a, L>(pub(super) &'a L);

/// The tangent at the first field along the second.
pub(super) struct TangentAt<'a, L>(pub(super) &'a L);

/// The same from stored moduli.
pub(super) struct TangentFrom<'a, L>(pub(super) &'a L);

impl<L> Clone for StressAt<'_, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L> Copy for StressAt<'_, L> {}

impl<L> Clone for TangentAt<'_, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L> Copy for TangentAt<'_, L> {}

impl<L> Clone for TangentFrom<'_, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L> Copy for TangentFrom<'_, L> {}

impl<L: Material> Point<1> for StressAt<'_, L> {
    const WATCHED: bool = true;
    #[inline(always)]
    fn watched<V: Value>(self, gradient: Tensor<V>) -> V {
        self.0.admissible(gradient)
    }
    #[inline(always)]
    fn stress<V: Value>(self, [gradient]: [Tensor<V>; 1], active: V, _moduli: [V; MODULI]) -> Tensor<V> {
        self.0.stress(gradient, active)
    }
}

impl<L: Material> Point<2> for TangentAt<'_, L> {
    const WATCHED: bool = false;
    #[inline(always)]
    fn watched<V: Value>(self, gradient: Tensor<V>) -> V {
        gradient[0][0]
    }
    #[inline(always)]
    fn stress<V: Value>(self, [gradient, change]: [Tensor<V>; 2], active: V, _moduli: [V; MODULI]) -> Tensor<V> {
        self.0.tangent(gradient, active, change)
    }
}

impl<L: Material> Point<2> for TangentFrom<'_, L> {
    const WATCHED: bool = false;
    const STORED: bool = true;
    #[inline(always)]
    fn watched<V: Value>(self, gradient: Tensor<V>) -> V {
        gradient[0][0]
    }
    #[inline(always)]
    fn stress<V: Value>(self, [gradient, change]: [Tensor<V>; 2], _active: V, moduli: [V; MODULI]) -> Tensor<V> {
        self.0.tangent_from(gradient, moduli, change)
    }
}
