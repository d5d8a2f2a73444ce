//! Loads that move a membrane out of its plane.

use super::model::Scene;
use deaflow_base::{Fields, InputError, Map, Stress, Volume, parameters};

/// Largest pressure in Pa, and volume in ml.
const STRONGEST: f64 = 1e9;
const LARGEST: f64 = 1e6;

parameters! {
    /// What moves the membrane out of its plane: one of these.
    pub struct Loads as "`loads`" {
        /// The pressure below the membrane less that above. It follows the surface; a positive one pushes to +z.
        pub pressure: Option<Stress> [-STRONGEST..=STRONGEST],
        /// The volume of an incompressible fluid between the membrane and its plane; the pressure is a result.
        pub volume: Option<Volume> [-LARGEST..=LARGEST],
    }
    rules(one_of)
    check(check)
}

fn one_of(fields: Fields) -> Fields {
    fields.exactly_one(&["pressure", "volume"])
}

fn check(loads: &Loads, map: &Map<'_>) -> Result<(), InputError> {
    match loads.pressure.is_some() == loads.volume.is_some() {
        true => Err(map
            .error("`loads` must have either a `pressure` or a `volume`")
            .help("for example { pressure: 500 Pa } or { volume: 2 ml }")),
        false => Ok(()),
    }
}

/// A pressure or a volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pressurised {
    /// A pressure in Pa.
    Pressure(f64),
    /// A volume in ml.
    Volume(f64),
}

impl Scene {
    /// Returns the pressure or the volume below the membrane, if one is given.
    #[must_use]
    pub fn pressurised(&self) -> Option<Pressurised> {
        let loads = self.loads.as_ref()?;
        let pressure = loads.pressure.map(|pressure| Pressurised::Pressure(pressure.value()));
        pressure.or_else(|| Some(Pressurised::Volume(loads.volume?.value())))
    }

    /// Returns whether something moves the membrane out of its plane: a pressure, a volume, or a force or spring out of
    /// the plane on a body.
    #[must_use]
    pub fn is_in_space(&self) -> bool {
        self.loads.is_some() || self.geometry.has_bodies_in_space()
    }

    /// Returns the scene without what moves the membrane out of its plane.
    #[must_use]
    pub fn in_plane(&self) -> Self {
        if !self.is_in_space() {
            return self.clone();
        }
        Self {
            loads: None,
            geometry: self.geometry.in_plane(),
            ..self.clone()
        }
    }
}
