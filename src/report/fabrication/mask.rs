//! The mask of a design on paper: true to scale if it fits, with rulers, numbers of groups, points and directions.

use std::fmt::Write;

use maud::{Markup, PreEscaped, html};

use crate::designs::{Design, TargetMotion, TargetPoint};
use crate::drawing::{THOUSAND, described, direction, number};
use crate::export::{mask_drawing, one_or_both, svg_elements};
use crate::page::cards::ARROW;
use deaflow_base::no_break_units;
use deaflow_pattern::{Membrane, Pattern};
use deaflow_scene::{Mask, Size};

/// The largest width of a membrane on paper in mm: across the page, and beside the text.
const ACROSS: f64 = 180.0;
const BESIDE: f64 = 95.0;

/// The height of ruler and caption in mm: across the page, and beside the text.
const CAPTION: [f64; 2] = [26.0, 36.0];

/// The height of the headings of texts beside the mask, less that of texts below it, mm.
const HEADINGS: f64 = 14.0;

/// Sizes on paper, mm: from the membrane to a ruler, the lines of a ruler, and letters.
const GAP: f64 = 1.0;
const TICKS: [(usize, f64); 3] = [(10, 3.0), (5, 2.2), (1, 1.4)];
const LETTERS: f64 = 2.8;
const GROUP_LETTERS: f64 = 4.0;

/// The largest membrane on paper, mm.
#[derive(Clone, Copy)]
pub struct Room {
    /// Across the page, above the text.
    across: [f64; 2],
    /// Beside the text.
    beside: [f64; 2],
}

impl Room {
    /// Returns the room on a page of which `height` mm are left for the mask and two texts of these heights in mm,
    /// which are one below the other beside the mask, and side by side below it.
    pub fn of(height: f64, texts: [f64; 2]) -> Self {
        let has_room_beside = texts[0] + texts[1] + HEADINGS <= height;
        Self {
            across: [ACROSS, height - CAPTION[0] - texts[0].max(texts[1])],
            beside: match has_room_beside {
                true => [BESIDE, height - CAPTION[1]],
                false => [0.0; 2],
            },
        }
    }

    /// Returns by which of 1, 2, 5, 10, … a membrane is drawn smaller to fit.
    fn reduction(self, size: [f64; 2]) -> f64 {
        let mut steps = (0..30).map(|k| [1.0, 2.0, 5.0][k % 3] * 10_f64.powi((k / 3) as i32));
        let fitting = steps.find(|step| fits(size, self.across, *step) || fits(size, self.beside, *step));
        fitting.unwrap_or(size[0].max(size[1]) / BESIDE)
    }
}

fn fits(size: [f64; 2], room: [f64; 2], reduction: f64) -> bool {
    (0..2).all(|axis| size[axis] / reduction <= room[axis])
}

/// The mask of a design on paper.
pub struct PrintedMask {
    /// The drawing with its caption.
    pub figure: Markup,
    /// Whether there is room for text beside it.
    pub leaves_room: bool,
}

impl PrintedMask {
    /// Draws the mask of a design at the size of the frame.
    pub fn of(design: &Design, title: &str, room: Room) -> Self {
        let mask = Mask::new(&design.pattern, &design.scene, Size::Prestretched, false);
        let size = mask.membrane.size_mm;
        let reduction = room.reduction(size);
        let figure = html! {
            figure.mask {
                (drawing(design, &mask, title, reduction))
                figcaption {
                    div.bar {
                        svg.check width="50mm" height="3mm" viewBox="0 0 50 3" role="img" aria-label="Bar of 50 mm" {
                            title { "Bar of 50 mm" }
                            path d="M0.15 0v3M49.85 0v3M0 1.5h50" {}
                        }
                        p { (no_break_units("50 mm, if the print has its full size.")) }
                    }
                    p { (no_break_units(&caption(design, &mask, reduction))) }
                }
            }
        };
        Self {
            figure,
            leaves_room: fits(size, room.beside, reduction),
        }
    }
}

