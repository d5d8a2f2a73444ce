//! `kind: sample` draws electrode patterns of one family.

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;

use super::results;
use deaflow_base::{Canonical, DigestWriter, Fields, InputError, Map, Node, Parameter, Seed};
use deaflow_content::{SampleRows, Samples};
use deaflow_orchestrator::{Chunk, Input, Job, Kind, Plan, Stage, StageDeclaration, StageError};
use deaflow_pattern::{Bits, Pattern};
use deaflow_sample::{Canvas, FAMILIES, Family, FamilyEntry, SampleError, SampleGroup, read_family};
use deaflow_scene::{Outline, Scene};
use deaflow_store::{Artifact, Object};

/// Samples per chunk: few enough that a killed run loses only seconds of work, many enough that the overhead of a file
/// is negligible.
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

    fn separate_cost_parameters(&self) -> &'static [&'static str] {
        &["family"]
    }

    fn as_written(&self, both: [&Canonical; 2]) -> [Canonical; 2] {
        let written = both.map(UnitGroups::of);
        if let [Some(now), Some(then)] = &written {
            let changed = now.changes_counts(then);
            return [now.written(changed), then.written(changed)];
        }
        let [now, then] = written;
        [(now, both[0]), (then, both[1])].map(|(written, as_is)| match written {
            Some(groups) => groups.written(true),
            None => as_is.clone(),
        })
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        results::of_samples(artifact)
    }

    fn schema(&self) -> Vec<Fields> {
        let fields = |entry: &&dyn FamilyEntry| {
            let description = "Seed of the random numbers.";
            let fields = entry.fields().tagged("family", entry.name());
            let fields = fields.declare::<Seed>("seed", description, &(), None);
            fields.declare::<usize>("groups", "Groups of electrodes.", &GROUPS, Some(1))
        };
        FAMILIES.iter().map(fields).collect()
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let what = WHAT;
        let (canvas, free) = canvas_of(scene)?;
        let (map, mut groups) = read_family(FAMILIES, stage, what, &OWN_KEYS, canvas.clone())?;
        for group in &mut groups {
            group.parameters.extend(canvas.parameters());
        }
        let electrodes = Electrodes::read(&map, what, scene, free)?;
        for group in &mut groups {
            group.parameters.extend(electrodes.parameters());
        }
        let Seed(seed) = Seed::read(map.required(what, "seed")?, "seed", &())?;
        Ok(Box::new(SampleStage {
            groups,
            seed,
            electrodes,
        }))
    }
}

/// The parameters of a stage whose family draws patterns for several numbers of units.
struct UnitGroups<'a> {
    /// The number of units of each group with its parameters, by rising number.
    groups: Vec<(u64, &'a BTreeMap<String, Canonical>)>,
    /// The parameters of the whole stage.
    common: Vec<(&'a String, &'a Canonical)>,
    /// The key of the number of patterns of each group.
    count_key: &'static str,
}

