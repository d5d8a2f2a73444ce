//! Passes of a material over all elements: the kernels, and their selection.
//!
//! Neighbouring elements of a row are computed together, one per lane of a register. Their forces on nodes are first
//! written to separate lines, one per node of the element, and summed when the row is finished: no element waits for
//! its neighbour.

mod gather;
mod point;
mod survey;

use std::marker::PhantomData;

use pulp::{Simd, WithSimd};

use deaflow_field::Order;

use crate::activity::{Activity, View};
use crate::element::{Bilinear, Biquadratic, Element};
use crate::energy::{MODULI, Margins, MaterialPoint, NeoHookean};
use crate::kinematics::Tensor;
use crate::lanes::{Value, WIDEST, Wide};
use crate::layout::NodeLayout;
use crate::memory::{self, MODULI_WITH_MEMORY};
use crate::precision::Precision;
use crate::registers::{self, dispatch, dispatch_widest};
pub(crate) use gather::{add_rest, scale_gradients, scale_stresses, stress_at_rest};
use gather::{gather, mapped_forces, scatter, sides, unmapped, write_mapped_gradients};
use point::{
    MemoryBetween, MemoryStress, Point, RelaxedTangentDerivative, StressAt, StressAtRest, StressBetween, TangentAt,
    TangentAtRest, TangentFrom, TangentWithMemory,
};
pub use survey::MaterialAtRest;
use survey::{EvaluateAtRest, Metrics, Store, Survey, moduli_offset};

/// A material without thickness and voltage: its tangent is the Laplacian.
const WITHOUT_THICKNESS: NeoHookean = NeoHookean::without_thickness();

/// A material and the elements it is evaluated on.
#[derive(Clone, Copy)]
pub struct Kernels<'a, L> {
    material: &'a L,
    activity: &'a Activity,
}

/// Returns the kernels of a material without thickness and voltage, for passes that do not depend on the material.
pub(super) fn without_material(activity: &Activity) -> Kernels<'_, NeoHookean> {
    Kernels::new(&WITHOUT_THICKNESS, activity)
}

impl Kernels<'_, NeoHookean> {
    /// Computes the forces of the stresses at rest.
    pub(super) fn forces_at_rest(&self, rest: &[f64], material: &MaterialAtRest, out: &mut [f64]) {
        self.sweep_plain([rest], &[], out, StressAtRest(material.stresses));
    }

    /// Computes the tangent at rest times a vector, for elements that are squares at rest.
    pub(super) fn tangent_at_rest<T: Precision>(&self, step: [&[T]; 2], material: &MaterialAtRest, out: &mut [T]) {
        self.sweep_plain(step, &[], out, TangentAtRest(material.moduli));
    }

    /// Computes the tangent at the first field times the second.
    pub(super) fn tangent<T: Precision>(&self, step: [&[T]; 2], out: &mut [T]) {
        self.sweep(step, &[], out, TangentAt(self.material));
    }

    /// Computes the forces of a [`memory::Memory`].
    pub(super) fn forces_of_memory(&self, u: &[f64], out: &mut [f64]) {
        self.sweep([u], &[], out, MemoryStress);
    }

    /// Computes the mean forces of a [`memory::Memory`] over a step from the first field by the second.
    pub(super) fn forces_of_memory_between(&self, step: [&[f64]; 2], out: &mut [f64]) {
        self.sweep(step, &[], out, MemoryBetween);
    }

    /// Computes the derivative of the tangent of relaxed branches with respect to the first field, along the second and
    /// times the second.
    pub(super) fn relaxed_tangent_derivative(&self, step: [&[f64]; 2], out: &mut [f64]) {
        self.sweep(step, &[], out, RelaxedTangentDerivative);
    }

    /// Computes the metrics of the quadrature points.
    pub(super) fn metrics(&self, u: &[f64], values: &mut [f64]) {
        match self.activity.grid().order() {
            Order::Bilinear => dispatch(Metrics {
                survey: self.survey::<Bilinear, f64, 4>(u),
                values,
            }),
            Order::Biquadratic => dispatch(Metrics {
                survey: self.survey::<Biquadratic, f64, 9>(u),
                values,
            }),
        }
    }
}

