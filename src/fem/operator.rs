//! The residual and the tangent–vector product of the whole membrane, without a matrix.

pub use super::activity::{Activity, Within, load_of};
use super::energy::Margins;
pub use super::kernels::MaterialAtRest;
pub(crate) use super::kernels::{from_rest, on_sides, per_side};
use super::kernels::{stress_at_rest, without_law};
use super::layout::NodeLayout;
use super::material::{Material, MaterialPrecision, Passes};
use super::memory;
pub use super::precision::Precision;
use super::registers::dispatch;
use super::sheet::Mount;
use super::supports::{Pose, Supports};

/// The discrete equilibrium of one pattern under one law.
#[derive(Clone, Copy)]
pub struct Operator<'a, L> {
    /// What the membrane is made of, at its load.
    pub material: &'a L,
    /// Its elements, and where it is active.
    pub activity: &'a Activity,
    /// The share of their loads that pulls the bodies.
    pub pulled: f64,
}

impl<'a, L> Operator<'a, L> {
    /// The equilibrium with the whole loads of bodies.
    #[must_use]
    pub fn new(material: &'a L, activity: &'a Activity) -> Self {
        Self {
            material,
            activity,
            pulled: 1.0,
        }
    }
}

impl<L: Material> Operator<'_, L> {
    /// How vectors lie in memory.
    #[must_use]
    pub fn layout(&self) -> NodeLayout {
        self.activity.grid().layout()
    }

    /// What rounding of the stress at rest may leave of a residual, entry by entry: where prestretch is unequal that stress is not zero.
    #[must_use]
    pub fn rounding(&self) -> f64 {
        let [along, across] = stress_at_rest(
            |gradient| self.material.stress(gradient, 0.0),
            self.activity.grid().rest(),
        );
        let remembered = self.activity.memory().map_or(0.0, |memory| memory.largest);
        2.0 * f64::EPSILON * (along.abs() + across.abs() + remembered)
    }

    /// The residual at interior nodes, zero on the frame, into `out`. Returns the smallest [`Material::admissible`]; the
    /// residual means something only where that is positive.
    pub fn residual(&self, u: &[f64], out: &mut [f64]) -> f64 {
        let smallest = self.forces(u, out);
        if let Some(supports) = self.activity.grid().supports() {
            self.mount(supports, &supports.poses(u), out);
        }
        smallest
    }

    /// Makes forces on nodes those that frames and bodies at some poses see, with loads and springs.
    fn mount(&self, supports: &Supports, poses: &[Pose], out: &mut [f64]) {
        let bodies = supports.bodies();
        supports.restrict_with(poses, out, |body, [x, y, moment]| {
            let (Mount { load, spring }, [p, q]) = (bodies[body].mount, poses[body].translation);
            [
                x + spring * p - self.pulled * load[0],
                y + spring * q - self.pulled * load[1],
                moment,
            ]
        });
    }

    /// The residual of a membrane that is not displaced; `rest` is zero everywhere.
    pub fn residual_at_rest(&self, rest: &[f64], out: &mut [f64]) {
        if self.is_uniform_at_rest() {
            let law = f64::passes(self.material).at_rest();
            without_law(self.activity).forces_at_rest(rest, &law, out);
        } else {
            self.residual(rest, out);
        }
    }

    /// Whether all bare elements are alike at rest, and all active ones, under a law that is worth asking once for each.
    fn is_uniform_at_rest(&self) -> bool {
        let grid = self.activity.grid();
        let is_alone = grid.supports().is_none() && self.activity.memory().is_none();
        self.material.stores() && grid.is_plain() && is_alone && self.activity.is_binary()
    }

    /// The forces of all elements on the nodes that are not on the edge; returns the smallest [`Material::admissible`].
    fn forces(&self, u: &[f64], out: &mut [f64]) -> f64 {
        let smallest = self.material.forces(self.activity, u, out);
        self.remember(out, |of_memory| {
            without_law(self.activity).forces_of_memory(u, of_memory)
        });
        smallest
    }

    /// The mean residual over a step from `u` by `du`, of which the work is the change of energy, at interior nodes, into `out`; `poses` are
    /// those of the bodies half-way.
    pub fn residual_between(&self, u: &[f64], du: &[f64], poses: &[Pose], out: &mut [f64]) {
        self.material.forces_between(self.activity, [u, du], out);
        self.remember(out, |of_memory| {
            without_law(self.activity).forces_of_memory_between([u, du], of_memory);
        });
        if let Some(supports) = self.activity.grid().supports() {
            self.mount(supports, poses, out);
        }
    }

    /// The derivative by `u` of v · (the tangent times v) of branches of modulus 1 that have relaxed at `u`, at interior nodes, into `out`.
    /// Bodies are not seen to.
    pub fn relaxed_change(&self, u: &[f64], v: &[f64], out: &mut [f64]) {
        without_law(self.activity).following_tangent([u, v], out);
        self.activity.grid().restrict(u, out);
    }

    /// Adds the forces of the [`super::memory::Memory`] of the elements, where they have one.
    fn remember(&self, out: &mut [f64], forces: impl FnOnce(&mut [f64])) {
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

    /// The tangent at `u` times `du`, at interior nodes, into `out`.
    pub fn tangent<T: MaterialPrecision>(&self, u: &[T], du: &[T], out: &mut [T]) {
        let curvatures = self.curvatures(u);
        let (mut moduli, law) = (Vec::new(), T::passes(self.material));
        law.store(self.activity, u, &mut moduli);
        law.image(self.activity, [u, du], &moduli, out);
        self.add_bodies(u, du, &curvatures, out);
    }

    /// The Laplacian times `du`: the tangent of a membrane without thickness and voltage, of bodies without loads and springs.
    pub fn laplacian<T: MaterialPrecision>(&self, u: &[T], du: &[T], out: &mut [T]) {
        without_law(self.activity).tangent([u, du], out);
        if let Some(supports) = self.activity.grid().supports() {
            supports.restrict(&supports.poses(u), out);
        }
    }

    /// The curvature of the rotation of each body at `u`.
    pub(super) fn curvatures<T: MaterialPrecision>(&self, u: &[T]) -> Vec<f64> {
        let Some(supports) = self.activity.grid().supports() else {
            return Vec::new();
        };
        if supports.bodies().is_empty() {
            return Vec::new();
        }
        let u: Vec<f64> = u.iter().map(|value| value.to_f64()).collect();
        let mut forces = vec![0.0; u.len()];
        self.forces(&u, &mut forces);
        let each = supports.bodies().iter().zip(supports.poses(&u));
        each.map(|(body, pose)| body.nodes.curvature(&pose, &forces)).collect()
    }

    /// Makes the image of `du` one that frames and bodies see, with the springs and the curvature of rotations.
    fn add_bodies<T: MaterialPrecision>(&self, u: &[T], du: &[T], curvatures: &[f64], out: &mut [T]) {
        let Some(supports) = self.activity.grid().supports() else {
            return;
        };
        let poses = supports.poses(u);
        let each = supports.bodies().iter().zip(&poses).zip(curvatures);
        let own: Vec<[f64; 3]> = each
            .map(|((body, pose), curvature)| {
                let [p, q, turn] = body.nodes.motion(pose, body.nodes.force(pose, du));
                let spring = body.mount.spring;
                [spring * p, spring * q, curvature * turn]
            })
            .collect();
        supports.restrict_with(&poses, out, |body, force| {
            std::array::from_fn(|at| force[at] + own[body][at])
        });
    }

    /// What [`Operator::tangent_at`] wants to be kept of `u`: nothing at rest, where elements are alike, and for laws that are quick to
    /// evaluate without a memory.
    pub fn linearise<T: MaterialPrecision>(&self, u: &[T], moduli: &mut Vec<T>) {
        if self.is_uniform_at_rest() && u.iter().all(|u| u.to_f64() == 0.0) {
            moduli.clear();
        } else {
            T::passes(self.material).store(self.activity, u, moduli);
        }
        moduli.extend(self.curvatures(u).into_iter().map(T::from_f64));
    }

    /// The tangent at a `u` that was linearised, times `du`, at interior nodes, into `out`.
    pub fn tangent_at<T: MaterialPrecision>(&self, u: &[T], moduli: &[T], du: &[T], out: &mut [T]) {
        let bodies = self
            .activity
            .grid()
            .supports()
            .map_or(0, |supports| supports.bodies().len());
        let (moduli, curvatures) = moduli.split_at(moduli.len() - bodies);
        let law = T::passes(self.material);
        if self.material.stores() && moduli.is_empty() {
            without_law(self.activity).tangent_at_rest([u, du], &law.at_rest(), out);
        } else {
            law.image(self.activity, [u, du], moduli, out);
        }
        let curvatures: Vec<f64> = curvatures.iter().map(|curvature| curvature.to_f64()).collect();
        self.add_bodies(u, du, &curvatures, out);
    }

    /// The smallest margins over the quadrature points.
    pub fn margins<T: MaterialPrecision>(&self, u: &[T]) -> Margins<f64> {
        T::passes(self.material).least(self.activity, u)
    }
}

/// c⁻¹ along xx, xy and yy, and j², at all quadrature points, in the lines that `memory::line` says.
#[must_use]
pub fn metrics(activity: &Activity, u: &[f64]) -> Vec<f64> {
    let mut values = Vec::new();
    write_metrics(activity, u, &mut values);
    values
}

/// The same into room that may be there: of metrics of the same grid, whose padding is left as it is.
pub fn write_metrics(activity: &Activity, u: &[f64], values: &mut Vec<f64>) {
    let layout = activity.grid().layout();
    let points = (layout.degree() + 1).pow(2);
    values.resize(layout.rows() * points * memory::NUMBERS * layout.part(), 0.0);
    without_law(activity).metrics(u, values);
}
