//! The contract between the orchestrator and the kinds of stages.
//!
//! A [`Kind`] reads a stage's mapping into a [`Stage`]; a stage states its canonical parameters (the only thing, with
//! its input digests, that its key is made of), how its work divides into chunks, and how one piece of work is done.

use std::sync::{Mutex, PoisonError};

use super::lock_difference::LockDifference;
use super::scratch::Scratch;
use deaflow_base::{ArtifactId, Canonical, Fields, InputError, Node, NodeValue, Progress, Stopped};
use deaflow_store::{Artifact, Object, ObjectError, StoreError};

/// A kind of stage: `sample`, `solve`, …
pub trait Kind: Sync {
    /// The word after `kind:`.
    fn name(&self) -> &'static str;

    /// Raised whenever the output for given parameters and inputs changes.
    fn recipe(&self) -> u32;

    /// What `needs` must name.
    fn needs(&self) -> Needs;

    /// Kinds that `needs` may name too, without being counted: there must be enough of [`Kind::needs`] beside them.
    fn optional_needs(&self) -> &'static [&'static str] {
        &[]
    }

    /// The keys that [`Kind::read`] accepts beside `kind` and `needs`: one mapping, or one for each family where families have
    /// keys of their own.
    fn schema(&self) -> Vec<Fields>;

    /// Whether stages of any kind may need this kind only to wait for it: it is then no input of theirs, and no part of their
    /// keys.
    fn gates(&self) -> bool {
        false
    }

    /// Whether its stages depend on the scene: of a scene that is swept they get their own.
    fn reads_scene(&self) -> bool {
        false
    }

    /// Whether its stages collect what all stages of sweeps made. [`Kind::read`] then finds which needs belong together under
    /// `rows`: a list of pairs, the values of the axes by their names, and the numbers of needs by the names of the file.
    fn collects(&self) -> bool {
        false
    }

    /// The kind to whose stages those of this kind are fed back, where these may be repeated in rounds, as `orchestrator/rounds.rs`
    /// says. [`Kind::read`] of this kind must then allow the keys `rounds` and `update`, and leave them alone; the target must accept
    /// stages of this kind and one of its own as needs.
    fn feedback_target(&self) -> Option<&'static str> {
        None
    }

    /// The keys in which a stage of this kind, as a feedback target, differs from the second round on, with their values.
    ///
    /// # Errors
    /// When a key that they depend on cannot be read.
    fn feedback_overrides(&self, stage: &Node) -> Result<Vec<(&'static str, NodeValue)>, InputError> {
        let _ = stage;
        Ok(Vec::new())
    }

    /// Parameters, by their dotted paths in the key of a stage or of a chunk, that make the work another one: what it took with one value
    /// foretells nothing of another.
    fn separate_cost_parameters(&self) -> &'static [&'static str] {
        &[]
    }

    /// What a finished artifact is worth in numbers, by names of one word, or of a word and what it is of: `max_displacement`,
    /// `rmse.physics`. They stand in the history of runs, are compared between runs, and tables collect them.
    ///
    /// # Errors
    /// When the artifact cannot be read.
    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let _ = artifact;
        Ok(Vec::new())
    }

    /// The files that a stage names, as it names them: relative to that of the pipeline.
    fn files(&self, stage: &Node) -> Vec<String> {
        let _ = stage;
        Vec::new()
    }

    /// What can be said of a stage and those that it needs before any work: what is bound to fail is refused, of what is likely to disappoint
    /// there are warnings. It must take next to no time. All stages have been read by then.
    ///
    /// # Errors
    /// When the stage would fail with whatever the stages that it needs make.
    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        let _ = (stage, needs);
        Ok(StageCheck::default())
    }

    /// Reads a stage from its mapping, which includes `kind` and `needs`, and from the pipeline's scene, already one
    /// mapping even where the pipeline names a file.
    ///
    /// # Errors
    /// When a key is unknown or missing, or a value out of range.
    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError>;
}

/// A stage as it stands in the pipeline.
#[derive(Clone, Copy)]
pub struct StageDeclaration<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its kind.
    pub kind: &'static str,
    /// Its mapping.
    pub node: &'a Node,
    /// Its scene.
    pub scene: Option<&'a Node>,
}

