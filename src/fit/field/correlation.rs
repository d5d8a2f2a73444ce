//! Noise that is correlated between neighbouring points, as where the subsets of image correlation overlap.
//!
//! The correlation of the noise at two points of an image, of the same component, is taken as R = exp(−d²/2ℓ²). ℓ is
//! fitted to the products of residuals at distances below a limit. The covariance of parameters is then s²ARAᵀ with
//! A = J⁺, for which JᵀRJ is needed. R is an integral over the plane,
//!
//! ```text
//! exp(−|x − y|²/2ℓ²) = 2/(πℓ²) ∫ exp(−|x − z|²/ℓ²) exp(−|y − z|²/ℓ²) dz
//! ```
//!
//! for which sums over a grid of z with spacing ℓ/2 are exact to 3 × 10⁻⁹: JᵀRJ is a sum of squares over the grid, each
//! from the points nearby. So it is not negative, and its cost does not depend on how many points are correlated.

use deaflow_linalg::Mat;
use std::collections::HashMap;
use std::f64::consts::PI;

/// Bins of distance for the products of residuals.
const BINS: usize = 128;
/// About how many products are used.
const PRODUCTS: f64 = 4e6;
/// Lengths that are tried before the best is refined.
const LENGTHS: usize = 120;
/// The spacing of the grid, relative to ℓ.
const SPACING: f64 = 0.5;
/// Grid points on each side of a point.
const REACH: i64 = 8;
/// All of them.
const WIDTH: usize = 2 * REACH as usize + 1;

/// What is known about the correlation of noise between points of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Correlation {
    /// There is none.
    Independent,
    /// Its length is found from the products of residuals at points closer than this.
    Estimated {
        /// The distance in mm.
        within_mm: f64,
    },
    /// Its length ℓ.
    Known {
        /// ℓ in mm.
        length_mm: f64,
    },
}

impl Default for Correlation {
    /// Estimated from points closer than 8 mm.
    fn default() -> Self {
        Self::Estimated { within_mm: 8.0 }
    }
}

/// The products of residuals in a range of distances.
#[derive(Clone, Copy, Debug, Default)]
struct Bin {
    count: f64,
    product: f64,
    squared_distance: f64,
}

/// The points of an image, and the residuals there.
pub(crate) type Residuals<'a> = (&'a [[f64; 2]], Vec<[f64; 2]>);

/// Returns ℓ in mm from the residuals at points of images, closer than `within`; `None` if no two points are, or the
/// residuals vanish.
pub(crate) fn length(images: &[Residuals<'_>], within: f64) -> Option<f64> {
    let lists: Vec<Cells> = images.iter().map(|(points, _)| Cells::new(points, within)).collect();
    let pairs: f64 = lists.iter().map(Cells::pairs).sum();
    let share = (PRODUCTS / pairs).min(1.0);
    let mut bins = [Bin::default(); BINS];
    let (mut squares, mut numbers) = (0.0, 0.0);
    for ((points, residuals), cells) in images.iter().zip(&lists) {
        squares += residuals.iter().flatten().map(|r| r * r).sum::<f64>();
        numbers += 2.0 * residuals.len() as f64;
        cells.add_products(points, residuals, within, share, &mut bins);
    }
    let variance = squares / numbers;
    let bins = bins.into_iter().filter(|bin| bin.count > 0.0);
    let means = bins.map(|bin| {
        let mean = bin.product / (2.0 * bin.count * variance);
        (bin.count, bin.squared_distance / bin.count, mean)
    });
    let means: Vec<(f64, f64, f64)> = means.collect();
    let nearest = means.iter().map(|(_, d2, _)| d2.sqrt()).reduce(f64::min)?;
    let valid = variance.is_finite() && variance > 0.0;
    valid.then(|| best_length(&means, 0.1 * nearest, within))
}

/// Returns the length between two that fits the mean products best.
fn best_length(means: &[(f64, f64, f64)], shortest: f64, longest: f64) -> f64 {
    let misfit = |logarithm: f64| -> f64 {
        let length = logarithm.exp();
        let of = |(count, d2, mean): &(f64, f64, f64)| count * (mean - (-d2 / (2.0 * length * length)).exp()).powi(2);
        means.iter().map(of).sum()
    };
    let (low, step) = (shortest.ln(), (longest / shortest).ln() / LENGTHS as f64);
    let at = |i: usize| low + step * i as f64;
    let best = (0..=LENGTHS)
        .min_by(|a, b| misfit(at(*a)).total_cmp(&misfit(at(*b))))
        .unwrap_or(0);
    let (mut low, mut high) = (at(best) - step, at(best) + step);
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    for _ in 0..60 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if misfit(a) < misfit(b) {
            high = b;
        } else {
            low = a;
        }
    }
    f64::exp(0.5 * (low + high))
}

