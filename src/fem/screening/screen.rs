//! Screening a scene for effects.

use super::bench::Bench;
use super::row::{Judged, Row, Said};
use super::solution::{self, Purpose};
use super::trial::Trial;
use crate::effects::{DISPLACED, EFFECTS, Effect, SMALL, Significance, Solutions, Verdict};
use crate::{SetupError, WorkLimit};
use deaflow_scene::{Effects, Scene};

/// The part of all work of a pattern that its comparisons may take; the rest goes to its solution and its loss of stability.
const COMPARING: f64 = 0.5;

/// All effects that are known, screened for a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Screening {
    /// The scene with the effects that are simulated: those that it names, or those that were found to be called for
    /// where it says `effects: auto`.
    pub scene: Scene,
    /// One row for each effect.
    pub rows: Vec<Row>,
}

impl Screening {
    /// The warnings, in the order of the rows.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        Said::together(self.rows.iter().filter_map(Row::said))
    }

    /// Those of an equilibrium.
    #[must_use]
    pub fn warnings_of_equilibrium(&self) -> Vec<String> {
        let drive = &self.scene.drive;
        let left_out = [("waveform", drive.waveform.is_some()), ("rest", drive.rest.is_some())];
        let keys = left_out.into_iter().filter(|(_, is_there)| *is_there);
        let keys = keys.map(|(key, _)| format!("the drive's `{key}` is left out of an equilibrium"));
        keys.chain(Said::together(self.rows.iter().filter_map(Row::said_of_equilibrium)))
            .collect()
    }
}

/// Screens a scene for all effects with named patterns.
///
/// # Errors
/// When the scene's effects cannot be simulated.
pub fn screen(scene: &Scene, patterns: &[Trial]) -> Result<Screening, SetupError> {
    screen_within(scene, patterns, WorkLimit::default())
}

/// The same with another limit of work for each pattern.
///
/// # Errors
/// As [`screen`].
pub fn screen_within(scene: &Scene, patterns: &[Trial], limit: WorkLimit) -> Result<Screening, SetupError> {
    screen_to(Purpose::Table, scene, patterns, limit)
}

/// The same for another purpose.
///
/// # Errors
/// As [`screen`].
pub(super) fn screen_to(
    purpose: Purpose,
    scene: &Scene,
    patterns: &[Trial],
    limit: WorkLimit,
) -> Result<Screening, SetupError> {
    if purpose != Purpose::Watch {
        return ScreeningRun::new(&EFFECTS, scene, patterns, limit).finish(purpose);
    }
    // What is simulated is no warning, but for what an equilibrium leaves out.
    let off = |effect: &&dyn Effect| effect.needs_time() || effect.is_on(&scene.effects, scene) != Some(true);
    let effects: Vec<&dyn Effect> = EFFECTS.into_iter().filter(off).collect();
    let stability = scene.effects.electromechanical_stability.is_some();
    let searched = |trial: &Trial| Trial {
        to_the_limit: trial.to_the_limit && !stability,
        ..trial.clone()
    };
    let patterns: Vec<Trial> = patterns.iter().map(searched).collect();
    ScreeningRun::new(&effects, scene, &patterns, limit).finish(purpose)
}

/// Screens a scene for some effects.
///
/// # Errors
/// As [`screen`].
pub fn screen_for(effects: &[&dyn Effect], scene: &Scene, patterns: &[Trial]) -> Result<Screening, SetupError> {
    ScreeningRun::new(effects, scene, patterns, WorkLimit::default()).finish(Purpose::Table)
}

/// A screening on the way. Effects are taken one after the other, and each is compared beside those that are simulated: the ones
/// that the scene names or, where it leaves them open, the ones before it that are called for.
struct ScreeningRun<'a> {
    effects: &'a [&'a dyn Effect],
    scene: &'a Scene,
    patterns: &'a [Trial],
    limit: WorkLimit,
    /// What is simulated.
    chosen: Effects,
    bench: Bench,
}

