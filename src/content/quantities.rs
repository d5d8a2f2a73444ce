//! What is measured against what: the names in artifacts, and the quantities with their dimensions.

use super::measured::MeasuredRows;
use deaflow_base::{Dimension, words};

words! {
    /// What is measured against what.
    pub enum Quantities {
        /// Displacements of many points.
        Field = "field",
        /// A displacement against the voltage.
        VoltageDisplacement = "displacement-voltage",
        /// A displacement against the time.
        TimeDisplacement = "displacement-time",
        /// The amplitude of a displacement under a small alternating voltage, against its frequency.
        FrequencyAmplitude = "amplitude-frequency",
        /// The phase of that displacement relative to the voltage, against the frequency.
        FrequencyPhase = "phase-frequency",
        /// A stretch against the voltage.
        VoltageStretch = "stretch-voltage",
        /// A stretch against the time.
        TimeStretch = "stretch-time",
        /// A nominal stress against the stretch.
        StretchStress = "stress-stretch",
        /// A nominal stress against the time.
        TimeStress = "stress-time",
    }
}

/// A measured quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeasuredQuantity {
    /// Its name.
    pub name: &'static str,
    /// Its symbol in tables.
    pub symbol: &'static str,
    /// Its dimension; numbers are in the base unit.
    pub dimension: Dimension,
}

const POSITION: MeasuredQuantity = MeasuredQuantity::new("position", "X", Dimension::Length);
const DISPLACEMENT: MeasuredQuantity = MeasuredQuantity::new("displacement", "u", Dimension::Length);
const AMPLITUDE: MeasuredQuantity = MeasuredQuantity::new("amplitude", "amplitude", Dimension::Length);
const PHASE: MeasuredQuantity = MeasuredQuantity::new("phase", "phase", Dimension::Angle);
const FREQUENCY: MeasuredQuantity = MeasuredQuantity::new("frequency", "f", Dimension::Frequency);
const VOLTAGE: MeasuredQuantity = MeasuredQuantity::new("voltage", "V", Dimension::Voltage);
const TIME: MeasuredQuantity = MeasuredQuantity::new("time", "t", Dimension::Time);
const STRETCH: MeasuredQuantity = MeasuredQuantity::new("stretch", "stretch", Dimension::Number);
const STRESS: MeasuredQuantity = MeasuredQuantity::new("nominal stress", "P", Dimension::Stress);

impl MeasuredQuantity {
    const fn new(name: &'static str, symbol: &'static str, dimension: Dimension) -> Self {
        Self {
            name,
            symbol,
            dimension,
        }
    }

    /// Returns the label of an axis: name and unit.
    #[must_use]
    pub fn label(self) -> String {
        match self.dimension.display_unit() {
            (_, "") => self.name.to_owned(),
            (_, unit) => format!("{}, {unit}", self.name),
        }
    }

    /// Returns whether its numbers are positive and span decades, so that axes are logarithmic.
    #[must_use]
    pub fn spans_decades(self) -> bool {
        self == FREQUENCY || self == AMPLITUDE
    }

    /// Converts a number from the base unit to that of the label.
    #[must_use]
    pub fn displayed(self, value: f64) -> f64 {
        self.dimension.display_unit().0 * value
    }
}

impl Quantities {
    /// Returns what was measured.
    #[must_use]
    pub fn measured(self) -> MeasuredQuantity {
        match self {
            Self::Field | Self::VoltageDisplacement | Self::TimeDisplacement => DISPLACEMENT,
            Self::FrequencyAmplitude => AMPLITUDE,
            Self::FrequencyPhase => PHASE,
            Self::VoltageStretch | Self::TimeStretch => STRETCH,
            Self::StretchStress | Self::TimeStress => STRESS,
        }
    }

    /// Returns what it was measured against.
    #[must_use]
    pub fn against(self) -> MeasuredQuantity {
        match self {
            Self::Field => POSITION,
            Self::VoltageDisplacement | Self::VoltageStretch => VOLTAGE,
            Self::TimeDisplacement | Self::TimeStretch | Self::TimeStress => TIME,
            Self::FrequencyAmplitude | Self::FrequencyPhase => FREQUENCY,
            Self::StretchStress => STRETCH,
        }
    }

    /// Returns what a file of a test has; tests of specimens whose rows have times are histories.
    #[must_use]
    pub fn of_test(test: &str, has_times: bool) -> Self {
        match test {
            "field" => Self::Field,
            "voltage-displacement" => Self::VoltageDisplacement,
            "time-displacement" => Self::TimeDisplacement,
            "frequency-response" => Self::FrequencyAmplitude,
            "voltage-stretch" => Self::VoltageStretch,
            "creep" => Self::TimeStretch,
            _ if has_times => Self::TimeStress,
            _ => Self::StretchStress,
        }
    }
}

impl MeasuredRows {
    /// Returns what a row was measured against and its measured number, in base units; of fields the first coordinate
    /// and the first component.
    #[must_use]
    pub fn numbers(&self, quantities: Quantities, row: usize) -> (f64, f64) {
        let number = |all: &Option<Vec<f64>>| all.as_ref().map_or(0.0, |all| all[row]);
        let at = match quantities {
            Quantities::Field => self.position[row][0],
            Quantities::VoltageDisplacement | Quantities::VoltageStretch => self.voltage[row],
            Quantities::TimeDisplacement | Quantities::TimeStretch | Quantities::TimeStress => self.time[row],
            Quantities::FrequencyAmplitude | Quantities::FrequencyPhase => number(&self.frequency),
            Quantities::StretchStress => self.stretch[row],
        };
        let measured = match quantities {
            Quantities::Field | Quantities::VoltageDisplacement | Quantities::TimeDisplacement => {
                self.displacement[row][0]
            }
            Quantities::FrequencyAmplitude => self.displacement[row][0],
            Quantities::FrequencyPhase => number(&self.phase),
            Quantities::VoltageStretch | Quantities::TimeStretch => self.stretch[row],
            Quantities::StretchStress | Quantities::TimeStress => self.stress[row],
        };
        (at, measured)
    }
}
