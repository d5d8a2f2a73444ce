//! The table of families, how a stage reads it, and whether one of them can have drawn a pattern.

use super::area_sweep::AreaSweepParameters;
use super::bezier::BezierParameters;
use super::blobs::BlobsParameters;
use super::canvas::Canvas;
use super::checker::CheckerParameters;
use super::curves::CurvesParameters;
use super::diagonals::DiagonalsParameters;
use super::dithers::DithersParameters;
use super::family::{FamilyEntry, FamilyOf, SampleGroup};
use super::glyphs::GlyphsParameters;
use super::large_grid::LargeGridParameters;
use super::mazes::MazesParameters;
use super::small_grid::SmallGridParameters;
use super::spirals::SpiralsParameters;
use super::stripes::StripesParameters;
use deaflow_base::{InputError, Map, Node};
use deaflow_pattern::{Pattern, Raster, Symmetry};

/// The families of this crate.
pub static FAMILIES: &[&dyn FamilyEntry] = &[
    &FamilyOf::<SmallGridParameters>::NEW,
    &FamilyOf::<LargeGridParameters>::NEW,
    &FamilyOf::<BezierParameters>::NEW,
    &FamilyOf::<AreaSweepParameters>::NEW,
    &FamilyOf::<StripesParameters>::NEW,
    &FamilyOf::<BlobsParameters>::NEW,
    &FamilyOf::<CurvesParameters>::NEW,
    &FamilyOf::<CheckerParameters>::NEW,
    &FamilyOf::<DithersParameters>::NEW,
    &FamilyOf::<MazesParameters>::NEW,
    &FamilyOf::<DiagonalsParameters>::NEW,
    &FamilyOf::<SpiralsParameters>::NEW,
    &FamilyOf::<GlyphsParameters>::NEW,
];

/// Reads the samples that a mapping with the key `family` describes, for a canvas and a table of families, and returns
/// the mapping too. The mapping may also have the keys `others`.
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
    // First check against the keys of all families, so that a misspelt `family` is not reported as missing.
    let others: Vec<&str> = ["family"].into_iter().chain(others.iter().copied()).collect();
    let mut keys = others.clone();
    keys.extend(table.iter().flat_map(|entry| entry.keys()));
    let map = node.fields(what, &keys)?;
    let name = map.required(what, "family")?.word("family", &names)?;
    let entry = table.iter().find(|entry| entry.name() == name);
    let groups = entry.map_or_else(|| Ok(Vec::new()), |entry| entry.read(node, &others, canvas))?;
    Ok((map, groups))
}

/// Returns whether the family of this name can have drawn a pattern or a symmetric image of it; `None` for another
/// name.
#[must_use]
pub fn admits(family: &str, pattern: &Pattern) -> Option<bool> {
    let entry = FAMILIES.iter().find(|entry| entry.name() == family)?;
    // The side lengths of other membranes are unknown.
    if pattern.raster() != Raster::PAPER {
        return Some(true);
    }
    // Datasets contain images of the samples. Units whose sizes differ by a cell have other positions in an image.
    Some(Symmetry::ALL.into_iter().any(|g| entry.admits(&pattern.transformed(g))))
}
