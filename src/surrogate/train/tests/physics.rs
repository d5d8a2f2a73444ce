//! Training of the network `physics`.

use super::*;
use crate::testing::response_at;
use crate::{Constants, NetworkKind, Surrogate};
use deaflow_fem::LinearResponse;
use deaflow_field::{CORNERS, Predictor};
use deaflow_scene::Scene;

/// Grids and half planes with the fields of four chord steps, which are within a thousandth of a millimetre of the
/// solution.
fn simulated(response: &LinearResponse, count: u64, split: Split) -> Vec<Example> {
    let mut data = examples(count, split);
    let patterns: Vec<Pattern> = data.iter().map(|example| example.pattern.clone()).collect();
    for (example, field) in data.iter_mut().zip(response.predict(&patterns, 4)) {
        example.label = Label::from_values(Raster::PAPER, field.unwrap().values()).unwrap();
    }
    data
}

fn options() -> TrainOptions {
    TrainOptions {
        epochs: 30,
        ..TrainOptions::of(NetworkKind::Physics)
    }
}

#[test]
fn a_few_examples_remove_most_of_the_error_of_the_linear_response() {
    let response = response_at(5250.0);
    let constants = Constants::new(&response, &Scene::vhb4910()).unwrap();
    let mut data = simulated(&response, 64, Split::Train);
    data.extend(simulated(&response, 16, Split::Validation));
    data.extend(simulated(&response, 16, Split::Test));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| train(&data, Some(&constants), &options(), &()).unwrap())
    };
    let trained = with(2);
    let test = of(&trained.metrics, Split::Test);
    // The untrained network is the linear response.
    let squares = data.iter().filter(|e| e.split == Split::Test).map(|example| {
        let linear = Label::from(
            &response.predict(std::slice::from_ref(&example.pattern), 0)[0]
                .clone()
                .unwrap(),
        );
        let (linear, simulated) = (linear.values(), example.label.values());
        let pairs = linear.iter().zip(simulated.iter());
        pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>()
    });
    let untrained = (squares.sum::<f64>() / (16 * 2 * CORNERS * CORNERS) as f64).sqrt();
    assert!(
        untrained > 0.02 && test.rmse_mm < 0.2 * untrained,
        "{} {untrained}",
        test.rmse_mm
    );
    assert!(test.r2 > 0.999, "{test:?}");
    assert!(with(1).weights == trained.weights);

    // The metrics are those of the written model.
    let surrogate = Surrogate::load(&trained.weights).unwrap();
    let tests: Vec<&Example> = data.iter().filter(|example| example.split == Split::Test).collect();
    let patterns: Vec<Pattern> = tests.iter().map(|example| example.pattern.clone()).collect();
    let predicted = surrogate.predict(&patterns).unwrap();
    let squares = tests.iter().zip(&predicted).map(|(example, field)| {
        let predicted = Label::from(field);
        let (predicted, simulated) = (predicted.values(), example.label.values());
        let pairs = predicted.iter().zip(simulated.iter());
        pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>()
    });
    let rmse = (squares.sum::<f64>() / (16 * 2 * CORNERS * CORNERS) as f64).sqrt();
    assert!((rmse / test.rmse_mm - 1.0).abs() < 1e-3, "{rmse} {}", test.rmse_mm);
}

#[test]
fn it_resumes_from_every_checkpoint_to_the_same_bits() {
    let response = response_at(5250.0);
    let constants = Constants::new(&response, &Scene::vhb4910()).unwrap();
    let data = simulated(&response, 12, Split::Train);
    let options = TrainOptions { epochs: 3, ..options() };
    let watch = Watch::default();
    let whole = train(&data, Some(&constants), &options, &watch).unwrap();
    for state in watch.states.take() {
        let watch = Watch {
            from: Some(state),
            ..Watch::default()
        };
        let resumed = train(&data, Some(&constants), &options, &watch).unwrap();
        assert_eq!((watch.resumed.take().len(), watch.refused.take()), (1, 0));
        assert!(resumed.weights == whole.weights);
    }
}

#[test]
fn it_needs_the_constants_of_the_scene() {
    let error = train(&examples(2, Split::Train), None, &options(), &()).err().unwrap();
    assert!(error.to_string().contains("linear response of the scene"), "{error}");
}
