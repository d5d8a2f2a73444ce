//! Natural frequencies about an equilibrium: K v = ω² M v.
//!
//! The iteration is LOBPCG (Knyazev, SIAM J. Sci. Comput. 23 (2001) 517) with a block of vectors, preconditioned by the
//! inverse Laplacian: Rayleigh and Ritz in the span of the block, its preconditioned residuals and its last steps, with
//! an orthonormal basis. Bars with a mass of their own can be thousands of times as heavy as the membrane; in the
//! metric of such masses the motions of the membrane are lost in rounding, so that the largest values of M v = ω⁻² K v
//! are searched in the metric of K.

use deaflow_linalg::{Eigen, Mat, eigen};

use crate::effects::WithMaterial;
use crate::eigenvalue::{add, dot, precondition};
use crate::error::SetupError;
use crate::gauge::check_resisted;
use crate::grid::Grid;
use crate::mass::Mass;
use crate::material::Material;
use crate::operator::{Activity, Operator};
use crate::out_of_plane::{self, OutOfPlane};
use crate::precondition::Laplacian;
use crate::rigid::Rigid;
use crate::solver::MembraneSolver;
use deaflow_base::Stream;
use deaflow_field::{Field, Outcome};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Largest number of modes per request.
pub const MOST_MODES: usize = 100;
/// Largest number of iterations.
const LIMIT: usize = 300;
/// Relative change of all eigenvalues that counts as zero.
const SETTLED: f64 = 1e-12;
/// Relative difference by which a value may be above the next one, where they are equal but for rounding.
const UNSORTED: f64 = 1e-6;

/// The vibration modes of a pattern about its equilibrium.
#[derive(Clone, Debug, PartialEq)]
pub struct Vibration {
    /// How the search for the equilibrium ended; without an equilibrium there are no modes.
    pub outcome: Outcome,
    /// The equilibrium.
    pub equilibrium: Option<Field>,
    /// Natural frequencies in Hz, lowest first.
    pub frequencies: Vec<f64>,
    /// Their modes, scaled to a largest displacement of 1.
    pub modes: Vec<Field>,
    /// Vibrations out of the plane.
    pub out_of_plane: Transverse,
}

/// The vibrations of a flat equilibrium out of its plane; empty without an equilibrium.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Transverse {
    /// Natural frequencies in Hz, lowest first; 0 for motions in which the flat state is unstable.
    pub frequencies: Vec<f64>,
    /// Displacements out of the plane at the corners of cells, `[y][x]`, scaled to a largest one of 1.
    pub modes: Vec<Vec<f64>>,
    /// Number of motions in which the flat state is unstable: it buckles or wrinkles.
    pub unstable: usize,
}

impl Vibration {
    /// No modes, for this reason.
    fn none(outcome: Outcome) -> Self {
        Self {
            outcome,
            equilibrium: None,
            frequencies: Vec::new(),
            modes: Vec::new(),
            out_of_plane: Transverse::default(),
        }
    }
}

/// The speed in m/s of shear waves that sets the scale of frequencies, c = λp√(μ/ρ).
///
/// # Errors
/// When the density is unknown.
pub fn wave_speed(scene: &Scene) -> Result<f64, SetupError> {
    let density = scene.density().ok_or(SetupError::Density)?;
    Ok(scene.mean_prestretch() * (scene.shear_modulus_pa() / density).sqrt())
}

impl MembraneSolver {
    /// The lowest natural frequencies of a pattern about its equilibrium at the voltage of the scene.
    ///
    /// # Errors
    /// When the density is unknown, the drive is a charge, or no node of the mesh is free to move.
    pub fn vibration(&self, pattern: &Pattern, count: usize, lumped: bool) -> Result<Vibration, SetupError> {
        let speed = wave_speed(&self.scene)?;
        if self.scene.drive.charge.is_some() {
            return Err(SetupError::Charge);
        }
        check_resisted(&self.scene, "natural frequencies")?;
        if !self.grid.moves() {
            return Err(SetupError::NothingMoves);
        }
        let solution = self.solve(pattern);
        if !solution.outcome.is_converged() {
            return Ok(Vibration::none(solution.outcome));
        }
        let found = self.model.with(Lowest {
            solver: self,
            activity: &self.model.activity(&self.grid, pattern),
            u: &solution.displacement,
            mass: &Mass::new(&self.grid, lumped),
            count,
            lumped,
        });
        let (Some(pairs), Some(transverse)) = found else {
            return Ok(Vibration::none(Outcome::IterationLimit));
        };
        let hertz = speed / (1e-3 * self.grid.unit_mm() * std::f64::consts::TAU);
        let frequency = |square: f64| hertz * square.max(0.0).sqrt();
        Ok(Vibration {
            outcome: solution.outcome,
            equilibrium: Some(self.field(&solution)),
            frequencies: pairs.iter().map(|(value, _)| frequency(*value)).collect(),
            modes: pairs
                .iter()
                .map(|(_, vector)| normalised(&self.grid.sample(vector)))
                .collect(),
            out_of_plane: Transverse {
                frequencies: transverse.values.into_iter().map(frequency).collect(),
                modes: transverse
                    .vectors
                    .iter()
                    .map(|vector| normalised_heights(self.grid.sample_heights(vector)))
                    .collect(),
                unstable: transverse.unstable,
            },
        })
    }
}

