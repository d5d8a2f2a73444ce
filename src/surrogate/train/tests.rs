mod physics;
mod update;

use std::cell::RefCell;

use super::*;
use crate::testing::examples;
use crate::{Label, Metrics, OptimizerKind};
use deaflow_base::Stopped;
use deaflow_pattern::{Pattern, Raster};

fn run(examples: &[Example], options: &TrainOptions) -> Result<Trained, TrainError> {
    train(examples, None, options, &())
}

/// Records all calls and stores every checkpoint.
#[derive(Default)]
struct Watch {
    steps: RefCell<Vec<(u32, f64, f64)>>,
    reports: RefCell<Vec<EpochReport>>,
    states: RefCell<Vec<Vec<u8>>>,
    resumed: RefCell<Vec<u32>>,
    from: Option<Vec<u8>>,
    refused: RefCell<u32>,
}

impl Monitor for Watch {
    fn step(&self, epoch: u32, done: f64, loss: f64) {
        self.steps.borrow_mut().push((epoch, done, loss));
    }

    fn epoch(&self, report: &EpochReport) {
        self.reports.borrow_mut().push(report.clone());
    }

    fn resumed(&self, epochs: u32) {
        self.resumed.borrow_mut().push(epochs);
    }

    fn checkpoint(&self) -> Option<Vec<u8>> {
        self.from.clone()
    }

    fn store_checkpoint(&self, state: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        self.states.borrow_mut().push(state().unwrap());
        Ok(())
    }

    fn unusable_checkpoint(&self) {
        *self.refused.borrow_mut() += 1;
    }
}

fn of(metrics: &[Metrics], split: Split) -> &Metrics {
    metrics.iter().find(|m| m.split == split && m.family == "all").unwrap()
}

#[test]
fn a_short_training_explains_patterns_it_has_not_seen() {
    let data = [
        examples(96, Split::Train),
        examples(16, Split::Validation),
        examples(16, Split::Test),
    ]
    .concat();
    let options = TrainOptions {
        epochs: 6,
        ..TrainOptions::default()
    };
    let trained = run(&data, &options).unwrap();
    // Predicting zero everywhere has R² = 0.
    assert!(of(&trained.metrics, Split::Test).r2 > 0.85, "{:?}", trained.metrics);
    let curves = &trained.curves;
    assert!(curves.len() == 6 && curves[5].train_loss < 0.3 * curves[0].train_loss);
    // The kept epoch is the best one, and the metrics are its metrics.
    let best = &curves[trained.best_epoch as usize - 1];
    assert!(
        curves
            .iter()
            .all(|report| report.validation_rmse_mm >= best.validation_rmse_mm)
    );
    let validation = of(&trained.metrics, Split::Validation);
    assert!((validation.rmse_mm - best.validation_rmse_mm).abs() < 1e-12);
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let data = [examples(13, Split::Train), examples(5, Split::Validation)].concat();
    let options = TrainOptions {
        epochs: 2,
        ..TrainOptions::default()
    };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&data, &options).unwrap())
    };
    let one = with(1);
    for threads in [2, 5] {
        let many = with(threads);
        assert_eq!(one.weights, many.weights);
        assert_eq!(one.curves, many.curves);
        assert_eq!(one.metrics, many.metrics);
    }
    let other = TrainOptions {
        seed: 1,
        ..options.clone()
    };
    assert_ne!(one.weights, run(&data, &other).unwrap().weights);
}

#[test]
fn reports_every_epoch_in_order() {
    let seen = Watch::default();
    let options = TrainOptions {
        epochs: 3,
        batch: 2,
        ..TrainOptions::default()
    };
    let trained = train(&examples(4, Split::Train), None, &options, &seen).unwrap();
    assert_eq!(*seen.reports.borrow(), trained.curves);
    assert!(trained.curves.iter().map(|r| r.epoch).eq(1..=3));
    let steps: Vec<(u32, f64)> = seen
        .steps
        .borrow()
        .iter()
        .map(|(epoch, done, _)| (*epoch, *done))
        .collect();
    assert_eq!(steps, [(1, 0.5), (1, 1.0), (2, 0.5), (2, 1.0), (3, 0.5), (3, 1.0)]);
    assert_eq!(seen.steps.borrow()[5].2, trained.curves[2].train_loss);
}

