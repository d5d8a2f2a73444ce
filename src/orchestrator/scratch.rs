//! Where a piece of work keeps what it has come to, so that the next run goes on with it where this one is killed.
//!
//! It is a convenience: what cannot be kept or read costs time and nothing else, so it is told and never stops the work.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use deaflow_base::{ActionKey, Stopped};
use deaflow_store::{CheckpointProgress, Store, StoreError};

/// Keeping may take this part of the time at most.
const SHARE: u32 = 20;

/// The scratch of one action.
pub struct Scratch<'a> {
    store: &'a Store,
    key: ActionKey,
    build: String,
    of: (&'a str, &'static str),
    steps: &'a AtomicU64,
    warn: &'a (dyn Fn(String) + Sync),
    stop: Option<&'a AtomicBool>,
    kept: Mutex<Kept>,
}

/// When something was last kept, and what that took.
#[derive(Clone, Copy)]
enum Kept {
    NotYet,
    At(Instant, Duration),
    /// It was refused: it is not tried again.
    Refused,
}

impl<'a> Scratch<'a> {
    /// The scratch of an action; `build` says which program can go on from what is kept. `of`: its stage and what the steps of that
    /// are, of which `steps` are done.
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
            kept: Mutex::new(Kept::NotYet),
        }
    }

    /// What an earlier run kept under a name. What is damaged, or was written by another build, is told and not used.
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

    /// Keeps what the work has come to under a name, in place of what was kept before, unless something was kept so lately that
    /// keeping would take more than a twentieth of the time. `content` makes it when it is to be kept.
    ///
    /// # Errors
    /// When the work is to stop.
    pub fn save(&self, name: &str, content: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        let stops = self.stop.is_some_and(|stop| stop.load(Ordering::Relaxed));
        self.save_when_due(name, content, stops);
        if stops { Err(Stopped) } else { Ok(()) }
    }

    fn save_when_due(&self, name: &str, content: &dyn Fn() -> Option<Vec<u8>>, stops: bool) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let due = match *kept {
            Kept::NotYet => true,
            Kept::At(when, took) => stops || when.elapsed() >= took * (SHARE - 1),
            Kept::Refused => false,
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
        *kept = match put {
            Ok(()) => Kept::At(Instant::now(), start.elapsed()),
            Err(error) => {
                (self.warn)(format!("if this run is killed it will begin again: {error}"));
                Kept::Refused
            }
        };
    }

    /// Tells that what an earlier run kept is not used.
    pub fn report_unused(&self, reason: &str) {
        (self.warn)(format!("what an earlier run had come to is not used: {reason}"));
    }

    /// Removes all that was kept: the work is recorded.
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
        assert!(told.len() == 1 && told[0].contains("will begin again"), "{told:?}");
    }
}
