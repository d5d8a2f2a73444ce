//! Places labels beside points, so that they cover neither points nor each other.

use std::ops::Range;

/// A position, or a width and a height.
type Pixel = (i32, i32);

/// A rectangle in pixels: left, top, right, bottom.
type Rect = [i32; 4];

/// The position of the upper left corner of a label, relative to its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LabelOffset {
    pub x: i32,
    pub y: i32,
}

/// Places labels, given what they must not cover.
pub struct LabelPlacer {
    frame: Rect,
    /// Points, which must not be covered.
    taken: Vec<Rect>,
    /// Parts of lines, which should not be covered.
    lines: Vec<Rect>,
}

impl LabelPlacer {
    /// Creates it for a frame, given by its ranges of columns and rows.
    pub fn new([x, y]: [Range<i32>; 2]) -> Self {
        Self {
            frame: [x.start, y.start, x.end, y.end],
            taken: Vec::new(),
            lines: Vec::new(),
        }
    }

    /// Forbids to cover a point with a radius.
    pub fn avoid_point(&mut self, (x, y): (i32, i32), radius: i32) {
        self.taken.push([x - radius, y - radius, x + radius, y + radius]);
    }

    /// Avoids to cover a line, if possible.
    pub fn avoid_line(&mut self, points: &[(i32, i32)]) {
        const PARTS: i32 = 24;
        for pair in points.windows(2) {
            let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
            for k in 0..=PARTS {
                let (x, y) = (x0 + (x1 - x0) * k / PARTS, y0 + (y1 - y0) * k / PARTS);
                self.lines.push([x - 2, y - 2, x + 2, y + 2]);
            }
        }
    }

    /// Returns the best offsets of labels, `gap` pixels or more from their points, given points and sizes. Labels are
    /// placed one after the other, and again as long as one finds a better place.
    pub fn place(&self, requests: &[(Pixel, Pixel)], gap: i32) -> Vec<LabelOffset> {
        let mut placed: Vec<Option<PlacedLabel>> = vec![None; requests.len()];
        for _ in 0..ROUNDS {
            let before = placed.clone();
            for (at, (point, size)) in requests.iter().enumerate() {
                placed[at] = None;
                let others: Vec<Rect> = placed.iter().flatten().map(|other| other.own).collect();
                let points = requests.iter().map(|(point, _)| *point).filter(|other| other != point);
                placed[at] = self.best(*point, *size, gap, (&others, &points.collect::<Vec<_>>()));
            }
            if placed == before {
                break;
            }
        }
        placed.into_iter().flatten().map(|placed| placed.offset).collect()
    }

    fn best(
        &self,
        (x, y): Pixel,
        (width, height): Pixel,
        gap: i32,
        (others, points): (&[Rect], &[Pixel]),
    ) -> Option<PlacedLabel> {
        let offsets = [1, 2, 3, 4].into_iter().flat_map(|far| {
            let (gap, low, middle) = (far * gap, -height - far * gap, -height / 2);
            [
                (gap, middle),
                (gap / 2, low),
                (gap / 2, gap),
                (-width - gap, middle),
                (-width - gap / 2, gap),
                (-width - gap / 2, low),
                (-width / 2, low),
                (-width / 2, gap),
            ]
        });
        let margin = gap / 3;
        let placed = offsets.map(|(dx, dy)| {
            let (left, top) = (x + dx, y + dy);
            PlacedLabel {
                offset: LabelOffset { x: dx, y: dy },
                own: [
                    left - margin,
                    top - margin,
                    left + width + margin,
                    top + height + margin,
                ],
            }
        });
        let cost = |(rank, placed): &(usize, PlacedLabel)| {
            let label = [x + placed.offset.x, y + placed.offset.y, width, height];
            let own = distance((x, y), label);
            // A label that is nearer to another point would be taken for that of the other one.
            let nearer = points.iter().filter(|other| distance(**other, label) <= own).count() as i64;
            4 * *rank as i64 + 250 * nearer + self.cost(placed.own, others)
        };
        placed.enumerate().min_by_key(cost).map(|(_, placed)| placed)
    }

    fn cost(&self, own: Rect, others: &[Rect]) -> i64 {
        let count = |boxes: &[Rect]| boxes.iter().filter(|other| overlap(own, **other)).count() as i64;
        let [left, top, right, bottom] = self.frame;
        let outside = own[0] < left || own[1] < top || own[2] > right || own[3] > bottom;
        // Beside the frame are the numbers of the axes.
        let beside = if outside { OUTSIDE } else { 0 };
        1000 * (count(&self.taken) + count(others)) + 25 * count(&self.lines) + beside
    }
}

