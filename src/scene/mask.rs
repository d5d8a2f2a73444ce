//! An electrode as polygons in mm, for manufacturing: along its shapes and those of frame and bodies where elements
//! follow them, else along cells.

use super::model::Scene;
use super::sides::Sides;
use deaflow_pattern::{Bits, Corners, Island, Membrane, Part, Pattern, Polygons, outlines, ring_area, total_area};

/// A point in mm, the origin at the lower left corner of the membrane.
pub type Point = [f64; 2];

/// Outer ring and holes of each island, largest first; outer rings run counterclockwise, holes clockwise.
pub type Islands = Vec<(Vec<Point>, Vec<Vec<Point>>)>;

/// The state of the membrane on which the electrode is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Before the membrane is stretched.
    Undeformed,
    /// On the frame, without voltage.
    Prestretched,
}

impl Size {
    /// The name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Undeformed => "undeformed",
            Self::Prestretched => "prestretched",
        }
    }
}

/// The mask of an electrode pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct Mask {
    /// The state of the membrane for which it is made.
    pub size: Size,
    /// The membrane in that state.
    pub membrane: Membrane,
    /// Its sides divided by those of the prestretched membrane.
    pub scale: [f64; 2],
    /// Prestretch along x and y.
    pub prestretch: [f64; 2],
    /// Area of the active cells on the free membrane, mm².
    pub electrode_area: f64,
    /// This area divided by that of the free membrane, which is neither frame nor body.
    pub area_fraction: f64,
    /// Area within the outline, mm².
    pub outline_area: f64,
    /// Whether the outline is rounded.
    pub rounded: bool,
    /// Whether the outline follows drawn shapes, or frame and bodies where elements do, and not cells alone.
    pub follows_shapes: bool,
    /// The islands of each electrode group.
    pub groups: Vec<Islands>,
    /// The area that is not frame, if there is a frame inside the rectangle.
    pub opening: Islands,
    /// The rigid bodies.
    pub bodies: Islands,
    /// What supports the sides, if not all are held.
    pub sides: Option<Sides>,
}

impl Mask {
    /// Creates the mask of a pattern on the membrane of a scene.
    #[must_use]
    pub fn new(pattern: &Pattern, scene: &Scene, size: Size, rounded: bool) -> Self {
        let prestretch = scene.prestretch();
        let scale = match size {
            Size::Prestretched => [1.0; 2],
            Size::Undeformed => prestretch.map(f64::recip),
        };
        let prestretched = scene.membrane();
        let membrane = Membrane {
            size_mm: [0, 1].map(|axis| prestretched.size_mm[axis] * scale[axis]),
            ..prestretched
        };
        let [width, height] = membrane.cell_mm();
        let corners = if rounded { Corners::Rounded } else { Corners::Square };
        let ring = |ring: &Vec<Point>| -> Vec<Point> { ring.iter().map(|[x, y]| [x * width, y * height]).collect() };
        let drawn = |pattern: &Pattern, corners: Corners| {
            let islands = outlines(pattern, corners);
            let rings = islands
                .iter()
                .map(|island| (ring(&island.outer), island.holes.iter().map(ring).collect()));
            (total_area(&islands), rings.collect::<Islands>())
        };
        let shapes = pattern.electrodes();
        let (parts, borders, free) = (scene.parts(), scene.borders(), scene.free_cells());
        let of_region = |region: &Polygons| (region.area() * scale[0] * scale[1], islands(region, scale));
        let group = |group: u8| match (shapes, &borders, &free) {
            (Some(shapes), ..) => {
                let own = shapes.groups().iter().find(|(number, _)| *number == group);
                own.map_or_else(Default::default, |(_, region)| of_region(region))
            }
            (None, Some(borders), Some(free)) => {
                let cells = to_borders(pattern, group, free);
                let [width, height] = prestretched.cell_mm();
                let rings = outlines(&cells, corners)
                    .into_iter()
                    .flat_map(Island::into_rings)
                    .map(|ring| ring.iter().map(|[x, y]| [x * width, y * height]).collect());
                of_region(&borders.on_membrane(&Polygons::new(&rings.collect::<Vec<_>>())))
            }
            _ => {
                let (cells, drawn) = match scene.groups() {
                    1 => drawn(pattern, corners),
                    _ => drawn(&pattern.of_group(group), corners),
                };
                (cells * width * height, drawn)
            }
        };
        let (areas, groups): (Vec<f64>, Vec<Islands>) = (1..=scene.groups() as u8).map(group).unzip();
        let part = |is_in: &dyn Fn(Part) -> bool| match &parts {
            Some(parts) => drawn(&parts.cells(is_in).pattern(), Corners::Square).1,
            None => Vec::new(),
        };
        let has_frame = scene.geometry.frame.is_some();
        let (opening, bodies) = match &borders {
            Some(borders) => {
                let opening = borders.opening.as_ref();
                let bodies = borders.bodies.iter().flat_map(|body| islands(body, scale));
                (
                    opening.map_or_else(Vec::new, |opening| islands(opening, scale)),
                    bodies.collect(),
                )
            }
            None => (
                part(&|part| has_frame && part != Part::Frame),
                part(&|part| part.body().is_some()),
            ),
        };
        let free_electrode = free
            .as_ref()
            .map_or_else(|| pattern.clone(), |free| pattern.within(free));
        Self {
            size,
            membrane,
            scale,
            prestretch,
            electrode_area: free_electrode.active_cells() as f64 * width * height,
            area_fraction: pattern.area_fraction(free.as_ref()),
            outline_area: areas.iter().sum(),
            rounded: rounded && shapes.is_none(),
            follows_shapes: shapes.is_some() || borders.is_some(),
            groups,
            opening,
            bodies,
            sides: scene.geometry.sides.clone(),
        }
    }

