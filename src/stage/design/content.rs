//! What the artifact of a design stage says: a row for each pattern, and how the searches went.

use crate::design::{FoundDesign, GenerationReport, Probe, Refinement, SearchResult, SearchStep, UNITS};
use crate::pattern::Pattern;
use crate::stage::arrays;
use crate::store::{Data, Dataset, Object};

/// What is said of every row of a target.
pub struct Heading {
    /// The label of the stage.
    pub case: String,
    /// The name of the target.
    pub name: String,
    /// Its objective in YAML.
    pub objective: String,
    /// The wanted area fraction, or `free`.
    pub area: String,
    /// The constraints in YAML.
    pub constraints: String,
}

/// The artifact of one target.
pub fn describe(heading: &Heading, found: &SearchResult) -> Object {
    let object = with_designs(Object::default(), heading, found);
    let object = with_history(object, heading, &found.generations);
    let object = with_refinements(object, heading, &found.refinements);
    with_probes(object, heading, found)
}

fn with_designs(object: Object, heading: &Heading, found: &SearchResult) -> Object {
    let rows = &found.designs;
    let texts = |note: &str, text: &dyn Fn(&FoundDesign) -> String| {
        let texts: Vec<String> = rows.iter().map(text).collect();
        arrays::texts(note, texts.iter().map(String::as_str))
    };
    let same = |note: &str, text: &str| texts(note, &|_| text.to_owned());
    let wholes = |note: &str, number: fn(&FoundDesign) -> usize| {
        arrays::wholes("1", note, rows.iter().map(|row| number(row) as u64).collect())
    };
    let reals = |units: &str, note: &str, number: fn(&FoundDesign) -> f64| {
        arrays::reals(units, note, rows.iter().map(number).collect())
    };
    let patterns: Vec<Pattern> = rows.iter().map(|row| row.pattern.clone()).collect();
    object
        .with("case", same("label of the stage", &heading.case))
        .with("name", same("name of the target", &heading.name))
        .with(
            "role",
            texts(
                "ga, refined along the gradient, optimum of gradients alone, intuitive, intuitive at the area of the design",
                &|row| row.role.name().to_owned(),
            ),
        )
        .with("member", wholes("which of several designs of the target", |row| row.member))
        .with("units", wholes("units along a side by which it was searched", |row| row.units))
        .with("area_target", same("wanted area fraction, or free", &heading.area))
        .with("evaluator", same("what predicted the field", &found.evaluator))
        .with(
            "patterns",
            arrays::patterns("electrode patterns [row][y][x], origin lower left, 1 = electrode", &patterns),
        )
        .with(
            "area",
            reals("1", "area fraction of the electrode", |row| row.pattern.area_fraction()),
        )
        .with(
            "predicted",
            arrays::fields(
                "predicted displacement at the cell corners [row][y][x][component]",
                rows.iter().map(|row| &row.predicted).collect::<Vec<_>>().into_iter(),
            ),
        )
        .with(
            "value",
            reals("mm", "predicted mean displacement along the wanted directions", |row| row.value_mm),
        )
        .with("fitness", reals("1", "fitness, smaller is better", |row| row.fitness))
        .with_long_texts("objective", "the objective in YAML", rows.iter().map(|_| heading.objective.as_str()))
        .with_long_texts("constraints", "the constraints in YAML", rows.iter().map(|_| heading.constraints.as_str()))
        .with_long_texts("status", "met, or which constraints are not", rows.iter().map(|row| row.status.as_str()))
}

fn with_history(object: Object, heading: &Heading, history: &[GenerationReport]) -> Object {
    let curve = |units, description, value: fn(&GenerationReport) -> f64| {
        arrays::reals(units, description, history.iter().map(value).collect())
    };
    let genes = history
        .iter()
        .flat_map(|report| report.genome.genes().iter().map(|&on| u8::from(on)));
    let genomes = Dataset::new(
        "1",
        "best genome of each generation [generation][y][x]",
        &[history.len(), UNITS, UNITS],
        Data::U8(genes.collect()),
    );
    object
        .with(
            "history/name",
            arrays::texts("name of the target", history.iter().map(|_| heading.name.as_str())),
        )
        .with(
            "history/generation",
            arrays::wholes(
                "1",
                "number of the generation",
                history.iter().map(|r| r.generation as u64).collect(),
            ),
        )
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
}

fn with_refinements(object: Object, heading: &Heading, refinements: &[Refinement]) -> Object {
    let steps: Vec<(&Refinement, usize, &SearchStep)> = refinements
        .iter()
        .flat_map(|search| {
            search
                .steps
                .iter()
                .enumerate()
                .map(move |(at, step)| (search, at, step))
        })
        .collect();
    let texts = |note: &str, text: &dyn Fn(&Refinement) -> String| {
        let texts: Vec<String> = steps.iter().map(|(search, ..)| text(search)).collect();
        arrays::texts(note, texts.iter().map(String::as_str))
    };
    let wholes = |note: &str, number: &dyn Fn(&Refinement, usize) -> usize| {
        arrays::wholes(
            "1",
            note,
            steps.iter().map(|(search, at, _)| number(search, *at) as u64).collect(),
        )
    };
    let reals = |units: &str, note: &str, number: fn(&SearchStep) -> f64| {
        arrays::reals(units, note, steps.iter().map(|(.., step)| number(step)).collect())
    };
    object
        .with("climb/name", texts("name of the target", &|_| heading.name.clone()))
        .with(
            "climb/role",
            texts("role of the result", &|search| search.role.name().to_owned()),
        )
        .with(
            "climb/member",
            wholes("which of several designs", &|search, _| search.member),
        )
        .with("climb/step", wholes("step of the climb", &|_, at| at))
        .with(
            "climb/value",
            reals(
                "mm",
                "displacement along the wanted directions by finite elements",
                |step| step.value_mm,
            ),
        )
        .with("climb/area", reals("1", "area fraction", |step| step.area))
        .with(
            "climb/simulations",
            arrays::wholes(
                "1",
                "patterns simulated up to this step",
                steps.iter().map(|(.., step)| step.simulations as u64).collect(),
            ),
        )
}

/// Adds what every candidate for an evaluator said, and how many patterns the search predicted.
fn with_probes(object: Object, heading: &Heading, found: &SearchResult) -> Object {
    let probes = &found.probes;
    let wholes = |note: &str, value: fn(&Probe) -> u64| arrays::wholes("1", note, probes.iter().map(value).collect());
    object
        .with(
            "evaluations",
            arrays::wholes("1", "patterns predicted by the search", vec![found.evaluations as u64]),
        )
        .with(
            "probe/name",
            arrays::texts("name of the target", probes.iter().map(|_| heading.name.as_str())),
        )
        .with(
            "probe/candidates",
            arrays::texts(
                "evaluators from the cheapest to the dearest, the reference last; none where one is named",
                probes.iter().map(|probe| probe.settings.as_str()),
            ),
        )
        .with(
            "probe/rmse",
            arrays::reals(
                "mm",
                "root mean square error of a component on patterns of the first generation",
                probes.iter().map(|probe| probe.rmse_mm).collect(),
            ),
        )
        .with(
            "probe/design_error",
            arrays::reals(
                "1",
                "largest error of the displacement along the wanted directions as a share of it, on patterns like designs",
                probes.iter().map(|probe| probe.design_error).collect(),
            ),
        )
        .with(
            "probe/known",
            wholes("patterns that the error is over", |probe| probe.known),
        )
        .with(
            "probe/disagree",
            wholes(
                "patterns of which the reference has a field and it has none, or it has one alone",
                |probe| probe.disagree,
            ),
        )
}
