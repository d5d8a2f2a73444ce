//! The displacement of some corners throughout a motion.
//!
//! The error of a motion is mostly one of its phase: it vanishes where the membrane turns around, and is largest a
//! quarter of a period later. So errors at requested times tell little, but those over all times before do.

use deaflow_field::Field;

/// Largest number of recorded times.
const MOST_TIMES: usize = 512;
/// Number of corners above which some are left out.
const MANY_CORNERS: usize = 1024;

/// Samples of a motion at times that all passes have.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Number of times so far.
    seen: usize,
    /// One of so many times is recorded.
    stride: usize,
    /// Displacements in mm at each recorded time.
    samples: Vec<Vec<[f64; 2]>>,
}

impl Trace {
    /// Creates an empty trace.
    #[must_use]
    pub fn new() -> Self {
        Self {
            seen: 0,
            stride: 1,
            samples: Vec::new(),
        }
    }

    /// Records the displacement at the next time.
    pub fn record(&mut self, field: &Field) {
        if self.seen.is_multiple_of(self.stride) {
            let [columns, rows] = field.raster().corner_sides();
            let apart = ((columns * rows) as f64 / MANY_CORNERS as f64).sqrt().ceil().max(1.0) as usize;
            let corners = (0..rows)
                .step_by(apart)
                .flat_map(|y| (0..columns).step_by(apart).map(move |x| (x, y)));
            self.samples.push(corners.map(|(x, y)| field.at_corner(x, y)).collect());
        }
        self.seen += 1;
        if self.samples.len() > MOST_TIMES {
            self.stride *= 2;
            self.samples = std::mem::take(&mut self.samples).into_iter().step_by(2).collect();
        }
    }

    /// Returns the largest magnitude in mm of a sum of traces with factors, over the times that all have.
    #[must_use]
    pub fn largest<const N: usize>(traces: [(f64, &Self); N]) -> f64 {
        let times = traces.iter().map(|(_, trace)| trace.samples.len()).min().unwrap_or(0);
        let mut largest: f64 = 0.0;
        for time in 0..times {
            let corners = traces[0].1.samples[time].len();
            for corner in 0..corners {
                let sum = traces.iter().fold([0.0; 2], |[x, y], (factor, trace)| {
                    let [u, v] = trace.samples[time][corner];
                    [x + factor * u, y + factor * v]
                });
                largest = largest.max(sum[0].hypot(sum[1]));
            }
        }
        largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    #[test]
    fn the_largest_difference_is_found_at_any_time_of_any_number_of_times() {
        let raster = Raster::new(4, 3).unwrap();
        let field = |size: f64| {
            let values = (0..2 * raster.corners()).map(|at| if at == 13 { size } else { 0.0 });
            Field::from_values(raster, values.collect()).unwrap()
        };
        for count in [1, 40, 512, 513, 3000] {
            let (mut one, mut other) = (Trace::new(), Trace::new());
            // An error that grows and vanishes at the end.
            for at in 0..count {
                let share = f64::from(at) / f64::from(count);
                one.record(&field(1.0 + (6.0 * std::f64::consts::PI * share).sin()));
                other.record(&field(1.0));
            }
            assert!(one.samples.len() <= MOST_TIMES);
            let found = Trace::largest([(1.0, &one), (-1.0, &other)]);
            let close = if count < 40 { 1.0 } else { 2e-2 };
            assert!((found - 1.0).abs() <= close, "{count}: {found}");
            assert_eq!(Trace::largest([(2.0, &one), (-2.0, &one)]), 0.0);
        }
    }
}
