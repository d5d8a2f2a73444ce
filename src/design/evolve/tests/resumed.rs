//! Resumed searches.

use super::*;
use crate::{Limits, Sides};
use deaflow_base::Stopped;
use deaflow_pattern::Membrane;

/// Stores every checkpoint, and resumes from one.
#[derive(Default)]
pub(super) struct CheckpointStore {
    from: Option<Vec<u8>>,
    pub(super) states: RefCell<Vec<Vec<u8>>>,
    resumed: RefCell<Vec<usize>>,
    heard: RefCell<Vec<usize>>,
    refused: RefCell<Vec<CheckpointError>>,
}

impl Observer for CheckpointStore {
    fn generation(&self, report: &GenerationReport) {
        self.heard.borrow_mut().push(report.generation);
    }

    fn load_checkpoint(&self) -> Option<Vec<u8>> {
        self.from.clone()
    }

    fn save_checkpoint(&self, checkpoint: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        self.states.borrow_mut().push(checkpoint().unwrap());
        Ok(())
    }

    fn resumed(&self, generation: usize) {
        self.resumed.borrow_mut().push(generation);
    }

    fn checkpoint_rejected(&self, error: &CheckpointError) {
        self.refused.borrow_mut().push(error.clone());
    }
}

impl CheckpointStore {
    pub(super) fn from(state: &[u8]) -> Self {
        Self {
            from: Some(state.to_vec()),
            ..Self::default()
        }
    }
}

struct NotTheRight;

impl Feasibility for NotTheRight {
    fn feasible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError> {
        Ok(patterns.iter().map(|pattern| !pattern.is_active(49, 25)).collect())
    }
}

fn options() -> EvolveOptions {
    EvolveOptions {
        generations: 12,
        designs: 3,
        distance: 0.08,
        ..small(5)
    }
}

/// A search with constraints, margins and several designs.
fn followed(options: &EvolveOptions, keeper: &CheckpointStore) -> (Evolution, usize) {
    let (linear, goal) = (Linear::new([30.0, 20.0]), goal(0.4));
    let limits = Limits {
        min_feature_mm: Some(3.0),
        islands: Some(2),
        leads: Some(Sides::ALL),
        ..Limits::default()
    };
    let problem = EvolveProblem {
        constraints: &Constraints::new(limits, Membrane::square(50.0)).unwrap(),
        feasibility: Some(&NotTheRight),
        ..free(&linear, &goal)
    };
    let found = evolve(&problem, options, keeper).unwrap();
    (found, linear.predicted.load(Ordering::Relaxed))
}

#[test]
fn a_resumed_search_gives_the_same_result() {
    let whole = CheckpointStore::default();
    let (expected, predictions) = followed(&options(), &whole);
    let states = whole.states.into_inner();
    assert_eq!(states.len(), 13);
    for from in [0, 1, 5, 11, 12] {
        let keeper = CheckpointStore::from(&states[from]);
        let (found, predicted) = followed(&options(), &keeper);
        assert_eq!(found, expected, "from generation {from}");
        assert_eq!(*keeper.resumed.borrow(), [from]);
        assert_eq!(*keeper.heard.borrow(), (from + 1..=12).collect::<Vec<_>>());
        assert_eq!(keeper.states.into_inner(), states[from + 1..]);
        assert!(predicted < predictions && (from < 12 || predicted == 0));
    }
    // A search can be resumed with more generations.
    let longer = EvolveOptions {
        generations: 14,
        ..options()
    };
    let expected = followed(&longer, &CheckpointStore::default()).0;
    assert_eq!(followed(&longer, &CheckpointStore::from(&states[12])).0, expected);
}

#[test]
fn invalid_checkpoints_are_rejected() {
    let whole = CheckpointStore::default();
    let short = EvolveOptions {
        generations: 2,
        population: 10,
        ..options()
    };
    let (expected, _) = followed(&short, &whole);
    let state = whole.states.into_inner().swap_remove(1);
    let refusal =
        |bytes: &[u8], options: &EvolveOptions| Checkpoint::from_bytes(bytes, options, 1).map(|_| ()).unwrap_err();
    for length in 0..state.len() {
        assert_eq!(
            refusal(&state[..length], &short),
            CheckpointError::Damaged,
            "{length} bytes"
        );
    }
    for at in (0..state.len()).step_by(7) {
        let mut damaged = state.clone();
        damaged[at] ^= 0x40;
        assert_eq!(refusal(&damaged, &short), CheckpointError::Damaged, "byte {at}");
    }
    let with_digest = |mut content: Vec<u8>| {
        let sum = deaflow_base::Digest::of(&content);
        content.extend(sum.as_bytes());
        content
    };
    let content = &state[..state.len() - 32];
    assert!(Checkpoint::from_bytes(&with_digest(content.to_vec()), &short, 1).is_ok());
    // Of another layout, with a header as long as memory, and with a row that is cut: each with a sum that is right.
    let mut layout = content.to_vec();
    layout[0] = 9;
    assert_eq!(
        refusal(&with_digest(layout), &short),
        CheckpointError::Version { found: 9, read: 2 }
    );
    let mut long = content.to_vec();
    long[4..12].copy_from_slice(&u64::MAX.to_le_bytes());
    assert_eq!(refusal(&with_digest(long), &short), CheckpointError::Damaged);
    assert_eq!(
        refusal(&with_digest(content[..content.len() - 1].to_vec()), &short),
        CheckpointError::Damaged
    );
    let row = content.len() - 75;
    assert_eq!(
        refusal(&with_digest(content[..row].to_vec()), &short),
        CheckpointError::Damaged
    );
    // Options that make another search, or a shorter one.
    for other in [
        EvolveOptions { seed: 6, ..short },
        EvolveOptions {
            population: 12,
            ..short
        },
        EvolveOptions { mutation: 0.4, ..short },
        EvolveOptions { designs: 2, ..short },
        EvolveOptions {
            generations: 0,
            ..short
        },
    ] {
        assert_eq!(refusal(&state, &other), CheckpointError::Options);
    }
    let keeper = CheckpointStore::from(&state[1..]);
    assert_eq!(followed(&short, &keeper).0, expected);
    assert_eq!(
        (keeper.refused.into_inner(), keeper.resumed.into_inner()),
        (vec![CheckpointError::Damaged], vec![])
    );
}

#[test]
fn a_search_does_not_depend_on_threads() {
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| followed(&options(), &CheckpointStore::default()).0)
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn a_finished_search_stays_finished() {
    let stagnant = EvolveOptions {
        stagnation: Some(1),
        generations: 500,
        population: 4,
        ..options()
    };
    let whole = CheckpointStore::default();
    let (expected, _) = followed(&stagnant, &whole);
    assert_eq!(expected.stop, Stop::Stagnation);
    let last = whole.states.into_inner().pop().unwrap();
    assert_eq!(followed(&stagnant, &CheckpointStore::from(&last)), (expected, 0));
}
