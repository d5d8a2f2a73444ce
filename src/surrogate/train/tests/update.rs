//! Updates of trained networks, and repeated examples.

use super::*;
use crate::NetworkKind;
use deaflow_field::CORNERS;

fn options(epochs: u32) -> TrainOptions {
    TrainOptions {
        epochs,
        ..TrainOptions::default()
    }
}

/// The same label, twice as large.
fn doubled(example: &Example) -> Example {
    let mut values = vec![0.0; 2 * CORNERS * CORNERS];
    let inner = CORNERS - 2;
    for (at, value) in example.label.values().iter().enumerate() {
        let (row, column) = (at / (2 * inner), at % (2 * inner));
        values[2 * ((row + 1) * CORNERS + 1) + column] = 2.0 * f64::from(*value);
    }
    Example {
        label: Label::from_values(Raster::PAPER, &values).unwrap(),
        ..example.clone()
    }
}

#[test]
fn an_update_starts_from_the_weights_and_the_unit_of_the_model() {
    let data = examples(16, Split::Train);
    let short = TrainOptions { batch: 2, ..options(3) };
    let first = run(&data, &short).unwrap();
    let error = of(&first.metrics, Split::Train).rmse_mm;
    // A training from scratch on labels of another size would have another unit.
    let mixed = [data.clone(), data.iter().map(doubled).collect()].concat();
    let still = TrainOptions {
        learning_rate: 1e-12,
        ..options(1)
    };
    let same = update(&first.weights, &mixed, None, &still, &()).unwrap();
    let rmse = |weights: &[u8], data: &[Example]| {
        let mut trainer = Trainer::new(data, None, &still).unwrap();
        let start = WarmStart::read(weights, &still, Corners::inner(Raster::PAPER)).unwrap();
        start.set(&trainer.vars).unwrap();
        trainer.scale_mm = start.scale_mm;
        let data: Vec<&Example> = data.iter().collect();
        rmse_mm(&trainer.problem().errors(&data).unwrap().sums)
    };
    assert!((rmse(&same.weights, &data) / error - 1.0).abs() < 1e-4);
    let updated = update(&first.weights, &data, None, &short, &()).unwrap();
    assert!(of(&updated.metrics, Split::Train).rmse_mm < 0.9 * error);
    let again = update(&first.weights, &data, None, &short, &()).unwrap();
    assert!(again.weights == updated.weights && updated.weights != first.weights);
}

#[test]
fn updates_of_other_networks_or_damaged_models_are_refused() {
    let data = examples(4, Split::Train);
    let trained = run(&data, &options(1)).unwrap();
    let refused =
        |bytes: &[u8], options: &TrainOptions| match WarmStart::read(bytes, options, Corners::inner(Raster::PAPER)) {
            Ok(_) => String::new(),
            Err(error) => error.to_string(),
        };
    let other = refused(&trained.weights, &TrainOptions::of(NetworkKind::Physics));
    assert_eq!(
        other,
        "cannot start training from the model: its network is qin2024, not physics"
    );
    let mut damaged = trained.weights.clone();
    *damaged.last_mut().unwrap() ^= 1;
    let same = options(1);
    assert!(refused(&damaged, &same).contains("damaged"));
    let groups = TrainOptions {
        loads: vec![1.0, 0.5],
        ..same
    };
    assert!(refused(&trained.weights, &groups).contains("its group loads are [1.0], not [1.0, 0.5]"));
}

#[test]
fn repeated_examples_take_all_symmetries_and_count_in_the_selection_error() {
    let mut data = [examples(3, Split::Train), examples(2, Split::Validation)].concat();
    data[1].repeats = 8;
    let turned = TrainOptions {
        symmetry: SymmetryGroup::D4,
        ..options(1)
    };
    for epoch in 1..4 {
        let trainer = Trainer::new(&data, None, &turned).unwrap();
        let order = trainer.order(epoch);
        let mut images: Vec<usize> = order
            .iter()
            .filter(|one| one.example.repeats == 8)
            .filter_map(|one| Symmetry::ALL.iter().position(|g| *g == one.symmetry))
            .collect();
        images.sort_unstable();
        assert_eq!((order.len(), images), (10, (0..8).collect()));
    }
    // Without augmentation the example is repeated unchanged.
    let upright = options(1);
    let trainer = Trainer::new(&data, None, &upright).unwrap();
    assert!(trainer.order(1).iter().all(|one| one.symmetry == Symmetry::IDENTITY));
    let errors = trainer.validation_errors().unwrap();
    let rmse = |data: &[&Example]| rmse_mm(&trainer.problem().errors(data).unwrap().sums);
    let (held_out, repeated) = (rmse(&[&data[3], &data[4]]), rmse(&[&data[1]]));
    let expected = ((2.0 * held_out.powi(2) + 8.0 * repeated.powi(2)) / 10.0).sqrt();
    assert!((errors.selection_rmse_mm / expected - 1.0).abs() < 1e-9);
    assert_eq!(errors.rmse_mm, held_out);
}

#[test]
fn repeated_examples_influence_the_choice_of_the_best_epoch() {
    // The validation examples do not move; the repeated ones do.
    let still = |example: &Example| Example {
        label: Label::zero(Raster::PAPER),
        split: Split::Validation,
        ..example.clone()
    };
    let mut data = examples(6, Split::Train);
    data.iter_mut().for_each(|example| example.repeats = 4);
    let held_out: Vec<Example> = examples(1, Split::Validation).iter().map(still).collect();
    let trained = run(&[data, held_out].concat(), &options(4)).unwrap();
    let curves = &trained.curves;
    let best = |of: fn(&EpochReport) -> f64| {
        let least = curves.iter().min_by(|a, b| of(a).total_cmp(&of(b))).unwrap();
        least.epoch
    };
    assert_eq!(trained.best_epoch, best(|e| e.selection_rmse_mm));
    assert_ne!(trained.best_epoch, best(|e| e.validation_rmse_mm));
}
