//! Elastic and electric energy of a point of the membrane, one form per file; the laws that have these forms are those of
//! [`deaflow_scene::laws`].
//!
//! [`NeoHookean`] is the base model, and nothing else is compiled into its kernels. With effects the law is that of an
//! [`Isotropic`] potential, put together of an elastomer, a dielectric and electrodes. All combinations share one type,
//! [`AnyPotential`], so that kernels are compiled twice in all: a [`Compound`] carries what is off as a number that makes it
//! vanish, and the elastic form and wrinkling are branches that are the same at all points.

mod any_potential;
mod compound;
mod elasticity;
mod first_invariant;
mod isotropic;
mod neo_hookean;
mod ogden;
mod potential;
mod second_invariant;

pub use any_potential::AnyPotential;
pub use compound::Compound;
pub use elasticity::{Elastic, Neo, relief};
pub use first_invariant::FirstInvariant;
pub use isotropic::{Isotropic, tangent_from};
pub use neo_hookean::NeoHookean;
pub use ogden::{MOST_TERMS, Ogden};
pub use potential::{Invariants, Potential, Rest, Slopes, Watched, slopes_apart};
pub use second_invariant::SecondInvariant;

use super::element::Line;
use super::kinematics::{Tensor, add_scaled, contract, deformation, determinant};
use super::lanes::Value;

/// Numbers that determine a tangent at a given deformation: 2φᵢ, φⱼ, 4φᵢᵢ, 2φᵢⱼ and φⱼⱼ of an isotropic potential.
pub const MODULI: usize = 5;

/// The square of a step that is long.
const LONG: f64 = 1e-5;

/// How far a law is from being lost: at a point, or the least of all points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins<V> {
    /// The smallest acoustic eigenvalue, min over unit m and N of (m⊗N) : ∂²w/∂f² : (m⊗N); positive where the law is
    /// strongly elliptic.
    pub ellipticity: V,
    /// Positive where the tangent, shifted by a null Lagrangian, is positive definite at the point. If it is positive everywhere
    /// the equilibrium of a clamped membrane is certainly stable; the converse does not hold.
    pub convexity: V,
    /// The largest principal stress where the membrane wrinkles, as far as its sign matters: not negative while there is
    /// tension. Some positive number elsewhere, infinite over all points under a law that does not wrinkle.
    pub tension: V,
}

/// An energy density per area of the prestretched membrane, in units of μH, as a function of f = I + ∇u.
///
/// `active` is 1 where the membrane carries an electrode and 0 where it is bare.
pub trait MaterialPoint: Sync + 'static {
    /// Whether a pattern can have several stable equilibria at one load, as where the elastomer stiffens after a snap. The
    /// loading then takes care to stay on the branch that begins at rest.
    fn has_several_branches(&self) -> bool {
        false
    }
    /// Whether the membrane bears no compression, so that it can lose its tension.
    fn wrinkles(&self) -> bool {
        false
    }
    /// Whether it is worth while to keep [`MaterialPoint::moduli`] at all points.
    const STORES: bool = false;

    /// w(f).
    fn energy<V: Value>(&self, f: Tensor<V>, active: V) -> V;
    /// The part of p = ∂w/∂f that is no null Lagrangian, from ∇u = f − I: p = `stress` + `self_stress`. It vanishes with
    /// the load and the displacement, so small loads do not drown in the rounding of the prestress.
    fn stress<V: Value>(&self, gradient: Tensor<V>, active: V) -> Tensor<V>;
    /// The derivative of `stress` along `df`.
    fn tangent<V: Value>(&self, gradient: Tensor<V>, active: V, df: Tensor<V>) -> Tensor<V>;
    /// The law with ½γ(tr c + j⁻²) beside it, over 1 + γ, where it is of the same form.
    fn with_unrelaxed(&self, _gamma: f64) -> Option<Self>
    where
        Self: Sized,
    {
        None
    }
    /// The mean of `stress` over a step from f to f + `df`, such that its work is the change of energy but for that of the null Lagrangian: by
    /// Gauss's two points, and over long steps with as much along `df` added as is wanting (Gonzalez, J. Nonlinear Sci. 6 (1996) 449).
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
        let wanting = self.energy(end, active) - self.energy(start, active) - null - contract(stress, df);
        let square = contract(df, df);
        // What is wanting to a shorter step, of fifth order, is less than the rounding of the energies.
        let long = square - number(LONG);
        let share = long.choose(wanting * square.max(number(LONG)).recip(), number(0.0));
        add_scaled(stress, share, df)
    }
    /// The numbers that [`MaterialPoint::tangent`] takes more time to find than to read again, for conjugate gradients that ask for it
    /// in many directions at one place.
    fn moduli<V: Value>(&self, gradient: Tensor<V>, active: V) -> [V; MODULI];
    /// Positive where the energy is finite: an equilibrium is sought only there.
    #[inline(always)]
    fn admissible<V: Value>(&self, gradient: Tensor<V>) -> V {
        determinant(deformation(gradient))
    }
    /// A stress of the form αI + β cof f with uniform α and β: free of divergence whatever f, because the cofactor of a
    /// gradient is.
    fn self_stress(&self, f: Tensor<f64>) -> Tensor<f64>;
    /// A load, in the unit of [`MaterialPoint::load`], beyond which it is not worth looking for an equilibrium from rest: twice that
    /// at which a membrane that is active everywhere loses stability.
    fn largest_load(&self) -> f64;
    /// The size of the load, the stress that the voltage causes in an undisplaced active cell.
    fn load(&self) -> f64;
    /// How far the law is from being lost at f.
    fn margins<V: Value>(&self, f: Tensor<V>, active: V) -> Margins<V>;
    /// The first of them.
    #[inline(always)]
    fn ellipticity<V: Value>(&self, f: Tensor<V>, active: V) -> V {
        self.margins(f, active).ellipticity
    }
}
