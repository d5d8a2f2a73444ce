//! What is known about an effect in a scene.

use super::comparison::Comparison;
use crate::effects::{DISPLACED, Effect, Significance, Verdict};
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene};

/// What is known about an effect in a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Its name in a scene.
    pub effect: &'static str,
    /// How much it matters.
    pub assessment: Significance,
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
pub const NOT_EACH: &str = "not computed for each pattern";

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
        self.said().map(|said| said.text())
    }

    pub(super) fn said(&self) -> Option<Said> {
        match self.status {
            Status::On => None,
            // A pattern that loses it is found out all the same: what is left out is how far the others are from it.
            Status::Off if self.effect == names::STABILITY => self.says(["is", "are"], NOT_EACH),
            Status::Off => self.says(["is", "are"], "neglected"),
            Status::NotAvailable => self.says(["cannot", "cannot"], "be simulated yet"),
        }
    }

    /// The same where an equilibrium is looked for: no effect of time is in it.
    pub(super) fn said_of_equilibrium(&self) -> Option<Said> {
        match self.status {
            Status::On if self.needs_time => self.says(["is", "are"], "left out of an equilibrium"),
            _ => self.said(),
        }
    }

    /// What it does, after its state, where it is called for.
    fn says(&self, verbs: [&'static str; 2], state: &'static str) -> Option<Said> {
        let Significance {
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
        Some(Said {
            effects: vec![self.effect],
            verbs,
            state,
            change: format!("{change}{reason}"),
            is_given_up: *verdict == Verdict::GivenUp,
        })
    }
}

/// A warning about effects of which the same is to be said.
pub(super) struct Said {
    effects: Vec<&'static str>,
    /// Before the state, of one effect and of several.
    verbs: [&'static str; 2],
    state: &'static str,
    change: String,
    is_given_up: bool,
}

impl Said {
    fn text(&self) -> String {
        let names: Vec<String> = self.effects.iter().map(|name| name.replace('_', " ")).collect();
        let Self { state, change, .. } = self;
        match names.split_last() {
            Some((last, others)) if !others.is_empty() => {
                let [_, verb] = self.verbs;
                format!("{} and {last} {verb} {state}; they {change}", others.join(", "))
            }
            _ => format!("{} {} {state}; it {change}", names.concat(), self.verbs[0]),
        }
    }

    /// The warnings as texts: effects that could not be judged, for the same reason, have one.
    pub fn together(all: impl Iterator<Item = Self>) -> Vec<String> {
        let mut told: Vec<Self> = Vec::new();
        for one in all {
            let same = told.iter_mut().find(|other| {
                one.is_given_up && other.is_given_up && (other.state, &other.change) == (one.state, &one.change)
            });
            match same {
                Some(other) => other.effects.extend(one.effects),
                None => told.push(one),
            }
        }
        told.iter().map(Self::text).collect()
    }
}

/// How much an effect matters, and the comparisons that say so.
pub(super) struct Judged {
    pub assessment: Significance,
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

impl From<Significance> for Judged {
    fn from(assessment: Significance) -> Self {
        Self {
            assessment,
            comparisons: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_that_cannot_be_judged_for_one_reason_have_one_warning() {
        let said = |effect: &'static str, change: &str, is_given_up: bool| Said {
            effects: vec![effect],
            verbs: ["is", "are"],
            state: "neglected",
            change: change.to_owned(),
            is_given_up,
        };
        let all = [
            said(names::STIFFENING, "could not be judged by `p`", true),
            said(names::FRINGE, "could not be judged by `p`", true),
            said(names::BREAKDOWN, "lowers it", false),
            said(names::WRINKLING, "could not be judged by `p`", true),
            said(names::STABILITY, "could not be judged by `q`", true),
            said(names::INERTIA, "lowers it", false),
        ];
        assert_eq!(
            Said::together(all.into_iter()),
            [
                "strain stiffening, fringe field and wrinkling are neglected; they could not be judged by `p`",
                "dielectric breakdown is neglected; it lowers it",
                "electromechanical stability is neglected; it could not be judged by `q`",
                "inertia is neglected; it lowers it",
            ]
        );
    }
}