    /// Returns the number of islands of all groups.
    #[must_use]
    pub fn islands(&self) -> usize {
        self.groups.iter().map(Vec::len).sum()
    }

    /// Returns the number of holes of all islands.
    #[must_use]
    pub fn holes(&self) -> usize {
        self.groups.iter().flatten().map(|(_, holes)| holes.len()).sum()
    }
}

/// Returns the cells of a group, with those of frame and bodies at their edge: between cells and a curve the membrane
/// reaches into them, and an electrode that ends at the last cell would not touch the frame. A cell next to another
/// group is left out.
fn to_borders(pattern: &Pattern, group: u8, free: &Bits) -> Pattern {
    let [columns, rows] = pattern.raster().sides().map(|cells| cells as isize);
    let joins = |x: usize, y: usize| {
        let around = |offsets: [[isize; 2]; 4]| {
            let near = offsets.into_iter().filter_map(|[dx, dy]| {
                let [x, y] = [x as isize + dx, y as isize + dy];
                let is_inside = (0..columns).contains(&x) && (0..rows).contains(&y);
                let [x, y] = [x as usize, y as usize];
                (is_inside && free.has(x, y)).then(|| pattern.group(x, y))
            });
            near.collect::<Vec<u8>>()
        };
        let beside = around([[-1, 0], [1, 0], [0, -1], [0, 1]]);
        if beside.is_empty() {
            let across = around([[-1, -1], [1, -1], [-1, 1], [1, 1]]);
            return !across.is_empty() && across.iter().all(|other| *other == group);
        }
        beside.contains(&group) && beside.iter().all(|other| [0, group].contains(other))
    };
    Pattern::from_fn(pattern.raster(), |x, y| match free.has(x, y) {
        true => pattern.group(x, y) == group,
        false => joins(x, y),
    })
}

/// How far in mm the outline of a mask may be from a shape.
const TOLERANCE: f64 = 5e-4;

/// Returns the islands of a region in mm, largest first, with lengths along x and y times `scale`.
fn islands(region: &Polygons, scale: [f64; 2]) -> Islands {
    let rings = region.rings().iter().map(|ring| simplified(ring));
    let (mut outer, holes): (Vec<Vec<Point>>, Vec<Vec<Point>>) = rings
        .filter(|ring| ring.len() > 2)
        .partition(|ring| ring_area(ring) > 0.0);
    outer.sort_by(|a, b| ring_area(b).total_cmp(&ring_area(a)));
    let regions: Vec<Polygons> = outer
        .iter()
        .map(|ring| Polygons::of_rings(vec![ring.clone()]))
        .collect();
    let mut islands: Islands = outer.into_iter().map(|ring| (ring, Vec::new())).collect();
    for hole in holes {
        // The smallest ring around a hole is the last one.
        let around = regions
            .iter()
            .rposition(|ring| ring.contains(hole[0]) && ring.area() > -ring_area(&hole));
        if let Some((_, own)) = around.and_then(|at| islands.get_mut(at)) {
            own.push(hole);
        }
    }
    let scaled = |ring: &mut Vec<Point>| {
        ring.iter_mut()
            .for_each(|at| *at = [at[0] * scale[0], at[1] * scale[1]])
    };
    for (outer, holes) in &mut islands {
        scaled(outer);
        holes.iter_mut().for_each(scaled);
    }
    islands
}