/// Scales a mode to a largest displacement of 1, with a positive larger component.
fn normalised(mode: &Field) -> Field {
    let [x, y] = mode.most_moved();
    let [along, across] = mode.at_corner(x, y);
    let larger = if along.abs() >= across.abs() { along } else { across };
    let scale = along.hypot(across).copysign(larger);
    match scale == 0.0 {
        true => mode.clone(),
        false => mode.scaled(1.0 / scale),
    }
}

/// Scales heights to a largest one of 1.
fn normalised_heights(mut heights: Vec<f64>) -> Vec<f64> {
    let farther = |best: f64, height: &f64| {
        if height.powi(2) > best.powi(2) { *height } else { best }
    };
    let peak = heights.iter().fold(0.0, farther);
    if peak != 0.0 {
        heights.iter_mut().for_each(|height| *height *= 1.0 / peak);
    }
    heights
}

struct Lowest<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    u: &'a [f64],
    mass: &'a Mass,
    count: usize,
    lumped: bool,
}

impl WithMaterial for Lowest<'_> {
    /// In the plane and out of it; `None` if the iteration breaks down.
    type Output = (Option<Vec<(f64, Vec<f64>)>>, Option<out_of_plane::Lowest>);

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Self::Output {
        let material = material(1.0);
        let operator = Operator::new(&material, self.activity);
        let found = lowest(&operator, &self.solver.laplacian, self.mass, self.u, self.count);
        // With bars far heavier than the membrane its own modes can be below rounding.
        let is_sorted = found.windows(2).all(|pair| pair[0].0 <= pair[1].0 * (1.0 + UNSORTED));
        let is_sound = !found.is_empty() && is_sorted && found.iter().all(|(value, _)| value.is_finite());
        (is_sound.then_some(found), self.transverse(&operator))
    }
}

impl Lowest<'_> {
    fn transverse<L: Material>(&self, operator: &Operator<'_, L>) -> Option<out_of_plane::Lowest> {
        let grid = self.activity.grid();
        let heights = OutOfPlane::new(grid)?;
        let mass = heights.mass(grid, self.lumped)?;
        heights.lowest(grid, &heights.stiffness(operator, self.u), &mass, self.count)
    }
}

/// The eigenvalue problem that is solved: A v = ν B v, for the lowest ν.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pencil {
    /// A = K and B = M, with ν = ω².
    Squares,
    /// A = −M and B = K, with ν = −ω⁻².
    Inverses,
}

impl Pencil {
    /// Returns the one for a grid.
    fn of(grid: &Grid) -> Self {
        let supports = grid.supports();
        let has_mass = |body: &Rigid| body.own_masses() != [0.0; 3];
        match supports.is_some_and(|supports| supports.bodies().iter().any(has_mass)) {
            true => Self::Inverses,
            false => Self::Squares,
        }
    }

    /// Returns ω² of a direction.
    fn square(self, direction: &Direction) -> f64 {
        let ratio = dot(&direction.vector, &direction.stiff) / dot(&direction.vector, &direction.heavy);
        match self {
            Self::Squares => ratio,
            Self::Inverses => -1.0 / ratio,
        }
    }
}

/// A vector and its products with A and B.
#[derive(Clone)]
struct Direction {
    vector: Vec<f64>,
    /// A times the vector.
    stiff: Vec<f64>,
    /// B times the vector.
    heavy: Vec<f64>,
}

impl Direction {
    fn new<L: Material>(
        pencil: Pencil,
        operator: &Operator<'_, L>,
        mass: &Mass,
        u: &[f64],
        mut vector: Vec<f64>,
    ) -> Self {
        // The motion of a body in single precision is not quite rigid, and the error grows if most of a direction is
        // subtracted.
        operator.activity.grid().restrict(u, &mut vector);
        let mut stiff = vec![0.0; vector.len()];
        operator.tangent(u, &vector, &mut stiff);
        let mut heavy = vec![0.0; vector.len()];
        mass.apply(&vector, &mut heavy);
        operator.activity.grid().restrict(u, &mut heavy);
        if pencil == Pencil::Inverses {
            std::mem::swap(&mut stiff, &mut heavy);
            stiff.iter_mut().for_each(|force| *force = -*force);
        }
        Self { vector, stiff, heavy }
    }

    fn zero(len: usize) -> Self {
        Self {
            vector: vec![0.0; len],
            stiff: vec![0.0; len],
            heavy: vec![0.0; len],
        }
    }

