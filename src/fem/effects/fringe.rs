//! Fringe field: the field beyond the edges of an electrode makes it act like a larger one.
//!
//! The permittivity of an elastomer is several times that of air, so the field stays inside: near the edge it obeys
//! Laplace's equation in a layer of half-thickness h/2, with a given potential on the electrode and no flux through the
//! bare face. The conformal map of that half-covered strip gives the charge of an electrode that is longer by (2/π) ln
//! 2 · h/2 = (ln 2/π)h = 0.2206 h (the end correction of a strip that is wide on one side; Maxwell, Treatise on
//! Electricity and Magnetism, vol. 1, chapter XII, for the edge of a plate between two planes, which is the same
//! problem). The edge of an active region therefore moves outward by d = 0.2206 H/λp², with the thickness H/λp² of the
//! prestretched membrane: the region is dilated by a square of half-width d. Nothing is active on the frame. The effect
//! vanishes as H → 0.
//!
//! If the strip is narrow in a bilinear element, the elements are those without a fringe field: the edge of the dilated
//! region lies within them, and the activities of their points make the forces of the voltage exact (see [`Activity`]).
//! At the edge the displacement has a kink, which matters for wider strips, and reduces the accuracy of biquadratic
//! elements. There elements end at the end of the strip, which takes up to two more elements along a cell: nine times
//! the work on the coarsest mesh, 1.6 times on the finest. In both cases the errors of a mesh are those without a
//! fringe field.

use std::f64::consts::{LN_2, PI};

use super::effect::{DISPLACED, Effect, SMALL, Significance, Verdict, switch};
use crate::element::Line;
use crate::error::SetupError;
use crate::grid::{Grid, THINNEST};
use crate::operator::{Activity, Within, load_of};
use crate::sheet::Sheet;
use deaflow_field::{Mesh, Order};
use deaflow_pattern::Pattern;
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, On, Scene};

/// Strips narrower than this share of a bilinear element lie within it. Up to a sixteenth, errors in the largest
/// displacement are those without a fringe field; at a quarter they are more than twice as large.
const MAX_WIDTH_WITHIN: f64 = 1.0 / 16.0;

/// The displacement of electrode edges by the fringe field.
#[derive(Clone, Debug, PartialEq)]
pub struct Fringe {
    /// Along x and y in units of the sides of a cell, at most a half.
    shift: [f64; 2],
    sheet: Sheet,
}

impl Fringe {
    /// Creates the fringe field of a scene.
    ///
    /// # Errors
    /// If it reaches beyond half a cell.
    pub fn new(scene: &Scene) -> Result<Self, SetupError> {
        let sheet = Sheet::of(scene);
        let (reach_mm, sides) = (LN_2 / PI * scene.prestretched_thickness_mm(), sheet.membrane.cell_mm());
        let cell_mm = sides[0].min(sides[1]);
        if reach_mm > 0.5 * cell_mm {
            return Err(SetupError::FringeField { reach_mm, cell_mm });
        }
        Ok(Self {
            shift: sides.map(|side| reach_mm / side),
            sheet,
        })
    }

    /// Returns the grid of a mesh.
    #[must_use]
    pub fn grid(&self, mesh: Mesh) -> Grid {
        let width = self.shift[0].max(self.shift[1]) * mesh.elements_per_cell() as f64;
        match mesh.order() {
            Order::Bilinear if width < MAX_WIDTH_WITHIN => Grid::uniform(mesh, &self.sheet),
            _ => Grid::along_strips(mesh, &self.sheet, self.shift),
        }
    }

    /// Returns the dilated pattern on a grid of [`Fringe::grid`], with a share of the load for each electrode group.
    /// Where the fringe fields of two groups meet, the stronger one acts.
    ///
    /// # Panics
    /// If a cell belongs to a group without share.
    #[must_use]
    pub fn activity(&self, grid: &Grid, pattern: &Pattern, loads: &[f64]) -> Activity {
        match (grid.is_uniform(), grid.order()) {
            (false, _) => self.along_strips(grid, pattern, loads),
            (true, Order::Bilinear) => self.within_elements::<2, 4>(grid, &Line::LINEAR, pattern, loads),
            (true, Order::Biquadratic) => self.within_elements::<3, 9>(grid, &Line::QUADRATIC, pattern, loads),
        }
    }

