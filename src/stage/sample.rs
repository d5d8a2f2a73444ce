//! `kind: sample` draws electrode patterns of one family.

use std::ops::Range;

use rayon::prelude::*;

use crate::base::{Canonical, Decimal, Dimension, Fields, InputError, Node, Schema};
use crate::content::{SampleRows, Samples};
use crate::orchestrator::{Chunk, Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::pattern::{CELLS, Pattern};
use crate::sample::{
    AreaSweep, Areas, Bezier, Blobs, Curves, Ends, Family, LargeGrid, SampleError, SmallGrid, Stripes,
};
use crate::store::Object;

/// Samples in a chunk: small enough that a killed run loses seconds, large enough that a file is worth opening.
const CHUNK: u64 = 50;

/// More samples than this in one stage are a slip of the pen.
const MAX_COUNT: u64 = 10_000_000;

/// The keys of all families.
const KEYS: [&str; 8] = [
    "kind",
    "family",
    "count",
    "area",
    "ends",
    "units",
    "count_per_units",
    "seed",
];

const FAMILIES: [&str; 7] = [
    "small-grid",
    "large-grid",
    "bezier",
    "area-sweep",
    "stripes",
    "blobs",
    "curves",
];

/// The kind `sample`.
pub struct SampleKind;

impl Kind for SampleKind {
    fn name(&self) -> &'static str {
        "sample"
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &[],
            least: 0,
            most: 0,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let family = |word: &str, says: &str| Fields::new(says).required("family", Schema::word(&[word]).says(says));
        let count = || Schema::whole(1, MAX_COUNT).says("Patterns to draw.");
        let area = || Schema::number(0.0, 1.0).says("Area fraction of the electrode.");
        let units = Schema::list(Schema::whole(2, CELLS as u64), 1, usize::MAX).distinct();
        let per_units =
            Schema::whole(1, MAX_COUNT).says("Patterns of each number of units; all where there are fewer.");
        let fractions = Schema::list(Schema::number(0.0, 1.0), 2, 2);
        let fractions = fractions
            .says("Area fractions to draw from, smallest and largest.")
            .default(vec![0.05, 0.95]);
        let one_or_two = || Schema::any_of([Schema::number(0.0, 1.0), Schema::list(Schema::number(0.0, 1.0), 2, 2)]);
        let areas = |default: Areas| {
            let says = "Area fraction, or smallest and largest to draw from.";
            one_or_two().says(says).default(default.ends().to_vec())
        };
        let ends = Schema::word(&["opposite", "any"]).says("Where on the frame a curve may end.");
        vec![
            family("small-grid", "Patterns of which every cell stands for itself.")
                .required("count", count())
                .optional("area", area().default(0.5))
                .required("seed", super::seed()),
            family("large-grid", "Patterns of N × N units that are on or off as a whole.")
                .required("units", units.says("Units across the membrane, such as [2, 3, 4]."))
                .required("count_per_units", per_units)
                .required("seed", super::seed()),
            family("bezier", "Patterns on one side of a smooth curve through the centre.")
                .required("count", count())
                .optional("area", area().says("Unless it is given, what the curve leaves."))
                .optional("ends", ends.default("opposite"))
                .required("seed", super::seed()),
            family(
                "area-sweep",
                "Cells, grids of units and curves at drawn area fractions.",
            )
            .required("count", count())
            .optional("area", fractions)
            .required("seed", super::seed()),
            family("stripes", "Parallel bands at any angle and period.")
                .required("count", count())
                .optional("area", areas(Stripes::AREAS))
                .required("seed", super::seed()),
            family(
                "blobs",
                "Islands and holes of any size: where a smooth random field is high.",
            )
            .required("count", count())
            .optional("area", areas(Blobs::AREAS))
            .required("seed", super::seed()),
            family("curves", "Regions bounded by one to three smooth random curves.")
                .required("count", count())
                .optional(
                    "area",
                    one_or_two()
                        .says("Area fraction, or smallest and largest; unless it is given, what the curves leave."),
                )
                .required("seed", super::seed()),
        ]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let what = "a sample stage";
        // First the keys of all families, so that a misspelt `family` is told from a missing one; then those of the family.
        let map = stage.fields(what, &KEYS)?;
        let family = map.required(what, "family")?.word("family", &FAMILIES)?;
        let groups = match family {
            "large-grid" => read_large_grid(stage)?,
            "bezier" => read_bezier(stage)?,
            "area-sweep" => read_area_sweep(stage)?,
            "stripes" => read_smooth(stage, Some(Stripes::AREAS), |areas| {
                Family::Stripes(Stripes::new(areas))
            })?,
            "blobs" => read_smooth(stage, Some(Blobs::AREAS), |areas| Family::Blobs(Blobs::new(areas)))?,
            "curves" => read_smooth(stage, None, |areas| Family::Curves(Curves::new(areas)))?,
            _ => read_small_grid(stage)?,
        };
        let seed = map.required(what, "seed")?.whole("seed", 0, i64::MAX as u64)?;
        Ok(Box::new(SampleStage { groups, seed }))
    }
}

