//! Laws as the solver asks for them.
//!
//! A [`MaterialPoint`] is written once for numbers and registers, and compiled into kernels of its own. All that solves, follows and judges is the
//! same under every law: it asks a [`Material`], and what a scene calls for is [`AnyMaterial`], of which the type says nothing. So the solver is compiled
//! once and not for each law; it is asked for whole passes over the elements, or for single points where these are few.

use crate::activity::Activity;
use crate::energy::{Margins, MaterialPoint};
use crate::kernels::{Kernels, MaterialAtRest};
use crate::kinematics::{self, Tensor};
use crate::precision::Precision;
use crate::registers::dispatch;

/// A [`MaterialPoint`], of which a program can hold one without knowing its type.
pub trait Material: Passes<f64> + Passes<f32> + Sync {
    /// [`MaterialPoint::wrinkles`].
    fn wrinkles(&self) -> bool;
    /// [`MaterialPoint::has_several_branches`].
    fn has_several_branches(&self) -> bool;
    /// [`MaterialPoint::STORES`].
    fn stores(&self) -> bool;
    /// [`MaterialPoint::load`].
    fn load(&self) -> f64;
    /// [`MaterialPoint::largest_load`].
    fn largest_load(&self) -> f64;
    /// [`MaterialPoint::self_stress`].
    fn self_stress(&self, f: Tensor<f64>) -> Tensor<f64>;
    /// [`MaterialPoint::energy`].
    fn energy(&self, f: Tensor<f64>, active: f64) -> f64;
    /// [`MaterialPoint::stress`].
    fn stress(&self, gradient: Tensor<f64>, active: f64) -> Tensor<f64>;
    /// [`MaterialPoint::tangent`].
    fn tangent(&self, gradient: Tensor<f64>, active: f64, df: Tensor<f64>) -> Tensor<f64>;
    /// [`MaterialPoint::admissible`].
    fn admissible(&self, gradient: Tensor<f64>) -> f64;
    /// [`MaterialPoint::margins`].
    fn margins(&self, f: Tensor<f64>, active: f64) -> Margins<f64>;
    /// [`MaterialPoint::ellipticity`].
    fn ellipticity(&self, f: Tensor<f64>, active: f64) -> f64 {
        self.margins(f, active).ellipticity
    }
    /// [`MaterialPoint::with_unrelaxed`].
    fn with_unrelaxed(&self, gamma: f64) -> Option<Self>
    where
        Self: Sized;
    /// The same of a law whose type is not known.
    fn any_with_unrelaxed(&self, gamma: f64) -> Option<AnyMaterial>;
    /// The energies of points side by side, from the lines of their metrics, into `out`; of a law that takes much time at active ones alone,
    /// where these are what is asked for.
    fn energies(&self, metric: [&[f64]; 4], active: &[f64], of_active_alone: bool, out: &mut [f64]);
    /// The forces of all elements at `u` on the nodes that are not on the edge, into `out`; returns the smallest [`MaterialPoint::admissible`].
    fn forces(&self, activity: &Activity, u: &[f64], out: &mut [f64]) -> f64;
    /// Their mean over a step from `u` by `du`.
    fn forces_between(&self, activity: &Activity, step: [&[f64]; 2], out: &mut [f64]);
}

/// Passes of a law over the elements, in one precision.
pub trait Passes<T> {
    /// Writes the moduli that [`Passes::image`] reads: none of a law that is quick to evaluate, on elements without a memory.
    fn store(&self, activity: &Activity, u: &[T], moduli: &mut Vec<T>);
    /// The elements' part of the tangent at `u` times `du`, into `out`.
    fn image(&self, activity: &Activity, step: [&[T]; 2], moduli: &[T], out: &mut [T]);
    /// The smallest margins over the quadrature points.
    fn least(&self, activity: &Activity, u: &[T]) -> Margins<f64>;
    /// What the law says of undisplaced points.
    fn at_rest(&self) -> MaterialAtRest;
}

/// A precision in which the passes of a material are compiled.
pub trait MaterialPrecision: Precision {
    /// Returns the passes of a material in this precision.
    fn passes<L: Material + ?Sized>(material: &L) -> &(impl Passes<Self> + ?Sized);
}

impl MaterialPrecision for f64 {
    fn passes<L: Material + ?Sized>(material: &L) -> &(impl Passes<Self> + ?Sized) {
        material
    }
}

impl MaterialPrecision for f32 {
    fn passes<L: Material + ?Sized>(material: &L) -> &(impl Passes<Self> + ?Sized) {
        material
    }
}

impl<L: MaterialPoint> Material for L {
    fn wrinkles(&self) -> bool {
        MaterialPoint::wrinkles(self)
    }

    fn has_several_branches(&self) -> bool {
        MaterialPoint::has_several_branches(self)
    }

    fn stores(&self) -> bool {
        L::STORES
    }

    fn load(&self) -> f64 {
        MaterialPoint::load(self)
    }

    fn largest_load(&self) -> f64 {
        MaterialPoint::largest_load(self)
    }

    fn self_stress(&self, f: Tensor<f64>) -> Tensor<f64> {
        MaterialPoint::self_stress(self, f)
    }

    fn energy(&self, f: Tensor<f64>, active: f64) -> f64 {
        MaterialPoint::energy(self, f, active)
    }

    fn stress(&self, gradient: Tensor<f64>, active: f64) -> Tensor<f64> {
        MaterialPoint::stress(self, gradient, active)
    }

