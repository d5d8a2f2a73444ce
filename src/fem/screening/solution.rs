//! Numbers that need a solution: compression, field, and the distance to the loss of stability.

use rayon::prelude::*;

use super::{Row, Trial, Verdict, known, open, voltage};
use crate::fem::effects::breakdown_ratio;
use crate::fem::{MembraneSolver, SetupError, SolveOptions, Survey, cell_states};
use crate::field::Mesh;
use crate::pattern::Pattern;
use crate::scene::effects::names;
use crate::scene::{Breakdown, Effects, HuangStrength, On, Scene};

/// A mesh on which the loss of stability comes out a few per cent high; bilinear elements of the same size would place that
/// of a single cell 12 % too high.
const MESH: SolveOptions = SolveOptions {
    mesh: Mesh::biquadratic(1),
    tolerance: 1e-8,
};

/// Above this share of the critical κ stability is called for.
const NEAR: f64 = 0.6;
/// The end of the stable branch is searched for up to the voltage of the scene over the root of this share of κ: what is
/// further away does not matter, and stiffening laws make it dear to find.
const FAR: f64 = 0.1;

/// What was found with one pattern.
struct Found {
    /// Largest −σ/μ over the cells.
    compression: f64,
    /// Largest E/E_B over the cells.
    field: f64,
    /// The voltage at which stability is lost; `None` where it is not within reach.
    limit: Option<f64>,
    /// Whether there is a stable state at the voltage of the scene. Where not, the compression is that of the last one before,
    /// and the field that of the membrane at rest.
    stable: bool,
}

/// The rows of the effects that need a solution.
pub fn rows(scene: &Scene, patterns: &[Trial]) -> Result<Vec<Row>, SetupError> {
    let breakdown = breakdown_law(scene);
    let solver = MembraneSolver::new(scene, MESH)?;
    // A run need only know whether stability is near; a table may look further.
    let reach = if patterns.iter().all(|trial| trial.to_the_limit) {
        FAR
    } else {
        NEAR
    };
    let search = MembraneSolver::new(&scene.at_voltage(scene.voltage_v() / reach.sqrt()), MESH)?;
    let found: Result<Vec<Found>, SetupError> = patterns
        .par_iter()
        .map(|trial| examine(scene, &solver, &search, trial, &breakdown))
        .collect();
    let found = found?;
    let names: Vec<&str> = patterns.iter().map(|trial| trial.name.as_str()).collect();
    Ok(vec![
        wrinkling(&names, &found),
        stability(&names, &found, scene, reach),
        breaking(&names, &found, scene),
    ])
}

/// Turns on what the rows call for.
pub fn turn_on(effects: &mut Effects, scene: &Scene, rows: &[Row]) {
    for row in rows.iter().filter(|row| row.verdict == Verdict::CalledFor) {
        match row.effect {
            names::WRINKLING => effects.wrinkling = Some(On {}),
            names::STABILITY => effects.electromechanical_stability = Some(On {}),
            names::BREAKDOWN => effects.dielectric_breakdown = Some(breakdown_law(scene)),
            _ => {}
        }
    }
}

/// The law of the scene, or that of the acrylic elastomer that most such membranes are made of.
fn breakdown_law(scene: &Scene) -> Breakdown {
    let named = scene.effects.dielectric_breakdown.clone();
    named
        .or_else(|| scene.properties.dielectric_breakdown.clone())
        .unwrap_or(Breakdown::Huang(HuangStrength {}))
}

