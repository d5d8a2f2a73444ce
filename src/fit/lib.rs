//! Least-squares fits of hyperelastic laws to homogeneous tests of an incompressible elastomer.
//!
//! A test stretches a specimen uniformly and records the nominal stress: force per undeformed area. [`fit()`] finds the
//! parameters of a law that agree best with one or several [`Curve`]s, and states how well the data determine each of
//! them. [`compare()`] ranks several laws, and [`fit_relaxation()`] fits the branches of a viscoelastic elastomer. Laws
//! and parameters are those of scenes; stresses are in Pa.

mod compare;
mod curve;
mod deformation;
mod fit;
mod law;
mod least_squares;
mod profile;
mod relaxation;
mod solution;
mod stability;
mod starts;
mod statistics;
#[cfg(test)]
mod tests;

pub use compare::{Candidate, compare};
pub use curve::{Curve, FitError, Sigma};
pub use deformation::Test;
pub use fit::{CurveResiduals, Fit, Options, Outlier, Verdict, fit};
pub use law::{Law, LawKind, OgdenTerm};
pub use relaxation::{Relaxation, RelaxationFit, fit_relaxation};
pub use solution::{Estimate, Parameter, Profiles};
pub use stability::Stability;
pub use statistics::{Direction, Information};
