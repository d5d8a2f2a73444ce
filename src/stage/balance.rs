//! `kind: balance` turns solved samples into a flat, augmented and split training set.

use rayon::prelude::*;

use super::arrays;
use crate::base::{Canonical, Dimension, Fields, InputError, Node, Quantity, Schema};
use crate::dataset::{BalanceOptions, Balanced, Bins, Candidate, Histogram, Row, SymmetryGroup, balance};
use crate::field::{CORNERS, Field};
use crate::orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::pattern::Pattern;
use crate::store::{Artifact, Data, Dataset, Object};

/// The kind `balance`.
pub struct BalanceKind;

impl Kind for BalanceKind {
    fn name(&self) -> &'static str {
        "balance"
    }

    fn recipe(&self) -> u32 {
        1
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
    fields: usize,
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
            solved.patterns.extend(arrays::read_patterns(input, "patterns")?);
            solved.fields += input
                .content("displacement")?
                .shape
                .first()
                .copied()
                .unwrap_or_default();
            solved.family.extend(input.texts("family")?.1);
            solved.max_displacement.extend(input.f64s("max_displacement")?.1);
            solved.unstable += input.texts("unstable/outcome")?.1.len() as u64;
        }
        let lengths = [solved.fields, solved.family.len(), solved.max_displacement.len()];
        if lengths != [solved.patterns.len(); 3] {
            return Err(StageError::Input(
                "the arrays of the solved samples differ in length".to_owned(),
            ));
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
        Ok(describe(&solved, &balanced, fields).attribute("scene", super::scene_attribute(job.inputs)?))
    }
}

/// The fields of rows in the order of their sources, `[row][y][x][component]`. They are read chunk by chunk: those of all
/// samples together are larger than all else that a run holds in memory.
fn fields(inputs: &[Artifact], rows: &[Row]) -> Result<Vec<f64>, StageError> {
    let mut values = Vec::with_capacity(rows.len() * CORNERS * CORNERS * 2);
    let (mut rest, mut first) = (rows, 0);
    for input in inputs {
        let chunks = if input.is_manifest() {
            input.chunks()?
        } else {
            std::slice::from_ref(input)
        };
        for chunk in chunks {
            let count = chunk
                .content("displacement")?
                .shape
                .first()
                .copied()
                .unwrap_or_default();
            let (here, after) = rest.split_at(rest.partition_point(|row| row.source < first + count));
            if !here.is_empty() {
                let fields = arrays::read_fields(chunk, "displacement")?;
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

fn describe(solved: &Solved, balanced: &Balanced, fields: Vec<f64>) -> Object {
    let rows = &balanced.rows;
    let patterns: Vec<Pattern> = rows
        .par_iter()
        .map(|row| row.pattern(&solved.patterns[row.source]))
        .collect();
    let orbits: Vec<String> = rows.iter().map(|row| row.orbit.to_string()).collect();
    let wholes = |description, value: fn(&Row) -> usize| {
        arrays::wholes("1", description, rows.iter().map(|row| value(row) as u64).collect())
    };
    let peaks = rows.iter().map(|row| solved.max_displacement[row.source]).collect();
    let object = Object::default()
        .with(
            "patterns",
            arrays::patterns(
                "electrode patterns [row][y][x], origin lower left, 1 = electrode",
                &patterns,
            ),
        )
        .with(
            "displacement",
            Dataset::new(
                "mm",
                "displacement at the cell corners [row][y][x][component]",
                &[rows.len(), CORNERS, CORNERS, 2],
                Data::F64(fields),
            ),
        )
        .with(
            "family",
            arrays::texts(
                "family of the sample",
                rows.iter().map(|row| solved.family[row.source].as_str()),
            ),
        )
        .with(
            "split",
            arrays::texts(
                "train, validation or test; one for all images of a pattern",
                rows.iter().map(|row| row.split.name()),
            ),
        )
        .with(
            "orbit",
            arrays::texts(
                "digest shared by a pattern and its images under symmetry",
                orbits.iter().map(String::as_str),
            ),
        )
        .with("source", wholes("row of the solved sample", |row| row.source))
        .with(
            "symmetry",
            wholes("symmetry applied: quarter turns, plus 4 when mirrored first", |row| {
                row.symmetry.index()
            }),
        )
        .with("bin", wholes("bin of the histogram", |row| row.bin))
        .with(
            "max_displacement",
            arrays::reals("mm", "largest displacement magnitude over the corners", peaks),
        );
    add_histograms(object, solved, balanced)
}

fn add_histograms(object: Object, solved: &Solved, balanced: &Balanced) -> Object {
    let bins = balanced.before.bins;
    let edges = (0..=bins.count()).map(|bin| bins.edge(bin)).collect();
    let counts = |description, histogram: &Histogram| arrays::wholes("1", description, histogram.counts.clone());
    let outside = Data::U64(vec![balanced.before.below, balanced.before.above]);
    let single = |description, value: u64| arrays::wholes("1", description, vec![value]);
    object
        .with(
            "histogram/edges",
            arrays::reals("mm", "edges of the bins of the largest displacement", edges),
        )
        .with(
            "histogram/before",
            counts("samples in each bin before balancing", &balanced.before),
        )
        .with(
            "histogram/augmented",
            counts("rows available in each bin after augmentation", &balanced.augmented),
        )
        .with(
            "histogram/after",
            counts("rows in each bin after balancing", &balanced.after),
        )
        .with(
            "histogram/outside",
            Dataset::new("1", "samples below and above the range", &[2], outside),
        )
        .with(
            "histogram/level",
            arrays::reals(
                "1",
                "uniform level: rows in each bin that holds enough",
                vec![balanced.level],
            ),
        )
        .with(
            "counts/empty_bins",
            single("bins without any sample", balanced.before.empty_bins().len() as u64),
        )
        .with(
            "counts/repeats",
            single(
                "samples left out because an image of them came before",
                balanced.repeats.len() as u64,
            ),
        )
        .with(
            "counts/unstable",
            single("samples left out because they have no stable solution", solved.unstable),
        )
}
