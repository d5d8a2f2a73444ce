//! The steps that all forms of `solve` share: read the scene and the patterns, simulate, write the files and report.
//! What they compute needs a [`Computation`] alone, which the Python package makes from arrays.

use std::borrow::Cow;
use std::path::PathBuf;
use std::time::Instant;

use rayon::prelude::*;
use serde_json::json;

use super::SolveArguments;
use crate::job::{Job, JobResult, attached_files, extend, seconds_each};
use crate::{CliError, Exit, Output, decisions, write};
use deaflow_base::Progress;
use deaflow_fem::screening::resolve;
use deaflow_fem::{SetupError, SolveOptions, SolverParameters, check_covered_cells, check_leads};
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

impl Form {
    /// Checks that this form simulates a scene.
    ///
    /// # Errors
    /// When a state must be chosen, or the scene is under pressure.
    fn check_scene(&self, scene: &Scene) -> Result<(), CliError> {
        if let States::Chosen(what) = self.states
            && !scene.states.is_empty()
        {
            return Err(
                CliError::bad_input(format!("{what} is computed for one state of a device"))
                    .help("choose a state: --state NAME"),
            );
        }
        match (self.without_pressure, scene.pressurised()) {
            (Some(with), Some(_)) => Err(SetupError::Pressure { with }.into()),
            _ => Ok(()),
        }
    }

    /// Checks that this form simulates patterns in a scene, and decides the effects of the scene.
    ///
    /// # Errors
    /// When leads do not meet electrodes, the effects cannot be simulated, or cells are covered in part and the form,
    /// the effects or the parameters do not allow that.
    fn check_patterns(
        &self,
        scene: &Scene,
        patterns: &[Pattern],
        parameters: &SolverParameters,
    ) -> Result<(), CliError> {
        check_leads(scene.leads.as_ref(), patterns)?;
        // Effects are those of the flat membrane.
        let flat = scene.in_plane();
        decisions::decide(&flat)?;
        if patterns.iter().any(|pattern| pattern.coverage().is_some()) {
            check_covered_cells(&resolve(&flat)?)?;
            parameters.check_covered_cells()?;
            if let Some(with) = self.without_covered_cells {
                return Err(SetupError::Coverage { with }.into());
            }
        }
        Ok(())
    }
}

/// Patterns to simulate in a scene, and how: what a form of `solve` computes from.
pub struct Computation<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The patterns.
    pub patterns: &'a [Pattern],
    /// The patterns as drawn, where cells stand for shapes; without them the patterns are the drawings.
    pub drawings: &'a [Pattern],
    /// Method, mesh or accuracy, tolerance and limit of work.
    pub parameters: &'a SolverParameters,
    /// Is told about each finished pattern.
    pub progress: &'a dyn Progress,
}

