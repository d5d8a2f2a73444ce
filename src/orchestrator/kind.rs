//! The interface between the orchestrator and the kinds of stages.
//!
//! A [`Kind`] reads the mapping of a stage into a [`Stage`]. A stage defines its canonical parameters (its key is
//! computed from these and the digests of its inputs), how its work is divided into chunks, and how to do one piece of
//! work.

use std::sync::{Mutex, PoisonError};

use super::declaration::StageDeclaration;
use super::lock_difference::LockDifference;
use super::scratch::Scratch;
use super::without::named_files;
use deaflow_base::{ArtifactId, Canonical, Fields, InputError, Node, NodeValue, Progress, Stopped};
use deaflow_store::{Artifact, Object, ObjectError, StoreError};

/// A kind of stage: `sample`, `solve`, …
pub trait Kind: Sync {
    /// Returns the name, which stands after `kind:`.
    fn name(&self) -> &'static str;

    /// Returns the RECIPE number. Raise it whenever the output for given parameters and inputs changes.
    fn recipe(&self) -> u32;

    /// Returns which stages `needs` must list; by default none.
    fn needs(&self) -> Needs {
        Needs::new(&[], 0, 0)
    }

    /// Returns kinds that `needs` may list in addition to those of [`Kind::needs`], without being counted.
    fn optional_needs(&self) -> &'static [&'static str] {
        &[]
    }

    /// Returns the kinds of stages that the key `without` may name, if there is one: they list rows to leave out, and
    /// are inputs after those of `needs`. [`Kind::read`] reads the other items of that key, which are names of files;
    /// see [`super::names_stage`].
    fn without(&self) -> &'static [&'static str] {
        &[]
    }

    /// Returns the keys that [`Kind::read`] accepts besides `kind` and `needs`: one mapping, or one for each family
    /// that has its own keys.
    fn schema(&self) -> Vec<Fields>;

    /// Whether stages of any kind may list stages of this kind in `needs` only to wait for them. Those are neither
    /// inputs nor part of the key.
    fn gates(&self) -> bool {
        false
    }

    /// Whether its stages depend on the scene. If the scene is swept, each gets its own.
    fn reads_scene(&self) -> bool {
        false
    }

    /// Whether its artifacts have a scene that it makes, which other stages may read in place of that of the pipeline:
    /// `scene: { from: STAGE }`.
    fn makes_scene(&self) -> bool {
        false
    }

    /// Returns the scene that a stage of a kind that [`Kind::makes_scene`] has made.
    ///
    /// # Errors
    /// If the artifact has none, or it cannot be read.
    fn scene_of(&self, artifact: &Artifact) -> Result<Node, StageError> {
        Err(StageError::in_artifact(artifact, "it has no scene for other stages"))
    }

    /// Whether its stages collect the results of all stages of sweeps. [`Kind::read`] then finds under `rows` which
    /// needs belong together: a list of pairs of the axis values by axis name, and the indices of needs by stage name.
    fn collects(&self) -> bool {
        false
    }

    /// Returns the kind that receives the results of this kind as feedback, if its stages may be repeated in rounds;
    /// see `orchestrator/rounds.rs`. [`Kind::read`] of this kind must then accept and ignore the keys `rounds` and
    /// `update`, and the target must accept stages of this kind and of its own kind as needs.
    fn feedback_target(&self) -> Option<&'static str> {
        None
    }

    /// Returns the keys and values that a stage of this kind, as a feedback target, has from the second round on.
    ///
    /// # Errors
    /// If a key on which they depend cannot be read.
    fn feedback_overrides(&self, stage: &Node) -> Result<Vec<(&'static str, NodeValue)>, InputError> {
        let _ = stage;
        Ok(Vec::new())
    }

    /// Returns the parameters, as dotted paths in the key of a stage or chunk, whose values have unrelated costs: the
    /// cost with one value does not predict the cost with another.
    fn separate_cost_parameters(&self) -> &'static [&'static str] {
        &[]
    }

    /// Returns the parameters of two stages of this kind as they are written in a pipeline, to name what differs: by
    /// the keys of the file, with shares in per cent where a length would have its unit.
    fn as_written(&self, both: [&Canonical; 2]) -> [Canonical; 2] {
        both.map(Canonical::clone)
    }

    /// Returns the parameters that a stage has from the scene, by the paths that it could have in their place. Each is
    /// followed by `=` and its path in the scene if that differs: `objective.robust.mask=tolerances.mask`.
    fn scene_parameters(&self, stage: &Node) -> Vec<String> {
        let _ = stage;
        Vec::new()
    }

    /// Returns the results of a finished artifact as numbers by name, such as `max_displacement` or `rmse.physics`.
    /// They are written into the history of runs, compared between runs and collected in tables.
    ///
    /// # Errors
    /// If the artifact cannot be read.
    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let _ = artifact;
        Ok(Vec::new())
    }

    /// Returns the estimated errors of those results that have one, by the names of the results.
    ///
    /// # Errors
    /// If the artifact cannot be read.
    fn errors(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let _ = artifact;
        Ok(Vec::new())
    }

    /// Returns the files that a stage names, relative to the file of the pipeline: those of `without`, if there is such
    /// a key.
    fn files(&self, stage: &Node) -> Vec<String> {
        match self.without().is_empty() {
            true => Vec::new(),
            false => named_files(stage),
        }
    }

    /// Checks a stage and its needs before any work, after all stages have been read. It must be fast. Returns warnings
    /// of likely problems.
    ///
    /// # Errors
    /// If the stage would certainly fail.
    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        let _ = (stage, needs);
        Ok(StageCheck::default())
    }

    /// Reads a stage from its mapping, which includes `kind` and `needs`, and from the scene of the pipeline, which has
    /// been loaded if the pipeline names a file.
    ///
    /// # Errors
    /// If a key is unknown or missing, or a value is out of range.
    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError>;
}

