//! The test patterns of a screening.

use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// A test pattern of a screening.
#[derive(Clone, Debug, PartialEq)]
pub struct TestPattern {
    /// Its name in the rows.
    pub name: String,
    /// The pattern.
    pub pattern: Pattern,
    /// The pattern as drawn, where cells stand for shapes.
    pub drawing: Option<Pattern>,
    /// Whether its critical voltage is searched for, which is the expensive part.
    pub find_critical_voltage: bool,
}

impl TestPattern {
    /// Creates a test pattern for all checks.
    #[must_use]
    pub fn new(name: &str, pattern: Pattern) -> Self {
        Self {
            name: name.to_owned(),
            pattern,
            drawing: None,
            find_critical_voltage: true,
        }
    }

    /// Adds the pattern as drawn, where cells stand for shapes.
    #[must_use]
    pub fn drawn(self, drawing: Pattern) -> Self {
        Self {
            drawing: Some(drawing),
            ..self
        }
    }

    /// Returns some of the patterns, evenly spaced, named after a word and their position: `pattern 0`.
    #[must_use]
    pub fn some_of(patterns: &[Pattern], word: &str) -> Vec<Self> {
        let count = patterns.len().min(MAX_GIVEN);
        (0..count)
            .map(|i| i * patterns.len() / count)
            .map(|at| Self::new(&format!("{word} {at}"), patterns[at].clone()))
            .collect()
    }
}

/// Largest number of given patterns that effects are compared on.
const MAX_GIVEN: usize = 4;

/// Returns a pattern with electrodes of the group with the highest voltage.
fn pattern(scene: &Scene, cells: impl Fn(usize, usize) -> bool) -> Pattern {
    let group = scene.strongest_group();
    Pattern::from_groups(scene.membrane().raster, |x, y| if cells(x, y) { group } else { 0 })
}

fn half_plane(scene: &Scene) -> TestPattern {
    let [columns, _] = scene.membrane().raster.sides();
    TestPattern::new("half plane", pattern(scene, |x, _| x < columns / 2))
}

fn middle(scene: &Scene) -> (usize, usize) {
    let [columns, rows] = scene.membrane().raster.sides();
    (columns / 2, rows / 2)
}

fn one_cell(scene: &Scene) -> TestPattern {
    let middle = middle(scene);
    TestPattern::new("one cell", pattern(scene, |x, y| (x, y) == middle))
}

/// Returns the default test patterns: half of the membrane, a single cell, the whole membrane, a disc with a radius of
/// 0.3 times the shorter side, a chessboard of five by five blocks, and all but a single cell. Their electrodes belong
/// to the group with the highest voltage.
#[must_use]
pub fn reference_patterns(scene: &Scene) -> Vec<TestPattern> {
    let membrane = scene.membrane();
    let ([width, height], [columns, rows]) = (membrane.size_mm, membrane.raster.sides());
    let from_centre = |x: usize, y: usize| {
        let [x, y] = membrane.centre_mm(x, y);
        (x - 0.5 * width).hypot(y - 0.5 * height)
    };
    let radius = 0.3 * width.min(height);
    let middle = middle(scene);
    vec![
        half_plane(scene),
        one_cell(scene),
        TestPattern::new("all active", pattern(scene, |_, _| true)),
        TestPattern::new("disc", pattern(scene, |x, y| from_centre(x, y) < radius)),
        TestPattern::new(
            "blocks",
            pattern(scene, |x, y| (5 * x / columns + 5 * y / rows).is_multiple_of(2)),
        ),
        TestPattern::new("one hole", pattern(scene, |x, y| (x, y) != middle)),
    ]
}