    /// For elements that end at the end of the strips.
    fn along_strips(&self, grid: &Grid, pattern: &Pattern, loads: &[f64]) -> Activity {
        let (per_cell, raster) = (grid.per_cell(), pattern.raster());
        let strips = self.shift.map(|shift| shift.max(THINNEST));
        // A strip too thin for an element is widened, with a reduced activity.
        let strengths = [0, 1].map(|axis| self.shift[axis] / strips[axis]);
        let zone_of = [0, 1].map(|axis| -> Vec<usize> {
            let strip = strips[axis];
            (0..per_cell[axis])
                .map(|at| grid.middle_in_cell(axis, at))
                .map(|middle| usize::from(middle > strip) + usize::from(middle > 1.0 - strip))
                .collect()
        });
        let cells = zones_of_cells(pattern, loads);
        Activity::from_elements(grid, |[column, row]| {
            let [cell_x, cell_y] = [column / per_cell[0], row / per_cell[1]];
            let zones = &cells[cell_y * raster.columns() + cell_x];
            let [x, y] = [zone_of[0][column % per_cell[0]], zone_of[1][row % per_cell[1]]];
            match pattern.is_active(cell_x, cell_y) {
                true => zones[1][1],
                false => zones[y][x] * strength([x, y], strengths),
            }
        })
    }

    /// For uniform elements.
    fn within_elements<const A: usize, const N: usize>(
        &self,
        grid: &Grid,
        line: &Line<A>,
        pattern: &Pattern,
        loads: &[f64],
    ) -> Activity {
        let (per_cell, raster) = (grid.per_cell(), pattern.raster());
        // For each element along a cell.
        let parts: [Vec<[ZoneShares<A>; 3]>; 2] = [0, 1].map(|axis| {
            let zones = |at| zones_in(line, [at, per_cell[axis]], self.shift[axis]);
            (0..per_cell[axis]).map(zones).collect()
        });
        let cells = zones_of_cells(pattern, loads);
        let weights = std::array::from_fn(|q| line.weights[q % A] * line.weights[q / A]);
        Activity::from_points(grid, weights, |column, row| {
            let loads = &cells[row / per_cell[1] * raster.columns() + column / per_cell[0]];
            let [along, across] = [&parts[0][column % per_cell[0]], &parts[1][row % per_cell[1]]];
            let mut within = Within {
                points: [0.0; N],
                strongest: 0.0,
            };
            for (loads, across) in loads.iter().zip(across) {
                for (load, along) in loads.iter().zip(along) {
                    if *load == 0.0 || !along.is_present() || !across.is_present() {
                        continue;
                    }
                    within.strongest = within.strongest.max(*load);
                    for (q, point) in within.points.iter_mut().enumerate() {
                        *point += load * along.of_points[q % A] * across.of_points[q / A];
                    }
                }
            }
            within
        })
    }
}

/// The shares of a zone of a cell at the points of an element along an axis: the integral of the basis function of each
/// point over the zone, over the weight of the point.
#[derive(Clone, Copy, Debug)]
struct ZoneShares<const A: usize> {
    of_points: [f64; A],
    /// Part of the length of the element in the zone.
    length: f64,
}

impl<const A: usize> ZoneShares<A> {
    fn is_present(&self) -> bool {
        self.length > 0.0
    }
}

/// Returns the shares of the first strip, the middle and the last strip of a cell in element `at` of `count` along it.
fn zones_in<const A: usize>(line: &Line<A>, [at, count]: [usize; 2], strip: f64) -> [ZoneShares<A>; 3] {
    // In units of the element, from its start.
    let place = |cell: f64| (cell * count as f64 - at as f64).clamp(0.0, 1.0);
    let edges = [0.0, place(strip), place(1.0 - strip), 1.0];
    std::array::from_fn(|zone| {
        let [from, to] = [edges[zone], edges[zone + 1]];
        let basis = |q: usize, x: f64| -> f64 {
            let others = (0..A).filter(|other| *other != q);
            let factor = |other: usize| (x - line.points[other]) / (line.points[q] - line.points[other]);
            others.map(factor).product()
        };
        // Gauss quadrature is exact for polynomials of this degree.
        let integral = |q: usize| -> f64 {
            let sum = |p: usize| line.weights[p] * basis(q, from + (to - from) * line.points[p]);
            (to - from) * (0..A).map(sum).sum::<f64>()
        };
        ZoneShares {
            of_points: std::array::from_fn(|q| integral(q) / line.weights[q]),
            length: to - from,
        }
    })
}

