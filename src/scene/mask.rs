//! An electrode as polygons in mm, for manufacturing.

use super::model::Scene;
use super::sides::Sides;
use deaflow_pattern::{Corners, Membrane, Part, Pattern, outlines, total_area};

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
        let (areas, groups): (Vec<f64>, Vec<Islands>) = match scene.groups() {
            1 => vec![drawn(pattern, corners)],
            several => (1..=several as u8)
                .map(|group| drawn(&pattern.of_group(group), corners))
                .collect(),
        }
        .into_iter()
        .unzip();
        let parts = scene.parts();
        let part = |is_in: &dyn Fn(Part) -> bool| match &parts {
            Some(parts) => drawn(&parts.cells(is_in).pattern(), Corners::Square).1,
            None => Vec::new(),
        };
        let has_frame = scene.geometry.frame.is_some();
        let free = scene.free_cells();
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
            outline_area: areas.iter().sum::<f64>() * width * height,
            rounded,
            groups,
            opening: part(&|part| has_frame && part != Part::Frame),
            bodies: part(&|part| part.body().is_some()),
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

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

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
}
