//! What screening asks of an effect.
//!
//! An effect has a number without unit that says how much it matters, and a threshold above which it is called for. The number
//! of an effect that moves the membrane is how much: solutions with it are compared with solutions without it. Others follow from the
//! scene alone, or from solutions for a few patterns.

use crate::critical::CriticalVoltage;
use deaflow_field::Outcome;
use deaflow_scene::{Effects, Scene};

/// An effect beyond the base model.
pub trait Effect: Sync {
    /// Its name in a scene.
    fn name(&self) -> &'static str;

    /// What it costs over the base model, in words; `benches/effects.rs` measures it.
    fn cost(&self) -> &'static str;

    /// Whether it is among these effects of a scene; `None` where it cannot be simulated yet.
    fn is_on(&self, effects: &Effects, scene: &Scene) -> Option<bool> {
        let _ = (effects, scene);
        None
    }

    /// Turns it on with the parameters that the scene knows; does nothing where it cannot be simulated.
    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        let _ = (effects, scene);
    }

    /// Turns it off.
    fn turn_off(&self, effects: &mut Effects) {
        let _ = effects;
    }

    /// Whether it shows in time alone: no equilibrium has it.
    fn needs_time(&self) -> bool {
        false
    }

    /// Whether it is judged by what it does to the displacement: solutions with it are compared with solutions without it.
    fn moves_membrane(&self) -> bool {
        false
    }

    /// How much it matters; `None` where a solution tells.
    fn assess(&self, scene: &Scene) -> Option<Significance> {
        let _ = scene;
        None
    }

    /// How much it matters by solutions of the scene; `None` where the scene tells.
    fn assess_solutions(&self, scene: &Scene, solutions: &Solutions<'_>) -> Option<Significance> {
        let _ = (scene, solutions);
        None
    }
}

/// How much an effect matters.
#[derive(Clone, Debug, PartialEq)]
pub struct Significance {
    /// What the number is, as a formula.
    pub quantity: String,
    /// The number; `None` where it cannot be computed or does not arise.
    pub number: Option<f64>,
    /// Above it the effect is called for.
    pub threshold: f64,
    /// How far the true number may lie on either side, where that is known.
    pub error: Option<f64>,
    /// Whether it is called for.
    pub verdict: Verdict,
    /// What it does, in words that follow its name: `changes the electric stress by -3.0 %`.
    pub change: String,
}

/// The number of an effect that moves the membrane: the largest difference over the cell corners, over the largest displacement
/// without it.
pub const DISPLACED: &str = "max |Δu|/max |u|";

/// Whether an effect is called for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The number is above the threshold.
    CalledFor,
    /// It is not, or the question does not arise.
    NotCalledFor,
    /// What is not given, or a state that there is none of, decides.
    Unknown,
    /// The work that is allowed was done before it was known.
    GivenUp,
}

impl Verdict {
    /// `yes`, `no` or `unknown`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::CalledFor => "yes",
            Self::NotCalledFor => "no",
            Self::Unknown | Self::GivenUp => "unknown",
        }
    }
}

impl Significance {
    /// One by a number.
    #[must_use]
    pub fn known(quantity: &str, number: f64, threshold: f64, change: String) -> Self {
        // Rounding alone is no reason.
        let verdict = match number > threshold + 1e-9 {
            true => Verdict::CalledFor,
            false => Verdict::NotCalledFor,
        };
        Self {
            // No negative zero.
            number: Some(number + 0.0),
            ..Self::open(quantity, verdict, threshold, change)
        }
    }

    /// One without a number.
    #[must_use]
    pub fn open(quantity: &str, verdict: Verdict, threshold: f64, change: String) -> Self {
        Self {
            quantity: quantity.to_owned(),
            number: None,
            error: None,
            threshold,
            verdict,
            change,
        }
    }

    /// One of an effect that moves the membrane and lacks data.
    pub(super) fn lacks_data(matters_if: &str) -> Self {
        let change = format!("no data: matters from about {matters_if}");
        Self::open(DISPLACED, Verdict::Unknown, SMALL, change)
    }

    /// One of a question that does not arise.
    pub(super) fn does_not_arise(why: &str) -> Self {
        Self::open("–", Verdict::NotCalledFor, 0.0, why.to_owned())
    }
}

/// What the solutions for a few patterns say, on a coarse mesh.
#[derive(Clone, Copy, Debug)]
pub struct Solutions<'a> {
    /// One for each pattern.
    pub examined: &'a [Examined],
}

/// What the solution for a pattern says.
#[derive(Clone, Debug, PartialEq)]
pub struct Examined {
    /// Name of the pattern.
    pub pattern: String,
    /// How its simulation ends at the voltage of the scene.
    pub outcome: Outcome,
    /// Largest E/E_B over the cells; where there is no stable state, that of the membrane at rest.
    pub field: f64,
    /// Where it loses stability; `None` where that was not asked and it has a stable state at the voltage of the scene.
    pub stability: Option<Stability>,
}

/// How far a pattern is stable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stability {
    /// Up to a voltage at which it is lost.
    Lost(CriticalVoltage),
    /// Nowhere.
    Never,
    /// At least up to this voltage in V: the search ended there.
    UpTo(f64),
}

impl Solutions<'_> {
    /// The largest of some numbers, and the pattern that has it.
    pub(super) fn worst(&self, number: impl Fn(&Examined) -> f64) -> Option<&Examined> {
        self.examined.iter().max_by(|a, b| number(a).total_cmp(&number(b)))
    }
}

/// Change of displacement, as a share of the largest, that is worth an effect; and of stiffness, where an effect cannot be
/// simulated yet.
pub const SMALL: f64 = 0.02;