    fn add(&mut self, factor: f64, other: &Self) {
        let parts = [
            (&mut self.vector, &other.vector),
            (&mut self.stiff, &other.stiff),
            (&mut self.heavy, &other.heavy),
        ];
        for (own, other) in parts {
            add(own, factor, other);
        }
    }

    /// Makes it orthogonal to unit directions and of unit size in B; `None` if nothing is left of it.
    fn orthonormal<'d>(mut self, others: impl Iterator<Item = &'d Self> + Clone) -> Option<Self> {
        let before = dot(&self.vector, &self.heavy);
        // Twice: the first pass leaves rounding of the size of the subtracted part.
        for _ in 0..2 {
            for other in others.clone() {
                self.add(-dot(&self.vector, &other.heavy), other);
            }
        }
        let size = dot(&self.vector, &self.heavy);
        if size.is_nan() || size <= 1e-18 * before.max(f64::MIN_POSITIVE) {
            return None;
        }
        let factor = 1.0 / size.sqrt();
        for part in [&mut self.vector, &mut self.stiff, &mut self.heavy] {
            part.iter_mut().for_each(|a| *a *= factor);
        }
        Some(self)
    }

    /// A sum of directions.
    fn combined(span: &[&Self], weights: impl Iterator<Item = f64>) -> Self {
        let mut sum = Self::zero(span[0].vector.len());
        weights
            .zip(span)
            .for_each(|(weight, direction)| sum.add(weight, direction));
        sum
    }
}

/// Returns the lowest eigenvalues of K v = ω² M v at `u` with their vectors; fewer if the problem is smaller.
pub(super) fn lowest<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    mass: &Mass,
    u: &[f64],
    count: usize,
) -> Vec<(f64, Vec<f64>)> {
    let grid = operator.activity.grid();
    let poses = grid.poses(u);
    let pencil = Pencil::of(grid);
    let mut scratch = laplacian.scratch();
    let mut block: Vec<Direction> = Vec::new();
    for index in 0..(count + (count / 2).max(4)) {
        let mut stream = Stream::new(0, "natural frequencies", index as u64);
        let load = grid.random_load(&mut stream, u);
        let Some(start) = precondition(laplacian, &load, &poses, &mut scratch) else {
            break;
        };
        block.extend(Direction::new(pencil, operator, mass, u, start).orthonormal(block.iter()));
    }
    let mut steps: Vec<Direction> = Vec::new();
    let mut values = vec![f64::INFINITY; block.len()];
    let mut settled = 0;
    for _ in 0..LIMIT {
        if block.is_empty() || settled >= 2 {
            break;
        }
        let mut corrections: Vec<Direction> = Vec::new();
        for x in &block {
            let value = dot(&x.vector, &x.stiff);
            let residual: Vec<f64> = x.stiff.iter().zip(&x.heavy).map(|(k, m)| k - value * m).collect();
            if let Some(correction) = precondition(laplacian, &residual, &poses, &mut scratch) {
                let others = block.iter().chain(&steps).chain(&corrections);
                corrections.extend(Direction::new(pencil, operator, mass, u, correction).orthonormal(others));
            }
        }
        let span: Vec<&Direction> = block.iter().chain(&steps).chain(&corrections).collect();
        let matrix = Mat::from_fn(span.len(), span.len(), |i, k| {
            0.5 * (dot(&span[i].vector, &span[k].stiff) + dot(&span[k].vector, &span[i].stiff))
        });
        let Some(Eigen { values: found, vectors }) = eigen(&matrix) else {
            break;
        };
        let vectors = &vectors;
        let weights =
            |mode: usize, from: usize| (0..span.len()).map(move |i| if i < from { 0.0 } else { vectors[(i, mode)] });
        let kept = block.len();
        let next: Vec<Direction> = (0..kept)
            .map(|mode| Direction::combined(&span, weights(mode, 0)))
            .collect();
        let moved: Vec<Direction> = (0..kept)
            .map(|mode| Direction::combined(&span, weights(mode, kept)))
            .collect();
        let change = (0..kept.min(count)).map(|mode| ((values[mode] - found[mode]) / found[mode]).abs());
        settled = if change.fold(0.0, f64::max) < SETTLED {
            settled + 1
        } else {
            0
        };
        values = (0..kept).map(|mode| found[mode]).collect();
        block = Vec::new();
        for direction in next {
            block.extend(direction.orthonormal(block.iter()));
        }
        steps = Vec::new();
        for direction in moved {
            steps.extend(direction.orthonormal(block.iter().chain(&steps)));
        }
    }
    let each = block.into_iter().take(count).map(|direction| {
        // The products of sums of sums accumulate rounding of their own.
        let fresh = Direction::new(pencil, operator, mass, u, direction.vector);
        (pencil.square(&fresh), fresh.vector)
    });
    each.collect()
}
