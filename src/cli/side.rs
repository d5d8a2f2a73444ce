//! What is compared: a past run, a pipeline as it stands, a lock file, or an artifact; its parameters and its results.

use std::collections::BTreeMap;
use std::path::Path;

use super::error::CliError;
use super::{locate, log, run};
use deaflow_base::{ArtifactId, Canonical, Override, readable_time};
use deaflow_orchestrator::{Environment, Kind, Registry, StageError, as_set, file_of, plan};
use deaflow_stage as stage;
use deaflow_store::{Artifact, LockFile, Record, Run, Store, StoreError};

/// The prefix of what a stage has from the scene.
const SCENE: &str = "scene.";

/// One side of a comparison.
pub struct Side {
    /// What it is, for people.
    pub title: String,
    /// Whether it is a pipeline, whose values `--set` can change.
    pub can_be_set: bool,
    /// Kind and parameters of each stage; none where they are not known any more.
    stages: Vec<(String, String, Option<Canonical>)>,
    /// What is known in numbers.
    pub results: BTreeMap<String, f64>,
    /// What is not known, and why.
    pub unknown: Vec<String>,
}

/// What was changed by `--set`, as words that follow a command or a file: a blank before each.
pub fn sets_of(overrides: &BTreeMap<String, String>) -> String {
    let sets = overrides.iter().map(|(path, value)| format!(" --set {path}={value}"));
    sets.collect()
}

impl Side {
    /// Nothing known yet.
    pub fn new(title: String) -> Self {
        Self {
            title,
            can_be_set: false,
            stages: Vec::new(),
            results: BTreeMap::new(),
            unknown: Vec::new(),
        }
    }

    /// Names of the stages whose parameters are not known any more.
    pub fn without_parameters(&self) -> impl Iterator<Item = &str> {
        let unknown = self.stages.iter().filter(|(.., parameters)| parameters.is_none());
        unknown.map(|(name, ..)| name.as_str())
    }

    /// Whether what a path names is of a stage whose parameters are not known here.
    pub fn is_unknown(&self, path: &str) -> bool {
        let of_stage = |name: &str| {
            let rest = path.strip_prefix("stages.").and_then(|rest| rest.strip_prefix(name));
            rest.is_some_and(|rest| rest.starts_with('.'))
        };
        self.without_parameters().any(of_stage)
    }

    /// All parameters by the paths that `--set` takes: `scene.drive.voltage`, where all stages that have it have it alike, or else
    /// `stages.NAME.scene.drive.voltage`.
    pub fn parameters(&self) -> BTreeMap<String, Canonical> {
        let mut all = BTreeMap::new();
        let mut of_scene: BTreeMap<String, Vec<(&str, &Canonical)>> = BTreeMap::new();
        for (name, kind, parameters) in &self.stages {
            all.insert(format!("stages.{name}.kind"), Canonical::from(kind.as_str()));
            for (path, value) in parameters.iter().flat_map(Canonical::leaves) {
                let path = as_set(&path).to_owned();
                match path.starts_with(SCENE) {
                    true => of_scene.entry(path).or_default().push((name, value)),
                    false => drop(all.insert(format!("stages.{name}.{path}"), value.clone())),
                }
            }
        }
        for (path, values) in of_scene {
            let first = values[0].1;
            if values.iter().all(|(_, value)| *value == first) {
                all.insert(path, first.clone());
            } else {
                let each = values.into_iter();
                all.extend(each.map(|(name, value)| (format!("stages.{name}.{path}"), value.clone())));
            }
        }
        all
    }
}

/// Where sides are looked for.
pub struct Places<'a> {
    store: &'a Store,
    registry: Registry,
}

impl<'a> Places<'a> {
    pub fn new(store: &'a Store) -> Self {
        Self {
            store,
            registry: stage::registry(),
        }
    }

    /// The side that an argument names. `sets` change it where it is a pipeline.
    ///
    /// # Errors
    /// When there is none, or what it names cannot be read.
    pub fn side(&self, argument: &str, sets: &[Override]) -> Result<Side, CliError> {
        let path = Path::new(argument);
        let extension = path.extension().and_then(|extension| extension.to_str());
        if let Some((pipeline, number)) = argument.rsplit_once('@') {
            return self.of_number(pipeline, number);
        }
        match extension {
            Some("yaml" | "yml") => self.of_pipeline(path, sets),
            Some("lock") => self.of_lock_file(path),
            _ => self.of_digits(argument),
        }
    }

    /// A run by its place in the list of all, or of those of a pipeline; 1 is the last.
    fn of_number(&self, pipeline: &str, number: &str) -> Result<Side, CliError> {
        let Some(place) = number.parse::<usize>().ok().filter(|place| *place > 0) else {
            return Err(CliError::bad_input(format!("{number:?} after `@` is no number from 1"))
                .help("@1 is the last run, @2 the one before, PIPELINE.yaml@1 the last of a pipeline"));
        };
        let path = Path::new(pipeline);
        let all = self.store.runs()?;
        let runs: Box<dyn Iterator<Item = Result<Run, StoreError>>> = match pipeline.is_empty() {
            true => Box::new(all),
            false => Box::new(self.store.runs_of(all, &file_of(path), &log::name_in(path))),
        };
        let mut seen = 0;
        for run in runs {
            let run = run?;
            seen += 1;
            if seen == place {
                return self.of_run(&run);
            }
        }
        let of = if pipeline.is_empty() {
            String::new()
        } else {
            format!(" of {pipeline}")
        };
        Err(CliError::bad_input(format!(
            "there is no run @{place}{of}: {seen} are remembered in {}",
            self.store.root().display()
        ))
        .help("`deaflow log` lists them"))
    }