/// What is foreseen of a stage.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StageCheck {
    /// Warnings, for people.
    pub warnings: Vec<String>,
    /// What is to be compared with results of earlier runs.
    pub expectations: Vec<Expectation>,
    /// Whether most of its samples are likely to have no stable solution: what stages took that found one foretells nothing of it then.
    pub mostly_unstable: bool,
}

/// A number that stages with a result of some name should not exceed.
#[derive(Clone, Debug, PartialEq)]
pub struct Expectation {
    /// The stages whose results count: one by its name, or all of a kind.
    pub source: ResultSource,
    /// Name of the result, as in [`Kind::results`].
    pub result: String,
    /// The most that it should be.
    pub limit: f64,
    /// What is warned of where it is more, with `{value}` in place of the result and `{stage}` in place of the stage.
    pub warning: String,
}

/// Whose results count.
#[derive(Clone, Debug, PartialEq)]
pub enum ResultSource {
    /// Those of a stage.
    Stage(String),
    /// Those of all stages of a kind.
    Kind(&'static str),
}

/// How many inputs a kind takes, and of which kinds.
#[derive(Clone, Copy, Debug)]
pub struct Needs {
    /// Kinds that an input may have.
    pub kinds: &'static [&'static str],
    /// The least number of inputs.
    pub least: usize,
    /// The largest number of inputs.
    pub most: usize,
}

/// A stage that has been read and is valid.
pub trait Stage: Send + Sync {
    /// Everything that the output depends on apart from the inputs, defaults filled in, with the parts of the scene that
    /// this kind declares and no others.
    fn parameters(&self) -> Canonical;

    /// How the work divides, given what is known of the inputs.
    fn plan(&self, inputs: &[Input]) -> Plan;

    /// How many pieces [`Stage::plan`] will give, given how many those of the inputs are together: a plan that is too large
    /// to be made must be known without making it.
    fn pieces(&self, inputs: u64) -> u64 {
        let _ = inputs;
        1
    }

    /// Does one piece of work: a chunk, or the whole where the plan is [`Plan::Whole`]. The result must be a function of
    /// the stage, the chunk and the inputs alone, with any number of threads.
    ///
    /// # Errors
    /// When an input lacks what is needed, or the work fails.
    fn build(&self, job: &Job<'_>) -> Result<Object, StageError>;

    /// Content attributes of the manifest of a chunked stage.
    fn attributes(&self) -> Vec<(String, String)> {
        Vec::new()
    }

    /// How much work one step is, in comparison with the same kind at other parameters: elements of a mesh, individuals of a
    /// generation. It serves to foretell costs and nothing else.
    fn weight(&self) -> f64 {
        1.0
    }

    /// Whether each step goes through all inputs again, as an epoch does. It serves to foretell costs and nothing else.
    fn repeats_inputs(&self) -> bool {
        false
    }

    /// Whether a stage in one piece takes as long as its inputs are, and not as many steps as it has. It serves to foretell costs and nothing else.
    fn time_scales_with_inputs(&self) -> bool {
        true
    }

    /// The parameter with which the files of a stage in one piece grow: a number that is met more or less, such as the rows that are wanted. It
    /// serves to foretell costs and nothing else.
    fn size_parameter(&self) -> Option<&'static str> {
        None
    }

    /// What is added to the RECIPE of its kind: more than 0 where results with its parameters changed and those with others did not.
    fn revision(&self) -> u32 {
        0
    }

    /// What the steps of its progress are, in the plural.
    fn unit(&self) -> &'static str {
        "steps"
    }

    /// How many samples of a finished artifact have no stable solution; the run then ends with exit code 3.
    ///
    /// # Errors
    /// When the artifact cannot be read.
    fn unstable(&self, artifact: &Artifact) -> Result<u64, StageError> {
        let _ = artifact;
        Ok(0)
    }

    /// Whether [`Stage::blocks`] looks into the artifact, which has to be here then even where nothing is to be built.
    fn blocking_reads_artifact(&self) -> bool {
        false
    }

    /// Why stages that need this one must not run although its artifact is there, if they must not; `open` opens the
    /// artifact.
    ///
    /// # Errors
    /// When the artifact cannot be read.
    fn blocks(&self, open: &dyn Fn() -> Result<Artifact, StoreError>) -> Result<Option<String>, StageError> {
        let _ = open;
        Ok(None)
    }
}