/// Returns the activity of a zone of a bare cell.
fn strength([x, y]: [usize; 2], [along, across]: [f64; 2]) -> f64 {
    match (x, y) {
        (_, 1) => along,
        (1, _) => across,
        // If both strips are wide enough this is 1.
        _ => along.min(across),
    }
}

/// Returns [`zones`] of all cells, row by row.
fn zones_of_cells(pattern: &Pattern, loads: &[f64]) -> Vec<[[f64; 3]; 3]> {
    let raster = pattern.raster();
    let cells = (0..raster.cells()).map(|i| [i % raster.columns(), i / raster.columns()]);
    cells.map(|[x, y]| zones(pattern, x, y, loads)).collect()
}

/// Returns the load of each of the nine zones of a cell, `[y][x]`, in the dilated pattern: that of an active cell, or
/// for a bare one the largest of the active neighbours next to the zone.
fn zones(pattern: &Pattern, x: usize, y: usize, loads: &[f64]) -> [[f64; 3]; 3] {
    let [columns, rows] = pattern.raster().sides();
    let load = |dx: usize, dy: usize| {
        let (x, y) = (x + dx, y + dy);
        let is_inside = (1..=columns).contains(&x) && (1..=rows).contains(&y);
        if is_inside {
            load_of(pattern.group(x - 1, y - 1), loads)
        } else {
            0.0
        }
    };
    if pattern.is_active(x, y) {
        return [[load(1, 1); 3]; 3];
    }
    std::array::from_fn(|dy| std::array::from_fn(|dx| load(dx, 1).max(load(1, dy)).max(load(dx, dy))))
}

/// The effect, as an entry of [`super::EFFECTS`].
pub struct FringeField;

