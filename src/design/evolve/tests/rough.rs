//! Searches that judge only the best of a generation by a rough score.

use super::resumed::CheckpointStore;
use super::*;
use crate::RoughScore;

/// A linear device that softens with displacement; one cell increases the displacement by 2 %.
struct Softening(Linear);

impl Predictor<StateFields> for Softening {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        let fields = self.0.predict(patterns)?.into_iter().zip(patterns);
        let answer = |(field, pattern): (StateFields, &Pattern)| {
            let [x, _] = field[0].at([25.0, 25.0]);
            let more = if pattern.is_active(10, 30) { 1.02 } else { 1.0 };
            Some(vec![field[0].scaled(more * (1.0 - 0.05 * x))])
        };
        Ok(fields.map(answer).collect())
    }
}

fn judging(share: f64, seed: u64) -> EvolveOptions {
    EvolveOptions {
        population: 200,
        generations: 40,
        judged: share,
        ..small(seed)
    }
}

fn searched(predictor: &dyn Predictor<StateFields>, options: &EvolveOptions, watch: &dyn Observer) -> Evolution {
    let (goal, linear) = (goal(0.5), Linear::new([25.0, 25.0]));
    let rough = RoughScore::new(&goal, &InStates::one(&linear.device), 1).unwrap();
    let problem = EvolveProblem {
        rough: rough.as_ref(),
        ..free(predictor, &goal)
    };
    evolve(&problem, options, watch).unwrap()
}

#[test]
fn judging_a_quarter_finds_as_much() {
    let (mut all, mut few, mut share) = (0.0, 0.0, 0.0);
    for seed in 1..=5 {
        let softening = Softening(Linear::new([25.0, 25.0]));
        let silent = |_: &GenerationReport| ();
        let everything = searched(&softening, &judging(1.0, seed), &silent);
        let all_judged = softening.0.predicted.swap(0, Ordering::Relaxed);
        assert_eq!(
            everything,
            evolved(&softening, &goal(0.5), &judging(1.0, seed)).unwrap()
        );
        softening.0.predicted.store(0, Ordering::Relaxed);
        let best = searched(&softening, &judging(0.25, seed), &silent);
        assert_eq!(softening.0.predicted.load(Ordering::Relaxed), best.evaluations);
        all += everything.winners[0].value_mm / 5.0;
        few += best.winners[0].value_mm / 5.0;
        share += best.evaluations as f64 / all_judged as f64 / 5.0;
        let judged = softening.predict(&[best.best_pattern()]).unwrap();
        assert_eq!(goal(0.5).value_mm(&judged[0]), best.winners[0].value_mm);
    }
    assert!(few > 0.995 * all, "{few} and {all} mm");
    assert!((0.1..0.3).contains(&share), "{share} of the judgements");
}

#[test]
fn patterns_without_a_field_do_not_win() {
    let partial = Partial(Linear::new([25.0, 25.0]));
    let found = searched(&partial, &judging(0.1, 1), &|_: &GenerationReport| ());
    assert!(found.history.iter().all(|report| report.best.is_finite()));
    assert!(partial.predict_some(&[found.best_pattern()]).unwrap()[0].is_some());
}

#[test]
fn small_populations_are_all_judged() {
    let softening = Softening(Linear::new([25.0, 25.0]));
    let few = |share| EvolveOptions {
        population: 50,
        ..judging(share, 3)
    };
    let silent = |_: &GenerationReport| ();
    assert_eq!(
        searched(&softening, &few(0.0), &silent),
        searched(&softening, &few(1.0), &silent)
    );
}

#[test]
fn a_resumed_search_with_a_rough_score_gives_the_same_result() {
    let softening = Softening(Linear::new([25.0, 25.0]));
    let options = EvolveOptions {
        generations: 8,
        ..judging(0.25, 2)
    };
    let keeper = CheckpointStore::default();
    let whole = searched(&softening, &options, &keeper);
    for state in keeper.states.take() {
        assert_eq!(searched(&softening, &options, &CheckpointStore::from(&state)), whole);
    }
}