/// Returns the distance of a point from a rectangle, given by its left, top, width and height.
pub fn distance((x, y): Pixel, [left, top, width, height]: [i32; 4]) -> f64 {
    let across = x - x.clamp(left, left + width);
    let down = y - y.clamp(top, top + height);
    f64::from(across).hypot(f64::from(down))
}

/// A label with its place.
#[derive(Clone, Copy, PartialEq, Eq)]
struct PlacedLabel {
    offset: LabelOffset,
    /// What it covers, with a margin.
    own: Rect,
}

/// Rounds of placement.
const ROUNDS: usize = 6;

/// What a label outside of the frame costs: more than one that covers all points of a curve.
const OUTSIDE: i64 = 1_000_000;

fn overlap(a: Rect, b: Rect) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_close_points_cover_nothing_and_stay_inside() {
        let points = [(50, 50), (60, 52), (70, 48), (195, 195), (5, 5)];
        let mut labels = LabelPlacer::new([0..200, 0..200]);
        points.iter().for_each(|p| labels.avoid_point(*p, 4));
        let size = (40, 10);
        let spots = labels.place(&points.map(|point| (point, size)), 6);
        let boxes: Vec<Rect> = points
            .iter()
            .zip(&spots)
            .map(|((x, y), spot)| [x + spot.x, y + spot.y, x + spot.x + size.0, y + spot.y + size.1])
            .collect();
        for (at, own) in boxes.iter().enumerate() {
            assert!(own[0] >= 0 && own[1] >= 0 && own[2] <= 200 && own[3] <= 200, "{own:?}");
            let others = labels.taken.iter().chain(&boxes[at + 1..]);
            assert_eq!(others.filter(|other| overlap(*own, **other)).count(), 0, "{own:?}");
        }
    }

    #[test]
    fn a_label_in_a_dense_curve_stays_in_the_frame() {
        let point = (10, 60);
        let mut labels = LabelPlacer::new([0..300, 0..120]);
        (0..200).for_each(|k| labels.avoid_point((4 + k, 60), 4));
        (0..100).for_each(|k| labels.avoid_point((10 + k, 20 + k), 4));
        (0..200).for_each(|k| labels.avoid_point((4 + k, 40), 4));
        (0..200).for_each(|k| labels.avoid_point((4 + k, 80), 4));
        let spot = labels.place(&[(point, (90, 13))], 10)[0];
        let (left, top) = (point.0 + spot.x, point.1 + spot.y);
        assert!(left >= 0 && top >= 0 && top + 13 <= 120, "{spot:?}");
    }

    #[test]
    fn a_label_stands_beside_its_own_point() {
        let points = [(40, 60), (62, 66), (84, 72), (106, 78)];
        let mut labels = LabelPlacer::new([0..300, 0..150]);
        points.iter().for_each(|point| labels.avoid_point(*point, 4));
        let size = (50, 13);
        let spots = labels.place(&points.map(|point| (point, size)), 10);
        for (point, spot) in points.iter().zip(&spots) {
            let label = [point.0 + spot.x, point.1 + spot.y, size.0, size.1];
            let own = distance(*point, label);
            let others = points.iter().filter(|other| *other != point);
            assert!(
                others.into_iter().all(|other| distance(*other, label) > own),
                "{point:?}: {spots:?}"
            );
        }
    }

    #[test]
    fn a_label_moves_for_one_that_has_no_other_place() {
        // The first would be to the right of its point, which is the only place for the second.
        let mut labels = LabelPlacer::new([0..150, 0..40]);
        for other in [(50, 5), (50, 35), (95, 8), (95, 32)] {
            labels.avoid_point(other, 3);
        }
        let wanted = [((40, 20), (30, 10)), ((84, 20), (60, 10))];
        let spots = labels.place(&wanted, 6);
        let own = |at: usize| {
            let (((x, y), (width, height)), spot) = (wanted[at], spots[at]);
            [x + spot.x, y + spot.y, x + spot.x + width, y + spot.y + height]
        };
        assert!(!overlap(own(0), own(1)), "{:?} {:?}", own(0), own(1));
    }
}
