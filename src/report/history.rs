//! The history of the artifacts of a pipeline: what built each, when, where and at what cost, and what the last run
//! built.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::artifacts::{RunArtifacts, StageArtifact};
use super::error::ReportError;
use deaflow_base::{ArtifactId, Node, NodeValue};
use deaflow_orchestrator::{Pipeline, Rounds, StageReport};
use deaflow_store::{Artifact, Command, Cost, Run, StageOutcome, Store, StoreError};

/// A pipeline with the history of its artifacts.
#[derive(Clone, Debug)]
pub struct PipelineHistory {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Its file.
    pub path: String,
    /// Overrides from the command line: values in YAML by dotted path.
    pub overrides: BTreeMap<String, String>,
    /// The stages in topological order.
    pub stages: Vec<StageRecord>,
    /// Stages that are repeated in rounds.
    pub rounds: Vec<Rounds>,
    /// Warnings about the model: neglected effects that are significant, a line each.
    pub model_warnings: Vec<String>,
    /// The last run that built an artifact of the present plan; `None` if no run in the history has these artifacts.
    pub last_run: Option<LastRun>,
    /// Another run that built one, as a sweep does, if no run of the pipeline did.
    pub built_by: Option<BuiltBy>,
}

/// A run that built artifacts that another pipeline or command uses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BuiltBy {
    /// Its identifier.
    pub id: String,
    /// The command that ran it.
    pub command: &'static str,
    /// Name of its pipeline.
    pub pipeline: String,
    /// Its end, in UTC, RFC 3339.
    pub ended: String,
}

/// The run of the drawing of stages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LastRun {
    /// Its end, in UTC, RFC 3339.
    pub ended: String,
    /// Whether it built an artifact of the plan; if not, no run of the pipeline in the history did.
    pub has_built: bool,
}

/// One stage.
#[derive(Clone, Debug)]
pub struct StageRecord {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: String,
    /// Indices of the stages that it waits for.
    pub needs: Vec<usize>,
    /// Its artifact; `None` if it is not built.
    pub digest: Option<ArtifactId>,
    /// Size of its files, bytes.
    pub bytes: u64,
    /// Why it has to be built; `None` if it is up to date.
    pub why: Option<String>,
    /// The origin of its artifact; `None` if it is not built.
    pub origin: Option<Origin>,
    /// The parts of its scene with their entries, as in the pipeline; empty without a scene.
    pub scene: Vec<(String, String)>,
}

/// The origin of an artifact.
#[derive(Clone, Debug)]
pub struct Origin {
    /// The time, in UTC, RFC 3339.
    pub created: String,
    /// Name of the machine.
    pub host: String,
    /// The machines, with the number of chunks that each built.
    pub builders: BTreeMap<String, usize>,
    /// Version of this program.
    pub version: String,
    /// Architecture, operating system and processor.
    pub target: String,
    /// The RECIPE number of the kind.
    pub recipe: String,
    /// Computing time, s: for chunks, the sum, although several run at a time.
    pub work: f64,
    /// Time from the start of the stage to its end, s; `None` if it was interrupted, or is not known.
    pub elapsed: Option<f64>,
    /// Its part of the time of the run, s: the parts add up to that time; `None` if it was interrupted.
    pub part: Option<f64>,
    /// Number of chunks; 1 if it has none.
    pub chunks: usize,
    /// The number of chunks that the last run built; `None` if it had no such stage.
    pub built: Option<usize>,
}

