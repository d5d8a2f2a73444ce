//! `kind: balance` turns solved samples into a flat, augmented and split training set.

use rayon::prelude::*;

use crate::base::{Canonical, Dimension, Fields, InputError, Node, Quantity, Schema};
use crate::content::{self, BalanceCounts, Histograms, Packed, Solutions, files};
use crate::dataset::{BalanceOptions, Balanced, Bins, Candidate, Row, SymmetryGroup, balance};
use crate::field::{CORNERS, Field};
use crate::orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::store::{Artifact, Object};

/// The kind `balance`.
pub struct BalanceKind;

impl Kind for BalanceKind {
    fn name(&self) -> &'static str {
        "balance"
    }

    fn recipe(&self) -> u32 {
        2
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["solve"],
            least: 1,
            most: 100,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let range = Schema::list(Schema::quantity(Dimension::Length, 0.0, 1e4), 2, 2);
        let symmetry =
            Schema::word(&["d4", "none"]).says("Images that fill scarce bins: by the square's symmetry, or none.");
        let fields = Fields::new("Turns solved samples into a flat, augmented and split training set.")
            .required(
                "bins",
                Schema::whole(1, 100_000).says("Bins of the histogram of the largest displacement."),
            )
            .required(
                "range",
                range.says("Both ends of the histogram, such as [0 mm, 2.5 mm]."),
            )
            .required("target", Schema::whole(1, 100_000_000).says("Rows that are wanted."))
            .optional("symmetry", symmetry.default("d4"))
            .required("seed", super::seed());
        vec![fields]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let what = "a balance stage";
        let map = stage.fields(what, &["kind", "needs", "bins", "range", "target", "symmetry", "seed"])?;
        let bins_node = map.required(what, "bins")?;
        let range_node = map.required(what, "range")?;
        let [low, high] = range_node.list("range")? else {
            return Err(range_node
                .error("`range` must have two ends")
                .help("for example [0 mm, 2.5 mm]"));
        };
        let length = |node: &Node| node.quantity_in("range", Dimension::Length, 0.0, 1e4);
        let range = [length(low)?, length(high)?];
        let bins = bins_node.whole("bins", 1, 100_000)?;
        let bins = Bins::new(range[0].value(), range[1].value(), bins as usize)
            .map_err(|e| range_node.error(e.to_string()))?;
        let symmetry = map
            .optional("symmetry")
            .map_or(Ok("d4"), |n| n.word("symmetry", &["d4", "none"]))?;
        let options = BalanceOptions {
            bins,
            target: map.required(what, "target")?.whole("target", 1, 100_000_000)?,
            symmetry: if symmetry == "d4" {
                SymmetryGroup::D4
            } else {
                SymmetryGroup::None
            },
            seed: map.required(what, "seed")?.whole("seed", 0, i64::MAX as u64)?,
        };
        Ok(Box::new(BalanceStage {
            options,
            range,
            symmetry,
        }))
    }
}

struct BalanceStage {
    options: BalanceOptions,
    range: [Quantity; 2],
    symmetry: &'static str,
}

/// The samples with a field of all inputs, end to end, without the fields.
#[derive(Default)]
struct Solved {
    patterns: Vec<Pattern>,
    family: Vec<String>,
    max_displacement: Vec<f64>,
    unstable: u64,
}

impl Stage for BalanceStage {
    fn parameters(&self) -> Canonical {
        Canonical::map([
            ("bins", Canonical::from(self.options.bins.count())),
            ("range", self.range.iter().collect()),
            ("target", self.options.target.into()),
            ("symmetry", self.symmetry.into()),
            ("seed", self.options.seed.into()),
        ])
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        Plan::Whole { steps: 1 }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let mut solved = Solved::default();
        for input in job.inputs {
            let view = Solutions::open(input)?;
            solved.patterns.extend(view.rows().patterns().read()?);
            solved.family.extend(view.rows().family().read()?);
            solved.max_displacement.extend(view.max_displacement().read()?);
            solved.unstable += view.unstable().outcome().len()? as u64;
        }
        if solved.patterns.is_empty() {
            return Err(StageError::Input(format!(
                "none of {} samples has a stable solution: there is nothing to learn from. A lower voltage, a thicker or a \
                 stiffer membrane stays stable",
                solved.unstable
            )));
        }
        let candidates: Vec<Candidate<'_>> = solved
            .patterns
            .iter()
            .zip(&solved.max_displacement)
            .map(|(pattern, &peak)| Candidate {
                pattern,
                max_displacement: Some(peak),
            })
            .collect();
        let balanced = balance(&candidates, &self.options).map_err(|e| StageError::Failed(e.to_string()))?;
        if balanced.rows.is_empty() {
            return Err(StageError::Input(format!(
                "none of {} solved samples lies within the range of the histogram",
                solved.patterns.len()
            )));
        }
        job.progress.advance(1);
        let fields = fields(job.inputs, &balanced.rows)?;
        Ok(content(&solved, balanced, fields, super::scene_of_inputs(job.inputs)?).object())
    }
}

/// The fields of rows in the order of their sources, `[row][y][x][component]`. They are read chunk by chunk: those of all
/// samples together are larger than all else that a run holds in memory.
fn fields(inputs: &[Artifact], rows: &[Row]) -> Result<Vec<f64>, StageError> {
    let mut values = Vec::with_capacity(rows.len() * CORNERS * CORNERS * 2);
    let (mut rest, mut first) = (rows, 0);
    for input in inputs {
        for chunk in files(input)? {
            let displacement = Solutions::open(chunk)?.displacement();
            let count = displacement.len()?;
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

fn content(solved: &Solved, balanced: Balanced, fields: Vec<f64>, scene: Scene) -> content::Balanced {
    let rows = &balanced.rows;
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