impl<'a, L: MaterialPoint> Kernels<'a, L> {
    /// Creates the kernels of a material on some elements.
    pub(crate) fn new(material: &'a L, activity: &'a Activity) -> Self {
        Self { material, activity }
    }

    fn layout(&self) -> NodeLayout {
        self.activity.grid().layout()
    }

    /// Evaluates the material at rest in a precision.
    pub(crate) fn at_rest<T: Precision>(material: &L) -> MaterialAtRest {
        dispatch(EvaluateAtRest::<L, T> {
            material,
            precision: PhantomData,
        })
    }

    /// Computes the forces at a field; returns the smallest [`MaterialPoint::admissible`].
    pub(crate) fn forces(&self, u: &[f64], out: &mut [f64]) -> f64 {
        self.sweep([u], &[], out, StressAt(self.material))
    }

    /// Computes the mean forces of a step from the first field by the second.
    pub(crate) fn forces_between(&self, step: [&[f64]; 2], out: &mut [f64]) {
        self.sweep(step, &[], out, StressBetween(self.material));
    }

    /// Computes the tangent at the first field times the second. All materials that store moduli share the same
    /// kernels, which are compiled once.
    pub(crate) fn tangent_product<T: Precision>(&self, step: [&[T]; 2], moduli: &[T], out: &mut [T]) {
        if self.activity.memory().is_some() {
            without_material(self.activity).sweep(step, moduli, out, TangentWithMemory);
        } else if L::STORES_MODULI {
            without_material(self.activity).sweep(step, moduli, out, TangentFrom);
        } else {
            self.sweep(step, &[], out, TangentAt(self.material));
        }
    }

    /// Writes the moduli that [`Kernels::tangent_product`] reads.
    pub(crate) fn store_moduli<T: Precision>(&self, u: &[T], moduli: &mut Vec<T>) {
        if !L::STORES_MODULI && self.activity.memory().is_none() {
            return moduli.clear();
        }
        match self.activity.grid().order() {
            Order::Bilinear => self.store_moduli_of::<Bilinear, T, 4>(u, moduli),
            Order::Biquadratic => self.store_moduli_of::<Biquadratic, T, 9>(u, moduli),
        }
    }

    fn store_moduli_of<E: Element<N>, T: Precision, const N: usize>(&self, u: &[T], moduli: &mut Vec<T>) {
        let layout = self.layout();
        let per_point = match self.activity.memory() {
            None => MODULI,
            Some(_) => MODULI_WITH_MEMORY,
        };
        moduli.resize(layout.element_rows() * layout.part() * N * per_point, T::default());
        let survey = self.survey::<E, T, N>(u);
        self.survey_with(Store { survey, moduli });
    }

    /// Returns the smallest margins over the quadrature points.
    pub(crate) fn smallest_margins<T: Precision>(&self, u: &[T]) -> Margins<f64> {
        match self.activity.grid().order() {
            Order::Bilinear => self.survey_with(self.survey::<Bilinear, T, 4>(u)),
            Order::Biquadratic => self.survey_with(self.survey::<Biquadratic, T, 9>(u)),
        }
    }

    /// Runs a pass with the registers of [`Kernels::sweep_elements`]: the order of stored moduli depends on them.
    fn survey_with<W: WithSimd>(&self, survey: W) -> W::Output {
        match self.activity.grid().is_plain() {
            true => dispatch_widest(survey),
            false => dispatch(survey),
        }
    }