impl PipelineHistory {
    /// Reads the history of the stages of a plan.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn of(pipeline: &Pipeline, plan: &[StageReport], store: &Store) -> Result<Self, ReportError> {
        let file = pipeline.file();
        let own = store.runs_of(store.runs()?.take(MAX_RUNS), &file, &pipeline.name);
        let last = last_of(own, plan)?;
        // What was built after the end of the run before was built by the last one, or by one that was killed since.
        let mut all = store.runs()?;
        let is_last = |run: &Run| last.as_ref().is_some_and(|last| last.id == run.id);
        let _ = all.find(|run| run.as_ref().is_ok_and(is_last));
        let since = all.next().transpose()?.map(|run| run.created);
        let (last, since) = (last.as_ref(), since.as_deref());
        let costs = store.costs();
        let mut stages = Vec::new();
        for report in plan {
            let digest = there(report);
            let origin = digest.map(|digest| {
                let artifact = store.artifact(&digest)?;
                let built = last.filter(|run| has(run, report, &digest));
                origin(&artifact, report, &costs, built.map(|_| since))
            });
            stages.push(StageRecord {
                name: report.name.clone(),
                kind: report.kind.clone(),
                needs: needs(pipeline, plan, &report.name),
                digest,
                bytes: report.size,
                why: report.why.clone(),
                origin: origin.transpose()?,
                scene: scene(pipeline, &report.name),
            });
        }
        Ok(Self {
            pipeline: pipeline.name.clone(),
            path: pipeline.path.display().to_string(),
            overrides: pipeline.overrides.clone(),
            stages,
            rounds: pipeline.rounds.clone(),
            model_warnings: Vec::new(),
            built_by: match last.is_some_and(|run| has_built(run, plan)) {
                true => None,
                false => built_by(store.runs()?.take(MAX_RUNS), plan)?,
            },
            last_run: last.map(|run| LastRun {
                ended: run.created.clone(),
                has_built: has_built(run, plan),
            }),
        })
    }

    /// Returns the artifacts for reading.
    #[must_use]
    pub fn run<'a>(&'a self, store: &'a Store, stages: &'a [StageArtifact]) -> RunArtifacts<'a> {
        RunArtifacts {
            store,
            file: Path::new(&self.path),
            stages,
            rounds: &self.rounds,
        }
    }

    /// Returns the artifacts that are built.
    #[must_use]
    pub fn made(&self) -> Vec<StageArtifact> {
        let made = |stage: &StageRecord| {
            Some(StageArtifact {
                stage: stage.name.clone(),
                kind: stage.kind.clone(),
                digest: stage.digest?,
            })
        };
        self.stages.iter().filter_map(made).collect()
    }

    /// Returns the stages that are not built.
    #[must_use]
    pub fn missing(&self) -> Vec<&StageRecord> {
        self.stages.iter().filter(|stage| stage.digest.is_none()).collect()
    }
}

/// Returns the parts of the scene of a stage with their entries as written.
fn scene(pipeline: &Pipeline, name: &str) -> Vec<(String, String)> {
    let node = pipeline.stage(name).and_then(|spec| pipeline.scene_of(spec));
    let Some(NodeValue::Map(parts)) = node.as_deref().map(Node::value) else {
        return Vec::new();
    };
    let entries = |part: &Node| match part.value() {
        NodeValue::Map(_) => part.written_entries().join(", "),
        _ => part.written(),
    };
    parts.iter().map(|(key, part)| (key.written(), entries(part))).collect()
}

/// Runs that are searched for the last one of a pipeline.
const MAX_RUNS: usize = 1000;

/// Returns the last run that built an artifact of the plan, of runs sorted from the newest; runs of a sweep with other
/// parameters built other artifacts. If there is none, returns the last run that had any of the artifacts.
fn last_of(
    runs: impl Iterator<Item = Result<Run, StoreError>>,
    plan: &[StageReport],
) -> Result<Option<Run>, StoreError> {
    let mut had = None;
    for run in runs {
        let run = run?;
        if run.command != Command::Run {
            continue;
        }
        if has_built(&run, plan) {
            return Ok(Some(run));
        }
        let is_of_it = |report: &&StageReport| there(report).is_some_and(|digest| has(&run, report, &digest));
        if had.is_none() && plan.iter().any(|report| is_of_it(&report)) {
            had = Some(run);
        }
    }
    Ok(had)
}

/// Returns the last run of any command and pipeline that built an artifact of the plan, of runs sorted from the newest.
fn built_by(
    runs: impl Iterator<Item = Result<Run, StoreError>>,
    plan: &[StageReport],
) -> Result<Option<BuiltBy>, StoreError> {
    let wanted: BTreeSet<ArtifactId> = plan.iter().filter_map(there).collect();
    for run in runs {
        let run = run?;
        let built = run.stages.iter().filter(|stage| stage.outcome == StageOutcome::Built);
        if built.into_iter().any(|stage| wanted.contains(&stage.artifact)) {
            return Ok(Some(BuiltBy {
                id: run.id,
                command: run.command.name(),
                pipeline: run.pipeline,
                ended: run.created,
            }));
        }
    }
    Ok(None)
}

/// Returns the artifact of a stage that is up to date.
fn there(report: &StageReport) -> Option<ArtifactId> {
    report.digest.filter(|_| report.staleness.is_none())
}

