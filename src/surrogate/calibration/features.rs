//! Cheap features of a pattern and its predicted field. They are equal for all images of a pattern under symmetries.

use deaflow_field::Field;
use deaflow_pattern::Pattern;

/// Number of features that predict the size of the error.
pub(super) const DIFFICULTY: usize = 13;

/// Number of these features, the first, that also distinguish families of patterns. The location of the strain does
/// not.
const SHAPE: usize = 11;

/// Number of features that distinguish families: the former, and correlations of the pattern.
#[cfg(test)]
pub(super) const NOVELTY: usize = SHAPE + 9;

/// Returns the logarithms of the largest and the mean square displacement, of the sum of squares, the largest and the
/// sum of fourth powers of the gradient (a measure of nonlinearity); the active area and its square; the logarithms of
/// the length of the electrode edge, the number of its corners (where the stress is singular) and the number of cells
/// that touch only at a corner; the active part of the edge cells; and the excess of strain, and of area change, in
/// active over bare cells.
pub(super) fn difficulty_features(pattern: &Pattern, predicted: &Field) -> [f64; DIFFICULTY] {
    let [largest, mean, gradient, steepest, fourth] = of_field(predicted);
    let [edge, corners, touching, boundary] = of_outline(pattern);
    // Of all cells: a feature, not the area fraction that is stated.
    let area = pattern.area_fraction(None);
    let [strain, change] = of_active_cells(pattern, predicted);
    [
        (largest + 1e-3).ln(),
        (mean + 1e-3).ln(),
        (gradient + 1e-4).ln(),
        (steepest + 1e-4).ln(),
        (fourth + 1e-9).ln(),
        area,
        area * area,
        (edge + 2.0).ln(),
        (corners + 1.0).ln(),
        (touching + 1.0).ln(),
        boundary,
        strain,
        change,
    ]
}

/// Returns half the difference between active and bare cells in the squared gradients and the area changes, relative to
/// their sums: −½ to ½.
fn of_active_cells(pattern: &Pattern, field: &Field) -> [f64; 2] {
    let (mut parts, mut whole) = ([0.0; 2], [1e-9; 2]);
    let columns = pattern.raster().columns();
    for (at, &group) in pattern.cells().iter().enumerate() {
        let (x, y) = (at % columns, at / columns);
        let corners = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| field.at_corner(x + i, y + j));
        let [a, b, c, d] = corners;
        let along_x: [f64; 2] = std::array::from_fn(|k| 0.5 * (b[k] + d[k] - a[k] - c[k]));
        let along_y: [f64; 2] = std::array::from_fn(|k| 0.5 * (c[k] + d[k] - a[k] - b[k]));
        let squares: f64 = along_x.iter().chain(&along_y).map(|g| g * g).sum();
        let amounts = [squares, (along_x[0] + along_y[1]).abs()];
        for (k, amount) in amounts.into_iter().enumerate() {
            parts[k] += (f64::from(u8::from(group != 0)) - 0.5) * amount;
            whole[k] += amount;
        }
    }
    [parts[0] / whole[0], parts[1] / whole[1]]
}

/// Returns the largest and the root mean square displacement in mm, and the sum of squares, the largest value and the
/// sum of fourth powers of the differences between neighbouring corners.
fn of_field(field: &Field) -> [f64; 5] {
    let (values, [columns, rows]) = (field.values(), field.raster().corner_sides());
    let mut squares = 0.0;
    let (mut gradient, mut steepest, mut fourth) = (0.0, 0.0f64, 0.0);
    for (at, value) in values.iter().enumerate() {
        squares += value * value;
        let (column, row) = (at / 2 % columns, at / 2 / columns);
        let right = (column + 1 < columns).then(|| values[at + 2]);
        let above = (row + 1 < rows).then(|| values[at + 2 * columns]);
        for next in [right, above].into_iter().flatten() {
            let difference = (next - value).abs();
            let square = difference * difference;
            gradient += square;
            fourth += square * square;
            steepest = steepest.max(difference);
        }
    }
    let mean = (squares / (columns * rows) as f64).sqrt();
    [field.max_magnitude(), mean, gradient, steepest, fourth]
}

/// Returns the number of sides between different cells (bare or of another group), the number of corners of the
/// outline, the number of points where cells touch only at a corner, and the active part of the cells along the edges.
fn of_outline(pattern: &Pattern) -> [f64; 4] {
    let [columns, rows] = pattern.raster().sides();
    let cell = |x: usize, y: usize| pattern.is_active(x, y);
    let (mut edge, mut corners, mut touching, mut boundary) = (0, 0, 0, 0);
    for y in 0..rows {
        for x in 0..columns {
            let here = cell(x, y);
            let sides = [x == 0, x + 1 == columns, y == 0, y + 1 == rows];
            boundary += sides.map(u32::from).iter().sum::<u32>() * u32::from(here);
            let differs = |u: usize, v: usize| pattern.group(x, y) != pattern.group(u, v);
            edge += u32::from(x + 1 < columns && differs(x + 1, y));
            edge += u32::from(y + 1 < rows && differs(x, y + 1));
            if x + 1 < columns && y + 1 < rows {
                let block = [here, cell(x + 1, y), cell(x, y + 1), cell(x + 1, y + 1)];
                let active = block.iter().filter(|&&on| on).count();
                if active % 2 == 1 {
                    corners += 1;
                } else if active == 2 && block[0] == block[3] {
                    corners += 2;
                    touching += 1;
                }
            }
        }
    }
    [
        f64::from(edge),
        f64::from(corners),
        f64::from(touching),
        f64::from(boundary) / (2 * (columns + rows)) as f64,
    ]
}

