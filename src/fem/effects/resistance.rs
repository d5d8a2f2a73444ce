//! Electrode resistance, judged by the charging time of the electrodes.

use std::f64::consts::PI;

use super::effect::{Effect, Significance, Verdict, switch};
use deaflow_scene::effects::names;
use deaflow_scene::{Effects, Scene};

/// The effect, as an entry of [`super::EFFECTS`].
pub struct ElectrodeResistance;

const QUANTITY: &str = "2πf R c/Λ₁";
const THRESHOLD: f64 = 0.04;

impl Effect for ElectrodeResistance {
    fn name(&self) -> &'static str {
        names::RESISTANCE
    }

    fn cost(&self) -> &'static str {
        "a solve for each time step"
    }

    fn needs_time(&self) -> bool {
        true
    }

    switch!(electrode_resistance);

    /// Does nothing without leads or with an incompatible effect.
    fn turn_on(&self, effects: &mut Effects, scene: &Scene) {
        if scene.leads.is_none() || scene.resistance_conflict(effects).is_some() {
            return;
        }
        effects.electrode_resistance = scene
            .properties
            .sheet_resistance
            .map(|sheet_resistance| deaflow_scene::ElectrodeResistance { sheet_resistance });
    }

    fn assess(&self, scene: &Scene) -> Option<Significance> {
        let Some(frequency) = scene.drive.voltage_frequency_hz() else {
            let change = "the drive is static";
            return Some(Significance::open(QUANTITY, Verdict::NotSignificant, THRESHOLD, change));
        };
        let simulated = scene.effects.electrode_resistance.as_ref();
        let simulated = simulated.map(|effect| &effect.sheet_resistance);
        let Some(resistance) = simulated.or(scene.properties.sheet_resistance.as_ref()) else {
            let change = "the voltage would lag; without `sheet_resistance` it is judged by 1 kHz";
            return Some(Significance::known("f/(1 kHz)", frequency / 1e3, 1.0, change));
        };
        let capacitance = scene.permittivity() / (1e-3 * scene.prestretched_thickness_mm());
        // The current flows through both sheets. Λ₁ is the lowest eigenvalue of −Δ on an electrode as long as the
        // membrane with a lead at one end: a quarter of a wave.
        let sheets = 2.0 * resistance.value();
        let [width, height] = scene.membrane().size_mm;
        let eigenvalue = (0.5 * PI / (1e-3 * width.max(height))).powi(2);
        let time = sheets * capacitance / eigenvalue;
        let change = format!("the voltage at the far end would lag by {time:.1e} s");
        Some(Significance::known(
            QUANTITY,
            2.0 * PI * frequency * time,
            THRESHOLD,
            change,
        ))
    }
}
