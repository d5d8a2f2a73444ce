//! A pass over the time: the membrane after each step, and how the pass ended.

use super::trace::Trace;
use crate::continuation::LoadingEnd;
use crate::stability::Loss;
use deaflow_field::{Field, Motion};

/// A displacement below this fraction of the largest one over all times is negligible.
pub const NEGLIGIBLE: f64 = 0.02;
/// Largest number of steps of a pass.
pub const MOST_STEPS: usize = 100_000;

/// How steps are chosen.
#[derive(Clone, Copy, Debug)]
pub enum Steps<'a> {
    /// Adaptive steps, by an error of each step in units of displacements.
    Within(f64),
    /// Steps that end at these times in s.
    At(&'a [f64]),
}

/// The membrane at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct Instant {
    /// Time since the start of the drive in s.
    pub time: f64,
    /// Voltage of the electrodes in V; with a resistance, their charge over their capacitance.
    pub voltage: f64,
    /// Charge on all electrodes in C.
    pub charge: f64,
    /// Elastic energy of material, branches and springs in J, relative to the state before the drive.
    pub stored: f64,
    /// Energy of the electric field in J.
    pub electric: f64,
    /// Kinetic energy in J.
    pub kinetic: f64,
    /// Energy dissipated by the branches and the resistances of the source and of the electrodes, in J.
    pub dissipated: f64,
    /// Energy supplied by the source, in J.
    pub supplied: f64,
    /// Largest displacement magnitude from rest over the cell corners in mm.
    pub largest: f64,
    /// Displacement magnitude of the watched corner from rest in mm.
    pub watched: f64,
    /// Motions of the rigid bodies; `None` if there are none.
    pub bodies: Option<Vec<Motion>>,
    /// Motions of the bars; `None` if there are none.
    pub bars: Option<Vec<Motion>>,
}

/// How a pass ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PassEnd {
    /// At the last time.
    Done,
    /// The membrane does not bear the load at the start of the drive.
    AtOnce(LoadingEnd),
    /// No state was found shortly after the last one.
    Lost {
        /// The last time in s with a stable state.
        before: f64,
        /// The first time in s without one.
        after: f64,
        /// The kind of instability.
        loss: Loss,
    },
    /// The iteration did not converge.
    Unknown,
    /// The pass exceeded the limit of work or the number of steps.
    WorkLimit,
}

/// A pass over the time.
#[derive(Clone, Debug)]
pub struct Pass {
    /// How it ended.
    pub end: PassEnd,
    /// The end times of the steps, in s.
    pub steps: Vec<f64>,
    /// The membrane after each step; two instants at a jump.
    pub instants: Vec<Instant>,
    /// Indices of the instants at the requested times that the pass reached.
    pub kept: Vec<usize>,
    /// The displacement from rest at these instants.
    pub fields: Vec<Field>,
    /// With inertia, the motion at the ends of the steps that all passes have.
    pub trace: Trace,
    /// The watched corner (column, row).
    pub watched: [usize; 2],
    /// Number of Newton steps.
    pub newton_steps: u32,
    /// Work, in the units of [`WorkLimit`](crate::work::WorkLimit).
    pub work: u64,
    /// Relative residual at the end of the last step.
    pub residual: f64,
    /// Estimate in mm of the change of the last field if the noise of the drive were not averaged over steps.
    pub noise: f64,
}

impl Pass {
    /// Creates a pass without steps that ends in some way and watches a corner.
    #[must_use]
    pub fn new(end: PassEnd, watched: [usize; 2]) -> Self {
        Self {
            end,
            steps: Vec::new(),
            instants: Vec::new(),
            kept: Vec::new(),
            fields: Vec::new(),
            trace: Trace::new(),
            watched,
            newton_steps: 0,
            work: 0,
            residual: 0.0,
            noise: 0.0,
        }
    }

    /// Returns the largest difference in mm from another pass at the requested times that both reached.
    #[must_use]
    pub fn difference(&self, other: &Self) -> f64 {
        let pairs = self.fields.iter().zip(&other.fields);
        pairs.map(|(a, b)| a.max_difference(b)).fold(0.0, f64::max)
    }

    /// Returns whether the pass ended because it exceeded the limit of work.
    #[must_use]
    pub fn is_cut_short(&self) -> bool {
        self.end == PassEnd::WorkLimit
    }

    /// Returns whether a pass with half the steps would exceed the number of steps.
    #[must_use]
    pub fn is_last(&self) -> bool {
        self.is_cut_short() || 2 * self.steps.len() > MOST_STEPS
    }

    /// Returns the same relative to the largest displacement at each time, without times of negligible displacement.
    #[must_use]
    pub fn relative_difference(&self, other: &Self) -> f64 {
        let sizes: Vec<f64> = self.fields.iter().map(Field::max_magnitude).collect();
        let least = NEGLIGIBLE * sizes.iter().copied().fold(0.0, f64::max);
        let pairs = self.fields.iter().zip(&other.fields).zip(sizes);
        let ratios = pairs.map(|((a, b), size)| a.max_difference(b) / size.max(least));
        ratios.filter(|ratio| !ratio.is_nan()).fold(0.0, f64::max)
    }
}

/// Returns the displacement magnitude of a corner in mm.
pub fn magnitude_at(field: &Field, [x, y]: [usize; 2]) -> f64 {
    let [along, across] = field.at_corner(x, y);
    along.hypot(across)
}
