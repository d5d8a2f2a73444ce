//! Equilibria computed from a nearby one.

use super::scenes::{gent, scene};
use super::*;
use crate::GradientEvaluator;
use deaflow_field::{Differentiable, Predictor};
use deaflow_pattern::Raster;
use deaflow_scene::{Effects, On};

#[test]
fn fields_near_a_pattern_are_those_from_rest() {
    let base = random(3);
    // One cell, two, and a square of nine.
    let changes: [&[usize]; 3] = [&[1275], &[620, 1990], &[0, 1, 2, 50, 51, 52, 100, 101, 102]];
    let changed = changes.map(|change| {
        let mut cells = base.cells().to_vec();
        change.iter().for_each(|&cell| cells[cell] ^= 1);
        Pattern::from_cells(Raster::PAPER, &cells).unwrap()
    });
    let stiff = Effects {
        strain_stiffening: Some(gent(100.0)),
        wrinkling: Some(On {}),
        ..Effects::default()
    };
    for effects in [Effects::default(), stiff] {
        let evaluator = GradientEvaluator::new(&scene(3.0, 5.25e3, effects)).unwrap();
        let near = evaluator.predict_near(&base, &changed).unwrap();
        let before = evaluator
            .predict_some(std::slice::from_ref(&base))
            .unwrap()
            .remove(0)
            .unwrap();
        let from_rest = evaluator.predict_some(&changed).unwrap();
        for (near, exact) in near.iter().zip(from_rest) {
            let (near, exact) = (near.as_ref().unwrap(), exact.unwrap());
            let apart = near.max_difference(&exact);
            let moved = exact.max_difference(&before);
            assert!(apart < 1e-5 * moved && apart < 2.5e-7, "{apart:e} of {moved:e}");
        }
    }
}
