//! `kind: sample` draws electrode patterns of one family.

use std::ops::Range;

use rayon::prelude::*;

use super::results;
use crate::base::{Canonical, Fields, InputError, Node, Parameter, Seed};
use crate::content::{SampleRows, Samples};
use crate::orchestrator::{Chunk, Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::pattern::Pattern;
use crate::sample::{Canvas, FAMILIES, FamilyEntry, Group, read_family};
use crate::store::{Artifact, Object};

/// Samples in a chunk: small enough that a killed run loses seconds, large enough that a file is worth opening.
pub const CHUNK: u64 = 50;

/// The kind `sample`.
pub struct SampleKind;

impl Kind for SampleKind {
    fn name(&self) -> &'static str {
        "sample"
    }

    fn recipe(&self) -> u32 {
        2
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        results::of_samples(artifact)
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &[],
            least: 0,
            most: 0,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let fields = |entry: &&dyn FamilyEntry| {
            let says = "Names the random numbers.";
            let fields = entry.fields().tagged("family", entry.name());
            fields.declare::<Seed>("seed", says, &(), None)
        };
        FAMILIES.iter().map(fields).collect()
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let what = "a sample stage";
        let canvas = super::membrane_of(scene)?.map_or(Canvas::PAPER, |membrane| Canvas::of(&membrane));
        let (map, mut groups) = read_family(FAMILIES, stage, what, &["kind", "seed"], canvas)?;
        for group in &mut groups {
            group.parameters.extend(canvas.parameters());
        }
        let Seed(seed) = Seed::read(map.required(what, "seed")?, "seed", &())?;
        Ok(Box::new(SampleStage { groups, seed }))
    }
}

struct SampleStage {
    groups: Vec<Group>,
    seed: u64,
}

/// The pieces of a group: numbers of samples.
fn chunks(group: &Group) -> impl Iterator<Item = Range<u64>> {
    let count = group.count;
    (0..count.div_ceil(CHUNK)).map(move |i| i * CHUNK..((i + 1) * CHUNK).min(count))
}

fn chunk_parameters(group: &Group, seed: u64, range: &Range<u64>) -> Canonical {
    let common = [
        ("family", Canonical::from(group.family.name())),
        ("seed", seed.into()),
        ("start", range.start.into()),
        ("count", (range.end - range.start).into()),
    ];
    Canonical::map(common.into_iter().chain(group.parameters.iter().cloned()))
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
                    .map(|(g, group)| (group.family.units().to_string(), g));
                Canonical::map([("units", Canonical::map(by_units)), ("seed", self.seed.into())])
            }
        }
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        let chunk = |group: &Group, range: Range<u64>| Chunk {
            parameters: chunk_parameters(group, self.seed, &range),
            inputs: Vec::new(),
            samples: range.end - range.start,
        };
        Plan::Chunks(
            self.groups
                .iter()
                .flat_map(|group| chunks(group).map(move |range| chunk(group, range)))
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
            (chunk_parameters(group, self.seed, &range) == *chunk).then_some((group, range))
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
            units: vec![group.family.units(); n],
            patterns,
        },
    }
}