/// Points in square cells.
struct Cells {
    cells: HashMap<(i64, i64), Vec<usize>>,
    of: Vec<(i64, i64)>,
}

impl Cells {
    fn new(points: &[[f64; 2]], size: f64) -> Self {
        let cell = |point: &[f64; 2]| ((point[0] / size).floor() as i64, (point[1] / size).floor() as i64);
        let of: Vec<(i64, i64)> = points.iter().map(cell).collect();
        let mut cells: HashMap<(i64, i64), Vec<usize>> = HashMap::new();
        for (at, cell) in of.iter().enumerate() {
            cells.entry(*cell).or_default().push(at);
        }
        Self { cells, of }
    }

    /// Returns the points in a cell and around it.
    fn around(&self, (x, y): (i64, i64)) -> impl Iterator<Item = &Vec<usize>> {
        (-1..=1).flat_map(move |dy| (-1..=1).filter_map(move |dx| self.cells.get(&(x + dx, y + dy))))
    }

    /// Returns the number of pairs in neighbouring cells.
    fn pairs(&self) -> f64 {
        let of = |(cell, points): (&(i64, i64), &Vec<usize>)| {
            let around: usize = self.around(*cell).map(Vec::len).sum();
            points.len() as f64 * around as f64
        };
        0.5 * self.cells.iter().map(of).sum::<f64>()
    }

    /// Adds products of the residuals at pairs of points to the bins of their distances, of a share of the points with
    /// all others.
    fn add_products(&self, points: &[[f64; 2]], residuals: &[[f64; 2]], within: f64, share: f64, bins: &mut [Bin]) {
        // Fractions of multiples of the golden ratio are spread evenly, also over the rows and columns of a raster.
        let is_chosen = |at: &usize| (*at as f64 * 0.618_033_988_749_895).fract() < share;
        for a in (0..points.len()).filter(is_chosen) {
            let neighbours = self.around(self.of[a]).flatten().copied();
            for b in neighbours.filter(|b| *b != a && (*b > a || share < 1.0)) {
                let [x, y] = [points[a][0] - points[b][0], points[a][1] - points[b][1]];
                let d2 = x * x + y * y;
                let at = (d2.sqrt() / within * BINS as f64) as usize;
                if let Some(bin) = bins.get_mut(at) {
                    bin.count += 1.0;
                    bin.product += residuals[a][0] * residuals[b][0] + residuals[a][1] * residuals[b][1];
                    bin.squared_distance += d2;
                }
            }
        }
    }
}

