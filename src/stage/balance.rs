//! `kind: balance` makes a balanced, augmented and split training set of solved samples.

use rayon::prelude::*;

use super::results::{most, named};
use super::without::{self, Dropped, Without};
use super::{needed, scene};
use deaflow_base::{ArtifactId, Canonical, Declared, Fields, InputError, Length, Node, Seed, parameters};
use deaflow_content as content;
use deaflow_content::{BalanceCounts, Histograms, Packed, SOLVED, Solutions, files};
use deaflow_dataset::{BalanceOptions, Balanced, BalancedRow, Bins, Candidate, SymmetryGroup, balance};
use deaflow_field::{Field, OutcomeKind};
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_pattern::{Pattern, Raster};
use deaflow_scene::Scene;
use deaflow_store::{Artifact, Object};

/// The kind `balance`.
pub struct BalanceKind;

impl Kind for BalanceKind {
    fn name(&self) -> &'static str {
        "balance"
    }

    fn recipe(&self) -> u32 {
        2
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = content::Balanced::open(artifact)?;
        Ok(named([
            ("rows", view.family().rows()? as f64),
            ("max_displacement", most(&view.max_displacement().read()?)),
        ]))
    }

    fn needs(&self) -> Needs {
        Needs::new(&SOLVED, 1, 100)
    }

    fn without(&self) -> &'static [&'static str] {
        without::LISTING
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        without::check(stage, needs)?;
        needed::one_device(stage, needs)?;
        needed::no_edges_within_cells(stage, needs)?;
        check_range(stage, needs)?;
        Ok(StageCheck::default())
    }

    fn schema(&self) -> Vec<Fields> {
        vec![BalanceParameters::fields()]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let parameters = BalanceParameters::read_with(stage, &["kind", "needs"])?;
        let [low, high] = parameters.range.map(|end| end.value());
        let bins = Bins::new(low, high, parameters.bins);
        let bins = bins.map_err(|e| stage.peek("range").unwrap_or(stage).error(e.to_string()))?;
        Ok(Box::new(BalanceStage { parameters, bins }))
    }
}

parameters! {
    /// Makes a balanced, augmented and split training set of solved samples.
    struct BalanceParameters as "a balance stage" {
        /// Bins of the histogram of the largest displacement.
        bins: usize [1..=100_000],
        /// Range of the histogram, such as [0 mm, 2.5 mm].
        range: [Length; 2] [0.0..=1e4],
        /// Number of rows to aim for.
        target: u64 [1..=100_000_000],
        /// Images of patterns that fill sparse bins: by the symmetries of the membrane, or none.
        symmetry: SymmetryGroup = SymmetryGroup::D4,
        /// Seed of the random numbers.
        seed: Seed,
        /// Audits whose rows with errors are dropped, and files with marked rows (FILE.txt, saved by the page).
        without: Option<Without>,
    }
}

struct BalanceStage {
    parameters: BalanceParameters,
    bins: Bins,
}

impl BalanceStage {
    fn options(&self, scene: &Scene) -> BalanceOptions {
        BalanceOptions {
            bins: self.bins,
            target: self.parameters.target,
            symmetry: self.parameters.symmetry,
            group: scene.symmetries(),
            seed: self.parameters.seed.0,
        }
    }
}

/// The stable samples of all inputs, concatenated, without their fields.
#[derive(Default)]
struct SolvedSamples {
    patterns: Vec<Pattern>,
    family: Vec<String>,
    max_displacement: Vec<f64>,
    /// Whether a row is left out.
    dropped: Vec<bool>,
    unstable: u64,
}

impl Stage for BalanceStage {
    fn parameters(&self) -> Canonical {
        self.parameters.to_canonical()
    }

