//! The residual and the tangent–vector product of the membrane, without a matrix.

pub use super::activity::{Activity, Within, load_of};
use super::boundary::{Boundary, EdgeStress, cofactor_stress};
use super::energy::Margins;
pub use super::kernels::MaterialAtRest;
use super::kernels::{stress_at_rest, without_material};
use super::laminates::Laminates;
use super::layout::NodeLayout;
use super::material::{Material, MaterialPrecision, Passes};
use super::memory;
pub use super::precision::Precision;
use super::registers::dispatch;
use super::rigid::Pose;
use super::supports::Supports;

/// The discrete equilibrium of a pattern with a material.
#[derive(Clone, Copy)]
pub struct Operator<'a, L> {
    /// The material at its load.
    pub material: &'a L,
    /// The elements and their activity.
    pub activity: &'a Activity,
    /// Share of the loads of bodies and sides.
    pub body_load: f64,
    /// Share of the prestress that sides release.
    pub release: f64,
    /// Further dead forces on nodes, with the opposite sign.
    pub dead: Option<&'a [f64]>,
}

impl<'a, L> Operator<'a, L> {
    /// Creates the equilibrium with the full loads of bodies.
    #[must_use]
    pub fn new(material: &'a L, activity: &'a Activity) -> Self {
        Self {
            material,
            activity,
            body_load: 1.0,
            release: 1.0,
            dead: None,
        }
    }
}

