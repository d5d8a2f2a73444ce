//! What a family of patterns is, and the table of those that there are.
//!
//! A family stands in one file: its parameters, declared once, and how a sample is drawn. The table names it; readers,
//! schemas and stages work with any table, so a program may add families of its own to these.

use std::fmt;
use std::marker::PhantomData;

use super::canvas::Canvas;
use super::error::SampleError;
use deaflow_base::{Canonical, Declared, Fields, InputError, Map, Node};
use deaflow_pattern::Pattern;

/// A family of electrode patterns with its parameters.
pub trait Family: fmt::Debug + Send + Sync {
    /// The word that stands in pipelines and files.
    fn name(&self) -> &'static str;

    /// Sample `index` under a seed: a function of the family, its parameters, the seed and the index alone.
    ///
    /// # Errors
    /// When the family has no more than `index` samples.
    fn sample(&self, seed: u64, index: u64) -> Result<Pattern, SampleError>;

    /// How many samples there are; `None` when there is no end to them.
    fn available(&self) -> Option<u64> {
        None
    }

    /// Units across the membrane, where patterns are made of units; 0 elsewhere.
    fn units(&self) -> u64 {
        0
    }
}

/// More samples than this in one stage are a slip of the pen.
pub const MOST_SAMPLES: u64 = 10_000_000;

/// Samples of a family with one set of parameters.
#[derive(Debug)]
pub struct SampleGroup {
    /// The family.
    pub family: Box<dyn Family>,
    /// How many samples.
    pub count: u64,
    /// The parameters that distinguish the group within its family, for keys.
    pub parameters: Vec<(&'static str, Canonical)>,
}

/// Parameters that no family can be made of.
#[derive(Debug)]
pub struct FamilyError {
    /// The key that is to blame.
    pub key: &'static str,
    /// Why.
    pub error: SampleError,
}

impl FamilyError {
    /// Blames a key.
    pub fn of(key: &'static str) -> impl Fn(SampleError) -> Self {
        move |error| Self { key, error }
    }
}

/// The declared parameters of a family, as a stage gives them.
pub trait FamilyParameters: Declared {
    /// The word after `family:`.
    const NAME: &'static str;

    /// What is to be drawn on a canvas.
    ///
    /// # Errors
    /// When a value leaves nothing to draw.
    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, FamilyError>;

    /// Whether the family may have drawn a pattern, with whatever parameters: false only where it cannot.
    #[must_use]
    fn admits(_pattern: &Pattern) -> bool {
        true
    }

    /// A single group: all parameters but the count distinguish it.
    fn one_group(&self, count: u64, family: Box<dyn Family>) -> Vec<SampleGroup> {
        let mut parameters = Vec::new();
        self.entries(&mut parameters);
        parameters.retain(|(key, _)| *key != "count");
        vec![SampleGroup {
            family,
            count,
            parameters,
        }]
    }
}

/// An entry of the table of families.
pub trait FamilyEntry: Sync {
    /// The word after `family:`.
    fn name(&self) -> &'static str;

    /// Its keys.
    fn keys(&self) -> Vec<&'static str>;

    /// What its keys may hold.
    fn fields(&self) -> Fields;

    /// Whether the family may have drawn a pattern, with whatever parameters: false only where it cannot.
    fn admits(&self, pattern: &Pattern) -> bool;

    /// Reads its keys from a mapping that may have `others` beside them, for patterns on a canvas.
    ///
    /// # Errors
    /// When a key is unknown or missing, or a value leaves nothing to draw.
    fn read(&self, node: &Node, others: &[&str], canvas: Canvas) -> Result<Vec<SampleGroup>, InputError>;
}

/// The entry of a family by its parameters.
pub struct FamilyOf<P>(PhantomData<fn() -> P>);

impl<P> FamilyOf<P> {
    /// The entry.
    pub const NEW: Self = Self(PhantomData);
}

impl<P: FamilyParameters> FamilyEntry for FamilyOf<P> {
    fn name(&self) -> &'static str {
        P::NAME
    }

    fn keys(&self) -> Vec<&'static str> {
        P::keys()
    }

    fn fields(&self) -> Fields {
        P::fields()
    }

    fn admits(&self, pattern: &Pattern) -> bool {
        P::admits(pattern)
    }

    fn read(&self, node: &Node, others: &[&str], canvas: Canvas) -> Result<Vec<SampleGroup>, InputError> {
        let parameters = P::read_with(node, others)?;
        parameters
            .groups(canvas)
            .map_err(|refusal| node.peek(refusal.key).unwrap_or(node).error(refusal.error.to_string()))
    }
}

/// The families that there are.
pub static FAMILIES: &[&dyn FamilyEntry] = &[
    &FamilyOf::<super::small_grid::SmallGridParameters>::NEW,
    &FamilyOf::<super::large_grid::LargeGridParameters>::NEW,
    &FamilyOf::<super::bezier::BezierParameters>::NEW,
    &FamilyOf::<super::area_sweep::AreaSweepParameters>::NEW,
    &FamilyOf::<super::stripes::StripesParameters>::NEW,
    &FamilyOf::<super::blobs::BlobsParameters>::NEW,
    &FamilyOf::<super::curves::CurvesParameters>::NEW,
    &FamilyOf::<super::checker::CheckerParameters>::NEW,
    &FamilyOf::<super::dithers::DithersParameters>::NEW,
    &FamilyOf::<super::mazes::MazesParameters>::NEW,
    &FamilyOf::<super::diagonals::DiagonalsParameters>::NEW,
    &FamilyOf::<super::spirals::SpiralsParameters>::NEW,
    &FamilyOf::<super::glyphs::GlyphsParameters>::NEW,
];

/// Reads the samples on a canvas that a mapping with the key `family` asks for, from a table of families, and gives the mapping too:
/// `others` may stand beside the keys of the family.
///
/// # Errors
/// When it names none of the families, or as [`FamilyEntry::read`].
pub fn read_family<'n>(
    table: &[&dyn FamilyEntry],
    node: &'n Node,
    what: &str,
    others: &[&str],
    canvas: Canvas,
) -> Result<(Map<'n>, Vec<SampleGroup>), InputError> {
    let names: Vec<&str> = table.iter().map(|entry| entry.name()).collect();
    // First the keys of all families, so that a misspelt `family` is told from a missing one; then those of the family.
    let others: Vec<&str> = ["family"].into_iter().chain(others.iter().copied()).collect();
    let mut keys = others.clone();
    keys.extend(table.iter().flat_map(|entry| entry.keys()));
    let map = node.fields(what, &keys)?;
    let name = map.required(what, "family")?.word("family", &names)?;
    let entry = table.iter().find(|entry| entry.name() == name);
    let groups = entry.map_or_else(|| Ok(Vec::new()), |entry| entry.read(node, &others, canvas))?;
    Ok((map, groups))
}
