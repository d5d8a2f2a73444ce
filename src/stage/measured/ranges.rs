//! What was read from a file of measurements: ranges of its numbers, and its noise.

use super::table::{MeasuredTable, RELATIVE, Row, Rows, SHARE, STATED};
use deaflow_base::Dimension;
use deaflow_content::Quantities;

/// The smallest and the largest number of a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// The name of the quantity.
    pub name: &'static str,
    /// Its dimension; numbers are in the base unit.
    pub dimension: Dimension,
    /// The smallest and the largest number.
    pub ends: [f64; 2],
}

/// The standard deviations of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Deviations {
    /// The smallest and the largest of them, in the unit of what was measured.
    Stated([f64; 2]),
    /// A share of the measured numbers.
    Share(f64),
    /// Unknown, in proportion to the measured numbers.
    Relative,
    /// Unknown, equal at all points.
    Absolute,
}

impl MeasuredTable {
    /// Returns what was measured against what.
    #[must_use]
    pub fn quantities(&self) -> Quantities {
        Quantities::of_test(self.test.name(), matches!(self.rows, Rows::History(_)))
    }

    /// Returns the ranges of the columns, over rows with finite numbers.
    #[must_use]
    pub fn ranges(&self) -> Vec<Range> {
        type Number = fn(&Row) -> f64;
        let (length, number) = (Dimension::Length, Dimension::Number);
        let time: (&str, Dimension, Number) = ("time", Dimension::Time, |row| row.time);
        let voltage: (&str, Dimension, Number) = ("voltage", Dimension::Voltage, |row| row.voltage);
        let stretch: (&str, Dimension, Number) = ("stretch", number, |row| row.stretch);
        let stress: (&str, Dimension, Number) = ("nominal stress", Dimension::Stress, |row| row.stress);
        let along: (&str, Dimension, Number) = ("displacement", length, |row| row.displacement[0]);
        let columns = match self.quantities() {
            Quantities::Field => vec![
                ("x", length, (|row| row.position[0]) as Number),
                ("y", length, |row| row.position[1]),
                ("ux", length, |row| row.displacement[0]),
                ("uy", length, |row| row.displacement[1]),
            ],
            Quantities::VoltageDisplacement => vec![voltage, along],
            Quantities::TimeDisplacement => {
                let is_measured = matches!(&self.rows, Rows::Motion(history) if history.voltages_v.is_some());
                let all = [Some(time), is_measured.then_some(voltage), Some(along)];
                all.into_iter().flatten().collect()
            }
            Quantities::FrequencyAmplitude | Quantities::FrequencyPhase => {
                let is_measured = matches!(&self.rows, Rows::Response(response) if response.phases_deg.is_some());
                let phase: (&str, Dimension, Number) = ("phase", Dimension::Angle, |row| row.phase);
                let frequency: (&str, Dimension, Number) = ("frequency", Dimension::Frequency, |row| row.frequency);
                let amplitude: (&str, Dimension, Number) = ("amplitude", length, |row| row.displacement[0]);
                let all = [Some(frequency), Some(amplitude), is_measured.then_some(phase)];
                all.into_iter().flatten().collect()
            }
            Quantities::VoltageStretch => vec![voltage, stretch],
            Quantities::TimeStretch => vec![time, stretch],
            Quantities::StretchStress => vec![stretch, stress],
            Quantities::TimeStress => vec![time, stretch, stress],
        };
        let rows = self.finite_rows();
        let range = |(name, dimension, number): (&'static str, Dimension, Number)| Range {
            name,
            dimension,
            ends: ends(rows.iter().map(number)),
        };
        columns.into_iter().map(range).collect()
    }

    /// Returns the standard deviations of rows with finite numbers.
    #[must_use]
    pub fn deviations(&self) -> Deviations {
        match self.noise() {
            (STATED, _, sigma) => {
                let sigma = sigma.unwrap_or_default();
                let of = |row: &Row| sigma.get(row.number - 1).copied();
                Deviations::Stated(ends(self.finite_rows().iter().filter_map(of)))
            }
            (SHARE, share, _) => Deviations::Share(share),
            (RELATIVE, ..) => Deviations::Relative,
            _ => Deviations::Absolute,
        }
    }

    /// Returns the number of rows with finite numbers.
    #[must_use]
    pub fn rows_with_numbers(&self) -> usize {
        self.finite_rows().len()
    }

    /// Returns the number of rows of a curve at which the specimen is not stretched, which fits do not count.
    #[must_use]
    pub fn rows_at_rest(&self) -> usize {
        match &self.rows {
            Rows::Curve(curve) => curve.stretch.iter().filter(|stretch| **stretch == 1.0).count(),
            _ => 0,
        }
    }
}

/// Returns the smallest and the largest number; infinities without one.
fn ends(numbers: impl Iterator<Item = f64>) -> [f64; 2] {
    let all = [f64::INFINITY, f64::NEG_INFINITY];
    numbers.fold(all, |[least, most], number| [least.min(number), most.max(number)])
}
