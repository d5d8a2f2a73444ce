//! The content of the artifact of a design stage: one row per design, and the course of the searches.

use deaflow_content::{
    Candidates, DesignRows, Designs, FrontObjectives, Fronts, GENOME_UNITS, GradientSteps, History, LongTexts, Packed,
};
use deaflow_design::{
    CandidateAccuracy, FoundDesign, FoundFront, Front, FrontMethod, GenerationReport, OtherObjective, PointOutcome,
    Refinement, SearchResult, Target, UNITS,
};
use deaflow_pattern::Bits;
use deaflow_scene::Scene;

/// The values that all rows of a target share.
pub struct Heading {
    /// The label of the stage.
    pub case: String,
    /// The name of the target.
    pub name: String,
    /// Its objective in YAML.
    pub objective: String,
    /// The target area fraction, or `free`.
    pub area: String,
    /// The constraints in YAML.
    pub constraints: String,
}

const _: () = assert!(GENOME_UNITS == UNITS);

/// Returns the content of the artifact of one target. With `is_robust`, the objective of this or another target of the
/// stage is robust.
pub fn designs(heading: Heading, found: SearchResult, is_robust: bool, (scene, method): (Scene, &str)) -> Designs {
    let name = heading.name.clone();
    let values = found
        .designs
        .iter()
        .map(|design| design.robust_value.unwrap_or(design.value_mm));
    Designs {
        value: found.designs.iter().map(|design| design.value_mm).collect(),
        robust: is_robust.then(|| values.collect()),
        fitness: found.designs.iter().map(|design| design.fitness).collect(),
        history: history(&name, &found.generations),
        steps: steps(&name, &found.refinements),
        evaluations: vec![found.evaluations as u64],
        candidates: candidates(&name, &found.accuracies),
        front: None,
        rows: rows(heading, found.designs, found.evaluator, scene.free_cells().as_ref()),
        scene,
        method: method.to_owned(),
    }
}

/// Returns the content of the artifact of a front: each point is a target of its own. That of a limit of the area has
/// this area, otherwise the area is free.
pub fn front(
    (heading, target): (Heading, &Target),
    found: FoundFront,
    front: &Front,
    (scene, method): (Scene, &str),
) -> Designs {
    let is_charge = |other: &OtherObjective| matches!(other, OtherObjective::Cost(cost) if cost.is_charge());
    let charge = front.others.iter().position(is_charge);
    let charge = charge.map(|at| found.values.iter().map(|values| values[at + 1]).collect());
    let is_genetic = front.pareto.method == FrontMethod::Nsga2;
    // The genetic algorithm counts in its evaluations.
    let simulations = match is_genetic {
        true => found.result.evaluations as u64,
        false => found.history.last().map_or(0, |(count, _)| *count as u64),
    };
    let has_areas = charge.is_none() && !is_genetic;
    let stored = Fronts {
        limit: found.limits.clone(),
        outcome: LongTexts(found.outcomes.iter().map(outcome).collect()),
        gain: found.values.iter().map(|values| values[0]).collect(),
        charge,
        reference: (!is_genetic).then(|| found.reference[1..].to_vec()),
        simulations: found.history.iter().map(|(count, _)| *count as u64).collect(),
        hypervolume: found.history.iter().map(|(_, reached)| *reached).collect(),
        objectives: is_genetic.then(|| objectives(target, &found, front)),
    };
    let is_robust = found.result.designs.iter().any(|design| design.robust_value.is_some());
    let mut designs = designs(heading, found.result, is_robust, (scene, method));
    let (rows, steps) = (&mut designs.rows, &mut designs.steps);
    for (at, member) in rows.member.iter_mut().enumerate() {
        let limit = std::mem::take(member) as usize;
        rows.name[at] = Front::point_name(limit);
        if has_areas {
            rows.area_target[at] = found.limits[limit].to_string();
        }
    }
    for (name, member) in steps.name.iter_mut().zip(&mut steps.member) {
        *name = Front::point_name(std::mem::take(member) as usize);
    }
    designs.evaluations = vec![simulations];
    designs.front = Some(stored);
    designs
}

