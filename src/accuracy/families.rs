//! The patterns on which methods are measured: the families of the pipelines, and families with large errors on coarse
//! meshes, such as single cells and dithers. A bound only holds for families that were measured.

use std::collections::BTreeMap;

use deaflow_base::Stream;
use deaflow_pattern::Pattern;
use deaflow_sample::{
    Areas, Bezier, Blobs, Canvas, Checker, Diagonals, Dithers, Ends, Family, Glyphs, LargeGrid, Mazes, SampleError,
    SmallGrid, Spirals, Stripes,
};

/// Patterns by the name of their family.
pub type Families = BTreeMap<String, Vec<Pattern>>;

/// Returns given patterns as a family of their own.
#[must_use]
pub fn given(patterns: Vec<Pattern>) -> Families {
    BTreeMap::from([("given".to_owned(), patterns)])
}

/// Units across the membrane of the large grids, as in the source paper.
const UNITS: [usize; 9] = [2, 3, 4, 5, 6, 7, 8, 9, 10];

/// Area fractions of stripes.
const STRIPED: [f64; 2] = [0.4, 0.6];

/// Draws `count` patterns of each family on a canvas: small grids, large grids of 2 to 10 units, Bézier curves,
/// stripes, blobs, checkers, dithers, mazes, diagonals, spirals, glyphs, and single cells. There may be fewer large
/// grids, since some have fewer patterns.
///
/// # Errors
/// When the canvas has fewer cells than a family needs.
pub fn drawn(canvas: &Canvas, count: u64, seed: u64) -> Result<Families, SampleError> {
    let of_family = |family: &dyn Family| -> Result<Vec<Pattern>, SampleError> {
        (0..count).map(|i| family.sample(seed, i)).collect()
    };
    let families = [
        ("small-grid", of_family(&SmallGrid::new(canvas.clone(), 0.5)?)?),
        ("large-grid", large_grids(canvas, count, seed)?),
        (
            "bezier",
            of_family(&Bezier::new(canvas.clone(), None, Ends::Opposite)?)?,
        ),
        (
            "stripes",
            of_family(&Stripes::new(Areas::new(canvas.clone(), STRIPED[0], STRIPED[1])?))?,
        ),
        ("blobs", of_family(&Blobs::new(Areas::new(canvas.clone(), 0.3, 0.7)?))?),
        (
            "checker",
            of_family(&Checker::new(Areas::new(canvas.clone(), 0.3, 0.7)?))?,
        ),
        (
            "dithers",
            of_family(&Dithers::new(Areas::new(canvas.clone(), 0.3, 0.7)?))?,
        ),
        ("mazes", of_family(&Mazes::new(canvas.clone()))?),
        ("diagonals", of_family(&Diagonals::new(canvas.clone()))?),
        (
            "spirals",
            of_family(&Spirals::new(Areas::new(canvas.clone(), 0.2, 0.8)?))?,
        ),
        ("glyphs", of_family(&Glyphs::new(canvas.clone()))?),
        (
            "single-cell",
            (0..count).map(|i| single_cell(canvas, seed, i)).collect(),
        ),
    ];
    Ok(families
        .into_iter()
        .map(|(name, patterns)| (name.to_owned(), patterns))
        .collect())
}

fn large_grids(canvas: &Canvas, count: u64, seed: u64) -> Result<Vec<Pattern>, SampleError> {
    let mut patterns = Vec::new();
    for i in 0..count {
        let (units, index) = (UNITS[i as usize % UNITS.len()], i / UNITS.len() as u64);
        let family = LargeGrid::new(canvas.clone(), units)?;
        if family.available().is_none_or(|available| index < available) {
            patterns.push(family.sample(seed, index)?);
        }
    }
    Ok(patterns)
}

fn single_cell(canvas: &Canvas, seed: u64, index: u64) -> Pattern {
    let mut stream = Stream::new(seed, "single cell", index);
    let cell = canvas.raster().sides().map(|count| stream.index(count));
    Pattern::from_fn(canvas.raster(), |x, y| [x, y] == cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_are_complete_and_a_function_of_the_seed() {
        let families = drawn(&Canvas::PAPER, 20, 1).unwrap();
        let counts: Vec<(&str, usize)> = families.iter().map(|(name, p)| (name.as_str(), p.len())).collect();
        let expected = [
            "bezier",
            "blobs",
            "checker",
            "diagonals",
            "dithers",
            "glyphs",
            "large-grid",
            "mazes",
            "single-cell",
            "small-grid",
            "spirals",
            "stripes",
        ];
        let expected = expected.map(|name| (name, 20));
        assert_eq!(counts, expected);
        assert!(families["single-cell"].iter().all(|p| p.active_cells() == 1));
        assert!(
            families["stripes"]
                .iter()
                .all(|p| (1000..=1500).contains(&p.active_cells()))
        );
        assert_eq!(families, drawn(&Canvas::PAPER, 20, 1).unwrap());
        assert_ne!(families, drawn(&Canvas::PAPER, 20, 2).unwrap());
        assert!(
            drawn(&Canvas::PAPER, 100, 1).unwrap()["large-grid"].len() < 100,
            "there are six grids of 2 × 2 units"
        );
    }
}
