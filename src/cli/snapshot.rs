//! Parameters and results of a past run, a pipeline, a lock file or an artifact, for comparisons.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::{CliError, locate, pipeline};
use deaflow_base::{ArtifactId, Canonical, Override, readable_time};
use deaflow_content::ArtifactKind;
use deaflow_orchestrator::{
    Environment, Kind, Registry, StageError, WITHOUT, as_set, file_of, is_digest, is_of_users, plan,
};
use deaflow_stage as stage;
use deaflow_store::{Artifact, Command, LockFile, Record, Run, RunStage, Store, StoreError};

/// The prefix of parameters that come from the scene.
const SCENE: &str = "scene.";

/// The key of a stage with the stages that it needs.
const NEEDS: &str = "needs";

/// The key of a stage with the names of its files.
const FILES: &str = "files";

/// A stage of a snapshot.
#[derive(Clone)]
struct NamedStage {
    name: String,
    kind: String,
    /// Missing if their record is gone.
    parameters: Option<Canonical>,
    /// The parameters that it has from the scene.
    from_scene: Vec<String>,
    /// Of each input the stages that made it: several may make the same artifact. `None` if that is not known.
    inputs: Option<Vec<Vec<String>>>,
}

/// One side of a comparison.
pub struct Snapshot {
    /// Its description.
    pub title: String,
    /// Whether it is a pipeline, whose values can be overridden.
    pub can_be_set: bool,
    /// Whether it is a run that did not reach the end of its pipeline.
    pub is_incomplete: bool,
    stages: Vec<NamedStage>,
    /// The results, by name.
    pub results: BTreeMap<String, f64>,
    /// The estimated errors of results that have one, by the names of the results.
    pub errors: BTreeMap<String, f64>,
    /// What is unknown, and why.
    pub unknown: Vec<String>,
}

/// Formats overrides as arguments, each after a space.
pub fn sets_of(overrides: &BTreeMap<String, String>) -> String {
    let sets = overrides.iter().map(|(path, value)| format!(" --set {path}={value}"));
    sets.collect()
}

impl Snapshot {
    /// Returns an empty snapshot.
    pub fn new(title: String) -> Self {
        Self {
            title,
            can_be_set: false,
            is_incomplete: false,
            stages: Vec::new(),
            results: BTreeMap::new(),
            errors: BTreeMap::new(),
            unknown: Vec::new(),
        }
    }

    /// Returns the names of the stages whose parameters are unknown.
    pub fn without_parameters(&self) -> impl Iterator<Item = &str> {
        let unknown = self.stages.iter().filter(|stage| stage.parameters.is_none());
        unknown.map(|stage| stage.name.as_str())
    }

    /// Whether a path belongs to a stage whose parameters are unknown.
    pub fn is_unknown(&self, path: &str) -> bool {
        let of_stage = |name: &str| {
            let rest = path.strip_prefix("stages.").and_then(|rest| rest.strip_prefix(name));
            rest.is_some_and(|rest| rest.starts_with('.'))
        };
        self.without_parameters().any(of_stage)
    }

    /// Adds a stage, of which the parameters `from_scene` are those of the scene.
    pub fn add_stage(
        &mut self,
        [name, kind]: [&str; 2],
        parameters: Option<Canonical>,
        from_scene: &[impl AsRef<str>],
    ) {
        self.stages.push(NamedStage {
            name: name.to_owned(),
            kind: kind.to_owned(),
            parameters,
            from_scene: from_scene.iter().map(|key| key.as_ref().to_owned()).collect(),
            inputs: None,
        });
    }

    /// Sets the inputs of the stage that was added last: of each the names of the stages that made it.
    pub fn set_inputs(&mut self, inputs: Vec<Vec<String>>) {
        if let Some(stage) = self.stages.last_mut() {
            stage.inputs = Some(inputs);
        }
    }

