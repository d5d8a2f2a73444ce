//! The grid of elements of a membrane.
//!
//! Laws assume equal prestretch. With λ = √(λ₁λ₂) and D = diag(λ₁, λ₂)/λ the deformation gradient is F = λ f with f =
//! (I + ∇u) D. So a membrane with unequal prestretch is one with prestretch λ whose elements are shorter by D, and
//! which is at rest at f = D. D has the determinant 1, so areas do not change.

use std::ops::Range;
use std::sync::Arc;

use deaflow_field::{Mesh, Motion, Order};
use deaflow_pattern::{Part, Parts, Polygons, Raster};

use super::boundary::Boundary;
use super::element::Element;
use super::error::SetupError;
use super::fitted::{Content, Fitted, Mapped, MappedElement};
use super::kernels::{add_rest, scale_gradients, scale_stresses};
use super::kinematics::Tensor;
use super::lanes::Real;
use super::layout::{FreeSides, NodeLayout};
use super::rigid::Pose;
use super::sheet::{Mount, Sheet, SheetSides};
use super::supports::Supports;

/// Smallest width of an element, in units of the side of a cell.
pub const THINNEST: f64 = 1e-3;
/// Largest number of elements along a cell: that of the finest mesh, and two for strips.
const MOST: usize = Mesh::MOST_ELEMENTS + 2;

/// The grid of elements. Their sizes are the same in every cell, symmetric about its middle, with the mean 1: the unit
/// along each side is the size of uniform elements.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    raster: Raster,
    order: Order,
    axes: [Axis; 2],
    /// Mean sides of elements, shorter by D, in units of the root of their area: their product is 1.
    sides: [f64; 2],
    /// D.
    rest: [f64; 2],
    unit_mm: f64,
    parts: Option<Arc<Parts>>,
    /// Nodes and elements that follow curved borders, if any.
    fitted: Option<Arc<Fitted>>,
    supports: Option<Arc<Supports>>,
    /// The supports of the sides in units of the grid, if not all are held.
    sheet_sides: Option<SheetSides>,
    /// The forces on sides that are not held, if any.
    boundary: Option<Arc<Boundary>>,
}

/// The elements along one side of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Axis {
    count: usize,
    /// Sizes, if they differ.
    sizes: Option<[f64; MOST]>,
}

impl Axis {
    fn uniform(count: usize) -> Self {
        Self { count, sizes: None }
    }

    /// Elements no larger than a cell divided by `count`, with edges at a distance of `strip` from its sides.
    fn along_strips(count: usize, strip: f64) -> Self {
        let strip = strip.max(THINNEST);
        let count = |width: f64| (width * count as f64 - 1e-9).ceil() as usize;
        let gap = 1.0 - 2.0 * strip;
        let (strip, inner) = if gap < THINNEST {
            (0.5, 0)
        } else {
            (strip, count(gap).max(1))
        };
        let outer = count(strip).max(1);
        let all = inner + 2 * outer;
        let size = |at: usize| {
            let width = if at < outer || at >= outer + inner {
                strip / outer as f64
            } else {
                gap / inner as f64
            };
            all as f64 * width
        };
        Self {
            count: all,
            sizes: Some(std::array::from_fn(|at| if at < all { size(at) } else { 1.0 })),
        }
    }

    fn size(&self, at: usize) -> f64 {
        self.sizes.map_or(1.0, |sizes| sizes[at % self.count])
    }

    fn start(&self, at: usize) -> f64 {
        let first = at - at % self.count;
        first as f64 + (first..at).map(|at| self.size(at)).sum::<f64>()
    }
}

impl Grid {
    /// Creates a grid of uniform elements.
    #[must_use]
    pub fn uniform(mesh: Mesh, sheet: &Sheet) -> Self {
        Self::new(mesh.order(), sheet, [Axis::uniform(mesh.elements_per_cell()); 2])
    }

