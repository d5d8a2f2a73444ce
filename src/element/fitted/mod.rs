//! Grids fitted to curved borders: vertices lie on the borders, and cells that they cut are two triangles.
//!
//! The nodes keep their numbers, so vectors and the inverse Laplacian of the rectangle stay. An element whose nodes
//! have moved, or a half of a split cell, is mapped: it has its own gradients of the basis at each point. Mapped
//! elements are computed in additional rows after those of the grid, in which their cells count as empty.

mod curve;
mod interpolation;
mod mapped;
mod snap;

use std::fmt;

use deaflow_pattern::{Borders, Part, Polygons};

use super::layout::NodeLayout;
use curve::{Curve, Point};
use interpolation::Interpolation;
pub(crate) use mapped::basis_of_square;
pub use mapped::{Mapped, MappedElement, MappedView};
pub use snap::Misfit;
use snap::Snapped;

/// What a border encloses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Enclosed {
    /// What is not frame.
    Opening,
    /// A body, by its number from 0.
    Body(usize),
    /// Electrodes of a group.
    Electrode(u8),
}

impl fmt::Display for Enclosed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Opening => write!(f, "the membrane within the frame"),
            Self::Body(number) => write!(f, "body {number}"),
            Self::Electrode(group) => write!(f, "the electrode of group {group}"),
        }
    }
}

/// Returns the regions that borders enclose.
fn regions(borders: &Borders) -> impl Iterator<Item = (Enclosed, &Polygons)> {
    let opening = borders.opening.iter().map(|region| (Enclosed::Opening, region));
    let bodies = borders.bodies.iter().enumerate();
    let bodies = bodies.map(|(number, region)| (Enclosed::Body(number), region));
    let electrodes = borders.electrodes.iter().flatten();
    let electrodes = electrodes.map(|(group, region)| (Enclosed::Electrode(*group), region));
    opening.chain(bodies).chain(electrodes)
}

/// What an element is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Content {
    /// Its part.
    pub part: Part,
    /// Its electrode group, 0 without electrode; `None` if electrodes are those of a pattern.
    pub group: Option<u8>,
}

/// A border that a grid cannot be fitted to.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FitFault {
    /// Borders are too close to each other at a point in mm.
    #[error(
        "near [{:.2} mm, {:.2} mm] borders are closer to each other than an element, or have details that small. Use \
         smaller elements, or `curves: cells` and `edges: cells`",
        .0[0], .0[1]
    )]
    Crowded([f64; 2]),
    /// An element would be too flat, at a point in mm.
    #[error(
        "near [{:.2} mm, {:.2} mm] a border touches a side or another border, and elements between them are too flat. \
         Move it by at least the side of an element, or use `curves: cells` and `edges: cells`",
        .0[0], .0[1]
    )]
    Flat([f64; 2]),
    /// A region on the mesh has another area than its shape.
    #[error(
        "on the elements {region} is {} mm² {} than its shape{}. Use smaller elements, or `curves: cells` and `edges: \
         cells`",
        deaflow_base::four_digits(less.abs()), if *less > 0.0 { "smaller" } else { "larger" },
        near.map_or_else(String::new, |[x, y]| format!(", near [{x:.2} mm, {y:.2} mm]"))
    )]
    Area {
        /// What has the border.
        region: Enclosed,
        /// The missing area in mm².
        less: f64,
        /// A point in mm of the part or hole that misses it, if that is small.
        near: Option<[f64; 2]>,
    },
}

/// The nodes and elements of a grid fitted to borders.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// Position of each node, row by row, in units of elements.
    nodes: Vec<Point>,
    /// Content of each element of the grid that is not mapped.
    regular: Vec<Option<Content>>,
    mapped: Mapped,
    interpolations: Vec<Interpolation>,
}

