//! Fringe field: the field of an electrode bulges out at its edges, so that it acts like a larger one.
//!
//! The permittivity of an elastomer is several times that of air, so the field stays inside: next to the edge it obeys
//! Laplace's equation in a layer of half-thickness h/2, with a given potential on the electrode and no flux through the bare
//! face. The conformal map of that half-covered strip gives the charge of an electrode that is longer by
//! (2/π) ln 2 · h/2 = (ln 2/π)h = 0.2206 h (the end correction of a strip that is wide on one side; Maxwell, Treatise on
//! Electricity and Magnetism, vol. 1, chapter XII, for the edge of a plate between two planes, which is the same problem).
//! The edge of an active region therefore moves outward by d = 0.2206 H/λp², with H/λp² the thickness of the prestretched
//! membrane: the region is dilated by a square of half-width d, and an element is active to the share of it that is covered.
//! Nothing is active beyond the frame. Without effect as H → 0.

use std::f64::consts::{LN_2, PI};

use super::effect::{Assessment, Effect};
use crate::fem::error::SetupError;
use crate::fem::operator::Activity;
use crate::field::Mesh;
use crate::pattern::{CELLS, Pattern};
use crate::scene::effects::names;
use crate::scene::{Effects, On, Scene};

/// How far edges move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fringe {
    /// In units of a cell's side, at most a half.
    shift: f64,
}

impl Fringe {
    /// The fringe of a scene.
    ///
    /// # Errors
    /// When it reaches further than half a cell.
    pub fn new(scene: &Scene) -> Result<Self, SetupError> {
        let (reach_mm, cell_mm) = (LN_2 / PI * scene.prestretched_thickness_mm(), cell_mm(scene));
        if reach_mm > 0.5 * cell_mm {
            return Err(SetupError::FringeField { reach_mm, cell_mm });
        }
        Ok(Self {
            shift: reach_mm / cell_mm,
        })
    }

    /// The dilated pattern on a mesh.
    #[must_use]
    pub fn activity(&self, mesh: Mesh, pattern: &Pattern) -> Activity {
        let per_cell = mesh.elements_per_cell();
        let overlaps: Vec<[f64; 3]> = (0..per_cell).map(|at| self.overlaps(at, per_cell)).collect();
        Activity::from_elements(mesh, |column, row| {
            let zones = zones(pattern, column / per_cell, row / per_cell);
            let (across, along) = (overlaps[column % per_cell], overlaps[row % per_cell]);
            let covered = |(y, x): (usize, usize)| if zones[y][x] { across[x] * along[y] } else { 0.0 };
            (0..9).map(|zone| covered((zone / 3, zone % 3))).sum()
        })
    }

    /// The shares of an element's side that lie within the shift of the cell's first edge, of none, and of its second edge.
    fn overlaps(&self, at: usize, per_cell: usize) -> [f64; 3] {
        let n = per_cell as f64;
        let (start, end) = (at as f64 / n, (at + 1) as f64 / n);
        let below = |place: f64| (place.clamp(start, end) - start) * n;
        let (first, second) = (below(self.shift), below(1.0 - self.shift));
        [first, second - first, 1.0 - second]
    }
}

/// Which of the nine zones of a cell, `[y][x]`, the dilated pattern covers: all of an active one, and of a bare one those
/// next to an active neighbour.
fn zones(pattern: &Pattern, x: usize, y: usize) -> [[bool; 3]; 3] {
    let active = |dx: usize, dy: usize| {
        let (x, y) = (x + dx, y + dy);
        (1..=CELLS).contains(&x) && (1..=CELLS).contains(&y) && pattern.is_active(x - 1, y - 1)
    };
    std::array::from_fn(|dy| std::array::from_fn(|dx| active(1, 1) || active(dx, 1) || active(1, dy) || active(dx, dy)))
}

/// Side of a cell, mm.
fn cell_mm(scene: &Scene) -> f64 {
    scene.side_mm() / CELLS as f64
}

/// The effect.
pub struct FringeField;

