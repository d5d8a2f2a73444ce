//! What differs from one device to the next.

use std::path::Path;

use super::geometry::Both;
use super::model::{SECTIONS, WHAT};
use deaflow_base::{
    Canonical, Decimal, Declared, Document, InputError, Length, Map, Node, NodeValue, Parameter, Schema, parameters,
    words,
};

/// Largest relative standard deviations: of a normal distribution, whose values stay positive then, and of the other.
const LARGEST_NORMAL: f64 = 0.15;
const LARGEST: f64 = 1.0;
/// Largest standard deviation of a length, mm.
const LONGEST: f64 = 1e3;

words! {
    /// The distribution of a factor.
    pub enum Distribution {
        /// 1 + σz with z normally distributed.
        Normal = "normal",
        /// exp(sz − s²/2) with s² = ln(1 + σ²), whose mean is 1.
        Lognormal = "lognormal",
    }
}

parameters! {
    /// The factor of a quantity, whose mean is 1.
    pub struct Factor as "a tolerance" {
        /// Its standard deviation.
        pub relative: Decimal [0.0..=LARGEST],
        /// Its distribution.
        pub distribution: Distribution = Distribution::Normal,
    }
    check(check_factor)
}

fn check_factor(factor: &Factor, map: &Map<'_>) -> Result<(), InputError> {
    let is_normal = factor.distribution == Distribution::Normal;
    match is_normal && factor.relative.to_f64() > LARGEST_NORMAL {
        true => Err(map
            .error(format!(
                "a normal distribution has a relative standard deviation of at most {} %",
                100.0 * LARGEST_NORMAL
            ))
            .help("use { relative: 30 %, distribution: lognormal }")),
        false => Ok(()),
    }
}

impl Spread {
    fn with_advice(error: InputError) -> InputError {
        error.help(format!(
            "allowed: 0 % to {} %, or {{ relative: 30 %, distribution: lognormal }}",
            100.0 * LARGEST_NORMAL
        ))
    }
}

/// A [`Factor`], in short its standard deviation if it is normally distributed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Spread(pub Factor);

impl Parameter for Spread {
    type Limits = ();
    type Literal = f64;

    fn read(node: &Node, key: &str, _: &()) -> Result<Self, InputError> {
        match node.value() {
            NodeValue::Map(_) => Factor::read_with(node, &[]).map(Self),
            _ => Decimal::read(node, key, &(0.0..=LARGEST_NORMAL))
                .map_err(Self::with_advice)
                .map(|relative| {
                    Self(Factor {
                        relative,
                        distribution: Distribution::Normal,
                    })
                }),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.0.to_canonical())
    }

    fn schema(_: &()) -> Schema {
        Schema::any_of([Decimal::schema(&(0.0..=LARGEST_NORMAL)), Factor::schema(&())])
    }

    fn literal(relative: f64) -> Self {
        Self(Factor {
            relative: Decimal::literal(relative),
            distribution: Distribution::Normal,
        })
    }
}

parameters! {
    /// What differs from one device to the next: standard deviations. They do not change a simulation of the scene.
    pub struct Tolerances as "`tolerances`" {
        /// The voltage, relative.
        pub voltage: Option<Spread>,
        /// The shear modulus, relative.
        pub shear_modulus: Option<Spread>,
        /// The undeformed thickness, relative.
        pub thickness: Option<Spread>,
        /// The permittivity, relative.
        pub permittivity: Option<Spread>,
        /// The prestretch, relative.
        pub prestretch: Option<Spread>,
        /// By how much electrodes are wider at each edge than drawn; narrower if negative.
        pub mask: Option<Length> [0.0..=LONGEST],
        /// Where the upper electrode lies against the lower one, along x and y; only their overlap is active.
        pub misregistration: Option<Both<Length>> [0.0..=LONGEST],
        /// The probability that a cell with an electrode has none.
        pub lost_cells: Option<Decimal> [0.0..=1.0],
    }
}

impl Tolerances {
    /// Reads the tolerances of the scene in a node of a document.
    ///
    /// # Errors
    /// When a key is unknown, or a value is out of range.
    pub fn of_scene(scene: &Node) -> Result<Option<Self>, InputError> {
        let node = scene.fields(WHAT, &SECTIONS)?.optional("tolerances");
        node.map(|node| Self::read_with(node, &[])).transpose()
    }

    /// Returns the tolerances in YAML on one line.
    #[must_use]
    pub fn to_text(&self) -> String {
        self.to_canonical().to_string()
    }

    /// Reads the text of [`Tolerances::to_text`].
    ///
    /// # Errors
    /// When the text is not valid.
    pub fn from_text(text: &str) -> Result<Self, InputError> {
        Self::read_with(&Document::from_text(Path::new("tolerances"), text)?.root, &[])
    }
}