    /// Splits the name of a result into its stage and the result. Names of stages may have dots.
    pub fn stage_and_result<'n>(&self, name: &'n str) -> (&'n str, &'n str) {
        let of = |stage: &str| {
            let result = name.strip_prefix(stage)?.strip_prefix('.')?;
            Some((&name[..stage.len()], result))
        };
        let found = self.stages.iter().filter_map(|stage| of(&stage.name));
        found
            .max_by_key(|(stage, _)| stage.len())
            .or_else(|| name.split_once('.'))
            .unwrap_or(("", name))
    }

    /// Returns the parameters of those stages that another snapshot has too, by name and kind.
    pub fn shared_with(&self, other: &Self) -> Self {
        let is_shared = |stage: &&NamedStage| other.same(stage).is_some();
        Self {
            stages: self.stages.iter().filter(is_shared).cloned().collect(),
            ..Self::new(self.title.clone())
        }
    }

    /// Returns the stages of another snapshot that it did not reach; none if it reached the end of its pipeline.
    pub fn not_reached<'o>(&self, other: &'o Self) -> Vec<&'o str> {
        let stages = other.stages.iter().filter(|_| self.is_incomplete);
        stages
            .filter(|stage| !self.stages.iter().any(|own| own.name == stage.name))
            .map(|stage| stage.name.as_str())
            .collect()
    }

    /// Whether it has no stage: a run may fail in the first one.
    pub fn is_empty(&self) -> bool {
        self.stages.is_empty()
    }

    /// Whether another snapshot has a stage of the same name and kind.
    pub fn shares_stages(&self, other: &Self) -> bool {
        self.stages.iter().any(|stage| other.same(stage).is_some())
    }

    /// Returns the inputs of a stage that differ from those of the same stage of another snapshot, by the key that names
    /// them in a pipeline. A sweep is named once.
    fn other_inputs(&self, stage: &NamedStage, other: &Self, same: &NamedStage) -> Vec<(&'static str, Canonical)> {
        let (Some(own), Some(others)) = (&stage.inputs, &same.inputs) else {
            return Vec::new();
        };
        let written = |inputs: &[&Vec<String>]| {
            let names = inputs.iter().filter_map(|names| names.first());
            let mut names: Vec<String> = names
                .map(|name| name.split('@').next().unwrap_or(name).to_owned())
                .collect();
            names.dedup();
            names
        };
        let of_key = |key: &'static str| {
            let own = self.inputs_of(own, key == WITHOUT);
            let others = other.inputs_of(others, key == WITHOUT);
            let is_same = |(own, other): (&&Vec<String>, &&Vec<String>)| own.iter().any(|name| other.contains(name));
            if own.len() == others.len() && own.iter().zip(&others).all(is_same) {
                return None;
            }
            let (own, others) = (written(&own), written(&others));
            (own != others).then(|| (key, own.iter().map(|name| Canonical::from(name.as_str())).collect()))
        };
        [NEEDS, WITHOUT].into_iter().filter_map(of_key).collect()
    }

    /// Returns the inputs that are audits, which `without` names, or all others.
    fn inputs_of<'i>(&self, inputs: &'i [Vec<String>], audits: bool) -> Vec<&'i Vec<String>> {
        let is_audit = |names: &&Vec<String>| {
            let is_of = |stage: &NamedStage| names.contains(&stage.name) && stage.kind == ArtifactKind::Audit.name();
            self.stages.iter().any(is_of)
        };
        inputs.iter().filter(|names| is_audit(names) == audits).collect()
    }

    /// Returns the stage of the same name and kind.
    fn same(&self, stage: &NamedStage) -> Option<&NamedStage> {
        let is_same = |one: &&NamedStage| (&one.name, &one.kind) == (&stage.name, &stage.kind);
        self.stages.iter().find(is_same)
    }
}

/// Parameters by the paths of `--set`.
pub type ByPath = BTreeMap<String, Canonical>;

/// Returns all parameters of two snapshots by the paths of `--set`: `scene.drive.voltage` if it is the same for all
/// stages of a snapshot that have it, otherwise `stages.NAME.scene.drive.voltage` in both.
pub fn parameters(both: [&Snapshot; 2]) -> [ByPath; 2] {
    by_path(both, |stage, _| stage.parameters.clone())
}

/// Returns the same as written in a pipeline, to name what differs.
pub fn written_parameters(both: [&Snapshot; 2]) -> [ByPath; 2] {
    let kinds = stage::registry().kinds;
    by_path(both, |stage, same| {
        let own = stage.parameters.as_ref()?;
        let same = same.and_then(|same| same.parameters.as_ref());
        let Some(kind) = kinds.iter().find(|known| known.name() == stage.kind) else {
            return Some(own.clone());
        };
        let [written, _] = kind.as_written([own, same.unwrap_or(own)]);
        Some(written)
    })
}