/// Leaves out points of a ring that lie within [`TOLERANCE`] of the line between those that stay (Douglas and Peucker,
/// Cartographica 10 (1973) 112).
fn simplified(ring: &[Point]) -> Vec<Point> {
    let Some(first) = ring.first() else { return Vec::new() };
    let distance = |a: &Point, b: &Point| (b[0] - a[0]).hypot(b[1] - a[1]);
    // A ring has no ends: it is divided at the point that is farthest from the first one.
    let far = (0..ring.len()).max_by(|&a, &b| distance(first, &ring[a]).total_cmp(&distance(first, &ring[b])));
    let closed: Vec<Point> = ring.iter().chain([first]).copied().collect();
    let mut kept = vec![false; closed.len()];
    let middle = far.unwrap_or(0);
    let mut parts = vec![(0, middle), (middle, ring.len())];
    while let Some((from, to)) = parts.pop() {
        (kept[from], kept[to]) = (true, true);
        let (a, b) = (closed[from], closed[to]);
        let length = distance(&a, &b);
        let off = |at: &Point| match length > 0.0 {
            true => ((b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0])).abs() / length,
            false => distance(&a, at),
        };
        let inner = (from + 1..to).map(|at| (off(&closed[at]), at));
        let most = inner.max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, at)) = most.filter(|(off, _)| *off > TOLERANCE) {
            parts.extend([(from, at), (at, to)]);
        }
    }
    let points = ring.iter().zip(kept).filter(|(_, kept)| *kept);
    points.map(|(point, _)| *point).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use deaflow_pattern::{Electrodes, Raster};

    #[test]
    fn the_undeformed_mask_is_smaller_by_the_prestretch() {
        let (pattern, scene) = (
            Pattern::from_fn(Raster::PAPER, |x, y| x < 10 && y < 20),
            Scene::vhb4910(),
        );
        let mask = Mask::new(&pattern, &scene, Size::Prestretched, false);
        assert_eq!(
            (mask.membrane.size_mm, mask.electrode_area, mask.outline_area),
            ([50.0; 2], 200.0, 200.0)
        );
        assert_eq!(
            mask.groups[0][0].0,
            [[0.0, 0.0], [10.0, 0.0], [10.0, 20.0], [0.0, 20.0]]
        );
        let small = Mask::new(&pattern, &scene, Size::Undeformed, false);
        assert!(
            (small.membrane.size_mm[1] - 50.0 / 3.0).abs() < 1e-12 && (small.outline_area - 200.0 / 9.0).abs() < 1e-12
        );
        assert!((small.groups[0][0].0[2][1] - 20.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_mask_follows_shapes_that_are_known() {
        let scene = Scene::from_text(
            "geometry: { side: 44 mm, thickness: 1 mm, prestretch: 2, cells: 44, frame: { opening: { disc: { centre: \
             [22 mm, 22 mm], radius: 20 mm } }, curves: fitted }, bodies: [{ disc: { centre: [22 mm, 22 mm], radius: \
             5 mm }, curves: fitted }] }\n\
             material: { model: neo-hookean, shear_modulus: 24.3 kPa, relative_permittivity: 4.7 }\n\
             drive: { voltage: 1 kV }\n",
        )
        .unwrap();
        let circle = |radius: f64| -> Vec<Point> {
            let angle = |k: usize| std::f64::consts::TAU * k as f64 / 4000.0;
            let at = |k| [22.0 + radius * angle(k).cos(), 22.0 + radius * angle(k).sin()];
            (0..4000).map(at).collect()
        };
        let ring = Polygons::new(&[circle(15.0), circle(10.0)]);
        let cells = Pattern::from_fn(scene.membrane().raster, |_, y| y < 22);
        let plain = Mask::new(&cells, &scene, Size::Prestretched, false);
        assert!(plain.follows_shapes);
        // Cells reach the curves of frame and body: half of the membrane between them.
        for rounded in [false, true] {
            let whole = Mask::new(&cells, &scene, Size::Prestretched, rounded);
            let off = (whole.outline_area - 187.5 * std::f64::consts::PI).abs();
            assert!(
                whole.groups[0].len() == 1 && off < if rounded { 1.0 } else { 0.05 },
                "{off}"
            );
        }
        let shapes = Electrodes::new(&[(1, ring)], [44.0; 2]);
        let drawn = cells.with_electrodes(Some(Arc::new(shapes)));
        let mask = Mask::new(&drawn, &scene, Size::Prestretched, false);
        let pi = std::f64::consts::PI;
        assert!(
            mask.follows_shapes && (mask.outline_area - 125.0 * pi).abs() < 0.01,
            "{}",
            mask.outline_area
        );
        let [(outer, holes)] = &mask.groups[0][..] else {
            panic!("{:?}", mask.groups)
        };
        assert_eq!(holes.len(), 1);
        // Far fewer points than the shape has, all of them on it.
        assert!((100..1000).contains(&outer.len()), "{}", outer.len());
        let off = |ring: &[Point], radius: f64| {
            let far = ring
                .iter()
                .map(|at| ((at[0] - 22.0).hypot(at[1] - 22.0) - radius).abs());
            far.fold(0.0, f64::max)
        };
        assert!(off(outer, 15.0) < 1e-5 && off(&holes[0], 10.0) < 1e-5);
        for mask in [&mask, &plain] {
            assert!(off(&mask.opening[0].0, 20.0) < 1e-5 && off(&mask.bodies[0].0, 5.0) < 1e-5);
        }
        // Half as large before it is stretched.
        let small = Mask::new(&drawn, &scene, Size::Undeformed, false);
        assert!((small.groups[0][0].0[0][0] - 0.5 * outer[0][0]).abs() < 1e-12);
        assert!((small.outline_area - 0.25 * mask.outline_area).abs() < 1e-9);
    }
}
