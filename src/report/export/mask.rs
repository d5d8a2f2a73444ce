//! A mask of electrodes as a drawing, with what it says of itself.

use super::{Drawing, Layer, Shape};
use deaflow_base::software;
use deaflow_scene::{Islands, Mask, Size};

/// The drawing of a mask of what has a title, from a source, with notes beside its size, scale and area.
#[must_use]
pub fn mask_drawing(mask: &Mask, title: &str, source: String, more: Vec<String>) -> Drawing {
    let from = format!("from {source}, by deaflow {}", env!("CARGO_PKG_VERSION"));
    let notes = mask_notes(mask).into_iter().chain(more).chain([from]);
    let layer = |(at, islands): (usize, &Islands)| Layer {
        group: (mask.groups.len() > 1).then_some(at + 1),
        shapes: shapes(islands),
    };
    Drawing {
        title: format!("electrode {title}"),
        notes: notes.collect(),
        source,
        program: software(),
        size: mask.membrane.size_mm,
        layers: mask.groups.iter().enumerate().map(layer).collect(),
        opening: shapes(&mask.opening),
        bodies: shapes(&mask.bodies),
    }
}

fn shapes(islands: &Islands) -> Vec<Shape> {
    let shape = |(outer, holes): &(Vec<_>, Vec<_>)| Shape {
        outer: outer.clone(),
        holes: holes.clone(),
    };
    islands.iter().map(shape).collect()
}

/// Size, scale and area of a mask, a line each.
fn mask_notes(mask: &Mask) -> Vec<String> {
    let state = match mask.size {
        Size::Prestretched => format!(
            "size: prestretched, as on the frame; undeformed it is smaller by the prestretch, {}",
            one_or_both(mask.prestretch)
        ),
        Size::Undeformed => format!(
            "size: undeformed, before stretching; on the frame it is larger by the prestretch, {}",
            one_or_both(mask.prestretch)
        ),
    };
    let mut notes = vec![
        state,
        format!(
            "{} of the membrane {} mm, scale {} of the prestretched size; lengths in mm, origin at the lower left",
            side_or_sides(mask.membrane.size_mm),
            one_or_both(mask.membrane.size_mm),
            one_or_both(mask.scale)
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

/// The word before a pair of lengths.
#[must_use]
pub fn side_or_sides([x, y]: [f64; 2]) -> &'static str {
    if x == y { "side" } else { "sides" }
}

/// A pair for people: one where both are equal.
#[must_use]
pub fn one_or_both([x, y]: [f64; 2]) -> String {
    match x == y {
        true => shown(x),
        false => format!("{} × {}", shown(x), shown(y)),
    }
}

/// A number with up to six decimals.
fn shown(value: f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
