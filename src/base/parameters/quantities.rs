//! Quantities with their dimension in the type, and the seed of random numbers.

use std::fmt;
use std::ops::{Deref, RangeInclusive};

use super::Parameter;
use crate::canonical::Canonical;
use crate::document::{InputError, Node};
use crate::quantity::{Decimal, Dimension, Quantity};
use crate::schema::Schema;

macro_rules! quantities {
    ($($(#[doc = $doc:literal])+ $name:ident: $dimension:ident),+ $(,)?) => {$(
        $(#[doc = $doc])+
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(Quantity);

        impl $name {
            /// Creates the quantity from an exact number in the base unit.
            #[must_use]
            pub fn from_base(base: Decimal) -> Self {
                Self(Quantity::new(base, Dimension::$dimension))
            }

            /// Creates the quantity from a number in the base unit; `None` unless it is finite.
            #[must_use]
            pub fn from_f64(value: f64) -> Option<Self> {
                Quantity::from_f64(value, Dimension::$dimension).map(Self)
            }
        }

        impl Deref for $name {
            type Target = Quantity;

            fn deref(&self) -> &Quantity {
                &self.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)
            }
        }

        impl Parameter for $name {
            /// The smallest and the largest value in the base unit.
            type Limits = RangeInclusive<f64>;
            /// As in a document: "0.003 mm".
            type Literal = &'static str;

            fn read(node: &Node, key: &str, limits: &RangeInclusive<f64>) -> Result<Self, InputError> {
                node.quantity_in(key, Dimension::$dimension, *limits.start(), *limits.end()).map(Self)
            }

            fn canonical(&self) -> Option<Canonical> {
                Some(Canonical::from(&self.0))
            }

            fn schema(limits: &RangeInclusive<f64>) -> Schema {
                Schema::quantity(Dimension::$dimension, *limits.start(), *limits.end())
            }

            fn example() -> String {
                format!("1 {}", Dimension::$dimension.base_unit())
            }

            fn literal(literal: &'static str) -> Self {
                Self(Quantity::parse(literal, Dimension::$dimension).expect("a declared default is a quantity"))
            }
        }
    )+};
}

quantities! {
    /// A length, base unit mm.
    Length: Length,
    /// A voltage, base unit V.
    Voltage: Voltage,
    /// A stress or modulus, base unit Pa.
    Stress: Stress,
    /// A plane angle, base unit deg.
    Angle: Angle,
    /// An electric field, base unit V/m.
    ElectricField: Field,
    /// A frequency, base unit Hz.
    Frequency: Frequency,
    /// A time, base unit s.
    Time: Time,
    /// A mass, base unit kg.
    Mass: Mass,
    /// A density of mass, base unit kg/m3.
    Density: Density,
    /// An electric resistance, base unit Ohm.
    Resistance: Resistance,
    /// A force, base unit N.
    Force: Force,
    /// The stiffness of a spring, base unit N/m.
    SpringRate: SpringRate,
    /// An electric charge, base unit C.
    Charge: Charge,
    /// An electric current, base unit A.
    Current: Current,
    /// A volume, base unit ml.
    Volume: Volume,
}

/// The seed of the random numbers of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seed(pub u64);

/// The largest integer in keys.
const LARGEST_SEED: u64 = i64::MAX as u64;

impl Parameter for Seed {
    type Limits = ();
    type Literal = u64;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        node.integer(key, 0, LARGEST_SEED).map(Self)
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.0.into())
    }

    fn schema((): &()) -> Schema {
        Schema::integer(0, LARGEST_SEED)
    }

    fn literal(literal: u64) -> Self {
        Self(literal)
    }
}