#[test]
fn without_validation_the_last_epoch_is_kept_and_only_groups_with_examples_are_measured() {
    let options = TrainOptions {
        epochs: 2,
        ..TrainOptions::default()
    };
    let trained = run(&examples(4, Split::Train), &options).unwrap();
    assert_eq!(trained.best_epoch, 2);
    assert!(trained.metrics.iter().all(|m| m.split == Split::Train && m.samples > 0));
    let rmse = of(&trained.metrics, Split::Train).rmse_mm;
    assert!((trained.curves[1].validation_rmse_mm - rmse).abs() < 1e-12);
}

#[test]
fn fields_that_do_not_move_train_without_nan() {
    let mut data = examples(4, Split::Train);
    data.iter_mut()
        .for_each(|example| example.label = Label::zero(Raster::PAPER));
    let trained = run(
        &data,
        &TrainOptions {
            epochs: 1,
            ..TrainOptions::default()
        },
    )
    .unwrap();
    assert!(
        trained
            .metrics
            .iter()
            .all(|m| m.rmse_mm.is_finite() && m.r2.is_finite())
    );
}

#[test]
fn invalid_trainings_are_errors() {
    let options = TrainOptions::default();
    assert!(matches!(
        run(&examples(3, Split::Test), &options),
        Err(TrainError::NoExamples)
    ));
    let zero = TrainOptions {
        batch: 0,
        ..options.clone()
    };
    assert!(matches!(
        run(&examples(3, Split::Train), &zero),
        Err(TrainError::Option { name: "batch", .. })
    ));
}

#[test]
fn a_resumed_training_gives_the_same_bits() {
    let data = [examples(12, Split::Train), examples(4, Split::Validation)].concat();
    for optimizer in OptimizerKind::ALL {
        let options = TrainOptions {
            epochs: 4,
            batch: 4,
            optimizer,
            symmetry: SymmetryGroup::D4,
            gradient_norm: Some(0.5),
            ..TrainOptions::default()
        };
        let whole = Watch::default();
        let expected = train(&data, None, &options, &whole).unwrap();
        for (k, state) in whole.states.take().into_iter().enumerate() {
            let rest = Watch {
                from: Some(state),
                ..Watch::default()
            };
            let found = train(&data, None, &options, &rest).unwrap();
            assert_eq!(found.weights, expected.weights, "{optimizer:?} after epoch {}", k + 1);
            assert_eq!((&found.curves, &found.metrics), (&expected.curves, &expected.metrics));
            assert_eq!(found.best_epoch, expected.best_epoch);
            assert_eq!(
                (rest.resumed.take(), rest.reports.take().len()),
                (vec![k as u32 + 1], 3 - k)
            );
        }
    }
}

#[test]
fn checkpoints_of_other_trainings_are_not_used() {
    let data = examples(4, Split::Train);
    let options = TrainOptions {
        epochs: 1,
        ..TrainOptions::default()
    };
    let other = Watch::default();
    let other_options = TrainOptions {
        optimizer: OptimizerKind::AdamW,
        ..options.clone()
    };
    train(&data, None, &other_options, &other).unwrap();
    for state in [other.states.take().remove(0), b"a training".to_vec()] {
        let watch = Watch {
            from: Some(state),
            ..Watch::default()
        };
        let trained = train(&data, None, &options, &watch).unwrap();
        assert_eq!((watch.refused.take(), watch.resumed.take()), (1, vec![]));
        assert_eq!(trained.weights, run(&data, &options).unwrap().weights);
    }
}

#[test]
fn patience_ends_a_training_without_improvement() {
    let data = [examples(8, Split::Train), examples(4, Split::Validation)].concat();
    let options = TrainOptions {
        epochs: 40,
        patience: Some(2),
        learning_rate: 0.02,
        ..TrainOptions::default()
    };
    let trained = run(&data, &options).unwrap();
    let last = trained.curves.len() as u32;
    assert_eq!(trained.ending, Ending::Patience);
    assert!(
        last < 40 && last == trained.best_epoch + 2,
        "{last} {}",
        trained.best_epoch
    );
    // The learning rate does not depend on the last epoch: these are the first epochs of the whole training.
    let whole = TrainOptions {
        patience: None,
        epochs: 40,
        ..options
    };
    let whole = run(&data, &whole).unwrap();
    assert_eq!(whole.ending, Ending::Complete);
    assert_eq!(trained.curves[..], whole.curves[..last as usize]);
}

