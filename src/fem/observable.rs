//! The state of each cell: stretches, fields and stresses.
//!
//! They are those of the mean deformation gradient of a cell. Stresses at points near a corner of an electrode increase
//! without limit under mesh refinement; those of the mean do not.

use deaflow_field::{Mesh, Order};
use deaflow_pattern::{Part, Pattern};
use deaflow_scene::Scene;

use super::coverage::Laminate;
use super::effects::{Model, WithMaterial};
use super::element::{Bilinear, Biquadratic, Element};
use super::error::SetupError;
use super::grid::Grid;
use super::kinematics::{Tensor, deformation, determinant, squared_stretches};
use super::material::Material;
use super::operator::{Activity, load_of};

/// The state of tension of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tension {
    /// No principal stress is negative.
    Taut,
    /// One is: a real membrane wrinkles. If wrinkling is simulated, the stress across the wrinkles is a small
    /// regularisation.
    Wrinkled,
    /// Both are: a real membrane is slack.
    Slack,
}

impl Tension {
    /// Returns the number used in files: 0 taut, 1 wrinkled, 2 slack.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::Taut => 0,
            Self::Wrinkled => 1,
            Self::Slack => 2,
        }
    }
}

/// The state of one cell. Stresses are those of elastomer and electrodes together, relative to the thickness of the
/// elastomer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellState {
    /// In-plane stretches from the undeformed state, larger first.
    pub stretches: [f64; 2],
    /// True electric field V/h in V/m; zero without electrode or voltage.
    pub electric_field: f64,
    /// First Piola–Kirchhoff stress in Pa, `[component][material direction]`.
    pub piola: Tensor<f64>,
    /// Principal Cauchy stresses in the plane in Pa, larger first; at a negative one, a real membrane wrinkles.
    pub stresses: [f64; 2],
    /// State of tension.
    pub tension: Tension,
}

/// Returns the state of each cell, `[y][x]`, from nodal displacements on a requested mesh, in units of
/// [`Grid::unit_mm`].
///
/// # Errors
/// If the effects of the scene cannot be simulated.
pub fn cell_states(scene: &Scene, mesh: Mesh, pattern: &Pattern, u: &[f64]) -> Result<Vec<CellState>, SetupError> {
    let model = Model::new(scene)?;
    Ok(states(scene, &model, &model.grid(mesh)?, pattern, u))
}

/// Like [`cell_states`], for a given model and grid.
pub(super) fn states(scene: &Scene, model: &Model, grid: &Grid, pattern: &Pattern, u: &[f64]) -> Vec<CellState> {
    let activity = model.activity(grid, pattern);
    model.with(States {
        scene,
        pattern,
        loads: model.loads(),
        activity: &activity,
        voltage: scene.voltage_v(),
        share: 1.0,
        u,
    })
}

/// The states of cells at nodal displacements.
pub(super) struct States<'a> {
    pub scene: &'a Scene,
    pub pattern: &'a Pattern,
    pub loads: &'a [f64],
    pub activity: &'a Activity,
    /// Voltage of the full electrical load in V.
    pub voltage: f64,
    /// Share of the full electrical load, which is proportional to V².
    pub share: f64,
    pub u: &'a [f64],
}

