//! Reports the progress of a training to its run, and stores its checkpoints.

use std::cell::Cell;

use deaflow_base::Stopped;
use deaflow_orchestrator::Job;
use deaflow_surrogate::{EpochReport, Monitor};

/// Progress notes per epoch.
const NOTES: f64 = 10.0;

/// The name of the checkpoint.
const STATE: &str = "training";

/// Reports the progress of a training to the job that runs it.
pub struct Follow<'a, 'j> {
    job: &'a Job<'j>,
    /// The tenth of the epoch that was last reported. The first step is reported too: it shows that the examples have
    /// been read.
    reported: Cell<Option<u32>>,
    rmse_mm: Cell<Option<f64>>,
}

impl<'a, 'j> Follow<'a, 'j> {
    /// Starts with nothing reported.
    pub fn new(job: &'a Job<'j>) -> Self {
        Self {
            job,
            reported: Cell::new(None),
            rmse_mm: Cell::new(None),
        }
    }
}

impl Monitor for Follow<'_, '_> {
    fn step(&self, epoch: u32, done: f64, loss: f64) {
        let tenth = (NOTES * done) as u32;
        if Some(tenth) == self.reported.replace(Some(tenth)) {
            return;
        }
        self.job.progress.part(done);
        let mut note = format!("epoch {epoch} {:.0} %, loss {loss:.2e}", 100.0 * done);
        if let Some(rmse_mm) = self.rmse_mm.get() {
            note += &format!(", validation RMSE {rmse_mm:.4} mm");
        }
        self.job.progress.note(&note);
    }

    fn epoch(&self, report: &EpochReport) {
        self.rmse_mm.set(Some(report.validation_rmse_mm));
        self.job.progress.note(&format!(
            "loss {:.2e}, validation RMSE {:.4} mm",
            report.train_loss, report.validation_rmse_mm
        ));
        self.job.progress.advance(1);
    }

    fn resumed(&self, epochs: u32) {
        self.job.progress.resume(u64::from(epochs));
        self.job
            .progress
            .note(&format!("resumes after epoch {epochs} of an earlier run"));
    }

    fn checkpoint(&self) -> Option<Vec<u8>> {
        self.job.scratch.load(STATE)
    }

    fn store_checkpoint(&self, state: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        self.job.scratch.save(STATE, state)
    }

    fn unusable_checkpoint(&self) {
        self.job
            .scratch
            .report_unused("it is not a checkpoint of this training");
    }
}