    fn survey<'u, E: Element<N>, T: Precision, const N: usize>(&self, u: &'u [T]) -> Survey<'u, E, L, T, N>
    where
        'a: 'u,
    {
        Survey {
            layout: self.layout(),
            material: self.material,
            activity: self.activity.view(),
            rest: self.activity.grid().rest(),
            u,
            element: PhantomData,
        }
    }

    fn sweep<T: Precision, P: Point<M>, const M: usize>(
        &self,
        inputs: [&[T]; M],
        moduli: &[T],
        out: &mut [T],
        point: P,
    ) -> f64 {
        match self.activity.grid().order() {
            Order::Bilinear => self.sweep_shape::<Bilinear, T, P, 4, M>(inputs, moduli, out, point),
            Order::Biquadratic => self.sweep_shape::<Biquadratic, T, P, 9, M>(inputs, moduli, out, point),
        }
    }

    /// Runs a pass over squares of side 1 that rest at f = I.
    fn sweep_plain<T: Precision, P: Point<M>, const M: usize>(
        &self,
        inputs: [&[T]; M],
        moduli: &[T],
        out: &mut [T],
        point: P,
    ) -> f64 {
        match self.activity.grid().order() {
            Order::Bilinear => self.sweep_squares::<Bilinear, T, P, 4, M>(inputs, moduli, out, point),
            Order::Biquadratic => self.sweep_squares::<Biquadratic, T, P, 9, M>(inputs, moduli, out, point),
        }
    }

    fn sweep_squares<E: Element<N>, T: Precision, P: Point<M>, const N: usize, const M: usize>(
        &self,
        inputs: [&[T]; M],
        moduli: &[T],
        out: &mut [T],
        point: P,
    ) -> f64 {
        match registers::are_scalar() {
            false => self.sweep_elements::<E, T, P, N, M, PLAIN>(inputs, moduli, out, point),
            true => self.sweep_elements::<E, T, P, N, M, VARIED>(inputs, moduli, out, point),
        }
    }

    /// Runs a pass by the kernel of the shape of elements: the inner loops have no branch on the shape. Machines
    /// without vector registers use the kernel of any shape, to compile less code for them.
    fn sweep_shape<E: Element<N>, T: Precision, P: Point<M>, const N: usize, const M: usize>(
        &self,
        inputs: [&[T]; M],
        moduli: &[T],
        out: &mut [T],
        point: P,
    ) -> f64 {
        let grid = self.activity.grid();
        if grid.is_plain() {
            self.sweep_squares::<E, T, P, N, M>(inputs, moduli, out, point)
        } else if grid.is_uniform() && !registers::are_scalar() {
            self.sweep_elements::<E, T, P, N, M, UNIFORM>(inputs, moduli, out, point)
        } else {
            self.sweep_elements::<E, T, P, N, M, VARIED>(inputs, moduli, out, point)
        }
    }

    fn sweep_elements<E: Element<N>, T: Precision, P: Point<M>, const N: usize, const M: usize, const SHAPE: u8>(
        &self,
        inputs: [&[T]; M],
        moduli: &[T],
        out: &mut [T],
        point: P,
    ) -> f64 {
        let layout = self.layout();
        let rest = self.activity.grid().rest();
        let sweep = Sweep::<E, T, P, N, M, SHAPE> {
            layout,
            activity: self.activity.view(),
            rest,
            stress_at_rest: match P::IS_STRESS || self.activity.grid().boundary().is_some() {
                true => stress_at_rest(|gradient| self.material.stress(gradient, 0.0), rest),
                false => [0.0; 2],
            },
            inputs,
            moduli,
            lines: vec![T::default(); 2 * N * (WIDEST + layout.part())],
            out,
            point,
            element: PhantomData,
        };
        let smallest = if const { SHAPE == VARIED } {
            dispatch(sweep)
        } else if const { SHAPE == PLAIN && P::WIDEST } {
            registers::dispatch_widest_vector(sweep)
        } else {
            registers::dispatch_vector(sweep)
        };
        layout.clear_frame(out);
        smallest
    }
}

/// Shapes of elements: squares of side 1 that rest at f = I; rectangles with equal sides; any rectangles.
const PLAIN: u8 = 0;
const UNIFORM: u8 = 1;
const VARIED: u8 = 2;

