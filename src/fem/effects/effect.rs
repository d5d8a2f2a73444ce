//! The interface of effects to screening.
//!
//! An effect has a dimensionless number and a threshold above which it is significant. For an effect that changes the
//! displacement the number comes from solutions with and without it; others are judged by the scene alone, or by
//! solutions for a few patterns.

use crate::critical::CriticalVoltage;
use deaflow_field::Outcome;
use deaflow_scene::{Effects, Scene};

/// An effect beyond the base model.
pub trait Effect: Sync {
    /// Returns its name in a scene.
    fn name(&self) -> &'static str;

    /// Returns its cost over the base model in words, as measured by `benches/effects.rs`.
    fn cost(&self) -> &'static str;

    /// Returns whether it is among these effects of a scene; `None` if it cannot be simulated.
    fn is_on(&self, effects: &Effects, scene: &Scene) -> Option<bool> {
        let _ = (effects, scene);
        None
    }

    /// Turns it on with the parameters of the scene; does nothing if it cannot be simulated.
    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        let _ = (effects, scene);
    }

    /// Turns it off.
    fn turn_off(&self, effects: &mut Effects) {
        let _ = effects;
    }

    /// Returns whether it acts in time only, so that no equilibrium contains it.
    fn needs_time(&self) -> bool {
        false
    }

    /// Returns whether it is judged by comparing displacements with and without it.
    fn changes_displacement(&self) -> bool {
        false
    }

    /// Judges it by the scene alone; `None` if that takes solutions.
    fn assess(&self, scene: &Scene) -> Option<Significance> {
        let _ = scene;
        None
    }

    /// Judges it by solutions of the scene; `None` if the scene alone decides.
    fn assess_solutions(&self, scene: &Scene, solutions: &Solutions<'_>) -> Option<Significance> {
        let _ = (scene, solutions);
        None
    }
}

/// Implements [`Effect::is_on`] and [`Effect::turn_off`] for a field of [`Effects`].
macro_rules! switch {
    ($field:ident) => {
        fn is_on(&self, effects: &Effects, _scene: &Scene) -> Option<bool> {
            Some(effects.$field.is_some())
        }

        fn turn_off(&self, effects: &mut Effects) {
            effects.$field = None;
        }
    };
}
pub(super) use switch;

/// How significant an effect is.
#[derive(Clone, Debug, PartialEq)]
pub struct Significance {
    /// Formula of the number.
    pub quantity: String,
    /// The number; `None` if it cannot be computed or does not apply.
    pub number: Option<f64>,
    /// The effect is significant above this number.
    pub threshold: f64,
    /// Error of the number on either side, if known.
    pub error: Option<f64>,
    /// Whether it is significant.
    pub verdict: Verdict,
    /// Change if it were switched on, as a sentence.
    pub change: String,
}

/// The number of an effect that changes the displacement: largest difference at a cell corner, relative to the largest
/// displacement without it.
pub const DISPLACED: &str = "max |Δu|/max |u|";

/// Whether an effect is significant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The number is above the threshold.
    Significant,
    /// The number is below the threshold, or the effect does not apply.
    NotSignificant,
    /// A stable state is missing.
    Unknown,
    /// Data of the material is missing.
    NoData,
    /// The work limit was reached before it was known.
    WorkLimit,
}

impl Verdict {
    /// Returns `yes`, `no` or `unknown`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Significant => "yes",
            Self::NotSignificant => "no",
            Self::Unknown | Self::NoData | Self::WorkLimit => "unknown",
        }
    }
}

impl Significance {
    /// Compares a number with a threshold.
    #[must_use]
    pub fn known(quantity: &str, number: f64, threshold: f64, change: impl Into<String>) -> Self {
        // The margin allows for rounding.
        let verdict = match number > threshold + 1e-9 {
            true => Verdict::Significant,
            false => Verdict::NotSignificant,
        };
        Self {
            // Avoids a negative zero.
            number: Some(number + 0.0),
            ..Self::open(quantity, verdict, threshold, change)
        }
    }

    /// Creates a verdict without a number.
    #[must_use]
    pub fn open(quantity: &str, verdict: Verdict, threshold: f64, change: impl Into<String>) -> Self {
        Self {
            quantity: quantity.to_owned(),
            number: None,
            error: None,
            threshold,
            verdict,
            change: change.into(),
        }
    }

    /// An effect on the displacement without material data; `condition` says when it would be significant.
    pub(super) fn lacks_data(condition: &str) -> Self {
        let change = format!("no data; significant for about {condition}");
        Self::open(DISPLACED, Verdict::NoData, SMALL, change)
    }

    /// An effect that does not apply to the scene.
    pub(super) fn not_applicable(why: &str) -> Self {
        Self::open("–", Verdict::NotSignificant, 0.0, why)
    }
}

/// Results for a few patterns on a coarse mesh.
#[derive(Clone, Copy, Debug)]
pub struct Solutions<'a> {
    /// One result for each pattern.
    pub examined: &'a [Examined],
}

/// Result for one pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct Examined {
    /// Name of the pattern.
    pub pattern: String,
    /// Outcome at the voltage of the scene.
    pub outcome: Outcome,
    /// Largest E/E_B over the cells; without a stable state, that of the membrane at rest.
    pub field: f64,
    /// Its critical voltage; `None` if it was not searched for and the pattern is stable at the voltage of the scene.
    pub stability: Option<StableRange>,
}

/// The range of voltages in which a pattern is stable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StableRange {
    /// Stable up to a critical voltage.
    Lost(CriticalVoltage),
    /// Unstable at any voltage.
    Nowhere,
    /// Stable at least up to this voltage in V, at which the search ended.
    UpTo(f64),
}

impl Solutions<'_> {
    /// Returns the pattern with the largest number.
    pub(super) fn worst(&self, number: impl Fn(&Examined) -> f64) -> Option<&Examined> {
        self.examined.iter().max_by(|a, b| number(a).total_cmp(&number(b)))
    }
}

/// Threshold of a relative change of displacement, or of stiffness for estimates without a solution.
pub const SMALL: f64 = 0.02;
