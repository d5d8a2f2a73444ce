//! Mazes: one winding corridor that branches and never closes.
//!
//! Rooms on a square lattice, joined by a random tree over all of them: a depth-first walk that turns back where it has been
//! everywhere. Corridors are 1 to 4 cells wide and so are the walls, both uniform; as many rooms as fit stand in the membrane, at a
//! uniform offset. The corridors are active, or the walls with what is left around them, each as likely. Electrode and bare
//! membrane are both connected over the whole, by paths far longer than its side.

use super::canvas::Canvas;
use super::error::SampleError;
use super::family::{Family, FamilyError, FamilyParameters, MOST_SAMPLES, SampleGroup};
use deaflow_base::{Stream, parameters};
use deaflow_pattern::{Pattern, Raster};

/// Cells across the widest corridor, and the widest wall.
const WIDEST: usize = 4;

parameters! {
    /// Winding corridors that branch and never close, or the walls between them.
    pub struct MazesParameters as "a mazes sample" {
        /// Patterns to draw.
        pub count: u64 [1..=MOST_SAMPLES],
    }
}

impl FamilyParameters for MazesParameters {
    const NAME: &'static str = "mazes";

    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, FamilyError> {
        Ok(self.one_group(self.count, Box::new(Mazes::new(canvas))))
    }
}

/// Mazes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mazes {
    canvas: Canvas,
}

impl Mazes {
    /// The family on a canvas.
    #[must_use]
    pub fn new(canvas: Canvas) -> Self {
        Self { canvas }
    }
}

/// Rooms with what stands between them.
struct Maze {
    corridor: usize,
    wall: usize,
    /// Columns and rows of rooms.
    rooms: [usize; 2],
    /// Whether a room is joined to the one on its right, and to the one above.
    joined: Vec<[bool; 2]>,
}

impl Maze {
    /// As many rooms as fit.
    fn drawn(raster: Raster, [corridor, wall]: [usize; 2], stream: &mut Stream) -> Self {
        // Where the membrane is narrower than a corridor there is one room, which is cut.
        let rooms = raster.sides().map(|cells| ((cells + wall) / (corridor + wall)).max(1));
        let joined = vec![[false; 2]; rooms[0] * rooms[1]];
        let mut maze = Self {
            corridor,
            wall,
            rooms,
            joined,
        };
        maze.join(stream);
        maze
    }

    /// Joins all rooms by a walk that goes on to a random room that it has not seen, and back where there is none.
    fn join(&mut self, stream: &mut Stream) {
        let count = self.rooms[0] * self.rooms[1];
        let mut seen = vec![false; count];
        let mut path = vec![stream.index(count)];
        while let Some(&here) = path.last() {
            seen[here] = true;
            let next: Vec<usize> = self.neighbours(here).filter(|&room| !seen[room]).collect();
            if next.is_empty() {
                path.pop();
                continue;
            }
            let there = next[stream.index(next.len())];
            let upwards = usize::from(here % self.rooms[0] == there % self.rooms[0]);
            self.joined[here.min(there)][upwards] = true;
            path.push(there);
        }
    }

    fn neighbours(&self, room: usize) -> impl Iterator<Item = usize> {
        let [n, m] = self.rooms;
        let (x, y) = (room % n, room / n);
        let sides = [
            (x + 1 < n).then_some(room + 1),
            (x > 0).then(|| room.wrapping_sub(1)),
            (y + 1 < m).then_some(room + n),
            (y > 0).then(|| room.wrapping_sub(n)),
        ];
        sides.into_iter().flatten()
    }

    /// Cells along its sides.
    fn sides(&self) -> [usize; 2] {
        self.rooms.map(|rooms| rooms * (self.corridor + self.wall) - self.wall)
    }

    /// Whether a cell belongs to a corridor; counted from the lower left cell of the first room.
    fn is_open(&self, x: usize, y: usize) -> bool {
        let [width, height] = self.sides();
        if x >= width || y >= height {
            return false;
        }
        let pitch = self.corridor + self.wall;
        let joined = self.joined[y / pitch * self.rooms[0] + x / pitch];
        match (x % pitch < self.corridor, y % pitch < self.corridor) {
            (true, true) => true,
            (false, true) => joined[0],
            (true, false) => joined[1],
            (false, false) => false,
        }
    }
}

