//! Regions of a membrane in mm, and the cells in them.

use super::bits::Bits;
use super::contour::{Contour, Contours, FillRule, RESOLUTION, area, area_within, cells_of_polygons};
use super::membrane::Membrane;
use super::polygons::Polygons;
use super::raster::Raster;

/// A region of the membrane in mm from its lower left corner. The border belongs to it.
#[derive(Clone, Debug, PartialEq)]
pub enum Region {
    /// Two opposite corners.
    Rectangle([[f64; 2]; 2]),
    /// A rectangle that is turned about its centre, or has round corners.
    Rounded {
        /// The centre.
        centre: [f64; 2],
        /// Half of the sides.
        half: [f64; 2],
        /// The angle of its first side to x in rad, anticlockwise.
        angle: f64,
        /// The radius of its corners.
        radius: f64,
    },
    /// A disc.
    Disc {
        /// The centre.
        centre: [f64; 2],
        /// The radius.
        radius: f64,
    },
    /// An ellipse.
    Ellipse {
        /// The centre.
        centre: [f64; 2],
        /// The semiaxes.
        semiaxes: [f64; 2],
        /// The angle of the first semiaxis to x in rad, anticlockwise.
        angle: f64,
    },
    /// A ring.
    Ring {
        /// The centre.
        centre: [f64; 2],
        /// The inner and the outer radius.
        radii: [f64; 2],
    },
    /// The corners in order. If the polygon crosses itself, the even-odd rule applies.
    Polygon(Vec<[f64; 2]>),
    /// What contours fill.
    Contours(Contours),
    /// Cells of a membrane with this raster.
    Cells(Bits),
    /// What is in any of these.
    Union(Vec<Region>),
    /// What is in all of these.
    Intersection(Vec<Region>),
    /// The first without the others.
    Without(Box<Region>, Vec<Region>),
}

impl Region {
    fn contains(&self, [x, y]: [f64; 2]) -> bool {
        match self {
            Self::Cells(_) => false,
            Self::Rectangle([[a, b], [c, d]]) => {
                let between = |at: f64, one: f64, other: f64| {
                    let tolerance = RESOLUTION * (one.abs() + other.abs());
                    at >= one.min(other) - tolerance && at <= one.max(other) + tolerance
                };
                between(x, *a, *c) && between(y, *b, *d)
            }
            Self::Rounded {
                centre,
                half,
                angle,
                radius,
            } => {
                let at = turned([x - centre[0], y - centre[1]], -angle);
                let beyond = [0, 1].map(|axis| at[axis].abs() - half[axis] + radius);
                let outside = beyond[0].max(0.0).hypot(beyond[1].max(0.0));
                outside + beyond[0].max(beyond[1]).min(0.0) <= radius + tolerance(*centre, half[0] + half[1])
            }
            Self::Disc { centre, radius } => {
                (x - centre[0]).hypot(y - centre[1]) <= radius + tolerance(*centre, *radius)
            }
            Self::Ellipse {
                centre,
                semiaxes,
                angle,
            } => {
                let at = turned([x - centre[0], y - centre[1]], -angle);
                let least = semiaxes[0].min(semiaxes[1]);
                (at[0] / semiaxes[0]).hypot(at[1] / semiaxes[1])
                    <= 1.0 + tolerance(*centre, semiaxes[0] + semiaxes[1]) / least
            }
            Self::Ring { centre, radii } => {
                let (distance, tolerance) = ((x - centre[0]).hypot(y - centre[1]), tolerance(*centre, radii[1]));
                (radii[0] - tolerance..=radii[1] + tolerance).contains(&distance)
            }
            Self::Polygon(_) | Self::Contours(_) | Self::Union(_) | Self::Intersection(_) | Self::Without(..) => false,
        }
    }

    /// Returns the cells whose centre lies in the region; none for cells of another raster.
    #[must_use]
    pub fn cells(&self, membrane: Membrane) -> Bits {
        let cells = |region: &Self| region.cells(membrane);
        let union = |regions: &[Self]| {
            let empty = Bits::empty(membrane.raster);
            regions.iter().map(cells).fold(empty, |all, cells| all.or(&cells))
        };
        match self {
            Self::Cells(cells) if cells.raster() == membrane.raster => cells.clone(),
            Self::Polygon(corners) => cells_of_polygons(std::slice::from_ref(corners), FillRule::EvenOdd, membrane),
            Self::Contours(contours) => contours.cells(membrane),
            Self::Union(regions) => union(regions),
            Self::Intersection(regions) => {
                let full = Bits::full(membrane.raster);
                regions.iter().map(cells).fold(full, |all, cells| all.and(&cells))
            }
            Self::Without(region, others) => region.cells(membrane).without(&union(others)),
            _ => Bits::from_fn(membrane.raster, |x, y| self.contains(membrane.centre_mm(x, y))),
        }
    }