/// A family with one set of parameters, and how many samples of it.
struct Group {
    family: Family,
    /// What distinguishes the group within its family, for the key.
    parameters: Vec<(&'static str, Canonical)>,
    count: u64,
}

struct SampleStage {
    groups: Vec<Group>,
    seed: u64,
}

fn read_area(node: &Node) -> Result<Decimal, InputError> {
    Ok(node.quantity_in("area", Dimension::Number, 0.0, 1.0)?.base())
}

fn refused(node: &Node) -> impl Fn(SampleError) -> InputError + '_ {
    move |error| node.error(error.to_string())
}

fn read_small_grid(stage: &Node) -> Result<Vec<Group>, InputError> {
    let what = "a small-grid sample";
    let map = stage.fields(what, &["kind", "family", "count", "area", "seed"])?;
    map.required(what, "family")?;
    let area = map
        .optional("area")
        .map_or(Ok(Decimal::from_f64(0.5).unwrap_or(Decimal::ZERO)), read_area)?;
    let family = SmallGrid::new(area.to_f64()).map_err(refused(map.optional("area").unwrap_or(stage)))?;
    let count = map.required(what, "count")?.whole("count", 1, MAX_COUNT)?;
    Ok(vec![Group {
        family: Family::SmallGrid(family),
        parameters: vec![("area", area.into())],
        count,
    }])
}

fn read_bezier(stage: &Node) -> Result<Vec<Group>, InputError> {
    let what = "a bezier sample";
    let map = stage.fields(what, &["kind", "family", "count", "area", "ends", "seed"])?;
    let word = map
        .optional("ends")
        .map_or(Ok("opposite"), |n| n.word("ends", &["opposite", "any"]))?;
    let ends = if word == "any" { Ends::Any } else { Ends::Opposite };
    let area = map.optional("area").map(read_area).transpose()?;
    let family =
        Bezier::new(area.map(Decimal::to_f64), ends).map_err(refused(map.optional("area").unwrap_or(stage)))?;
    let count = map.required(what, "count")?.whole("count", 1, MAX_COUNT)?;
    let parameters = vec![
        ("area", area.map_or(Canonical::Null, Canonical::from)),
        ("ends", word.into()),
    ];
    Ok(vec![Group {
        family: Family::Bezier(family),
        parameters,
        count,
    }])
}

fn read_area_sweep(stage: &Node) -> Result<Vec<Group>, InputError> {
    let what = "an area-sweep sample";
    let map = stage.fields(what, &["kind", "family", "count", "area", "seed"])?;
    let range = match map.optional("area") {
        Some(node) => {
            node.list("area")?;
            read_areas(node)?
        }
        None => [5, 95].map(|percent| Decimal::from(percent).scaled(-2)),
    };
    let [low, high] = range.map(Decimal::to_f64);
    let family = AreaSweep::new(low, high).map_err(refused(map.optional("area").unwrap_or(stage)))?;
    let count = map.required(what, "count")?.whole("count", 1, MAX_COUNT)?;
    Ok(vec![Group {
        family: Family::AreaSweep(family),
        parameters: vec![("area", range.into_iter().collect())],
        count,
    }])
}

/// The families that have area fractions, one or a range, as their only parameter.
fn read_smooth(
    stage: &Node,
    usual: Option<Areas>,
    family: fn(Option<Areas>) -> Family,
) -> Result<Vec<Group>, InputError> {
    let what = "a sample of this family";
    let map = stage.fields(what, &["kind", "family", "count", "area", "seed"])?;
    let decimals = |areas: Areas| areas.ends().map(|end| Decimal::from_f64(end).unwrap_or(Decimal::ZERO));
    let range = match map.optional("area") {
        Some(node) => Some(read_areas(node)?),
        None => usual.map(decimals),
    };
    let areas = range.map(|[low, high]| Areas::new(low.to_f64(), high.to_f64()));
    let areas = areas
        .transpose()
        .map_err(refused(map.optional("area").unwrap_or(stage)))?;
    let count = map.required(what, "count")?.whole("count", 1, MAX_COUNT)?;
    let range = range.map_or(Canonical::Null, |range| range.into_iter().collect());
    Ok(vec![Group {
        family: family(areas),
        parameters: vec![("area", range)],
        count,
    }])
}

/// One area fraction, or the smallest and the largest.
fn read_areas(node: &Node) -> Result<[Decimal; 2], InputError> {
    match node.list("area") {
        Ok([low, high]) => Ok([read_area(low)?, read_area(high)?]),
        Ok(_) => Err(node.error("`area` must have two ends").help("for example [0.05, 0.95]")),
        Err(_) => Ok([read_area(node)?; 2]),
    }
}

