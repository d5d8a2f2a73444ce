//! Saves checkpoints of a piece of work, so that the next run can resume it.
//!
//! A checkpoint that cannot be written or read only costs time, so it leads to a warning and never stops the work.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use deaflow_base::{ActionKey, Stopped};
use deaflow_store::{CheckpointProgress, Store, StoreError};

/// Saving may take at most one part in this number of the time.
const SAVE_TIME_DIVISOR: u32 = 20;

/// The checkpoints of one action.
pub struct Scratch<'a> {
    store: &'a Store,
    key: ActionKey,
    build: String,
    of: (&'a str, &'static str),
    steps: &'a AtomicU64,
    warn: &'a (dyn Fn(String) + Sync),
    stop: Option<&'a AtomicBool>,
    last_save: Mutex<LastSave>,
}

/// When a checkpoint was last saved, and how long that took.
#[derive(Clone, Copy)]
enum LastSave {
    Never,
    At(Instant, Duration),
    /// Saving failed and is not tried again.
    Failed,
}

impl<'a> Scratch<'a> {
    /// Creates the scratch of an action. `build` identifies the builds that can resume it; `of` is the stage and the
    /// unit of its steps, of which `steps` are done.
    pub(super) fn new(
        store: &'a Store,
        (key, build): (ActionKey, String),
        of: (&'a str, &'static str),
        steps: &'a AtomicU64,
        warn: &'a (dyn Fn(String) + Sync),
        stop: Option<&'a AtomicBool>,
    ) -> Self {
        Self {
            store,
            key,
            build,
            of,
            steps,
            warn,
            stop,
            last_save: Mutex::new(LastSave::Never),
        }
    }

    /// Loads the checkpoint of an earlier run. If it is damaged or was written by another build, it leads to a warning.
    #[must_use]
    pub fn load(&self, name: &str) -> Option<Vec<u8>> {
        match self.store.checkpoint(&self.key, name, &self.build) {
            Ok(content) => content,
            Err(StoreError::Damaged { path, reason }) => {
                self.report_unused(&format!("{}: {reason}", path.display()));
                None
            }
            Err(error) => {
                self.report_unused(&error.to_string());
                None
            }
        }
    }

    /// Saves a checkpoint, replacing the previous one, unless saving would take more than a twentieth of the time.
    /// `content` is called if it is saved.
    ///
    /// # Errors
    /// If the work has to stop.
    pub fn save(&self, name: &str, content: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        let stopped = self.check_stopped();
        self.save_when_due(name, content, stopped.is_err());
        stopped
    }