/// Returns CᵀRC for `columns` numbers at each component of each point: `numbers[2 i + c]` are those of component c at
/// point i.
pub(crate) fn correlated_gram(points: &[[f64; 2]], numbers: &[Vec<f64>], columns: usize, length: f64) -> Mat<f64> {
    let spacing = SPACING * length;
    let node = |number: f64| (number / spacing).round() as i64;
    let weight = |number: f64, node: i64| {
        let distance = number / length - SPACING * node as f64;
        (-distance * distance).exp()
    };
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|a, b| points[*a][1].total_cmp(&points[*b][1]));
    let across: Vec<[f64; WIDTH]> = points
        .iter()
        .map(|[x, _]| std::array::from_fn(|i| weight(*x, node(*x) - REACH + i as i64)))
        .collect();
    let first = points.iter().map(|[x, _]| node(*x)).min().unwrap_or(0) - REACH;
    let last = points.iter().map(|[x, _]| node(*x)).max().unwrap_or(0) + REACH;
    let mut line = Line::new((last - first + 1) as usize, 2 * columns);
    let mut gram = Mat::zeros(columns, columns);
    let (mut begin, mut row) = (0, i64::MIN);
    while begin < order.len() {
        row = (row + 1).max(node(points[order[begin]][1]) - REACH);
        for &at in &order[begin..] {
            let [x, y] = points[at];
            if node(y) - REACH > row {
                break;
            }
            let (start, along) = ((node(x) - REACH - first) as usize, weight(y, row));
            line.add(start, &across[at], along, [&numbers[2 * at], &numbers[2 * at + 1]]);
        }
        line.flush(&mut gram);
        while begin < order.len() && node(points[order[begin]][1]) + REACH <= row {
            begin += 1;
        }
    }
    let factor = 2.0 / PI * SPACING * SPACING;
    Mat::from_fn(columns, columns, |i, j| factor * gram[(i.max(j), i.min(j))])
}

/// A line of the grid.
struct Line {
    width: usize,
    sums: Vec<f64>,
    touched: Vec<bool>,
}

impl Line {
    fn new(nodes: usize, width: usize) -> Self {
        Self {
            width,
            sums: vec![0.0; nodes * width],
            touched: vec![false; nodes],
        }
    }

    /// Adds the numbers of a point to the nodes around it.
    fn add(&mut self, start: usize, across: &[f64; WIDTH], along: f64, numbers: [&Vec<f64>; 2]) {
        self.touched[start..start + WIDTH].fill(true);
        let sums = &mut self.sums[start * self.width..(start + WIDTH) * self.width];
        for (sums, weight) in sums.chunks_exact_mut(self.width).zip(across) {
            let weight = weight * along;
            for (sum, number) in sums.iter_mut().zip(numbers[0].iter().chain(numbers[1])) {
                *sum += weight * number;
            }
        }
    }

    /// Adds the products of the sums at each node to the lower triangle of a matrix, and clears them.
    fn flush(&mut self, gram: &mut Mat<f64>) {
        let columns = self.width / 2;
        for (sums, touched) in self.sums.chunks_exact_mut(self.width).zip(&mut self.touched) {
            if !std::mem::take(touched) {
                continue;
            }
            for component in sums.chunks_exact(columns) {
                for (i, a) in component.iter().enumerate() {
                    for (j, b) in component[..=i].iter().enumerate() {
                        gram[(i, j)] += a * b;
                    }
                }
            }
            sums.fill(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::correlated_gram;

    #[test]
    fn the_sum_over_a_grid_is_the_sum_over_pairs() {
        let fraction = |i: usize, factor: f64| (i as f64 * factor).fract();
        let points: Vec<[f64; 2]> = (0..60)
            .map(|i| [30.0 * fraction(i, 0.618_034) - 10.0, 9.0 * fraction(i, 0.754_878)])
            .collect();
        let numbers: Vec<Vec<f64>> = (0..120).map(|i| vec![1.0, fraction(i, 0.569_84) - 0.3]).collect();
        for length in [0.05, 0.7, 3.0, 40.0] {
            let gram = correlated_gram(&points, &numbers, 2, length);
            for (i, j) in [(0, 0), (0, 1), (1, 1)] {
                let mut sum = 0.0;
                for (a, b) in (0..60).flat_map(|a| (0..60).map(move |b| (a, b))) {
                    let [x, y] = [points[a][0] - points[b][0], points[a][1] - points[b][1]];
                    let r = (-(x * x + y * y) / (2.0 * length * length)).exp();
                    sum += (0..2)
                        .map(|c| r * numbers[2 * a + c][i] * numbers[2 * b + c][j])
                        .sum::<f64>();
                }
                assert!(
                    (gram[(i, j)] / sum - 1.0).abs() < 1e-6,
                    "{length}: {} {sum}",
                    gram[(i, j)]
                );
                assert_eq!(gram[(i, j)], gram[(j, i)]);
            }
        }
    }
}
