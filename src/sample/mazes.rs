//! Mazes: one winding corridor that branches and never closes.
//!
//! Rooms on a square lattice are joined by a random spanning tree, found by depth-first search. The widths of corridors
//! and walls are uniform in 1 to 4 cells. The membrane holds as many rooms as fit, at a uniform offset. The corridors
//! are active, or all else, with equal probability. Electrode and bare membrane are both connected, by paths far longer
//! than the side.

use super::family::{Family, family};
use deaflow_base::Stream;
use deaflow_pattern::{Pattern, Raster};

/// Cells across the widest corridor, and the widest wall.
const WIDEST: usize = 4;

family! {
    /// Winding corridors that branch and never close, or the walls between them.
    Mazes, MazesParameters as "a mazes sample", "mazes"
}

/// A maze: rooms, corridors and walls.
struct Maze {
    corridor: usize,
    wall: usize,
    /// Columns and rows of rooms.
    rooms: [usize; 2],
    /// Whether a room is joined to the one on its right, and to the one above.
    joined: Vec<[bool; 2]>,
}

impl Maze {
    /// Draws a maze with as many rooms as fit.
    fn draw(raster: Raster, [corridor, wall]: [usize; 2], stream: &mut Stream) -> Self {
        // A membrane narrower than a corridor has one room, which is cut.
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

    /// Joins all rooms by depth-first search in random order.
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

    /// Returns the number of cells along the sides.
    fn sides(&self) -> [usize; 2] {
        self.rooms.map(|rooms| rooms * (self.corridor + self.wall) - self.wall)
    }

    /// Returns whether a cell belongs to a corridor; cells are counted from the lower left cell of the first room.
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
        "mazes"
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let [corridor, wall] = [1 + stream.index(WIDEST), 1 + stream.index(WIDEST)];
        let inside = stream.chance(0.5);
        let raster = self.canvas.raster();
        let maze = Maze::draw(raster, [corridor, wall], stream);
        let (cells, sides) = (raster.sides(), maze.sides());
        let [left, below] = [0, 1].map(|axis| stream.index(cells[axis].saturating_sub(sides[axis]) + 1));
        let open = |x: usize, y: usize| x >= left && y >= below && maze.is_open(x - left, y - below);
        Pattern::from_fn(raster, |x, y| open(x, y) == inside)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Canvas;
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
        let areas: Vec<f64> = (0..400).map(|i| drawn(1, i).area_fraction(None)).collect();
        let mean = areas.iter().sum::<f64>() / 400.0;
        assert!((0.45..0.55).contains(&mean), "{mean}");
        assert!(areas.iter().all(|area| (0.1..=0.9).contains(area)));
    }
}