impl Family for Mazes {
    fn name(&self) -> &'static str {
        MazesParameters::NAME
    }

    fn sample(&self, seed: u64, index: u64) -> Result<Pattern, SampleError> {
        let mut stream = Stream::new(seed, "mazes", index);
        let [corridor, wall] = [1 + stream.index(WIDEST), 1 + stream.index(WIDEST)];
        let inside = stream.chance(0.5);
        let raster = self.canvas.raster();
        let maze = Maze::drawn(raster, [corridor, wall], &mut stream);
        let (cells, sides) = (raster.sides(), maze.sides());
        let [left, below] = [0, 1].map(|axis| stream.index(cells[axis].saturating_sub(sides[axis]) + 1));
        let open = |x: usize, y: usize| x >= left && y >= below && maze.is_open(x - left, y - below);
        Ok(Pattern::from_fn(raster, |x, y| open(x, y) == inside))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::CELLS;

    fn drawn(seed: u64, index: u64) -> Pattern {
        Mazes::new(Canvas::PAPER).sample(seed, index).unwrap()
    }

    /// Whether the corridors are active, and how wide they and the walls are.
    fn widths(seed: u64, index: u64) -> (bool, usize, usize) {
        let mut stream = Stream::new(seed, "mazes", index);
        let [corridor, wall] = [1 + stream.index(WIDEST), 1 + stream.index(WIDEST)];
        (stream.chance(0.5), corridor, wall)
    }

    #[test]
    fn corridors_are_one_tree() {
        for index in 0..60 {
            let (inside, corridor, wall) = widths(3, index);
            let pattern = drawn(3, index);
            let open = |cell: usize| pattern.is_active(cell % CELLS, cell / CELLS) == inside;
            let cells: Vec<usize> = (0..CELLS * CELLS).filter(|&cell| open(cell)).collect();
            // A tree over n² rooms has n² − 1 passages.
            let rooms = (CELLS + wall) / (corridor + wall);
            let expected = rooms * rooms * corridor * corridor + (rooms * rooms - 1) * corridor * wall;
            assert_eq!(cells.len(), expected, "sample {index}");
            let (mut seen, mut rest) = (vec![false; CELLS * CELLS], vec![cells[0]]);
            let mut reached = 0;
            while let Some(cell) = rest.pop() {
                if std::mem::replace(&mut seen[cell], true) {
                    continue;
                }
                reached += 1;
                let (x, y) = (cell % CELLS, cell / CELLS);
                let sides = [
                    (x + 1 < CELLS).then(|| cell + 1),
                    (x > 0).then(|| cell - 1),
                    (y + 1 < CELLS).then(|| cell + CELLS),
                    (y > 0).then(|| cell - CELLS),
                ];
                rest.extend(sides.into_iter().flatten().filter(|&side| open(side)));
            }
            assert_eq!(reached, expected, "sample {index}: corridors are connected");
        }
    }

    #[test]
    fn corridors_and_walls_are_active_as_often() {
        let inside = (0..400).filter(|&i| widths(1, i).0).count();
        // Binomial: 200 ± 10.
        assert!((160..=240).contains(&inside), "{inside}");
        let areas: Vec<f64> = (0..400).map(|i| drawn(1, i).area_fraction()).collect();
        let mean = areas.iter().sum::<f64>() / 400.0;
        assert!((0.45..0.55).contains(&mean), "{mean}");
        assert!(areas.iter().all(|area| (0.1..=0.9).contains(area)));
    }

    #[test]
    fn a_sample_is_named_by_seed_and_index() {
        assert_eq!(drawn(1, 7), drawn(1, 7));
        assert_ne!(drawn(1, 7), drawn(1, 8));
        assert_ne!(drawn(1, 7), drawn(2, 7));
    }
}
