//! A drive with noise, averaged over steps.
//!
//! A measured waveform has noise between its rows. The membrane responds to its mean: branches, inertia, sources and
//! leads integrate it. So in each pass the squared voltage (the voltage, if a source or leads charge the electrodes) is
//! replaced by the continuous function, linear within the steps of this pass, with the smallest squared distance from
//! it between two stops: jumps of the voltage and requested times. This keeps the integral of the drive between two
//! stops and its first moment. For a smooth drive its error is of second order, as that of steps, so passes with
//! shorter steps converge as with a smooth drive, while values of single rows would add their noise to each step.

/// The drive averaged over some steps, between whose ends it is linear.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Smoothed {
    /// Ends of steps in s and values in V² or V; empty without noise.
    nodes: Vec<[f64; 2]>,
    /// Mean squared distance of the drive from it.
    variance: f64,
}

/// Integrals over a step relative to its length: of the drive times the linear functions that are 1 at its start and
/// at its end, and of the squared drive.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    start: f64,
    end: f64,
    square: f64,
}

impl Moments {
    /// Integrates a function of the voltage, which is linear between points of time in s and voltage in V.
    fn of(points: &[[f64; 2]], value: impl Fn(f64) -> f64) -> Self {
        let (from, whole) = (points[0][0], points[points.len() - 1][0] - points[0][0]);
        let mut moments = Self::default();
        for pair in points.windows(2) {
            let [[start, first], [end, last]] = [pair[0], pair[1]];
            // Simpson's rule, exact for the moments of a squared linear function.
            let thirds = [
                (start, first, 1.0),
                (0.5 * (start + end), 0.5 * (first + last), 4.0),
                (end, last, 1.0),
            ];
            for (time, voltage, weight) in thirds {
                let (share, value) = ((time - from) / whole, value(voltage));
                let part = weight / 6.0 * (end - start) / whole;
                moments.start += part * (1.0 - share) * value;
                moments.end += part * share * value;
                moments.square += part * value * value;
            }
        }
        moments
    }
}

impl Smoothed {
    /// Averages a drive over steps with these ends in s. `points` returns times in s and voltages in V between two
    /// times between which the voltage is linear, and `value` is that which is averaged.
    pub fn over(times: &[f64], points: impl Fn([f64; 2]) -> Vec<[f64; 2]>, value: impl Fn(f64) -> f64) -> Self {
        let steps: Vec<(f64, Moments)> = times
            .windows(2)
            .map(|pair| (pair[1] - pair[0], Moments::of(&points([pair[0], pair[1]]), &value)))
            .collect();
        // The normal equations, whose matrix is that of linear elements.
        let count = times.len();
        let (mut diagonal, mut right) = (vec![0.0; count], vec![0.0; count]);
        for (at, (length, moments)) in steps.iter().enumerate() {
            diagonal[at] += length / 3.0;
            diagonal[at + 1] += length / 3.0;
            right[at] += length * moments.start;
            right[at + 1] += length * moments.end;
        }
        let loads = right.clone();
        for (at, (length, _)) in steps.iter().enumerate() {
            let factor = length / 6.0 / diagonal[at];
            diagonal[at + 1] -= factor * length / 6.0;
            right[at + 1] -= factor * right[at];
        }
        let mut values = vec![0.0; count];
        for at in (0..count).rev() {
            let next = steps.get(at).map_or(0.0, |(length, _)| length / 6.0 * values[at + 1]);
            values[at] = (right[at] - next) / diagonal[at];
        }
        let squares: f64 = steps.iter().map(|(length, moments)| length * moments.square).sum();
        let kept: f64 = values.iter().zip(&loads).map(|(value, load)| value * load).sum();
        Self {
            nodes: times.iter().zip(values).map(|(time, value)| [*time, value]).collect(),
            variance: ((squares - kept) / (times[count - 1] - times[0])).max(0.0),
        }
    }

    /// Continues from the value at the start of a step to its end, with a look ahead to a later time.
    #[must_use]
    pub fn continued(
        &self,
        [from, to, ahead]: [f64; 3],
        points: impl Fn([f64; 2]) -> Vec<[f64; 2]>,
        value: impl Fn(f64) -> f64,
    ) -> Self {
        let start = self.at(from);
        let length = to - from;
        let here = Moments::of(&points([from, to]), &value);
        let end = if ahead > to {
            let next = Moments::of(&points([to, ahead]), &value);
            let behind = ahead - to;
            let load = length * here.end + behind * (next.start - 0.5 * next.end) - length / 6.0 * start;
            load / ((length + behind) / 3.0 - behind / 12.0)
        } else {
            3.0 * here.end - 0.5 * start
        };
        Self {
            nodes: vec![[from, start], [to, end]],
            variance: 0.0,
        }
    }

    /// Returns it at a time in s only, to be continued from there.
    #[must_use]
    pub fn only_at(&self, time: f64) -> Self {
        Self {
            nodes: vec![[time, self.at(time)]],
            variance: 0.0,
        }
    }