    fn size_parameter(&self) -> Option<&'static str> {
        Some("target")
    }

    fn unit(&self) -> &'static str {
        "steps"
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        Plan::Whole { steps: 1 }
    }

    fn check_inputs(
        &self,
        inputs: &[(&'static str, Option<ArtifactId>)],
        open: &dyn Fn(&ArtifactId) -> Option<Artifact>,
    ) -> Result<(), InputError> {
        let without = self.parameters.without.as_ref();
        without.map_or(Ok(()), |without| without.check_inputs(inputs, open))
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let scene = scene::of_inputs(job.inputs)?;
        let dropped = Dropped::of(job.inputs, self.parameters.without.as_ref())?;
        let inputs = &job.inputs[..without::datasets(job.inputs)];
        let (mut solved, mut undecided) = (SolvedSamples::default(), 0);
        // Most of the time is spent on reading: first the candidates, then the fields of the chosen rows.
        let read = |pass: usize, files: usize| {
            job.progress
                .part((pass * inputs.len() + files) as f64 / (2 * inputs.len() + 1) as f64);
        };
        for (files, input) in inputs.iter().enumerate() {
            read(0, files);
            let view = Solutions::open(input)?;
            solved.patterns.extend(view.rows().patterns().read()?);
            solved.family.extend(view.rows().family().read()?);
            let peaks = view.max_displacement().read()?;
            solved
                .dropped
                .extend((0..peaks.len()).map(|row| dropped.has(files, row)));
            solved.max_displacement.extend(peaks);
            let outcomes = view.unstable().outcome().read()?;
            solved.unstable += outcomes.len() as u64;
            undecided += outcomes
                .iter()
                .filter(|outcome| **outcome == OutcomeKind::WorkLimit)
                .count() as u64;
        }
        if solved.patterns.is_empty() {
            return Err(StageError::input(none_solved(solved.unstable, undecided)));
        }
        let candidates: Vec<Candidate<'_>> = solved
            .patterns
            .iter()
            .zip(&solved.max_displacement)
            .zip(&solved.dropped)
            .map(|((pattern, &peak), dropped)| Candidate {
                pattern,
                max_displacement: (!dropped).then_some(peak),
            })
            .collect();
        let balanced = balance(&candidates, &self.options(&scene)).map_err(StageError::failed)?;
        if balanced.rows.is_empty() {
            return Err(StageError::input(format!(
                "none of the {} solved samples is in the `range` of the histogram{}",
                solved.patterns.len(),
                match solved.dropped.iter().filter(|dropped| **dropped).count() {
                    0 => String::new(),
                    count => format!(" ({count} are dropped by `without`)"),
                }
            )));
        }
        let fields = fields(inputs, &balanced.rows, scene.membrane().raster, &|files| read(1, files))?;
        let content = content(&solved, balanced, fields, &dropped, scene).object();
        job.progress.advance(1);
        Ok(content)
    }
}

/// Refuses a range that no displacement reaches: points of a membrane stay inside its frame.
fn check_range(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let (Some(node), Some(scene)) = (stage.node.peek("range"), needed::scene_of(needs)) else {
        return Ok(());
    };
    let parameters = BalanceParameters::read_with(stage.node, &["kind", "needs"])?;
    let [width, height] = scene.membrane().size_mm;
    let (low, largest) = (parameters.range[0], width.hypot(height));
    if low.value() < largest {
        return Ok(());
    }
    Err(node
        .error(format!(
            "`range` starts at {low}, and no point of a membrane of {width} × {height} mm can move by more than \
             {largest:.4} mm"
        ))
        .help("lower the `range`, or check its unit"))
}

/// Says why there is nothing to train on; `undecided` of the samples reached the work limit.
fn none_solved(samples: u64, undecided: u64) -> String {
    let cause = match undecided {
        0 => "lower the voltage, or use a thicker or stiffer membrane".to_owned(),
        n if n == samples => "all reached the work limit; raise `time_limit` of the solve stage".to_owned(),
        n => format!(
            "lower the voltage, or use a thicker or stiffer membrane; {n} reached the work limit: raise `time_limit` of \
             the solve stage"
        ),
    };
    format!("none of {samples} samples has a known stable solution, so there is nothing to train on: {cause}")
}

/// Reads the fields of rows in the order of their sources, `[row][y][x][component]`, chunk by chunk: the fields of all
/// samples together may exceed the memory.
fn fields(
    inputs: &[Artifact],
    rows: &[BalancedRow],
    raster: Raster,
    read: &dyn Fn(usize),
) -> Result<Vec<f64>, StageError> {
    let mut values = Vec::with_capacity(rows.len() * 2 * raster.corners());
    let (mut rest, mut first) = (rows, 0);
    for (done, input) in inputs.iter().enumerate() {
        read(done);
        for chunk in files(input)? {
            let displacement = Solutions::open(chunk)?.displacement();
            let count = displacement.rows()?;
            let (here, after) = rest.split_at(rest.partition_point(|row| row.source < first + count));
            if !here.is_empty() {
                let fields = displacement.read()?;
                let images: Vec<Field> = here
                    .par_iter()
                    .map(|row| row.field(&fields[row.source - first]))
                    .collect();
                values.extend(images.iter().flat_map(Field::values));
            }
            (rest, first) = (after, first + count);
        }
    }
    Ok(values)
}

fn content(
    solved: &SolvedSamples,
    balanced: Balanced,
    fields: Vec<f64>,
    dropped: &Dropped,
    scene: Scene,
) -> content::Balanced {
    let rows = &balanced.rows;
    let (dropped, without) = dropped.content();
    content::Balanced {
        patterns: rows
            .par_iter()
            .map(|row| row.pattern(&solved.patterns[row.source]))
            .collect(),
        displacement: Packed(fields),
        family: rows.iter().map(|row| solved.family[row.source].clone()).collect(),
        split: rows.iter().map(|row| row.split.name().to_owned()).collect(),
        orbit: rows.iter().map(|row| row.orbit.to_string()).collect(),
        source: rows.iter().map(|row| row.source as u64).collect(),
        symmetry: rows.iter().map(|row| row.symmetry.index() as u64).collect(),
        bin: rows.iter().map(|row| row.bin as u64).collect(),
        max_displacement: rows.iter().map(|row| solved.max_displacement[row.source]).collect(),
        counts: BalanceCounts {
            empty_bins: [balanced.before.empty_bins().len() as u64],
            repeats: [balanced.repeats.len() as u64],
            unstable: [solved.unstable],
        },
        histogram: histograms(balanced),
        dropped,
        without,
        scene,
    }
}

fn histograms(balanced: Balanced) -> Histograms {
    let bins = balanced.before.bins;
    Histograms {
        edges: (0..=bins.count()).map(|bin| bins.edge(bin)).collect(),
        outside: [balanced.before.below, balanced.before.above],
        level: [balanced.level],
        before: balanced.before.counts,
        augmented: balanced.augmented.counts,
        after: balanced.after.counts,
    }
}

#[cfg(test)]
mod tests {
    use super::none_solved;

    #[test]
    fn samples_at_the_work_limit_are_not_said_to_be_unstable() {
        let advised = |undecided| none_solved(5, undecided);
        assert!(advised(0).contains("lower the voltage") && !advised(0).contains("time_limit"));
        assert!(advised(2).contains("lower the voltage") && advised(2).contains("2 reached the work limit"));
        assert!(advised(5).contains("raise `time_limit`") && !advised(5).contains("lower the voltage"));
    }
}