fn examine(
    scene: &Scene,
    solver: &MembraneSolver,
    search: &MembraneSolver,
    trial: &Trial,
    breakdown: &Breakdown,
) -> Result<Found, SetupError> {
    let pattern = &trial.pattern;
    let solution = solver.solve(pattern);
    let reached = solution.outcome.bracket().map(|[stable, _]| scene.at_voltage(stable));
    let states = cell_states(
        reached.as_ref().unwrap_or(scene),
        solver.mesh(),
        pattern,
        &solution.displacement,
    )?;
    let stable = solution.outcome.is_converged();
    let active = pattern.cells().contains(&1);
    Ok(Found {
        compression: -Survey::of(&states, scene.shear_modulus_pa()).smallest_stress,
        field: match stable {
            true => breakdown_ratio(breakdown, scene.thickness_mm(), &states),
            false if active => ratio_at_rest(scene, breakdown),
            false => 0.0,
        },
        limit: if trial.to_the_limit {
            limit(search, pattern)
        } else {
            None
        },
        stable,
    })
}

/// E/E_B of an active cell that has not moved: what a membrane that snaps has at least.
fn ratio_at_rest(scene: &Scene, breakdown: &Breakdown) -> f64 {
    let area = scene.prestretch().powi(2);
    let field = 1e3 * scene.voltage_v() * area / scene.thickness_mm();
    field / breakdown.strength(scene.thickness_mm(), area)
}

/// The voltage at which stability is lost, if it is within reach.
fn limit(search: &MembraneSolver, pattern: &Pattern) -> Option<f64> {
    let [stable, _] = search.solve(pattern).outcome.bracket()?;
    (stable > 0.0).then_some(stable)
}

/// The largest of some numbers, and the pattern that has it, in words.
fn worst(patterns: &[&str], found: &[Found], number: impl Fn(&Found) -> f64, unstable: &str) -> Option<(String, f64)> {
    let pairs = patterns.iter().zip(found);
    let (name, worst) = pairs.max_by(|a, b| number(a.1).total_cmp(&number(b.1)))?;
    let state = if worst.stable { "" } else { unstable };
    Some((format!("is largest for `{name}`{state}"), number(worst)))
}

fn wrinkling(patterns: &[&str], found: &[Found]) -> Row {
    let (effect, quantity) = (names::WRINKLING, "−min σ/μ");
    match worst(patterns, found, |f| f.compression, ", just before it is lost") {
        None => open(effect, quantity, Verdict::Unknown, 0.0, "no patterns".to_owned()),
        Some((worst, number)) => {
            let meaning = if number > 0.0 {
                "it wrinkles there"
            } else {
                "all cells are in tension"
            };
            known(
                effect,
                quantity.to_owned(),
                number + 0.0,
                0.0,
                format!("{worst}; {meaning}"),
            )
        }
    }
}

fn stability(patterns: &[&str], found: &[Found], scene: &Scene, reach: f64) -> Row {
    let (effect, quantity) = (names::STABILITY, "κ/κ(critical)");
    let limits = patterns
        .iter()
        .zip(found)
        .filter_map(|(name, f)| Some((name, f.limit?)));
    match limits.min_by(|a, b| a.1.total_cmp(&b.1)) {
        Some((pattern, limit)) => {
            let change = format!("ends the stability of `{pattern}` at {}", voltage(limit));
            let ratio = (scene.voltage_v() / limit).powi(2);
            known(effect, quantity.to_owned(), ratio, NEAR, change)
        }
        None => {
            let change = format!("below {reach}: stable at {:.1} times the voltage", reach.sqrt().recip());
            open(effect, quantity, Verdict::NotCalledFor, NEAR, change)
        }
    }
}

fn breaking(patterns: &[&str], found: &[Found], scene: &Scene) -> Row {
    const THRESHOLD: f64 = 0.8;
    let effect = names::BREAKDOWN;
    let given = scene.effects.dielectric_breakdown.is_some() || scene.properties.dielectric_breakdown.is_some();
    let quantity = if given {
        "max E/E_B"
    } else {
        "max E/E_B (Huang's law assumed)"
    };
    match worst(patterns, found, |f| f.field, ", at rest: it is not stable") {
        None => open(effect, quantity, Verdict::Unknown, THRESHOLD, "no patterns".to_owned()),
        Some((worst, number)) => known(effect, quantity.to_owned(), number, THRESHOLD, worst),
    }
}
