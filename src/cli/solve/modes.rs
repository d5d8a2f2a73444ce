//! `deaflow solve --modes`: natural frequencies of patterns about their equilibria.

use clap::Args;
use serde_json::{Value, json};

use super::SolveArguments;
use super::history::TIME;
use super::simulation::{Computation, Form, PatternSolver, Simulation, States};
use crate::arguments::integer;
use crate::job::JobResult;
use crate::text::Text;
use crate::{CliError, Exit, Output, model_warnings, table};
use deaflow_base::four_digits;
use deaflow_content::{CoveredCells, DrawnElectrodes, Packed, Vibrations};
use deaflow_fem::screening::resolve;
use deaflow_fem::{MOST_MODES, MembraneSolver, SetupError, Vibration};
use deaflow_scene::Scene;

#[derive(Clone, Debug, Args)]
pub struct ModesArguments {
    /// Find the K lowest natural frequencies of each pattern about its equilibrium, with their modes; needs a density
    #[arg(
        long,
        value_name = "K",
        value_parser = integer::<u64>(1..=MOST_MODES as u64),
        conflicts_with_all = ["path", "cells", "accuracy", "history", "at", "every"],
        help_heading = TIME
    )]
    pub modes: Option<u64>,
    /// Lump the mass at the nodes
    #[arg(long, requires = "modes", help_heading = TIME)]
    lumped: bool,
}

pub const FORM: Form = Form {
    name: "modes",
    has_attachments: false,
    states: States::Chosen("a natural frequency"),
    without_covered_cells: None,
    without_pressure: Some("`--modes`"),
};

/// Finds natural frequencies and their modes.
///
/// # Errors
/// When the scene or a pattern cannot be used, the density is missing, or the file cannot be written.
pub fn execute(arguments: &SolveArguments, count: u64, output: &Output) -> Result<Exit, CliError> {
    let simulation = Simulation::read(arguments, &FORM)?;
    let lumped = arguments.modes.lumped;
    let Modes {
        found,
        content,
        warnings,
    } = Modes::find(&simulation.computation(), count as usize, lumped)?;
    let lumped = if lumped { ", lumped mass" } else { "" };
    let unstable = found.iter().filter(|one| one.equilibrium.is_none()).count();
    let result = JobResult {
        patterns: found.len(),
        arrays: content.object(),
        parameters: simulation.described(&format!(", {count} modes{lumped}")),
        attachments: None,
        warnings,
        document: json!({
            "vibrations": found.iter().enumerate().map(document).collect::<Vec<_>>(),
            "unstable": unstable,
        }),
        text: text(&found, count as usize),
        exit: if unstable > 0 { Exit::Unstable } else { Exit::Done },
    };
    simulation.finish(result, output)
}

/// The natural frequencies and modes of patterns.
pub struct Modes {
    found: Vec<Vibration>,
    /// The arrays.
    pub content: Vibrations,
    /// Warnings about the model, one line each.
    pub warnings: Vec<String>,
}

impl Modes {
    /// Finds the lowest natural frequencies of each pattern, `count` in the plane and out of it.
    ///
    /// # Errors
    /// When a pattern cannot be simulated, or the density is missing.
    pub fn find(computation: &Computation<'_>, count: usize, lumped: bool) -> Result<Self, CliError> {
        let scene = resolve(computation.scene)?;
        let options = computation.options()?;
        let solver = PatternSolver::new(&scene, |scene| {
            let solver = MembraneSolver::new(scene, options)?;
            Ok::<_, SetupError>(solver.within(computation.parameters.work_limit()))
        })?;
        let (mut found, mut seconds) = (Vec::new(), Vec::new());
        computation.run(
            |pattern| {
                let vibration = |solver: &MembraneSolver| solver.vibration(pattern, count, lumped);
                Ok(solver.with(pattern, vibration)??)
            },
            |vibration, time| {
                found.push(vibration);
                seconds.push(time);
            },
        )?;
        Ok(Self {
            content: content(computation, &scene, count, &found, seconds),
            warnings: model_warnings::of_states_of_motion(&scene, computation.patterns)?
                .into_iter()
                .chain(warnings(&scene, &found))
                .collect(),
            found,
        })
    }
}

