//! The steps that all forms of `solve` share: read the scene and the patterns, simulate, write the files and report.

use std::borrow::Cow;
use std::time::Instant;

use rayon::prelude::*;
use serde_json::json;

use super::SolveArguments;
use crate::job::{Job, JobResult, attached_files, extend, seconds_each};
use crate::{CliError, Exit, Output, decisions, write};
use deaflow_base::Progress;
use deaflow_fem::screening::resolve;
use deaflow_fem::{SetupError, check_covered_cells, check_leads};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_stage::direct::NamedPatterns;

/// What a form of `solve` needs before it computes.
pub struct Form {
    /// The name of its progress bar.
    pub name: &'static str,
    /// Whether it writes a table and a figure next to its HDF5 file, which then must be named.
    pub has_attachments: bool,
    /// Which states of a device it simulates.
    pub states: States,
    /// What it computes, if that is not possible where electrodes cover parts of cells.
    pub without_covered_cells: Option<&'static str>,
    /// Its option, if it is not simulated under pressure.
    pub without_pressure: Option<&'static str>,
}

/// Which states of a device a form of `solve` simulates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum States {
    /// Each of them.
    Each,
    /// The one of the drive, or the first.
    Drive,
    /// The one that must be chosen, since it computes this.
    Chosen(&'static str),
}

/// The solver of a scene, and its own one for each pattern with drawn electrodes, whose elements follow them.
pub struct PatternSolver<'a, S, F> {
    scene: &'a Scene,
    set_up: F,
    usual: S,
}

impl<'a, S, E, F: Fn(&Scene) -> Result<S, E>> PatternSolver<'a, S, F> {
    /// Sets up the solver of a scene.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn new(scene: &'a Scene, set_up: F) -> Result<Self, E> {
        let usual = set_up(scene)?;
        Ok(Self { scene, set_up, usual })
    }

    /// Returns the solver of patterns without drawn electrodes.
    pub fn usual(&self) -> &S {
        &self.usual
    }

    /// Runs the solver of a pattern.
    ///
    /// # Errors
    /// When elements cannot follow the drawn electrodes of the pattern.
    pub fn with<T>(&self, pattern: &Pattern, run: impl FnOnce(&S) -> T) -> Result<T, E> {
        match self.scene.with_electrodes_of(pattern) {
            Cow::Borrowed(_) => Ok(run(&self.usual)),
            Cow::Owned(scene) => Ok(run(&(self.set_up)(&scene)?)),
        }
    }
}

/// Patterns that are simulated in a scene.
pub struct Simulation<'a> {
    /// The command line.
    pub arguments: &'a SolveArguments,
    /// The scene, in the state and with the changes that the command line names.
    pub scene: Scene,
    /// The patterns.
    pub patterns: Vec<Pattern>,
    /// The file of each pattern.
    pub names: Vec<String>,
    /// The patterns as drawn, where cells stand for shapes.
    pub drawings: Vec<Pattern>,
    /// What the readers of the files did that a user should know.
    pub notes: Vec<String>,
    /// Progress, time and files.
    pub job: Job<'a>,
}

impl<'a> Simulation<'a> {
    /// Reads the scene and the patterns.
    ///
    /// # Errors
    /// When a file would be overwritten that is read, or the scene or a pattern cannot be used.
    pub fn read(arguments: &'a SolveArguments, form: &Form) -> Result<Self, CliError> {
        let start = Instant::now();
        if form.has_attachments {
            check_attachments(arguments)?;
        }
        let read = arguments.read_scene()?;
        let (of_scene, scene) = (read.notes(), read.scene);
        if let States::Chosen(what) = form.states
            && !scene.states.is_empty()
        {
            return Err(
                CliError::bad_input(format!("{what} is computed for one state of a device"))
                    .help("choose a state: --state NAME"),
            );
        }
        if let (Some(with), true) = (form.without_pressure, scene.pressurised().is_some()) {
            return Err(SetupError::Pressure { with }.into());
        }
        let NamedPatterns {
            patterns,
            names,
            notes,
            drawings,
        } = arguments.patterns.read(scene.form(), arguments.edges)?;
        let notes = of_scene.into_iter().chain(notes).collect();
        check_leads(scene.leads.as_ref(), &patterns)?;
        // Effects are those of the flat membrane.
        let flat = scene.in_plane();
        decisions::decide(&flat)?;
        if patterns.iter().any(|pattern| pattern.coverage().is_some()) {
            check_covered_cells(&resolve(&flat)?)?;
            arguments.parameters().check_covered_cells()?;
            if let Some(with) = form.without_covered_cells {
                return Err(SetupError::Coverage { with }.into());
            }
        }
        let states = match form.states {
            States::Each => scene.in_states().len(),
            States::Drive | States::Chosen(_) => 1,
        };
        let steps = patterns.len() * states;
        let job = Job::start("solve", arguments.patterns.output.as_deref(), form.name, steps).since(start);
        Ok(Self {
            arguments,
            scene,
            patterns,
            names,
            notes,
            drawings,
            job,
        })
    }

    /// Simulates all patterns, one per thread at a time, and passes each result on with its computing time in s.
    ///
    /// # Errors
    /// When a pattern cannot be simulated.
    pub fn run<T: Send>(
        &self,
        simulate: impl Fn(&Pattern) -> Result<T, CliError> + Sync,
        mut keep: impl FnMut(T, f64),
    ) -> Result<(), CliError> {
        for batch in self.patterns.chunks(rayon::current_num_threads()) {
            let start = Instant::now();
            let found = batch.par_iter().map(|pattern| {
                let found = simulate(pattern);
                self.job.bar.advance(1);
                found
            });
            let found = found.collect::<Result<Vec<T>, CliError>>()?;
            let seconds = seconds_each(start, batch.len());
            found
                .into_iter()
                .zip(seconds)
                .for_each(|(found, seconds)| keep(found, seconds));
        }
        Ok(())
    }

    /// The scene, the solver and what is computed, for the provenance.
    pub fn parameters(&self, what: &str) -> String {
        format!("{}, {}{what}", self.arguments.described(), self.arguments.parameters())
    }

    /// The parameters of the solver as a YAML map.
    pub fn solver(&self) -> String {
        format!("{{ {} }}", self.arguments.parameters())
    }

    /// Writes the files and prints the report.
    ///
    /// # Errors
    /// When a file or the report cannot be written.
    pub fn finish(self, mut result: JobResult<'_>, output: &Output) -> Result<Exit, CliError> {
        self.job.bar.clear();
        self.notes.iter().for_each(|note| output.warn(note));
        extend(&mut result.document, json!({ "notes": self.notes }));
        self.job.finish(result, output)
    }
}

/// Checks that a table and a figure can be written next to the HDF5 file.
fn check_attachments(arguments: &SolveArguments) -> Result<(), CliError> {
    let file = arguments.patterns.file()?;
    let attached = attached_files(file);
    if attached.iter().any(|attached| attached == file) {
        return Err(
            CliError::bad_input(format!("{} would be written twice", file.display()))
                .help("name the HDF5 file, as in -o OUT.h5; OUT.csv and OUT.png are written next to it"),
        );
    }
    attached
        .iter()
        .try_for_each(|attached| write::check_output(attached, &arguments.inputs()))
}
