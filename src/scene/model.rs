//! The valid scene. Construction is the only validation: a `Scene` at hand can be simulated.

use super::effects::Effects;
use super::properties::Properties;
use crate::base::{Canonical, Decimal, Dimension, Quantity};
use crate::pattern::CELLS;

/// ε₀ in F/m (CODATA 2018).
pub const VACUUM_PERMITTIVITY: f64 = 8.854_187_812_8e-12;

/// The square membrane, prestretched and clamped on a rigid frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Geometry {
    /// Side of the prestretched membrane (length).
    pub side: Quantity,
    /// Undeformed thickness, before prestretch (length).
    pub thickness: Quantity,
    /// Equibiaxial prestretch (number, ≥ 1).
    pub prestretch: Quantity,
}

/// The elastic law.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Law {
    /// Incompressible neo-Hookean: W = ½μ(I₁ − 3).
    NeoHookean,
}

impl Law {
    /// The word that stands in a scene.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NeoHookean => "neo-hookean",
        }
    }
}

/// The elastomer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Material {
    /// The elastic law.
    pub law: Law,
    /// Small-strain shear modulus μ (stress).
    pub shear_modulus: Quantity,
    /// Relative permittivity (number).
    pub relative_permittivity: Quantity,
}

/// What drives the actuator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drive {
    /// Voltage between the electrodes.
    pub voltage: Quantity,
    /// Frequency, where the voltage alternates. Only screening looks at it.
    pub frequency: Option<Quantity>,
    /// How long the voltage is held, where that is known. Only screening looks at it.
    pub duration: Option<Quantity>,
}

/// One membrane with its drive, and the effects that are simulated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scene {
    /// Shape and prestretch.
    pub geometry: Geometry,
    /// Elastomer.
    pub material: Material,
    /// Drive.
    pub drive: Drive,
    /// What is simulated beyond the base model.
    pub effects: Effects,
    /// Whether screening is to turn effects on; until then `effects` is empty.
    pub auto: bool,
    /// What is known beyond the base model.
    pub properties: Properties,
}

impl Scene {
    /// The default scene: VHB 4910 as in the source paper, κ = 0.0255.
    #[must_use]
    pub fn vhb4910() -> Self {
        Self::with_values(50.0, 1.0, 3.0, 45e3, 4.7, 5250.0)
    }

    /// A scene from numbers: side and thickness in mm, prestretch, shear modulus in Pa, relative permittivity, voltage in V.
    ///
    /// # Panics
    /// When a number is not finite. It is for tests and benchmarks; scenes of users are read from documents.
    #[must_use]
    pub fn with_values(
        side: f64,
        thickness: f64,
        prestretch: f64,
        shear_modulus: f64,
        permittivity: f64,
        voltage: f64,
    ) -> Self {
        let q = |value, dimension| Quantity::from_f64(value, dimension).expect("a finite number");
        Self {
            geometry: Geometry {
                side: q(side, Dimension::Length),
                thickness: q(thickness, Dimension::Length),
                prestretch: q(prestretch, Dimension::Number),
            },
            material: Material {
                law: Law::NeoHookean,
                shear_modulus: q(shear_modulus, Dimension::Stress),
                relative_permittivity: q(permittivity, Dimension::Number),
            },
            drive: Drive {
                voltage: q(voltage, Dimension::Voltage),
                frequency: None,
                duration: None,
            },
            effects: Effects::default(),
            auto: false,
            properties: Properties::default(),
        }
    }

    /// The same scene at another voltage in V.
    ///
    /// # Panics
    /// When the voltage is not finite.
    #[must_use]
    pub fn at_voltage(&self, voltage: f64) -> Self {
        let voltage = Quantity::from_f64(voltage, Dimension::Voltage).expect("a finite number");
        Self {
            drive: Drive {
                voltage,
                ..self.drive.clone()
            },
            ..self.clone()
        }
    }

    /// The same scene with exactly these effects.
    #[must_use]
    pub fn with_effects(&self, effects: Effects) -> Self {
        Self {
            effects,
            auto: false,
            ..self.clone()
        }
    }

    /// Side L of the prestretched membrane in mm.
    #[must_use]
    pub fn side_mm(&self) -> f64 {
        self.geometry.side.value()
    }

    /// Undeformed thickness H in mm.
    #[must_use]
    pub fn thickness_mm(&self) -> f64 {
        self.geometry.thickness.value()
    }

    /// Prestretch λp.
    #[must_use]
    pub fn prestretch(&self) -> f64 {
        self.geometry.prestretch.value()
    }