fn warnings(scene: &Scene, found: &[Vibration]) -> Vec<String> {
    let relaxed = scene.effects.viscoelasticity.as_ref().map(|_| {
        "modes are those of the relaxed membrane: viscoelastic branches that relax more slowly than a period stiffen \
         it, as --response shows"
            .to_owned()
    });
    let buckled = found.iter().enumerate().filter_map(|(index, one)| {
        let motions = match one.out_of_plane.unstable {
            0 => return None,
            1 => "1 motion".to_owned(),
            many => format!("{many} motions"),
        };
        Some(format!(
            "pattern {index}: the flat membrane is unstable in {motions} out of the plane: it wrinkles or buckles"
        ))
    });
    relaxed.into_iter().chain(buckled).collect()
}

fn content(
    computation: &Computation<'_>,
    scene: &Scene,
    count: usize,
    found: &[Vibration],
    solve_seconds: Vec<f64>,
) -> Vibrations {
    let corners = scene.membrane().raster.corners();
    let missing = |rows: usize| std::iter::repeat_n(f64::NAN, 2 * rows * corners);
    let [mut displacement, mut modes, mut frequencies] = [(); 3].map(|()| Vec::<f64>::new());
    let [mut heights, mut out_of_plane] = [(); 2].map(|()| Vec::<f64>::new());
    for one in found {
        match &one.equilibrium {
            Some(field) => displacement.extend_from_slice(field.values()),
            None => displacement.extend(missing(1)),
        }
        let known = one.frequencies.iter().copied();
        frequencies.extend(known.chain(std::iter::repeat(f64::NAN)).take(count));
        modes.extend(one.modes.iter().flat_map(|mode| mode.values()));
        modes.extend(missing(count - one.modes.len()));
        let known = one.out_of_plane.frequencies.iter().copied();
        out_of_plane.extend(known.chain(std::iter::repeat(f64::NAN)).take(count));
        heights.extend(one.out_of_plane.modes.iter().flatten());
        heights.extend(std::iter::repeat_n(
            f64::NAN,
            (count - one.out_of_plane.modes.len()) * corners,
        ));
    }
    Vibrations {
        patterns: computation.patterns.to_vec(),
        electrodes: DrawnElectrodes::of(computation.patterns),
        covered: CoveredCells::of(computation.patterns),
        outcome: found.iter().map(|one| one.outcome.kind()).collect(),
        displacement: Packed(displacement),
        mode: (1..=count as u64).collect(),
        frequencies: Packed(frequencies),
        modes: Packed(modes),
        out_of_plane_frequencies: Packed(out_of_plane),
        out_of_plane_modes: Packed(heights),
        solve_seconds,
        scene: scene.clone(),
        solver: computation.solver(),
        effects: scene.effects.clone(),
    }
}

/// The overview, and where a mesh has fewer motions than requested.
fn text(found: &[Vibration], count: usize) -> Text {
    let mut text = Text::of(overview(found, count));
    let is_short = |one: &Vibration| {
        one.equilibrium.is_some() && one.frequencies.len().min(one.out_of_plane.frequencies.len()) < count
    };
    if found.iter().any(is_short) {
        text.line("fewer frequencies than requested: this mesh has no more motions");
    }
    text
}

/// Lists the patterns with their lowest frequencies.
fn overview(found: &[Vibration], count: usize) -> table::Table {
    const SHOWN: usize = 6;
    let shown = count.min(SHOWN);
    let names: Vec<String> = (1..=shown).map(|mode| format!("f{mode}")).collect();
    let header: Vec<&str> = ["pattern", "outcome", "motion"]
        .into_iter()
        .chain(names.iter().map(String::as_str))
        .collect();
    let last: Vec<&str> = header[3..].iter().rev().copied().collect();
    let mut table = table::table(&header, &header[3..]).dispensable(&last);
    for (index, one) in found.iter().enumerate() {
        for (motion, frequencies) in [
            ("in the plane", &one.frequencies),
            ("out of the plane", &one.out_of_plane.frequencies),
        ] {
            let hertz = frequencies.iter().map(|hertz| format!("{} Hz", four_digits(*hertz)));
            let hertz = hertz.chain(std::iter::repeat("-".to_owned())).take(shown);
            let row = [index.to_string(), one.outcome.to_string(), motion.to_owned()];
            table.add_row(row.into_iter().chain(hertz).collect::<Vec<_>>());
        }
    }
    table
}

fn document((index, one): (usize, &Vibration)) -> Value {
    json!({
        "index": index,
        "outcome": one.outcome.name(),
        "frequencies": one.frequencies,
        "out_of_plane_frequencies": one.out_of_plane.frequencies,
        "out_of_plane_unstable": one.out_of_plane.unstable,
    })
}
