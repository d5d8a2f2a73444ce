//! Which effects a scene calls for.
//!
//! Each of the [effects](super::effects) says how much it matters, most by the scene alone. The rest ask for solutions, which
//! are computed on a coarse mesh for a few patterns, between them as extreme as patterns are.

mod solution;
#[cfg(test)]
mod tests;

use crate::fem::SetupError;
use crate::fem::effects::{Assessment, EFFECTS, Effect, NEAR, Solutions, Verdict};
use crate::pattern::{CELLS, Pattern};
use crate::scene::{Effects, Scene};

/// The end of the stable branch is searched for up to the voltage of the scene over the root of this share of κ: what is
/// further away does not matter, and stiffening laws make it dear to find.
const FAR: f64 = 0.1;

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

impl Row {
    fn new(effect: &dyn Effect, assessment: Assessment, effects: &Effects) -> Self {
        let status = match effect.is_on(effects) {
            Some(true) => Status::On,
            Some(false) => Status::Off,
            None => Status::NotAvailable,
        };
        Self {
            effect: effect.name(),
            assessment,
            status,
            cost: effect.cost(),
        }
    }

    /// The warning that belongs to an effect that is called for and not simulated: what it does, its number and the threshold.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let Assessment {
            quantity,
            threshold,
            verdict,
            change,
            number,
            ..
        } = &self.assessment;
        let number = (*number)?;
        let state = match self.status {
            Status::On => return None,
            Status::Off => "is neglected",
            Status::NotAvailable => "cannot be simulated yet",
        };
        let name = self.effect.replace('_', " ");
        (*verdict == Verdict::CalledFor)
            .then(|| format!("{name} {state} and {change} ({quantity} = {number:.3} > {threshold})"))
    }
}

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
        self.rows.iter().filter_map(Row::warning).collect()
    }
}

/// A pattern that a scene is screened with.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Its name in the rows.
    pub name: String,
    /// The pattern.
    pub pattern: Pattern,
    /// Whether the voltage at which its stability is lost is searched for; that is the dear part.
    pub to_the_limit: bool,
}

impl Trial {
    /// A pattern that is screened in every respect.
    #[must_use]
    pub fn new(name: &str, pattern: Pattern) -> Self {
        Self {
            name: name.to_owned(),
            pattern,
            to_the_limit: true,
        }
    }
}

fn half_plane() -> Trial {
    Trial::new("half plane", Pattern::from_fn(|x, _| x < CELLS / 2))
}

fn one_cell() -> Trial {
    Trial::new("one cell", Pattern::from_fn(|x, y| (x, y) == (CELLS / 2, CELLS / 2)))
}

/// The patterns that a scene is screened with: all of the membrane, half of it, a disc of radius 0.3 L, blocks of 10 cells
/// like a chessboard, a single cell, and all but a single cell.
#[must_use]
pub fn reference_patterns() -> Vec<Trial> {
    let from_centre = |x: usize, y: usize| (x as f64 + 0.5 - 25.0).hypot(y as f64 + 0.5 - 25.0);
    vec![
        half_plane(),
        one_cell(),
        Trial::new("all active", Pattern::from_fn(|_, _| true)),
        Trial::new("disc", Pattern::from_fn(|x, y| from_centre(x, y) < 15.0)),
        Trial::new("blocks", Pattern::from_fn(|x, y| (x / 10 + y / 10) % 2 == 0)),
        Trial::new("one hole", Pattern::from_fn(|x, y| (x, y) != (CELLS / 2, CELLS / 2))),
    ]
}

/// The two of the reference patterns that go furthest: half of the membrane, which moves most, and a single cell, whose
/// stability is lost first. They are what a run is watched with: it costs some tens of milliseconds.
#[must_use]
pub fn watch_patterns() -> Vec<Trial> {
    let half = Trial {
        to_the_limit: false,
        ..half_plane()
    };
    vec![half, one_cell()]
}

/// Screens a scene for all effects with named patterns.
///
/// # Errors
/// When the scene's effects cannot be simulated.
pub fn screen(scene: &Scene, patterns: &[Trial]) -> Result<Screening, SetupError> {
    screen_for(&EFFECTS, scene, patterns)
}

/// Screens a scene for some effects.
///
/// # Errors
/// As [`screen`].
pub fn screen_for(effects: &[&dyn Effect], scene: &Scene, patterns: &[Trial]) -> Result<Screening, SetupError> {
    let by_scene: Vec<Assessed> = effects.iter().filter_map(|e| Some((*e, e.assess(scene)?))).collect();
    // What is called for by the scene alone takes part in the solution that the rest is judged by.
    let mut chosen = scene.effects.clone();
    if scene.auto {
        turn_on(&mut chosen, scene, &by_scene);
    }
    let trial = scene.with_effects(Effects {
        wrinkling: None,
        ..chosen.clone()
    });
    // A run need only know whether stability is near; a table may look further.
    let reach = match patterns.iter().all(|trial| trial.to_the_limit) {
        true => FAR,
        false => NEAR,
    };
    let examined = solution::examine(&trial, patterns, reach)?;
    let solutions = Solutions {
        examined: &examined,
        reach,
    };
    let by_solutions: Vec<Assessed> = effects
        .iter()
        .filter_map(|e| Some((*e, e.assess_solutions(&trial, &solutions)?)))
        .collect();
    if scene.auto {
        turn_on(&mut chosen, &trial, &by_solutions);
    }
    let rows = by_scene.into_iter().chain(by_solutions);
    let rows = rows
        .map(|(effect, assessment)| Row::new(effect, assessment, &chosen))
        .collect();
    Ok(Screening {
        scene: scene.with_effects(chosen),
        rows,
    })
}

/// An effect and how much it matters.
type Assessed<'a> = (&'a dyn Effect, Assessment);

/// Turns on what is called for, with the parameters that the scene knows.
fn turn_on(effects: &mut Effects, scene: &Scene, assessed: &[Assessed]) {
    for (effect, assessment) in assessed {
        if assessment.verdict == Verdict::CalledFor {
            effect.turn_on(effects, scene);
        }
    }
}

/// Screens a scene with [`reference_patterns`].
///
/// # Errors
/// As [`screen`].
pub fn screen_by_references(scene: &Scene) -> Result<Screening, SetupError> {
    screen(scene, &reference_patterns())
}

/// A scene as it is simulated, with what it lacks.
pub struct Screened {
    /// The scene with its effects decided.
    pub scene: Scene,
    /// One line for each effect that is called for and not simulated.
    pub warnings: Vec<String>,
}

impl Screened {
    /// Screens a scene with [`watch_patterns`]; where its effects are yet to be decided, the screening that
    /// decides them tells of both.
    ///
    /// # Errors
    /// When its effects cannot be simulated.
    pub fn new(scene: &Scene) -> Result<Self, SetupError> {
        let screening = if scene.auto {
            screen_by_references(scene)?
        } else {
            screen(scene, &watch_patterns())?
        };
        Ok(Self {
            warnings: screening.warnings(),
            scene: screening.scene,
        })
    }

    /// The effects that are simulated, as artifacts name them.
    #[must_use]
    pub fn effects(&self) -> String {
        self.scene.effects.to_text()
    }
}

/// The scene with its effects decided: unchanged unless it says `effects: auto`.
///
/// # Errors
/// As [`screen`].
pub fn resolve(scene: &Scene) -> Result<Scene, SetupError> {
    if scene.auto {
        Ok(screen_by_references(scene)?.scene)
    } else {
        Ok(scene.clone())
    }
}