impl WithMaterial for States<'_> {
    type Output = Vec<CellState>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Vec<CellState> {
        let (material, grid) = (material(self.share), self.activity.grid());
        let (raster, integrals) = (grid.raster(), [0, 1].map(|axis| along_side(grid, axis)));
        // Parsed once, because scene values are stored as text.
        let scale = Scale {
            prestretch: self.scene.mean_prestretch(),
            modulus: self.scene.shear_modulus_pa(),
            voltage: self.share.sqrt() * self.voltage,
            thickness: 1e-3 * self.scene.thickness_mm(),
        };
        let cells = match grid.order() {
            Order::Bilinear => mapped_cells::<Bilinear, 4>(self.activity, self.u),
            Order::Biquadratic => mapped_cells::<Biquadratic, 9>(self.activity, self.u),
        };
        let places = (0..raster.cells()).map(|i| (i % raster.columns(), i / raster.columns()));
        let coverage = self.pattern.coverage();
        places
            .map(|(x, y)| {
                let mut cell = match cells.get(y * raster.columns() + x) {
                    Some(sums) => sums.mean(grid.rest()),
                    None => Cell {
                        f: mean_deformation(grid, &integrals, self.u, x, y),
                        share: self.share(x, y),
                        load: match grid.is_membrane(x, y) {
                            true => load_of(self.pattern.group(x, y), self.loads),
                            false => 0.0,
                        },
                    },
                };
                if let Some(coverage) = coverage.filter(|_| cell.share > 0.0) {
                    cell.load = load_of(coverage.group(x, y), self.loads);
                }
                let cut = self
                    .activity
                    .covered()
                    .and_then(|covered| covered.laminate_of_cut_cell(grid, [x, y]));
                self.state(&material, &scale, cell, cut)
            })
            .collect()
    }
}

/// Compression below this, in units of the shear modulus, is rounding.
pub(super) const ROUNDING: f64 = 1e-9;

/// Constants of all cells.
struct Scale {
    prestretch: f64,
    /// Shear modulus in Pa.
    modulus: f64,
    /// Voltage in V and thickness in m.
    voltage: f64,
    thickness: f64,
}

impl States<'_> {
    /// Returns the state of a cell, and of the laminate of one that is cut: its mean stress, and the field in its
    /// covered layer.
    fn state<L: Material>(
        &self,
        material: &L,
        scale: &Scale,
        Cell { f, share, load }: Cell,
        cut: Option<Laminate>,
    ) -> CellState {
        let &Scale {
            prestretch,
            modulus,
            voltage,
            thickness,
        } = scale;
        let gradient = [[f[0][0] - 1.0, f[0][1]], [f[1][0], f[1][1] - 1.0]];
        let layers = cut.and_then(|cut| cut.layers(material, gradient).map(|layers| (cut, layers)));
        let (stress, covered) = match layers {
            Some((cut, layers)) => (cut.stress(material, &layers), deformation(layers.covered)),
            None => (material.stress(gradient, share), f),
        };
        let rest = material.self_stress(f);
        let unit = modulus * prestretch;
        let piola = std::array::from_fn(|i| std::array::from_fn(|k| unit * (stress[i][k] + rest[i][k])));
        let stresses = principal_stresses(piola, f.map(|row| row.map(|v| prestretch * v)));
        let nominal = voltage * load.sqrt() / thickness;
        CellState {
            stretches: squared_stretches(f).map(|s| prestretch * s.sqrt()),
            electric_field: nominal * prestretch * prestretch * determinant(covered),
            piola,
            stresses,
            tension: match stresses.map(|s| s < -ROUNDING * modulus) {
                [true, _] => Tension::Slack,
                [false, true] => Tension::Wrinkled,
                [false, false] => Tension::Taut,
            },
        }
    }

    /// Returns the mean activity of a cell.
    fn share(&self, x: usize, y: usize) -> f64 {
        let [m, n] = self.activity.grid().per_cell();
        let elements = (0..m * n).map(|i| [x * m + i % m, y * n + i / m]);
        let area: f64 = elements.map(|element| self.activity.area(element)).sum();
        area / (m * n) as f64
    }
}

/// Means over the membrane in a cell.
struct Cell {
    f: Tensor<f64>,
    /// Activity.
    share: f64,
    /// Share of the load of its strongest electrode.
    load: f64,
}

/// Sums over the membrane in a cell.
#[derive(Clone, Copy, Debug, Default)]
struct CellSums {
    area: f64,
    active: f64,
    strongest: f64,
    /// f times area.
    deformation: Tensor<f64>,
}

impl CellSums {
    /// Returns the means; those at rest without any membrane.
    fn mean(&self, [along, across]: [f64; 2]) -> Cell {
        let has_membrane = self.area > 0.0;
        let rest = [[along, 0.0], [0.0, across]];
        Cell {
            f: match has_membrane {
                true => self.deformation.map(|row| row.map(|sum| sum / self.area)),
                false => rest,
            },
            share: if has_membrane { self.active / self.area } else { 0.0 },
            load: self.strongest,
        }
    }
}

