//! Materials with type-erased passes over elements.
//!
//! A [`MaterialPoint`] is written once for numbers and registers, and compiled into separate kernels. The solver
//! depends on a [`Material`] only, and scenes give an [`AnyMaterial`], which hides the type. So the solver is compiled
//! once and not per material. Its calls are whole passes over the elements, or single points where these are few.

use crate::activity::Activity;
use crate::energy::{MODULI, Margins, MaterialPoint, NeoHookean};
use crate::kernels::{Kernels, MaterialAtRest, without_material};
use crate::kinematics::{self, Tensor};
use crate::precision::Precision;
use crate::registers::dispatch;

/// A [`MaterialPoint`] as a trait object.
pub trait Material: Passes<f64> + Passes<f32> + Sync {
    /// [`MaterialPoint::WRINKLES`].
    fn wrinkles(&self) -> bool;
    /// [`MaterialPoint::SEVERAL_BRANCHES`].
    fn has_several_branches(&self) -> bool;
    /// [`MaterialPoint::STORES_MODULI`].
    fn stores_moduli(&self) -> bool;
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
    /// [`MaterialPoint::moduli`].
    fn moduli(&self, gradient: Tensor<f64>, active: f64) -> [f64; MODULI];
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
    /// [`Material::with_unrelaxed`] with a type-erased result.
    fn any_with_unrelaxed(&self, gamma: f64) -> Option<AnyMaterial>;
    /// Writes the energies of points, from the lines of their metrics, into `out`. With `of_active_alone`, a material
    /// that stores moduli is evaluated at active points only.
    fn energies(&self, metric: [&[f64]; 4], active: &[f64], of_active_alone: bool, out: &mut [f64]);
    /// Writes the forces of all elements at `u` on the nodes inside the edge into `out`; returns the smallest
    /// [`MaterialPoint::admissible`].
    fn forces(&self, activity: &Activity, u: &[f64], out: &mut [f64]) -> f64;
    /// Writes the mean forces over a step from `u` by `du` into `out`.
    fn forces_between(&self, activity: &Activity, step: [&[f64]; 2], out: &mut [f64]);
}

/// Passes of a material over the elements, in one precision.
pub trait Passes<T> {
    /// Writes the moduli that [`Passes::tangent_product`] reads: none without a memory for a material that does not
    /// store them.
    fn store_moduli(&self, activity: &Activity, u: &[T], moduli: &mut Vec<T>);
    /// Writes the tangent of the elements at `u` times `du` into `out`.
    fn tangent_product(&self, activity: &Activity, step: [&[T]; 2], moduli: &[T], out: &mut [T]);
    /// Returns the smallest margins over the quadrature points.
    fn smallest_margins(&self, activity: &Activity, u: &[T]) -> Margins<f64>;
    /// Returns stresses and moduli at undisplaced points.
    fn at_rest(&self) -> MaterialAtRest;
}

/// A precision in which the passes of a material are compiled.
pub trait MaterialPrecision: Precision {
    /// Returns the passes of a material in this precision.
    fn passes<L: Material + ?Sized>(material: &L) -> &(impl Passes<Self> + ?Sized);
    /// Writes the Laplacian at the first field times the second into `out`.
    fn laplacian(activity: &Activity, step: [&[Self]; 2], out: &mut [Self]);
    /// Writes the tangent of elements that are squares at rest times the second field into `out`.
    fn tangent_at_rest(activity: &Activity, step: [&[Self]; 2], material: &MaterialAtRest, out: &mut [Self]);
}

macro_rules! material_precision {
    ($real:ty) => {
        impl MaterialPrecision for $real {
            fn passes<L: Material + ?Sized>(material: &L) -> &(impl Passes<Self> + ?Sized) {
                material
            }

            fn laplacian(activity: &Activity, step: [&[Self]; 2], out: &mut [Self]) {
                without_material(activity).tangent(step, out);
            }

            fn tangent_at_rest(activity: &Activity, step: [&[Self]; 2], material: &MaterialAtRest, out: &mut [Self]) {
                without_material(activity).tangent_at_rest(step, material, out);
            }
        }
    };
}

material_precision!(f64);
material_precision!(f32);

// What is not inlined is compiled once, with this crate, if its type is in `Composition`.
impl<L: MaterialPoint> Material for L {
    fn wrinkles(&self) -> bool {
        L::WRINKLES
    }

    fn has_several_branches(&self) -> bool {
        L::SEVERAL_BRANCHES
    }

