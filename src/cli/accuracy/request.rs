//! Measures methods on patterns of a scene, for the command and for Python.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use serde_json::Value;

use super::findings::Findings;
use crate::arguments::StoreArguments;
use crate::{CliError, model};
use deaflow_accuracy::{AccuracyError, Benchmark, Candidate, Families, Measured, Network, Reference, drawn, given};
use deaflow_base::{Document, Progress, Quantity};
use deaflow_pattern::Pattern;
use deaflow_sample::Canvas;
use deaflow_scene::Scene;

/// Methods to measure in a scene, on patterns.
pub struct AccuracyRequest {
    scene: Scene,
    reference: Reference,
    methods: Vec<Candidate>,
    families: Families,
    /// Given patterns as drawn.
    drawings: Vec<Pattern>,
}

/// The networks to measure, and the store in which they are found; by default that of the command.
#[derive(Clone, Debug, Default)]
pub struct Networks<'a> {
    /// Each as for `deaflow predict`.
    pub names: &'a [String],
    /// The folder of the store.
    pub store: Option<PathBuf>,
}

impl AccuracyRequest {
    /// The reference by default.
    pub const REFERENCE: &str = "{ elements_per_cell: 8, order: 2 }";

    /// The numbers of patterns of a family that are allowed.
    pub const PER_FAMILY: RangeInclusive<u64> = 1..=10_000;

    /// Reads the reference and the methods, each as the option of the command. Without `methods` the usual ones of the
    /// scene are measured. There are no patterns yet.
    ///
    /// # Errors
    /// When the reference or a method is invalid, or cannot be used in the scene or with the other.
    pub fn new(
        scene: Scene,
        reference: &Document,
        methods: Option<&Document>,
        networks: &Networks<'_>,
    ) -> Result<Self, CliError> {
        let reference = Reference::read(&reference.root)?;
        // Checked before the reference is solved, which may take long.
        reference.check_scene(&scene).map_err(bad_input)?;
        let time = reference.settings().time();
        let networks = networks.read()?;
        let methods = match methods {
            Some(methods) => Candidate::read_with_models(&methods.root, networks)?,
            None => {
                let usual = Candidate::usual_in(&scene, time).into_iter();
                usual.chain(Candidate::networks(networks)).collect()
            }
        };
        reference.check(&methods).map_err(bad_input)?;
        for method in &methods {
            method.check_scene(&scene, time).map_err(bad_input)?;
        }
        Ok(Self {
            scene,
            reference,
            methods,
            families: Families::new(),
            drawings: Vec::new(),
        })
    }

    /// Returns the scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Measures on `count` patterns of each family.
    ///
    /// # Errors
    /// When the membrane has fewer cells than a family needs, or the number is not [allowed](Self::PER_FAMILY).
    pub fn on_families(self, count: u64, seed: u64) -> Result<Self, CliError> {
        if !Self::PER_FAMILY.contains(&count) {
            let (least, most) = Self::PER_FAMILY.into_inner();
            return Err(CliError::bad_input(format!("{count} patterns of each family"))
                .help(format!("allowed: {least} to {most}")));
        }
        let families = drawn(&Canvas::of(&self.scene.membrane()), count, seed);
        let families = families.map_err(|error| CliError::bad_input(error.to_string()))?;
        Ok(Self { families, ..self })
    }

    /// Measures on given patterns; `drawings` are those as drawn, where cells stand for shapes.
    #[must_use]
    pub fn on_patterns(self, patterns: Vec<Pattern>, drawings: Vec<Pattern>) -> Self {
        Self {
            families: given(patterns),
            drawings,
            ..self
        }
    }

    /// Returns the number of patterns.
    #[must_use]
    pub fn patterns(&self) -> usize {
        self.families.values().map(Vec::len).sum()
    }

    /// Solves the patterns by the reference. Progress counts patterns.
    ///
    /// # Errors
    /// When the reference cannot be set up.
    pub fn solve(self, progress: &dyn Progress) -> Result<SolvedReference, CliError> {
        let benchmark = Benchmark::new(self.scene, self.reference, self.families, &self.drawings, progress);
        Ok(SolvedReference {
            benchmark: benchmark.map_err(failed)?,
            methods: self.methods,
        })
    }
}

impl Networks<'_> {
    fn read(&self) -> Result<Vec<Network>, CliError> {
        let store = StoreArguments::of(self.store.clone());
        let read = |name: &String| {
            let bytes = model::weights(name, &store.folder_of_any([name]))?;
            let network = Network::from_bytes(&bytes);
            network.map_err(|error| CliError::bad_input(format!("cannot use {name}: {error}")))
        };
        self.names.iter().map(read).collect()
    }
}

/// Patterns with reference solutions, and the methods to measure on them.
pub struct SolvedReference {
    benchmark: Benchmark,
    methods: Vec<Candidate>,
}

impl SolvedReference {
    /// Returns the number of methods.
    #[must_use]
    pub fn methods(&self) -> usize {
        self.methods.len()
    }

    /// Measures the methods one after another, on one thread. Progress counts methods.
    ///
    /// # Errors
    /// When a method cannot be evaluated.
    pub fn measure(self, progress: &dyn Progress) -> Result<MeasuredAccuracy, CliError> {
        let methods: Vec<&Candidate> = self.methods.iter().collect();
        let measured = self.benchmark.measure(&methods, progress).map_err(failed)?;
        Ok(MeasuredAccuracy {
            benchmark: self.benchmark,
            measured,
        })
    }
}

/// The errors and times of methods.
pub struct MeasuredAccuracy {
    pub(super) benchmark: Benchmark,
    pub(super) measured: Vec<Measured>,
}

impl MeasuredAccuracy {
    /// Returns what `deaflow accuracy --json` prints, without its files; with a target also the fastest setting whose
    /// error is at most that.
    #[must_use]
    pub fn document(&self, target: Option<Quantity>) -> Value {
        Findings::new(&self.benchmark, &self.measured, target).document()
    }
}

fn bad_input(error: AccuracyError) -> CliError {
    CliError::bad_input(error.to_string())
}

fn failed(error: AccuracyError) -> CliError {
    CliError::failure(error.to_string())
}