impl<'a> UnitGroups<'a> {
    /// Finds them in the parameters of a stage; `None` for other families.
    fn of(parameters: &'a Canonical) -> Option<Self> {
        let Canonical::Map(all) = parameters else { return None };
        let (each, common): (Vec<&Canonical>, _) = match all.get("units") {
            Some(Canonical::Map(groups)) => {
                let common = all.iter().filter(|(key, _)| *key != "units");
                (groups.values().collect(), common.collect())
            }
            _ => (vec![parameters], Vec::new()),
        };
        let group = |parameters: &'a Canonical| match parameters {
            Canonical::Map(own) => Some((integer(own.get("units")?)?, own)),
            _ => None,
        };
        let mut groups: Vec<_> = each.into_iter().map(group).collect::<Option<_>>()?;
        groups.sort_by_key(|(units, _)| *units);
        let Some(Canonical::Text(family)) = groups.first()?.1.get("family") else {
            return None;
        };
        let entry = FAMILIES.iter().find(|entry| entry.name() == family)?;
        Some(Self {
            groups,
            common,
            count_key: entry.keys().into_iter().find(|key| key.starts_with("count_"))?,
        })
    }

    /// Returns whether a number of units that both have has another number of patterns, or both have none in common.
    /// There may be fewer patterns of few units than are wanted.
    fn changes_counts(&self, other: &Self) -> bool {
        let counts = |(units, own): &(u64, &BTreeMap<String, Canonical>)| {
            let (_, theirs) = other.groups.iter().find(|(known, _)| known == units)?;
            Some(own.get("count") != theirs.get("count"))
        };
        let differ: Vec<bool> = self.groups.iter().filter_map(counts).collect();
        differ.is_empty() || differ.contains(&true)
    }

    /// Returns the parameters by the keys of a pipeline; without the number of patterns if that has not changed.
    fn written(&self, with_count: bool) -> Canonical {
        let units = self.groups.iter().map(|(units, _)| Canonical::from(*units));
        let counts = self.groups.iter().filter_map(|(_, own)| integer(own.get("count")?));
        let count = counts.max().filter(|_| with_count);
        let own = self.groups.iter().take(1).flat_map(|(_, own)| own.iter());
        let own = own.filter(|(key, _)| !["units", "count"].contains(&key.as_str()));
        let all = own.chain(self.common.iter().copied());
        let all = all.map(|(key, value)| (key.clone(), value.clone()));
        let keys = [("units".to_owned(), units.collect())];
        let count = count.map(|count| (self.count_key.to_owned(), count.into()));
        Canonical::map(all.chain(keys).chain(count))
    }
}

/// Returns an integer of canonical parameters.
fn integer(value: &Canonical) -> Option<u64> {
    match value {
        Canonical::Number(number, _) => number.to_string().parse().ok(),
        _ => None,
    }
}

const WHAT: &str = "a sample stage";

/// The keys beside those of the family.
const OWN_KEYS: [&str; 3] = ["kind", "seed", "groups"];

/// Returns the canvas of a scene, and the cells that may carry electrodes, if there are frames or bodies.
fn canvas_of(scene: Option<&Node>) -> Result<(Canvas, Option<Bits>), InputError> {
    let canvas = scene
        .map(Outline::read)
        .transpose()?
        .map_or(Canvas::PAPER, |outline| Canvas::of(&outline.membrane));
    let free = scene.map(Outline::free_cells).transpose()?.flatten();
    Ok((canvas.with_free(free.clone()), free))
}

/// Returns the number of patterns of each family that a stage will draw; `None` if its mapping is invalid.
pub fn drawn(stage: &StageDeclaration<'_>) -> Option<BTreeMap<String, u64>> {
    let (canvas, _) = canvas_of(stage.scene).ok()?;
    let (_, groups) = read_family(FAMILIES, stage.node, WHAT, &OWN_KEYS, canvas).ok()?;
    let mut counts = BTreeMap::new();
    for group in groups {
        *counts.entry(group.family.name().to_owned()).or_default() += group.count;
    }
    Some(counts)
}

struct SampleStage {
    groups: Vec<SampleGroup>,
    seed: u64,
    electrodes: Electrodes,
}

const GROUPS: std::ops::RangeInclusive<u64> = 1..=Pattern::MOST_GROUPS as u64;

/// How the patterns of a family become electrodes.
struct Electrodes {
    /// Number of groups of electrodes.
    groups: u64,
    /// The cells that may carry electrodes, if there are frames or bodies.
    free: Option<Bits>,
}

impl Electrodes {
    fn read(map: &Map<'_>, what: &str, scene: Option<&Node>, free: Option<Bits>) -> Result<Self, InputError> {
        let groups: usize = map.read(what, "groups", &GROUPS, Some(1))?;
        let outline = scene.map(Outline::read).transpose()?;
        let known = outline.map_or(Pattern::MOST_GROUPS, |outline| outline.groups);
        match map.optional("groups") {
            Some(node) if groups > known => Err(node
                .error(format!(
                    "{groups} groups of electrodes, but the scene has voltages for {known}"
                ))
                .help(format!("allowed: 1 to {known}, or more `voltages`"))),
            _ => Ok(Self {
                groups: groups as u64,
                free,
            }),
        }
    }

