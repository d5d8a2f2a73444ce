//! Screening a scene for effects.

use super::comparer::Comparer;
use super::examine::{Purpose, examine};
use super::row::{Judgement, Row, Warning};
use super::test_pattern::TestPattern;
use crate::effects::{DISPLACED, EFFECTS, Effect, Examined, SMALL, Significance, Solutions, Verdict};
use crate::{SetupError, WorkLimit};
use deaflow_base::four_significant;
use deaflow_scene::effects::names;
use deaflow_scene::{Bar, Edge, Effects, Scene, Sides};

/// How the line of effects begins that could not be judged.
pub const NO_DATA: &str = "not checked, no data: ";

/// Share of the work for a pattern that its comparisons may take; the rest is for its solution and critical voltage.
const COMPARING: f64 = 0.5;

/// Elements that do not resolve the strips of a fringe field underestimate its influence by up to a half, near a loss of
/// stability by more: above this number, a quarter of the threshold, it is computed again.
const IN_DOUBT: f64 = 0.25 * SMALL;

/// The screening of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Screening {
    /// The scene with its simulated effects: those that it names, or the significant ones with `effects: auto`.
    pub scene: Scene,
    /// One row for each effect.
    pub rows: Vec<Row>,
}

impl Screening {
    /// Returns the warnings in the order of the rows.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        Warning::merged(self.rows.iter().filter_map(Row::to_warning))
    }

    /// Returns a line with the effects that could not be judged, because the scene has no data about them.
    #[must_use]
    pub fn not_checked(&self) -> Option<String> {
        let effects: Vec<String> = self.rows.iter().filter_map(Row::without_data).collect();
        (!effects.is_empty()).then(|| format!("{NO_DATA}{}", effects.join(", ")))
    }

    /// Returns the warnings of an equilibrium, which ignores the drive in time.
    #[must_use]
    pub fn warnings_of_equilibrium(&self) -> Vec<String> {
        let drive = &self.scene.drive;
        let ignored = [("waveform", drive.waveform.is_some()), ("rest", drive.rest.is_some())];
        let keys = ignored.into_iter().filter(|(_, is_set)| *is_set);
        let keys = keys.map(|(key, _)| format!("an equilibrium ignores the drive's `{key}`"));
        let rows = self.rows.iter().filter_map(Row::to_equilibrium_warning);
        keys.chain(masses(&self.scene)).chain(Warning::merged(rows)).collect()
    }
}

/// Warns of bars with a mass and without a load, which is what a weight is in an equilibrium.
fn masses(scene: &Scene) -> Vec<String> {
    const GRAVITY: f64 = 9.81;
    let bars = scene.geometry.sides.iter().flat_map(Sides::bars);
    let idle = bars.filter(|(_, bar)| bar.mass_kg() > 0.0 && bar.load_n() == [0.0; 2]);
    let warning = |(edge, bar): (Edge, &Bar)| {
        let (grams, newtons) = (1e3 * bar.mass_kg(), GRAVITY * bar.mass_kg());
        format!(
            "the mass of the bar on the {} side does not act in an equilibrium: {} g weigh {} N; write `load`",
            edge.name(),
            four_significant(grams),
            four_significant(newtons)
        )
    };
    idle.map(warning).collect()
}

/// Screens a scene for all effects with some patterns.
///
/// # Errors
/// If the effects of the scene cannot be simulated.
pub fn screen(scene: &Scene, patterns: &[TestPattern]) -> Result<Screening, SetupError> {
    screen_within(scene, patterns, WorkLimit::default())
}

/// Like [`screen`], with a work limit for each pattern.
///
/// # Errors
/// As [`screen`].
pub fn screen_within(scene: &Scene, patterns: &[TestPattern], limit: WorkLimit) -> Result<Screening, SetupError> {
    screen_to(Purpose::Table, scene, patterns, limit)
}

pub(super) fn screen_to(
    purpose: Purpose,
    scene: &Scene,
    patterns: &[TestPattern],
    limit: WorkLimit,
) -> Result<Screening, SetupError> {
    ScreeningRun::new(&EFFECTS, scene, patterns, limit, purpose).finish()
}

/// Screens a scene for the effects that its results neglect, with some patterns. `solved` are the solutions of all
/// patterns that were simulated; without them the patterns are solved on a coarse mesh.
pub(super) fn screen_for_warnings(
    scene: &Scene,
    patterns: &[TestPattern],
    solved: Option<&[Examined]>,
    limit: WorkLimit,
) -> Result<Screening, SetupError> {
    // Effects that are on need no warning, except those in time, which an equilibrium ignores, and breakdown. The
    // stability of the patterns is known from their own results.
    let is_open = |effect: &&dyn Effect| match effect.name() {
        names::STABILITY => false,
        names::BREAKDOWN => true,
        _ => effect.needs_time() || effect.is_on(&scene.effects, scene) != Some(true),
    };
    let effects: Vec<&dyn Effect> = EFFECTS.into_iter().filter(is_open).collect();
    let run = ScreeningRun::new(&effects, scene, patterns, limit, Purpose::Warnings);
    ScreeningRun { solved, ..run }.finish()
}

/// Screens a scene for some effects.
///
/// # Errors
/// As [`screen`].
pub fn screen_for(effects: &[&dyn Effect], scene: &Scene, patterns: &[TestPattern]) -> Result<Screening, SetupError> {
    ScreeningRun::new(effects, scene, patterns, WorkLimit::default(), Purpose::Table).finish()
}

