//! A pass over the time: the membrane after each step, and how the pass ended.

use crate::continuation::{LoadingEnd, Loss};
use deaflow_field::{Field, Motion};

/// A displacement below this fraction of the largest one over all times is negligible.
pub const NEGLIGIBLE: f64 = 0.02;
/// Largest number of steps of a pass.
pub const MOST_STEPS: usize = 100_000;

/// How steps are chosen.
#[derive(Clone, Copy, Debug)]
pub enum Steps<'a> {
    /// By an error of each step in units of displacements.
    Within(f64),
    /// So that they end at these times in s.
    At(&'a [f64]),
}

/// A membrane at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct Instant {
    /// Time since the drive began in s.
    pub time: f64,
    /// Voltage of the electrodes in V: where they have a resistance, their charge over their capacitance.
    pub voltage: f64,
    /// Charge on all electrodes in C.
    pub charge: f64,
    /// Elastic energy of the law and the branches in J, from before the drive on.
    pub stored: f64,
    /// Energy of the electric field in J.
    pub electric: f64,
    /// Kinetic energy in J.
    pub kinetic: f64,
    /// What the branches and the resistances of the source and of the electrodes have dissipated, in J.
    pub dissipated: f64,
    /// What the source has supplied, in J.
    pub supplied: f64,
    /// Largest displacement magnitude over the cell corners in mm.
    pub largest: f64,
    /// Displacement magnitude of the corner that is watched in mm.
    pub watched: f64,
    /// How rigid bodies have moved; none where there are none.
    pub bodies: Option<Vec<Motion>>,
}

/// How a pass ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PassEnd {
    /// At the last time.
    Done,
    /// The drive begins with a load that the membrane does not bear.
    AtOnce(LoadingEnd),
    /// No state follows within a short time.
    Lost {
        /// The last time in s at which there was a stable state.
        before: f64,
        /// The first at which there was none.
        after: f64,
        /// What was lost.
        loss: Loss,
    },
    /// The iteration did not end.
    Unknown,
    /// The steps took more work than is allowed, or there were too many.
    WorkLimit,
}

/// A pass over the time.
#[derive(Clone, Debug)]
pub struct Pass {
    /// How it ended.
    pub end: PassEnd,
    /// The times at which steps ended, in s.
    pub steps: Vec<f64>,
    /// The membrane after each step; two at a jump.
    pub instants: Vec<Instant>,
    /// Which of them are at the times that were asked for, as far as it got.
    pub kept: Vec<usize>,
    /// The displacement then.
    pub fields: Vec<Field>,
    /// The corner (column, row) whose displacement was followed.
    pub watched: [usize; 2],
    /// Newton steps.
    pub newton_steps: u32,
    /// Work, in the units of [`WorkLimit`].
    pub work: u64,
    /// Relative residual at the end of the last step.
    pub residual: f64,
}

impl Pass {
    /// The largest difference in mm from another pass at the times that both got to.
    #[must_use]
    pub fn difference(&self, other: &Self) -> f64 {
        let pairs = self.fields.iter().zip(&other.fields);
        pairs.map(|(a, b)| a.max_difference(b)).fold(0.0, f64::max)
    }

    /// Whether it ended because it took too much work.
    #[must_use]
    pub fn is_cut_short(&self) -> bool {
        self.end == PassEnd::WorkLimit
    }

    /// Whether there can be none with steps half as long.
    #[must_use]
    pub fn is_last(&self) -> bool {
        self.is_cut_short() || 2 * self.steps.len() > MOST_STEPS
    }

    /// The same, at each time in units of the largest displacement then, but for times at which there is hardly any.
    #[must_use]
    pub fn relative_difference(&self, other: &Self) -> f64 {
        let sizes: Vec<f64> = self.fields.iter().map(Field::max_magnitude).collect();
        let least = NEGLIGIBLE * sizes.iter().copied().fold(0.0, f64::max);
        let pairs = self.fields.iter().zip(&other.fields).zip(sizes);
        let ratios = pairs.map(|((a, b), size)| a.max_difference(b) / size.max(least));
        ratios.filter(|ratio| !ratio.is_nan()).fold(0.0, f64::max)
    }
}

/// The displacement magnitude of a corner in mm.
pub fn magnitude_at(field: &Field, [x, y]: [usize; 2]) -> f64 {
    let [along, across] = field.at_corner(x, y);
    along.hypot(across)
}