/// Returns the sums of cells, `[y][x]`, on a grid that follows borders; none on another.
fn mapped_cells<E: Element<N>, const N: usize>(activity: &Activity, u: &[f64]) -> Vec<CellSums> {
    let (grid, plane) = (activity.grid(), u.len() / 2);
    if grid.follows_borders().is_none() {
        return Vec::new();
    }
    let raster = grid.raster();
    let mut cells = vec![CellSums::default(); raster.cells()];
    for element in grid
        .each_element()
        .filter(|element| grid.content(*element).part == Part::Membrane)
    {
        let [x, y] = grid.cell_of(element);
        let cell = &mut cells[y * raster.columns() + x];
        let nodes = grid.nodes_of::<N>(element);
        let gradients = grid.gradients::<E, N>(element, &[0, 1].map(|c| nodes.map(|at| u[at + c * plane])));
        for (gradient, area) in gradients.into_iter().zip(grid.areas_of(element, E::WEIGHTS)) {
            let f = deformation(gradient);
            cell.area += area;
            for (sum, row) in cell.deformation.iter_mut().zip(f) {
                *sum = [sum[0] + area * row[0], sum[1] + area * row[1]];
            }
        }
        cell.active += activity.area(element);
        cell.strongest = cell.strongest.max(activity.strongest(element[1])[element[0]]);
    }
    cells
}

/// Returns the principal values of σ = P Fᵀ, larger first, for an incompressible membrane.
fn principal_stresses(piola: Tensor<f64>, f: Tensor<f64>) -> [f64; 2] {
    let entry = |i: usize, k: usize| piola[i][0] * f[k][0] + piola[i][1] * f[k][1];
    let (mean, half_gap) = (0.5 * (entry(0, 0) + entry(1, 1)), 0.5 * (entry(0, 0) - entry(1, 1)));
    let radius = half_gap.hypot(0.5 * (entry(0, 1) + entry(1, 0)));
    [mean + radius, mean - radius]
}

/// Returns the nodes along a side of a cell, relative to its corner, with their weights for the integral along the
/// side; axis 1 is y.
fn along_side(grid: &Grid, axis: usize) -> Vec<(usize, f64)> {
    let degree = grid.layout().degree();
    let weights: &[f64] = if degree == 1 {
        &[0.5, 0.5]
    } else {
        &[1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0]
    };
    let elements = 0..grid.per_cell()[axis];
    let nodes = elements.flat_map(|e| {
        let length = grid.sides([e; 2])[axis];
        weights
            .iter()
            .enumerate()
            .map(move |(a, w)| (e * degree + a, w * length))
    });
    nodes.collect()
}

/// Returns the mean of f over a cell: by the divergence theorem that of ∇u is an integral of u along its sides.
fn mean_deformation(grid: &Grid, integrals: &[Vec<(usize, f64)>; 2], u: &[f64], x: usize, y: usize) -> Tensor<f64> {
    let (layout, per_cell) = (grid.layout(), grid.per_cell());
    let [right, up] = per_cell.map(|count| count * layout.degree());
    let area = (per_cell[0] * per_cell[1]) as f64;
    let (left, low) = (x * right, y * up);
    let [first, second] = grid.rest();
    let mut f = [[first, 0.0], [0.0, second]];
    for (c, row) in f.iter_mut().enumerate() {
        let node = |x, y| u[layout.index(c, x, y)];
        let jumps_x = integrals[1]
            .iter()
            .map(|&(at, w)| w * (node(left + right, low + at) - node(left, low + at)));
        let jumps_y = integrals[0]
            .iter()
            .map(|&(at, w)| w * (node(left + at, low + up) - node(left + at, low)));
        row[0] += jumps_x.sum::<f64>() / area;
        row[1] += jumps_y.sum::<f64>() / area;
    }
    f
}