fn read_large_grid(stage: &Node) -> Result<Vec<Group>, InputError> {
    let what = "a large-grid sample";
    let map = stage.fields(what, &["kind", "family", "units", "count_per_units", "seed"])?;
    let count = map
        .required(what, "count_per_units")?
        .whole("count_per_units", 1, MAX_COUNT)?;
    let units = map.required(what, "units")?;
    let mut seen = Vec::new();
    let mut groups = Vec::new();
    for node in units.list("units")? {
        let n = node.whole("units", 2, CELLS as u64)?;
        if seen.contains(&n) {
            return Err(node.error(format!("`units` names {n} twice")));
        }
        seen.push(n);
        let family = Family::LargeGrid(LargeGrid::new(n as usize).map_err(refused(node))?);
        // Families with few patterns give all of them.
        let count = family.available().map_or(count, |available| available.min(count));
        groups.push(Group {
            family,
            parameters: vec![("units", n.into())],
            count,
        });
    }
    if groups.is_empty() {
        return Err(units.error("`units` is empty").help("for example [2, 3, 4]"));
    }
    // The order of the list means nothing, so it must not change the artifact.
    groups.sort_by_key(Group::units);
    Ok(groups)
}

impl Group {
    fn chunks(&self) -> impl Iterator<Item = Range<u64>> {
        let count = self.count;
        (0..count.div_ceil(CHUNK)).map(move |i| i * CHUNK..((i + 1) * CHUNK).min(count))
    }

    fn chunk_parameters(&self, seed: u64, range: &Range<u64>) -> Canonical {
        let common = [
            ("family", Canonical::from(self.family.name())),
            ("seed", seed.into()),
            ("start", range.start.into()),
            ("count", (range.end - range.start).into()),
        ];
        Canonical::map(common.into_iter().chain(self.parameters.iter().cloned()))
    }

    fn units(&self) -> u64 {
        match &self.family {
            Family::LargeGrid(grid) => grid.units() as u64,
            _ => 0,
        }
    }
}

impl Stage for SampleStage {
    fn parameters(&self) -> Canonical {
        let groups = self.groups.iter().map(|group| {
            let own = group.parameters.iter().cloned();
            let family = ("family", Canonical::from(group.family.name()));
            Canonical::map(own.chain([family, ("count", group.count.into())]))
        });
        match groups.collect::<Vec<_>>() {
            // One group is the usual case, and its parameters read better without an index.
            mut single if single.len() == 1 => match single.remove(0) {
                Canonical::Map(mut map) => {
                    map.insert("seed".to_owned(), self.seed.into());
                    Canonical::Map(map)
                }
                other => other,
            },
            many => {
                let by_units = many
                    .into_iter()
                    .zip(&self.groups)
                    .map(|(g, group)| (group.units().to_string(), g));
                Canonical::map([("units", Canonical::map(by_units)), ("seed", self.seed.into())])
            }
        }
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        let chunk = |group: &Group, range: Range<u64>| Chunk {
            parameters: group.chunk_parameters(self.seed, &range),
            inputs: Vec::new(),
            samples: range.end - range.start,
        };
        Plan::Chunks(
            self.groups
                .iter()
                .flat_map(|g| g.chunks().map(move |r| chunk(g, r)))
                .collect(),
        )
    }

    fn pieces(&self, _inputs: u64) -> u64 {
        self.groups.iter().map(|group| group.count.div_ceil(CHUNK)).sum()
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let (group, range) = job
            .chunk
            .and_then(|chunk| self.find(&chunk.parameters))
            .ok_or_else(|| StageError::Failed("the chunk is not one of this stage's".to_owned()))?;
        let draw = |i| {
            group
                .family
                .sample(self.seed, i)
                .map_err(|e| StageError::Failed(e.to_string()))
        };
        let patterns = range
            .clone()
            .into_par_iter()
            .map(draw)
            .collect::<Result<Vec<Pattern>, _>>()?;
        job.progress.advance(patterns.len() as u64);
        Ok(samples(group, range, patterns).object())
    }
}

impl SampleStage {
    /// The group and the range of a chunk: found by where it starts, since there may be a hundred thousand of them.
    fn find(&self, chunk: &Canonical) -> Option<(&Group, Range<u64>)> {
        let Canonical::Map(parameters) = chunk else {
            return None;
        };
        let Some(Canonical::Number(start, _)) = parameters.get("start") else {
            return None;
        };
        let start = start.to_u64()?;
        let mut groups = self.groups.iter().filter(|group| start < group.count);
        groups.find_map(|group| {
            let range = start..(start + CHUNK).min(group.count);
            (group.chunk_parameters(self.seed, &range) == *chunk).then_some((group, range))
        })
    }
}

fn samples(group: &Group, range: Range<u64>, patterns: Vec<Pattern>) -> Samples {
    let n = patterns.len();
    Samples {
        area: patterns.iter().map(Pattern::area_fraction).collect(),
        rows: SampleRows {
            family: vec![group.family.name().to_owned(); n],
            index: range.collect(),
            units: vec![group.units(); n],
            patterns,
        },
    }
}