    fn tangent(&self, gradient: Tensor<f64>, active: f64, df: Tensor<f64>) -> Tensor<f64> {
        MaterialPoint::tangent(self, gradient, active, df)
    }

    fn admissible(&self, gradient: Tensor<f64>) -> f64 {
        MaterialPoint::admissible(self, gradient)
    }

    fn margins(&self, f: Tensor<f64>, active: f64) -> Margins<f64> {
        MaterialPoint::margins(self, f, active)
    }

    fn with_unrelaxed(&self, gamma: f64) -> Option<Self> {
        MaterialPoint::with_unrelaxed(self, gamma)
    }

    fn any_with_unrelaxed(&self, gamma: f64) -> Option<AnyMaterial> {
        MaterialPoint::with_unrelaxed(self, gamma).map(AnyMaterial::new)
    }

    fn energies(&self, metric: [&[f64]; 4], active: &[f64], of_active_alone: bool, out: &mut [f64]) {
        let [xx, xy, yy, square] = metric.map(|line| &line[..active.len()]);
        let out = &mut out[..active.len()];
        dispatch(
            #[inline(always)]
            || {
                let one = |at: usize| {
                    MaterialPoint::energy(
                        self,
                        kinematics::deformation_of_metric([xx[at], xy[at], yy[at], square[at]]),
                        active[at],
                    )
                };
                if L::STORES && of_active_alone {
                    for at in (0..active.len()).filter(|at| active[*at] != 0.0) {
                        out[at] = one(at);
                    }
                } else {
                    for (at, out) in out.iter_mut().enumerate() {
                        *out = one(at);
                    }
                }
            },
        );
    }

    fn forces(&self, activity: &Activity, u: &[f64], out: &mut [f64]) -> f64 {
        Kernels::new(self, activity).forces(u, out)
    }

    fn forces_between(&self, activity: &Activity, step: [&[f64]; 2], out: &mut [f64]) {
        Kernels::new(self, activity).forces_between(step, out);
    }
}

impl<L: MaterialPoint, T: Precision> Passes<T> for L {
    fn store(&self, activity: &Activity, u: &[T], moduli: &mut Vec<T>) {
        Kernels::new(self, activity).store(u, moduli);
    }

    fn image(&self, activity: &Activity, step: [&[T]; 2], moduli: &[T], out: &mut [T]) {
        Kernels::new(self, activity).image(step, moduli, out);
    }

    fn least(&self, activity: &Activity, u: &[T]) -> Margins<f64> {
        Kernels::new(self, activity).least(u)
    }

    fn at_rest(&self) -> MaterialAtRest {
        Kernels::<L>::at_rest::<T>(self)
    }
}

/// Any law.
pub struct AnyMaterial(Box<dyn Material>);

impl AnyMaterial {
    /// One of them.
    #[must_use]
    pub fn new(material: impl MaterialPoint) -> Self {
        Self(Box::new(material))
    }
}

impl Material for AnyMaterial {
    fn wrinkles(&self) -> bool {
        self.0.wrinkles()
    }

    fn has_several_branches(&self) -> bool {
        self.0.has_several_branches()
    }

    fn stores(&self) -> bool {
        self.0.stores()
    }

    fn load(&self) -> f64 {
        self.0.load()
    }

    fn largest_load(&self) -> f64 {
        self.0.largest_load()
    }

    fn self_stress(&self, f: Tensor<f64>) -> Tensor<f64> {
        self.0.self_stress(f)
    }

    fn energy(&self, f: Tensor<f64>, active: f64) -> f64 {
        self.0.energy(f, active)
    }

    fn stress(&self, gradient: Tensor<f64>, active: f64) -> Tensor<f64> {
        self.0.stress(gradient, active)
    }

    fn tangent(&self, gradient: Tensor<f64>, active: f64, df: Tensor<f64>) -> Tensor<f64> {
        self.0.tangent(gradient, active, df)
    }

    fn admissible(&self, gradient: Tensor<f64>) -> f64 {
        self.0.admissible(gradient)
    }

    fn margins(&self, f: Tensor<f64>, active: f64) -> Margins<f64> {
        self.0.margins(f, active)
    }

    fn with_unrelaxed(&self, gamma: f64) -> Option<Self> {
        self.any_with_unrelaxed(gamma)
    }

    fn any_with_unrelaxed(&self, gamma: f64) -> Option<AnyMaterial> {
        self.0.any_with_unrelaxed(gamma)
    }

    fn energies(&self, metric: [&[f64]; 4], active: &[f64], of_active_alone: bool, out: &mut [f64]) {
        self.0.energies(metric, active, of_active_alone, out);
    }

    fn forces(&self, activity: &Activity, u: &[f64], out: &mut [f64]) -> f64 {
        self.0.forces(activity, u, out)
    }

    fn forces_between(&self, activity: &Activity, step: [&[f64]; 2], out: &mut [f64]) {
        self.0.forces_between(activity, step, out);
    }
}

impl<T: MaterialPrecision> Passes<T> for AnyMaterial {
    fn store(&self, activity: &Activity, u: &[T], moduli: &mut Vec<T>) {
        T::passes(&*self.0).store(activity, u, moduli);
    }

    fn image(&self, activity: &Activity, step: [&[T]; 2], moduli: &[T], out: &mut [T]) {
        T::passes(&*self.0).image(activity, step, moduli, out);
    }

    fn least(&self, activity: &Activity, u: &[T]) -> Margins<f64> {
        T::passes(&*self.0).least(activity, u)
    }

    fn at_rest(&self) -> MaterialAtRest {
        T::passes(&*self.0).at_rest()
    }
}