/// Returns parameters by the paths of `--set`, as [`parameters`]. `written` returns those of a stage, given the same
/// stage of the other snapshot.
fn by_path(
    both: [&Snapshot; 2],
    written: impl Fn(&NamedStage, Option<&NamedStage>) -> Option<Canonical>,
) -> [ByPath; 2] {
    let mut own = [ByPath::new(), ByPath::new()];
    let mut of_scene: [BTreeMap<String, Vec<(&str, Canonical)>>; 2] = [BTreeMap::new(), BTreeMap::new()];
    let [from, to] = both;
    for (side, (snapshot, other)) in [(from, to), (to, from)].into_iter().enumerate() {
        for stage in &snapshot.stages {
            let (name, same) = (stage.name.as_str(), other.same(stage));
            // What a stage has from the scene on one side only is compared by its own path.
            let is_of_both = |key: &&String| same.is_none_or(|same| same.from_scene.contains(key));
            let from_scene: Vec<&String> = stage.from_scene.iter().filter(is_of_both).collect();
            own[side].insert(format!("stages.{name}.kind"), Canonical::from(stage.kind.as_str()));
            let other_inputs = same.map(|same| snapshot.other_inputs(stage, other, same));
            for (key, inputs) in other_inputs.into_iter().flatten() {
                own[side].insert(format!("stages.{name}.{key}"), inputs);
            }
            let parameters = written(stage, same);
            for (path, value) in parameters.iter().flat_map(Canonical::leaves) {
                let path = match is_of_users(&path) {
                    true => as_set(&path, &from_scene).into_owned(),
                    // The content of its files, which a user changes in the files.
                    false if is_digest(value) => FILES.to_owned(),
                    false => continue,
                };
                match path.starts_with(SCENE) {
                    true => of_scene[side].entry(path).or_default().push((name, value.clone())),
                    false => drop(own[side].insert(format!("stages.{name}.{path}"), value.clone())),
                }
            }
        }
    }
    let differs = |values: &Vec<(&str, Canonical)>| values.iter().any(|(_, value)| *value != values[0].1);
    let each = of_scene.iter().flatten().filter(|(_, values)| differs(values));
    let by_stage: BTreeSet<String> = each.map(|(path, _)| path.clone()).collect();
    for (all, of_scene) in own.iter_mut().zip(of_scene) {
        for (path, values) in of_scene {
            if by_stage.contains(&path) {
                let each = values.into_iter();
                all.extend(each.map(|(name, value)| (format!("stages.{name}.{path}"), value)));
            } else {
                all.extend(values.into_iter().next().map(|(_, value)| (path, value)));
            }
        }
    }
    own
}

/// Whether two runs are of the same file by the same command.
pub fn is_same_pipeline(one: &Run, other: &Run) -> bool {
    (&one.path, one.command) == (&other.path, other.command)
}

/// Reads snapshots of what arguments name.
pub struct SnapshotReader<'a> {
    store: &'a Store,
    registry: Registry,
}

impl<'a> SnapshotReader<'a> {
    pub fn new(store: &'a Store) -> Self {
        Self {
            store,
            registry: stage::registry(),
        }
    }

