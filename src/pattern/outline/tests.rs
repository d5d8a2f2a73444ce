use super::*;
use crate::{CELLS, Raster, Symmetry};
use deaflow_base::Stream;

/// The pattern whose cells are drawn at the lower left, the last line lowest.
fn drawn(lines: &[&str]) -> Pattern {
    let rows: Vec<&[u8]> = lines.iter().rev().map(|line| line.as_bytes()).collect();
    Pattern::from_fn(Raster::PAPER, |x, y| {
        rows.get(y).and_then(|row| row.get(x)) == Some(&b'#')
    })
}

/// The same moved away from the frame.
fn moved(lines: &[&str]) -> Pattern {
    let pattern = drawn(lines);
    Pattern::from_fn(Raster::PAPER, |x, y| {
        x >= 10 && y >= 10 && pattern.is_active(x - 10, y - 10)
    })
}

fn holes(islands: &[Island]) -> Vec<usize> {
    islands.iter().map(|island| island.holes.len()).collect()
}

fn rings_of(islands: &[Island]) -> Vec<&Vec<Point>> {
    islands
        .iter()
        .flat_map(|i| std::iter::once(&i.outer).chain(&i.holes))
        .collect()
}

#[test]
fn a_full_pattern_is_the_membrane_and_an_empty_one_is_nothing() {
    let corner = CELLS as f64;
    for corners in [Corners::Square, Corners::Rounded] {
        let full = outlines(&Pattern::from_fn(Raster::PAPER, |_, _| true), corners);
        assert_eq!(full.len(), 1);
        assert_eq!(
            full[0].outer,
            [[0.0, 0.0], [corner, 0.0], [corner, corner], [0.0, corner]]
        );
        assert!(full[0].holes.is_empty());
        assert!(outlines(&Pattern::from_fn(Raster::PAPER, |_, _| false), corners).is_empty());
    }
}

#[test]
fn cells_of_different_islands_are_apart_at_a_corner_and_those_of_one_are_joined() {
    let apart = moved(&["#.", ".#"]);
    assert_eq!(holes(&outlines(&apart, Corners::Square)), [0, 0]);
    // The ends of a C touch at a corner: what it holds is a hole.
    let ends = moved(&["####", "#..#", "#.#.", "###."]);
    for corners in [Corners::Square, Corners::Rounded] {
        assert_eq!(holes(&outlines(&ends, corners)), [1]);
    }
    // Two bare cells that touch at a corner are two holes.
    let pair = moved(&["####", "#.##", "##.#", "####"]);
    assert_eq!(holes(&outlines(&pair, Corners::Square)), [2]);
    assert_eq!(holes(&outlines(&pair, Corners::Rounded)), [2]);
}

#[test]
fn islands_in_holes_come_after_what_surrounds_them() {
    let target = moved(&[
        "#######", "#.....#", "#.###.#", "#.#.#.#", "#.###.#", "#.....#", "#######",
    ]);
    let islands = outlines(&target, Corners::Square);
    assert_eq!(holes(&islands), [1, 1]);
    assert_eq!([0, 1].map(|i| area(&islands[i].outer)), [49.0, 9.0]);
    assert_eq!([0, 1].map(|i| area(&islands[i].holes[0])), [-25.0, -1.0]);
}

#[test]
fn rounding_has_the_area_of_the_spline() {
    // A block of 10 × 10: each corner loses 1/8 by the chord, and 1/3 of two triangles of 1/16 by the parabolas, which
    // four pieces draw a sixteenth short.
    let block = Pattern::from_fn(Raster::PAPER, |x, y| (20..30).contains(&x) && (20..30).contains(&y));
    let lost = 100.0 - total_area(&outlines(&block, Corners::Rounded));
    let parabola = (1.0 / 16.0) * (1.0 - 2.0 / 3.0 * (1.0 - 1.0 / 16.0));
    assert!((lost - 4.0 * (0.125 + 2.0 * parabola)).abs() < 1e-12, "{lost}");
    // Steps of one cell become one slope.
    let slope = Pattern::from_fn(Raster::PAPER, |x, y| x + y < CELLS);
    let islands = outlines(&slope, Corners::Rounded);
    let long = |ring: &[Point]| (0..ring.len()).any(|i| (ring[i][0] - ring[(i + 1) % ring.len()][0]).abs() > 47.0);
    assert!(long(&islands[0].outer), "{:?}", islands[0].outer);
}

