//! The patterns that a scene is screened with.

use crate::pattern::{CELLS, Pattern};

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

fn half_plane() -> Trial {
    Trial::new("half plane", Pattern::from_fn(|x, _| x < CELLS / 2))
}

fn one_cell() -> Trial {
    Trial::new("one cell", Pattern::from_fn(|x, y| (x, y) == (CELLS / 2, CELLS / 2)))
}

/// The patterns that a scene is screened with: all of the membrane, half of it, a disc of radius 0.3 L, blocks of 10 cells
/// like a chessboard, a single cell, and all but a single cell.
#[must_use]
pub fn reference_patterns() -> Vec<Trial> {
    let from_centre = |x: usize, y: usize| (x as f64 + 0.5 - 25.0).hypot(y as f64 + 0.5 - 25.0);
    vec![
        half_plane(),
        one_cell(),
        Trial::new("all active", Pattern::from_fn(|_, _| true)),
        Trial::new("disc", Pattern::from_fn(|x, y| from_centre(x, y) < 15.0)),
        Trial::new("blocks", Pattern::from_fn(|x, y| (x / 10 + y / 10) % 2 == 0)),
        Trial::new("one hole", Pattern::from_fn(|x, y| (x, y) != (CELLS / 2, CELLS / 2))),
    ]
}

/// The two of the reference patterns that go furthest: half of the membrane, which moves most, and a single cell, whose
/// stability is lost first. They are what a run is watched with: it costs some tens of milliseconds.
#[must_use]
pub fn watch_patterns() -> Vec<Trial> {
    let half = Trial {
        to_the_limit: false,
        ..half_plane()
    };
    vec![half, one_cell()]
}

/// The most of somebody's own patterns that a run is watched with.
const OWN: usize = 4;

/// Patterns that are about to be simulated, some of them where they are many, instead of those that effects are compared on in
/// [`watch_patterns`].
#[must_use]
pub fn watch_patterns_with(own: &[Pattern]) -> Vec<Trial> {
    let count = own.len().min(OWN);
    let named = (0..count).map(|i| i * own.len() / count).map(|at| Trial {
        to_the_limit: false,
        ..Trial::new(&format!("pattern {at}"), own[at].clone())
    });
    let extreme = watch_patterns().into_iter().map(|trial| Trial {
        compared: own.is_empty(),
        ..trial
    });
    named.chain(extreme).collect()
}
