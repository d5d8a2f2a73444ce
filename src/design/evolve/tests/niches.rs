//! Searches for several designs.

use super::*;
use deaflow_pattern::distance;

fn several(designs: usize, distance: f64, options: &EvolveOptions) -> EvolveOptions {
    EvolveOptions {
        designs,
        distance,
        ..*options
    }
}

#[test]
fn several_designs_have_the_minimum_distance() {
    let found = run(&several(5, 0.1, &small(2)), 0.5);
    assert_eq!(found.winners.len(), 5);
    let patterns: Vec<&Pattern> = found.winners.iter().map(|winner| &winner.pattern).collect();
    for (k, one) in patterns.iter().enumerate() {
        assert!(patterns[..k].iter().all(|other| distance(one, other) >= 0.1));
    }
    assert!(found.winners.windows(2).all(|pair| pair[0].fitness <= pair[1].fitness));
    let last = found.history.last().unwrap();
    assert_eq!(
        (&found.winners[0].genome, found.winners[0].fitness),
        (&last.genome, last.best)
    );
    // All designs are close to the result of a search for one design.
    let alone = run(&small(2), 0.5).winners[0].value_mm;
    let worst = found.winners[4].value_mm;
    assert!(worst > 0.85 * alone, "{worst} mm instead of {alone} mm");
}

#[test]
fn there_may_be_fewer_designs_than_requested() {
    // No two patterns of half area differ in 90 % of their cells over all symmetries.
    let found = run(&several(3, 0.9, &small(2)), 0.5);
    assert_eq!(found.winners.len(), 1);
    // All individuals are the same at area 0 and 1, and there are more of them than the search has generations.
    for area in [0.0, 1.0] {
        let same = EvolveOptions {
            population: 1000,
            generations: 2,
            ..several(8, 0.05, &small(1))
        };
        let found = run(&same, area);
        assert_eq!((found.winners.len(), found.winners[0].area), (1, area));
    }
}

#[test]
fn two_individuals_can_be_searched_for_many_designs() {
    let two = EvolveOptions {
        population: 2,
        ..several(8, 0.05, &small(1))
    };
    let found = run(&two, 0.5);
    assert!((2..=8).contains(&found.winners.len()) && found.history.len() == 21);
}
