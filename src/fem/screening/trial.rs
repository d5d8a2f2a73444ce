//! The patterns that a scene is screened with.

use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// A pattern that a scene is screened with.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Its name in the rows.
    pub name: String,
    /// The pattern.
    pub pattern: Pattern,
    /// Whether the voltage at which its stability is lost is searched for; that is the dear part.
    pub to_the_limit: bool,
    /// Whether solutions with each effect are compared with solutions without it.
    pub compared: bool,
}

impl Trial {
    /// A pattern that is screened in every respect.
    #[must_use]
    pub fn new(name: &str, pattern: Pattern) -> Self {
        Self {
            name: name.to_owned(),
            pattern,
            to_the_limit: true,
            compared: true,
        }
    }
}

/// A pattern of the group of electrodes that has the highest voltage.
fn drawn(scene: &Scene, cells: impl Fn(usize, usize) -> bool) -> Pattern {
    let group = scene.strongest_group();
    Pattern::from_groups(scene.membrane().raster, |x, y| if cells(x, y) { group } else { 0 })
}

fn half_plane(scene: &Scene) -> Trial {
    let [columns, _] = scene.membrane().raster.sides();
    Trial::new("half plane", drawn(scene, |x, _| x < columns / 2))
}

fn middle(scene: &Scene) -> (usize, usize) {
    let [columns, rows] = scene.membrane().raster.sides();
    (columns / 2, rows / 2)
}

fn one_cell(scene: &Scene) -> Trial {
    let middle = middle(scene);
    Trial::new("one cell", drawn(scene, |x, y| (x, y) == middle))
}

/// The patterns that a scene is screened with: all of the membrane, half of it, a disc of 0.3 times the shorter side, five blocks by five
/// like a chessboard, a single cell, and all but a single cell. Their electrodes are of the group with the highest voltage.
#[must_use]
pub fn reference_patterns(scene: &Scene) -> Vec<Trial> {
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
        Trial::new("all active", drawn(scene, |_, _| true)),
        Trial::new("disc", drawn(scene, |x, y| from_centre(x, y) < radius)),
        Trial::new(
            "blocks",
            drawn(scene, |x, y| (5 * x / columns + 5 * y / rows).is_multiple_of(2)),
        ),
        Trial::new("one hole", drawn(scene, |x, y| (x, y) != middle)),
    ]
}

/// The two of the reference patterns that go furthest: half of the membrane, which moves most, and a single cell, whose
/// stability is lost first. They are what a run is watched with: it costs some tens of milliseconds.
#[must_use]
pub fn watch_patterns(scene: &Scene) -> Vec<Trial> {
    let half = Trial {
        to_the_limit: false,
        ..half_plane(scene)
    };
    vec![half, one_cell(scene)]
}

/// The most of somebody's own patterns that a run is watched with.
const OWN: usize = 4;

/// Patterns that are about to be simulated, some of them where they are many, instead of those that effects are compared on in
/// [`watch_patterns`].
#[must_use]
pub fn watch_patterns_with(scene: &Scene, own: &[Pattern]) -> Vec<Trial> {
    let count = own.len().min(OWN);
    let named = (0..count).map(|i| i * own.len() / count).map(|at| Trial {
        to_the_limit: false,
        ..Trial::new(&format!("pattern {at}"), own[at].clone())
    });
    let extreme = watch_patterns(scene).into_iter().map(|trial| Trial {
        compared: own.is_empty(),
        ..trial
    });
    named.chain(extreme).collect()
}