/// One pass over the elements that turns nodal fields into nodal forces.
struct Sweep<'a, E, T, P, const N: usize, const M: usize, const SHAPE: u8> {
    layout: NodeLayout,
    activity: View<'a, T>,
    /// f at rest.
    rest: [f64; 2],
    /// Stress of the bare membrane at rest, along x and y. It is uniform and gives no forces; without subtracting it,
    /// small loads are lost in its rounding. On sides that are not held, the padding of rows would have forces with it.
    /// Mean stresses of steps keep it where all sides are held.
    stress_at_rest: [f64; 2],
    inputs: [&'a [T]; M],
    /// Moduli of the points as written by [`Store`], if used.
    moduli: &'a [T],
    /// A line for each component and node of the element: a margin of zeros, then one number per element of the row.
    lines: Vec<T>,
    out: &'a mut [T],
    point: P,
    element: PhantomData<E>,
}

impl<E: Element<N>, T: Precision, P: Point<M>, const N: usize, const M: usize, const SHAPE: u8> WithSimd
    for Sweep<'_, E, T, P, N, M, SHAPE>
{
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> f64 {
        let mut smallest = Wide::<S, T>::splat(simd, f64::INFINITY);
        // Used if all elements have equal sides.
        let [width, height] = match self.activity.sides {
            Some([widths, heights]) => [widths[0].to_f64(), heights[0].to_f64()],
            None => [1.0; 2],
        };
        let factors = [width.recip(), height.recip()];
        let mut gradients = [[[Wide::splat(simd, 0.0); 2]; 2]; N];
        let mut changes = gradients;
        let rows = if SHAPE == VARIED {
            self.layout.element_rows()
        } else {
            self.layout.rows()
        };
        for row in 0..rows {
            let is_mapped = SHAPE == VARIED && row >= self.layout.rows();
            for first in (0..self.layout.columns()).step_by(T::lanes::<S>()) {
                let zero = Wide::splat(simd, 0.0);
                let sides = match self.activity.sides {
                    Some(all) if SHAPE == VARIED && !is_mapped => sides(simd, all, first, row),
                    _ => [Wide::splat(simd, 1.0); 2],
                };
                let unmapped = match SHAPE == VARIED && !is_mapped {
                    true => unmapped(simd, self.layout, self.activity.mapped, [first, row]),
                    false => Wide::splat(simd, 1.0),
                };
                // Not a loop: it would not be unrolled, and gradients in memory would cost a third of a tangent
                // product.
                self.gradients(
                    simd,
                    (first, row),
                    0,
                    factors,
                    self.rest,
                    (sides, unmapped),
                    &mut gradients,
                );
                if M > 1 {
                    self.gradients(
                        simd,
                        (first, row),
                        1,
                        factors,
                        [1.0; 2],
                        (sides, unmapped),
                        &mut changes,
                    );
                }
                if SHAPE == VARIED {
                    add_rest(&mut gradients, self.rest);
                }
                // Each stress overwrites its gradient.
                for q in 0..N {
                    let mut at_point = [gradients[q]; M];
                    if let Some(change) = at_point.get_mut(1) {
                        *change = changes[q];
                    }
                    if P::IS_STRESS {
                        smallest = smallest.min(self.point.admissible(at_point[0]));
                    }
                    let mut moduli = [zero; MODULI_WITH_MEMORY];
                    if P::STORED_MODULI > 0 {
                        let lanes = T::lanes::<S>();
                        let start = moduli_offset(self.layout, [first, row], lanes, [N, q], P::STORED_MODULI);
                        for (at, value) in moduli.iter_mut().take(P::STORED_MODULI).enumerate() {
                            *value = Wide::load(simd, &self.moduli[start + at * lanes..]);
                        }
                    }
                    if P::READS_MEMORY
                        && let Some((numbers, _)) = self.activity.memory
                    {
                        for (at, value) in moduli.iter_mut().take(memory::NUMBERS).enumerate() {
                            *value = Wide::load(simd, &numbers[memory::line(self.layout, N, row, q, at) + first..]);
                        }
                    }
                    let active = self.activity.at(simd, [first, row], q);
                    let mut stress = self.point.stress(at_point, active, moduli);
                    if SHAPE != PLAIN && P::FROM_REST {
                        let [along, across] = self.stress_at_rest;
                        stress[0][0] = stress[0][0] + zero.constant(-along);
                        stress[1][1] = stress[1][1] + zero.constant(-across);
                    }
                    gradients[q] = stress;
                }
                if is_mapped {
                    if let Some(mapped) = self.activity.mapped {
                        let forces = mapped_forces(simd, self.layout, mapped, [first, row], &gradients);
                        scatter(self.layout, mapped, [first, row], &forces, self.out);
                    }
                    continue;
                }
                let forces = if SHAPE == UNIFORM {
                    E::forces_on(&gradients, [height, width])
                } else {
                    if SHAPE == VARIED {
                        scale_stresses(&mut gradients, sides.map(|side| side * unmapped));
                    }
                    E::forces(&gradients)
                };
                self.write(&forces, first);
            }
            if !is_mapped {
                self.collect(simd, row);
            }
        }
        smallest.smallest()
    }
}

