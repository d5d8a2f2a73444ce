//! Measured motions of a point of a device beside simulations: its displacement over time, and its response to a small
//! alternating voltage.
//!
//! Displacements are bilinear between the corners of a cell, as those of `solve --history` and `--response` are given.
//! Derivatives by parameters are differences of simulations.

use rayon::prelude::*;

use super::device::Device;
use super::free::VOLTAGE_OFFSET;
use super::motion::{History, Response};
use super::table::Settings;
use deaflow_content::Quantities;
use deaflow_fem::{AtFrequency, FrequencySolver, HistoryRequest, MembraneSolver, WorkLimit, at_bias};
use deaflow_field::Field;
use deaflow_fit::{Sigma, Simulated};
use deaflow_pattern::Pattern;
use deaflow_scene::{Scene, Waveform};

/// Relative half of the difference of a parameter between the simulations whose difference gives a derivative. The error
/// of steps in time, 2e-5 of the displacement, must be small beside the difference.
const STEP: f64 = 2e-3;
/// The same half of the voltage offset, in V.
const VOLTAGE_STEP: f64 = 5.0;

/// A measured motion of a point of a device.
#[derive(Debug)]
pub struct DynamicSet {
    motion: Measured,
    pattern: Pattern,
    point_mm: [f64; 2],
    direction: [f64; 2],
    /// The amplitude of a waveform, or the bias of a frequency response, in V; that of the scene if it is not given.
    voltage_v: Option<f64>,
}

#[derive(Debug)]
enum Measured {
    History(History),
    /// The response, and the amplitude of the alternating voltage in V.
    Response(Response, f64),
}

/// Measured and simulated numbers of one quantity.
pub struct Motions<'a> {
    /// What they are.
    pub quantities: Quantities,
    /// Times or frequencies.
    pub at: &'a [f64],
    /// The measured numbers.
    pub measured: &'a [f64],
    /// The simulated ones, or why there is none.
    pub simulated: Vec<Result<f64, String>>,
    /// The noise.
    pub sigma: Sigma,
}

impl DynamicSet {
    /// Places a displacement over time on a device.
    pub(super) fn of_history(history: History, pattern: Pattern, point_mm: [f64; 2], settings: &Settings) -> Self {
        Self::new(Measured::History(history), pattern, point_mm, settings)
    }

    /// Places a frequency response on a device.
    pub(super) fn of_response(response: Response, pattern: Pattern, point_mm: [f64; 2], settings: &Settings) -> Self {
        let alternating_v = settings.alternating_v.unwrap_or(1.0);
        Self::new(Measured::Response(response, alternating_v), pattern, point_mm, settings)
    }

    fn new(motion: Measured, pattern: Pattern, point_mm: [f64; 2], settings: &Settings) -> Self {
        Self {
            motion,
            pattern,
            point_mm,
            direction: settings.direction(),
            voltage_v: settings.voltage_v,
        }
    }

    /// Returns the numbers that are fitted, and their noise: displacements in mm; of a response the logarithms of the
    /// amplitudes and then the phases in radians, whose noise is that of a share of the amplitude.
    pub(super) fn numbers(&self) -> (Vec<f64>, Sigma) {
        match &self.motion {
            Measured::History(history) => (history.displacements_mm.clone(), history.sigma.clone()),
            Measured::Response(response, _) => {
                let phases = response.phases_deg.iter().flatten().map(|phase| phase.to_radians());
                let logarithms = response.amplitudes_mm.iter().map(|amplitude| amplitude.ln());
                let numbers: Vec<f64> = logarithms.chain(phases).collect();
                let repeated =
                    |shares: Vec<f64>| Sigma::Stated(shares.iter().cycle().take(numbers.len()).copied().collect());
                let sigma = match &response.sigma {
                    Sigma::Stated(sigma) => {
                        let shares = sigma.iter().zip(&response.amplitudes_mm).map(|(sigma, mm)| sigma / mm);
                        repeated(shares.collect())
                    }
                    Sigma::StatedFraction(share) => repeated(vec![*share]),
                    Sigma::UnstatedRelative | Sigma::UnstatedAbsolute => Sigma::UnstatedAbsolute,
                };
                (numbers, sigma)
            }
        }
    }