    /// Creates a grid with elements no larger than those of a mesh, and edges at a distance of `strips` from the sides
    /// of each cell, along x and y in units of its sides, up to ½. Thinner strips are widened to [`THINNEST`], and
    /// thinner gaps closed.
    #[must_use]
    pub fn along_strips(mesh: Mesh, sheet: &Sheet, strips: [f64; 2]) -> Self {
        let axis = |strip| Axis::along_strips(mesh.elements_per_cell(), strip);
        Self::new(mesh.order(), sheet, strips.map(axis))
    }

    /// Creates a grid of elements that are uniform but near the borders of the sheet, which they follow.
    ///
    /// # Errors
    /// If they cannot.
    pub fn fitted(mesh: Mesh, sheet: &Sheet) -> Result<Self, SetupError> {
        let Some(borders) = &sheet.borders else {
            return Ok(Self::uniform(mesh, sheet));
        };
        let mut grid = Self::without_supports(mesh.order(), sheet, [Axis::uniform(mesh.elements_per_cell()); 2]);
        let elements = grid.elements();
        let sides = [0, 1].map(|axis| sheet.membrane.size_mm[axis] / elements[axis] as f64);
        let fitted =
            Fitted::new(grid.layout(), sides, grid.sides, grid.per_cell(), borders).map_err(SetupError::Borders)?;
        let part = |at: usize| grid.content([at % elements[0], at / elements[0]]).part;
        if fitted.is_uniform(part) {
            return Ok(Self::uniform(mesh, sheet));
        }
        grid.fitted = Some(Arc::new(fitted));
        // Nodes on the sides may have moved along them.
        Ok(grid.with_sides(sheet.sides).with_supports(sheet))
    }

    fn new(order: Order, sheet: &Sheet, axes: [Axis; 2]) -> Self {
        Self::without_supports(order, sheet, axes).with_supports(sheet)
    }

    fn without_supports(order: Order, sheet: &Sheet, axes: [Axis; 2]) -> Self {
        let (cells, size) = (sheet.raster().sides(), sheet.membrane.size_mm);
        let [width, height] = [0, 1].map(|axis| size[axis] / (cells[axis] * axes[axis].count) as f64);
        let rest = sheet.distortion();
        let side = (width / height).sqrt() / rest[0];
        Self {
            raster: sheet.raster(),
            order,
            axes,
            sides: [side, 1.0 / side],
            rest,
            unit_mm: (width * height).sqrt(),
            parts: sheet.parts.clone(),
            fitted: None,
            supports: None,
            sheet_sides: None,
            boundary: None,
        }
        .with_sides(sheet.sides)
    }

    fn with_sides(mut self, sides: Option<SheetSides>) -> Self {
        self.sheet_sides = sides.map(|sides| sides.in_units(self.unit_mm));
        self.boundary = None;
        if let Some(sides) = &self.sheet_sides {
            self.boundary = Some(Arc::new(Boundary::new(&self, sides)));
        }
        self
    }

    /// Returns the grid of a membrane on whose sides nothing acts, and without supports.
    #[must_use]
    pub fn opened(&self) -> Self {
        let opened = Self {
            supports: None,
            ..self.clone()
        };
        opened.with_sides(Some(SheetSides::FREE))
    }

    /// Returns the supports of the sides in units of the grid; `None` if all are held.
    #[must_use]
    pub fn sheet_sides(&self) -> Option<&SheetSides> {
        self.sheet_sides.as_ref()
    }

    fn free_sides(&self) -> FreeSides {
        let sides = self.sheet_sides.as_ref();
        sides.map_or_else(FreeSides::default, |sides| FreeSides::new(sides.held))
    }