fn caption(design: &Design, mask: &Mask, reduction: f64) -> String {
    let scale = match reduction {
        1.0 => "Scale 1:1".to_owned(),
        smaller => format!("Scale 1:{}, as the page is too small", number(smaller, 3)),
    };
    let mut text = format!(
        "{scale}; mask of the prestretched membrane, {} mm",
        one_or_both(mask.membrane.size_mm)
    );
    if !mask.opening.is_empty() {
        text += "; grey area: frame";
    }
    if !mask.bodies.is_empty() {
        text += "; grey outline: rigid body";
    }
    if let Some(sides) = &mask.sides {
        let _ = write!(text, "; sides: {}", described(sides));
    }
    let points = design.objective.points();
    let has_arrow = points
        .iter()
        .any(|target| matches!(target.motion, TargetMotion::Along(_)));
    if has_arrow {
        text += "; circle and arrow: point and direction";
    } else if points.iter().any(TargetPoint::has_point) {
        text += "; circle: point";
    }
    text + ". Rulers in mm."
}

/// Draws the membrane in mm, as large on paper as it is divided by `reduction`, with rulers outside.
fn drawing(design: &Design, mask: &Mask, title: &str, reduction: f64) -> Markup {
    let background = &design.background;
    let [width, height] = mask.membrane.size_mm;
    let on_paper = |length: f64| format!("{}mm", number(length / reduction, 6));
    let view = format!("0 0 {} {}", number(width, 6), number(height, 6));
    // Drawings of membranes are in thousandths of the longer side, with the membrane at the lower left of a square.
    let side = background.side();
    let thousandths = format!(
        "translate(0 {}) scale({})",
        number(height - side, 6),
        number(side / THOUSAND, 9)
    );
    let drawn = svg_elements(&mask_drawing(mask, title, String::new(), Vec::new()));
    let description = format!("Mask of {title}, scale 1:{}", number(reduction, 3));
    html! {
        svg.membrane id="mask" width=(on_paper(width)) height=(on_paper(height)) viewBox=(view)
            role="img" aria-label=(description) {
            title { (description) }
            g transform=(thousandths) { (background.draw_frame()) }
            (PreEscaped(drawn))
            g transform=(thousandths) { (background.draw_sides()) (targets(design)) }
            (groups(design, &mask.membrane, reduction))
            (rulers([width, height], reduction))
        }
    }
}

/// Draws points and directions of the objective.
fn targets(design: &Design) -> Markup {
    let side = design.background.side();
    html! {
        @for target in design.objective.points() {
            @match &target.motion {
                TargetMotion::Along(degrees) => { (direction(target.point, side, *degrees, ARROW)) }
                TargetMotion::Fill(_) => {}
                _ => { (direction(target.point, side, 0.0, 0.0)) }
            }
        }
    }
}

/// Writes the number of each group on its electrodes, if there are several.
fn groups(design: &Design, membrane: &Membrane, reduction: f64) -> Markup {
    let count = design.scene.groups();
    let size = number(GROUP_LETTERS * reduction, 4);
    html! {
        @if count > 1 {
            @for group in 1..=count {
                @if let Some([x, y]) = middle(&design.pattern.of_group(group as u8), membrane) {
                    text.group font-size=(size) x=(number(x, 4)) y=(number(membrane.size_mm[1] - y, 4)) dy="0.35em" {
                        (group)
                    }
                }
            }
        }
    }
}