#[test]
fn a_lead_keeps_its_width_at_the_frame() {
    let lead = Pattern::from_fn(Raster::PAPER, |x, y| (10..12).contains(&x) && y < 20);
    let islands = outlines(&lead, Corners::Rounded);
    for corner in [[10.0, 0.0], [12.0, 0.0]] {
        assert!(islands[0].outer.contains(&corner), "{:?}", islands[0].outer);
    }
}

/// A block of random cells, at the frame or away from it.
fn random(seed: u64, density: f64, at: usize) -> Pattern {
    let mut stream = Stream::new(seed, "outline", at as u64);
    let mut cells = vec![0; CELLS * CELLS];
    for y in at..at + 14 {
        for x in at..at + 14 {
            cells[y * CELLS + x] = u8::from(stream.uniform() < density);
        }
    }
    Pattern::from_cells(Raster::PAPER, &cells).unwrap()
}

/// Whether two segments have a point in common.
fn meet(a: [Point; 2], b: [Point; 2]) -> bool {
    let side = |p: Point, q: Point, r: Point| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let apart = |c: usize| {
        let (a, b) = ([a[0][c], a[1][c]], [b[0][c], b[1][c]]);
        a[0].max(a[1]) < b[0].min(b[1]) || b[0].max(b[1]) < a[0].min(a[1])
    };
    if apart(0) || apart(1) {
        return false;
    }
    side(a[0], a[1], b[0]) * side(a[0], a[1], b[1]) <= 0.0 && side(b[0], b[1], a[0]) * side(b[0], b[1], a[1]) <= 0.0
}

#[test]
fn outlines_are_simple_and_contain_the_cells() {
    for (seed, density) in (0..24).zip([0.3, 0.5, 0.6, 0.75].into_iter().cycle()) {
        let pattern = random(seed, density, [0, 18, CELLS - 14][seed as usize % 3]);
        let exact = outlines(&pattern, Corners::Square);
        assert_eq!(total_area(&exact), pattern.active_cells() as f64);
        for ring in rings_of(&exact) {
            let mut sorted: Vec<[u64; 2]> = ring.iter().map(|p| p.map(|v| v as u64)).collect();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!(sorted.len(), ring.len(), "a corner comes twice");
        }
        let smooth = outlines(&pattern, Corners::Rounded);
        let mut counts = [holes(&exact), holes(&smooth)];
        counts.iter_mut().for_each(|c| c.sort_unstable());
        assert_eq!(counts[0], counts[1]);
        let mut segments: Vec<([usize; 2], [Point; 2])> = Vec::new();
        for (r, ring) in rings_of(&smooth).into_iter().enumerate() {
            assert!(ring.iter().flatten().all(|v| (0.0..=CELLS as f64).contains(v)));
            segments.extend((0..ring.len()).map(|i| ([r, i], [ring[i], ring[(i + 1) % ring.len()]])));
        }
        for (i, (name, a)) in segments.iter().enumerate() {
            for (other, b) in &segments[i + 1..] {
                let length = rings_of(&smooth)[name[0]].len();
                let apart = (other[1] + length - name[1]) % length;
                let neighbours = name[0] == other[0] && (apart == 1 || apart + 1 == length);
                assert!(neighbours || !meet(*a, *b), "seed {seed}: {a:?} meets {b:?}");
            }
        }
    }
}

#[test]
fn the_symmetries_of_the_square_keep_areas() {
    let pattern = random(7, 0.55, 0);
    let area = total_area(&outlines(&pattern, Corners::Rounded));
    for g in Symmetry::ALL {
        let image = total_area(&outlines(&pattern.transformed(g), Corners::Rounded));
        assert!((image - area).abs() < 1e-9);
    }
}
