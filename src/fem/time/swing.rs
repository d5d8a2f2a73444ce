//! The amplitude of a pattern at a frequency, for designs.

use rayon::prelude::*;

use super::frequency::{AtFrequency, FrequencySolver, at_bias};
use crate::error::SetupError;
use crate::evaluator::{SolverParameters, check_leads};
use crate::gradient_evaluator::{linear_in_cells, of_groups};
use crate::solver::SolveOptions;
use deaflow_field::{Differentiable, Evaluator, Field, Outcome, PredictError, Predictor, WithGradient};
use deaflow_pattern::Pattern;
use deaflow_scene::{Leads, Scene};

/// The linear response to the sine of a drive about its bias, at the phase at which a weighted sum of displacements is
/// largest.
pub struct Swing {
    solver: FrequencySolver,
    /// The result of [`linear_in_cells`], for the gradient.
    plain: Option<FrequencySolver>,
    /// The fraction of the load of each electrode group.
    loads: Vec<f64>,
    leads: Option<Leads>,
    frequency_hz: f64,
    amplitude_v: f64,
    weights: Field,
    settings: String,
}

impl Swing {
    /// Checks whether the response can be computed in a scene.
    ///
    /// # Errors
    /// When it cannot.
    pub fn check(scene: &Scene) -> Result<(), SetupError> {
        let has_bias = scene.waveform().sine.is_some_and(|sine| sine.bias.value() > 0.0);
        let has = [
            (!scene.states.is_empty(), "the scene has several `states`"),
            (scene.geometry.bodies.is_some(), "the scene has rigid bodies"),
            (scene.drive.charge.is_some(), "the drive is a `charge`; give a voltage"),
            (!has_bias, "the drive has no `sine` about a `bias`"),
            (
                scene.drive.source.is_some() || scene.effects.electrode_resistance.is_some(),
                "the scene has a `source` or `electrode_resistance`",
            ),
        ];
        match has.into_iter().find_map(|(has, why)| has.then_some(why)) {
            Some(why) => Err(SetupError::Swing { why }),
            None => Ok(()),
        }
    }

    /// Builds the evaluator for a frequency, on the mesh of parameters, in a scene with resolved effects. The weights
    /// are those of the displacement of each corner.
    ///
    /// # Errors
    /// When the scene has no sine about a bias, or cannot be simulated; or if each pattern has its own mesh.
    pub fn new(
        scene: &Scene,
        frequency_hz: f64,
        weights: Field,
        parameters: &SolverParameters,
    ) -> Result<Self, SetupError> {
        Self::check(scene)?;
        let options = SolveOptions {
            mesh: parameters.mesh().ok_or(SetupError::SeveralMeshes)?,
            tolerance: parameters.tolerance(),
        };
        let biased = at_bias(scene);
        let solver = |scene: &Scene| FrequencySolver::new(scene, options, parameters.work_limit());
        Ok(Self {
            solver: solver(&biased)?,
            plain: linear_in_cells(&biased).map(|plain| solver(&plain)).transpose()?,
            loads: biased.group_loads(),
            leads: scene.leads.clone(),
            frequency_hz,
            amplitude_v: scene.voltage_v(),
            weights,
            settings: parameters.settings_in_time("response"),
        })
    }

    /// Returns the field in mm, as a difference from that of the bias, and how the search for the equilibrium ended.
    #[must_use]
    pub fn farthest(&self, pattern: &Pattern) -> (Outcome, Option<Field>) {
        match self.solver.respond_at(pattern, self.frequency_hz) {
            (outcome, None) => (outcome, None),
            (outcome, Some(AtFrequency::Response { real, imaginary })) => {
                (outcome, Some(self.at_peak([&real, &imaginary])))
            }
            // The amplitude of an undamped resonance is unknown.
            (_, Some(AtFrequency::Resonance | AtFrequency::NotSolved)) => (Outcome::NoEstimate, None),
        }
    }

    /// Re(û e^(−iθ)) V̂ with the phase θ of the weighted sum of û.
    fn at_peak(&self, [real, imaginary]: [&Field; 2]) -> Field {
        let sum = |part: &Field| -> f64 {
            let pairs = self.weights.values().iter().zip(part.values());
            pairs.map(|(weight, u)| weight * u).sum()
        };
        let (sine, cosine) = sum(imaginary).atan2(sum(real)).sin_cos();
        let pairs = real.values().iter().zip(imaginary.values());
        let values = pairs.map(|(real, imaginary)| self.amplitude_v * (cosine * real + sine * imaginary));
        Field::from_values(real.raster(), values.collect()).unwrap_or_else(|_| real.clone())
    }
}

impl Predictor for Swing {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        check_leads(self.leads.as_ref(), patterns).map_err(PredictError::failed)?;
        Ok(patterns.par_iter().map(|pattern| self.farthest(pattern).1).collect())
    }
}

