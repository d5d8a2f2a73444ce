//! Progress and checkpoints of a design search.

use std::cell::Cell;

use deaflow_base::{Stopped, four_digits};
use deaflow_design::{CheckpointError, FrontReport, GenerationReport, Observer, SearchProgress, SearchStep};
use deaflow_orchestrator::Job;

/// Reports the progress of a search and stores its checkpoints.
pub struct Follow<'a> {
    job: &'a Job<'a>,
    /// The unit in which values are shown, and the factor from that of the search.
    unit: &'static str,
    factor: f64,
    /// The share of a step for the first generation: it has no step of its own, and takes half of the step of the
    /// second one.
    first: f64,
    /// The start of the current generation within its step, and its share of the step.
    generation: Cell<(f64, f64)>,
    /// Steps of the current local search.
    steps: Cell<u32>,
    /// Total steps and number of the finished local searches.
    ended: Cell<(u32, u32)>,
}

/// Assumed steps of a local search before one has finished.
const USUAL_STEPS: f64 = 20.0;

impl<'a> Follow<'a> {
    /// An observer of the search of a job.
    pub fn new(job: &'a Job<'a>, generations: usize, (factor, unit): (f64, &'static str)) -> Self {
        let first = if generations == 0 { 1.0 } else { 0.5 };
        Self {
            job,
            unit,
            factor,
            first,
            generation: Cell::new((0.0, first)),
            steps: Cell::default(),
            ended: Cell::default(),
        }
    }

    /// Shows that a generation is finished.
    fn finished(&self, number: usize, note: &str) {
        self.job.progress.note(note);
        if number == 0 && self.first < 1.0 {
            self.generation.set((self.first, 1.0 - self.first));
            self.job.progress.part(self.first);
        } else {
            self.generation.set((0.0, 1.0));
            self.job.progress.advance(1);
        }
    }

    /// The estimated share of the current local search that is done, from the mean length of the finished ones.
    fn part(&self) -> f64 {
        let steps = f64::from(self.steps.get());
        let usual = match self.ended.get() {
            (_, 0) => USUAL_STEPS,
            (steps, searches) => f64::from(steps) / f64::from(searches),
        };
        steps / (steps + usual.max(1.0))
    }
}

/// The name of the checkpoint.
const CHECKPOINT: &str = "search";

impl Observer for Follow<'_> {
    fn generation(&self, report: &GenerationReport) {
        let (number, value, area) = (report.generation, report.value_mm, report.area);
        let note = format!(
            "generation {number}: best {} {} at area {:.1} %",
            four_digits(self.factor * value),
            self.unit,
            100.0 * area
        );
        self.finished(number, &note);
    }

    fn front(&self, report: &FrontReport) {
        let note = format!(
            "generation {}: front of {} designs, up to {} {}",
            report.generation,
            report.designs,
            four_digits(self.factor * report.best),
            self.unit
        );
        self.finished(report.generation, &note);
    }

    fn judged(&self, share: f64) {
        let (start, of_step) = self.generation.get();
        self.job.progress.part(start + of_step * share);
    }

    fn load_checkpoint(&self) -> Option<Vec<u8>> {
        self.job.scratch.load(CHECKPOINT)
    }

    fn save_checkpoint(&self, checkpoint: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        self.job.scratch.save(CHECKPOINT, checkpoint)
    }

    fn resumed(&self, generation: usize) {
        if generation == 0 {
            self.generation.set((self.first, 1.0 - self.first));
        } else {
            self.generation.set((0.0, 1.0));
        }
        let is_only_generation = generation == 0 && self.first >= 1.0;
        let steps = generation as u64 + u64::from(is_only_generation);
        self.job.progress.resume(steps);
    }

    fn checkpoint_rejected(&self, error: &CheckpointError) {
        self.job.scratch.report_unused(&error.to_string());
    }
}

impl SearchProgress for Follow<'_> {
    fn step(&self, step: &SearchStep) {
        let steps = self.steps.get() + 1;
        self.steps.set(steps);
        let note = format!(
            "gradient step {steps}: {} {} at area {:.1} %",
            four_digits(self.factor * step.value_mm),
            self.unit,
            100.0 * step.area
        );
        self.job.progress.note(&note);
        self.job.progress.part(self.part());
    }

    fn searched(&self) {
        let (steps, searches) = self.ended.get();
        self.ended.set((steps + self.steps.replace(0), searches + 1));
        self.job.progress.advance(1);
    }

    fn searched_before(&self, searches: usize) {
        self.job.progress.resume(searches as u64);
    }
}
