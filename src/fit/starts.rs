//! The bounds of parameters, and where the searches for them start.
//!
//! Every law is linear in its moduli, so a start needs a grid of the other parameters alone. Ogden's law has several
//! local minima: its starts are the best of all combinations of exponents on a grid.

use crate::curve::{FitError, Points, Row};
use crate::fit::Options;
use crate::law::{Law, LawKind, OgdenTerm};
use crate::solution::{Coordinate, Scale};
use deaflow_linalg::{Mat, solve_definite};

/// The searches of Ogden's law.
const OGDEN_STARTS: usize = 12;
/// A factor of zero is replaced by this part of the sum of all.
const SMALL_FACTOR: f64 = 1e-4;
/// Added to the diagonal, relative to it, so that columns may depend on each other.
const RIDGE: f64 = 1e-13;
/// The largest number of combinations of exponents that are tried.
const COMBINATIONS: f64 = 4000.0;
/// The largest number of exponents from which combinations are made.
const EXPONENTS: usize = 22;

/// Returns parameters with their bounds, where `modulus` is that of the neo-Hookean law.
///
/// # Errors
/// When given bounds name no parameter, or are not in order.
pub(crate) fn coordinates(
    law: &'static str,
    names: Vec<String>,
    modulus: f64,
    options: &Options,
) -> Result<Vec<Coordinate>, FitError> {
    let mut coordinates: Vec<Coordinate> = names.into_iter().map(|name| default(name, modulus)).collect();
    for (name, lower, upper) in &options.bounds {
        let is_meant = |c: &&mut Coordinate| c.name == *name || base_name(&c.name) == name;
        let mut meant = coordinates.iter_mut().filter(is_meant).peekable();
        if meant.peek().is_none() {
            return Err(FitError::UnknownParameter {
                law,
                name: name.clone(),
            });
        }
        for coordinate in meant {
            let positive = coordinate.scale != Scale::Logarithm || *lower > 0.0;
            if !(lower < upper && positive && lower.is_finite() && upper.is_finite()) {
                return Err(FitError::Bounds {
                    name: name.clone(),
                    lower: *lower,
                    upper: *upper,
                });
            }
            coordinate.limits = (*lower, *upper);
        }
    }
    Ok(coordinates)
}

/// Returns the name without the number of a term.
fn base_name(name: &str) -> &str {
    match name.rsplit_once('_') {
        Some((base, number)) if number.parse::<usize>().is_ok() => base,
        _ => name,
    }
}

/// Returns the coordinate of a parameter with its bounds, those of scenes.
fn default(name: String, modulus: f64) -> Coordinate {
    let (scale, limits) = match base_name(&name) {
        "jm" => (Scale::Logarithm, (1e-3, 1e12)),
        "locking_stretch" => (Scale::Logarithm, (1.0, 1e6)),
        "tau" | "branch_time" => (Scale::Logarithm, (1e-12, 1e12)),
        "c2" | "c3" => (Scale::Modulus, (-1e9, 1e9)),
        "alpha" => (Scale::Exponent, (-15.0, 15.0)),
        _ => (Scale::Logarithm, (1e-9 * modulus, 1e6 * modulus)),
    };
    Coordinate { name, scale, limits }
}

/// Returns the parameters from which searches start, the most promising first.
pub(crate) fn starts(kind: LawKind, points: &Points, modulus: f64, coordinates: &[Coordinate]) -> Vec<Vec<f64>> {
    let largest = points.counted().map(first_invariant).fold(3.0, f64::max);
    match kind {
        LawKind::NeoHookean => vec![vec![modulus]],
        LawKind::Yeoh => vec![vec![modulus, 0.0, 0.0]],
        LawKind::MooneyRivlin => vec![vec![modulus, 0.0]],
        LawKind::Gent => with_limit(kind, points, |excess| (largest - 3.0) * (1.0 + excess)),
        LawKind::ArrudaBoyce => with_limit(kind, points, |excess| (largest / 3.0).sqrt() * (1.0 + excess)),
        LawKind::Ogden(terms) => ogden(terms, points, coordinates),
    }
}