    /// Returns whether the drive is not averaged.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Returns the value at a time in s.
    #[must_use]
    pub fn at(&self, time: f64) -> f64 {
        let later = self.nodes.partition_point(|[node, _]| *node <= time);
        match (later.checked_sub(1).map(|at| self.nodes[at]), self.nodes.get(later)) {
            (Some([start, low]), Some(&[end, high])) => low + (high - low) * (time - start) / (end - start),
            (Some([_, value]), None) | (None, Some(&[_, value])) => value,
            (None, None) => 0.0,
        }
    }

    /// Returns the mean squared distance of the drive from it, in V⁴ or V².
    #[must_use]
    pub fn variance(&self) -> f64 {
        self.variance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a voltage at rows of a distance in s.
    fn rows(apart: f64, voltage: impl Fn(f64) -> f64) -> impl Fn([f64; 2]) -> Vec<[f64; 2]> {
        move |[from, to]| {
            let first = (from / apart).floor() as i64 + 1;
            let at = |time: f64| {
                let row = (time / apart).floor();
                let [low, high] = [row, row + 1.0].map(|row| voltage(row * apart));
                [time, low + (high - low) * (time / apart - row)]
            };
            let inner = (first..)
                .map(|row| row as f64 * apart)
                .take_while(|time| *time < to - 1e-9 * apart);
            let mut points = vec![at(from)];
            points.extend(
                inner
                    .filter(|time| *time > from + 1e-9 * apart)
                    .map(|time| [time, voltage(time)]),
            );
            points.push(at(to));
            points
        }
    }

    #[test]
    fn lines_are_kept_and_smooth_drives_within_second_order() {
        let steps = |count: u32| -> Vec<f64> { (0..=count).map(|at| f64::from(at) / f64::from(count)).collect() };
        let line = Smoothed::over(&[0.0, 0.1, 0.5, 1.0], rows(0.01, |time| 3.0 - time), |v| v);
        for time in [0.0, 0.1, 0.3, 0.5, 0.77, 1.0] {
            assert!((line.at(time) - (3.0 - time)).abs() < 1e-12, "{time}");
        }
        assert!(line.variance() < 1e-12);
        let errors = [8, 16].map(|count| {
            let found = Smoothed::over(&steps(count), rows(1e-5, |time| (3.0 * time).sin()), |v| v);
            (found.at(0.5) - 1.5_f64.sin()).abs()
        });
        assert!(errors[0] < 0.02 && errors[1] < errors[0] / 3.9, "{errors:?}");
    }

    #[test]
    fn noise_loses_its_values_and_keeps_its_integral_and_its_variance() {
        let noise = |time: f64| {
            let row = (1e4 * time).round();
            (1e3 * (2.3 * row * row).sin()).sin()
        };
        let steps: Vec<f64> = (0..=10).map(|at| 0.1 * f64::from(at)).collect();
        let points = rows(1e-4, noise);
        let found = Smoothed::over(&steps, &points, |v| v);
        let worst = steps
            .iter()
            .fold(0.0, |worst: f64, time| worst.max(found.at(*time).abs()));
        assert!(worst < 0.1, "{worst}");
        let each = points([0.0, 1.0]);
        let integral = |value: &dyn Fn(f64) -> f64| -> f64 {
            let parts = each.windows(2).map(|pair| {
                let middle = 0.5 * (pair[0][1] + pair[1][1]);
                (pair[1][0] - pair[0][0]) / 6.0 * (value(pair[0][1]) + 4.0 * value(middle) + value(pair[1][1]))
            });
            parts.sum()
        };
        let (mean, all) = (integral(&|v| v), integral(&|v| v * v));
        let averaged: f64 = steps
            .windows(2)
            .map(|pair| 0.05 * (found.at(pair[0]) + found.at(pair[1])))
            .sum();
        assert!((averaged - mean).abs() < 1e-12, "{averaged} {mean}");
        assert!(
            (found.variance() / all - 1.0).abs() < 0.05,
            "{} {all}",
            found.variance()
        );
    }

    #[test]
    fn a_step_that_looks_ahead_is_near_the_average_of_all_steps() {
        let noisy = |time: f64| {
            let row = (1e4 * time).round();
            1.0 + time * time + 0.02 * (1e3 * (2.3 * row * row).sin()).sin()
        };
        let (points, steps) = (rows(1e-4, noisy), [0.0, 0.1, 0.2, 0.3, 0.4]);
        let all = Smoothed::over(&steps, &points, |v| v);
        let mut found = Smoothed::over(&steps[..3], &points, |v| v);
        for at in 0..4 {
            let ahead = steps.get(at + 2).copied().unwrap_or(0.4);
            found = found.continued([steps[at], steps[at + 1], ahead], &points, |v| v);
            let off = found.at(steps[at + 1]) - all.at(steps[at + 1]);
            assert!(off.abs() < 2e-3, "{at}: {off}");
        }
    }
}
