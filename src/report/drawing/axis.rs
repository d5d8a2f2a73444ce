//! Axes with round ticks.

use deaflow_base::with_minus;

/// An axis: its label, range and ticks.
#[derive(Clone)]
pub struct Axis {
    label: String,
    low: f64,
    high: f64,
    ticks: Vec<f64>,
    logarithmic: bool,
    format: TickFormat,
}

/// Decimals of ticks; smaller steps are written with a power of ten.
const MOST_DECIMALS: usize = 4;

#[derive(Clone)]
enum TickFormat {
    Decimals(usize),
    Shortest,
    Names(Vec<String>),
}

impl Axis {
    /// Creates an axis from `low` to `high`, with about seven round ticks.
    pub fn linear(label: &str, low: f64, high: f64) -> Self {
        let high = if high > low { high } else { low + 1.0 };
        let step = round_step((high - low) / 6.0);
        let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
        Self {
            label: label.to_owned(),
            low,
            high,
            ticks: (first..=last).map(|k| k as f64 * step).collect(),
            logarithmic: false,
            format: TickFormat::Decimals((-step.log10().floor()).max(0.0) as usize),
        }
    }

    /// Creates an axis for counts: ticks on integers only.
    pub fn counting(label: &str, low: f64, high: f64) -> Self {
        let mut axis = Self::linear(label, low, high);
        if axis.high - axis.low <= 12.0 {
            axis.ticks = (axis.low.ceil() as i64..=axis.high.floor() as i64)
                .map(|k| k as f64)
                .collect();
        }
        axis.format = TickFormat::Decimals(0);
        axis
    }

