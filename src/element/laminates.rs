//! The passes over elements that electrodes cover in part: their laminates, less the energy that is linear in the
//! covered share, which the kernels compute. There are few such elements.

use deaflow_base::is_interrupted;
use deaflow_field::Order;
use deaflow_pattern::Part;
use deaflow_scene::Scene;

use super::activity::Activity;
use super::coverage::{Covered, CutElement, Laminate};
use super::element::{Bilinear, Biquadratic, Element};
use super::energy::Margins;
use super::error::SetupError;
use super::grid::Grid;
use super::kinematics::{Tensor, add_scaled};
use super::laminate::{LAMINATE_MODULI, excess_tangent};
use super::lanes::Real;
use super::material::Material;

/// Checks that a scene has no effects that cannot be simulated where electrodes cover parts of cells.
///
/// # Errors
/// If it has one.
pub fn check_covered_cells(scene: &Scene) -> Result<(), SetupError> {
    let effects = &scene.effects;
    let excluded = [
        (effects.fringe_field.is_some(), "`fringe_field`"),
        (effects.wrinkling.is_some(), "`wrinkling`"),
        (effects.viscoelasticity.is_some(), "`viscoelasticity`"),
        (effects.inertia.is_some(), "`inertia`"),
        (effects.electrode_resistance.is_some(), "`electrode_resistance`"),
        (scene.drive.charge.is_some(), "a prescribed charge"),
    ];
    match excluded.into_iter().find(|(is_on, _)| *is_on) {
        Some((_, with)) => Err(SetupError::Coverage { with }),
        None => Ok(()),
    }
}

/// The laminates of a material.
pub struct Laminates<'a, L> {
    grid: &'a Grid,
    covered: &'a Covered,
    material: &'a L,
}

impl<'a, L: Material> Laminates<'a, L> {
    /// Returns the laminates of an activity; `None` if electrodes cover whole cells.
    #[must_use]
    pub fn of(activity: &'a Activity, material: &'a L) -> Option<Self> {
        Some(Self {
            grid: activity.grid(),
            covered: activity.covered()?,
            material,
        })
    }

    /// Returns the number of stored moduli.
    #[must_use]
    pub fn count_moduli(&self) -> usize {
        let points = (self.grid.layout().degree() + 1).pow(2);
        self.covered.elements().len() * points * LAMINATE_MODULI
    }

    /// Adds the forces of the laminates at `u`, less those that are linear in the share, at interior nodes. Returns the
    /// smallest [`Material::admissible`] of their layers, or 0 if one has no equilibrium.
    pub fn add_forces(&self, u: &[f64], out: &mut [f64]) -> f64 {
        match self.grid.order() {
            Order::Bilinear => self.add_forces_of::<Bilinear, 4>(u, out),
            Order::Biquadratic => self.add_forces_of::<Biquadratic, 9>(u, out),
        }
    }

    fn add_forces_of<E: Element<N>, const N: usize>(&self, u: &[f64], out: &mut [f64]) -> f64 {
        let mut smallest = f64::INFINITY;
        for CutElement { at, laminate } in self.covered.elements() {
            let nodes = self.grid.nodes_of::<N>(*at);
            let gradients = self.grid.gradients::<E, N>(*at, &nodal(&nodes, u));
            let stresses = gradients.map(|gradient| match laminate.layers(self.material, gradient) {
                Some(layers) => {
                    let admissible = [layers.covered, layers.bare].map(|layer| self.material.admissible(layer));
                    smallest = admissible.into_iter().fold(smallest, f64::min);
                    laminate.excess_stress(self.material, gradient, &layers)
                }
                None => {
                    smallest = smallest.min(0.0);
                    [[0.0; 2]; 2]
                }
            });
            add_nodal(&nodes, &self.grid.forces::<E, N>(*at, stresses), out);
        }
        self.grid.layout().clear_frame(out);
        smallest
    }

    /// Appends the moduli for [`Laminates::add_product`] at `u`. Where a laminate has no equilibrium, they are those of
    /// the energy that is linear in the share, and [`Laminates::smallest_margins`] is negative.
    pub fn store_moduli<T: Real>(&self, u: &[T], moduli: &mut Vec<T>) {
        match self.grid.order() {
            Order::Bilinear => self.store_moduli_of::<Bilinear, T, 4>(u, moduli),
            Order::Biquadratic => self.store_moduli_of::<Biquadratic, T, 9>(u, moduli),
        }
    }

    fn store_moduli_of<E: Element<N>, T: Real, const N: usize>(&self, u: &[T], moduli: &mut Vec<T>) {
        for cut in self.covered.elements() {
            for gradient in self.gradients::<E, T, N>(cut.at, u) {
                let excess = cut.laminate.excess_moduli(self.material, gradient).unwrap_or_default();
                moduli.extend(excess.map(T::from_f64));
            }
        }
    }

    /// Adds the tangent of the laminates times `du`, less that of an energy that is linear in the share, at interior
    /// nodes.
    pub fn add_product<T: Real>(&self, du: &[T], moduli: &[T], out: &mut [T]) {
        match self.grid.order() {
            Order::Bilinear => self.add_product_of::<Bilinear, T, 4>(du, moduli, out),
            Order::Biquadratic => self.add_product_of::<Biquadratic, T, 9>(du, moduli, out),
        }
    }

    fn add_product_of<E: Element<N>, T: Real, const N: usize>(&self, du: &[T], moduli: &[T], out: &mut [T]) {
        let all = self.covered.elements().iter();
        for (CutElement { at, .. }, moduli) in all.zip(moduli.chunks_exact(N * LAMINATE_MODULI)) {
            let nodes = self.grid.nodes_of::<N>(*at);
            let changes = self.grid.changes::<E, N>(*at, &nodal(&nodes, du));
            let stresses = std::array::from_fn(|q| {
                let moduli = std::array::from_fn(|at| moduli[q * LAMINATE_MODULI + at].to_f64());
                excess_tangent(&moduli, changes[q])
            });
            add_nodal(&nodes, &self.grid.forces::<E, N>(*at, stresses), out);
        }
        self.grid.layout().clear_frame(out);
    }