/// Returns laws of a kind, each as the terms whose moduli are 1, from which searches of a spring beside branches start.
pub(crate) fn springs(kind: LawKind, points: &Points) -> Vec<Vec<Law>> {
    let largest = points.counted().map(first_invariant).fold(3.0, f64::max);
    let beyond = [0.05, 1.0, 10.0];
    let laws = |values: Vec<Vec<f64>>| {
        values
            .iter()
            .filter_map(|values| Some(vec![kind.with(values)?]))
            .collect()
    };
    match kind {
        LawKind::NeoHookean => laws(vec![vec![1.0]]),
        LawKind::Yeoh => laws(vec![vec![1.0, 0.0, 0.0]]),
        LawKind::MooneyRivlin => laws(vec![vec![1.0, 0.0]]),
        LawKind::Gent => laws(
            beyond
                .map(|excess| vec![1.0, (largest - 3.0) * (1.0 + excess)])
                .to_vec(),
        ),
        LawKind::ArrudaBoyce => laws(
            beyond
                .map(|excess| vec![1.0, (largest / 3.0).sqrt() * (1.0 + excess)])
                .to_vec(),
        ),
        LawKind::Ogden(terms) => {
            let term = |alpha: f64| {
                let shear_modulus = 1.0;
                Law::Ogden(vec![OgdenTerm { shear_modulus, alpha }])
            };
            let exponents = |order: &[f64]| {
                (0..terms)
                    .map(|p| term(order[p % order.len()] + 0.1 * p as f64))
                    .collect()
            };
            vec![
                exponents(&[2.0, 5.0, -2.0]),
                exponents(&[1.3, 8.0, -2.0]),
                exponents(&[1.0, 3.0, 5.0]),
            ]
        }
    }
}

fn first_invariant(row: &Row) -> f64 {
    row.test.squared_stretches(row.stretch).iter().sum()
}