impl<L: Material> Operator<'_, L> {
    /// Returns the layout of nodal vectors.
    #[must_use]
    pub fn layout(&self) -> NodeLayout {
        self.activity.grid().layout()
    }

    /// Returns the laminates of elements that electrodes cover in part, if there are any.
    pub fn laminates(&self) -> Option<Laminates<'_, L>> {
        Laminates::of(self.activity, self.material)
    }

    /// Returns a bound of the entries of a residual due to rounding of the stress at rest, which is not zero with
    /// unequal prestretch.
    #[must_use]
    pub fn rounding(&self) -> f64 {
        let [along, across] = stress_at_rest(
            |gradient| self.material.stress(gradient, 0.0),
            self.activity.grid().rest(),
        );
        let remembered = self.activity.memory().map_or(0.0, |memory| memory.largest);
        2.0 * f64::EPSILON * (along.abs() + across.abs() + remembered)
    }

    /// Writes the residual at interior nodes, zero on the frame, into `out`. Returns the smallest
    /// [`Material::admissible`]; the residual is valid only where that is positive.
    pub fn residual(&self, u: &[f64], out: &mut [f64]) -> f64 {
        let smallest = self.forces(u, out);
        if let Some(supports) = self.activity.grid().supports() {
            supports.restrict_forces(&supports.poses(u), self.body_load, out);
        }
        smallest
    }

    /// Writes the residual of the undisplaced membrane into `out`; `rest` is zero everywhere.
    pub fn residual_at_rest(&self, rest: &[f64], out: &mut [f64]) {
        if self.is_uniform_at_rest() {
            let at_rest = f64::passes(self.material).at_rest();
            without_material(self.activity).forces_at_rest(rest, &at_rest, out);
        } else {
            self.residual(rest, out);
        }
    }

    /// Returns whether all bare elements are equal at rest, and all active ones, and a single evaluation of each saves
    /// time.
    fn is_uniform_at_rest(&self) -> bool {
        let grid = self.activity.grid();
        let is_whole = self.activity.covered().is_none();
        let is_alone = grid.supports().is_none() && self.activity.memory().is_none() && is_whole;
        self.material.stores_moduli() && grid.is_plain() && is_alone && self.activity.is_binary()
    }

    /// Writes the forces of all elements on the nodes inside the edge into `out`; returns the smallest
    /// [`Material::admissible`].
    pub fn forces(&self, u: &[f64], out: &mut [f64]) -> f64 {
        let smallest = self.material.forces(self.activity, u, out);
        self.add_memory_forces(out, |memory_forces| {
            without_material(self.activity).forces_of_memory(u, memory_forces)
        });
        let smallest = match self.laminates() {
            Some(laminates) => smallest.min(laminates.add_forces(u, out)),
            None => smallest,
        };
        self.add_forces_of_sides(u, out);
        if let Some(dead) = self.dead {
            out.iter_mut().zip(dead).for_each(|(out, dead)| *out += dead);
        }
        smallest
    }

    /// Adds the forces on sides that are not held, if any.
    fn add_forces_of_sides(&self, u: &[f64], out: &mut [f64]) {
        let grid = self.activity.grid();
        if let Some(boundary) = grid.boundary() {
            let stress = EdgeStress::of(self.material, grid.rest());
            boundary.add_forces(&stress, [self.release, self.body_load], u, out);
        }
    }

    /// Returns whether loads act on bodies or sides, or sides release a prestress.
    #[must_use]
    pub fn is_loaded(&self) -> bool {
        let grid = self.activity.grid();
        let on_bodies = grid.supports().is_some_and(Supports::is_loaded);
        let on_sides = |boundary: &Boundary| boundary.is_loaded(&EdgeStress::of(self.material, grid.rest()));
        on_bodies || grid.boundary().is_some_and(on_sides)
    }

    /// Writes the mean residual over a step from `u` by `du` at interior nodes into `out`; its work is the change of
    /// energy. `poses` are those of the bodies half-way.
    pub fn residual_between(&self, u: &[f64], du: &[f64], poses: &[Pose], out: &mut [f64]) {
        self.material.forces_between(self.activity, [u, du], out);
        self.add_memory_forces(out, |memory_forces| {
            without_material(self.activity).forces_of_memory_between([u, du], memory_forces);
        });
        if self.activity.grid().boundary().is_some() {
            let between: Vec<f64> = u.iter().zip(du).map(|(u, du)| u + 0.5 * du).collect();
            self.add_forces_of_sides(&between, out);
        }
        if let Some(supports) = self.activity.grid().supports() {
            supports.restrict_forces(poses, self.body_load, out);
        }
    }

    /// Writes the derivative with respect to `u` of v · Kv at interior nodes into `out`, with the tangent K of branches
    /// of modulus 1 that are relaxed at `u`. Bodies are ignored.
    pub fn relaxed_tangent_derivative(&self, u: &[f64], v: &[f64], out: &mut [f64]) {
        without_material(self.activity).relaxed_tangent_derivative([u, v], out);
        self.activity.grid().restrict(u, out);
    }

    /// Adds the forces of the [`memory::Memory`] of the elements, if any.
    fn add_memory_forces(&self, out: &mut [f64], forces: impl FnOnce(&mut [f64])) {
        if self.activity.memory().is_none() {
            return;
        }
        let mut more = vec![0.0; out.len()];
        forces(&mut more);
        dispatch(
            #[inline(always)]
            || out.iter_mut().zip(&more).for_each(|(out, more)| *out += more),
        );
    }

    /// Writes the tangent at `u` times `du` at interior nodes into `out`.
    pub fn tangent<T: MaterialPrecision>(&self, u: &[T], du: &[T], out: &mut [T]) {
        let curvatures = self.curvatures(u);
        let (mut moduli, passes) = (Vec::new(), T::passes(self.material));
        passes.store_moduli(self.activity, u, &mut moduli);
        passes.tangent_product(self.activity, [u, du], &moduli, out);
        if let Some(laminates) = self.laminates() {
            moduli.clear();
            laminates.store_moduli(u, &mut moduli);
            laminates.add_product(du, &moduli, out);
        }
        self.add_product_of_sides(du, out);
        self.add_bodies(u, du, &curvatures, out);
    }

    /// Adds the tangent of the forces on sides that are not held, times `du`.
    fn add_product_of_sides<T: MaterialPrecision>(&self, du: &[T], out: &mut [T]) {
        if let Some(boundary) = self.activity.grid().boundary() {
            boundary.add_product(cofactor_stress(self.material), du, out);
        }
    }

    /// Writes the Laplacian times `du` into `out`: the tangent of a membrane without thickness and voltage, and of
    /// bodies without loads and springs.
    pub fn laplacian<T: MaterialPrecision>(&self, u: &[T], du: &[T], out: &mut [T]) {
        T::laplacian(self.activity, [u, du], out);
        if let Some(supports) = self.activity.grid().supports() {
            supports.restrict(&supports.poses(u), out);
        }
    }

    /// Returns the curvature of the rotation of each body at `u`.
    pub fn curvatures<T: MaterialPrecision>(&self, u: &[T]) -> Vec<f64> {
        let Some(supports) = self.activity.grid().supports() else {
            return Vec::new();
        };
        if supports.bodies().is_empty() {
            return Vec::new();
        }
        let u: Vec<f64> = u.iter().map(|value| value.to_f64()).collect();
        let mut forces = vec![0.0; u.len()];
        self.forces(&u, &mut forces);
        supports.curvatures(&supports.poses(&u), self.body_load, &forces)
    }

    /// Projects the tangent product of `du` onto forces of frames and bodies, and adds springs and the curvature of
    /// rotations.
    fn add_bodies<T: MaterialPrecision>(&self, u: &[T], du: &[T], curvatures: &[f64], out: &mut [T]) {
        let Some(supports) = self.activity.grid().supports() else {
            return;
        };
        supports.restrict_product(&supports.poses(u), curvatures, du, out);
    }

    /// Writes the moduli for [`Operator::tangent_at`] at `u`, and the curvatures of bodies. There are no moduli at rest
    /// with equal elements, and for a material without memory that does not store moduli.
    pub fn linearise<T: MaterialPrecision>(&self, u: &[T], moduli: &mut Vec<T>) {
        if self.is_uniform_at_rest() && u.iter().all(|u| u.to_f64() == 0.0) {
            moduli.clear();
        } else {
            T::passes(self.material).store_moduli(self.activity, u, moduli);
        }
        if let Some(laminates) = self.laminates() {
            laminates.store_moduli(u, moduli);
        }
        moduli.extend(self.curvatures(u).into_iter().map(T::from_f64));
    }

    /// Writes the tangent at a linearised `u` times `du` at interior nodes into `out`.
    pub fn tangent_at<T: MaterialPrecision>(&self, u: &[T], moduli: &[T], du: &[T], out: &mut [T]) {
        let bodies = self
            .activity
            .grid()
            .supports()
            .map_or(0, |supports| supports.bodies().len());
        let (moduli, curvatures) = moduli.split_at(moduli.len() - bodies);
        let laminates = self.laminates();
        let count = laminates.as_ref().map_or(0, Laminates::count_moduli);
        let (moduli, of_laminates) = moduli.split_at(moduli.len() - count);
        let passes = T::passes(self.material);
        if self.material.stores_moduli() && moduli.is_empty() {
            T::tangent_at_rest(self.activity, [u, du], &passes.at_rest(), out);
        } else {
            passes.tangent_product(self.activity, [u, du], moduli, out);
        }
        if let Some(laminates) = laminates {
            laminates.add_product(du, of_laminates, out);
        }
        self.add_product_of_sides(du, out);
        let curvatures: Vec<f64> = curvatures.iter().map(|curvature| curvature.to_f64()).collect();
        self.add_bodies(u, du, &curvatures, out);
    }

    /// Returns the smallest margins over the quadrature points.
    pub fn margins<T: MaterialPrecision>(&self, u: &[T]) -> Margins<f64> {
        let margins = T::passes(self.material).smallest_margins(self.activity, u);
        match self.laminates() {
            Some(laminates) => laminates.smallest_margins(u, margins),
            None => margins,
        }
    }
}

/// Returns c⁻¹ along xx, xy and yy, and j², at all quadrature points, in lines as `memory::line` orders them.
#[must_use]
pub fn metrics(activity: &Activity, u: &[f64]) -> Vec<f64> {
    let mut values = Vec::new();
    write_metrics(activity, u, &mut values);
    values
}

/// Writes the metrics into a buffer, new or of the same grid; padding is left unchanged.
pub fn write_metrics(activity: &Activity, u: &[f64], values: &mut Vec<f64>) {
    let layout = activity.grid().layout();
    let points = (layout.degree() + 1).pow(2);
    values.resize(layout.element_rows() * points * memory::NUMBERS * layout.part(), 0.0);
    without_material(activity).metrics(u, values);
}
