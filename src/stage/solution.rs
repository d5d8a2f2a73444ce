//! What the artifact of a solve stage says.
//!
//! Samples with a field stand at the root, the others under `unstable/` with the reason: no row holds
//! numbers that only look valid.

use std::collections::BTreeMap;

use super::{arrays, observations};
use crate::fem::{AccurateSimulation, Order};
use crate::field::Field;
use crate::orchestrator::StageError;
use crate::pattern::Pattern;
use crate::scene::{Effects, Scene};
use crate::store::{Artifact, Data, Dataset, Object};

/// The rows of a chunk of samples.
struct Samples<'a> {
    patterns: &'a [Pattern],
    family: Vec<String>,
    index: Vec<u64>,
    units: Vec<u64>,
}

/// A result that has a field.
type Solved<'a> = (&'a AccurateSimulation, &'a Field);

/// The object for the results of one chunk of samples, with estimates of their errors where the solver makes them.
///
/// # Errors
/// When the arrays of the samples are missing or differ in length.
pub fn describe(
    samples: &Artifact,
    patterns: &[Pattern],
    results: &[AccurateSimulation],
    estimated: bool,
    scene: &Scene,
    effects: &Effects,
) -> Result<Object, StageError> {
    let (family, index, units) = (
        samples.texts("family")?.1,
        samples.u64s("index")?.1,
        samples.u64s("units")?.1,
    );
    if [family.len(), index.len(), units.len(), results.len()] != [patterns.len(); 4] {
        return Err(StageError::Input(format!(
            "artifact {}: its arrays differ in length",
            samples.digest().short()
        )));
    }
    let samples = Samples {
        patterns,
        family,
        index,
        units,
    };
    let (stable, unstable): (Vec<usize>, Vec<usize>) =
        (0..results.len()).partition(|&i| results[i].simulation.field.is_some());
    let mut datasets = BTreeMap::new();
    for (prefix, rows) in [("", &stable), ("unstable/", &unstable)] {
        datasets.extend(identity(&samples, results, rows).map(|(path, dataset)| (format!("{prefix}{path}"), dataset)));
    }
    datasets.insert("unstable/voltage_bracket".to_owned(), brackets(results, &unstable));
    let solved: Vec<Solved<'_>> = results
        .iter()
        .filter_map(|r| Some((r, r.simulation.field.as_ref()?)))
        .collect();
    datasets.extend(solution(&solved).map(|(path, dataset)| (path.to_owned(), dataset)));
    let observations: Vec<_> = solved
        .iter()
        .map(|(result, _)| Some(&result.simulation.observation))
        .collect();
    datasets.extend(
        observations::datasets(effects, &observations)
            .into_iter()
            .map(|(path, dataset)| (path.to_owned(), dataset)),
    );
    if estimated {
        datasets.extend(
            estimates(&solved)
                .into_iter()
                .map(|(path, dataset)| (path.to_owned(), dataset)),
        );
    }
    let attributes = BTreeMap::from([("scene".to_owned(), scene.to_text())]);
    Ok(Object {
        attributes,
        datasets,
        parts: Vec::new(),
    })
}

/// Which samples these rows are, and how they ended.
fn identity(samples: &Samples<'_>, results: &[AccurateSimulation], rows: &[usize]) -> [(&'static str, Dataset); 5] {
    let chosen: Vec<Pattern> = rows.iter().map(|&i| samples.patterns[i].clone()).collect();
    let family = rows.iter().map(|&i| samples.family[i].as_str());
    let outcome = rows.iter().map(|&i| results[i].simulation.outcome.name());
    let wholes =
        |description, values: &[u64]| arrays::wholes("1", description, rows.iter().map(|&i| values[i]).collect());
    [
        (
            "patterns",
            arrays::patterns(
                "electrode patterns [sample][y][x], origin lower left, 1 = electrode",
                &chosen,
            ),
        ),
        (
            "family",
            arrays::texts("family that the pattern was drawn from", family),
        ),
        (
            "index",
            wholes(
                "number of the sample within its family, parameters and seed",
                &samples.index,
            ),
        ),
        (
            "units",
            wholes("units across the membrane (large-grid), 0 elsewhere", &samples.units),
        ),
        ("outcome", arrays::texts("how the simulation ended", outcome)),
    ]
}

fn brackets(results: &[AccurateSimulation], unstable: &[usize]) -> Dataset {
    let bracket = |&i: &usize| results[i].simulation.outcome.bracket().unwrap_or_default();
    let note = "highest voltage with a stable equilibrium and lowest without; 0, 0 where the outcome is `iteration-limit` or `no-estimate`";
    Dataset::new(
        "V",
        note,
        &[unstable.len(), 2],
        Data::F64(unstable.iter().flat_map(bracket).collect()),
    )
}

fn solution(solved: &[Solved<'_>]) -> [(&'static str, Dataset); 4] {
    let largest = solved.iter().map(|(_, field)| field.max_magnitude()).collect();
    let iterations = solved
        .iter()
        .map(|(result, _)| result.simulation.newton_iterations)
        .collect();
    let residuals = solved.iter().map(|(result, _)| result.simulation.residual).collect();
    let fields = arrays::fields(
        "displacement at the cell corners [sample][y][x][component]",
        solved.iter().map(|(_, field)| *field),
    );
    let iterations = Dataset::new(
        "1",
        "Newton steps over all load steps, or steps of an estimate",
        &[solved.len()],
        Data::U32(iterations),
    );
    [
        ("displacement", fields),
        (
            "max_displacement",
            arrays::reals("mm", "largest displacement magnitude over the corners", largest),
        ),
        ("newton_iterations", iterations),
        (
            "residual",
            arrays::reals("1", "relative residual of the equilibrium", residuals),
        ),
    ]
}

/// Estimated error and mesh of each sample.
fn estimates(solved: &[Solved<'_>]) -> Vec<(&'static str, Dataset)> {
    let note = "estimated largest error of the displacement over the corners";
    let errors = solved
        .iter()
        .filter_map(|(result, _)| result.discretisation_error)
        .collect();
    let errors = ("discretisation_error", arrays::reals("mm", note, errors));
    std::iter::once(errors)
        .chain(meshes(solved.iter().map(|(result, _)| *result)))
        .collect()
}

/// The mesh that was picked for each sample.
pub fn meshes<'a>(results: impl Iterator<Item = &'a AccurateSimulation> + Clone) -> [(&'static str, Dataset); 2] {
    let order = |order| if order == Order::Biquadratic { 2 } else { 1 };
    let elements = results.clone().map(|result| result.elements_per_cell as u64).collect();
    let orders = results.map(|result| order(result.order)).collect();
    [
        (
            "elements_per_cell",
            arrays::wholes("1", "elements along one side of a cell", elements),
        ),
        ("order", arrays::wholes("1", "polynomial order of the elements", orders)),
    ]
}