    /// Returns the contours around the region, anticlockwise or outer before inner; `None` for cells and for shapes
    /// that are combined.
    #[must_use]
    pub fn contours(&self) -> Option<Contours> {
        let of = |contours: Vec<Contour>| Contours {
            contours,
            rule: FillRule::EvenOdd,
        };
        let rounded = |[a, b]: [f64; 2], half: [f64; 2], angle: f64, radius: f64| {
            Some(of(vec![Contour::rectangle([a, b], half, angle, radius)]))
        };
        match self {
            Self::Rectangle([one, other]) => rounded(
                [0, 1].map(|axis| f64::midpoint(one[axis], other[axis])),
                [0, 1].map(|axis| (other[axis] - one[axis]).abs() / 2.0),
                0.0,
                0.0,
            ),
            Self::Rounded {
                centre,
                half,
                angle,
                radius,
            } => rounded(*centre, *half, *angle, *radius),
            Self::Disc { centre, radius } => Some(of(vec![Contour::ellipse(*centre, [*radius; 2], 0.0)])),
            Self::Ellipse {
                centre,
                semiaxes,
                angle,
            } => Some(of(vec![Contour::ellipse(*centre, *semiaxes, *angle)])),
            Self::Ring { centre, radii } => {
                let disc = |radius: f64| Contour::ellipse(*centre, [radius; 2], 0.0);
                Some(of(vec![disc(radii[1]), disc(radii[0])]))
            }
            Self::Polygon(corners) => Some(of(Contour::polygon(corners).into_iter().collect())),
            Self::Contours(contours) => Some(contours.clone()),
            Self::Cells(_) | Self::Union(_) | Self::Intersection(_) | Self::Without(..) => None,
        }
    }

    /// Returns the area in mm²: exact if no contours cross, else to 1e-6 mm along them; `None` for cells.
    #[must_use]
    pub fn area_mm2(&self) -> Option<f64> {
        let sets = self.sets()?;
        Some(area(&sets, &|windings: &[i32]| self.fills(&mut windings.iter())))
    }

    /// Returns the area within the rectangle from (0, 0) to a size in mm, to 1e-6 mm along the contours.
    #[must_use]
    pub fn area_within_mm2(&self, size: [f64; 2]) -> Option<f64> {
        let sets = self.sets()?;
        Some(area_within(
            &sets,
            &|windings: &[i32]| self.fills(&mut windings.iter()),
            size,
        ))
    }

    /// Returns the contours of each shape that is combined in the region; `None` for cells.
    fn sets(&self) -> Option<Vec<Vec<Contour>>> {
        let all = |regions: &[Self]| -> Option<Vec<Vec<Contour>>> {
            let sets: Option<Vec<_>> = regions.iter().map(Self::sets).collect();
            Some(sets?.into_iter().flatten().collect())
        };
        match self {
            Self::Union(regions) | Self::Intersection(regions) => all(regions),
            Self::Without(region, others) => Some([region.sets()?, all(others)?].concat()),
            _ => Some(vec![self.contours()?.contours]),
        }
    }

    /// Returns whether a point is in the region, by how often the contours of each shape run around it.
    fn fills(&self, windings: &mut std::slice::Iter<'_, i32>) -> bool {
        // Each shape takes its number, also where the result is known before.
        let mut all = |regions: &[Self]| -> Vec<bool> { regions.iter().map(|region| region.fills(windings)).collect() };
        match self {
            Self::Union(regions) => all(regions).contains(&true),
            Self::Intersection(regions) => !all(regions).contains(&false),
            Self::Without(region, others) => {
                let is_whole = all(std::slice::from_ref(region))[0];
                !all(others).contains(&true) && is_whole
            }
            Self::Contours(contours) => windings.next().is_some_and(|winding| contours.rule.fills(*winding)),
            _ => windings.next().is_some_and(|winding| FillRule::EvenOdd.fills(*winding)),
        }
    }

    /// Returns the contours of all shapes in the region; none for cells.
    pub(super) fn all_contours(&self) -> Vec<Contour> {
        self.sets().unwrap_or_default().into_iter().flatten().collect()
    }