    /// What a run did, without what came of it.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn parameters_of_run(&self, run: &Run) -> Result<Side, CliError> {
        let mut side = Side::new(run.id.clone());
        for stage in &run.stages {
            let record = self.store.record(&stage.key)?.record();
            self.stage(&mut side, &stage.name, &stage.kind, record.as_ref());
        }
        Ok(side)
    }

    fn of_run(&self, run: &Run) -> Result<Side, CliError> {
        let mut side = Side::new(format!(
            "run {} of {} at {}",
            run.id,
            run.pipeline,
            readable_time(&run.created)
        ));
        for stage in &run.stages {
            let record = self.store.record(&stage.key)?.record();
            self.stage(&mut side, &stage.name, &stage.kind, record.as_ref());
        }
        side.results.clone_from(&run.results);
        if run.results.is_empty() {
            for stage in &run.stages {
                self.results(&mut side, &stage.name, &stage.artifact);
            }
        }
        Ok(side)
    }

    fn of_pipeline(&self, path: &Path, sets: &[Override]) -> Result<Side, CliError> {
        let pipeline = run::load_file(path, sets, true)?;
        let reports = plan(&pipeline, self.store, None, &Environment::system())?;
        let sets = sets_of(&pipeline.overrides);
        let mut side = Side::new(format!("{}{sets} as it stands", path.display()));
        side.can_be_set = true;
        for (spec, report) in pipeline.stages.iter().zip(&reports) {
            let parameters = Some(spec.stage.parameters());
            side.stages
                .push((spec.name.clone(), spec.kind.name().to_owned(), parameters));
            match report.digest.filter(|_| report.why.is_none()) {
                Some(digest) => self.results(&mut side, &spec.name, &digest),
                None => side
                    .unknown
                    .push(format!("results of `{}`, which is not built", spec.name)),
            }
        }
        Ok(side)
    }

    fn of_lock_file(&self, path: &Path) -> Result<Side, CliError> {
        let lock = LockFile::read(path)?;
        let mut side = Side::new(format!("lock file {}", path.display()));
        for (name, stage) in &lock.stages {
            let record = self.store.record(&stage.key)?.record();
            let kind = record
                .as_ref()
                .map_or("", |record| record.action.kind.as_str())
                .to_owned();
            self.stage(&mut side, name, &kind, record.as_ref());
            self.results(&mut side, name, &stage.artifact);
        }
        Ok(side)
    }

    /// A run, or else an artifact, whose name or digest begins so.
    fn of_digits(&self, digits: &str) -> Result<Side, CliError> {
        if digits.len() >= locate::LEAST {
            for run in self.store.runs()? {
                let run = run?;
                if run.id.starts_with(&digits.to_ascii_lowercase()) {
                    return self.of_run(&run);
                }
            }
        }
        let artifact = locate::artifact(self.store, digits)?;
        let provenance = artifact.provenance()?;
        let key = provenance.get("action").and_then(|key| key.parse().ok());
        let record = key.map(|key| self.store.record(&key)).transpose()?;
        let record = record.and_then(deaflow_store::Lookup::record);
        let kind = artifact.kind().to_owned();
        let mut side = Side::new(format!("artifact {} ({kind})", artifact.digest().short()));
        // Two artifacts of a kind are compared whatever their stages are called.
        self.stage(&mut side, &kind, &kind, record.as_ref());
        self.results_of(&mut side, &kind, &artifact);
        Ok(side)
    }

    fn stage(&self, side: &mut Side, name: &str, kind: &str, record: Option<&Record>) {
        let parameters = record.map(|record| record.action.parameters.clone());
        if parameters.is_none() {
            side.unknown.push(format!(
                "parameters of `{name}` in {}: there is no record of them",
                side.title
            ));
        }
        side.stages.push((name.to_owned(), kind.to_owned(), parameters));
    }

    /// Reads the results of a stage from its artifact, where that is there.
    fn results(&self, side: &mut Side, name: &str, digest: &ArtifactId) {
        match self.store.artifact(digest) {
            Ok(artifact) => self.results_of(side, name, &artifact),
            Err(error) => side
                .unknown
                .push(format!("results of `{name}` in {}: {error}", side.title)),
        }
    }

    fn results_of(&self, side: &mut Side, name: &str, artifact: &Artifact) {
        let kind = self.registry.kinds.iter().find(|kind| kind.name() == artifact.kind());
        let found: Option<Result<_, StageError>> = kind.map(|kind: &&dyn Kind| kind.results(artifact));
        match found {
            Some(Ok(results)) => {
                let finite = results.into_iter().filter(|(_, value)| value.is_finite());
                side.results
                    .extend(finite.map(|(result, value)| (format!("{name}.{result}"), value)));
            }
            Some(Err(error)) => side
                .unknown
                .push(format!("results of `{name}` in {}: {error}", side.title)),
            None => side.unknown.push(format!(
                "results of `{name}` in {}: no kind {:?}",
                side.title,
                artifact.kind()
            )),
        }
    }
}
