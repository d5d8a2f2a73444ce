//! Builds the stages of a run as soon as their needs exist, several in parallel.

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::{Sender, channel};
use std::thread::{Result as ThreadResult, Scope};

use super::event::{Event, Outcome, StageReport};
use super::execution::{EndedStages, Execution, Failure, Started};
use super::kind::StageError;
use super::stage_work::{FinishedWork, StageWork};
use super::time_shares::TimeShares;

/// Stack of the thread of a stage, bytes: as much as the main thread has.
const STACK: usize = 8 << 20;

/// The stages that have neither ended nor are running.
struct PendingStages {
    /// Those that may be started.
    open: BTreeSet<usize>,
    /// Those that other processes build. They are waited for when there is nothing else to do.
    busy: BTreeSet<usize>,
    /// Those that are left to other processes.
    others: BTreeSet<usize>,
    /// Whether there is nothing else to do.
    waits: bool,
}

impl PendingStages {
    fn contains(&self, index: usize) -> bool {
        let sets = [&self.open, &self.busy, &self.others];
        sets.iter().any(|stages| stages.contains(&index))
    }

    /// Updates the sets after a stage has ended. If it was built here, other processes have had time to build too.
    fn ended(&mut self, index: usize, report: &Result<StageReport, StageError>) {
        match report.as_ref().map(|report| report.outcome) {
            Ok(Outcome::Left) => {
                let stages = if self.waits { &mut self.others } else { &mut self.busy };
                stages.insert(index);
            }
            Ok(Outcome::Built) => {
                self.open.append(&mut self.busy);
                self.open.append(&mut self.others);
                self.waits = false;
            }
            _ => {}
        }
    }
}

impl<'a> Execution<'a> {
    /// Builds stages until one fails, or until everything that can be built exists. Returns reports and failures.
    pub fn run_stages(&mut self, selection: &[usize]) -> (Vec<StageReport>, Vec<Failure>) {
        let environment = self.builder.environment;
        let mut ended = EndedStages::default();
        let mut pending = PendingStages {
            open: selection.iter().copied().collect(),
            busy: BTreeSet::new(),
            others: BTreeSet::new(),
            waits: false,
        };
        let mut running = TimeShares::default();
        let (sender, receiver) = channel();
        std::thread::scope(|scope| {
            loop {
                while running.len() < self.parallel_stages && self.continues(&ended) {
                    let Some(index) = self.next_ready(&mut pending, &running) else {
                        break;
                    };
                    if let Some(skipped) = self.skip_if_missing(index, &ended.reports) {
                        ended.reports.insert(index, skipped);
                        continue;
                    }
                    let start = (environment.clock)();
                    let report = match self.start(index, start, pending.waits) {
                        Ok(Started::LeftToOthers) => {
                            pending.others.insert(index);
                            continue;
                        }
                        Ok(Started::Busy) => {
                            pending.busy.insert(index);
                            continue;
                        }
                        Ok(Started::Lost(lost)) => {
                            pending.open.extend(self.reset(lost, &mut ended));
                            pending.open.insert(index);
                            continue;
                        }
                        Ok(Started::Exists(report)) => Ok(*report),
                        Ok(Started::Work(work)) if self.parallel_stages == 1 => {
                            let done = work.run(self.builder, &self.pipeline.stages[index]);
                            self.finish(done, None)
                        }
                        Ok(Started::Work(work)) => {
                            running.begin(index, environment);
                            match self.spawn(scope, work, sender.clone()) {
                                Ok(()) => continue,
                                Err(error) => {
                                    running.end(index, environment);
                                    Err(error)
                                }
                            }
                        }
                        Err(error) => Err(error),
                    };
                    pending.ended(index, &report);
                    self.end(index, start, report, &mut ended);
                }
                if running.len() == 0 {
                    break;
                }
                // This thread holds a sender too, so the channel never closes.
                let Ok(done) = receiver.recv() else { break };
                let done: FinishedWork = done.unwrap_or_else(|panic| resume_unwind(panic));
                let (index, start) = (done.work.index, done.work.start);
                let share = running.end(index, environment);
                let report = self.finish(done, Some(share));
                pending.ended(index, &report);
                let has_failed = report
                    .as_ref()
                    .is_err_and(|error| !matches!(error, StageError::Stopped(_)));
                self.end(index, start, report, &mut ended);
                if has_failed && !self.builder.keep_going {
                    self.warn_of_running(index, &running);
                }
            }
        });
        let has_failed = ended.failures.values().any(|failure| !failure.is_stop());
        if self.ours.is_none() && self.builder.only.is_none() && has_failed {
            self.report_not_started(selection, &mut ended);
        }
        let EndedStages { reports, failures } = ended;
        (reports.into_values().collect(), failures.into_values().collect())
    }

    /// Takes the next stage whose needs have all ended. If there is none, takes one that another process is building.
    fn next_ready(&self, pending: &mut PendingStages, running: &TimeShares) -> Option<usize> {
        let stages = &self.pipeline.stages;
        loop {
            let is_unfinished = |index: &usize| pending.contains(*index) || running.contains(*index);
            let is_ready = |index: &&usize| !stages[**index].waits_for().iter().any(is_unfinished);
            if let Some(index) = pending.open.iter().find(is_ready).copied() {
                pending.open.remove(&index);
                return Some(index);
            }
            if pending.busy.is_empty() {
                return None;
            }
            pending.open.append(&mut pending.busy);
            pending.waits = true;
        }
    }

    /// Builds a stage in a thread, which sends the result.
    fn spawn<'scope>(
        &self,
        scope: &'scope Scope<'scope, '_>,
        work: Box<StageWork>,
        sender: Sender<ThreadResult<FinishedWork>>,
    ) -> Result<(), StageError>
    where
        'a: 'scope,
    {
        let (builder, spec) = (self.builder, &self.pipeline.stages[work.index]);
        let build = move || {
            // A panic is sent too: the receiver would wait for this thread forever.
            let done = catch_unwind(AssertUnwindSafe(|| work.run(builder, spec)));
            // The receiver is gone if another thread has panicked.
            let _ = sender.send(done);
        };
        let thread = std::thread::Builder::new().name(spec.name.clone()).stack_size(STACK);
        match thread.spawn_scoped(scope, build) {
            Ok(_) => Ok(()),
            Err(error) => Err(StageError::failed(format!("cannot start a thread: {error}"))),
        }
    }

    /// Whether more stages may be started.
    fn continues(&self, ended: &EndedStages) -> bool {
        !self.builder.is_stopped() && (ended.failures.is_empty() || self.builder.keep_going)
    }

    /// Warns that the stages that are running are still finished after another one has failed.
    fn warn_of_running(&self, failed: usize, running: &TimeShares) {
        let stages = &self.pipeline.stages;
        let names: Vec<String> = running
            .stages()
            .map(|index| format!("`{}`", stages[index].name))
            .collect();
        if names.is_empty() {
            return;
        }
        let failed = &stages[failed].name;
        let text = format!(
            "`{failed}` failed; the run ends after {} (Ctrl-C stops it now)",
            names.join(", ")
        );
        (self.builder.listener)(&Event::Warning { text });
    }
}