    /// Returns the smallest of some margins and those of the laminates.
    pub fn smallest_margins<T: Real>(&self, u: &[T], margins: Margins<f64>) -> Margins<f64> {
        match self.grid.order() {
            Order::Bilinear => self.smallest_margins_of::<Bilinear, T, 4>(u, margins),
            Order::Biquadratic => self.smallest_margins_of::<Biquadratic, T, 9>(u, margins),
        }
    }

    fn smallest_margins_of<E: Element<N>, T: Real, const N: usize>(
        &self,
        u: &[T],
        margins: Margins<f64>,
    ) -> Margins<f64> {
        let each = self.covered.elements().iter().flat_map(|cut| {
            let gradients = self.gradients::<E, T, N>(cut.at, u);
            gradients.map(|gradient| cut.laminate.margins(self.material, gradient))
        });
        each.fold(margins, |least, own| Margins {
            ellipticity: least.ellipticity.min(own.ellipticity),
            convexity: least.convexity.min(own.convexity),
            tension: least.tension.min(own.tension),
        })
    }

    fn gradients<E: Element<N>, T: Real, const N: usize>(&self, at: [usize; 2], u: &[T]) -> [Tensor<f64>; N] {
        self.grid.gradients::<E, N>(at, &nodal(&self.grid.nodes_of::<N>(at), u))
    }

    /// Computes −ψ · ∂R/∂S for the covered share of each cell, `[y][x]`. A change of a share also turns the normals of
    /// the cells around it. Of a cell that is covered or bare it is the slope towards a partial cover. `None` if a
    /// laminate has no equilibrium, or after an interrupt.
    #[must_use]
    pub fn gradient(&self, u: &[f64], adjoint: &[f64]) -> Option<Vec<f64>> {
        match self.grid.order() {
            Order::Bilinear => self.gradient_of::<Bilinear, 4>(u, adjoint),
            Order::Biquadratic => self.gradient_of::<Biquadratic, 9>(u, adjoint),
        }
    }

    fn gradient_of<E: Element<N>, const N: usize>(&self, u: &[f64], adjoint: &[f64]) -> Option<Vec<f64>> {
        let grid = self.grid;
        let columns = grid.raster().columns();
        let mut gradient = vec![0.0; grid.raster().cells()];
        for at in grid
            .each_element()
            .filter(|at| grid.content(*at).part == Part::Membrane)
        {
            // On large meshes this takes longer than the solution.
            if is_interrupted() {
                return None;
            }
            let nodes = grid.nodes_of::<N>(at);
            let (gradients, adjoint) = (grid.gradients::<E, N>(at, &nodal(&nodes, u)), nodal(&nodes, adjoint));
            let work = |stresses: [Tensor<f64>; N]| -> f64 {
                let forces = grid.forces::<E, N>(at, stresses);
                let pairs = forces.as_flattened().iter().zip(adjoint.as_flattened());
                pairs.map(|(force, adjoint)| force * adjoint).sum()
            };
            let [x, y] = grid.cell_of(at);
            let laminate = self.covered.laminate_of_cell(grid, [x, y]);
            let mut slopes = [[[[0.0; 2]; 2]; N]; 2];
            for (q, point) in gradients.into_iter().enumerate() {
                [slopes[0][q], slopes[1][q]] = match &laminate {
                    Some(laminate) => self.slopes(laminate, point)?,
                    None => [self.linear_slope(self.covered.load_of_cell(x, y), point), [[0.0; 2]; 2]],
                };
            }
            let [of_share, of_angle] = slopes;
            gradient[y * columns + x] -= work(of_share);
            if laminate.is_some_and(|laminate| laminate.is_cut()) {
                let turn = work(of_angle);
                for ([x, y], slope) in self.covered.slopes_of_angle(grid, [x, y]) {
                    gradient[y * columns + x] -= turn * slope;
                }
            }
        }
        Some(gradient)
    }

    /// Returns the derivatives of the stress with respect to the share and the angle of the normal.
    fn slopes(&self, laminate: &Laminate, point: Tensor<f64>) -> Option<[Tensor<f64>; 2]> {
        let layers = laminate.layers(self.material, point)?;
        Some([
            laminate.slope_of_share(self.material, &layers)?,
            laminate.slope_of_angle(self.material, &layers)?,
        ])
    }

    /// Returns the derivative of a stress that is linear in the share.
    fn linear_slope(&self, load: f64, point: Tensor<f64>) -> Tensor<f64> {
        add_scaled(
            self.material.stress(point, load),
            -1.0,
            self.material.stress(point, 0.0),
        )
    }
}

/// Returns the values of a vector at the nodes of an element.
fn nodal<T: Real, const N: usize>(nodes: &[usize; N], vector: &[T]) -> [[f64; N]; 2] {
    let plane = vector.len() / 2;
    [0, 1].map(|c| nodes.map(|at| vector[at + c * plane].to_f64()))
}

/// Adds forces on the nodes of an element.
fn add_nodal<T: Real, const N: usize>(nodes: &[usize; N], forces: &[[f64; N]; 2], out: &mut [T]) {
    let plane = out.len() / 2;
    for (c, component) in forces.iter().enumerate() {
        for (node, force) in nodes.iter().zip(component) {
            let at = node + c * plane;
            out[at] = T::from_f64(out[at].to_f64() + force);
        }
    }
}