/// Whether a run built an artifact of the plan.
fn has_built(run: &Run, plan: &[StageReport]) -> bool {
    let built = run.stages.iter().filter(|stage| stage.outcome == StageOutcome::Built);
    built.into_iter().any(|stage| {
        let of_plan = plan.iter().find(|report| report.name == stage.name);
        of_plan.and_then(there) == Some(stage.artifact)
    })
}

fn has(run: &Run, report: &StageReport, digest: &ArtifactId) -> bool {
    run.stage(&report.name).is_some_and(|stage| stage.artifact == *digest)
}

/// Returns the indices of the stages that a stage waits for.
fn needs(pipeline: &Pipeline, plan: &[StageReport], name: &str) -> Vec<usize> {
    let waits = pipeline.stage(name).map(|spec| spec.waits_for()).unwrap_or_default();
    let place = |index: usize| {
        let needed = &pipeline.stages[index].name;
        plan.iter().position(|other| other.name == *needed)
    };
    waits.into_iter().filter_map(place).collect()
}

/// Reads the origin of an artifact. `since` is the end of the run before the last one, if there was one; the outer
/// option is `None` without a last run that has this artifact.
fn origin(
    artifact: &Artifact,
    report: &StageReport,
    costs: &[Cost],
    since: Option<Option<&str>>,
) -> Result<Origin, ReportError> {
    let entries = artifact.provenance()?;
    let entry = |name: &str| entries.get(name).cloned().unwrap_or_default();
    let pieces = match artifact.is_manifest() {
        true => artifact
            .chunks()?
            .iter()
            .map(Artifact::provenance)
            .collect::<Result<_, _>>()?,
        false => vec![entries.clone()],
    };
    let mut builders = BTreeMap::new();
    for piece in &pieces {
        *builders
            .entry(piece.get("host").cloned().unwrap_or_default())
            .or_default() += 1;
    }
    // Times have one format, so that their texts are in the order of time.
    let is_after = |piece: &&BTreeMap<String, String>, since: Option<&str>| {
        since.is_none_or(|since| piece.get("created").map(String::as_str) > Some(since))
    };
    let built = since.map(|since| pieces.iter().filter(|piece| is_after(piece, since)).count());
    let created = entry("created");
    let cost = cost_of(costs, report, &created);
    Ok(Origin {
        host: entry("host"),
        builders,
        version: entry("version"),
        target: entry("target"),
        recipe: entry("recipe"),
        work: entry("seconds").parse().unwrap_or_default(),
        elapsed: cost.and_then(|cost| cost.elapsed),
        part: cost.map(|cost| cost.seconds),
        chunks: artifact.parts().len().max(1),
        built,
        created,
    })
}

/// Returns the cost that was recorded for the artifact: the first one of its kind within a second after it.
fn cost_of<'a>(costs: &'a [Cost], report: &StageReport, created: &str) -> Option<&'a Cost> {
    let made = seconds(created)?;
    let lag = |cost: &Cost| Some(seconds(&cost.created)? - made);
    let own = costs.iter().filter(|cost| cost.kind == report.kind);
    let own = own.filter_map(|cost| Some((lag(cost)?, cost)));
    own.filter(|(lag, _)| (0.0..1.0).contains(lag))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, cost)| cost)
}