    /// Returns the smallest rectangle around what is drawn: its lower left and upper right corner. None for cells and
    /// for nothing.
    #[must_use]
    pub fn bounds(&self) -> Option<[[f64; 2]; 2]> {
        let corners = self.all_contours().into_iter().flat_map(|contour| contour.corners());
        let empty = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        let [low, high] = corners.fold(empty, |[low, high], [x, y]| {
            [[low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]]
        });
        (low[0] <= high[0]).then_some([low, high])
    }

    /// Returns the region as polygons that are within 1e-6 mm of it; cells of another raster are left out.
    #[must_use]
    pub fn polygons(&self, membrane: Membrane) -> Polygons {
        let polygons = |region: &Self| region.polygons(membrane);
        let union = |regions: &[Self]| {
            let each = regions.iter().map(polygons);
            each.fold(Polygons::default(), |all, region| all.union(&region))
        };
        match self {
            Self::Cells(cells) if cells.raster() == membrane.raster => Polygons::of_cells(cells, membrane),
            Self::Union(regions) => union(regions),
            Self::Intersection(regions) => {
                let whole = Polygons::of_membrane(membrane);
                regions
                    .iter()
                    .map(polygons)
                    .fold(whole, |all, region| all.intersection(&region))
            }
            Self::Without(region, others) => region.polygons(membrane).without(&union(others)),
            _ => self
                .contours()
                .map_or_else(Polygons::default, |contours| contours.filled()),
        }
    }

    /// Returns the raster of a mask in the region that is not this one.
    #[must_use]
    pub fn other_raster(&self, raster: Raster) -> Option<Raster> {
        match self {
            Self::Cells(cells) => Some(cells.raster()).filter(|found| *found != raster),
            Self::Union(regions) | Self::Intersection(regions) => {
                regions.iter().find_map(|region| region.other_raster(raster))
            }
            Self::Without(region, others) => region
                .other_raster(raster)
                .or_else(|| others.iter().find_map(|region| region.other_raster(raster))),
            _ => None,
        }
    }
}

/// Returns how far outside of a border a point still counts as on it.
fn tolerance(centre: [f64; 2], extent: f64) -> f64 {
    RESOLUTION * (centre[0].abs() + centre[1].abs() + extent)
}