impl Effect for FringeField {
    fn name(&self) -> &'static str {
        names::FRINGE
    }

    fn cost(&self) -> &'static str {
        "1.4× to 6× a solve"
    }

    switch!(fringe_field);

    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        effects.fringe_field = Fringe::new(scene).is_ok().then_some(On {});
    }

    fn changes_displacement(&self) -> bool {
        true
    }

    fn assess(&self, scene: &Scene) -> Option<Significance> {
        let refusal = Fringe::new(scene).err()?;
        let change = format!("it could not be simulated: {refusal}");
        Some(Significance::open(DISPLACED, Verdict::Significant, SMALL, change))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;
    use deaflow_pattern::Symmetry;

    /// Returns the active areas of elements, in cells.
    fn areas(mesh: Mesh, fringe: &Fringe, pattern: &Pattern) -> Vec<f64> {
        let grid = fringe.grid(mesh);
        let activity = fringe.activity(&grid, pattern, &[1.0]);
        let [m, n] = grid.per_cell();
        let elements = grid.layout().each_element();
        elements
            .map(|element| activity.area(element) / (m * n) as f64)
            .collect()
    }

    fn fringe(shift: f64) -> Fringe {
        Fringe {
            shift: [shift; 2],
            sheet: Sheet::paper(),
        }
    }

    /// Returns the active area in cells on bilinear elements, and checks that it is the same on biquadratic ones.
    fn total(fringe: &Fringe, per_cell: usize, pattern: &Pattern) -> f64 {
        let [within, along] = [Mesh::bilinear(per_cell), Mesh::biquadratic(per_cell)]
            .map(|mesh| areas(mesh, fringe, pattern).iter().sum::<f64>());
        // To first order: the corners of a strip too thin for an element are too small by a thousandth.
        let thinnest = fringe.shift[0].min(THINNEST);
        assert!(
            (within - along).abs() < 4.1 * THINNEST * thinnest + 1e-7,
            "{within} {along}"
        );
        within
    }

    #[test]
    fn one_cell_grows_to_the_square_around_it() {
        let scene = Scene::with_values(50.0, 5.0, 2.0, 45e3, 4.7, 1e3);
        let fringe = Fringe::new(&scene).unwrap();
        let d = LN_2 / PI * 1.25;
        assert!(fringe.shift.iter().all(|shift| (shift - d).abs() < 1e-15));
        for per_cell in 1..=8 {
            let at = |cx, cy| {
                total(
                    &fringe,
                    per_cell,
                    &Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (cx, cy)),
                )
            };
            assert!((at(20, 31) - (1.0 + 2.0 * d).powi(2)).abs() < 1e-12);
            assert!((at(0, 31) - (1.0 + d) * (1.0 + 2.0 * d)).abs() < 1e-12);
            assert!((at(49, 0) - (1.0 + d).powi(2)).abs() < 1e-12);
        }
    }

    #[test]
    fn overlapping_fringes_count_once() {
        // Two cells with a bare one between them, and two that touch at a corner: areas by hand.
        let fringe = fringe(0.3);
        let gap = Pattern::from_fn(Raster::PAPER, |x, y| y == 10 && (x == 10 || x == 12));
        assert!((total(&fringe, 3, &gap) - 2.0 * 1.6 * 1.6).abs() < 1e-12);
        let touching = Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (10, 10) || (x, y) == (11, 11));
        assert!((total(&fringe, 3, &touching) - (2.0 * 1.6 * 1.6 - 0.6 * 0.6)).abs() < 1e-12);
        assert!((total(&fringe, 3, &Pattern::from_fn(Raster::PAPER, |_, _| true)) - 2500.0).abs() < 1e-7);
    }

    #[test]
    fn the_thinnest_strips_keep_their_area() {
        for shift in [0.5, 1e-3, 1e-4, 1e-7, 0.0] {
            let one = Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (20, 31));
            let area = total(&fringe(shift), 1, &one);
            assert!((area - (1.0 + 2.0 * shift).powi(2)).abs() < 1e-12, "{shift}: {area}");
        }
    }

    /// The integral of xⁿ over the zone is that over the element with the weights of the zone.
    #[test]
    fn points_integrate_zones_exactly() {
        fn check<const A: usize>(line: &Line<A>) {
            for (count, strip) in [(1, 0.02), (1, 0.4), (2, 0.3), (3, 0.5), (4, 0.37)] {
                for at in 0..count {
                    let place = |cell: f64| (cell * f64::from(count) - f64::from(at)).clamp(0.0, 1.0);
                    let edges = [0.0, place(strip), place(1.0 - strip), 1.0];
                    let zones = zones_in(line, [at as usize, count as usize], strip);
                    for (zone, edges) in zones.iter().zip(edges.windows(2)) {
                        for n in 0..A as i32 {
                            let term = |q: usize| line.weights[q] * zone.of_points[q] * line.points[q].powi(n);
                            let found: f64 = (0..A).map(term).sum();
                            let exact = (edges[1].powi(n + 1) - edges[0].powi(n + 1)) / f64::from(n + 1);
                            assert!(
                                (found - exact).abs() < 1e-14,
                                "{count} {strip} {at} {n}: {found} {exact}"
                            );
                        }
                    }
                }
            }
        }
        check(&Line::LINEAR);
        check(&Line::QUADRATIC);
    }

    #[test]
    fn it_follows_the_symmetries() {
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| (x * x + 3 * y + x * y) % 7 < 3);
        let fringe = fringe(0.2);
        for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
            let sorted = |pattern: &Pattern| {
                let mut areas = areas(mesh, &fringe, pattern);
                areas.sort_by(f64::total_cmp);
                areas
            };
            let reference = sorted(&pattern);
            for g in Symmetry::ALL {
                let image = sorted(&pattern.transformed(g));
                let gap = image
                    .iter()
                    .zip(&reference)
                    .map(|(a, b)| (a - b).abs())
                    .fold(0.0, f64::max);
                assert!(gap < 1e-14);
            }
        }
    }

    #[test]
    fn a_membrane_too_thick_for_its_cells_is_refused() {
        // 0.2206 · 2.3 mm is more than half a millimetre.
        let refusal = Fringe::new(&Scene::with_values(50.0, 2.3, 1.0, 45e3, 4.7, 1e3)).unwrap_err();
        assert!(matches!(refusal, SetupError::FringeField { .. }), "{refusal}");
        assert!(Fringe::new(&Scene::with_values(50.0, 2.2, 1.0, 45e3, 4.7, 1e3)).is_ok());
    }
}