#[test]
fn a_loss_that_is_not_finite_stops_the_training() {
    let wild = TrainOptions {
        learning_rate: 1e30,
        ..TrainOptions::default()
    };
    assert!(matches!(
        run(&examples(9, Split::Train), &wild),
        Err(TrainError::Diverged { epoch: 1 })
    ));
}

#[test]
fn a_loss_that_explodes_stops_the_training_with_the_best_weights_so_far() {
    let data = [examples(16, Split::Train), examples(4, Split::Validation)].concat();
    // The learning rate rises over the first epochs: small in the first, too large in a later one.
    let options = TrainOptions {
        epochs: 3000,
        learning_rate: 10.0,
        ..TrainOptions::default()
    };
    let trained = run(&data, &options).unwrap();
    let Ending::Diverged(epoch) = trained.ending else {
        panic!("{:?}", trained.ending);
    };
    assert!(trained.best_epoch < epoch && trained.curves.len() as u32 == epoch - 1);
    let best = &trained.curves[trained.best_epoch as usize - 1];
    let kept = of(&trained.metrics, Split::Validation).rmse_mm;
    assert!((best.validation_rmse_mm - kept).abs() < 1e-12);
    assert!(trained.curves.iter().all(|report| report.train_loss.is_finite()));
    // When no epoch improved on the untrained network, training fails.
    let sudden = TrainOptions { epochs: 3, ..options };
    let error = run(&data, &sudden).unwrap_err();
    assert!(matches!(error, TrainError::Diverged { .. }), "{error}");
    assert!(error.to_string().contains("smaller learning rate"));
}

#[test]
fn each_epoch_draws_other_symmetries() {
    let data = [examples(64, Split::Train), examples(4, Split::Validation)].concat();
    let options = TrainOptions {
        symmetry: SymmetryGroup::D4,
        ..TrainOptions::default()
    };
    let trainer = Trainer::new(&data, None, &options).unwrap();
    let symmetries = |epoch| {
        let mut order = trainer.order(epoch);
        order.sort_by_key(|one| std::ptr::from_ref(one.example));
        order.iter().map(|one| one.symmetry).collect::<Vec<_>>()
    };
    assert_eq!(symmetries(1), symmetries(1));
    assert_ne!(symmetries(1), symmetries(2));
    assert!(Symmetry::ALL.iter().all(|g| symmetries(1).contains(g)));
    let plain = TrainOptions::default();
    let trainer = Trainer::new(&data, None, &plain).unwrap();
    assert!(trainer.order(1).iter().all(|one| one.symmetry == Symmetry::IDENTITY));
}

#[test]
fn one_example_a_batch_of_one_and_a_batch_beyond_the_examples_all_train() {
    for (count, batch) in [(1, 1), (1, 8), (5, 1), (5, 4096)] {
        let options = TrainOptions {
            epochs: 12,
            batch,
            ..TrainOptions::default()
        };
        let trained = run(&examples(count, Split::Train), &options).unwrap();
        let (first, last) = (&trained.curves[0], &trained.curves[11]);
        assert!(
            last.train_loss < first.train_loss,
            "{count} {batch}: {first:?} {last:?}"
        );
    }
}

#[test]
fn a_constant_label_is_learned() {
    let mut data = examples(8, Split::Train);
    let label = data[0].label.clone();
    data.iter_mut().for_each(|example| example.label = label.clone());
    let options = TrainOptions {
        epochs: 10,
        batch: 1,
        ..TrainOptions::default()
    };
    let trained = run(&data, &options).unwrap();
    assert!(of(&trained.metrics, Split::Train).r2 > 0.7, "{:?}", trained.metrics);
}

#[test]
fn empty_and_full_patterns_belong_to_a_training_set() {
    let still = |active: bool| Example {
        pattern: Pattern::from_fn(Raster::PAPER, |_, _| active),
        label: Label::zero(Raster::PAPER),
        family: "uniform".to_owned(),
        split: Split::Train,
        repeats: 1,
    };
    let data = [examples(14, Split::Train), vec![still(false), still(true)]].concat();
    let options = TrainOptions {
        epochs: 20,
        ..TrainOptions::default()
    };
    let trained = run(&data, &options).unwrap();
    let uniform = trained.metrics.iter().find(|m| m.family == "uniform").unwrap();
    let all = of(&trained.metrics, Split::Train);
    assert!(
        uniform.samples == 2 && uniform.rmse_mm < 0.5 && all.r2 > 0.5,
        "{uniform:?} {all:?}"
    );
}