/// The result of checking a stage before a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StageCheck {
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// Limits for results of earlier runs.
    pub expectations: Vec<Expectation>,
    /// Whether most of its samples are likely to have no stable solution. Costs of stable stages do not predict its
    /// cost then.
    pub mostly_unstable: bool,
}

/// A limit that a result of other stages should not exceed.
#[derive(Clone, Debug, PartialEq)]
pub struct Expectation {
    /// The stages whose results are compared.
    pub source: ResultSource,
    /// Name of the result, as in [`Kind::results`].
    pub result: String,
    /// The limit.
    pub limit: f64,
    /// The warning if it is exceeded; `{value}` is replaced by the result and `{stage}` by the stage.
    pub warning: String,
}

/// Which stages have a result.
#[derive(Clone, Debug, PartialEq)]
pub enum ResultSource {
    /// The stage of this name.
    Stage(String),
    /// All stages of this kind.
    Kind(&'static str),
}

/// The number of inputs of a kind, and their kinds.
#[derive(Clone, Copy, Debug)]
pub struct Needs {
    /// Allowed kinds of inputs.
    pub kinds: &'static [&'static str],
    /// The smallest number of inputs.
    pub least: usize,
    /// The largest number of inputs.
    pub most: usize,
}

impl Needs {
    /// Allows `least` to `most` inputs of some kinds.
    #[must_use]
    pub const fn new(kinds: &'static [&'static str], least: usize, most: usize) -> Self {
        Self { kinds, least, most }
    }
}

/// A stage that has been read and is valid.
pub trait Stage: Send + Sync {
    /// Returns everything besides the inputs that the output depends on, including defaults and the parts of the scene
    /// that this kind reads.
    fn parameters(&self) -> Canonical;