impl<E: Element<N>, T: Precision, P, const N: usize, const M: usize, const SHAPE: u8> Sweep<'_, E, T, P, N, M, SHAPE> {
    /// Writes f − I at the points of some elements, for a field that is f = `rest` at rest; for [`VARIED`] elements
    /// without the offset of `rest`.
    #[inline(always)]
    #[expect(
        clippy::too_many_arguments,
        reason = "each differs between the two fields, or is computed once for both"
    )]
    fn gradients<S: Simd>(
        &self,
        simd: S,
        (first, row): (usize, usize),
        field: usize,
        factors: [f64; 2],
        rest: [f64; 2],
        (sides, unmapped): ([Wide<S, T>; 2], Wide<S, T>),
        gradients: &mut [Tensor<Wide<S, T>>; N],
    ) {
        if SHAPE == VARIED && row >= self.layout.rows() {
            if let Some(mapped) = self.activity.mapped {
                write_mapped_gradients(simd, self.layout, mapped, self.inputs[field], [first, row], gradients);
            }
            return;
        }
        let nodal = gather::<E, S, T, N>(simd, self.layout, self.inputs[field], first, row);
        match SHAPE {
            PLAIN => E::write_gradients(&nodal, gradients),
            UNIFORM => E::write_gradients_on(&nodal, factors, [rest[0] - 1.0, rest[1] - 1.0], gradients),
            _ => {
                E::write_gradients(&nodal, gradients);
                scale_gradients(gradients, sides.map(|side| side.recip() * unmapped));
            }
        }
    }

    /// Returns the start of the line of a node of the element.
    #[inline(always)]
    fn line(&self, c: usize, node: usize) -> usize {
        (c * N + node) * (WIDEST + self.layout.part()) + WIDEST
    }

    #[inline(always)]
    fn write<S: Simd>(&mut self, forces: &[[Wide<S, T>; N]; 2], first: usize) {
        for (c, component) in forces.iter().enumerate() {
            for (node, force) in component.iter().enumerate() {
                let at = self.line(c, node) + first;
                force.store(&mut self.lines[at..]);
            }
        }
    }

    /// Adds the lines of a finished row of elements to the adjacent rows of nodes.
    #[inline(always)]
    fn collect<S: Simd>(&mut self, simd: S, row: usize) {
        let (degree, part) = (E::DEGREE, self.layout.part());
        // A single loop over both indices: nested loops take longer to compile.
        for component in 0..2 * (degree + 1) {
            let (c, rise) = (component / (degree + 1), component % (degree + 1));
            for inner in 0..degree {
                let own = self.line(c, rise * (degree + 1) + inner);
                let left = self.line(c, rise * (degree + 1) + degree) - 1;
                let start = self.layout.index_in(c, 0, inner, row * degree + rise);
                let target = &mut self.out[start..start + part];
                for at in (0..part).step_by(T::lanes::<S>()) {
                    let mut sum = Wide::load(simd, &self.lines[own + at..]);
                    if inner == 0 {
                        sum = sum + Wide::load(simd, &self.lines[left + at..]);
                    }
                    if rise == 0 && row > 0 {
                        sum = sum + Wide::load(simd, &target[at..]);
                    }
                    sum.store(&mut target[at..]);
                }
            }
        }
    }
}