    fn with_supports(mut self, sheet: &Sheet) -> Self {
        if sheet.parts.is_none() && sheet.sides.is_none() {
            return self;
        }
        let mounts: Vec<Mount> = sheet.mounts.iter().map(|mount| mount.in_units(self.unit_mm)).collect();
        let borders = sheet.borders.as_ref().filter(|_| self.fitted.is_some());
        let exact = borders.map(|borders| {
            let centroids = borders.bodies.iter().filter_map(Polygons::centroid);
            centroids.map(|centroid| centroid.map(|at| at / self.unit_mm)).collect()
        });
        self.supports = Some(Arc::new(Supports::new(&self, exact, &mounts)));
        self
    }

    /// Returns whether another grid has the same inverse Laplacian, that of the rectangle with the same supports:
    /// mapped elements and electrodes are not in it.
    #[must_use]
    pub fn shares_laplacian(&self, other: &Self) -> bool {
        let of_rectangle = |grid: &Self| {
            let sides = grid.free_sides();
            (grid.raster, grid.order, grid.axes, grid.sides, grid.rest, sides)
        };
        of_rectangle(self) == of_rectangle(other) && self.supports == other.supports
    }

    /// Returns the parts of the sheet; `None` if all cells are membrane.
    #[must_use]
    pub fn parts(&self) -> Option<&Parts> {
        self.parts.as_deref()
    }

    /// Returns whether a cell (column, row) is membrane.
    #[must_use]
    pub fn is_membrane(&self, x: usize, y: usize) -> bool {
        self.parts().is_none_or(|parts| parts.at(x, y) == Part::Membrane)
    }

    /// Returns the supports of nodes inside the rectangle; `None` if all are free.
    #[must_use]
    pub fn supports(&self) -> Option<&Supports> {
        self.supports.as_deref()
    }

    /// Returns the forces on sides that are not held; `None` if all are held.
    #[must_use]
    pub fn boundary(&self) -> Option<&Boundary> {
        self.boundary.as_deref()
    }

    /// Like [`Self::supports`], with shared ownership.
    #[must_use]
    pub fn shared_supports(&self) -> Option<Arc<Supports>> {
        self.supports.clone()
    }

    /// Returns the grid for displacements out of the plane, in which bodies translate alone, on springs of these rates.
    #[must_use]
    pub fn levelled(&self, springs: &[f64]) -> Self {
        let supports = self.supports().map(|supports| Arc::new(supports.levelled(springs)));
        Self {
            supports,
            ..self.clone()
        }
    }

    /// Projects a vector onto the admissible changes of a displacement.
    pub fn restrict<T: Real>(&self, u: &[T], vector: &mut [T]) {
        self.restrict_at(&self.poses(u), vector);
    }

    /// Like [`Self::restrict`], for bodies at some poses.
    pub fn restrict_at<T: Real>(&self, poses: &[Pose], vector: &mut [T]) {
        self.layout().clear_frame(vector);
        if let Some(supports) = self.supports() {
            supports.restrict(poses, vector);
        }
    }

    /// Returns whether a node is free to move.
    #[must_use]
    pub fn moves(&self) -> bool {
        let rest = vec![0.0; self.layout().vector_len()];
        let mut free = vec![1.0; rest.len()];
        self.restrict(&rest, &mut free);
        free.iter().any(|free| *free != 0.0)
    }

    /// Returns the poses of the bodies at a displacement.
    #[must_use]
    pub fn poses<T: Real>(&self, u: &[T]) -> Vec<Pose> {
        self.supports().map_or_else(Vec::new, |supports| supports.poses(u))
    }

    /// Returns the poses of the bodies half-way in a step from a displacement.
    #[must_use]
    pub fn poses_between(&self, u: &[f64], change: &[f64]) -> Vec<Pose> {
        self.supports()
            .map_or_else(Vec::new, |supports| supports.poses_between(u, change))
    }

    /// Corrects a change of displacement so that the motion of every body is rigid.
    pub fn settle_change(&self, u: &[f64], change: &mut [f64]) {
        if let Some(supports) = self.supports() {
            supports.settle_change(u, change);
        }
    }