impl Differentiable for Swing {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&Field) -> Field,
    ) -> Result<Option<WithGradient>, PredictError> {
        let solver = self.plain.as_ref().unwrap_or(&self.solver);
        // The phase follows from the weights: the slope of an amplitude is a multiple of them at any state of the
        // membrane.
        let slope = slope(&Field::zero(pattern.raster()));
        let Some(found) = solver.differentiate(pattern, self.frequency_hz, &slope) else {
            return Ok(None);
        };
        let field = match &self.plain {
            None => Some(self.at_peak(found.parts.each_ref())),
            Some(_) => self.farthest(pattern).1,
        };
        let Some(field) = field else {
            return Ok(None);
        };
        let of_cells: Vec<f64> = found.of_cells.iter().map(|cell| self.amplitude_v * cell).collect();
        Ok(Some((field, of_groups(&self.loads, &of_cells))))
    }
}

impl Evaluator for Swing {
    fn settings(&self) -> String {
        self.settings.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::square_of_ten;
    use crate::time::{HistoryOptions, HistoryRequest, HistorySolver};
    use crate::{Method, WorkLimit};
    use deaflow_field::Mesh;
    use deaflow_pattern::Raster;

    fn scene(drive: &str, effects: &str) -> Scene {
        square_of_ten(drive, effects, ", properties: { density: 960 }")
    }

    const BRANCHES: &str =
        "viscoelasticity: { branches: [{ modulus: 45 kPa, time: 1 s }, { modulus: 20 kPa, time: 20 ms }] }";

    fn odd() -> Pattern {
        Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, y| (x * 7 + y * 3) % 5 < 2 || x > 7)
    }

    /// The mean of two components at two corners.
    fn weights() -> Field {
        let mut values = vec![0.0; 2 * 11 * 11];
        values[2 * (5 * 11 + 5)] = 0.5;
        values[2 * (7 * 11 + 3) + 1] = -0.5;
        Field::from_values(Raster::new(10, 10).unwrap(), values).unwrap()
    }

    fn weighted(field: &Field) -> f64 {
        let pairs = weights()
            .values()
            .iter()
            .zip(field.values())
            .map(|(a, b)| a * b)
            .collect::<Vec<_>>();
        pairs.iter().sum()
    }

    #[test]
    fn patterns_swing_as_far_as_in_their_history() {
        let drive = "voltage: 20 V, waveform: { sine: { frequency: 0.5 Hz, bias: 5 kV } }";
        let (scene, mesh) = (scene(drive, BRANCHES), Mesh::bilinear(1));
        let swing = Swing::new(&scene, 0.5, weights(), &SolverParameters::new(Method::Newton, mesh)).unwrap();
        let (outcome, field) = swing.farthest(&odd());
        assert_eq!(outcome, Outcome::Converged);
        let amplitude = weighted(&field.unwrap());
        let samples = 16_u32;
        let request = HistoryRequest {
            times: (0..samples)
                .map(|k| 2.0 * (12.0 + f64::from(k) / f64::from(samples)))
                .collect(),
            accuracy_mm: Some(2e-6),
            limit: WorkLimit::of_history(None),
            ..HistoryRequest::at(Vec::new())
        };
        let options = HistoryOptions {
            mesh: Some(mesh),
            tolerance: 1e-12,
        };
        let history = HistorySolver::new(&scene, &options, request)
            .unwrap()
            .displace(&odd())
            .unwrap()
            .history;
        let mut sums = [0.0; 2];
        for (k, field) in history.fields.iter().enumerate() {
            let (sine, cosine) = (std::f64::consts::TAU * k as f64 / f64::from(samples)).sin_cos();
            let value = 2.0 / f64::from(samples) * weighted(field);
            sums = [sums[0] + value * sine, sums[1] + value * cosine];
        }
        let simulated = sums[0].hypot(sums[1]);
        assert!((amplitude / simulated - 1.0).abs() < 1e-3, "{amplitude} {simulated}");
        assert!(amplitude > 1e-4);
    }

    #[test]
    fn what_does_not_swing_is_refused() {
        let check = |drive: &str, effects: &str| Swing::check(&scene(drive, effects)).map_err(|e| e.to_string());
        let sine = "voltage: 20 V, waveform: { sine: { frequency: 1 Hz, bias: 5 kV } }";
        for (drive, effects, said) in [
            ("voltage: 1 kV", "", "a `bias`"),
            ("voltage: 1 kV, waveform: { sine: { frequency: 1 Hz } }", "", "a `bias`"),
            ("charge: { total: 1 uC }", "", "`charge`"),
            (&format!("{sine}, source: {{ resistance: 1 MOhm }}"), "", "`source`"),
        ] {
            let refused = check(drive, effects).unwrap_err();
            assert!(refused.contains(said), "{refused}");
        }
        assert_eq!(check(sine, "inertia: {}"), Ok(()));
    }
}
