//! The design that a person would draw, against which optimised ones are compared.
//!
//! The source paper's rule (Qin et al., doi 10.1089/soro.2024.0063, case I): a line through the point, perpendicular to
//! its wanted motion; the region behind it is active, so that its expansion pushes the point forward. Such a design has
//! an area of its own, and a gain over it at another area says nothing; the same design at equal area comes from moving
//! the line until the area is met.

use super::objective::{Goal, PlacedAim};
use crate::pattern::{Pattern, Raster};

/// Distances that differ by less than this many cells are equal: rounding must not decide which cell is active.
const RESOLUTION: f64 = 1e-9;

/// The intuitive design of a goal. With several points each cell belongs to the point nearest to it.
#[derive(Clone, Debug)]
pub struct Intuitive {
    raster: Raster,
    /// Cells from the one farthest behind its line to the one farthest before it, with the distance before the line.
    ranked: Vec<(f64, usize)>,
}

impl Intuitive {
    /// Ranks the cells by how far they lie behind their line; cells equally far by how near they are to their point, then
    /// from the lower left.
    #[must_use]
    pub fn of(goal: &Goal) -> Self {
        let rounded = |distance: f64| (distance / RESOLUTION).round() * RESOLUTION;
        let raster = goal.raster();
        let mut cells: Vec<(f64, f64, usize)> = (0..raster.cells())
            .map(|cell| {
                let (before, from_point) = nearest(goal.aims(), raster, cell);
                (rounded(before), rounded(from_point), cell)
            })
            .collect();
        cells.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
        Self {
            raster,
            ranked: cells.into_iter().map(|(before, _, cell)| (before, cell)).collect(),
        }
    }

    /// The design with its line through the point: a cell is active where its centre lies behind the line.
    #[must_use]
    pub fn at_own_area(&self) -> Pattern {
        self.first(self.ranked.iter().take_while(|(before, _)| *before < 0.0).count())
    }

    /// The design with its line moved so that exactly the nearest number of cells to `area` of all is active; an area
    /// fraction outside 0 to 1 is taken as the nearer of the two.
    #[must_use]
    pub fn at_area(&self, area: f64) -> Pattern {
        let all = self.raster.cells() as f64;
        self.first((area * all).round().clamp(0.0, all) as usize)
    }

    fn first(&self, count: usize) -> Pattern {
        let (columns, mut active) = (self.raster.columns(), vec![false; self.raster.cells()]);
        for &(_, cell) in &self.ranked[..count] {
            active[cell] = true;
        }
        Pattern::from_fn(self.raster, |x, y| active[y * columns + x])
    }
}

/// How far a cell's centre lies before the line of its nearest point, and from that point, in cells.
fn nearest(aims: &[PlacedAim], raster: Raster, cell: usize) -> (f64, f64) {
    let columns = raster.columns();
    let centre = [(cell % columns) as f64 + 0.5, (cell / columns) as f64 + 0.5];
    let mut best = (0.0, f64::INFINITY);
    for aim in aims {
        let from = [centre[0] - aim.point[0], centre[1] - aim.point[1]];
        let distance = from[0].hypot(from[1]);
        if distance < best.1 {
            best = (from[0] * aim.direction[0] + from[1] * aim.direction[1], distance);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::{Aim, Displacement, Motion};
    use crate::pattern::{Membrane, Symmetry};

    fn intuitive(aims: &[(f64, f64, f64)]) -> Intuitive {
        let aims: Vec<Aim> = aims
            .iter()
            .map(|&(x, y, direction_deg)| Aim {
                point_mm: [x, y],
                motion: Motion::Along(direction_deg),
                weight: 1.0,
            })
            .collect();
        Intuitive::of(&Goal::new(&Displacement, &aims, Membrane::square(50.0), None, 0.0).unwrap())
    }

    #[test]
    fn the_centre_to_the_right_is_pushed_by_the_left_half() {
        // H7 of the physics: the active half x < 25 moves the centre towards +x.
        let design = intuitive(&[(25.0, 25.0, 0.0)]);
        let left = Pattern::from_fn(Raster::PAPER, |x, _| x < 25);
        assert_eq!(design.at_own_area(), left);
        assert_eq!(design.at_area(0.5), left);
        let down = intuitive(&[(25.0, 25.0, 270.0)]);
        assert_eq!(down.at_own_area(), Pattern::from_fn(Raster::PAPER, |_, y| y >= 25));
    }

    #[test]
    fn the_line_moves_to_meet_the_area() {
        let design = intuitive(&[(12.5, 25.0, 0.0)]);
        assert_eq!(design.at_own_area(), Pattern::from_fn(Raster::PAPER, |x, _| x < 12));
        assert_eq!(design.at_area(0.5), Pattern::from_fn(Raster::PAPER, |x, _| x < 25));
        for area in [0.0, 0.05, 0.333, 0.5, 1.0] {
            let cells = (area * 2500.0_f64).round() as usize;
            assert_eq!(design.at_area(area).active_cells(), cells);
            assert_eq!(intuitive(&[(30.0, 20.0, 77.0)]).at_area(area).active_cells(), cells);
        }
    }

    #[test]
    fn diagonal_designs_keep_their_mirror_symmetry() {
        let swap_axes = Symmetry::ALL
            .into_iter()
            .find(|g| g.matrix() == [[0, 1], [1, 0]])
            .unwrap();
        let own = intuitive(&[(25.0, 25.0, 45.0)]).at_own_area();
        assert_eq!(own.active_cells(), 1225);
        assert_eq!(own, Pattern::from_fn(Raster::PAPER, |x, y| x + y < 49));
        assert_eq!(own.transformed(swap_axes), own);
    }

    #[test]
    fn several_points_share_the_membrane() {
        let points = [
            (12.5, 12.5, 45.0),
            (37.5, 12.5, 135.0),
            (37.5, 37.5, 225.0),
            (12.5, 37.5, 315.0),
        ];
        let own = intuitive(&points).at_own_area();
        // Behind a point that should move to the centre lies the corner.
        for corner in [(0, 0), (49, 0), (49, 49), (0, 49)] {
            assert!(own.is_active(corner.0, corner.1));
        }
        assert!(!own.is_active(25, 25));
        for g in Symmetry::ALL {
            assert_eq!(own.transformed(g), own);
        }
    }
}
