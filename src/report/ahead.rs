//! Figures that are drawn while other stages are at work.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{Builder, JoinHandle};

use super::artifacts::{Made, RunArtifacts};
use super::kinds::PRESENTERS;
use super::results::{draw_of_stage, folder_of};
use deaflow_store::Store;

/// Draws the figures of stages as they end, so that only those of the last are waited for.
///
/// What cannot be drawn is passed over: [`RunResults::of`](super::RunResults::of) draws what is missing in the end, and says why it cannot.
pub struct FiguresAhead {
    stages: Option<Sender<(Made, bool)>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl FiguresAhead {
    /// For the stages of a pipeline, by its file and its name.
    ///
    /// # Errors
    /// When the system has no more threads to give.
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

    /// A stage has been built, or was found built: that alone has its figures already.
    pub fn tell(&self, made: Made, is_new: bool) {
        if let Some(stages) = &self.stages {
            // Nobody listens after a panic, which has been told of.
            let _ = stages.send((made, is_new));
        }
    }

    /// All stages have ended: waits for their figures.
    pub fn finish(mut self) {
        drop(self.stages.take());
        self.join();
    }

    fn join(&mut self) {
        if let Some(thread) = self.thread.take() {
            // One that has panicked has said so.
            let _ = thread.join();
        }
    }
}

impl Drop for FiguresAhead {
    /// What is not drawn yet is not waited for.
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        drop(self.stages.take());
        self.join();
    }
}

fn draw(store: &Store, file: &Path, pipeline: &str, ended: &Receiver<(Made, bool)>, over: &AtomicBool) {
    let folder = folder_of(store, file, pipeline);
    let mut made = Vec::new();
    for (stage, is_new) in ended {
        made.push(stage);
        let run = RunArtifacts {
            store,
            file,
            made: &made,
            rounds: &[],
        };
        if let Some(stage) = made.last().filter(|_| is_new && !over.load(Ordering::Relaxed)) {
            let _ = draw_of_stage(PRESENTERS, &run, stage, (pipeline, &folder));
        }
    }
}