/// Returns the shape features with correlations of the pattern: along the sides over 1, 2, 5 and 10 cells and along
/// the diagonals over 1 and 3 cells, each as the mean of both directions; and the differences of both directions over
/// 1 and 5 cells along the sides and over 3 along the diagonals.
pub(super) fn novelty_features(pattern: &Pattern, difficulty: &[f64; DIFFICULTY]) -> Vec<f64> {
    let sides = [1, 2, 5, 10].map(|n| [correlation(pattern, [n, 0]), correlation(pattern, [0, n])]);
    let diagonals = [1, 3].map(|n| [correlation(pattern, [n, n]), correlation(pattern, [n, -n])]);
    let mean = |pair: &[f64; 2]| 0.5 * (pair[0] + pair[1]);
    let means = sides.iter().chain(&diagonals).map(mean);
    let differences = [sides[0], sides[2], diagonals[1]].map(|pair| (pair[0] - pair[1]).abs());
    let shape = difficulty[..SHAPE].iter().copied();
    shape.chain(means).chain(differences).collect()
}

/// Returns the mean over pairs of cells at an offset: 1 for equal cells (bare or of one group), −1 for different cells.
fn correlation(pattern: &Pattern, [dx, dy]: [isize; 2]) -> f64 {
    let [columns, rows] = pattern.raster().sides();
    let (mut sum, mut count) = (0i32, 0i32);
    for y in 0..rows {
        for x in 0..columns {
            let other = (x.checked_add_signed(dx), y.checked_add_signed(dy));
            if let (Some(u), Some(v)) = other
                && u < columns
                && v < rows
            {
                count += 1;
                sum += 2 * i32::from(pattern.group(x, y) == pattern.group(u, v)) - 1;
            }
        }
    }
    // A small raster has no such pairs.
    f64::from(sum) / f64::from(count.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::Stream;
    use deaflow_field::CORNERS;
    use deaflow_pattern::CELLS;
    use deaflow_pattern::Raster;
    use deaflow_pattern::Symmetry;

    #[test]
    fn outlines_are_counted() {
        let square = Pattern::from_fn(Raster::PAPER, |x, y| (10..20).contains(&x) && (10..20).contains(&y));
        assert_eq!(of_outline(&square), [40.0, 4.0, 0.0, 0.0]);
        let touching = Pattern::from_fn(Raster::PAPER, |x, y| [(3, 3), (4, 4)].contains(&(x, y)));
        assert_eq!(of_outline(&touching), [8.0, 8.0, 1.0, 0.0]);
        let full = Pattern::from_fn(Raster::PAPER, |_, _| true);
        assert_eq!(of_outline(&full), [0.0, 0.0, 0.0, 1.0]);
        let board = Pattern::from_fn(Raster::PAPER, |x, y| (x + y) % 2 == 0);
        assert_eq!((correlation(&board, [1, 0]), correlation(&board, [1, -1])), (-1.0, 1.0));
    }

    #[test]
    fn gradients_are_counted() {
        let ramp = (0..CORNERS * CORNERS).flat_map(|i| [0.1 * (i % CORNERS) as f64, 0.0]);
        let [largest, _, gradient, steepest, fourth] =
            of_field(&Field::from_values(Raster::PAPER, ramp.collect()).unwrap());
        let steps = (CORNERS * (CORNERS - 1)) as f64;
        let found = [largest, gradient / steps, steepest, fourth / steps];
        let expected = [5.0, 0.01, 0.1, 0.0001];
        assert!(
            found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9),
            "{found:?}"
        );
    }

    #[test]
    fn strain_in_active_cells_is_measured() {
        // The left half is stretched along x; the right half does not move.
        let ramp = |i: usize| (i % CORNERS).min(25) as f64 * 0.1;
        let field = Field::from_values(
            Raster::PAPER,
            (0..CORNERS * CORNERS).flat_map(|i| [ramp(i), 0.0]).collect(),
        )
        .unwrap();
        let [left, right] =
            [0, 25].map(|start| Pattern::from_fn(Raster::PAPER, |x, _| (start..start + 25).contains(&x)));
        for (pattern, expected) in [(left, 0.5), (right, -0.5)] {
            let found = of_active_cells(&pattern, &field);
            assert!(found.iter().all(|f| (f - expected).abs() < 1e-9), "{found:?}");
        }
        assert_eq!(
            of_active_cells(
                &Pattern::from_fn(Raster::PAPER, |_, _| true),
                &Field::zero(Raster::PAPER)
            ),
            [0.0; 2]
        );
    }

    #[test]
    fn images_of_a_pattern_have_equal_features() {
        let mut stream = Stream::new(1, "feature test", 0);
        let bits: Vec<bool> = (0..CELLS * CELLS).map(|_| stream.chance(0.4)).collect();
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| bits[y * CELLS + x]);
        let field = Field::from_values(
            Raster::PAPER,
            (0..CORNERS * CORNERS * 2).map(|_| stream.normal()).collect(),
        )
        .unwrap();
        let features = novelty_features(&pattern, &difficulty_features(&pattern, &field));
        assert_eq!(features.len(), NOVELTY);
        for g in Symmetry::ALL {
            let (pattern, field) = (pattern.transformed(g), field.transformed(g));
            let image = novelty_features(&pattern, &difficulty_features(&pattern, &field));
            let same = features.iter().zip(&image).all(|(a, b)| (a - b).abs() < 1e-9);
            assert!(same, "{g:?}: {features:?} {image:?}");
        }
    }
}
