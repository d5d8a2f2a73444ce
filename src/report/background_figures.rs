//! Draws the figures of stages in the background while other stages run.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{Builder, JoinHandle};

use super::artifacts::{RunArtifacts, StageArtifact};
use super::kinds::PRESENTERS;
use super::results::{draw_of_stage, folder_of};
use deaflow_store::Store;

/// Draws the figures of each stage when it ends, so that a run waits only for those of its last stages.
///
/// Errors are ignored: [`RunResults::of`](super::RunResults::of) draws what is missing at the end, and reports why it
/// cannot.
pub struct BackgroundFigures {
    stages: Option<Sender<(StageArtifact, bool)>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl BackgroundFigures {
    /// Starts the thread for a pipeline, given its file and its name.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn start(store: Store, file: PathBuf, pipeline: String) -> io::Result<Self> {
        let (stages, ended) = channel();
        let is_over = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&is_over);
        let draw = move || draw(&store, &file, &pipeline, &ended, &over);
        Ok(Self {
            thread: Some(Builder::new().name("figures".to_owned()).spawn(draw)?),
            stages: Some(stages),
            is_over,
        })
    }

    /// Adds a stage that has been built, or, without drawing it, one that already existed.
    pub fn add(&self, made: StageArtifact, is_new: bool) {
        if let Some(stages) = &self.stages {
            // The thread may have panicked, which was reported.
            let _ = stages.send((made, is_new));
        }
    }

    /// Waits for the figures of all stages.
    pub fn finish(mut self) {
        drop(self.stages.take());
        self.join();
    }

    fn join(&mut self) {
        if let Some(thread) = self.thread.take() {
            // A panic was reported.
            let _ = thread.join();
        }
    }
}

impl Drop for BackgroundFigures {
    /// Figures that are not drawn yet are left out.
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        drop(self.stages.take());
        self.join();
    }
}

fn draw(store: &Store, file: &Path, pipeline: &str, ended: &Receiver<(StageArtifact, bool)>, over: &AtomicBool) {
    let folder = folder_of(store, file, pipeline);
    let mut made = Vec::new();
    for (stage, is_new) in ended {
        made.push(stage);
        let run = RunArtifacts {
            store,
            file,
            stages: &made,
            rounds: &[],
        };
        if let Some(stage) = made.last().filter(|_| is_new && !over.load(Ordering::Relaxed)) {
            let _ = draw_of_stage(PRESENTERS, &run, stage, (pipeline, &folder));
        }
    }
}