/// Returns starts with the best limits of extensibility on a grid between 0.1 % and a factor of 1000 beyond the data.
fn with_limit(kind: LawKind, points: &Points, limit: impl Fn(f64) -> f64) -> Vec<Vec<f64>> {
    let mut found: Vec<(f64, Vec<f64>)> = (0..=48)
        .filter_map(|step| {
            let limit = limit(10_f64.powf(-3.0 + f64::from(step) / 8.0));
            let (modulus, sum) = linear_modulus(&kind.with(&[1.0, limit])?, points)?;
            (modulus > 0.0).then(|| (sum, vec![modulus, limit]))
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.into_iter().map(|(_, start)| start).step_by(4).take(3).collect()
}

/// Returns the modulus of the neo-Hookean law.
///
/// # Errors
/// When it is not positive.
pub(crate) fn neo_hookean_modulus(points: &Points) -> Result<f64, FitError> {
    let modulus = linear_modulus(&Law::NeoHookean { shear_modulus: 1.0 }, points);
    let positive = modulus.map(|(modulus, _)| modulus).filter(|modulus| *modulus > 0.0);
    positive.ok_or(FitError::WrongSign)
}

/// Returns the modulus that fits best by linear least squares, for a law with the modulus 1, and the sum of squares.
fn linear_modulus(law: &Law, points: &Points) -> Option<(f64, f64)> {
    let (mut model_model, mut model_data, mut data_data) = (0.0, 0.0, 0.0);
    for row in points.counted() {
        let model = law.nominal_stress(row.test, row.stretch)? / row.scale;
        let data = row.stress / row.scale;
        model_model += model * model;
        model_data += model * data;
        data_data += data * data;
    }
    let modulus = model_data / model_model;
    Some((modulus, data_data - modulus * model_data))
}

/// Returns the best combinations of exponents, each with the moduli that fit best and are not negative.
fn ogden(terms: usize, points: &Points, coordinates: &[Coordinate]) -> Vec<Vec<f64>> {
    let limits = coordinates
        .iter()
        .find(|c| c.scale == Scale::Exponent)
        .map_or((-15.0, 15.0), |c| c.limits);
    let exponents = exponents_within(limits, terms);
    let columns: Vec<Vec<f64>> = exponents.iter().map(|alpha| column(*alpha, points)).collect();
    let data: Vec<f64> = points.counted().map(|row| row.stress / row.scale).collect();
    let best = best_combinations(&[], &columns, terms, &data, OGDEN_STARTS);
    let pairs = |(chosen, moduli): (Vec<usize>, Vec<f64>)| {
        let pair = |(i, g): (usize, f64)| [g, exponents[i]];
        chosen.into_iter().zip(moduli).flat_map(pair).collect()
    };
    best.into_iter().map(pairs).collect()
}

/// Returns the choices of columns that fit the data best together with those that are always used, and their positive
/// factors: of the columns that are always used first.
pub(crate) fn best_combinations(
    always: &[Vec<f64>],
    columns: &[Vec<f64>],
    chosen: usize,
    data: &[f64],
    count: usize,
) -> Vec<(Vec<usize>, Vec<f64>)> {
    let all: Vec<&Vec<f64>> = always.iter().chain(columns).collect();
    let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
    let gram = Mat::from_fn(all.len(), all.len(), |i, j| dot(all[i], all[j]));
    let right: Vec<f64> = all.iter().map(|column| dot(column, data)).collect();
    let fitted = |chosen: Vec<usize>| {
        let offset = always.len();
        let used: Vec<usize> = (0..offset).chain(chosen.iter().map(|i| offset + i)).collect();
        let (gain, factors) = positive_factors(&gram, &right, &used)?;
        Some((gain, chosen, factors))
    };
    let chosen = combinations(columns.len(), chosen).into_iter();
    let mut found: Vec<(f64, Vec<usize>, Vec<f64>)> = chosen.filter_map(fitted).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let best = found.into_iter().take(count);
    best.map(|(_, chosen, factors)| (chosen, factors)).collect()
}

/// Returns by how much some columns reduce the sum of squares, and their factors. Columns whose factor would be
/// negative leave one by one, the most negative first; in place of zero they get a small factor, which has a logarithm.
fn positive_factors(gram: &Mat<f64>, right: &[f64], used: &[usize]) -> Option<(f64, Vec<f64>)> {
    let mut kept = used.to_vec();
    loop {
        let system = Mat::from_fn(kept.len(), kept.len(), |a, b| {
            let ridge = if a == b { 1.0 + RIDGE } else { 1.0 };
            ridge * gram[(kept[a], kept[b])]
        });
        let reduced: Vec<f64> = kept.iter().map(|&i| right[i]).collect();
        let factors = solve_definite(&system, &reduced)?;
        let (worst, least) = factors.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1))?;
        if *least > 0.0 {
            let gain = factors.iter().zip(&reduced).map(|(x, b)| x * b).sum();
            let small = SMALL_FACTOR * factors.iter().sum::<f64>();
            let of = |i: &usize| {
                kept.iter()
                    .position(|k| k == i)
                    .map_or(small, |a| factors[a].max(small))
            };
            return Some((gain, used.iter().map(of).collect()));
        }
        kept.remove(worst);
    }
}

/// Returns the stresses of one term with the modulus 1, divided by the scales.
fn column(alpha: f64, points: &Points) -> Vec<f64> {
    let law = Law::Ogden(vec![OgdenTerm {
        shear_modulus: 1.0,
        alpha,
    }]);
    let stress = |row: &Row| law.nominal_stress(row.test, row.stretch).unwrap_or(f64::NAN) / row.scale;
    points.counted().map(stress).collect()
}

/// Returns evenly spaced exponents within limits: so few that not too many combinations of them are tried.
fn exponents_within((low, high): (f64, f64), terms: usize) -> Vec<f64> {
    let choices = |of: usize| (0..terms).fold(1.0, |product, k| product * of.saturating_sub(k) as f64 / (k + 1) as f64);
    let few = |count: &usize| choices(*count) <= COMBINATIONS;
    let count = (terms + 1..=EXPONENTS).rev().find(few).unwrap_or(terms + 1);
    (0..count)
        .map(|i| low + (high - low) * i as f64 / (count - 1) as f64)
        .collect()
}

/// Returns all ascending choices of `chosen` of `count` indices.
fn combinations(count: usize, chosen: usize) -> Vec<Vec<usize>> {
    let mut all = vec![Vec::new()];
    for following in (0..chosen).rev() {
        let longer = |begun: Vec<usize>| {
            let next = begun.last().map_or(0, |last| last + 1);
            let end = count.saturating_sub(following);
            (next..end).map(move |index| [begun.as_slice(), &[index]].concat())
        };
        all = all.into_iter().flat_map(longer).collect();
    }
    all
}
