//! The design that a person would draw; optimised designs are compared with it.
//!
//! The source paper's rule (Qin et al., doi 10.1089/soro.2024.0063, case I): a line through the point, perpendicular
//! to the target motion; the region behind the line is active, so that its expansion pushes the point forward. A
//! comparison is only fair at equal area, so the line can be moved until the area is that of the other design.

use super::objective::{Goal, PlacedAim, Subject};
use deaflow_pattern::{Bits, Pattern, Raster};

/// Resolution of distances in cells: rounding errors must not decide which cell is active.
const RESOLUTION: f64 = 1e-9;

/// Cells: farther than any cell is from a point.
const FARTHEST: f64 = 2.0 * Raster::MOST as f64;

/// The intuitive design of a goal. Each cell belongs to the nearest point; for equal distances in different states of
/// the device, to the point behind whose line it lies farther.
#[derive(Clone, Debug)]
pub struct Intuitive {
    raster: Raster,
    /// The number of cells of which areas are shares.
    free: usize,
    /// Cells in the order of activation: the cell farthest behind its line first.
    ranked: Vec<Ranked>,
}

/// A cell of an intuitive design.
#[derive(Clone, Copy, Debug)]
struct Ranked {
    /// Signed distance from its line in cells, negative behind the line.
    before: f64,
    /// Distance from its point in cells.
    from_point: f64,
    cell: usize,
    /// The electrode group that drives the state of its point.
    group: u8,
}

impl Intuitive {
    /// Ranks the cells by the distance behind their line, then by the distance from their point, then from the lower
    /// left. `drivers` are the electrode groups that drive the states of the device.
    #[must_use]
    pub fn of(goal: &Goal, drivers: &[u8]) -> Self {
        let raster = goal.raster();
        let mut ranked: Vec<Ranked> = (0..raster.cells())
            .map(|cell| rank(goal.aims(), raster, cell, drivers))
            .collect();
        ranked.sort_by(|a, b| {
            let by_line = a.before.total_cmp(&b.before);
            by_line
                .then(a.from_point.total_cmp(&b.from_point))
                .then(a.cell.cmp(&b.cell))
        });
        Self {
            raster,
            free: ranked.len(),
            ranked,
        }
    }

    /// The design on the available cells only: electrodes on frames and bodies have no effect.
    #[must_use]
    pub fn within(self, available: &Bits) -> Self {
        let kept = self.only_on(available);
        Self {
            free: kept.ranked.len(),
            ..kept
        }
    }

    /// The design on the cells only that constraints allow; areas stay shares of all available cells.
    #[must_use]
    pub fn only_on(mut self, allowed: &Bits) -> Self {
        let columns = self.raster.columns();
        self.ranked
            .retain(|ranked| allowed.has(ranked.cell % columns, ranked.cell / columns));
        self
    }

    /// The design with the line through the point: a cell is active if its centre lies behind the line.
    #[must_use]
    pub fn at_own_area(&self) -> Pattern {
        self.first(self.ranked.iter().take_while(|ranked| ranked.before < 0.0).count())
    }

    /// The design with the line moved: round(`area` · available cells) cells are active, or all that are
    /// allowed if these are fewer.
    #[must_use]
    pub fn at_area(&self, area: f64) -> Pattern {
        let count = (area * self.free as f64).round();
        self.first(count.clamp(0.0, self.ranked.len() as f64) as usize)
    }

    fn first(&self, count: usize) -> Pattern {
        let (columns, mut groups) = (self.raster.columns(), vec![0; self.raster.cells()]);
        for ranked in &self.ranked[..count] {
            groups[ranked.cell] = ranked.group;
        }
        Pattern::from_groups(self.raster, |x, y| groups[y * columns + x])
    }
}

/// Assigns a cell to the nearest point; for equal distances in another state, to the one behind whose line it lies
/// farther.
fn rank(aims: &[PlacedAim], raster: Raster, cell: usize, drivers: &[u8]) -> Ranked {
    let rounded = |distance: f64| (distance / RESOLUTION).round() * RESOLUTION;
    let columns = raster.columns();
    let centre = [(cell % columns) as f64 + 0.5, (cell / columns) as f64 + 0.5];
    let mut best = (0.0, f64::INFINITY, 0);
    for aim in aims {
        let from = [centre[0] - aim.point[0], centre[1] - aim.point[1]];
        let (distance, before) = (
            from[0].hypot(from[1]),
            before(aim, from, [cell % columns, cell / columns]),
        );
        let is_better = match aim.state != best.2 && rounded(distance) == rounded(best.1) {
            true => before < best.0,
            false => distance < best.1,
        };
        if is_better {
            best = (before, distance, aim.state);
        }
    }
    Ranked {
        before: rounded(best.0),
        from_point: rounded(best.1),
        cell,
        group: drivers.get(best.2).copied().unwrap_or(1),
    }
}