    fn stores_moduli(&self) -> bool {
        L::STORES_MODULI
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

    #[inline(never)]
    fn energy(&self, f: Tensor<f64>, active: f64) -> f64 {
        MaterialPoint::energy(self, f, active)
    }

    #[inline(never)]
    fn stress(&self, gradient: Tensor<f64>, active: f64) -> Tensor<f64> {
        MaterialPoint::stress(self, gradient, active)
    }

    #[inline(never)]
    fn tangent(&self, gradient: Tensor<f64>, active: f64, df: Tensor<f64>) -> Tensor<f64> {
        MaterialPoint::tangent(self, gradient, active, df)
    }

    #[inline(never)]
    fn moduli(&self, gradient: Tensor<f64>, active: f64) -> [f64; MODULI] {
        MaterialPoint::moduli(self, gradient, active)
    }

    fn admissible(&self, gradient: Tensor<f64>) -> f64 {
        MaterialPoint::admissible(self, gradient)
    }

    #[inline(never)]
    fn margins(&self, f: Tensor<f64>, active: f64) -> Margins<f64> {
        MaterialPoint::margins(self, f, active)
    }

    fn with_unrelaxed(&self, gamma: f64) -> Option<Self> {
        MaterialPoint::with_unrelaxed(self, gamma)
    }

    fn any_with_unrelaxed(&self, gamma: f64) -> Option<AnyMaterial> {
        MaterialPoint::with_unrelaxed(self, gamma).map(AnyMaterial::new)
    }

    #[inline(never)]
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
                if L::STORES_MODULI && of_active_alone {
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

    #[inline(never)]
    fn forces(&self, activity: &Activity, u: &[f64], out: &mut [f64]) -> f64 {
        Kernels::new(self, activity).forces(u, out)
    }

    #[inline(never)]
    fn forces_between(&self, activity: &Activity, step: [&[f64]; 2], out: &mut [f64]) {
        Kernels::new(self, activity).forces_between(step, out);
    }
}

impl<L: MaterialPoint, T: Precision> Passes<T> for L {
    #[inline(never)]
    fn store_moduli(&self, activity: &Activity, u: &[T], moduli: &mut Vec<T>) {
        Kernels::new(self, activity).store_moduli(u, moduli);
    }

    #[inline(never)]
    fn tangent_product(&self, activity: &Activity, step: [&[T]; 2], moduli: &[T], out: &mut [T]) {
        Kernels::new(self, activity).tangent_product(step, moduli, out);
    }

    #[inline(never)]
    fn smallest_margins(&self, activity: &Activity, u: &[T]) -> Margins<f64> {
        Kernels::new(self, activity).smallest_margins(u)
    }

    #[inline(never)]
    fn at_rest(&self) -> MaterialAtRest {
        Kernels::<L>::at_rest::<T>(self)
    }
}

/// A material of any type.
pub struct AnyMaterial(Box<dyn Material>);

impl AnyMaterial {
    /// Erases the type of a material.
    #[must_use]
    pub fn new(material: impl Material + 'static) -> Self {
        Self(Box::new(material))
    }
}

impl From<NeoHookean> for AnyMaterial {
    fn from(material: NeoHookean) -> Self {
        Self::new(material)
    }
}

impl Material for AnyMaterial {
    #[inline]
    fn wrinkles(&self) -> bool {
        self.0.wrinkles()
    }

    #[inline]
    fn has_several_branches(&self) -> bool {
        self.0.has_several_branches()
    }

    #[inline]
    fn stores_moduli(&self) -> bool {
        self.0.stores_moduli()
    }

    #[inline]
    fn load(&self) -> f64 {
        self.0.load()
    }

    fn largest_load(&self) -> f64 {
        self.0.largest_load()
    }

    fn self_stress(&self, f: Tensor<f64>) -> Tensor<f64> {
        self.0.self_stress(f)
    }

    #[inline]
    fn energy(&self, f: Tensor<f64>, active: f64) -> f64 {
        self.0.energy(f, active)
    }

    #[inline]
    fn stress(&self, gradient: Tensor<f64>, active: f64) -> Tensor<f64> {
        self.0.stress(gradient, active)
    }

    #[inline]
    fn tangent(&self, gradient: Tensor<f64>, active: f64, df: Tensor<f64>) -> Tensor<f64> {
        self.0.tangent(gradient, active, df)
    }

    #[inline]
    fn moduli(&self, gradient: Tensor<f64>, active: f64) -> [f64; MODULI] {
        self.0.moduli(gradient, active)
    }

    #[inline]
    fn admissible(&self, gradient: Tensor<f64>) -> f64 {
        self.0.admissible(gradient)
    }

    #[inline]
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
    fn store_moduli(&self, activity: &Activity, u: &[T], moduli: &mut Vec<T>) {
        T::passes(&*self.0).store_moduli(activity, u, moduli);
    }

    fn tangent_product(&self, activity: &Activity, step: [&[T]; 2], moduli: &[T], out: &mut [T]) {
        T::passes(&*self.0).tangent_product(activity, step, moduli, out);
    }

    fn smallest_margins(&self, activity: &Activity, u: &[T]) -> Margins<f64> {
        T::passes(&*self.0).smallest_margins(activity, u)
    }

    fn at_rest(&self) -> MaterialAtRest {
        T::passes(&*self.0).at_rest()
    }
}
