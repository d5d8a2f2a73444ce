//! The drawing of an electrode mask, with notes on its size, scale and area.

use super::{Drawing, Layer, Shape, number};
use crate::drawing::described;
use crate::format;
use deaflow_base::software;
use deaflow_scene::{Islands, Mask, Size};

/// Creates the drawing of a mask.
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

/// Describes size, scale and area of a mask, a line each.
fn mask_notes(mask: &Mask) -> Vec<String> {
    let state = match mask.size {
        Size::Prestretched => format!(
            "size: prestretched, as on the frame; the undeformed size is smaller by the prestretch, {}",
            one_or_both(mask.prestretch)
        ),
        Size::Undeformed => format!(
            "size: undeformed, before stretching; the size on the frame is larger by the prestretch, {}",
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
            "area of the electrode {} mm^2, {} of the {}; islands {}, holes {}",
            format::number(mask.electrode_area),
            format::percents(mask.area_fraction),
            match mask.opening.is_empty() && mask.bodies.is_empty() {
                true => "membrane",
                false => "membrane that is neither frame nor body",
            },
            mask.islands(),
            mask.holes()
        ),
    ];
    notes.extend(mask.sides.as_ref().map(|sides| format!("sides: {}", described(sides))));
    if mask.rounded || mask.follows_shapes {
        let outline = if mask.rounded {
            "outline rounded"
        } else {
            "outline along the shapes"
        };
        notes.push(format!(
            "{outline}: its area is {} mm^2, {:+.4} mm^2 compared with the cells",
            format::number(mask.outline_area),
            mask.outline_area - mask.electrode_area
        ));
    }
    notes
}

/// Returns `side` or `sides`, for a pair of lengths.
#[must_use]
pub fn side_or_sides([x, y]: [f64; 2]) -> &'static str {
    if x == y { "side" } else { "sides" }
}

/// Writes a pair of lengths, or one if both are equal.
#[must_use]
pub fn one_or_both([x, y]: [f64; 2]) -> String {
    match x == y {
        true => number(x),
        false => format!("{} × {}", number(x), number(y)),
    }
}