    /// Returns the motions of bodies at a displacement; `None` without bodies.
    #[must_use]
    pub fn motions(&self, u: &[f64]) -> Option<Vec<Motion>> {
        let bodies = self.supports()?.drawn_bodies();
        self.motions_of(u, 0..bodies)
    }

    /// Returns the motions of the bars on sides at a displacement; `None` without bars.
    #[must_use]
    pub fn bar_motions(&self, u: &[f64]) -> Option<Vec<Motion>> {
        let supports = self.supports()?;
        self.motions_of(u, supports.drawn_bodies()..supports.bodies().len())
    }

    fn motions_of(&self, u: &[f64], bodies: Range<usize>) -> Option<Vec<Motion>> {
        let motion = |pose: &Pose| Motion {
            translation: pose.translation.map(|t| self.unit_mm * t),
            rotation: pose.angle().to_degrees(),
        };
        (!bodies.is_empty()).then(|| self.poses(u)[bodies].iter().map(motion).collect())
    }

    /// Corrects a displacement so that the motion of every body is rigid, as needed after a step along the tangent.
    pub fn settle<T: Real>(&self, u: &mut [T]) {
        if let Some(supports) = self.supports() {
            supports.settle(u);
        }
    }

    /// Returns the position of a node (column, row) on the prestretched membrane, in units of [`Grid::unit_mm`].
    #[must_use]
    pub fn node_position(&self, node: [usize; 2]) -> [f64; 2] {
        if let Some(fitted) = &self.fitted {
            let position = fitted.position(self.layout(), node);
            return [0, 1].map(|axis| position[axis] * self.sides[axis] * self.rest[axis]);
        }
        let degree = self.layout().degree();
        [0, 1].map(|axis| {
            let (element, inner) = (node[axis] / degree, node[axis] % degree);
            let within = if inner == 0 {
                0.0
            } else {
                0.5 * self.size(axis, element)
            };
            (self.start(axis, element) + within) * self.sides[axis] * self.rest[axis]
        })
    }

