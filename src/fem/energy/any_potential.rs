//! The potentials of all combinations of effects as one type, so that the kernels of all are compiled once.

use super::compound::Compound;
use super::potential::{Invariants, Potential, Rest, Slopes, Watched};
use crate::effects::TensionField;
use crate::lanes::Value;

/// A potential with or without wrinkling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AnyPotential {
    /// The membrane bears compression.
    Flat(Compound),
    /// It wrinkles instead.
    TensionField(TensionField),
}

impl AnyPotential {
    fn flat(&self) -> &Compound {
        match self {
            Self::Flat(flat) => flat,
            Self::TensionField(field) => field.flat(),
        }
    }
}

impl Potential for AnyPotential {
    fn has_several_branches(&self) -> bool {
        self.flat().has_several_branches()
    }

    fn wrinkles(&self) -> bool {
        matches!(self, Self::TensionField(_))
    }

    #[inline(always)]
    fn energy<V: Value>(&self, at: &Invariants<V>, active: V) -> V {
        match self {
            Self::Flat(flat) => flat.energy(at, active),
            Self::TensionField(field) => field.energy(at, active),
        }
    }

    #[inline(always)]
    fn slopes<V: Value>(&self, at: &Invariants<V>, active: V) -> Slopes<V> {
        match self {
            Self::Flat(flat) => flat.slopes(at, active),
            Self::TensionField(field) => field.slopes(at, active),
        }
    }

    #[inline(always)]
    fn energy_apart<V: Value>(&self, at: &Invariants<V>, active: V) -> V {
        match self {
            Self::Flat(flat) => flat.energy_apart(at, active),
            Self::TensionField(field) => field.energy_apart(at, active),
        }
    }

    #[inline(always)]
    fn slopes_apart<V: Value>(&self, at: &Invariants<V>, active: V) -> Slopes<V> {
        match self {
            Self::Flat(flat) => flat.slopes_apart(at, active),
            Self::TensionField(field) => field.slopes_apart(at, active),
        }
    }

    #[inline(always)]
    fn first_slopes_apart<V: Value>(&self, at: &Invariants<V>, active: V) -> [V; 3] {
        match self {
            Self::Flat(flat) => flat.first_slopes_apart(at, active),
            Self::TensionField(field) => field.first_slopes_apart(at, active),
        }
    }

    #[inline(always)]
    fn watched_apart<V: Value>(&self, at: &Invariants<V>, active: V) -> Watched<V> {
        match self {
            Self::Flat(flat) => flat.watched_apart(at, active),
            Self::TensionField(field) => field.watched_apart(at, active),
        }
    }

    fn rest(&self) -> Rest {
        self.flat().rest()
    }

    #[inline(always)]
    fn admissible<V: Value>(&self, at: &Invariants<V>) -> V {
        self.flat().admissible(at)
    }

    fn load(&self) -> f64 {
        self.flat().load()
    }

    fn softening(&self) -> f64 {
        self.flat().softening()
    }
}