    /// Simulates the numbers that are fitted for values of the free parameters.
    ///
    /// # Errors
    /// When there is no state at a row, or a value is not allowed, with the reason.
    pub(super) fn simulate(&self, device: &Device, values: &[f64]) -> Result<Simulated, String> {
        let at = |values: &[f64]| -> Result<Vec<f64>, String> { self.each(device, values)?.into_iter().collect() };
        let moved = |parameter: usize, by: f64| {
            let mut values = values.to_vec();
            values[parameter] += by;
            at(&values)
        };
        let derivative = |parameter: usize| -> Result<Vec<f64>, String> {
            let value = values[parameter];
            let step = match device.keys()[parameter].path == VOLTAGE_OFFSET {
                true => VOLTAGE_STEP,
                false => STEP * if value == 0.0 { 1.0 } else { value.abs() },
            };
            let [less, more] = [moved(parameter, -step)?, moved(parameter, step)?];
            let pairs = less.into_iter().zip(more);
            Ok(pairs.map(|(less, more)| (more - less) / (2.0 * step)).collect())
        };
        let (middle, by_parameter) = rayon::join(
            || at(values),
            || {
                (0..values.len())
                    .into_par_iter()
                    .map(derivative)
                    .collect::<Result<_, _>>()
            },
        );
        Ok(Simulated {
            values: middle?,
            by_parameter: by_parameter?,
        })
    }

