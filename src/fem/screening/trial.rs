//! The patterns that a scene is screened with.

use crate::pattern::{Membrane, Pattern};

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

fn half_plane(membrane: &Membrane) -> Trial {
    let [columns, _] = membrane.raster.sides();
    Trial::new("half plane", Pattern::from_fn(membrane.raster, |x, _| x < columns / 2))
}

fn middle(membrane: &Membrane) -> (usize, usize) {
    let [columns, rows] = membrane.raster.sides();
    (columns / 2, rows / 2)
}

fn one_cell(membrane: &Membrane) -> Trial {
    let middle = middle(membrane);
    Trial::new("one cell", Pattern::from_fn(membrane.raster, |x, y| (x, y) == middle))
}

/// The patterns that a scene is screened with: all of the membrane, half of it, a disc of 0.3 times the shorter side, five blocks by five
/// like a chessboard, a single cell, and all but a single cell.
#[must_use]
pub fn reference_patterns(membrane: &Membrane) -> Vec<Trial> {
    let ([width, height], [columns, rows]) = (membrane.size_mm, membrane.raster.sides());
    let from_centre = |x: usize, y: usize| {
        let [x, y] = membrane.centre_mm(x, y);
        (x - 0.5 * width).hypot(y - 0.5 * height)
    };
    let radius = 0.3 * width.min(height);
    let middle = middle(membrane);
    let drawn = |cells: &dyn Fn(usize, usize) -> bool| Pattern::from_fn(membrane.raster, cells);
    vec![
        half_plane(membrane),
        one_cell(membrane),
        Trial::new("all active", drawn(&|_, _| true)),
        Trial::new("disc", drawn(&|x, y| from_centre(x, y) < radius)),
        Trial::new("blocks", drawn(&|x, y| (5 * x / columns + 5 * y / rows) % 2 == 0)),
        Trial::new("one hole", drawn(&|x, y| (x, y) != middle)),
    ]
}

/// The two of the reference patterns that go furthest: half of the membrane, which moves most, and a single cell, whose
/// stability is lost first. They are what a run is watched with: it costs some tens of milliseconds.
#[must_use]
pub fn watch_patterns(membrane: &Membrane) -> Vec<Trial> {
    let half = Trial {
        to_the_limit: false,
        ..half_plane(membrane)
    };
    vec![half, one_cell(membrane)]
}

/// The most of somebody's own patterns that a run is watched with.
const OWN: usize = 4;

/// Patterns that are about to be simulated, some of them where they are many, instead of those that effects are compared on in
/// [`watch_patterns`].
#[must_use]
pub fn watch_patterns_with(membrane: &Membrane, own: &[Pattern]) -> Vec<Trial> {
    let count = own.len().min(OWN);
    let named = (0..count).map(|i| i * own.len() / count).map(|at| Trial {
        to_the_limit: false,
        ..Trial::new(&format!("pattern {at}"), own[at].clone())
    });
    let extreme = watch_patterns(membrane).into_iter().map(|trial| Trial {
        compared: own.is_empty(),
        ..trial
    });
    named.chain(extreme).collect()
}
