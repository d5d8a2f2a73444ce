//! What a run leaves behind besides artifacts: its entry in the history, the costs of its stages, and its lock file.

use std::collections::BTreeMap;

use super::cost_estimate;
use super::event::{Event, StageReport};
use super::execution::{Execution, Failure};
use super::kind::StageError;
use super::planner::StageStatus;
use super::spec::StageSpec;
use deaflow_store::{LockFile, LockedStage, Run, RunStage, StoreError};

impl Execution<'_> {
    /// Returns the names of the stages that do not exist and have not failed.
    pub fn not_started(&self, selection: &[usize], failures: &[Failure]) -> Vec<String> {
        let missing = selection.iter().filter(|index| !self.completed.contains_key(index));
        let names = missing.map(|&index| &self.pipeline.stages[index].name);
        let has_failed = |name: &String| failures.iter().any(|failure| failure.stage == *name);
        names.filter(|name| !has_failed(name)).cloned().collect()
    }

    /// Writes the run into the history, unless the last run was the same.
    ///
    /// # Errors
    /// If the store reports an error.
    pub fn write_history(&self, run: Run) -> Result<(), StoreError> {
        let environment = self.builder.environment;
        let file = self.pipeline.file();
        let run = Run {
            pipeline: self.pipeline.name.clone(),
            path: file.display().to_string(),
            place: self.builder.store.relative_path_to(&file),
            created: environment.now(),
            host: environment.host.clone(),
            version: format!("{} (build {})", environment.version, environment.build),
            overrides: self.pipeline.overrides.clone(),
            stages: self.completed.values().cloned().collect(),
            ..run
        };
        if !self.builder.store.is_new_run(&run)? {
            return Ok(());
        }
        let mut results = BTreeMap::new();
        for stage in &run.stages {
            results.extend(self.results(stage)?);
        }
        self.builder.store.put_run(&Run { results, ..run })
    }

    /// Returns the results of a stage: those in the history if the last run had the same artifact, otherwise those in
    /// the artifact. If that is damaged, the next run finds out; this run is written without them.
    fn results(&self, stage: &RunStage) -> Result<Vec<(String, f64)>, StoreError> {
        let Some(spec) = self.pipeline.stage(&stage.name) else {
            return Ok(Vec::new());
        };
        let prefix = format!("{}.", stage.name);
        let last = self.planner.last_run_of(spec)?;
        if let Some((run, _)) = last.filter(|(_, then)| then.artifact == stage.artifact) {
            let own = run.results.range(prefix.clone()..);
            let own = own.take_while(|(name, _)| name.starts_with(&prefix));
            let own: Vec<(String, f64)> = own.map(|(name, value)| (name.clone(), *value)).collect();
            if !own.is_empty() {
                return Ok(own);
            }
        }
        // An artifact that no stage needed is not downloaded only for this.
        if self.builder.store.has_upstream() && !self.builder.store.has(&stage.artifact) {
            return Ok(Vec::new());
        }
        let artifact = self.builder.store.artifact(&stage.artifact).map_err(StageError::from);
        match artifact.and_then(|artifact| spec.kind.results(&artifact)) {
            Ok(results) => {
                // The mean of nothing is NaN.
                let finite = results.into_iter().filter(|(_, value)| value.is_finite());
                Ok(finite.map(|(name, value)| (prefix.clone() + &name, value)).collect())
            }
            Err(error) => {
                let text = format!("cannot write the results of `{}` into the history: {error}", stage.name);
                (self.builder.listener)(&Event::Warning { text });
                Ok(Vec::new())
            }
        }
    }

    /// Writes the cost of a stage. An error does not stop the run; it is reported at the end.
    pub fn write_cost(&mut self, spec: &StageSpec, status: &StageStatus, report: &StageReport, unstable: u64) {
        let input_bytes: Option<u64> = spec.needs.iter().map(|need| self.sizes.get(need)).sum();
        let Some(input_bytes) = input_bytes else { return };
        let environment = self.builder.environment;
        let cost = cost_estimate::cost(spec, status, report, unstable, input_bytes, environment);
        if let Some(Err(error)) = cost.map(|cost| self.builder.store.put_cost(&cost)) {
            self.history_error.get_or_insert(error);
        }
    }

    /// Returns the lock file of the stages that exist.
    pub fn lock_file(&self) -> LockFile {
        let stages = self.completed.values().map(|stage| {
            let locked = LockedStage {
                key: stage.key,
                artifact: stage.artifact,
            };
            (stage.name.clone(), locked)
        });
        LockFile {
            pipeline: self.pipeline.name.clone(),
            target: self.builder.environment.target.clone(),
            stages: stages.collect(),
        }
    }
}