    /// Fails if the work has to stop.
    ///
    /// # Errors
    /// If it has.
    pub fn check_stopped(&self) -> Result<(), Stopped> {
        match self.stop.is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            true => Err(Stopped),
            false => Ok(()),
        }
    }

    fn save_when_due(&self, name: &str, content: &dyn Fn() -> Option<Vec<u8>>, stops: bool) {
        let mut last_save = self.last_save.lock().unwrap_or_else(PoisonError::into_inner);
        let due = match *last_save {
            LastSave::Never => true,
            LastSave::At(when, took) => stops || when.elapsed() >= took * (SAVE_TIME_DIVISOR - 1),
            LastSave::Failed => false,
        };
        if !due {
            return;
        }
        let start = Instant::now();
        let Some(content) = content() else { return };
        let reached = CheckpointProgress {
            stage: self.of.0.to_owned(),
            steps: self.steps.load(Ordering::Relaxed),
            unit: self.of.1.to_owned(),
        };
        let put = self
            .store
            .put_checkpoint(&self.key, name, &self.build, &reached, &content);
        *last_save = match put {
            Ok(()) => LastSave::At(Instant::now(), start.elapsed()),
            Err(error) => {
                (self.warn)(format!(
                    "cannot save a checkpoint, so this run cannot be resumed: {error}"
                ));
                LastSave::Failed
            }
        };
    }

    /// Warns that the checkpoint of an earlier run is not used.
    pub fn report_unused(&self, reason: &str) {
        (self.warn)(format!(
            "the checkpoint of an earlier run cannot be used, starting anew: {reason}"
        ));
    }

    /// Removes all checkpoints after the work has been recorded.
    pub(super) fn clear(&self) {
        if let Err(error) = self.store.remove_checkpoints(&self.key) {
            (self.warn)(error.to_string());
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    static STEPS: AtomicU64 = AtomicU64::new(3);

    fn of_build(build: &str) -> (ActionKey, String) {
        (ActionKey::of(b"key"), build.to_owned())
    }

    const OF: (&str, &str) = ("surrogate", "epochs");

    #[test]
    fn what_is_kept_is_found_by_the_next_run_of_the_same_build_only() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let warnings = Mutex::new(Vec::new());
        let warn = |text: String| warnings.lock().unwrap().push(text);
        let scratch = |build: &str| Scratch::new(&store, of_build(build), OF, &STEPS, &warn, None);
        assert_eq!(scratch("one").load("state"), None);
        let first = scratch("one");
        first.save("state", &|| Some(b"content".to_vec())).unwrap();
        assert_eq!(scratch("one").load("state").as_deref(), Some(&b"content"[..]));
        let reached = store.checkpoint_progress(&ActionKey::of(b"key"), "one").unwrap();
        assert_eq!((reached.stage.as_str(), reached.steps), ("surrogate", 3));
        assert!(warnings.lock().unwrap().is_empty());
        assert_eq!(scratch("two").load("state"), None);
        assert!(warnings.lock().unwrap()[0].contains("another build"), "{warnings:?}");
        scratch("one").clear();
        assert_eq!(scratch("one").load("state"), None);
    }

    #[test]
    fn keeping_takes_a_small_part_of_the_time() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let warn = |text: String| panic!("{text}");
        let scratch = Scratch::new(&store, of_build("build"), OF, &STEPS, &warn, None);
        let made = Mutex::new(0);
        let keep = || {
            scratch.save("state", &|| {
                *made.lock().unwrap() += 1;
                std::thread::sleep(Duration::from_millis(20));
                Some(vec![1])
            })
        };
        // The first is kept, those right after it are not: 19 times its 20 ms have not gone by.
        (0..5).for_each(|_| keep().unwrap());
        assert_eq!(*made.lock().unwrap(), 1);
    }

    #[test]
    fn work_that_is_asked_to_stop_keeps_what_it_has_come_to() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let warn = |text: String| panic!("{text}");
        let stop = AtomicBool::new(false);
        let scratch = Scratch::new(&store, of_build("build"), OF, &STEPS, &warn, Some(&stop));
        let keep = |content: u8| {
            scratch.save("state", &|| {
                std::thread::sleep(Duration::from_millis(20));
                Some(vec![content])
            })
        };
        assert_eq!((keep(1), keep(2)), (Ok(()), Ok(())));
        assert_eq!(scratch.load("state"), Some(vec![1]), "the second came too soon");
        stop.store(true, Ordering::Relaxed);
        assert_eq!((keep(3), scratch.load("state")), (Err(Stopped), Some(vec![3])));
    }

    #[test]
    fn what_cannot_be_kept_is_told_once_and_stops_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        std::fs::write(folder.path().join("checkpoints"), "in the way").unwrap();
        let warnings = Mutex::new(Vec::new());
        let warn = |text: String| warnings.lock().unwrap().push(text);
        let scratch = Scratch::new(&store, of_build("build"), OF, &STEPS, &warn, None);
        for _ in 0..2 {
            scratch.save("state", &|| Some(vec![1])).unwrap();
        }
        let told = warnings.lock().unwrap().clone();
        assert!(told.len() == 1 && told[0].contains("cannot be resumed"), "{told:?}");
    }
}
