//! Regions bounded by polygons, and their combinations.

use i_overlay::core::fill_rule as overlay;
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::float::single::SingleFloatOverlay;

use super::bits::Bits;
use super::contour::FillRule;
use super::membrane::Membrane;
use super::symmetry::Symmetries;

/// A point in mm.
type Point = [f64; 2];

/// A region bounded by closed polygons that do not cross: outer ones anticlockwise, holes clockwise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Polygons {
    rings: Vec<Vec<Point>>,
}

/// The exact borders of the parts of a membrane and of electrodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Borders {
    /// What is not frame; `None` without a frame inside the rectangle.
    pub opening: Option<Polygons>,
    /// Each body.
    pub bodies: Vec<Polygons>,
    /// Electrode groups, from 1, which do not overlap; `None` if electrodes are the cells of a pattern.
    pub electrodes: Option<Vec<(u8, Polygons)>>,
}

/// Width in mm below which a part of a region is due to rounding; outlines are within 1e-6 mm of curves.
const THINNEST: f64 = 1e-5;

/// By how much regions may differ in mm² and count as equal, for rounding and flattened arcs.
const EQUAL: f64 = 1e-3;

impl Borders {
    /// Returns the part of a region that is neither frame nor body.
    #[must_use]
    pub fn on_membrane(&self, region: &Polygons) -> Polygons {
        let opening = self.opening.iter();
        let within = opening.fold(region.clone(), |region, opening| region.intersection(opening));
        let outside = self.bodies.iter().fold(within, |region, body| region.without(body));
        outside.without_slivers()
    }

    /// Returns the symmetries of a rectangle of a size that map the opening to itself, and bodies to bodies.
    #[must_use]
    pub fn symmetries(&self, of: Symmetries, size: [f64; 2]) -> Symmetries {
        let bodies = self
            .bodies
            .iter()
            .fold(Polygons::default(), |all, body| all.union(body));
        let regions = self.opening.iter().chain([&bodies]);
        let regions: Vec<&Polygons> = regions.collect();
        of.filter(|g| {
            let turned = |point: Point| {
                let [x, y] = g.apply_vector([point[0] - 0.5 * size[0], point[1] - 0.5 * size[1]]);
                [x + 0.5 * size[0], y + 0.5 * size[1]]
            };
            regions
                .iter()
                .all(|region| region.moved(turned).is_within(EQUAL, region))
        })
    }
}

impl Polygons {
    /// Creates the region of points that lie within an odd number of closed polygons, which may cross.
    #[must_use]
    pub fn new(rings: &[Vec<Point>]) -> Self {
        Self::filled(rings, FillRule::EvenOdd)
    }

    /// Creates the region that closed polygons fill.
    #[must_use]
    pub fn filled(rings: &[Vec<Point>], rule: FillRule) -> Self {
        let rule = match rule {
            FillRule::EvenOdd => overlay::FillRule::EvenOdd,
            FillRule::NonZero => overlay::FillRule::NonZero,
        };
        Self::overlaid(rings, &[], OverlayRule::Subject, rule)
    }

    /// Creates the region of cells of a membrane.
    #[must_use]
    pub fn of_cells(cells: &Bits, membrane: Membrane) -> Self {
        let [width, height] = membrane.cell_mm();
        let [columns, rows] = membrane.raster.sides();
        let mut rings = Vec::new();
        for y in 0..rows {
            let mut x = 0;
            while x < columns {
                let end = (x..columns).find(|&x| !cells.has(x, y)).unwrap_or(columns);
                if end > x {
                    let ([left, right], [low, high]) = ([x, end], [y, y + 1]);
                    let corners = [[left, low], [right, low], [right, high], [left, high]];
                    rings.push(corners.map(|[x, y]| [x as f64 * width, y as f64 * height]).to_vec());
                }
                x = end.max(x + 1);
            }
        }
        Self::new(&rings)
    }

    /// Creates a region from rings that do not cross: outer ones anticlockwise, holes clockwise.
    #[must_use]
    pub fn of_rings(rings: Vec<Vec<Point>>) -> Self {
        Self { rings }
    }

    /// Creates the whole rectangle of a membrane.
    #[must_use]
    pub fn of_membrane(membrane: Membrane) -> Self {
        Self::of_rectangle(membrane.size_mm)
    }