/// What is known of an input before the work: a digest is `None` while it has yet to be built.
#[derive(Clone, Debug)]
pub struct Input {
    /// Digest of the artifact.
    pub digest: Option<ArtifactId>,
    /// Digests of its chunks, with the number of samples in each; the artifact itself, counted as one sample, where the
    /// stage is not chunked.
    pub parts: Vec<(Option<ArtifactId>, u64)>,
}

/// How the work of a stage divides.
#[derive(Clone, Debug)]
pub enum Plan {
    /// One piece of work over the stage's inputs. `steps` is the length of its progress bar.
    Whole {
        /// Length of the progress bar (epochs, generations, samples).
        steps: u64,
    },
    /// Chunks, each an action of its own; the artifact is a manifest of them.
    Chunks(Vec<Chunk>),
}

/// One chunk of a stage.
#[derive(Clone, Debug)]
pub struct Chunk {
    /// Canonical parameters of the chunk's own action.
    pub parameters: Canonical,
    /// Digests of the artifacts that it reads; `None` where one has yet to be built.
    pub inputs: Vec<Option<ArtifactId>>,
    /// Samples in it: its share of the progress bar.
    pub samples: u64,
}

/// One piece of work.
pub struct Job<'a> {
    /// Which chunk, or `None` for the whole.
    pub chunk: Option<&'a Chunk>,
    /// The artifacts to read: the chunk's inputs, or the stage's in the order of `needs`.
    pub inputs: &'a [Artifact],
    /// Where to report progress.
    pub progress: &'a dyn Progress,
    /// What was measured: see [`Job::measure`].
    pub measured: &'a Mutex<Vec<(String, f64)>>,
    /// Where the work may keep what it has come to, to be gone on with where it is killed.
    pub scratch: &'a Scratch<'a>,
}

impl Job<'_> {
    /// Notes seconds under a name on one line. They go into the provenance of the artifact, never into its content: no
    /// two runs measure the same.
    pub fn measure(&self, name: impl Into<String>, seconds: f64) {
        let mut measured = self.measured.lock().unwrap_or_else(PoisonError::into_inner);
        measured.push((name.into(), seconds));
    }
}

/// An error of any type, or a message.
pub type Cause = Box<dyn std::error::Error + Send + Sync>;

/// Why a stage could not be built.
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// An input artifact lacks what the stage needs, or holds what it cannot use.
    #[error(transparent)]
    Input(Cause),
    /// An input artifact cannot be used.
    #[error("artifact {}: {source}", artifact.short())]
    Artifact {
        /// The artifact.
        artifact: ArtifactId,
        /// Why it cannot be used.
        source: Cause,
    },
    /// The inputs are valid, but the stage cannot make anything from them.
    #[error("{source}")]
    Advised {
        /// What is wrong.
        source: Cause,
        /// What the user can do.
        help: String,
    },
    /// The work itself failed.
    #[error(transparent)]
    Failed(Cause),
    /// It made something else than the lock file says.
    #[error(transparent)]
    Locked(#[from] LockDifference),
    /// The artifact is there, and what it says stops the pipeline.
    #[error("{0}")]
    Blocked(String),
    /// It was asked to stop.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The store refused.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The result cannot be an artifact.
    #[error("the result is not a valid artifact: {0}")]
    Object(#[from] ObjectError),
}

impl StageError {
    /// Returns the error for inputs that the stage cannot use.
    pub fn input(cause: impl Into<Cause>) -> Self {
        Self::Input(cause.into())
    }

    /// Returns the error for an input artifact that the stage cannot use.
    pub fn in_artifact(artifact: &Artifact, source: impl Into<Cause>) -> Self {
        Self::Artifact {
            artifact: artifact.digest(),
            source: source.into(),
        }
    }

    /// Returns the error for work that failed.
    pub fn failed(cause: impl Into<Cause>) -> Self {
        Self::Failed(cause.into())
    }
}
