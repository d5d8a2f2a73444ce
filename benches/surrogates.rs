//! Predictions of the surrogates on one core beside the estimates that they have to beat.
//!
//! `cargo bench --bench surrogates`. The networks are built for the default scene and trained on a few fields only: how
//! long a prediction takes does not depend on the weights. Times are those that the thread was on a core, the best of
//! ten rounds of 1000 patterns; so other work on the machine disturbs them little. With names behind `--` only those
//! are measured.

mod bound;
#[allow(dead_code, reason = "trainings are in another benchmark")]
mod network_work;

use bound::Work;
use deaflow::base::{Stream, thread_seconds};
use deaflow::dataset::Split;
use deaflow::fem::LinearResponse;
use deaflow::field::{Mesh, Predictor};
use deaflow::pattern::{CELLS, Pattern, Raster};
use deaflow::scene::Scene;
use deaflow::surrogate::{Constants, Example, Label, NetworkKind, Surrogate, TrainOptions, train};

fn main() {
    let scene = Scene::vhb4910();
    let fine = LinearResponse::new(&scene, Mesh::biquadratic(1)).expect("the membrane is stable");
    let coarse = LinearResponse::new(&scene, Mesh::bilinear(1)).expect("the membrane is stable");
    let constants = Constants::new(&fine, &scene).expect("the membrane moves");
    let patterns: Vec<Pattern> = (0..1000).map(grid).collect();
    let examples = examples(&fine, &patterns[..16]);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.expect("a thread can be started");

    let names: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let wanted = |name: &str| names.is_empty() || names.iter().any(|other| other == name);
    let mut bounds = Vec::new();
    println!("method      ms per pattern   1000 patterns, s");
    for kind in NetworkKind::ALL.into_iter().filter(|kind| wanted(kind.name())) {
        let training = TrainOptions {
            network: kind,
            epochs: 1,
            ..TrainOptions::default()
        };
        let trained = train(&examples, Some(&constants), &training, &()).expect("it can be trained");
        let surrogate = Surrogate::load(&trained.weights).expect("it was just written");
        let seconds = pool.install(|| best(|| surrogate.predict(&patterns).expect("it predicts").len()));
        row(kind.name(), seconds);
        bounds.push(bound::row(
            &format!("prediction, {}", kind.name()),
            1e-3 * seconds,
            work(kind),
        ));
    }
    for (name, steps) in [("linear", 0), ("chord:1", 1), ("chord:2", 2)] {
        if !wanted(name) {
            continue;
        }
        row(name, pool.install(|| best(|| coarse.predict(&patterns, steps).len())));
    }
    bound::print(&bounds);
}

fn work(kind: NetworkKind) -> Work {
    match kind {
        NetworkKind::Qin2024 => network_work::predict_qin2024(),
        NetworkKind::Physics => network_work::predict_physics(),
    }
}

/// The least seconds of a thread over ten rounds.
fn best(work: impl Fn() -> usize + Sync) -> f64 {
    let round = |_| {
        let start = thread_seconds();
        assert_eq!(work(), 1000);
        thread_seconds() - start
    };
    (0..10).map(round).fold(f64::INFINITY, f64::min)
}

fn row(name: &str, seconds: f64) {
    println!("{name:<11} {seconds:>14.3}   {seconds:>16.3}");
}

/// Eight by eight units, half of them active.
fn grid(index: u64) -> Pattern {
    let on = Stream::new(1, "surrogate benchmark", index).choose(64, 32);
    Pattern::from_fn(Raster::PAPER, |x, y| on.contains(&(y * 8 / CELLS * 8 + x * 8 / CELLS)))
}

fn examples(response: &LinearResponse, patterns: &[Pattern]) -> Vec<Example> {
    let fields = response.predict(patterns, 1);
    let example = |(pattern, field): (&Pattern, Option<deaflow::field::Field>)| Example {
        pattern: pattern.clone(),
        label: Label::from(&field.expect("an estimate")),
        family: "grid".to_owned(),
        split: Split::Train,
        repeats: 1,
    };
    patterns.iter().zip(fields).map(example).collect()
}