    /// Creates a rectangle with its lower left corner at the origin.
    #[must_use]
    pub fn of_rectangle([width, height]: [f64; 2]) -> Self {
        Self::new(&[vec![[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]])
    }

    fn combined(&self, other: &Self, rule: OverlayRule) -> Self {
        Self::overlaid(&self.rings, &other.rings, rule, overlay::FillRule::EvenOdd)
    }

    fn overlaid(one: &[Vec<Point>], other: &[Vec<Point>], rule: OverlayRule, fill: overlay::FillRule) -> Self {
        let shapes = one.to_vec().overlay_as::<i64>(&other.to_vec(), rule, fill);
        Self {
            rings: shapes.into_iter().flatten().collect(),
        }
    }

    /// Returns the region with coordinates of so many decimal places.
    pub(super) fn rounded(&self, decimals: i32) -> Self {
        let scale = 10_f64.powi(decimals);
        let rounded = |point: &Point| point.map(|at| (at * scale).round() / scale + 0.0);
        let ring = |ring: &Vec<Point>| -> Vec<Point> { ring.iter().map(rounded).collect() };
        Self {
            rings: self.rings.iter().map(ring).collect(),
        }
    }

    /// Returns the region without parts and holes that rounding leaves where borders coincide.
    #[must_use]
    pub fn without_slivers(&self) -> Self {
        let is_wide = |ring: &&Vec<Point>| {
            let edges = || ring.iter().zip(ring.iter().cycle().skip(1));
            let area: f64 = edges().map(|(a, b)| 0.5 * cross(*a, *b)).sum();
            let length: f64 = edges().map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).sum();
            2.0 * area.abs() > THINNEST * length
        };
        Self {
            rings: self.rings.iter().filter(is_wide).cloned().collect(),
        }
    }

    /// Returns whether a point is in the region.
    #[must_use]
    pub fn contains(&self, [x, y]: Point) -> bool {
        let crossed = self
            .edges()
            .filter(|[[a, b], [c, d]]| (*b > y) != (*d > y) && x < a + (y - b) / (d - b) * (c - a));
        crossed.count() % 2 == 1
    }

    /// Returns the polygons; the last point of each is joined to the first.
    #[must_use]
    pub fn rings(&self) -> &[Vec<Point>] {
        &self.rings
    }

    /// Returns whether the region is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rings.is_empty()
    }

    /// Returns what is in either region.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        self.combined(other, OverlayRule::Union)
    }

    /// Returns what is in both regions.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        self.combined(other, OverlayRule::Intersect)
    }

    /// Returns what is in this region and not in the other.
    #[must_use]
    pub fn without(&self, other: &Self) -> Self {
        self.combined(other, OverlayRule::Difference)
    }

    /// Returns whether two regions differ by less than an area in mm².
    #[must_use]
    pub fn is_within(&self, area: f64, other: &Self) -> bool {
        self.combined(other, OverlayRule::Xor).area() <= area
    }

    /// Returns the image under a map that keeps distances.
    pub(super) fn moved(&self, point: impl Fn(Point) -> Point) -> Self {
        let [origin, right, up] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(&point);
        let is_mirrored = cross(
            [right[0] - origin[0], right[1] - origin[1]],
            [up[0] - origin[0], up[1] - origin[1]],
        ) < 0.0;
        let ring = |ring: &Vec<Point>| -> Vec<Point> {
            let mut image: Vec<Point> = ring.iter().map(|at| point(*at)).collect();
            if is_mirrored {
                image.reverse();
            }
            image
        };
        Self {
            rings: self.rings.iter().map(ring).collect(),
        }
    }

    /// Returns the area in mm².
    #[must_use]
    pub fn area(&self) -> f64 {
        self.edges().map(|[a, b]| 0.5 * cross(a, b)).sum::<f64>() + 0.0
    }

    /// Returns the centroid; `None` without area.
    #[must_use]
    pub fn centroid(&self) -> Option<Point> {
        let area = self.area();
        let sums = self.edges().fold([0.0; 2], |sums, [a, b]| {
            let weight = cross(a, b) / 6.0;
            [0, 1].map(|axis| sums[axis] + weight * (a[axis] + b[axis]))
        });
        (area > 0.0).then(|| sums.map(|sum| sum / area))
    }

    fn edges(&self) -> impl Iterator<Item = [Point; 2]> {
        self.rings.iter().flat_map(|ring| {
            let next = ring.iter().cycle().skip(1);
            ring.iter().zip(next).map(|(a, b)| [*a, *b])
        })
    }
}

fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(low: f64, high: f64) -> Vec<Point> {
        vec![[low, low], [high, low], [high, high], [low, high]]
    }

    #[test]
    fn regions_are_combined_with_holes_and_corners() {
        let (large, small) = (Polygons::new(&[square(0.0, 6.0)]), Polygons::new(&[square(2.0, 4.0)]));
        let ring = large.without(&small);
        assert_eq!(ring.rings().len(), 2);
        assert!((ring.area() - 32.0).abs() < 1e-9);
        assert_eq!(ring, Polygons::new(&[square(0.0, 6.0), square(2.0, 4.0)]));
        assert!((ring.union(&small).area() - 36.0).abs() < 1e-9 && small.without(&large).is_empty());
        let shifted = Polygons::new(&[square(3.0, 9.0)]);
        assert!((large.intersection(&shifted).area() - 9.0).abs() < 1e-9);
        let centroid = large.union(&shifted).centroid().unwrap();
        assert!((centroid[0] - 4.5).abs() < 1e-9 && (centroid[1] - 4.5).abs() < 1e-9);
        assert_eq!(Polygons::default().centroid(), None);
        // A contour that crosses itself: both halves count, whatever their sense.
        let bow = Polygons::new(&[vec![[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]]]);
        assert!((bow.area() - 2.0).abs() < 1e-9, "{}", bow.area());
    }
}