impl Computation<'_> {
    /// Checks that a form of `solve` can simulate this.
    ///
    /// # Errors
    /// When it cannot.
    pub fn check(&self, form: &Form) -> Result<(), CliError> {
        form.check_scene(self.scene)?;
        form.check_patterns(self.scene, self.patterns, self.parameters)
    }

    /// Returns mesh and tolerance, for what is computed on one mesh.
    ///
    /// # Errors
    /// When the mesh shall follow from an accuracy.
    pub fn options(&self) -> Result<SolveOptions, CliError> {
        let refused = || {
            CliError::bad_input("`accuracy` cannot be used here: this is computed on one mesh")
                .help("choose the mesh by `elements_per_cell` and `order`")
        };
        Ok(SolveOptions {
            mesh: self.parameters.mesh().ok_or_else(refused)?,
            tolerance: self.parameters.tolerance(),
        })
    }

    /// Simulates all patterns, one per thread at a time, and passes each result on with its computing time in s.
    ///
    /// # Errors
    /// When a pattern cannot be simulated, or after an interrupt.
    pub fn run<T: Send>(
        &self,
        simulate: impl Fn(&Pattern) -> Result<T, CliError> + Sync,
        mut keep: impl FnMut(T, f64),
    ) -> Result<(), CliError> {
        for batch in self.patterns.chunks(rayon::current_num_threads()) {
            CliError::if_interrupted()?;
            let start = Instant::now();
            let found = batch.par_iter().map(|pattern| {
                let found = simulate(pattern);
                self.progress.advance(1);
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

    /// Simulates all patterns at once, where some take much longer than others: each on cells and as drawn.
    ///
    /// # Errors
    /// When a pattern cannot be simulated, or after an interrupt.
    pub fn run_at_once<T: Send>(
        &self,
        simulate: impl Fn([&Pattern; 2]) -> Result<T, CliError> + Sync,
    ) -> Result<Vec<T>, CliError> {
        let simulated = |(at, pattern): (usize, &Pattern)| {
            CliError::if_interrupted()?;
            let found = simulate([pattern, self.drawings.get(at).unwrap_or(pattern)])?;
            self.progress.advance(1);
            Ok(found)
        };
        self.patterns.par_iter().enumerate().map(simulated).collect()
    }

    /// The parameters of the solver as a YAML map.
    pub fn solver(&self) -> String {
        format!("{{ {} }}", self.parameters)
    }
}

/// Patterns that are simulated in a scene by the command.
pub struct Simulation<'a> {
    /// The command line.
    pub arguments: &'a SolveArguments,
    /// Method, mesh or accuracy, tolerance and limit of work.
    pub parameters: SolverParameters,
    /// The scene, in the state and with the changes that the command line names.
    pub scene: Scene,
    /// The patterns.
    pub patterns: Vec<Pattern>,
    /// The file of each pattern.
    pub names: Vec<String>,
    /// The patterns as drawn, where cells stand for shapes.
    pub drawings: Vec<Pattern>,
    /// How numbers without a unit in the scene were read; `None` if all have one.
    bare_numbers: Option<String>,
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
        let (bare_numbers, scene) = (read.bare_numbers, read.scene);
        form.check_scene(&scene)?;
        let NamedPatterns {
            patterns,
            names,
            notes,
            drawings,
        } = arguments.patterns.read(scene.form(), arguments.edges.edges)?;
        let notes = scene.geometry.notes().into_iter().chain(notes).collect();
        let parameters = arguments.parameters();
        form.check_patterns(&scene, &patterns, &parameters)?;
        let states = match form.states {
            States::Each => scene.in_states().len(),
            States::Drive | States::Chosen(_) => 1,
        };
        let steps = patterns.len() * states;
        let job = Job::start("solve", arguments.patterns.output.as_deref(), form.name, steps).since(start);
        Ok(Self {
            arguments,
            parameters,
            scene,
            patterns,
            names,
            bare_numbers,
            notes,
            drawings,
            job,
        })
    }

    /// Returns the name of the simulated state, if the scene has states and the voltages are those of one of them.
    pub fn state(&self) -> Option<String> {
        let of_drive = || {
            let mut states = self.scene.states.iter();
            let found = states.find(|(_, voltages)| **voltages == self.scene.drive.voltages);
            found.map(|(name, _)| name.to_owned())
        };
        self.arguments.state.state.clone().or_else(of_drive)
    }

    /// Returns what is computed from.
    pub fn computation(&self) -> Computation<'_> {
        Computation {
            scene: &self.scene,
            patterns: &self.patterns,
            drawings: &self.drawings,
            parameters: &self.parameters,
            progress: &self.job.bar,
        }
    }

    /// The scene, the solver and what is computed, for the provenance.
    pub fn described(&self, what: &str) -> String {
        format!("{}, {}{what}", self.arguments.described(), self.parameters)
    }

    /// Adds a figure that was drawn.
    pub fn with_figure(mut self, figure: Option<PathBuf>) -> Self {
        self.job.figure = figure;
        self
    }

    /// Writes the files and prints the report.
    ///
    /// # Errors
    /// When a file or the report cannot be written.
    pub fn finish(self, mut result: JobResult<'_>, output: &Output) -> Result<Exit, CliError> {
        self.job.bar.clear();
        self.bare_numbers.iter().for_each(|note| output.warn_of_units(note));
        self.notes.iter().for_each(|note| output.warn(note));
        extend(&mut result.document, json!({ "notes": self.notes }));
        self.job.finish(result, output)
    }
}

/// Checks that a table and a figure can be written next to the HDF5 file.
fn check_attachments(arguments: &SolveArguments) -> Result<(), CliError> {
    let Some(file) = arguments.patterns.output.as_deref() else {
        return Ok(());
    };
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