/// The signed distance of a position relative to its point from the line through the point. The design for a rotation
/// is a windmill: four blades, each of which pushes one side of the body. That for an area covers the region, or all
/// but the region, the cells that are farther in first. That for a height or a volume covers all, or nothing.
fn before(aim: &PlacedAim, from: [f64; 2], cell: [usize; 2]) -> f64 {
    let along = from[0] * aim.direction[0] + from[1] * aim.direction[1];
    match &aim.subject {
        Subject::Point | Subject::Translation(_) => along,
        // A side whose force on the membrane changes along the direction is pushed against it.
        Subject::Reaction(_) => -along,
        Subject::Region(region) => {
            let distance = from[0].hypot(from[1]);
            let inside = match region.has(cell) {
                true => distance - FARTHEST,
                false => distance,
            };
            aim.direction[0] * inside
        }
        // The softest part is about the point: the nearest cells first, or the farthest for the opposite.
        Subject::Height | Subject::BodyHeight(_) | Subject::Volume(_) => {
            aim.direction[0] * (from[0].hypot(from[1]) - FARTHEST)
        }
        Subject::Rotation(_) => -aim.direction[0] * from[0].hypot(from[1]) * (4.0 * from[1].atan2(from[0])).sin(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Aim, Displacement, Motion, RegionCells};
    use deaflow_pattern::{Membrane, Region, Symmetry};

    fn intuitive(aims: &[(f64, f64, f64)]) -> Intuitive {
        let aims: Vec<Aim> = aims
            .iter()
            .map(|&(x, y, direction_deg)| Aim::new([x, y], Motion::Along(direction_deg)))
            .collect();
        Intuitive::of(
            &Goal::new(&Displacement, &aims, Membrane::square(50.0), None, 0.0).unwrap(),
            &[1],
        )
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
    fn a_region_that_shall_grow_is_covered_and_one_that_shall_shrink_is_left_bare() {
        let (membrane, corners) = (Membrane::square(50.0), [[10.0, 20.0], [20.0, 40.0]]);
        let region = RegionCells::of(&Region::Rectangle(corners), membrane).unwrap();
        let of = |larger| {
            let aim = Aim {
                region: Some(region.clone()),
                ..Aim::new(region.centroid_mm(), Motion::Grow(larger))
            };
            Intuitive::of(&Goal::new(&Displacement, &[aim], membrane, None, 0.0).unwrap(), &[1])
        };
        let inside = |x: usize, y: usize| (10..20).contains(&x) && (20..40).contains(&y);
        assert_eq!(of(true).at_own_area(), Pattern::from_fn(Raster::PAPER, inside));
        let others = Pattern::from_fn(Raster::PAPER, |x, y| !inside(x, y));
        assert_eq!(of(false).at_own_area(), others);
        let wider = of(true).at_area(0.3);
        assert_eq!(wider.active_cells(), 750);
        assert!((0..2500).all(|i| !inside(i % 50, i / 50) || wider.cells()[i] == 1));
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
    fn unavailable_cells_are_excluded_and_the_area_is_met() {
        let available = Bits::from_fn(Raster::PAPER, |x, _| x >= 10);
        let design = intuitive(&[(25.0, 25.0, 0.0)]).within(&available);
        assert_eq!(
            design.at_own_area(),
            Pattern::from_fn(Raster::PAPER, |x, _| (10..25).contains(&x))
        );
        assert_eq!(
            design.at_area(0.5),
            Pattern::from_fn(Raster::PAPER, |x, _| (10..30).contains(&x))
        );
        assert_eq!(design.at_area(1.0).active_cells(), available.count());
    }

    #[test]
    fn cells_that_constraints_forbid_stay_bare_at_equal_area() {
        let allowed = Bits::from_fn(Raster::PAPER, |x, _| x >= 10);
        let design = intuitive(&[(25.0, 25.0, 0.0)]).only_on(&allowed);
        assert_eq!(
            design.at_own_area(),
            Pattern::from_fn(Raster::PAPER, |x, _| (10..25).contains(&x))
        );
        assert_eq!(
            design.at_area(0.5),
            Pattern::from_fn(Raster::PAPER, |x, _| (10..35).contains(&x))
        );
        assert_eq!(design.at_area(1.0).active_cells(), allowed.count());
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

    #[test]
    fn each_state_has_the_group_that_drives_it() {
        let aim = |state, degrees| Aim {
            state,
            ..Aim::new([25.0, 25.0], Motion::Along(degrees))
        };
        let aims = [aim(0, 0.0), aim(1, 180.0)];
        let goal = Goal::new(&Displacement, &aims, Membrane::square(50.0), None, 0.0).unwrap();
        let stroke = Intuitive::of(&goal, &[2, 1]);
        // Pushed by the left half, pulled back by the right one.
        assert_eq!(
            stroke.at_own_area(),
            Pattern::from_groups(Raster::PAPER, |x, _| if x < 25 { 2 } else { 1 })
        );
        let half = stroke.at_area(0.5);
        assert_eq!(
            (
                half.active_cells(),
                half.group(0, 3),
                half.group(49, 3),
                half.group(24, 3)
            ),
            (1250, 2, 1, 0)
        );
    }
}
