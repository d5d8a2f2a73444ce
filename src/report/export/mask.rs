//! The mask of an electrode as a drawing.

use super::{Drawing, Layer, Shape};
use crate::base::SOFTWARE;
use crate::scene::{Islands, Mask, Size};

impl Drawing {
    /// The drawing of a mask with a title, notes, and where it comes from.
    #[must_use]
    pub fn of_mask(mask: &Mask, title: String, notes: Vec<String>, source: String) -> Self {
        let layer = |(at, islands): (usize, &Islands)| Layer {
            group: (mask.groups.len() > 1).then_some(at + 1),
            shapes: shapes(islands),
        };
        Self {
            title,
            notes,
            source,
            program: SOFTWARE.to_owned(),
            size: mask.membrane.size_mm,
            layers: mask.groups.iter().enumerate().map(layer).collect(),
            opening: shapes(&mask.opening),
            bodies: shapes(&mask.bodies),
        }
    }
}

fn shapes(islands: &Islands) -> Vec<Shape> {
    let shape = |(outer, holes): &(Vec<_>, Vec<_>)| Shape {
        outer: outer.clone(),
        holes: holes.clone(),
    };
    islands.iter().map(shape).collect()
}

/// What must be known of a mask: its size and scale, and its areas.
#[must_use]
pub fn notes_of(mask: &Mask) -> Vec<String> {
    let state = match mask.size {
        Size::Prestretched => format!(
            "size: prestretched, as on the frame; undeformed it is smaller by the prestretch, {}",
            shown_both(mask.prestretch)
        ),
        Size::Undeformed => format!(
            "size: undeformed, before stretching; on the frame it is larger by the prestretch, {}",
            shown_both(mask.prestretch)
        ),
    };
    let mut notes = vec![
        state,
        format!(
            "{} of the membrane {} mm, scale {} of the prestretched size; lengths in mm, origin at the lower left",
            side_or_sides(mask.membrane.size_mm),
            shown_both(mask.membrane.size_mm),
            shown_both(mask.scale)
        ),
        format!(
            "area of the electrode {} mm^2, {} of that of the membrane; islands {}, holes {}",
            shown(mask.electrode_area),
            shown(mask.area_fraction),
            mask.islands(),
            mask.holes()
        ),
    ];
    if mask.rounded {
        notes.push(format!(
            "outline rounded: it holds {} mm^2, {:+.4} mm^2 against the cells",
            shown(mask.outline_area),
            mask.outline_area - mask.electrode_area
        ));
    }
    notes
}

/// A pair for people: one where both are equal.
#[must_use]
pub fn shown_both([x, y]: [f64; 2]) -> String {
    match x == y {
        true => shown(x),
        false => format!("{} × {}", shown(x), shown(y)),
    }
}

/// The word for one side or two of different lengths.
#[must_use]
pub fn side_or_sides([x, y]: [f64; 2]) -> &'static str {
    if x == y { "side" } else { "sides" }
}

/// A number with up to six decimals.
fn shown(value: f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
