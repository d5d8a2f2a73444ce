//! What is known about an effect in a scene.

use super::comparison::Comparison;
use crate::fem::effects::{Assessment, DISPLACED, Effect, Verdict};
use crate::scene::effects::names;
use crate::scene::{Effects, Scene};

/// What is known about an effect in a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Its name in a scene.
    pub effect: &'static str,
    /// How much it matters.
    pub assessment: Assessment,
    /// Whether it is simulated.
    pub status: Status,
    /// What it would cost, in words.
    pub cost: &'static str,
    /// Whether it shows in time alone.
    pub needs_time: bool,
    /// What it does to the displacement of each pattern; none where it is judged otherwise.
    pub comparisons: Vec<Comparison>,
}

/// Whether an effect is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The scene names it, or screening turned it on.
    On,
    /// It could be simulated and is not.
    Off,
    /// It cannot be simulated yet.
    NotAvailable,
}

impl Status {
    /// `on`, `off` or `not available`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::On => "on",
            Self::Off => "off",
            Self::NotAvailable => "not available",
        }
    }
}

/// What is said of the critical voltage where each pattern's own is left out.
pub const NOT_EACH: &str = "is not computed for each pattern";

impl Row {
    pub(super) fn new(effect: &dyn Effect, judged: Judged, effects: &Effects, scene: &Scene) -> Self {
        let status = match effect.is_on(effects, scene) {
            Some(true) => Status::On,
            Some(false) => Status::Off,
            None => Status::NotAvailable,
        };
        Self {
            effect: effect.name(),
            assessment: judged.assessment,
            status,
            cost: effect.cost(),
            needs_time: effect.needs_time(),
            comparisons: judged.comparisons,
        }
    }

    /// The warning that belongs to an effect that is called for and not simulated: what it does, how much, and from when that matters. So
    /// does one to an effect whose comparison took more work than is allowed.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        match self.status {
            Status::On => None,
            // A pattern that loses it is found out all the same: what is left out is how far the others are from it.
            Status::Off if self.effect == names::STABILITY => self.says(NOT_EACH),
            Status::Off => self.says("is neglected"),
            Status::NotAvailable => self.says("cannot be simulated yet"),
        }
    }

    /// The same where an equilibrium is looked for: no effect of time is in it.
    #[must_use]
    pub fn warning_of_equilibrium(&self) -> Option<String> {
        match self.status {
            Status::On if self.needs_time => self.says("is left out of an equilibrium"),
            _ => self.warning(),
        }
    }

    /// What it does, after its state, where it is called for.
    fn says(&self, state: &str) -> Option<String> {
        let Assessment {
            quantity,
            threshold,
            verdict,
            change,
            number,
            ..
        } = &self.assessment;
        let reason = match (verdict, number) {
            (Verdict::NotCalledFor | Verdict::Unknown, _) => return None,
            (Verdict::CalledFor, Some(number)) if quantity != DISPLACED => {
                format!(" ({quantity} is {number:.3}, and above {threshold} it matters)")
            }
            (Verdict::CalledFor, Some(number)) if number > threshold => {
                format!(", and matters from {:.0} % on", 100.0 * threshold)
            }
            _ => String::new(),
        };
        let name = self.effect.replace('_', " ");
        Some(format!("{name} {state}; it {change}{reason}"))
    }
}

/// How much an effect matters, and the comparisons that say so.
pub(super) struct Judged {
    pub assessment: Assessment,
    pub comparisons: Vec<Comparison>,
}

impl Judged {
    /// By its comparisons.
    pub fn by(comparisons: Vec<Comparison>) -> Self {
        Self {
            assessment: super::comparison::assess(&comparisons),
            comparisons,
        }
    }
}

impl From<Assessment> for Judged {
    fn from(assessment: Assessment) -> Self {
        Self {
            assessment,
            comparisons: Vec::new(),
        }
    }
}