/// Turns a vector anticlockwise by an angle in rad.
fn turned([x, y]: [f64; 2], angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Raster;

    fn drawn(region: &Region) -> Vec<String> {
        let membrane = Membrane {
            raster: Raster::new(6, 4).unwrap(),
            size_mm: [6.0, 4.0],
        };
        let cells = region.cells(membrane);
        let row = |y| (0..6).map(|x| if cells.has(x, y) { '#' } else { '.' }).collect();
        (0..4).rev().map(row).collect()
    }

    #[test]
    fn a_cell_belongs_to_the_region_of_its_centre() {
        let polygon = |corners: &[[f64; 2]]| Region::Polygon(corners.to_vec());
        assert_eq!(
            drawn(&polygon(&[
                [0.0, 0.0],
                [6.0, 0.0],
                [6.0, 2.0],
                [2.0, 2.0],
                [2.0, 4.0],
                [0.0, 4.0]
            ])),
            ["##....", "##....", "######", "######"]
        );
        // The diagonal runs through centres, which belong to it.
        assert_eq!(
            drawn(&polygon(&[[0.0, 0.0], [4.0, 4.0], [0.0, 4.0]])),
            ["####..", "###...", "##....", "#....."]
        );
        // What lies inside twice does not.
        let twice = [
            [0.0, 0.0],
            [6.0, 0.0],
            [6.0, 4.0],
            [0.0, 4.0],
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 4.0],
            [0.0, 4.0],
        ];
        assert_eq!(drawn(&polygon(&twice)), ["...###"; 4]);
        let disc = Region::Disc {
            centre: [3.0, 2.0],
            radius: 1.5_f64.hypot(0.5),
        };
        assert_eq!(drawn(&disc), ["..##..", ".####.", ".####.", "..##.."]);
        let rectangle = Region::Rectangle([[4.5, 3.5], [1.5, 0.6]]);
        assert_eq!(drawn(&rectangle), [".####.", ".####.", ".####.", "......"]);
    }

    #[test]
    fn turned_and_round_regions_have_their_areas_and_symmetries() {
        let membrane = Membrane {
            raster: Raster::new(400, 400).unwrap(),
            size_mm: [20.0, 20.0],
        };
        let pi = std::f64::consts::PI;
        let area = |region: &Region| region.cells(membrane).count() as f64 * 0.05 * 0.05;
        let (centre, angle) = ([10.0, 10.0], pi / 6.0);
        for (region, exact) in [
            (
                Region::Ellipse {
                    centre,
                    semiaxes: [7.0, 3.0],
                    angle,
                },
                pi * 21.0,
            ),
            (
                Region::Ring {
                    centre,
                    radii: [3.0, 8.0],
                },
                pi * 55.0,
            ),
            (
                Region::Rounded {
                    centre,
                    half: [6.0, 2.0],
                    angle,
                    radius: 0.0,
                },
                48.0,
            ),
            (
                Region::Rounded {
                    centre,
                    half: [6.0, 2.0],
                    angle,
                    radius: 2.0,
                },
                32.0 + pi * 4.0,
            ),
        ] {
            assert!(
                (area(&region) / exact - 1.0).abs() < 2e-3,
                "{region:?}: {} {exact}",
                area(&region)
            );
            // A half turn about the middle maps each to itself, also on borders through centres.
            let cells = region.cells(membrane);
            let turned = Bits::from_fn(membrane.raster, |x, y| cells.has(399 - x, 399 - y));
            assert_eq!(cells, turned, "{region:?}");
            let found = region.contours().unwrap().area();
            assert!((found / exact - 1.0).abs() < 1e-14, "{region:?}: {found} {exact}");
        }
        // The ellipse lies along 30°, not −30°.
        let ellipse = Region::Ellipse {
            centre,
            semiaxes: [7.0, 3.0],
            angle,
        };
        let tip = [10.0 + 6.9 * angle.cos(), 10.0 + 6.9 * angle.sin()];
        assert!(ellipse.contains(tip) && !ellipse.contains([tip[0], 20.0 - tip[1]]));
    }

    #[test]
    fn regions_are_combined() {
        let disc = |x: f64, radius: f64| Region::Disc {
            centre: [x, 2.0],
            radius,
        };
        let all = Region::Rectangle([[0.0, 0.0], [6.0, 4.0]]);
        assert_eq!(
            drawn(&Region::Union(vec![
                disc(0.5, 1.0),
                Region::Rectangle([[5.0, 0.0], [6.0, 1.0]])
            ])),
            ["......", "#.....", "#.....", ".....#"]
        );
        assert_eq!(
            drawn(&Region::Intersection(vec![disc(2.0, 1.8), disc(4.0, 1.8)])),
            ["......", "..##..", "..##..", "......"]
        );
        let cells = Bits::from_fn(Raster::new(6, 4).unwrap(), |x, _| x == 5);
        let others = vec![disc(3.0, 2.0), Region::Cells(cells.clone())];
        let without = Region::Without(Box::new(all), others);
        assert_eq!(drawn(&without), ["##..#.", "#.....", "#.....", "##..#."].map(|row| row));
        assert_eq!(without.area_mm2(), None);
        // Half of a disc, with a notch of a disc that touches nothing else.
        let half = Region::Intersection(vec![disc(3.0, 2.0), Region::Rectangle([[0.0, 0.0], [3.0, 4.0]])]);
        let notched = Region::Without(Box::new(half.clone()), vec![disc(2.0, 0.5)]);
        let pi = std::f64::consts::PI;
        assert!((half.area_mm2().unwrap() - 2.0 * pi).abs() < 1e-5);
        assert!((notched.area_mm2().unwrap() - 1.75 * pi).abs() < 1e-5);
        let both = Region::Union(vec![disc(1.0, 1.0), disc(5.0, 1.0)]);
        assert!((both.area_mm2().unwrap() - 2.0 * pi).abs() < 1e-14);
        assert!((both.area_within_mm2([5.0, 2.0]).unwrap() - 0.75 * pi).abs() < 1e-5);
        let [low, _] = both.bounds().unwrap();
        assert!(low[0].abs() < 1e-5 && (low[1] - 1.0).abs() < 1e-5);
        let nested = Region::Without(Box::new(without), vec![Region::Rectangle([[0.0, 0.0], [1.0, 4.0]])]);
        assert_eq!(drawn(&nested), [".#..#.", "......", "......", ".#..#."]);
        let other = Raster::new(7, 4).unwrap();
        assert_eq!(nested.other_raster(other), Some(cells.raster()));
        assert_eq!(nested.other_raster(cells.raster()), None);
    }
}
