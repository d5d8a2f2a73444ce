//! The stretch of a homogeneous sheet at which forces balance: the first one that a growing load reaches.
//!
//! ```text
//! P(λ) + branches − κ λ₁⁻¹λ₃⁻² = s,   κ = ε₀ε(V/H)²
//! ```
//!
//! κ λ₁⁻¹λ₃⁻² is the nominal stress of Maxwell on a sheet of undeformed thickness H: κλ³ if it is stretched equally, κλ
//! in pure shear. Where the left side has a maximum below s, the sheet jumps to the next stretch that balances; there
//! is none if the law does not stiffen.

use crate::curve::FitError;
use crate::deformation::Test;
use crate::law::Law;

/// The permittivity of vacuum in F/m.
pub(crate) const VACUUM: f64 = 8.854_187_812_8e-12;
/// Steps in ln λ in which roots and maxima are looked for.
const STEP: f64 = 0.02;
/// The largest change of ln λ.
const REACH: f64 = 5.0;
/// Bisections and Newton steps for one root.
const ITERATIONS: usize = 100;

/// The load of a sheet or specimen, which stays as it is while the voltage acts and while it creeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Load {
    /// The nominal stress in Pa: force per undeformed area.
    Stress(f64),
    /// A force in N over the undeformed width in m times the thickness.
    Force {
        /// The force in N.
        force_n: f64,
        /// The width in m.
        width_m: f64,
    },
    /// The force that holds the elastomer at this stretch without a voltage.
    Prestretch(f64),
}

impl Load {
    /// Checks a load.
    ///
    /// # Errors
    /// When a number is not finite, or a width or stretch is not positive.
    pub(crate) fn check(self, set: &str) -> Result<(), FitError> {
        let (what, value, valid) = match self {
            Self::Stress(stress) => ("load", stress, stress.is_finite()),
            Self::Force { force_n, .. } if !force_n.is_finite() => ("force", force_n, false),
            Self::Force { width_m, .. } => ("width", width_m, width_m.is_finite() && width_m > 0.0),
            Self::Prestretch(stretch) => ("prestretch", stretch, stretch.is_finite() && stretch > 0.0),
        };
        let set = set.to_owned();
        if valid {
            Ok(())
        } else {
            Err(FitError::Setting { set, what, value })
        }
    }

    /// Returns the stretch at which the sheet is before the load or the voltage acts.
    pub(crate) fn rest(self) -> f64 {
        match self {
            Self::Stress(_) | Self::Force { .. } => 1.0,
            Self::Prestretch(stretch) => stretch,
        }
    }

    /// Returns the nominal stress and its derivatives with respect to the parameters of the law.
    pub(crate) fn stress(self, law: &Law, test: Test, thickness: f64) -> Option<(f64, Vec<f64>)> {
        let none = || vec![0.0; law.kind().parameters().len()];
        match self {
            Self::Stress(stress) => Some((stress, none())),
            Self::Force { force_n, width_m } => Some((force_n / (width_m * thickness), none())),
            Self::Prestretch(stretch) => law.stress_and_gradient(test, stretch),
        }
    }
}

/// A voltage on a sheet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Electric {
    /// κ in Pa.
    pub kappa: f64,
    pub by_permittivity: f64,
    pub by_voltage: f64,
}

impl Electric {
    /// No voltage.
    pub const NONE: Self = Self {
        kappa: 0.0,
        by_permittivity: 0.0,
        by_voltage: 0.0,
    };

    /// Returns the stress of a voltage in V over a thickness in m.
    pub fn new(permittivity: f64, voltage: f64, thickness: f64) -> Self {
        let per_permittivity = VACUUM * (voltage / thickness).powi(2);
        Self {
            kappa: permittivity * per_permittivity,
            by_permittivity: per_permittivity,
            by_voltage: 2.0 * permittivity * VACUUM * voltage / (thickness * thickness),
        }
    }
}

/// Returns λ₁⁻¹λ₃⁻² and its derivative.
pub(crate) fn squeeze(test: Test, stretch: f64) -> (f64, f64) {
    let [first, second] = test.path();
    let power = first + 2.0 * second;
    let value = stretch.powf(power);
    (value, power * value / stretch)
}

/// Returns the first stretch, from one at which forces need not balance and in the direction in which they pull, at
/// which they balance; `None` if there is none. `excess` is the left side less the right one with its derivative; it
/// has no value beyond a limit of extensibility.
pub(crate) fn first_balance(excess: &dyn Fn(f64) -> Option<(f64, f64)>, from: f64) -> Option<f64> {
    let (start, _) = excess(from)?;
    if start == 0.0 {
        return Some(from);
    }
    let direction = -start.signum();
    let at = |x: f64| from * (direction * x).exp();
    // Below zero before the root. Beyond a limit of extensibility it is infinite.
    let infinite = (f64::INFINITY, f64::INFINITY);
    let gap = |x: f64| excess(at(x)).map_or(infinite, |(value, slope)| (direction * value, slope * at(x)));
    let (mut low, mut slope) = (0.0, gap(0.0).1);
    while low < REACH {
        let high = low + STEP;
        let (value, next) = gap(high);
        if value >= 0.0 {
            return Some(at(root(&gap, low, high)));
        }
        if slope > 0.0 && next < 0.0 {
            let top = maximum(&gap, low, high);
            if gap(top).0 >= 0.0 {
                return Some(at(root(&gap, low, top)));
            }
        }
        (low, slope) = (high, next);
    }
    None
}

/// Returns the root between a point below and one above, by Newton's steps within bisections.
fn root(gap: &dyn Fn(f64) -> (f64, f64), mut low: f64, mut high: f64) -> f64 {
    let mut x = 0.5 * (low + high);
    for _ in 0..ITERATIONS {
        let (value, slope) = gap(x);
        if value >= 0.0 {
            high = x;
        } else {
            low = x;
        }
        let newton = x - value / slope;
        let next = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        let change = (next - x).abs();
        x = next;
        if change <= 1e-15 || high - low <= 1e-15 {
            break;
        }
    }
    x
}

/// Returns the maximum between a point at which the gap rises and one at which it falls.
fn maximum(gap: &dyn Fn(f64) -> (f64, f64), mut low: f64, mut high: f64) -> f64 {
    for _ in 0..ITERATIONS {
        let middle = 0.5 * (low + high);
        if gap(middle).1 > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}