impl Fitted {
    /// Fits a uniform grid to borders. `sides` are those of elements in mm, and `scale` those in the units of
    /// gradients; `step` are the elements along the sides of a cell.
    ///
    /// # Errors
    /// If the borders are too close to each other, or a region loses area.
    pub fn new(
        layout: NodeLayout,
        sides: [f64; 2],
        scale: [f64; 2],
        step: [usize; 2],
        borders: &Borders,
    ) -> Result<Self, FitFault> {
        let elements = [layout.columns(), layout.rows()];
        let (enclosed, curves): (Vec<_>, Vec<_>) = regions(borders)
            .map(|(enclosed, region)| (enclosed, Curve::new(region, sides, elements)))
            .unzip();
        let in_mm = |at: Point| [0, 1].map(|axis| at[axis] * sides[axis]);
        let crowded = |at: Point| FitFault::Crowded(in_mm(at));
        let fault = |misfit| match misfit {
            Misfit::Crowded(at) => crowded(at),
            Misfit::Area(number, area, near) => FitFault::Area {
                region: enclosed[number],
                less: area * sides[0] * sides[1],
                near: near.map(in_mm),
            },
        };
        let mut snapped = Snapped::new(elements, &curves).map_err(fault)?;
        let content = |snapped: &Snapped, cell: usize, half: usize| {
            content(&enclosed, borders, |curve| snapped.is_inside(cell, half, curve))
        };
        let (fine, mapped, is_mapped) = loop {
            let fine = mapped::fine_nodes(elements, &snapped, &curves);
            let area = |cell: usize, half: usize| mapped::area(elements, &snapped, &fine, cell, half);
            snapped.check_areas(&curves, area).map_err(fault)?;
            match Mapped::new(layout, scale, &snapped, &fine, |cell, half| {
                content(&snapped, cell, half)
            }) {
                Ok((mapped, is_mapped)) => break (fine, mapped, is_mapped),
                Err(flat) => {
                    // Where a border meets another one or a side at a small angle, its curve may fold elements.
                    let straighten = |(cell, half): &mapped::Half| snapped.straighten(*cell, *half);
                    if flat.iter().map(straighten).filter(|is_new| *is_new).count() == 0 {
                        return Err(FitFault::Flat(in_mm(snapped.middle_of(flat[0].0))));
                    }
                }
            }
        };
        let regular = (0..elements[0] * elements[1]).map(|cell| (!is_mapped[cell]).then(|| content(&snapped, cell, 0)));
        let [columns, rows] = layout.nodes();
        let every = 2 / layout.degree();
        let wide = 2 * elements[0] + 1;
        let node = |at: usize| fine[at / columns * every * wide + at % columns * every];
        let mut fitted = Self {
            nodes: (0..columns * rows).map(node).collect(),
            regular: regular.collect(),
            mapped,
            interpolations: Vec::new(),
        };
        fitted.interpolations = interpolation::at_cell_corners(layout, step, &fitted).map_err(crowded)?;
        Ok(fitted)
    }

    /// Returns the position of a node (column, row) in units of elements.
    #[must_use]
    pub fn position(&self, layout: NodeLayout, [column, row]: [usize; 2]) -> Point {
        self.nodes[row * layout.nodes()[0] + column]
    }

    /// Returns the content of an element (column, row); `None` if it is mapped.
    #[must_use]
    pub fn regular(&self, layout: NodeLayout, [column, row]: [usize; 2]) -> Option<Content> {
        self.regular[row * layout.columns() + column]
    }

    /// Returns the mapped elements.
    #[must_use]
    pub fn mapped(&self) -> &Mapped {
        &self.mapped
    }

    /// Returns whether all elements are those of a uniform grid, with the parts of their cells; `part` is that of an
    /// element.
    #[must_use]
    pub fn is_uniform(&self, part: impl Fn(usize) -> Part) -> bool {
        let is_cell = |(at, content): (usize, &Option<Content>)| {
            content.is_some_and(|content| content.group.is_none() && content.part == part(at))
        };
        self.regular.iter().enumerate().all(is_cell)
    }

    /// Returns the weights of the nodes of the mapped element that covers a point in units of elements, and its part;
    /// `None` if none does.
    #[must_use]
    pub fn covering(&self, layout: NodeLayout, point: Point) -> Option<(Vec<(usize, f64)>, Part)> {
        let vertex = point.map(|at| at.round().max(0.0) as usize);
        interpolation::covering(layout, self, vertex, point)
    }

    /// Returns how values at moved corners of cells follow from those of nodes.
    #[must_use]
    pub fn interpolations(&self) -> &[Interpolation] {
        &self.interpolations
    }
}

/// Returns the content of an element that is inside some borders.
fn content(enclosed: &[Enclosed], borders: &Borders, is_inside: impl Fn(usize) -> bool) -> Content {
    let mut found = Content {
        part: Part::Membrane,
        group: borders.electrodes.as_ref().map(|_| 0),
    };
    let mut is_frame = false;
    for (curve, enclosed) in enclosed.iter().enumerate() {
        match (enclosed, is_inside(curve)) {
            (Enclosed::Opening, inside) => is_frame = !inside,
            (Enclosed::Body(number), true) => found.part = Part::Body(*number),
            (Enclosed::Electrode(group), true) => found.group = Some(*group),
            (_, false) => {}
        }
    }
    if is_frame {
        found.part = Part::Frame;
    }
    found
}