/// Converts a time of an artifact to seconds: `2026-01-01T00:00:00.000Z`.
fn seconds(time: &str) -> Option<f64> {
    let number = |from: usize, to: usize| time.get(from..to)?.parse::<f64>().ok();
    let (year, month, day) = (number(0, 4)?, number(5, 7)?, number(8, 10)?);
    // Days of the Julian calendar with years that start in March, correct between 1901 and 2099.
    let (year, month) = if month > 2.0 {
        (year, month)
    } else {
        (year - 1.0, month + 12.0)
    };
    let days = (365.25 * year).floor() + (30.6 * (month + 1.0)).floor() + day;
    Some(86_400.0 * days + 3600.0 * number(11, 13)? + 60.0 * number(14, 16)? + number(17, 23)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::ActionKey;
    use deaflow_orchestrator::{Outcome, Staleness};
    use deaflow_store::RunStage;

    fn id(text: &str) -> ArtifactId {
        ArtifactId::of(text.as_bytes())
    }

    fn run(name: &str, command: Command, stages: &[(&str, &str, StageOutcome)]) -> Run {
        let stage = |(name, artifact, outcome): &(&str, &str, StageOutcome)| RunStage {
            name: (*name).to_owned(),
            kind: "solve".into(),
            key: ActionKey::of(artifact.as_bytes()),
            artifact: id(artifact),
            outcome: *outcome,
            from_scene: Vec::new(),
        };
        Run {
            id: name.to_owned(),
            command,
            stages: stages.iter().map(stage).collect(),
            ..Run::default()
        }
    }

    fn planned(name: &str, artifact: &str, staleness: Option<Staleness>) -> StageReport {
        StageReport {
            chunks_reused: 1,
            digest: Some(id(artifact)),
            staleness,
            ..StageReport::new(name, "solve", Outcome::Reused)
        }
    }

    #[test]
    fn the_last_run_is_the_one_that_built_the_present_artifacts() {
        use StageOutcome::{Built, Reused};
        let plan = [planned("a", "a1", None), planned("b", "b1", None)];
        let swept = run("swept", Command::Run, &[("a", "a1", Reused), ("b", "b2", Built)]);
        let audit = run("audit", Command::Audit, &[("a", "a1", Built)]);
        let first = run("first", Command::Run, &[("a", "a1", Built), ("b", "b1", Built)]);
        let found = |runs: &[&Run], plan: &[StageReport]| {
            let runs = runs.iter().map(|run| Ok((*run).clone()));
            last_of(runs, plan)
                .unwrap()
                .map(|run| (run.id.clone(), has_built(&run, plan)))
        };
        assert_eq!(
            found(&[&swept, &audit, &first], &plan),
            Some(("first".to_owned(), true))
        );
        let by = |runs: &[&Run]| built_by(runs.iter().map(|run| Ok((*run).clone())), &plan).unwrap();
        let sweep = Run {
            command: Command::Sweep,
            ..run("sweep", Command::Run, &[("a@x=1", "a1", Built)])
        };
        let found_by = by(&[&swept, &sweep]).unwrap();
        assert_eq!((found_by.id.as_str(), found_by.command), ("sweep", "sweep"));
        assert_eq!(by(&[&swept]), None);
        // The run that built it is not in the history.
        assert_eq!(found(&[&audit, &swept], &plan), Some(("swept".to_owned(), false)));
        assert_eq!(found(&[&audit], &plan), None);
        // A stale stage is not built.
        let stale = [planned("b", "b1", Some(Staleness::ArtifactMissing))];
        assert_eq!(found(&[&first], &stale), None);
    }

    #[test]
    fn a_stage_has_the_cost_recorded_when_it_was_built() {
        let cost = |kind: &str, created: &str, seconds: f64| Cost {
            kind: kind.into(),
            recipe: 1,
            parameters: BTreeMap::new(),
            host: "here".into(),
            jobs: 2,
            steps: 1,
            weight: 1.0,
            chunks: 1,
            input_bytes: 0,
            unstable: 0,
            seconds,
            elapsed: Some(2.0 * seconds),
            bytes: 0,
            created: created.into(),
        };
        let costs = [
            cost("solve", "2026-01-01T00:00:09.900Z", 1.0),
            cost("train", "2026-01-01T00:00:10.100Z", 2.0),
            cost("solve", "2026-01-01T00:00:10.200Z", 3.0),
        ];
        let report = planned("a", "a1", None);
        let found = cost_of(&costs, &report, "2026-01-01T00:00:10.000Z").unwrap();
        assert_eq!((found.seconds, found.elapsed), (3.0, Some(6.0)));
        assert!(cost_of(&costs, &report, "2026-01-01T00:00:12.000Z").is_none());
    }

    #[test]
    fn times_are_converted_to_seconds() {
        let apart = |a: &str, b: &str| seconds(b).unwrap() - seconds(a).unwrap();
        for (a, b, expected) in [
            ("2026-02-28T23:59:59.500Z", "2026-03-01T00:00:00.250Z", 0.75),
            ("2028-02-28T00:00:00.000Z", "2028-03-01T00:00:00.000Z", 2.0 * 86_400.0),
            ("2026-12-31T00:00:00.000Z", "2027-01-01T01:00:01.000Z", 90_001.0),
        ] {
            assert!((apart(a, b) - expected).abs() < 1e-6, "{a} {b} {}", apart(a, b));
        }
        assert_eq!(seconds("yesterday"), None);
    }
}