    /// Returns the raster of cells.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.raster
    }

    /// Returns the polynomial order.
    #[must_use]
    pub fn order(&self) -> Order {
        self.order
    }

    /// Returns the number of elements along the sides of a cell.
    #[must_use]
    pub fn per_cell(&self) -> [usize; 2] {
        self.axes.map(|axis| axis.count)
    }

    /// Returns the numbers of columns and rows of elements.
    #[must_use]
    pub fn elements(&self) -> [usize; 2] {
        let ([columns, rows], [along, across]) = (self.raster.sides(), self.per_cell());
        [columns * along, rows * across]
    }

    /// Returns the layout of vectors.
    #[must_use]
    pub fn layout(&self) -> NodeLayout {
        let mapped_rows = self.fitted.as_ref().map_or(0, |fitted| fitted.mapped().rows());
        let layout = NodeLayout::new(self.elements(), self.order).with_mapped_rows(mapped_rows);
        layout.with_free_sides(self.free_sides())
    }

    /// Returns the nodes and elements that follow curved borders, if any.
    #[must_use]
    pub fn follows_borders(&self) -> Option<&Fitted> {
        self.fitted.as_deref()
    }

    /// Returns all elements (column, row): those of the grid but for cells that are mapped, row by row, then the mapped
    /// ones in the rows after them.
    pub fn each_element(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let (layout, fitted) = (self.layout(), self.fitted.clone());
        let count = fitted.as_ref().map_or(0, |fitted| fitted.mapped().elements().len());
        let columns = layout.columns();
        let regular = layout.each_element().filter(move |element| {
            let regular = |fitted: &Arc<Fitted>| fitted.regular(layout, *element).is_some();
            fitted.as_ref().is_none_or(regular)
        });
        let mapped = (0..count).map(move |at| [at % columns, layout.rows() + at / columns]);
        regular.chain(mapped)
    }

    /// Returns a mapped element (column, row) with all of them; `None` for one of the grid.
    fn mapped(&self, [column, row]: [usize; 2]) -> Option<(&Mapped, &MappedElement)> {
        let all = self.fitted.as_ref()?.mapped();
        let layout = self.layout();
        let number = row.checked_sub(layout.rows())? * layout.columns() + column;
        all.elements().get(number).map(|element| (all, element))
    }

    /// Returns the element (column, row) of the uniform grid that an element is, or is a part of.
    fn place(&self, element: [usize; 2]) -> [usize; 2] {
        self.mapped(element).map_or(element, |(_, mapped)| mapped.place)
    }

    /// Returns the cell of an element (column, row).
    #[must_use]
    pub fn cell_of(&self, element: [usize; 2]) -> [usize; 2] {
        let [column, row] = self.place(element);
        let [along, across] = self.per_cell();
        [column / along, row / across]
    }

    /// Returns what an element (column, row) is made of.
    #[must_use]
    pub fn content(&self, element: [usize; 2]) -> Content {
        let of_cell = || {
            let [x, y] = self.cell_of(element);
            Content {
                part: self.parts().map_or(Part::Membrane, |parts| parts.at(x, y)),
                group: None,
            }
        };
        match (self.mapped(element), &self.fitted) {
            (Some((_, mapped)), _) => mapped.content,
            (None, Some(fitted)) => fitted.regular(self.layout(), element).unwrap_or_else(of_cell),
            (None, None) => of_cell(),
        }
    }

    /// Returns the indices of the nodes of an element (column, row) for the first component.
    #[must_use]
    pub fn nodes_of<const N: usize>(&self, element: [usize; 2]) -> [usize; N] {
        let (layout, place) = (self.layout(), self.place(element));
        std::array::from_fn(|node| layout.node_of(place, node))
    }

    /// Returns the indices of the nodes that an element (column, row) depends on, for the first component.
    #[must_use]
    pub fn own_nodes(&self, element: [usize; 2]) -> Vec<usize> {
        let layout = self.layout();
        let all: Vec<usize> = match layout.degree() {
            1 => self.nodes_of::<4>(element).to_vec(),
            _ => self.nodes_of::<9>(element).to_vec(),
        };
        match self.mapped(element) {
            Some((_, mapped)) => all
                .into_iter()
                .zip(mapped.has_nodes(layout.degree()))
                .filter_map(|(index, has)| has.then_some(index))
                .collect(),
            None => all,
        }
    }

    /// Returns the area of each point of an element (column, row), given the weights of the points of a square.
    #[must_use]
    pub fn areas_of<const N: usize>(&self, element: [usize; 2], weights: [f64; N]) -> [f64; N] {
        match self.mapped(element) {
            Some((mapped, _)) => mapped.areas_of(self.layout(), element),
            None => {
                let [width, height] = [0, 1].map(|axis| self.size(axis, element[axis]));
                weights.map(|weight| weight * width * height)
            }
        }
    }

    /// Returns the area of an element (column, row), in units of the mean area of elements; 0 if its cell is mapped.
    #[must_use]
    pub fn area_of(&self, element: [usize; 2]) -> f64 {
        let layout = self.layout();
        if let Some((mapped, _)) = self.mapped(element) {
            return mapped.area_of(layout, element);
        }
        match &self.fitted {
            Some(fitted) if fitted.regular(layout, element).is_none() => 0.0,
            _ => self.size(0, element[0]) * self.size(1, element[1]),
        }
    }

    /// Returns ∇u D at the points of an element (column, row), from its nodal values.
    #[must_use]
    pub fn changes<E: Element<N>, const N: usize>(
        &self,
        element: [usize; 2],
        nodal: &[[f64; N]; 2],
    ) -> [Tensor<f64>; N] {
        if let Some((mapped, _)) = self.mapped(element) {
            return mapped.gradients(self.layout(), element, nodal);
        }
        let mut gradients = E::gradients(nodal);
        scale_gradients(&mut gradients, self.sides(element).map(f64::recip));
        gradients
    }

    /// Returns f − I at the points of an element (column, row), from its nodal displacements.
    #[must_use]
    pub fn gradients<E: Element<N>, const N: usize>(
        &self,
        element: [usize; 2],
        nodal: &[[f64; N]; 2],
    ) -> [Tensor<f64>; N] {
        let mut gradients = self.changes::<E, N>(element, nodal);
        add_rest(&mut gradients, self.rest());
        gradients
    }

    /// Returns the consistent masses of pairs of nodes of an element (column, row) for the density 1, as a factor and a
    /// matrix.
    #[must_use]
    pub fn mass_of<E: Element<N>, const N: usize>(&self, element: [usize; 2]) -> (f64, [[f64; N]; N]) {
        if self.mapped(element).is_none() {
            return (self.sides(element).iter().product(), E::masses());
        }
        let areas = self.areas_of(element, E::WEIGHTS);
        let values = self.values_of::<E, N>(element);
        let mass = |a: usize, b: usize| (0..N).map(|q| areas[q] * values[q][a] * values[q][b]).sum();
        (1.0, std::array::from_fn(|a| std::array::from_fn(|b| mass(a, b))))
    }

    /// Returns the basis functions at the points of an element (column, row), `[point][node]`.
    #[must_use]
    pub fn values_of<E: Element<N>, const N: usize>(&self, element: [usize; 2]) -> [[f64; N]; N] {
        match self.mapped(element) {
            Some((_, mapped)) => mapped.values_at_points(E::DEGREE),
            None => E::values(),
        }
    }

    /// Returns the nodal forces of the stresses at the points of an element (column, row).
    #[must_use]
    pub fn forces<E: Element<N>, const N: usize>(
        &self,
        element: [usize; 2],
        mut stresses: [Tensor<f64>; N],
    ) -> [[f64; N]; 2] {
        if let Some((mapped, _)) = self.mapped(element) {
            return mapped.forces(self.layout(), element, &stresses);
        }
        scale_stresses(&mut stresses, self.sides(element));
        E::forces(&stresses)
    }

    /// Returns the root of the mean area of elements in mm, which is the unit of displacements.
    #[must_use]
    pub fn unit_mm(&self) -> f64 {
        self.unit_mm
    }

    /// Returns whether all elements are squares of side 1, at rest at f = I.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        self.is_uniform() && self.sides == [1.0; 2] && self.rest == [1.0; 2]
    }

    /// Returns whether all elements have the same size.
    #[must_use]
    pub fn is_uniform(&self) -> bool {
        self.fitted.is_none() && self.axes.iter().all(|axis| axis.sizes.is_none())
    }

    /// Returns f at rest.
    #[must_use]
    pub fn rest(&self) -> [f64; 2] {
        self.rest
    }

    /// Returns the sides of an element (column, row), shorter by D, in units of [`Grid::unit_mm`]: derivatives along
    /// them give f.
    #[must_use]
    pub fn sides(&self, element: [usize; 2]) -> [f64; 2] {
        [0, 1].map(|axis| self.size(axis, element[axis]) * self.sides[axis])
    }

    /// Returns the size of an element by its column for axis 0, or its row for axis 1.
    #[must_use]
    pub fn size(&self, axis: usize, at: usize) -> f64 {
        self.axes[axis].size(at)
    }

    /// Returns the start of an element by its column or row.
    #[must_use]
    pub fn start(&self, axis: usize, at: usize) -> f64 {
        self.axes[axis].start(at)
    }

    /// Returns the middle of an element in its cell by its column or row, in units of the side of the cell.
    #[must_use]
    pub fn middle_in_cell(&self, axis: usize, at: usize) -> f64 {
        let Axis { count, .. } = self.axes[axis];
        (self.start(axis, at % count) + 0.5 * self.size(axis, at)) / count as f64
    }
}