/// Returns the centre of the electrode cell that is nearest to the centroid, in mm; `None` without electrodes.
fn middle(pattern: &Pattern, membrane: &Membrane) -> Option<[f64; 2]> {
    let columns = pattern.raster().columns();
    let cells = pattern.cells().iter().enumerate().filter(|(_, cell)| **cell != 0);
    let centres: Vec<[f64; 2]> = cells
        .map(|(at, _)| membrane.centre_mm(at % columns, at / columns))
        .collect();
    let mean = [0, 1].map(|axis| centres.iter().map(|at| at[axis]).sum::<f64>() / centres.len() as f64);
    let distance = |at: &[f64; 2]| (at[0] - mean[0]).hypot(at[1] - mean[1]);
    centres.into_iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Draws a ruler below and one at the left, with a line for each mm on paper.
fn rulers([width, height]: [f64; 2], reduction: f64) -> Markup {
    let [horizontal, vertical] = [width, height].map(|length| marks(length, reduction));
    let mark = |value: f64| number(value, 4);
    let gap = GAP * reduction;
    let (mut lines, long) = (String::new(), TICKS[0].1 * reduction);
    for (at, length) in &horizontal {
        let _ = write!(
            lines,
            "M{} {}v{}",
            mark(*at),
            mark(height + gap),
            mark(length * reduction)
        );
    }
    for (at, length) in &vertical {
        let _ = write!(
            lines,
            "M{} {}h{}",
            mark(-gap),
            mark(height - at),
            mark(-length * reduction)
        );
    }
    let named = |marks: &[(f64, f64)]| -> Vec<f64> {
        let long = marks.iter().filter(|(_, length)| *length == TICKS[0].1);
        long.map(|(at, _)| *at).collect()
    };
    html! {
        g.ruler font-size=(mark(LETTERS * reduction)) {
            path d=(lines) stroke-width=(mark(0.12 * reduction)) {}
            @for at in named(&horizontal) {
                text x=(mark(at)) y=(mark(height + gap + long)) dy="1em" text-anchor="middle" { (mark(at)) }
            }
            @for at in named(&vertical) {
                text x=(mark(-gap - long)) y=(mark(height - at)) dx="-0.2em" dy="0.35em" text-anchor="end" {
                    (mark(at))
                }
            }
        }
    }
}

/// Returns the positions of the lines of a ruler in mm of the membrane, with their lengths on paper.
fn marks(length: f64, reduction: f64) -> Vec<(f64, f64)> {
    let count = (length / reduction + 1e-9).floor() as usize;
    let line = |k: usize| {
        TICKS
            .iter()
            .find(|(every, _)| k.is_multiple_of(*every))
            .map(|(_, long)| *long)
    };
    (0..=count)
        .filter_map(|k| Some((k as f64 * reduction, line(k)?)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_membrane_is_drawn_at_its_size_if_it_fits() {
        let room = Room {
            across: [180.0, 80.0],
            beside: [95.0, 130.0],
        };
        let sizes = [
            [50.0, 50.0],
            [180.0, 80.0],
            [95.0, 130.0],
            [181.0, 20.0],
            [100.0, 120.0],
            [800.0, 10.0],
        ];
        assert_eq!(sizes.map(|size| room.reduction(size)), [1.0, 1.0, 1.0, 2.0, 2.0, 5.0]);
    }

    #[test]
    fn a_mask_is_beside_the_text_unless_that_is_too_long() {
        assert_eq!(Room::of(150.0, [40.0, 40.0]).beside, [95.0, 114.0]);
        let long = Room::of(150.0, [80.0, 60.0]);
        assert_eq!((long.beside, long.across), ([0.0; 2], [180.0, 44.0]));
    }

    #[test]
    fn a_ruler_has_a_line_for_each_mm_on_paper() {
        let one = marks(50.0, 1.0);
        assert_eq!(
            (one.len(), one[50], one[5], one[49]),
            (51, (50.0, 3.0), (5.0, 2.2), (49.0, 1.4))
        );
        let two = marks(181.0, 2.0);
        assert_eq!((two.len(), two[90].0, two[10]), (91, 180.0, (20.0, 3.0)));
    }

    #[test]
    fn a_number_is_on_an_electrode() {
        let membrane = Membrane::square(50.0);
        // The centroid of a ring is in its hole.
        let ring = Pattern::from_fn(membrane.raster, |x, y| {
            let inside = |from: usize, to: usize| (from..to).contains(&x) && (from..to).contains(&y);
            inside(10, 40) && !inside(15, 35)
        });
        let [x, y] = middle(&ring, &membrane).unwrap();
        assert_eq!(ring.cells()[y as usize * 50 + x as usize], 1);
        assert_eq!(
            middle(&Pattern::from_fn(membrane.raster, |_, _| false), &membrane),
            None
        );
    }
}