    /// Reads what an argument names; `sets` override values of a pipeline.
    ///
    /// # Errors
    /// When it does not exist or cannot be read.
    pub fn read(&self, argument: &str, sets: &[Override]) -> Result<Snapshot, CliError> {
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

    /// Reads the last run of a pipeline by `run`, whose stages are those of the file, as `status` does; without one,
    /// that of another command.
    ///
    /// # Errors
    /// When there is none, or the store cannot be read.
    pub fn last_of(&self, pipeline: &str) -> Result<Snapshot, CliError> {
        let path = Path::new(pipeline);
        let name = pipeline::name_in(path);
        for run in self.store.runs_of(self.store.runs()?, &file_of(path), &name) {
            let run = run?;
            if run.command == Command::Run {
                return self.of_run(&run);
            }
        }
        self.of_number(pipeline, "1")
    }

    /// Reads the last run, and the one before it of the same pipeline; the earlier one first.
    ///
    /// # Errors
    /// When there are no two, or the store cannot be read.
    pub fn last_two(&self) -> Result<[Snapshot; 2], CliError> {
        let mut runs = self.store.runs()?;
        let Some(last) = runs.next().transpose()? else {
            return Err(self.no_run("@1", 0));
        };
        for run in runs {
            let run = run?;
            if is_same_pipeline(&run, &last) {
                return Ok([self.of_run(&run)?, self.of_run(&last)?]);
            }
        }
        Err(CliError::bad_input("the pipeline of the last run has no other run")
            .help("name two runs, as in `deaflow diff @2 @1`"))
    }

    /// Reads a run by its position in the list of all runs, or of those of a pipeline; 1 is the last.
    fn of_number(&self, pipeline: &str, number: &str) -> Result<Snapshot, CliError> {
        let Some(position) = number.parse::<usize>().ok().filter(|position| *position > 0) else {
            return Err(
                CliError::bad_input(format!("{number:?} after `@` is not a positive number"))
                    .help("@1 is the last run, @2 the one before it, PIPELINE.yaml@1 the last run of a pipeline"),
            );
        };
        let path = Path::new(pipeline);
        let all = self.store.runs()?;
        let runs: Box<dyn Iterator<Item = Result<Run, StoreError>>> = match pipeline.is_empty() {
            true => Box::new(all),
            false => Box::new(self.store.runs_of(all, &file_of(path), &pipeline::name_in(path))),
        };
        let mut seen = 0;
        for run in runs {
            let run = run?;
            seen += 1;
            if seen == position {
                return self.of_run(&run);
            }
        }
        let of = if pipeline.is_empty() {
            String::new()
        } else {
            format!(" of {pipeline}")
        };
        Err(self.no_run(&format!("@{position}{of}"), seen))
    }

    /// Returns that there is no run of a name among those that were seen.
    fn no_run(&self, name: &str, seen: usize) -> CliError {
        CliError::bad_input(format!(
            "there is no run {name}: {} recorded in {}",
            match seen {
                1 => "1 run is".to_owned(),
                _ => format!("{seen} runs are"),
            },
            self.store.root().display()
        ))
        .help("list them with `deaflow log`")
    }

    /// Reads the parameters of a run, without its results.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn parameters_of_run(&self, run: &Run) -> Result<Snapshot, CliError> {
        let (id, created) = (&run.id, readable_time(&run.created));
        let mut snapshot = Snapshot::new(format!("run {id} of {} at {created}", run.pipeline));
        snapshot.is_incomplete = !run.is_complete();
        for stage in &run.stages {
            let record = self.store.record(&stage.key)?.record();
            let both = [stage.name.as_str(), &stage.kind];
            Self::stage(&mut snapshot, both, record.as_ref(), &stage.from_scene);
            let named = run.stages.iter().map(|made| (made.name.as_str(), &made.artifact));
            Self::inputs(&mut snapshot, record.as_ref(), named);
        }
        Ok(snapshot)
    }

    fn of_run(&self, run: &Run) -> Result<Snapshot, CliError> {
        let mut snapshot = self.parameters_of_run(run)?;
        snapshot.results.clone_from(&run.results);
        for stage in &run.stages {
            match run.results.is_empty() {
                true => self.results(&mut snapshot, &stage.name, &stage.artifact),
                false => self.errors(&mut snapshot, stage),
            }
        }
        Ok(snapshot)
    }

    fn of_pipeline(&self, path: &Path, sets: &[Override]) -> Result<Snapshot, CliError> {
        let pipeline = pipeline::load_file(path, sets, true)?;
        let reports = plan(&pipeline, self.store, None, &Environment::system())?;
        let sets = sets_of(&pipeline.overrides);
        let mut snapshot = Snapshot::new(format!("{}{sets}, current", path.display()));
        snapshot.can_be_set = true;
        for (spec, report) in pipeline.stages.iter().zip(&reports) {
            let parameters = Some(spec.stage().parameters());
            snapshot.add_stage([&spec.name, spec.kind.name()], parameters, &spec.from_scene);
            let needs = spec.needs.iter().map(|&need| vec![pipeline.stages[need].name.clone()]);
            snapshot.set_inputs(needs.collect());
            match report.digest.filter(|_| report.why.is_none()) {
                Some(digest) => self.results(&mut snapshot, &spec.name, &digest),
                None => snapshot.unknown.push(format!("results of `{}`: not built", spec.name)),
            }
        }
        Ok(snapshot)
    }

    fn of_lock_file(&self, path: &Path) -> Result<Snapshot, CliError> {
        let lock = LockFile::read(path)?;
        let mut snapshot = Snapshot::new(format!("lock file {}", path.display()));
        for (name, stage) in &lock.stages {
            let record = self.store.record(&stage.key)?.record();
            let kind = record
                .as_ref()
                .map_or("", |record| record.action.kind.as_str())
                .to_owned();
            Self::stage(&mut snapshot, [name, &kind], record.as_ref(), &[]);
            let named = lock.stages.iter().map(|(name, stage)| (name.as_str(), &stage.artifact));
            Self::inputs(&mut snapshot, record.as_ref(), named);
            self.results(&mut snapshot, name, &stage.artifact);
        }
        Ok(snapshot)
    }

