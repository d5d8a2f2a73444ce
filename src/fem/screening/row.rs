//! The screening result of one effect, and its warning.

use super::comparison::{Comparison, assess};
use crate::effects::{DISPLACED, Effect, Significance, Verdict};
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene};

/// The screening result of one effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Its name in a scene.
    pub effect: &'static str,
    /// Number, threshold and verdict.
    pub assessment: Significance,
    /// Whether it is simulated.
    pub status: Status,
    /// Its cost, in words.
    pub cost: &'static str,
    /// Whether it acts in time only, so that no equilibrium contains it.
    pub needs_time: bool,
    /// Influence on the displacement of each pattern; empty for effects judged otherwise.
    pub comparisons: Vec<Comparison>,
    /// Number of patterns whose critical voltage was searched for; 0 for effects judged otherwise.
    pub stability_checks: usize,
}

/// Whether an effect is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The scene names it, or screening turned it on.
    On,
    /// It could be simulated and is not.
    Off,
    /// It cannot be simulated.
    NotAvailable,
}

impl Status {
    /// Returns `on`, `off` or `not available`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::On => "on",
            Self::Off => "off",
            Self::NotAvailable => "not available",
        }
    }
}

impl Row {
    pub(super) fn new(effect: &dyn Effect, judged: Judgement, effects: &Effects, scene: &Scene) -> Self {
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
            stability_checks: judged.stability_checks,
        }
    }

    /// Returns a warning if the effect is not simulated, and is significant or could not be judged within the work
    /// limit; of breakdown also if it is on.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        self.to_warning().map(|warning| warning.text())
    }

    pub(super) fn to_warning(&self) -> Option<Warning> {
        match self.status {
            // It observes the field, and changes nothing about it.
            Status::On if self.effect == names::BREAKDOWN => {
                self.warn(Some("the electric field comes close to breakdown".to_owned()))
            }
            Status::On => None,
            // A pattern that is unstable is detected anyway; what is missing is the distance of the others from it.
            Status::Off if self.effect == names::STABILITY => {
                let patterns = match self.stability_checks {
                    1 => "one pattern".to_owned(),
                    n => format!("{n} patterns"),
                };
                self.warn(Some(format!(
                    "electromechanical stability was checked on {patterns} only"
                )))
            }
            Status::Off => self.warn(None),
            Status::NotAvailable => self.warn(Some(format!("{} cannot be simulated", spoken(self.effect)))),
        }
    }

    /// The same for an equilibrium, which ignores effects in time.
    pub(super) fn to_equilibrium_warning(&self) -> Option<Warning> {
        match self.status {
            Status::On if self.needs_time => self.warn(Some(format!("an equilibrium ignores {}", spoken(self.effect)))),
            _ => self.to_warning(),
        }
    }

    /// Returns the name of the effect in a sentence if it is off and cannot be judged, because the scene has no data
    /// about it.
    pub(super) fn without_data(&self) -> Option<String> {
        let is_unchecked = self.status == Status::Off && self.assessment.verdict == Verdict::NoData;
        is_unchecked.then(|| spoken(self.effect))
    }

    /// `cause` is a sentence, or `None` if the effect is off.
    fn warn(&self, cause: Option<String>) -> Option<Warning> {
        let Significance {
            quantity,
            threshold,
            verdict,
            change,
            number,
            ..
        } = &self.assessment;
        let reason = match (verdict, number) {
            (Verdict::NotSignificant | Verdict::Unknown | Verdict::NoData, _) => return None,
            (Verdict::Significant, Some(number)) if quantity != DISPLACED => {
                format!(" ({quantity} = {number:.3}, threshold {threshold})")
            }
            (Verdict::Significant, Some(number)) if number > threshold => {
                format!(" (threshold {:.0} %)", 100.0 * threshold)
            }
            _ => String::new(),
        };
        let acts = *verdict == Verdict::Significant && (quantity == DISPLACED || self.needs_time);
        let condition = if acts && cause.is_none() { "switched on, " } else { "" };
        Some(Warning {
            effects: vec![self.effect],
            cause,
            change: format!("{condition}{change}{reason}"),
            is_work_limit: *verdict == Verdict::WorkLimit,
        })
    }
}

/// The name of an effect in a sentence.
fn spoken(effect: &str) -> String {
    effect.replace('_', " ")
}

/// A warning about effects with the same message.
pub(super) struct Warning {
    effects: Vec<&'static str>,
    /// A sentence; `None` if the effects are off.
    cause: Option<String>,
    change: String,
    is_work_limit: bool,
}

impl Warning {
    fn text(&self) -> String {
        let change = &self.change;
        if let Some(cause) = &self.cause {
            return format!("{cause}; {change}");
        }
        let names: Vec<String> = self.effects.iter().copied().map(spoken).collect();
        match names.split_last() {
            Some((last, others)) if !others.is_empty() => {
                format!("{} and {last} are off; {change}", others.join(", "))
            }
            _ => format!("{} is off; {change}", names.concat()),
        }
    }

    /// Formats warnings; effects that reached the work limit in the same way share one.
    pub fn merged(all: impl Iterator<Item = Self>) -> Vec<String> {
        let mut merged: Vec<Self> = Vec::new();
        for one in all {
            let is_mergeable = |warning: &Self| warning.is_work_limit && warning.cause.is_none();
            let same = merged
                .iter_mut()
                .find(|other| is_mergeable(&one) && is_mergeable(other) && one.change == other.change);
            match same {
                Some(other) => other.effects.extend(one.effects),
                None => merged.push(one),
            }
        }
        merged.iter().map(Self::text).collect()
    }
}

/// The assessment of an effect, with what it was derived from.
pub(super) struct Judgement {
    pub assessment: Significance,
    pub comparisons: Vec<Comparison>,
    pub stability_checks: usize,
}

impl From<Vec<Comparison>> for Judgement {
    fn from(comparisons: Vec<Comparison>) -> Self {
        Self {
            assessment: assess(&comparisons),
            comparisons,
            stability_checks: 0,
        }
    }
}

impl From<Significance> for Judgement {
    fn from(assessment: Significance) -> Self {
        Self {
            assessment,
            comparisons: Vec::new(),
            stability_checks: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_that_reach_the_work_limit_in_the_same_way_share_a_warning() {
        let warning = |effect: &'static str, change: &str, is_work_limit: bool| Warning {
            effects: vec![effect],
            cause: None,
            change: change.to_owned(),
            is_work_limit,
        };
        let all = [
            warning(names::STIFFENING, "unknown for `p`", true),
            warning(names::FRINGE, "unknown for `p`", true),
            warning(names::BREAKDOWN, "it falls", false),
            warning(names::WRINKLING, "unknown for `p`", true),
            warning(names::CHARGE, "unknown for `q`", true),
            warning(names::INERTIA, "it falls", false),
        ];
        assert_eq!(
            Warning::merged(all.into_iter()),
            [
                "strain stiffening, fringe field and wrinkling are off; unknown for `p`",
                "dielectric breakdown is off; it falls",
                "charge control is off; unknown for `q`",
                "inertia is off; it falls",
            ]
        );
    }
}
