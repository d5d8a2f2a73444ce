//! Fringe field: the field of an electrode bulges out at its edges, so that it acts like a larger one.
//!
//! The permittivity of an elastomer is several times that of air, so the field stays inside: next to the edge it obeys
//! Laplace's equation in a layer of half-thickness h/2, with a given potential on the electrode and no flux through the bare
//! face. The conformal map of that half-covered strip gives the charge of an electrode that is longer by
//! (2/π) ln 2 · h/2 = (ln 2/π)h = 0.2206 h (the end correction of a strip that is wide on one side; Maxwell, Treatise on
//! Electricity and Magnetism, vol. 1, chapter XII, for the edge of a plate between two planes, which is the same problem).
//! The edge of an active region therefore moves outward by d = 0.2206 H/λp², with H/λp² the thickness of the prestretched
//! membrane: the region is dilated by a square of half-width d. Nothing is active beyond the frame. Without effect as H → 0.
//!
//! Elements end where the strip ends, so that errors of a mesh are those without a fringe field. That takes up to two elements
//! more along a cell: nine times the work on the coarsest mesh, 1.6 times on the finest.

use std::f64::consts::{LN_2, PI};

use super::effect::{Assessment, DISPLACED, Effect, SMALL, Verdict};
use crate::fem::error::SetupError;
use crate::fem::grid::{Grid, THINNEST};
use crate::fem::operator::{Activity, load_of};
use crate::fem::sheet::Sheet;
use crate::field::Mesh;
use crate::pattern::Pattern;
use crate::scene::effects::names;
use crate::scene::{Effects, On, Scene};

/// How far edges move.
#[derive(Clone, Debug, PartialEq)]
pub struct Fringe {
    /// Along x and y in units of a cell's sides, at most a half.
    shift: [f64; 2],
    sheet: Sheet,
}

impl Fringe {
    /// The fringe of a scene.
    ///
    /// # Errors
    /// When it reaches further than half a cell.
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

    /// Elements that end where the electrodes act no more.
    #[must_use]
    pub fn grid(&self, mesh: Mesh) -> Grid {
        Grid::along_strips(mesh, &self.sheet, self.shift)
    }

    /// The dilated pattern on a grid of [`Fringe::grid`]; its groups of electrodes have these shares of the load. Where the fringes of two groups
    /// meet, the stronger one acts.
    ///
    /// # Panics
    /// When a cell belongs to a group that has no share.
    #[must_use]
    pub fn activity(&self, grid: &Grid, pattern: &Pattern, loads: &[f64]) -> Activity {
        let (per_cell, raster) = (grid.per_cell(), pattern.raster());
        let strips = self.shift.map(|shift| shift.max(THINNEST));
        // A strip that is too thin for an element is a thin one that is active in part.
        let strengths = [0, 1].map(|axis| self.shift[axis] / strips[axis]);
        let zone_of = [0, 1].map(|axis| -> Vec<usize> {
            let strip = strips[axis];
            (0..per_cell[axis])
                .map(|at| grid.middle_in_cell(axis, at))
                .map(|middle| usize::from(middle > strip) + usize::from(middle > 1.0 - strip))
                .collect()
        });
        let cells: Vec<_> = (0..raster.cells())
            .map(|i| zones(pattern, i % raster.columns(), i / raster.columns(), loads))
            .collect();
        Activity::from_elements(grid, |column, row| {
            let [cell_x, cell_y] = [column / per_cell[0], row / per_cell[1]];
            let zones = &cells[cell_y * raster.columns() + cell_x];
            let [x, y] = [zone_of[0][column % per_cell[0]], zone_of[1][row % per_cell[1]]];
            match pattern.is_active(cell_x, cell_y) {
                true => zones[1][1],
                false => zones[y][x] * strength([x, y], strengths),
            }
        })
    }
}

/// How much of a zone beside a cell is active.
fn strength([x, y]: [usize; 2], [along, across]: [f64; 2]) -> f64 {
    match (x, y) {
        (_, 1) => along,
        (1, _) => across,
        // Where both strips are wide enough this is 1.
        _ => along.min(across),
    }
}

/// The load of each of the nine zones of a cell, `[y][x]`, under the dilated pattern: its own of an active one, and of a bare one the largest of
/// the active neighbours next to the zone.
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

/// The effect.
pub struct FringeField;

impl Effect for FringeField {
    fn name(&self) -> &'static str {
        names::FRINGE
    }

    fn cost(&self) -> &'static str {
        "6× a solve"
    }

    fn is_on(&self, effects: &Effects, _scene: &Scene) -> Option<bool> {
        Some(effects.fringe_field.is_some())
    }

    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        effects.fringe_field = Fringe::new(scene).is_ok().then_some(On {});
    }

    fn turn_off(&self, effects: &mut Effects) {
        effects.fringe_field = None;
    }

    fn moves_membrane(&self) -> bool {
        true
    }

    fn assess(&self, scene: &Scene) -> Option<Assessment> {
        let refusal = Fringe::new(scene).err()?;
        let change = format!("is more than can be simulated: {refusal}");
        Some(Assessment::open(DISPLACED, Verdict::CalledFor, SMALL, change))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::Raster;
    use crate::pattern::Symmetry;

    /// The areas of elements that are active, in cells.
    fn areas(fringe: &Fringe, per_cell: usize, pattern: &Pattern) -> Vec<f64> {
        let grid = fringe.grid(Mesh::bilinear(per_cell));
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

    fn total(fringe: &Fringe, per_cell: usize, pattern: &Pattern) -> f64 {
        areas(fringe, per_cell, pattern).iter().sum()
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
    fn strips_too_thin_for_elements_keep_their_area() {
        // To first order: the corners of the strip are smaller by a thousandth than they should be.
        for shift in [1e-3, 1e-4, 1e-7, 0.0] {
            let area = total(
                &fringe(shift),
                1,
                &Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (20, 31)),
            );
            assert!(
                (area - (1.0 + 4.0 * shift)).abs() < 4.1 * THINNEST * shift + 1e-12,
                "{shift}: {area}"
            );
        }
    }

    #[test]
    fn it_follows_the_symmetries() {
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| (x * x + 3 * y + x * y) % 7 < 3);
        let fringe = fringe(0.2);
        let sorted = |pattern: &Pattern| {
            let mut areas = areas(&fringe, 1, pattern);
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

    #[test]
    fn a_membrane_too_thick_for_its_cells_is_refused() {
        // 0.2206 · 2.3 mm is more than half a millimetre.
        let refusal = Fringe::new(&Scene::with_values(50.0, 2.3, 1.0, 45e3, 4.7, 1e3)).unwrap_err();
        assert!(matches!(refusal, SetupError::FringeField { .. }), "{refusal}");
        assert!(Fringe::new(&Scene::with_values(50.0, 2.2, 1.0, 45e3, 4.7, 1e3)).is_ok());
    }
}