impl Grid {
    /// Returns uniform elements on [`Sheet::paper`].
    #[must_use]
    pub fn paper(mesh: Mesh) -> Self {
        Self::uniform(mesh, &Sheet::paper())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Membrane;

    #[test]
    fn elements_fill_a_cell_symmetrically_and_end_at_the_strip() {
        for asked in 1..=Mesh::MOST_ELEMENTS {
            for strip in [0.001, 1.0 / 64.0, 0.1, 0.125, 0.2, 0.25, 0.3, 0.4, 0.49, 0.5] {
                let grid = Grid::along_strips(Mesh::biquadratic(asked), &Sheet::paper(), [strip, 0.5]);
                let [count, _] = grid.per_cell();
                assert!((asked..=asked + 2).contains(&count));
                let starts: Vec<f64> = (0..=count).map(|at| grid.start(0, at) / count as f64).collect();
                assert!((starts[count] - 1.0).abs() < 1e-14);
                for at in 0..count {
                    let size = starts[at + 1] - starts[at];
                    assert!((starts[at] + starts[count - at] - 1.0).abs() < 1e-14);
                    assert!(
                        size >= 0.999 * THINNEST && size * asked as f64 <= 1.0 + 1e-8,
                        "{asked} {strip}"
                    );
                    assert!((grid.size(0, at + 7 * count) - count as f64 * size).abs() < 1e-12);
                    assert!((grid.middle_in_cell(0, at + count) - starts[at] - 0.5 * size).abs() < 1e-14);
                }
                for edge in [strip, 1.0 - strip] {
                    assert!(
                        starts.iter().any(|start| (start - edge).abs() < 1e-14),
                        "{asked} {strip}"
                    );
                }
                assert!((grid.start(0, 3 * count + 1) / count as f64 - 3.0 - starts[1]).abs() < 1e-13);
            }
        }
    }

    #[test]
    fn what_is_too_thin_for_an_element_is_widened_or_closed() {
        let starts = |strip| {
            let grid = Grid::along_strips(Mesh::bilinear(2), &Sheet::paper(), [0.3, strip]);
            let [_, count] = grid.per_cell();
            (0..=count)
                .map(|at| grid.start(1, at) / count as f64)
                .collect::<Vec<_>>()
        };
        assert!((starts(1e-6)[1] - THINNEST).abs() < 1e-15);
        assert_eq!(starts(0.4999), [0.0, 0.5, 1.0]);
    }

    #[test]
    fn elements_of_rectangles_are_measured_in_the_root_of_their_area() {
        let sheet = Sheet {
            membrane: Membrane {
                raster: Raster::new(12, 40).unwrap(),
                size_mm: [60.0, 30.0],
            },
            prestretch: [4.0, 1.0],
            ..Sheet::paper()
        };
        let grid = Grid::uniform(Mesh::bilinear(2), &sheet);
        assert_eq!((grid.elements(), grid.layout().nodes()), ([24, 80], [25, 81]));
        // 2.5 × 0.375 mm; D = diag(2, ½).
        let unit = (2.5_f64 * 0.375).sqrt();
        let [along, across] = grid.sides([3, 70]);
        assert!((grid.unit_mm() - unit).abs() < 1e-14 && grid.rest() == [2.0, 0.5]);
        assert!((along - 1.25 / unit).abs() < 1e-14 && (across - 0.75 / unit).abs() < 1e-14);
        assert!((along * across - 1.0).abs() < 1e-14 && !grid.is_plain());
        for prestretch in [1.0, 3.0, 3.1, 7.3] {
            let sheet = Sheet {
                prestretch: [prestretch; 2],
                ..Sheet::paper()
            };
            let grid = Grid::uniform(Mesh::biquadratic(3), &sheet);
            assert!(grid.is_plain() && grid.unit_mm() == 50.0 / 150.0);
        }
    }
}