    /// Compares measured with simulated numbers, each quantity on its own.
    ///
    /// # Errors
    /// When the scene cannot be simulated, with the reason.
    pub(super) fn motions(&self, device: &Device, values: &[f64]) -> Result<Vec<Motions<'_>>, String> {
        let mut simulated = self.each(device, values)?;
        match &self.motion {
            Measured::History(history) => Ok(vec![Motions {
                quantities: Quantities::TimeDisplacement,
                at: &history.times_s,
                measured: &history.displacements_mm,
                simulated,
                sigma: history.sigma.clone(),
            }]),
            Measured::Response(response, _) => {
                let phases = simulated.split_off(response.frequencies_hz.len());
                let amplitudes = simulated.into_iter().map(|one| one.map(f64::exp)).collect();
                let phase = |measured| Motions {
                    quantities: Quantities::FrequencyPhase,
                    at: &response.frequencies_hz,
                    measured,
                    simulated: phases.into_iter().map(|one| one.map(f64::to_degrees)).collect(),
                    sigma: match self.numbers().1 {
                        Sigma::Stated(shares) => {
                            let rows = response.frequencies_hz.len();
                            Sigma::Stated(shares.into_iter().take(rows).map(f64::to_degrees).collect())
                        }
                        other => other,
                    },
                };
                let amplitude = Motions {
                    quantities: Quantities::FrequencyAmplitude,
                    at: &response.frequencies_hz,
                    measured: &response.amplitudes_mm,
                    simulated: amplitudes,
                    sigma: response.sigma.clone(),
                };
                let phases_deg = response.phases_deg.as_deref();
                Ok(std::iter::once(amplitude).chain(phases_deg.map(phase)).collect())
            }
        }
    }

    /// Simulates each number that is fitted; the reason where there is none.
    fn each(&self, device: &Device, values: &[f64]) -> Result<Vec<Result<f64, String>>, String> {
        let scene = device.scene(values).map_err(|error| error.to_string())?;
        let scene = scene.with_electrodes_of(&self.pattern);
        let offset_v = device.voltage_offset(values);
        match &self.motion {
            Measured::History(history) => self.displacements(device, &scene, history, offset_v),
            Measured::Response(response, alternating_v) => {
                let bias = at_bias(&scene);
                let bias_v = self.voltage_v.unwrap_or_else(|| bias.voltage_v());
                let bias = bias.at_voltage((bias_v + offset_v).abs());
                self.responses(device, &bias, response, *alternating_v)
            }
        }
    }

    fn displacements(
        &self,
        device: &Device,
        scene: &Scene,
        history: &History,
        offset_v: f64,
    ) -> Result<Vec<Result<f64, String>>, String> {
        let scene = match &history.voltages_v {
            Some(voltages_v) => {
                let rows = history.times_s.iter().zip(voltages_v);
                let rows: Vec<[f64; 2]> = rows.map(|(time, voltage)| [*time, voltage + offset_v]).collect();
                scene.with_table(Waveform::of_table(&rows)?)
            }
            None => {
                let voltage_v = self.voltage_v.unwrap_or_else(|| scene.voltage_v());
                scene.at_voltage((voltage_v + offset_v).abs())
            }
        };
        let request = HistoryRequest {
            measures: false,
            ..HistoryRequest::at(history.times_s.clone())
        };
        let solver = MembraneSolver::new(&scene, device.options()).map_err(|error| error.to_string())?;
        let found = solver
            .history(&self.pattern, &request)
            .map_err(|error| error.to_string())?;
        let lost = |time: &f64| Err(format!("at {time} s: {}", found.outcome));
        let along = found.fields.iter().map(|field| Ok(self.along(&scene, field)));
        let lost = history.times_s.iter().skip(found.fields.len()).map(lost);
        Ok(along.chain(lost).collect())
    }

    fn responses(
        &self,
        device: &Device,
        bias: &Scene,
        response: &Response,
        alternating_v: f64,
    ) -> Result<Vec<Result<f64, String>>, String> {
        let frequencies = &response.frequencies_hz;
        let solver = FrequencySolver::new(bias, device.options(), WorkLimit::of_history(None));
        let found = solver
            .map_err(|error| error.to_string())?
            .respond(&self.pattern, frequencies);
        if found.equilibrium.is_none() {
            return Err(format!("at the bias of {} V: {}", bias.voltage_v(), found.outcome));
        }
        let parts = |(at, frequency): (&AtFrequency, &f64)| match at {
            AtFrequency::Response { real, imaginary } => Ok([real, imaginary].map(|part| self.along(bias, part))),
            other => Err(format!("at {frequency} Hz: {}", other.name())),
        };
        let parts: Vec<Result<[f64; 2], String>> = found.each.iter().zip(frequencies).map(parts).collect();
        let of = |number: &dyn Fn(usize, [f64; 2]) -> f64| -> Vec<Result<f64, String>> {
            let each = parts.iter().cloned().enumerate();
            each.map(|(at, one)| one.map(|one| number(at, one))).collect()
        };
        let mut all = of(&|_, [real, imaginary]| (alternating_v * real.hypot(imaginary)).ln());
        if let Some(measured) = &response.phases_deg {
            // Phases are known but for full turns: the turn is that of the measured one.
            all.extend(of(&|at, [real, imaginary]| {
                let (phase, measured) = (imaginary.atan2(real), measured[at].to_radians());
                let turns = (measured - phase) / std::f64::consts::TAU;
                phase + std::f64::consts::TAU * turns.round()
            }));
        }
        Ok(all)
    }

    /// Returns the part of the displacement of the point along the direction.
    fn along(&self, scene: &Scene, field: &Field) -> f64 {
        let (sides, size_mm) = (field.raster().sides(), scene.membrane().size_mm);
        let cells = [0, 1].map(|axis: usize| self.point_mm[axis] * sides[axis] as f64 / size_mm[axis]);
        let [x, y] = field.at(cells);
        self.direction[0] * x + self.direction[1] * y
    }
}