    /// Shear modulus μ in Pa.
    #[must_use]
    pub fn shear_modulus_pa(&self) -> f64 {
        self.material.shear_modulus.value()
    }

    /// Permittivity ε = εr ε₀ in F/m.
    #[must_use]
    pub fn permittivity(&self) -> f64 {
        self.material.relative_permittivity.value() * VACUUM_PERMITTIVITY
    }

    /// Voltage V in V.
    #[must_use]
    pub fn voltage_v(&self) -> f64 {
        self.drive.voltage.value()
    }

    /// The number that drives the statics: κ = ε (V/H)² / μ, without unit.
    #[must_use]
    pub fn kappa(&self) -> f64 {
        let nominal_field = self.voltage_v() / (self.thickness_mm() * 1e-3);
        self.permittivity() * nominal_field * nominal_field / self.shear_modulus_pa()
    }

    /// The scene as a canonical value, by section, for action keys.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        let (g, m) = (&self.geometry, &self.material);
        let mut sections = vec![
            (
                "geometry",
                Canonical::map([
                    ("side", Canonical::from(&g.side)),
                    ("thickness", (&g.thickness).into()),
                    ("prestretch", (&g.prestretch).into()),
                    ("cells", Decimal::from(CELLS as u64).into()),
                ]),
            ),
            (
                "material",
                Canonical::map([
                    ("model", Canonical::from(m.law.name())),
                    ("shear_modulus", (&m.shear_modulus).into()),
                    ("relative_permittivity", (&m.relative_permittivity).into()),
                ]),
            ),
            ("drive", self.drive.canonical()),
            ("effects", self.effects_canonical()),
        ];
        if !self.properties.is_empty() {
            sections.push(("properties", self.properties.canonical()));
        }
        Canonical::map(sections)
    }

    fn effects_canonical(&self) -> Canonical {
        if self.auto {
            "auto".into()
        } else {
            self.effects.canonical()
        }
    }

    /// The scene in its own YAML syntax on one line: what artifacts carry, and [`Scene::from_text`] reads.
    #[must_use]
    pub fn to_text(&self) -> String {
        let (g, m) = (&self.geometry, &self.material);
        let properties = if self.properties.is_empty() {
            String::new()
        } else {
            format!(", properties: {}", self.properties.canonical())
        };
        format!(
            "{{ geometry: {{ side: {}, thickness: {}, prestretch: {}, cells: {CELLS} }}, material: {{ model: {}, \
             shear_modulus: {}, relative_permittivity: {} }}, drive: {}, effects: {}{properties} }}",
            g.side,
            g.thickness,
            g.prestretch,
            m.law.name(),
            m.shear_modulus,
            m.relative_permittivity,
            self.drive.canonical(),
            self.effects_canonical(),
        )
    }
}

impl Drive {
    fn canonical(&self) -> Canonical {
        let entries = [
            ("voltage", Some(&self.voltage)),
            ("frequency", self.frequency.as_ref()),
            ("duration", self.duration.as_ref()),
        ];
        let known = entries.into_iter().filter_map(|(key, value)| Some((key, value?)));
        Canonical::map(known.map(|(key, value)| (key, Canonical::from(value))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kappa_of_the_default_scene_is_the_published_value() {
        // 4.7 · 8.8541878128e-12 · (5250 / 1e-3)² / 45000
        assert!((Scene::vhb4910().kappa() - 0.025_489).abs() < 1e-6);
    }

    #[test]
    fn a_scene_survives_its_own_text() {
        let scene = Scene::vhb4910().at_voltage(4999.5);
        assert_eq!(Scene::from_text(&scene.to_text()).unwrap(), scene);
        let rich = "{ geometry: { side: 50, thickness: 1, prestretch: 3, cells: 50 }, material: { model: neo-hookean, \
                    shear_modulus: 45 kPa, relative_permittivity: 4.7 }, drive: { voltage: 5 kV, frequency: 2 Hz }, \
                    effects: { strain_stiffening: { model: ogden, terms: [ { mu: 45 kPa, alpha: 2 } ] }, wrinkling: {}, \
                    dielectric_breakdown: { law: constant, field: 90 MV/m } }, properties: { density: 960, \
                    electrode_stiffness: { shear_modulus: 1 MPa, thickness: 2 um }, \
                    viscoelasticity: [ { modulus: 20 kPa, time: 30 s } ] } }";
        let scene = Scene::from_text(rich).unwrap();
        assert_eq!(Scene::from_text(&scene.to_text()).unwrap(), scene);
        assert_eq!(
            Scene::from_text(&scene.to_text()).unwrap().canonical(),
            scene.canonical()
        );
    }
}