    /// Returns the parameters for the key; none for one group without frames and bodies.
    fn parameters(&self) -> Vec<(&'static str, Canonical)> {
        let groups = (self.groups > 1).then(|| ("groups", self.groups.into()));
        groups.into_iter().chain(self.free.as_ref().map(room)).collect()
    }

    /// Draws a sample. Its active cells are those of the family's pattern. With several groups, each group but the last
    /// draws a further pattern of the family; a cell belongs to the first group whose pattern is active there, or else
    /// to the last. The numbering of the groups rotates with the index of the sample.
    fn draw(&self, family: &dyn Family, seed: u64, index: u64) -> Result<Pattern, SampleError> {
        /// Distance between the seeds of the groups (2⁶⁴ divided by the golden ratio).
        const SEED_DISTANCE: u64 = 0x9E37_79B9_7F4A_7C15;
        let drawn = family.sample(seed, index)?;
        let more =
            (1..self.groups).map(|group| family.sample(seed.wrapping_add(group.wrapping_mul(SEED_DISTANCE)), index));
        let more: Vec<Pattern> = more.collect::<Result<_, _>>()?;
        if more.is_empty() && self.free.is_none() {
            return Ok(drawn);
        }
        let is_free = |x: usize, y: usize| self.free.as_ref().is_none_or(|free| free.has(x, y));
        Ok(Pattern::from_groups(drawn.raster(), |x, y| {
            if !drawn.is_active(x, y) || !is_free(x, y) {
                return 0;
            }
            let first = more
                .iter()
                .position(|pattern| pattern.is_active(x, y))
                .unwrap_or(more.len());
            ((first as u64 + index) % self.groups) as u8 + 1
        }))
    }
}

/// Returns the parameter for keys of the cells that may carry electrodes.
pub fn room(free: &Bits) -> (&'static str, Canonical) {
    let runs = free.runs().into_iter();
    let runs: Vec<u8> = runs.flat_map(|run| (run as u64).to_le_bytes()).collect();
    let digest = DigestWriter::new().bytes(&runs).finish();
    ("room", digest.to_string().as_str().into())
}

/// Returns the chunks of a group as ranges of samples.
fn chunks(group: &SampleGroup) -> impl Iterator<Item = Range<u64>> {
    let count = group.count;
    (0..count.div_ceil(CHUNK)).map(move |i| i * CHUNK..((i + 1) * CHUNK).min(count))
}

fn chunk_parameters(group: &SampleGroup, seed: u64, range: &Range<u64>) -> Canonical {
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
            // The parameters of a single group, the usual case, are easier to read without an index.
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

    fn revision(&self) -> u32 {
        Scene::area_revision(self.electrodes.free.as_ref())
    }

    fn unit(&self) -> &'static str {
        "patterns"
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        let chunk = |group: &SampleGroup, range: Range<u64>| Chunk {
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
            .ok_or_else(|| StageError::failed("the chunk is not one of this stage's"))?;
        let draw = |i| {
            let drawn = self.electrodes.draw(&*group.family, self.seed, i);
            drawn.map_err(StageError::failed)
        };
        let patterns = range
            .clone()
            .into_par_iter()
            .map(draw)
            .collect::<Result<Vec<Pattern>, _>>()?;
        job.progress.advance(patterns.len() as u64);
        Ok(samples(group, range, patterns, self.electrodes.free.as_ref()).object())
    }
}

impl SampleStage {
    /// Returns the group and the range of a chunk. It is found by its start, because there may be 100,000 chunks.
    fn find(&self, chunk: &Canonical) -> Option<(&SampleGroup, Range<u64>)> {
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

fn samples(group: &SampleGroup, range: Range<u64>, patterns: Vec<Pattern>, free: Option<&Bits>) -> Samples {
    let n = patterns.len();
    Samples {
        area: patterns.iter().map(|pattern| pattern.area_fraction(free)).collect(),
        rows: SampleRows {
            family: vec![group.family.name().to_owned(); n],
            index: range.collect(),
            units: vec![group.family.units(); n],
            electrodes: None,
            covered: None,
            patterns,
        },
    }
}
