//! What a solution says beside the displacement: effects that leave it alone, and where rigid bodies are.

/// One entry for each effect that is on, and one where there are bodies; without such nothing is computed and nothing
/// is kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observation {
    /// Dielectric breakdown: the largest E/E_B over the cells; the membrane fails at 1.
    pub breakdown_ratio: Option<f64>,
    /// Wrinkling: how each cell bears its load, `[y][x]`: 0 taut, 1 wrinkled, 2 slack.
    pub tension: Option<Vec<u8>>,
    /// Electromechanical stability: the smallest eigenvalue of the tangent relative to the Laplacian; zero where
    /// stability is lost.
    pub smallest_eigenvalue: Option<f64>,
    /// Electromechanical stability: the voltages in V between which stability is lost, where it is lost within reach.
    pub critical_voltage: Option<[f64; 2]>,
    /// How each rigid body has moved.
    pub bodies: Option<Vec<Motion>>,
    /// Charge control: charge, voltage and stability.
    pub charged: Option<Charged>,
}

/// An equilibrium at a given charge.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Charged {
    /// Charge on all electrodes in C.
    pub charge: f64,
    /// Voltage between them in V; none where the charge does not move, so that there is no one voltage.
    pub voltage: Option<f64>,
    /// How many eigenvalues of the tangent are negative where the voltage is held.
    pub negative_at_voltage: usize,
    /// How many where the charge is held.
    pub negative_at_charge: usize,
}

/// How a rigid body has moved.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Its centroid, in mm.
    pub translation: [f64; 2],
    /// About its centroid, in degrees from −180 to 180, counter-clockwise.
    pub rotation: f64,
}

impl Observation {
    /// Whether nothing was observed.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Wrinkling: the part of the membrane whose cells are wrinkled or slack.
    #[must_use]
    pub fn wrinkled_fraction(&self) -> Option<f64> {
        let tension = self.tension.as_ref()?;
        Some(tension.iter().filter(|&&state| state > 0).count() as f64 / tension.len() as f64)
    }
}