impl Effect for FringeField {
    fn name(&self) -> &'static str {
        names::FRINGE
    }

    fn cost(&self) -> &'static str {
        "1.3× a solve"
    }

    fn is_on(&self, effects: &Effects) -> Option<bool> {
        Some(effects.fringe_field.is_some())
    }

    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        effects.fringe_field = Fringe::new(scene).is_ok().then_some(On {});
    }

    fn assess(&self, scene: &Scene) -> Option<Assessment> {
        let cell = cell_mm(scene);
        let change = match Fringe::new(scene) {
            Err(_) => "is beyond membrane theory: the membrane is thicker than cells are wide".to_owned(),
            Ok(fringe) => format!("lets electrodes act {} beyond their edges", length(fringe.shift * cell)),
        };
        Some(Assessment::known(
            "h/cell",
            scene.prestretched_thickness_mm() / cell,
            0.05,
            change,
        ))
    }
}

/// A length as people say it.
fn length(mm: f64) -> String {
    if mm < 0.1 {
        format!("{:.1} µm", 1e3 * mm)
    } else {
        format!("{mm:.3} mm")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::Order;
    use crate::pattern::Symmetry;

    fn total(activity: &Activity, mesh: Mesh) -> f64 {
        activity.elements().iter().sum::<f64>() / (mesh.elements_per_cell() as f64).powi(2)
    }

    #[test]
    fn one_cell_grows_to_the_square_around_it() {
        let scene = Scene::with_values(50.0, 5.0, 2.0, 45e3, 4.7, 1e3);
        let fringe = Fringe::new(&scene).unwrap();
        let d = LN_2 / PI * 1.25;
        assert!((fringe.shift - d).abs() < 1e-15);
        for per_cell in 1..=4 {
            let mesh = Mesh::new(per_cell, Order::Bilinear);
            let at = |cx, cy| {
                total(
                    &fringe.activity(mesh, &Pattern::from_fn(|x, y| (x, y) == (cx, cy))),
                    mesh,
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
        let fringe = Fringe { shift: 0.3 };
        let mesh = Mesh::new(3, Order::Biquadratic);
        let gap = fringe.activity(mesh, &Pattern::from_fn(|x, y| y == 10 && (x == 10 || x == 12)));
        assert!((total(&gap, mesh) - 2.0 * 1.6 * 1.6).abs() < 1e-12);
        let touching = fringe.activity(mesh, &Pattern::from_fn(|x, y| (x, y) == (10, 10) || (x, y) == (11, 11)));
        assert!((total(&touching, mesh) - (2.0 * 1.6 * 1.6 - 0.6 * 0.6)).abs() < 1e-12);
        let all = fringe.activity(mesh, &Pattern::from_fn(|_, _| true));
        assert!((total(&all, mesh) - 2500.0).abs() < 1e-9);
    }

    #[test]
    fn it_follows_the_symmetries_and_vanishes_with_the_thickness() {
        let mesh = Mesh::new(1, Order::Bilinear);
        let pattern = Pattern::from_fn(|x, y| (x * x + 3 * y + x * y) % 7 < 3);
        let fringe = Fringe { shift: 0.2 };
        let reference = fringe.activity(mesh, &pattern);
        let sorted = |activity: &Activity| {
            let mut shares = activity.elements().to_vec();
            shares.sort_by(f64::total_cmp);
            shares
        };
        for g in Symmetry::ALL {
            let image = fringe.activity(mesh, &pattern.transformed(g));
            let gap = sorted(&image)
                .iter()
                .zip(sorted(&reference))
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            assert!(gap < 1e-15);
        }
        let none = Fringe { shift: 0.0 }.activity(mesh, &pattern);
        assert_eq!(none.elements(), Activity::new(mesh, &pattern).elements());
    }

    #[test]
    fn a_membrane_too_thick_for_its_cells_is_refused() {
        // 0.2206 · 2.3 mm is more than half a millimetre.
        let refusal = Fringe::new(&Scene::with_values(50.0, 2.3, 1.0, 45e3, 4.7, 1e3)).unwrap_err();
        assert!(matches!(refusal, SetupError::FringeField { .. }), "{refusal}");
        assert!(Fringe::new(&Scene::with_values(50.0, 2.2, 1.0, 45e3, 4.7, 1e3)).is_ok());
    }
}
