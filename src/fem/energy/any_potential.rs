//! One type for the potentials of all combinations of effects, so that the kernels are compiled once.

use super::compound::Compound;
use super::potential::{Invariants, MarginTerms, Potential, Rest, Slopes};
use crate::effects::TensionField;
use crate::lanes::Value;

/// A potential with or without wrinkling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AnyPotential {
    /// The membrane bears compression.
    Flat(Compound),
    /// The membrane wrinkles instead of bearing compression.
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
    fn energy_out_of_line<V: Value>(&self, at: &Invariants<V>, active: V) -> V {
        match self {
            Self::Flat(flat) => flat.energy_out_of_line(at, active),
            Self::TensionField(field) => field.energy_out_of_line(at, active),
        }
    }

    #[inline(always)]
    fn slopes_out_of_line<V: Value>(&self, at: &Invariants<V>, active: V) -> Slopes<V> {
        match self {
            Self::Flat(flat) => flat.slopes_out_of_line(at, active),
            Self::TensionField(field) => field.slopes_out_of_line(at, active),
        }
    }

    #[inline(always)]
    fn first_slopes_out_of_line<V: Value>(&self, at: &Invariants<V>, active: V) -> [V; 3] {
        match self {
            Self::Flat(flat) => flat.first_slopes_out_of_line(at, active),
            Self::TensionField(field) => field.first_slopes_out_of_line(at, active),
        }
    }

    #[inline(always)]
    fn margin_terms_out_of_line<V: Value>(&self, at: &Invariants<V>, active: V) -> MarginTerms<V> {
        match self {
            Self::Flat(flat) => flat.margin_terms_out_of_line(at, active),
            Self::TensionField(field) => field.margin_terms_out_of_line(at, active),
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
