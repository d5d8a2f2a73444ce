//! Which effects a scene calls for.
//!
//! Each effect has a number without unit that says how much it matters, and a threshold above which it is called for. Most
//! follow from the scene alone. Wrinkling, breakdown and the distance to pull-in depend on the solution, which is computed
//! on a coarse mesh for a few patterns between them as extreme as patterns are.

mod scene;
mod solution;
#[cfg(test)]
mod tests;

use crate::fem::SetupError;
use crate::pattern::{CELLS, Pattern};
use crate::scene::effects::names;
use crate::scene::{Effects, Scene};

/// What is known about an effect in a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Its name in a scene, from [`names`].
    pub effect: &'static str,
    /// What the number is, as a formula.
    pub quantity: String,
    /// The number; `None` where it cannot be computed or does not arise.
    pub number: Option<f64>,
    /// Above it the effect is called for.
    pub threshold: f64,
    /// Whether it is called for.
    pub verdict: Verdict,
    /// Whether it is simulated.
    pub status: Status,
    /// What it does, in words that follow its name: `changes the electric stress by -3.0 %`.
    pub change: String,
    /// What it would cost, in words.
    pub cost: &'static str,
}

/// Whether an effect is called for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The number is above the threshold.
    CalledFor,
    /// It is not, or the question does not arise.
    NotCalledFor,
    /// A property that is not given decides.
    Unknown,
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

impl Verdict {
    /// `yes`, `no` or `unknown`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::CalledFor => "yes",
            Self::NotCalledFor => "no",
            Self::Unknown => "unknown",
        }
    }
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
    /// The warning that belongs to an effect that is called for and not simulated: what it does, its number and the threshold.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let number = self.number?;
        let state = match self.status {
            Status::On => return None,
            Status::Off => "is neglected",
            Status::NotAvailable => "cannot be simulated yet",
        };
        (self.verdict == Verdict::CalledFor).then(|| {
            format!(
                "{} {state} and {} ({} = {number:.3} > {})",
                self.effect.replace('_', " "),
                self.change,
                self.quantity,
                self.threshold
            )
        })
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

/// Screens a scene with named patterns.
///
/// # Errors
/// When the scene's effects cannot be simulated.
pub fn screen(scene: &Scene, patterns: &[Trial]) -> Result<Screening, SetupError> {
    let fixed = scene::rows(scene);
    // What is called for by the scene alone takes part in the solution that the rest is judged by.
    let mut chosen = scene.effects.clone();
    if scene.auto {
        chosen = scene::called_for(scene, &fixed);
    }
    let trial = scene.with_effects(Effects {
        wrinkling: None,
        ..chosen.clone()
    });
    let found = solution::rows(&trial, patterns)?;
    if scene.auto {
        solution::turn_on(&mut chosen, &trial, &found);
    }
    let simulated = scene.with_effects(chosen);
    let mut rows: Vec<Row> = fixed.into_iter().chain(found).collect();
    for row in &mut rows {
        row.status = status(&simulated.effects, row.effect);
    }
    Ok(Screening { scene: simulated, rows })
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

fn status(effects: &Effects, name: &str) -> Status {
    let on = match name {
        names::STIFFENING => effects.strain_stiffening.is_some(),
        names::ELECTRODE => effects.electrode_stiffness.is_some(),
        names::PERMITTIVITY => effects.stretch_dependent_permittivity.is_some(),
        names::FRINGE => effects.fringe_field.is_some(),
        names::WRINKLING => effects.wrinkling.is_some(),
        names::BREAKDOWN => effects.dielectric_breakdown.is_some(),
        names::STABILITY => effects.electromechanical_stability.is_some(),
        _ => return Status::NotAvailable,
    };
    if on { Status::On } else { Status::Off }
}

/// A length as people say it.
fn length(mm: f64) -> String {
    if mm < 0.1 {
        format!("{:.1} µm", 1e3 * mm)
    } else {
        format!("{mm:.3} mm")
    }
}

/// A voltage as people say it.
fn voltage(volts: f64) -> String {
    if volts < 1e3 {
        format!("{volts:.1} V")
    } else {
        format!("{:.2} kV", 1e-3 * volts)
    }
}

/// A row whose number is known.
fn known(effect: &'static str, quantity: String, number: f64, threshold: f64, change: String) -> Row {
    // Rounding alone is no reason.
    let called_for = number > threshold + 1e-9;
    Row {
        effect,
        quantity,
        number: Some(number),
        threshold,
        verdict: if called_for {
            Verdict::CalledFor
        } else {
            Verdict::NotCalledFor
        },
        status: Status::Off,
        change,
        cost: cost(effect),
    }
}

/// A row without a number.
fn open(effect: &'static str, quantity: &str, verdict: Verdict, threshold: f64, change: String) -> Row {
    Row {
        effect,
        quantity: quantity.to_owned(),
        number: None,
        threshold,
        verdict,
        status: Status::Off,
        change,
        cost: cost(effect),
    }
}

/// What an effect costs over the base model; `benches/effects.rs` measures it.
fn cost(effect: &str) -> &'static str {
    match effect {
        names::STIFFENING => "1.8× a solve, Ogden 4 to 6×",
        names::ELECTRODE => "1.4× a solve",
        names::PERMITTIVITY => "3× a solve",
        names::FRINGE => "1.3× a solve",
        names::WRINKLING => "2.3× a solve, more where it wrinkles",
        names::BREAKDOWN => "a pass over the cells",
        names::STABILITY => "20 to 100 solves",
        names::INERTIA | names::VISCOELASTICITY | names::RESISTANCE => "a solve for each time step",
        _ => "one more solve",
    }
}
