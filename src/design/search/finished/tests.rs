use std::cell::{Cell, RefCell};

use super::*;
use crate::Constraints;
use crate::evolve::{GenerationReport, Observer};
use crate::objective::{Goal, Objective};
use crate::options::SearchOptions;
use crate::search::{Search, SearchResult};
use crate::target::{Area, Target};
use crate::tests::{Elements, TestDevice, node};
use deaflow_base::{Declared, Stopped};
use deaflow_field::InStates;
use deaflow_pattern::{Membrane, Raster};
use deaflow_scene::Scene;

/// Stops after a number of local searches, and keeps the last checkpoint.
#[derive(Default)]
struct Interrupted {
    from: Option<Vec<u8>>,
    last: RefCell<Option<Vec<u8>>>,
    /// The number of local searches after which it stops.
    after: Option<u64>,
    searches: Cell<u64>,
    before: Cell<usize>,
    steps: Cell<u64>,
    refused: Cell<bool>,
}

impl Observer for Interrupted {
    fn generation(&self, _: &GenerationReport) {}

    fn load_checkpoint(&self) -> Option<Vec<u8>> {
        self.from.clone()
    }

    fn save_checkpoint(&self, checkpoint: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        *self.last.borrow_mut() = checkpoint();
        if self.after == Some(self.searches.get()) {
            Err(Stopped)
        } else {
            Ok(())
        }
    }

    fn checkpoint_rejected(&self, _: &CheckpointError) {
        self.refused.set(true);
    }
}

impl SearchProgress for Interrupted {
    fn step(&self, _: &SearchStep) {
        self.steps.set(self.steps.get() + 1);
    }

    fn searched(&self) {
        self.searches.set(self.searches.get() + 1);
    }

    fn searched_before(&self, searches: usize) {
        self.before.set(searches);
    }
}

fn search(progress: &Interrupted) -> Result<SearchResult, SearchError> {
    let worth = |cell: usize| ((cell * 7919) % 101) as f64 * 1e-6 - 3e-5;
    let device = TestDevice {
        spread: (0..2500).map(|cell| ((cell * 104_729) % 89) as f64 * 1e-4).collect(),
        bend: -1e-4,
        ..TestDevice::linear((0..2500).map(worth).collect())
    };
    let objective = Objective::read(&node("{ point: [25 mm, 25 mm], direction: 0 deg }")).unwrap();
    let goal: Goal = objective.goal(&Scene::vhb4910(), None, 0.0).unwrap();
    let target = Target {
        name: "centre".to_owned(),
        objective,
        area: Area::Free,
        goal,
        masks: None,
    };
    let options = node("{ method: adjoint, starts: 3, designs: 2, distance: 0.05, units: 20, seed: 1 }");
    let search = Search {
        target: &target,
        constraints: &Constraints::none(Membrane::square(50.0)),
        options: &SearchOptions::read_with(&options, &[]).unwrap(),
        drivers: &[1],
        elements: &Elements(InStates::one(&device)),
        progress,
    };
    search.along_gradient()
}

#[test]
fn a_resumed_search_repeats_no_finished_local_search_and_ends_the_same() {
    let whole = Interrupted::default();
    let expected = search(&whole).unwrap();
    // Three starts and their refinement, for each of two designs.
    assert_eq!((whole.searches.get(), whole.before.get()), (8, 0));
    for after in [1, 3, 6] {
        let stopped = Interrupted {
            after: Some(after),
            ..Interrupted::default()
        };
        assert!(matches!(search(&stopped), Err(SearchError::Stopped(_))), "{after}");
        let kept = if after < 4 { after } else { after - 1 };
        let resumed = Interrupted {
            from: stopped.last.take(),
            ..Interrupted::default()
        };
        let found = search(&resumed).unwrap();
        assert_eq!(resumed.before.get() as u64, kept, "{after}");
        assert_eq!(resumed.searches.get(), 8 - kept, "{after}");
        assert!(resumed.steps.get() < whole.steps.get(), "{after}");
        for (one, other) in expected.designs.iter().zip(&found.designs) {
            assert!(one.pattern == other.pattern, "{after}: {:?} {}", one.role, one.member);
            assert_eq!(one.value_mm.to_bits(), other.value_mm.to_bits());
        }
        assert_eq!(found.designs.len(), expected.designs.len());
        for (one, other) in expected.refinements.iter().zip(&found.refinements) {
            assert_eq!(one.steps, other.steps, "{after}");
        }
    }
}

#[test]
fn a_checkpoint_that_cannot_be_read_is_refused_and_the_search_starts_anew() {
    let sound = Interrupted {
        after: Some(2),
        ..Interrupted::default()
    };
    assert!(search(&sound).is_err());
    let bytes = sound.last.take().unwrap();
    let form = PatternForm::of_square_cells(Raster::PAPER, 1);
    assert_eq!(from_bytes(&bytes, form).unwrap().len(), 2);
    let smaller = PatternForm::of_square_cells(Raster::new(20, 20).unwrap(), 1);
    assert_eq!(from_bytes(&bytes, smaller).unwrap_err(), CheckpointError::Damaged);
    let cut = Interrupted {
        from: Some(bytes[..bytes.len() - 9].to_vec()),
        ..Interrupted::default()
    };
    assert!(search(&cut).is_ok());
    assert!(cut.refused.get());
    assert_eq!((cut.before.get(), cut.searches.get()), (0, 8));
}
