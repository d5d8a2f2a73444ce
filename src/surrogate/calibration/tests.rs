use super::*;
use deaflow_field::CORNERS;
use deaflow_pattern::{CELLS, Raster};

/// Patterns of two families, random cells and half planes. The prediction is a smooth field. Its error is a normal
/// deviate, larger for half planes, at one random corner.
fn sample(family: usize, seed: u64, index: u64) -> (Pattern, Field, Field) {
    let mut stream = Stream::new(seed, "calibration test", 10 * index + family as u64);
    let pattern = match family {
        0 => {
            let bits: Vec<bool> = (0..CELLS * CELLS).map(|_| stream.chance(0.5)).collect();
            Pattern::from_fn(Raster::PAPER, |x, y| bits[y * CELLS + x])
        }
        1 => {
            let (s, c) = stream.range(0.0, 6.3).sin_cos();
            let shift = stream.range(-8.0, 8.0);
            Pattern::from_fn(Raster::PAPER, |x, y| {
                c * (x as f64 - 24.5) + s * (y as f64 - 24.5) < shift
            })
        }
        _ => Pattern::from_fn(Raster::PAPER, |x, y| (x + y) % 2 == 0),
    };
    let (deviation, size) = [(0.004, 0.3), (0.05, 1.8), (0.05, 0.02)][family];
    let bump = |i: usize| (std::f64::consts::PI * (i % CORNERS) as f64 / 50.0).sin();
    let tall = size * stream.range(0.9, 1.1);
    let predicted: Vec<f64> = (0..2 * CORNERS * CORNERS)
        .map(|i| tall * bump(i / 2) * bump(i / 2 / CORNERS))
        .collect();
    let mut simulated = predicted.clone();
    // The error at the centre is a tenth of that at the random corner.
    simulated[2 * (25 * CORNERS + 25)] += 0.1 * deviation * stream.normal();
    simulated[2 * (1 + stream.index(CORNERS * CORNERS - 2))] += deviation * stream.normal();
    (
        pattern,
        Field::from_values(Raster::PAPER, predicted).unwrap(),
        Field::from_values(Raster::PAPER, simulated).unwrap(),
    )
}

fn samples(families: &[usize], count: u64, seed: u64) -> Vec<CalibrationSample> {
    let each = families.iter().flat_map(|&family| (0..count).map(move |i| (family, i)));
    each.map(|(family, i)| {
        let (pattern, predicted, simulated) = sample(family, seed, i);
        CalibrationSample::new(&pattern, &predicted, &simulated, true)
    })
    .collect()
}

fn calibration() -> Calibration {
    Calibration::fit(samples(&[0, 1], 1000, 1), 7).unwrap()
}

#[test]
fn intervals_have_their_coverage_in_each_family() {
    let calibration = calibration();
    let centre = |field: &Field| field.at_corner(25, 25)[0];
    let objective = calibration.objective(&centre);
    // A normal deviate is within 1.96 deviations with 95 % probability.
    for (family, radius) in [(0, 1.96 * 0.004), (1, 1.96 * 0.05)] {
        let n = 1000;
        let (mut inside, mut objective_inside, mut flagged, mut width) = (0, 0, 0, 0.0);
        for i in 0..n {
            let (pattern, predicted, simulated) = sample(family, 2, i);
            let interval = calibration.interval(&pattern, &predicted);
            let pairs = predicted.values().iter().zip(simulated.values());
            inside += usize::from(pairs.into_iter().all(|(p, s)| (p - s).abs() <= interval.radius_mm));
            let off = (centre(&predicted) - centre(&simulated)).abs();
            objective_inside += usize::from(off <= objective.half_width(&pattern, &predicted));
            flagged += usize::from(interval.out_of_distribution);
            width += interval.radius_mm / n as f64;
        }
        let [field, number, alarms] = [inside, objective_inside, flagged].map(|k| k as f64 / n as f64);
        assert!((0.925..=0.975).contains(&field), "family {family}: {field}");
        assert!((0.925..=0.975).contains(&number), "family {family}: {number}");
        assert!(
            (0.8..1.25).contains(&(width / radius)),
            "family {family}: {width} {radius}"
        );
        assert!(alarms <= 0.03, "family {family}: {alarms}");
    }
}

#[test]
fn patterns_out_of_distribution_are_flagged_and_have_finite_intervals() {
    let calibration = calibration();
    let (board, predicted, _) = sample(2, 1, 0);
    let interval = calibration.interval(&board, &predicted);
    assert!(interval.out_of_distribution && interval.novelty > 1.0, "{interval:?}");
    for active in [false, true] {
        let interval = calibration.interval(
            &Pattern::from_fn(Raster::PAPER, |_, _| active),
            &Field::zero(Raster::PAPER),
        );
        assert!(
            interval.out_of_distribution && interval.radius_mm.is_finite() && interval.radius_mm >= 0.0,
            "{interval:?}"
        );
    }
    let only_cells = samples(&[0], 200, 3);
    let of_cells = Calibration::fit(only_cells, 1).unwrap();
    let (plane, predicted, _) = sample(1, 1, 0);
    assert!(of_cells.interval(&plane, &predicted).out_of_distribution);
}

#[test]
fn exact_predictions_have_intervals() {
    let exact = (0..100).map(|i| {
        let (pattern, predicted, _) = sample(i as usize % 2, 4, i);
        CalibrationSample::new(&pattern, &predicted, &predicted, true)
    });
    let calibration = Calibration::fit(exact.collect(), 1).unwrap();
    let (pattern, predicted, _) = sample(0, 5, 0);
    let interval = calibration.interval(&pattern, &predicted);
    assert!(interval.radius_mm <= 2.0 * FLOOR, "{interval:?}");
    assert_eq!(
        calibration
            .objective(&|field| field.at([25.0, 25.0])[0])
            .half_width(&pattern, &predicted),
        0.0
    );
}

#[test]
fn a_calibration_survives_encoding_as_arrays() {
    let calibration = calibration();
    let again = Calibration::from_parts(calibration.parts()).unwrap();
    let (pattern, predicted, _) = sample(1, 9, 0);
    assert_eq!(
        again.interval(&pattern, &predicted),
        calibration.interval(&pattern, &predicted)
    );
    let mut parts = calibration.parts();
    parts.residuals.pop();
    assert_eq!(
        Calibration::from_parts(parts).err(),
        Some(CalibrationError::Parts("residuals"))
    );
    let mut parts = calibration.parts();
    parts.residuals[3] = f32::NAN;
    assert!(Calibration::from_parts(parts).is_err());
    let mut parts = calibration.parts();
    parts.difficulty.scores.pop();
    assert!(Calibration::from_parts(parts).is_err());
    let mut parts = calibration.parts();
    parts.novelty.factor.pop();
    assert!(Calibration::from_parts(parts).is_err());
}

#[test]
fn too_few_patterns_are_refused() {
    let refused = |samples| Calibration::fit(samples, 1).err();
    assert_eq!(refused(Vec::new()), Some(CalibrationError::Few(0)));
    assert_eq!(refused(samples(&[0], 1, 1)), Some(CalibrationError::Few(1)));
    let mut strangers = samples(&[0], 100, 1);
    strangers.iter_mut().skip(20).for_each(|o| o.familiar = false);
    assert_eq!(refused(strangers), Some(CalibrationError::FewFamiliar(20)));
}