    /// Creates an axis for the counts of bins: from zero to a little above the largest.
    pub fn counts<'v>(label: &str, counts: impl IntoIterator<Item = &'v u64>) -> Self {
        let most = counts.into_iter().max().copied().unwrap_or(0);
        Self::counting(label, 0.0, (1.08 * most as f64).max(1.0))
    }

    /// Creates an axis between the smallest and the largest value, with a margin, so that a flat curve has an axis too.
    pub fn between<'v>(label: &str, values: impl IntoIterator<Item = &'v f64>) -> Self {
        let (low, high) = extent(values, EMPTY);
        let margin = (0.08 * (high - low)).max(0.01 * high.abs()).max(1e-6);
        Self::linear(label, low - margin, high + margin)
    }

    /// Creates an axis from zero, or below if there are negative values, to a little above the largest value.
    pub fn above<'v>(label: &str, values: impl IntoIterator<Item = &'v f64>) -> Self {
        let (low, high) = extent(values, (0.0, 0.0));
        let margin = if high > low { 0.15 * (high - low) } else { 1.0 };
        Self::linear(label, if low < 0.0 { low - margin } else { 0.0 }, high + margin)
    }

    /// Creates an axis that is symmetric to zero and contains some values.
    pub fn around<'v>(label: &str, values: impl IntoIterator<Item = &'v f64>) -> Self {
        let largest = values.into_iter().fold(0.0, |a: f64, v| a.max(v.abs()));
        let end = if largest > 0.0 { 1.15 * largest } else { 1.0 };
        Self::linear(label, -end, end)
    }

    /// Creates a logarithmic axis for positive values; others are ignored.
    pub fn logarithmic<'v>(label: &str, values: impl IntoIterator<Item = &'v f64>) -> Self {
        let logs: Vec<f64> = values.into_iter().filter(|v| **v > 0.0).map(|v| v.log10()).collect();
        let (low, high) = extent(&logs, EMPTY);
        let (low, high) = if low <= high { (low, high) } else { (-1.0, 0.0) };
        let margin = (0.06 * (high - low)).max(0.05);
        let (low, high) = (low - margin, high + margin);
        let axis = Self {
            logarithmic: true,
            ..Self::linear(label, 10f64.powf(low), 10f64.powf(high))
        };
        if high - low < 1.0 {
            // Within a decade, a linear axis has enough round ticks.
            return axis;
        }
        let within: &[f64] = if high - low < 2.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let ticks = (low.floor() as i32..=high.ceil() as i32)
            .flat_map(|decade| within.iter().map(move |m| m * 10f64.powi(decade)))
            .filter(|t| (low..=high).contains(&t.log10()))
            .collect();
        Self {
            ticks,
            format: TickFormat::Shortest,
            ..axis
        }
    }

    /// Creates an axis with one tick per name, at 0, 1, 2, …
    pub fn names(names: Vec<String>) -> Self {
        Self {
            ticks: (0..names.len()).map(|k| k as f64).collect(),
            format: TickFormat::Names(names.clone()),
            ..Self::linear("", -0.5, names.len() as f64 - 0.5)
        }
    }

    /// Sets the label.
    pub fn with_label(self, label: &str) -> Self {
        Self {
            label: label.to_owned(),
            ..self
        }
    }

    /// Returns its range.
    pub fn ends(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// Whether a value can be shown: a logarithmic axis shows only positive ones.
    pub fn shows(&self, value: f64) -> bool {
        !self.logarithmic || value > 0.0
    }

    /// Returns the label.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// Returns the ticks with their texts.
    pub fn ticks(&self) -> impl Iterator<Item = (f64, String)> {
        self.ticks.iter().map(|tick| (*tick, self.write(*tick)))
    }

    /// Returns the position of a value along the axis: 0 at its beginning, 1 at its end.
    pub fn fraction(&self, value: f64) -> f64 {
        if self.logarithmic {
            (value / self.low).log10() / (self.high / self.low).log10()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    fn write(&self, tick: f64) -> String {
        let text = match &self.format {
            // There is no space for more decimals.
            TickFormat::Decimals(decimals) if *decimals > MOST_DECIMALS => {
                if tick == 0.0 {
                    return "0".to_owned();
                }
                let digits = (tick.abs().log10() + 1e-9).floor() + *decimals as f64;
                format!("{:.*e}", digits.max(0.0) as usize, tick)
            }
            // −0.0 would have a sign.
            TickFormat::Decimals(decimals) => format!("{:.*}", decimals, tick + 0.0),
            TickFormat::Names(names) => return names.get(tick.round() as usize).cloned().unwrap_or_default(),
            TickFormat::Shortest => {
                let digits = (-(tick.log10() + 1e-9).floor()).max(0.0) as usize;
                if digits <= MOST_DECIMALS && tick < 99_999.0 {
                    format!("{tick:.digits$}")
                } else {
                    format!("{tick:.0e}")
                }
            }
        };
        with_minus(&text)
    }
}

/// The range of no values.
pub const EMPTY: (f64, f64) = (f64::INFINITY, f64::NEG_INFINITY);

/// Extends a range by some values.
pub fn extent<'v>(values: impl IntoIterator<Item = &'v f64>, range: (f64, f64)) -> (f64, f64) {
    let extend = |(low, high): (f64, f64), value: &f64| (low.min(*value), high.max(*value));
    values.into_iter().fold(range, extend)
}

/// Returns the nearest of 1, 2, 5 times a power of ten that is not below `rough`.
fn round_step(rough: f64) -> f64 {
    let power = 10f64.powf(rough.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= rough * (1.0 - 1e-9));
    power * factor.unwrap_or(10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::linear("x", 0.0, 2.5);
        let texts: Vec<String> = axis.ticks.iter().map(|t| axis.write(*t)).collect();
        assert_eq!(texts, ["0.0", "0.5", "1.0", "1.5", "2.0", "2.5"]);
        let axis = Axis::counting("n", 0.0, 3.0);
        let texts: Vec<String> = axis.ticks.iter().map(|t| axis.write(*t)).collect();
        assert_eq!(texts, ["0", "1", "2", "3"]);
        assert_eq!(
            Axis::counting("n", 0.0, 60.0).ticks,
            [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
        );
    }

    #[test]
    fn small_ticks_are_short() {
        let texts = |low: f64, high: f64| {
            Axis::linear("x", low, high)
                .ticks()
                .map(|(_, text)| text)
                .collect::<Vec<_>>()
        };
        assert_eq!(texts(2.05e-5, 2.35e-5)[..2], ["2.05e−5", "2.10e−5"]);
        assert_eq!(texts(0.0, 1e-4)[..2], ["0", "2e−5"]);
    }

    #[test]
    fn logarithmic_axes_have_ticks_even_within_a_decade() {
        let texts = |values: &[f64]| {
            let axis = Axis::logarithmic("loss", values);
            axis.ticks.iter().map(|t| axis.write(*t)).collect::<Vec<_>>()
        };
        assert_eq!(
            texts(&[0.0153, 0.11, 0.0]),
            ["0.02", "0.04", "0.06", "0.08", "0.10", "0.12"]
        );
        assert_eq!(texts(&[0.0153, 0.3]), ["0.02", "0.05", "0.1", "0.2"]);
        assert_eq!(texts(&[1e-5, 1.0]), ["1e−5", "0.0001", "0.001", "0.01", "0.1", "1"]);
        assert!(texts(&[0.5]).len() > 2 && !texts(&[]).is_empty());
        assert!(!Axis::logarithmic("loss", &[1.0]).shows(0.0));
    }

    #[test]
    fn equal_ratios_are_equal_distances_on_a_logarithmic_axis() {
        let axis = Axis::logarithmic("loss", &[0.01, 1.0]);
        let place = |value: f64| axis.fraction(value);
        assert!((place(0.1) - place(0.01) - (place(1.0) - place(0.1))).abs() < 1e-9);
        assert!(place(0.01) < place(1.0));
    }
}