/// The objectives of a front of the genetic algorithm.
fn objectives(target: &Target, found: &FoundFront, front: &Front) -> FrontObjectives {
    let others = front.others.iter().map(|other| match other {
        OtherObjective::Value(objective, goal) => (objective.to_text(), goal.unit()),
        OtherObjective::Cost(cost) => (cost.to_text(), cost.unit()),
    });
    let all = std::iter::once((target.objective.to_text(), target.goal.unit())).chain(others);
    let (texts, units): (Vec<String>, Vec<&str>) = all.unzip();
    FrontObjectives {
        objective: LongTexts(texts),
        unit: units.into_iter().map(str::to_owned).collect(),
        reference: found.reference.clone(),
        values: Packed(found.values.concat()),
    }
}

/// The text is part of artifact digests.
fn outcome(outcome: &PointOutcome) -> String {
    match outcome {
        PointOutcome::Found => "found".to_owned(),
        PointOutcome::Dominated(other) => format!("{} is at least as good", Front::point_name(*other)),
        PointOutcome::None(why) => format!("no design: each pattern {why}"),
    }
}

fn rows(heading: Heading, designs: Vec<FoundDesign>, evaluator: String, free: Option<&Bits>) -> DesignRows {
    let n = designs.len();
    let mut rows = DesignRows {
        case: vec![heading.case; n],
        name: vec![heading.name; n],
        area_target: vec![heading.area; n],
        evaluator: vec![evaluator; n],
        objective: LongTexts(vec![heading.objective; n]),
        constraints: LongTexts(vec![heading.constraints; n]),
        ..DesignRows::default()
    };
    for design in designs {
        rows.role.push(design.role);
        rows.member.push(design.member as u64);
        rows.units.push(design.units as u64);
        rows.area.push(design.pattern.area_fraction(free));
        rows.patterns.push(design.pattern);
        if let [first, _, ..] = &design.predicted[..] {
            rows.predicted.push(first.clone());
            let states = rows.states.get_or_insert_default();
            states.predicted.extend(design.predicted);
        } else {
            rows.predicted.extend(design.predicted);
        }
        rows.status.0.push(design.status);
    }
    rows
}

fn history(name: &str, reports: &[GenerationReport]) -> History {
    let genes = reports.iter().flat_map(|report| report.genome.genes());
    History {
        name: vec![name.to_owned(); reports.len()],
        generation: reports.iter().map(|r| r.generation as u64).collect(),
        best: reports.iter().map(|r| r.best).collect(),
        mean: reports.iter().map(|r| r.mean).collect(),
        value: reports.iter().map(|r| r.value_mm).collect(),
        area: reports.iter().map(|r| r.area).collect(),
        genomes: Packed(genes.copied().collect()),
    }
}

fn steps(name: &str, refinements: &[Refinement]) -> GradientSteps {
    let mut found = GradientSteps::default();
    for search in refinements {
        for (at, step) in search.steps.iter().enumerate() {
            found.name.push(name.to_owned());
            found.role.push(search.role);
            found.member.push(search.member as u64);
            found.step.push(at as u64);
            found.value.push(step.value_mm);
            found.area.push(step.area);
            found.simulations.push(step.simulations as u64);
        }
    }
    found
}

fn candidates(name: &str, accuracies: &[CandidateAccuracy]) -> Candidates {
    Candidates {
        name: vec![name.to_owned(); accuracies.len()],
        settings: accuracies.iter().map(|candidate| candidate.settings.clone()).collect(),
        rmse: accuracies.iter().map(|candidate| candidate.rmse_mm).collect(),
        design_error: accuracies.iter().map(|candidate| candidate.design_error).collect(),
        known: accuracies.iter().map(|candidate| candidate.known).collect(),
        disagree: accuracies.iter().map(|candidate| candidate.disagree).collect(),
    }
}