    /// Reads the run, or else the artifact, whose name or digest begins with these digits.
    fn of_digits(&self, digits: &str) -> Result<Snapshot, CliError> {
        if digits.len() >= locate::MIN_DIGITS {
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
        let mut snapshot = Snapshot::new(format!("artifact {} ({kind})", artifact.digest().short()));
        // Stages are named by kind, so that artifacts of stages with different names can be compared.
        Self::stage(&mut snapshot, [&kind, &kind], record.as_ref(), &[]);
        self.results_of(&mut snapshot, &kind, &artifact);
        Ok(snapshot)
    }

    fn stage(snapshot: &mut Snapshot, [name, kind]: [&str; 2], record: Option<&Record>, from_scene: &[String]) {
        let parameters = record.map(|record| record.action.parameters.clone());
        if parameters.is_none() {
            snapshot
                .unknown
                .push(format!("parameters of `{name}` in {}: no record", snapshot.title));
        }
        snapshot.add_stage([name, kind], parameters, from_scene);
    }

    /// Sets the inputs of the stage that was added last, by the names of the stages that made them.
    fn inputs<'s>(
        snapshot: &mut Snapshot,
        record: Option<&Record>,
        made: impl Iterator<Item = (&'s str, &'s ArtifactId)> + Clone,
    ) {
        let Some(record) = record else { return };
        let names = |input: &ArtifactId| -> Vec<String> {
            let named = made.clone().filter(|(_, artifact)| *artifact == input);
            let names: Vec<String> = named.map(|(name, _)| name.to_owned()).collect();
            // The stage that made it is not in the run.
            if names.is_empty() { vec![input.short()] } else { names }
        };
        snapshot.set_inputs(record.action.inputs.iter().map(names).collect());
    }

    /// Reads the errors of the results of a stage of a run. The history has the results themselves; where an artifact
    /// is not there any more, they have no errors.
    fn errors(&self, snapshot: &mut Snapshot, stage: &RunStage) {
        if let Ok(artifact) = self.store.artifact(&stage.artifact) {
            self.errors_of(snapshot, &stage.name, &artifact);
        }
    }

    fn errors_of(&self, snapshot: &mut Snapshot, name: &str, artifact: &Artifact) {
        let kind = self.registry.kinds.iter().find(|kind| kind.name() == artifact.kind());
        match kind.map(|kind| kind.errors(artifact)) {
            Some(Ok(errors)) => {
                let named = errors
                    .into_iter()
                    .map(|(result, error)| (format!("{name}.{result}"), error));
                snapshot.errors.extend(named);
            }
            Some(Err(error)) => snapshot
                .unknown
                .push(format!("errors of `{name}` in {}: {error}", snapshot.title)),
            None => {}
        }
    }

    /// Reads the results of a stage from its artifact, if it exists.
    fn results(&self, snapshot: &mut Snapshot, name: &str, digest: &ArtifactId) {
        match self.store.artifact(digest) {
            Ok(artifact) => self.results_of(snapshot, name, &artifact),
            Err(error) => snapshot
                .unknown
                .push(format!("results of `{name}` in {}: {error}", snapshot.title)),
        }
    }

    fn results_of(&self, snapshot: &mut Snapshot, name: &str, artifact: &Artifact) {
        let kind = self.registry.kinds.iter().find(|kind| kind.name() == artifact.kind());
        let found: Option<Result<_, StageError>> = kind.map(|kind: &&dyn Kind| kind.results(artifact));
        match found {
            Some(Ok(results)) => {
                let finite = results.into_iter().filter(|(_, value)| value.is_finite());
                snapshot
                    .results
                    .extend(finite.map(|(result, value)| (format!("{name}.{result}"), value)));
                self.errors_of(snapshot, name, artifact);
            }
            Some(Err(error)) => snapshot
                .unknown
                .push(format!("results of `{name}` in {}: {error}", snapshot.title)),
            None => snapshot.unknown.push(format!(
                "results of `{name}` in {}: unknown kind {:?}",
                snapshot.title,
                artifact.kind()
            )),
        }
    }
}