/// A screening in progress. Effects are judged one after the other, each on top of the simulated ones: those that the
/// scene names or, with `effects: auto`, the significant ones before it.
struct ScreeningRun<'a> {
    effects: &'a [&'a dyn Effect],
    scene: &'a Scene,
    patterns: &'a [TestPattern],
    limit: WorkLimit,
    purpose: Purpose,
    /// The solutions that are judged, if they are known.
    solved: Option<&'a [Examined]>,
    /// The simulated effects.
    chosen: Effects,
    comparer: Comparer,
}

impl<'a> ScreeningRun<'a> {
    fn new(
        effects: &'a [&'a dyn Effect],
        scene: &'a Scene,
        patterns: &'a [TestPattern],
        limit: WorkLimit,
        purpose: Purpose,
    ) -> Self {
        Self {
            effects,
            scene,
            patterns,
            limit,
            purpose,
            solved: None,
            chosen: scene.effects.clone(),
            comparer: Comparer::new(patterns, purpose, limit.part(COMPARING)),
        }
    }

    fn finish(mut self) -> Result<Screening, SetupError> {
        let mut judged = Vec::with_capacity(self.effects.len());
        for effect in self.effects {
            judged.push(self.judge_by_scene_or_comparison(*effect)?);
        }
        if judged.iter().any(Option::is_none) {
            self.judge_by_solutions(&mut judged)?;
        }
        let rows = self.effects.iter().zip(judged);
        let rows = rows.filter_map(|(effect, judged)| Some(Row::new(*effect, judged?, &self.chosen, self.scene)));
        Ok(Screening {
            rows: rows.collect(),
            scene: self.scene.with_effects(self.chosen),
        })
    }

    /// Judges the remaining effects by solutions of the scene with its simulated effects.
    fn judge_by_solutions(&mut self, judged: &mut [Option<Judgement>]) -> Result<(), SetupError> {
        let scene = self.scene.with_effects(self.chosen.clone());
        let examined = match (self.solved, self.purpose) {
            (Some(solved), _) => solved.to_vec(),
            (None, Purpose::Warnings) => self.comparer.examine(&scene)?,
            (None, purpose) => examine(&scene, self.patterns, purpose, self.limit.part(1.0 - COMPARING))?,
        };
        let solutions = Solutions { examined: &examined };
        for (effect, judged) in self.effects.iter().zip(judged) {
            if judged.is_some() {
                continue;
            }
            let Some(assessment) = effect.assess_solutions(&scene, &solutions) else {
                continue;
            };
            self.turn_on_if_significant(*effect, &assessment);
            let stability_checks = match effect.name() {
                names::STABILITY => self.patterns.iter().filter(|one| one.find_critical_voltage).count(),
                _ => 0,
            };
            *judged = Some(Judgement {
                stability_checks,
                ..assessment.into()
            });
        }
        Ok(())
    }

    /// Judges an effect by the scene alone or by its influence on the displacement; `None` if it is judged by
    /// solutions.
    fn judge_by_scene_or_comparison(&mut self, effect: &dyn Effect) -> Result<Option<Judgement>, SetupError> {
        if let Some(assessment) = effect.assess(self.scene) {
            self.turn_on_if_significant(effect, &assessment);
            return Ok(Some(assessment.into()));
        }
        if !effect.changes_displacement() {
            return Ok(None);
        }
        self.compare(effect).map(Some)
    }

    fn compare(&mut self, effect: &dyn Effect) -> Result<Judgement, SetupError> {
        if self.patterns.is_empty() {
            return Ok(Vec::new().into());
        }
        let is_on = effect.is_on(&self.chosen, self.scene) == Some(true);
        let mut others = self.chosen.clone();
        if is_on {
            effect.turn_off(&mut others);
        } else {
            effect.turn_on(&mut others, self.scene);
        }
        let [current, other_scene] = [&self.chosen, &others].map(|effects| self.scene.with_effects(effects.clone()));
        let other = match self.comparer.prepare(&current, &other_scene) {
            Ok(other) => other,
            Err(error) if self.scene.auto => return Err(error),
            Err(error) => {
                let change = format!("it could not be simulated: {error}");
                return Ok(Significance::open(DISPLACED, Verdict::Significant, SMALL, change).into());
            }
        };
        let mut judged = Judgement::from(self.comparer.compare(&other, !is_on)?);
        let is_fringed = [&current, &other_scene]
            .iter()
            .any(|scene| scene.effects.fringe_field.is_some());
        if self.purpose == Purpose::Warnings && is_fringed && judged.assessment.number.is_some_and(|n| n > IN_DOUBT) {
            let mut fine = self.comparer.resolving_strips(&judged.comparisons);
            let other = fine.prepare(&current, &other_scene)?;
            judged = fine.compare(&other, !is_on)?.into();
        }
        if self.scene.auto && judged.assessment.verdict == Verdict::Significant {
            self.chosen = others;
            self.comparer.adopt(other);
        }
        Ok(judged)
    }

    /// Turns a significant effect on if the scene says `effects: auto`.
    fn turn_on_if_significant(&mut self, effect: &dyn Effect, assessment: &Significance) {
        if self.scene.auto && assessment.verdict == Verdict::Significant {
            effect.turn_on(&mut self.chosen, self.scene);
        }
    }
}
