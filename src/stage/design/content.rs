//! What the artifact of a design stage says.

use super::probe::Probe;
use crate::design::{Evolution, GenerationReport, UNITS};
use crate::field::Field;
use crate::pattern::Pattern;
use crate::stage::arrays;
use crate::store::{Data, Dataset, Object};

/// Adds what every candidate for an evaluator said.
pub fn with_probes(object: Object, probes: &[Probe]) -> Object {
    let wholes = |note: &str, value: fn(&Probe) -> u64| arrays::wholes("1", note, probes.iter().map(value).collect());
    object
        .with(
            "evaluator/candidates",
            arrays::texts(
                "evaluators from the cheapest to the dearest, the reference last; none where one is named",
                probes.iter().map(|probe| probe.settings.as_str()),
            ),
        )
        .with(
            "evaluator/rmse",
            arrays::reals(
                "mm",
                "root mean square error of a component on patterns of the first generation",
                probes.iter().map(|probe| probe.rmse_mm).collect(),
            ),
        )
        .with(
            "evaluator/known",
            wholes("patterns that the error is over", |probe| probe.known),
        )
        .with(
            "evaluator/disagree",
            wholes(
                "patterns of which the reference has a field and it has none, or it has one alone",
                |probe| probe.disagree,
            ),
        )
}

/// The search, and the patterns that it is judged by with their predicted fields.
pub fn describe(evolution: &Evolution, patterns: &[Pattern; 3], predicted: &[Field]) -> Object {
    let curve = |units, description, value: fn(&GenerationReport) -> f64| {
        arrays::reals(units, description, evolution.history.iter().map(value).collect())
    };
    let genes = evolution
        .history
        .iter()
        .flat_map(|report| report.genome.genes().iter().map(|&on| u8::from(on)));
    let genomes = Dataset::new(
        "1",
        "best genome of each generation [generation][y][x]",
        &[evolution.history.len(), UNITS, UNITS],
        Data::U8(genes.collect()),
    );
    let mut object = Object::default()
        .with(
            "history/best",
            curve(
                "1",
                "fitness of the best individual of each generation, smaller is better",
                |r| r.best,
            ),
        )
        .with(
            "history/mean",
            curve("1", "mean fitness of each generation", |r| r.mean),
        )
        .with(
            "history/value",
            curve(
                "mm",
                "predicted displacement of the best along the wanted direction",
                |r| r.value_mm,
            ),
        )
        .with("history/area", curve("1", "area fraction of the best", |r| r.area))
        .with("history/genomes", genomes)
        .with(
            "evaluations",
            arrays::wholes("1", "patterns predicted", vec![evolution.evaluations as u64]),
        );
    for ((name, pattern), field) in ["best", "intuitive", "intuitive_equal_area"]
        .into_iter()
        .zip(patterns)
        .zip(predicted)
    {
        let shown = arrays::pattern("electrode pattern [y][x], origin lower left, 1 = electrode", pattern);
        object = object.with(&format!("{name}/pattern"), shown).with(
            &format!("{name}/predicted"),
            arrays::field("predicted displacement at the cell corners [y][x][component]", field),
        );
    }
    object
}
