use super::*;
use crate::surrogate::testing::examples;

fn run(examples: &[Example], options: &TrainOptions) -> Result<Trained, TrainError> {
    train(examples, None, options, &|_| ())
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
    let seen = std::cell::RefCell::new(Vec::new());
    let options = TrainOptions {
        epochs: 3,
        ..TrainOptions::default()
    };
    let trained = train(&examples(4, Split::Train), None, &options, &|r| {
        seen.borrow_mut().push(r.clone())
    })
    .unwrap();
    assert_eq!(seen.into_inner(), trained.curves);
    assert!(trained.curves.iter().map(|r| r.epoch).eq(1..=3));
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
    data.iter_mut().for_each(|example| example.field = Field::zero());
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
fn what_cannot_be_trained_is_an_error() {
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
    let wild = TrainOptions {
        learning_rate: 1e30,
        ..options
    };
    assert!(matches!(
        run(&examples(9, Split::Train), &wild),
        Err(TrainError::Diverged { epoch: 1 })
    ));
}