    /// Divides the work, given what is known of the inputs. The default is one piece with a step per input.
    fn plan(&self, inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: inputs.len() as u64,
        }
    }

    /// Returns the number of pieces that [`Stage::plan`] will return, given the total number of pieces of the inputs.
    /// It is used to refuse plans that are too large.
    fn pieces(&self, inputs: u64) -> u64 {
        let _ = inputs;
        1
    }

    /// Checks the numbers of samples of its inputs, given by kind, before any work. The number of an input that is not
    /// divided into chunks is 1.
    ///
    /// # Errors
    /// If the stage would certainly fail: the reason.
    fn check_samples(&self, inputs: &[(&'static str, u64)]) -> Result<(), String> {
        let _ = inputs;
        Ok(())
    }

    /// Whether [`Stage::check_samples`] refuses anything. Counting samples takes time in a large pipeline.
    fn checks_samples(&self) -> bool {
        false
    }

    /// Checks its inputs before any work: their kinds and digests, and what `open` opens, which is `None` if it is not
    /// in the store. The digest of an input that has not been built is not known.
    ///
    /// # Errors
    /// If the stage would certainly fail, with the position of the reason in the pipeline.
    fn check_inputs(
        &self,
        inputs: &[(&'static str, Option<ArtifactId>)],
        open: &dyn Fn(&ArtifactId) -> Option<Artifact>,
    ) -> Result<(), InputError> {
        let _ = (inputs, open);
        Ok(())
    }

    /// Does one piece of work: a chunk, or the whole stage if the plan is [`Plan::Whole`]. The result must depend only
    /// on the stage, the chunk and the inputs, not on the number of threads.
    ///
    /// # Errors
    /// If an input is not suitable, or the work fails.
    fn build(&self, job: &Job<'_>) -> Result<Object, StageError>;

    /// Returns the content attributes of the manifest of a chunked stage.
    fn attributes(&self) -> Vec<(String, String)> {
        Vec::new()
    }

    /// Returns how much work one step is, relative to the same kind with other parameters: elements of a mesh,
    /// individuals of a generation. Used only for cost estimates.
    fn weight(&self) -> f64 {
        1.0
    }

    /// Whether each step reads all inputs again, as an epoch does. Used only for cost estimates.
    fn repeats_inputs(&self) -> bool {
        false
    }

    /// Whether the duration of a stage in one piece is proportional to the size of its inputs, not to its steps. Used
    /// only for cost estimates.
    fn time_scales_with_inputs(&self) -> bool {
        true
    }

    /// Returns the parameter to which the file size of a stage in one piece is proportional, such as the requested
    /// number of rows. Used only for cost estimates.
    fn size_parameter(&self) -> Option<&'static str> {
        None
    }

    /// Returns a number to add to the RECIPE of its kind: more than 0 if only results with certain parameters have
    /// changed.
    fn revision(&self) -> u32 {
        0
    }

    /// Returns what its reading did that a user should know, such as how the files that it names were read.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// Returns the unit of its progress, in the plural.
    fn unit(&self) -> &'static str {
        "inputs"
    }

    /// Returns the number of samples of a finished artifact without a stable solution; the run then ends with exit code
    /// 3.
    ///
    /// # Errors
    /// If the artifact cannot be read.
    fn unstable(&self, artifact: &Artifact) -> Result<u64, StageError> {
        let _ = artifact;
        Ok(0)
    }

    /// Whether [`Stage::blocks`] reads the artifact, which then has to be in this store even if nothing is built.
    fn blocking_reads_artifact(&self) -> bool {
        false
    }

    /// Returns why stages that need this one must not run although its artifact exists, if so; `open` opens the
    /// artifact.
    ///
    /// # Errors
    /// If the artifact cannot be read.
    fn blocks(&self, open: &dyn Fn() -> Result<Artifact, StoreError>) -> Result<Option<String>, StageError> {
        let _ = open;
        Ok(None)
    }
}

/// What is known of an input before the work. A digest is `None` until the artifact is built.
#[derive(Clone, Debug)]
pub struct Input {
    /// Digest of the artifact.
    pub digest: Option<ArtifactId>,
    /// Digests of its chunks with their numbers of samples; for a stage without chunks the artifact itself, counted as
    /// one sample.
    pub parts: Vec<(Option<ArtifactId>, u64)>,
}

/// How the work of a stage is divided.
#[derive(Clone, Debug)]
pub enum Plan {
    /// One piece of work on the inputs of the stage.
    Whole {
        /// Length of the progress bar (epochs, generations, samples).
        steps: u64,
    },
    /// Chunks, each with its own action; the artifact is a manifest of them.
    Chunks(Vec<Chunk>),
}

/// One chunk of a stage.
#[derive(Clone, Debug)]
pub struct Chunk {
    /// Canonical parameters of the action of the chunk.
    pub parameters: Canonical,
    /// Digests of the artifacts that it reads; `None` for one that is not built yet.
    pub inputs: Vec<Option<ArtifactId>>,
    /// Number of samples in it.
    pub samples: u64,
}

/// One piece of work.
pub struct Job<'a> {
    /// The chunk, or `None` for a whole stage.
    pub chunk: Option<&'a Chunk>,
    /// The artifacts to read: the inputs of the chunk, or of the stage in the order of `needs`.
    pub inputs: &'a [Artifact],
    /// Receives the progress.
    pub progress: &'a dyn Progress,
    /// Measured times; see [`Job::measure`].
    pub measured: &'a Mutex<Vec<(String, f64)>>,
    /// Stores checkpoints, from which killed work is resumed.
    pub scratch: &'a Scratch<'a>,
}

impl Job<'_> {
    /// Adds a measured time in s under a name on one line. It is written into the provenance of the artifact, never
    /// into its content, because it differs between runs.
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
    /// The content of the artifact stops the pipeline.
    #[error("{0}")]
    Blocked(String),
    /// The run was stopped.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The store reported an error.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The result is not valid as an artifact.
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