impl<'a> ScreeningRun<'a> {
    fn new(effects: &'a [&'a dyn Effect], scene: &'a Scene, patterns: &'a [Trial], limit: WorkLimit) -> Self {
        Self {
            effects,
            scene,
            patterns,
            limit,
            chosen: scene.effects.clone(),
            bench: Bench::new(patterns, limit.part(COMPARING)),
        }
    }

    fn finish(mut self, purpose: Purpose) -> Result<Screening, SetupError> {
        let mut judged = Vec::with_capacity(self.effects.len());
        for effect in self.effects {
            judged.push(self.before_solutions(*effect)?);
        }
        if judged.iter().any(Option::is_none) {
            self.by_solutions(purpose, &mut judged)?;
        }
        let rows = self.effects.iter().zip(judged);
        let rows = rows.filter_map(|(effect, judged)| Some(Row::new(*effect, judged?, &self.chosen, self.scene)));
        Ok(Screening {
            rows: rows.collect(),
            scene: self.scene.with_effects(self.chosen),
        })
    }

    /// Judges by solutions of the scene as it stands what is not judged yet.
    fn by_solutions(&mut self, purpose: Purpose, judged: &mut [Option<Judged>]) -> Result<(), SetupError> {
        let scene = self.scene.with_effects(self.chosen.clone());
        let examined = solution::examine(&scene, self.patterns, purpose, self.limit.part(1.0 - COMPARING))?;
        let solutions = Solutions { examined: &examined };
        for (effect, judged) in self.effects.iter().zip(judged) {
            if judged.is_some() {
                continue;
            }
            let Some(assessment) = effect.assess_solutions(&scene, &solutions) else {
                continue;
            };
            self.turn_on_if_called_for(*effect, &assessment);
            *judged = Some(assessment.into());
        }
        Ok(())
    }

    /// Judges an effect by the scene alone or by what it does to the displacement; `None` where solutions are to tell.
    fn before_solutions(&mut self, effect: &dyn Effect) -> Result<Option<Judged>, SetupError> {
        if let Some(assessment) = effect.assess(self.scene) {
            self.turn_on_if_called_for(effect, &assessment);
            return Ok(Some(assessment.into()));
        }
        if !effect.moves_membrane() {
            return Ok(None);
        }
        self.compare(effect).map(Some)
    }

    fn compare(&mut self, effect: &dyn Effect) -> Result<Judged, SetupError> {
        let is_on = effect.is_on(&self.chosen, self.scene) == Some(true);
        let mut others = self.chosen.clone();
        if is_on {
            effect.turn_off(&mut others);
        } else {
            effect.turn_on(&mut others, self.scene);
        }
        let [current, other] = [&self.chosen, &others].map(|effects| self.scene.with_effects(effects.clone()));
        let other = match self.bench.prepare(&current, &other) {
            Ok(other) => other,
            Err(refusal) if self.scene.auto => return Err(refusal),
            Err(refusal) => return Ok(refused(&refusal).into()),
        };
        let judged = Judged::by(self.bench.compare(&other, !is_on)?);
        if self.scene.auto && judged.assessment.verdict == Verdict::CalledFor {
            self.chosen = others;
            self.bench.adopt(other);
        }
        Ok(judged)
    }

    /// Turns on what is called for, with the parameters that the scene knows, where the scene leaves it open.
    fn turn_on_if_called_for(&mut self, effect: &dyn Effect, assessment: &Significance) {
        if self.scene.auto && assessment.verdict == Verdict::CalledFor {
            effect.turn_on(&mut self.chosen, self.scene);
        }
    }
}

/// An effect that the scene has data for and that cannot be simulated with them.
fn refused(refusal: &SetupError) -> Significance {
    let change = format!("cannot be compared: {refusal}");
    Significance::open(DISPLACED, Verdict::CalledFor, SMALL, change)
}
