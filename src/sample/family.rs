//! The interface of a family of patterns, and the macro that declares a simple one.
//!
//! Each family has its own file: its parameters, declared once, and how a pattern is drawn. `families.rs` lists all;
//! readers, schemas and stages accept any table, so a program can add families of its own.

use std::fmt;
use std::marker::PhantomData;

use super::canvas::Canvas;
use super::error::{ParameterError, SampleError};
use deaflow_base::{Canonical, Declared, Fields, InputError, Node, Stream};
use deaflow_pattern::Pattern;

/// A family of electrode patterns with its parameters.
pub trait Family: fmt::Debug + Send + Sync {
    /// The name in pipelines and files. It also names the random stream.
    fn name(&self) -> &'static str;

    /// Draws a pattern.
    fn draw(&self, stream: &mut Stream) -> Pattern;

    /// Returns sample `index`, a function of the family, its parameters, the seed and the index only.
    ///
    /// # Errors
    /// When the family has no more than `index` samples.
    fn sample(&self, seed: u64, index: u64) -> Result<Pattern, SampleError> {
        Ok(self.draw(&mut Stream::new(seed, self.name(), index)))
    }

    /// Returns the number of samples; `None` if unlimited.
    fn available(&self) -> Option<u64> {
        None
    }

    /// Returns the number of units across the membrane if patterns are made of units, otherwise 0.
    fn units(&self) -> u64 {
        0
    }
}

/// The largest number of samples in one stage; more are probably a typing error.
pub const MOST_SAMPLES: u64 = 10_000_000;

/// Samples of a family with one set of parameters.
#[derive(Debug)]
pub struct SampleGroup {
    /// The family.
    pub family: Box<dyn Family>,
    /// The number of samples.
    pub count: u64,
    /// The parameters that distinguish the group within its family, for keys.
    pub parameters: Vec<(&'static str, Canonical)>,
}

/// The declared parameters of a family in a stage.
pub trait FamilyParameters: Declared {
    /// The word after `family:`.
    const NAME: &'static str;

    /// Returns the samples to draw on a canvas.
    ///
    /// # Errors
    /// When no pattern satisfies the parameters.
    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, ParameterError>;

    /// Returns false if the family cannot have drawn a pattern with any parameters.
    #[must_use]
    fn admits(_pattern: &Pattern) -> bool {
        true
    }

    /// Returns a single group, which all parameters except the count distinguish.
    fn one_group(&self, count: u64, family: Box<dyn Family>) -> Vec<SampleGroup> {
        let mut parameters = Vec::new();
        self.entries(&mut parameters);
        parameters.retain(|(key, _)| *key != "count");
        vec![SampleGroup {
            family,
            count,
            parameters,
        }]
    }
}

/// Declares a family that is drawn on a canvas, at an area fraction from a range if a default for it is given: its
/// parameters and its type. `admits` checks whether it can have drawn a pattern.
macro_rules! family {
    (
        $(#[doc = $about:literal])+
        $family:ident, $parameters:ident as $what:literal, $name:literal
        , area: $area:expr $(, admits: $admits:expr)?
    ) => {
        $crate::family::family!(
            @declare [$($about)+] $family, $parameters, $what, $name, areas: $crate::Areas,
            {
                /// Electrode area, a share of the free membrane, or smallest and largest to draw from.
                pub area: $crate::AreaFractions = $area,
            },
            |parameters, canvas| parameters.area.areas(canvas),
            $($admits)?
        );
    };
    ($(#[doc = $about:literal])+ $family:ident, $parameters:ident as $what:literal, $name:literal) => {
        $crate::family::family!(
            @declare [$($about)+] $family, $parameters, $what, $name, canvas: $crate::Canvas, {},
            |_, canvas| Ok(canvas),
        );
    };
    (
        @declare [$($about:literal)+] $family:ident, $parameters:ident, $what:literal, $name:literal,
        $field:ident: $type:ty, { $($area:tt)* }, $value:expr, $($admits:expr)?
    ) => {
        deaflow_base::parameters! {
            $(#[doc = $about])+
            pub struct $parameters as $what {
                /// Patterns to draw.
                pub count: u64 [1..=$crate::MOST_SAMPLES],
                $($area)*
            }
        }

        impl $crate::FamilyParameters for $parameters {
            const NAME: &'static str = $name;

            fn groups(&self, canvas: $crate::Canvas) -> Result<Vec<$crate::SampleGroup>, $crate::ParameterError> {
                let value: fn(&Self, $crate::Canvas) -> Result<$type, $crate::ParameterError> = $value;
                Ok(self.one_group(self.count, Box::new($family::new(value(self, canvas)?))))
            }

            $(fn admits(pattern: &deaflow_pattern::Pattern) -> bool {
                let admits: fn(&deaflow_pattern::Pattern) -> bool = $admits;
                admits(pattern)
            })?
        }

        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq)]
        pub struct $family {
            $field: $type,
        }

        impl $family {
            /// Creates the family.
            #[must_use]
            pub fn new($field: $type) -> Self {
                Self { $field }
            }
        }
    };
}
pub(crate) use family;

/// An entry of a table of families.
pub trait FamilyEntry: Sync {
    /// The word after `family:`.
    fn name(&self) -> &'static str;

    /// Returns its keys.
    fn keys(&self) -> Vec<&'static str>;

    /// Returns the schema of its keys.
    fn fields(&self) -> Fields;

    /// Returns false if the family cannot have drawn a pattern with any parameters.
    fn admits(&self, pattern: &Pattern) -> bool;

    /// Reads its keys from a mapping that may also have the keys `others`, for patterns on a canvas.
    ///
    /// # Errors
    /// When a key is unknown or missing, or no pattern satisfies the values.
    fn read(&self, node: &Node, others: &[&str], canvas: Canvas) -> Result<Vec<SampleGroup>, InputError>;
}

/// The entry of the family with these parameters.
pub struct FamilyOf<P>(PhantomData<fn() -> P>);

impl<P> FamilyOf<P> {
    /// The entry.
    pub const NEW: Self = Self(PhantomData);
}

impl<P: FamilyParameters> FamilyEntry for FamilyOf<P> {
    fn name(&self) -> &'static str {
        P::NAME
    }

    fn keys(&self) -> Vec<&'static str> {
        P::keys()
    }

    fn fields(&self) -> Fields {
        P::fields()
    }

    fn admits(&self, pattern: &Pattern) -> bool {
        P::admits(pattern)
    }

    fn read(&self, node: &Node, others: &[&str], canvas: Canvas) -> Result<Vec<SampleGroup>, InputError> {
        let groups = P::read_with(node, others)?.groups(canvas);
        groups.map_err(|why| node.peek(why.key).unwrap_or(node).error(why.error.to_string()))
    }
}
