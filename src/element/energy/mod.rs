//! Elastic and electric energy at a point of the membrane, one form per file. The laws with these forms are in
//! [`deaflow_scene::laws`].
//!
//! [`NeoHookean`] is the base model; its kernels contain nothing else. With effects the material is an [`Isotropic`]
//! potential of elastomer, dielectric and electrodes. One type for each combination would multiply the build time, so a
//! [`Compound`] has coefficients that vanish for effects that are off, and the form of an energy that stiffens is a
//! branch that is the same at all points. One type for all of them was tried: a solve with wrinkling took 10 % longer.

mod compound;
mod dielectric;
mod elasticity;
mod electrode;
mod first_invariant;
mod isotropic;
mod neo_hookean;
mod ogden;
mod potential;
mod second_invariant;
mod tension_field;

pub use compound::Compound;
pub use dielectric::Decaying;
pub use elasticity::{Elasticity, NeoHookeanEnergy, Stiffened};
pub use electrode::Stiff;
pub use first_invariant::FirstInvariant;
pub use isotropic::{Isotropic, tangent_from};
pub use neo_hookean::NeoHookean;
pub use ogden::{MOST_TERMS, Ogden};
pub use potential::{Invariants, MarginTerms, Potential, Rest, Slopes, slopes_out_of_line};
pub use second_invariant::SecondInvariant;
pub use tension_field::{RESIDUAL, TensionField};

use super::element::Line;
use super::kinematics::{Tensor, add_scaled, contract, deformation, determinant};
use super::lanes::Value;

/// Number of moduli, which determine a tangent at a given deformation: 2φᵢ, φⱼ, 4φᵢᵢ, 2φᵢⱼ and φⱼⱼ of an isotropic
/// potential.
pub const MODULI: usize = 5;

/// Squared length of a step from which the mean stress is corrected to conserve energy.
const LONG_STEP: f64 = 1e-5;

/// Margins of stability: at a point, or the smallest over all points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins<V> {
    /// Smallest acoustic eigenvalue, min over unit m and N of (m⊗N) : ∂²w/∂f² : (m⊗N); positive where the material is
    /// strongly elliptic.
    pub ellipticity: V,
    /// Positive where the tangent, shifted by a null Lagrangian, is positive definite. If it is positive everywhere,
    /// the equilibrium of a clamped membrane is stable; the converse does not hold.
    pub convexity: V,
    /// Where the membrane wrinkles, a number with the sign of the largest principal stress. Elsewhere positive; over
    /// all points infinite for a material that does not wrinkle.
    pub tension: V,
}

/// An energy density per area of the prestretched membrane, in units of μH, as a function of f = I + ∇u.
///
/// `active` is 1 where the membrane carries an electrode and 0 where it is bare.
pub trait MaterialPoint: Sync + 'static {
    /// Whether a pattern can have several stable equilibria at one load, e.g. after a snap of a stiffening
    /// elastomer. The load steps are then chosen to stay on the branch from rest.
    const SEVERAL_BRANCHES: bool = false;
    /// Whether the membrane bears no compression, so that it can lose its tension.
    const WRINKLES: bool = false;
    /// Whether storing [`MaterialPoint::moduli`] at all points saves time.
    const STORES_MODULI: bool = false;

    /// Returns w(f).
    fn energy<V: Value>(&self, f: Tensor<V>, active: V) -> V;
    /// Returns the part of p = ∂w/∂f without the null Lagrangian, from ∇u = f − I: p = `stress` + `self_stress`. It
    /// vanishes with load and displacement, so small loads are not lost in the rounding of the prestress.
    fn stress<V: Value>(&self, gradient: Tensor<V>, active: V) -> Tensor<V>;
    /// Returns the derivative of `stress` along `df`.
    fn tangent<V: Value>(&self, gradient: Tensor<V>, active: V, df: Tensor<V>) -> Tensor<V>;
    /// Returns the material with the additional energy ½γ(tr c + j⁻²), divided by 1 + γ; `None` where it has another
    /// form.
    fn with_unrelaxed(&self, _gamma: f64) -> Option<Self>
    where
        Self: Sized,
    {
        None
    }
    /// Returns the mean of `stress` over a step from f to f + `df`, whose work is the change of energy without the null
    /// Lagrangian. It is the mean at two Gauss points, with a correction along `df` in long steps (Gonzalez, J.
    /// Nonlinear Sci. 6 (1996) 449).
    #[inline(always)]
    fn stress_between<V: Value>(&self, gradient: Tensor<V>, active: V, df: Tensor<V>) -> Tensor<V> {
        let number = |value: f64| active.constant(value);
        let [near, far] = Line::LINEAR.points;
        let first = self.stress(add_scaled(gradient, number(near), df), active);
        let last = self.stress(add_scaled(gradient, number(far), df), active);
        let zero = number(0.0);
        let mean = add_scaled([[zero; 2]; 2], number(0.5), first);
        let stress = add_scaled(mean, number(0.5), last);
        let (start, end) = (
            deformation(gradient),
            deformation(add_scaled(gradient, number(1.0), df)),
        );
        // The null Lagrangian is α tr f + β det f.
        let alpha = self.self_stress([[0.0; 2]; 2])[0][0];
        let beta = self.self_stress([[1.0, 0.0], [0.0, 1.0]])[0][0] - alpha;
        let null = number(alpha) * (df[0][0] + df[1][1]) + number(beta) * (determinant(end) - determinant(start));
        let error = self.energy(end, active) - self.energy(start, active) - null - contract(stress, df);
        let square = contract(df, df);
        // In a shorter step the error is of fifth order and less than the rounding of the energies.
        let long = square - number(LONG_STEP);
        let share = long.choose(error * square.max(number(LONG_STEP)).recip(), number(0.0));
        add_scaled(stress, share, df)
    }
    /// Returns the moduli of [`MaterialPoint::tangent`]. Conjugate gradients evaluate it along many directions at one
    /// state; for some materials, reading stored moduli is faster than computing them again.
    fn moduli<V: Value>(&self, gradient: Tensor<V>, active: V) -> [V; MODULI];
    /// Returns a number that is positive where the energy is finite; equilibria are sought only there.
    #[inline(always)]
    fn admissible<V: Value>(&self, gradient: Tensor<V>) -> V {
        determinant(deformation(gradient))
    }
    /// Returns a stress αI + β cof f with uniform α and β. It is free of divergence for any f, because the cofactor of
    /// a gradient is.
    fn self_stress(&self, f: Tensor<f64>) -> Tensor<f64>;
    /// Returns the load, in units of [`MaterialPoint::load`], beyond which no equilibrium from rest is sought: twice
    /// the load at which a fully active membrane loses stability.
    fn largest_load(&self) -> f64;
    /// Returns the load: the stress due to the voltage in an undisplaced active cell.
    fn load(&self) -> f64;
    /// Returns the margins of stability at f.
    fn margins<V: Value>(&self, f: Tensor<V>, active: V) -> Margins<V>;
    /// Returns the margin of ellipticity.
    #[inline(always)]
    fn ellipticity<V: Value>(&self, f: Tensor<V>, active: V) -> V {
        self.margins(f, active).ellipticity
    }
}
