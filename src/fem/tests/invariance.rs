//! Changes that leave the result unchanged, or change it in a known way.

use super::*;

#[test]
fn results_follow_the_symmetries_of_the_square() {
    let solver = solver(&Scene::vhb4910(), 1);
    let pattern = random(0);
    let field = solver.simulate(std::slice::from_ref(&pattern)).remove(0).field.unwrap();
    for g in Symmetry::ALL {
        let image = solver.simulate(&[pattern.transformed(g)]).remove(0).field.unwrap();
        assert!(image.rms_difference(&field.transformed(g)) < 1e-10);
    }
}

#[test]
fn only_kappa_prestretch_and_shape_matter() {
    let reference = field(&Scene::vhb4910(), 1, &random(1));
    // Twice the side and thickness, four times the modulus: the same κ at four times the voltage.
    let scaled = Scene::with_values(100.0, 2.0, 3.0, 180e3, 4.7, 4.0 * 5250.0);
    let other = field(&scaled, 1, &random(1));
    for (a, b) in reference.values().iter().zip(other.values()) {
        assert!((2.0 * a - b).abs() < 1e-9);
    }
}

#[test]
fn small_displacements_grow_with_the_square_of_the_voltage() {
    let at = |voltage| field(&Scene::vhb4910().at_voltage(voltage), 1, &random(2));
    let (one, ten) = (at(1.0), at(10.0));
    let largest = ten.max_magnitude();
    for (a, b) in one.values().iter().zip(ten.values()) {
        assert!((100.0 * a - b).abs() < 1e-5 * largest);
    }
}

#[test]
fn results_do_not_depend_on_company_or_threads() {
    let solver = solver(&Scene::vhb4910(), 1);
    let patterns: Vec<Pattern> = (0..5).map(random).collect();
    let together = solver.simulate(&patterns);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    assert_eq!(pool.install(|| solver.simulate(&patterns)), together);
    for (pattern, result) in patterns.iter().zip(&together) {
        assert_eq!(&solver.simulate(std::slice::from_ref(pattern))[0], result);
    }
}
