//! A membrane under a pressure that follows its surface, or above a given volume of an incompressible fluid, and under
//! forces out of the plane on bodies.
//!
//! From the flat state the pressure, or the volume, is raised with these forces by steps, which are halved where no
//! stable state is found. At a pressure p the potential E − p Vol is minimised by Newton's method with a line search; at
//! a volume the pressure is the multiplier of the constraint, and each step solves a bordered system. There K + ρ b bᵀ
//! is positive definite also past the largest pressure, where K is not: the solution of the bordered system is the same
//! for any ρ.

use std::sync::Arc;

use deaflow_base::{Stream, is_interrupted};

use super::flat::OutOfPlane;
use super::lifted::{Lifted, bodies};
use super::surface::{Linearised, Surface, Totals};
use crate::effects::WithMaterial;
use crate::eigenvalue::{add, dot};
use crate::error::SetupError;
use crate::material::Material;
use crate::newton::norm;
use crate::operator::Activity;
use crate::precondition::{Laplacian, LaplacianScratch};
use crate::rigid::Pose;
use crate::sheet::lifts;
use crate::solver::{MembraneSolver, SolveOptions};
use crate::work::WorkLimit;
use deaflow_field::{Field, Outcome};
use deaflow_pattern::Pattern;
use deaflow_scene::{Pressurised, Scene};

/// Most Newton steps at one load.
const MOST_STEPS: u32 = 40;
/// Most halvings of a step.
const MOST_HALVINGS: i32 = 20;
/// Most sizes at which the potential is compared on leaving the plane.
const MOST_GUESSES: u32 = 60;
/// Most conjugate-gradient iterations of a step.
const MOST_ITERATIONS: u32 = 600;
/// Share of the load between a stable state and none at which the search ends.
const BRACKET: f64 = 1e-3;
/// Most loads at which a state is searched.
const MOST_LOADS: u32 = 60;
/// Decrease of the potential, relative to that of the linear model, that a step has to reach.
const ARMIJO: f64 = 1e-4;
/// ρ in units of the stiffness of the membrane against a pressure.
const STIFF: f64 = 10.0;
/// Work of an iteration in units of [`WorkLimit`]: three components in double precision.
const WORK: u64 = 10;
/// Compression below this share of the largest tension of a point is rounding.
const ROUNDING: f64 = 1e-6;

/// How the search for an equilibrium under pressure ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InflationOutcome {
    /// A stable equilibrium was found.
    Converged,
    /// There is none without pressure.
    Flat(Outcome),
    /// There is no stable equilibrium beyond a limit between two shares of the load.
    LimitPoint {
        /// The largest share with a stable equilibrium.
        last_stable: f64,
        /// The smallest share at which none was found.
        first_unstable: f64,
    },
    /// The limit of work was reached.
    WorkLimit,
}

impl InflationOutcome {
    /// Returns the word used in files: `converged`, `limit-point`, `work-limit`, or that of the flat state.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Flat(outcome) => outcome.name(),
            Self::LimitPoint { .. } => "limit-point",
            Self::WorkLimit => "work-limit",
        }
    }
}

/// The equilibrium of a pattern under pressure.
#[derive(Clone, Debug, PartialEq)]
pub struct Inflated {
    /// How the search ended.
    pub outcome: InflationOutcome,
    /// Displacement in the plane at the corners of cells, mm; that of the last stable state without an equilibrium.
    pub displacement: Field,
    /// Displacement out of the plane at the corners of cells, `[y][x]`, mm.
    pub heights: Vec<f64>,
    /// Pressure in Pa.
    pub pressure: f64,
    /// Volume between the membrane and its plane, ml.
    pub volume: f64,
    /// Motions of the bodies.
    pub bodies: Vec<SpatialMotion>,
    /// Share of the membrane that is compressed in some direction: a real one wrinkles there.
    pub compressed: f64,
    /// Newton steps, with those of the flat state.
    pub newton_iterations: u32,
    /// Conjugate-gradient iterations, with those of the flat state.
    pub krylov_iterations: u32,
}

/// The motion of a body in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialMotion {
    /// Displacement of the centroid along x, y and out of the plane, mm.
    pub translation: [f64; 3],
    /// Rotation in the plane in degrees, counterclockwise.
    pub rotation: f64,
}

/// What is given.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Given {
    Pressure,
    Volume,
}

/// Finds equilibria of patterns under the pressure of a scene.
pub struct InflationSolver {
    solver: MembraneSolver,
    heights: OutOfPlane,
    bodies: Vec<Lifted>,
    /// The inverse Laplacian for heights.
    level: Arc<Laplacian>,
    given: Given,
    /// The pressure or the volume, without dimension.
    load: f64,
    /// Pa and ml of one unit.
    units: [f64; 2],
}

impl InflationSolver {
    /// Creates a solver for a scene with a pressure or a volume, or with bodies that move out of the plane.
    ///
    /// # Errors
    /// If the scene has none, has sides that are not held or effects that are not simulated with it, or an option is
    /// out of range.
    pub fn new(scene: &Scene, options: SolveOptions) -> Result<Self, SetupError> {
        if !scene.is_in_space() {
            return Err(SetupError::NoPressure);
        }
        let refused = |with| Err(SetupError::not_in_space(scene, with));
        if scene.geometry.sides.is_some() {
            return refused("`sides` that are not held");
        }
        if scene.drive.charge.is_some() {
            return refused("a `charge`");
        }
        if scene.effects.fringe_field.is_some() {
            return refused("`fringe_field`");
        }
        let solver = MembraneSolver::new(&scene.in_plane(), options)?;
        let heights = OutOfPlane::new(&solver.grid).ok_or(SetupError::Memory)?;
        if !heights.moves() {
            return Err(SetupError::NothingMoves);
        }
        let unit_mm = solver.grid.unit_mm();
        let units = [
            scene.shear_modulus_pa() * scene.thickness_mm() / unit_mm,
            1e-3 * unit_mm.powi(3),
        ];
        let (given, load) = match scene.pressurised() {
            None => (Given::Pressure, 0.0),
            Some(Pressurised::Pressure(pascals)) => (Given::Pressure, pascals / units[0]),
            Some(Pressurised::Volume(millilitres)) => (Given::Volume, millilitres / units[1]),
        };
        let lifts = lifts(scene, unit_mm);
        let springs: Vec<f64> = lifts.iter().map(|lift| lift.spring).collect();
        let bodies = bodies(&solver.grid, &lifts);
        let level = match bodies.is_empty() {
            true => Arc::clone(&solver.laplacian),
            false => Laplacian::shared(&solver.grid.levelled(&springs))?,
        };
        Ok(Self {
            solver,
            heights,
            bodies,
            level,
            given,
            load,
            units,
        })
    }

    /// Changes the limit of work of a pattern.
    #[must_use]
    pub fn within(self, limit: WorkLimit) -> Self {
        Self {
            solver: self.solver.within(limit),
            ..self
        }
    }

    /// Finds the equilibrium of a pattern.
    #[must_use]
    pub fn solve(&self, pattern: &Pattern) -> Inflated {
        let flat = self.solver.solve(pattern);
        let plane = self.solver.grid.layout().vector_len() / 2;
        let mut x = flat.displacement.clone();
        x.resize(3 * plane, 0.0);
        let mut found = Found {
            outcome: InflationOutcome::Flat(flat.outcome),
            x,
            pressure: 0.0,
            volume: 0.0,
            compressed: 0.0,
            steps: 0,
            iterations: 0,
        };
        if flat.outcome.is_converged() {
            found = self.solver.model.with(Inflate {
                solver: self,
                activity: &self.solver.model.activity(&self.solver.grid, pattern),
                start: found.x,
            });
        }
        let (planar, height) = found.x.split_at(2 * plane);
        Inflated {
            outcome: found.outcome,
            displacement: self.solver.grid.sample(planar),
            heights: self.solver.grid.sample_heights(height),
            pressure: self.units[0] * found.pressure,
            volume: self.units[1] * found.volume,
            bodies: self.motions(planar, height),
            compressed: found.compressed,
            newton_iterations: flat.newton_iterations + found.steps,
            krylov_iterations: flat.krylov_iterations + found.iterations,
        }
    }

    fn motions(&self, planar: &[f64], height: &[f64]) -> Vec<SpatialMotion> {
        let grid = &self.solver.grid;
        let in_plane = grid.motions(planar).unwrap_or_default();
        let each = in_plane.into_iter().zip(&self.bodies);
        each.map(|(motion, body)| {
            let [x, y] = motion.translation;
            SpatialMotion {
                translation: [x, y, grid.unit_mm() * body.height(height)],
                rotation: motion.rotation,
            }
        })
        .collect()
    }
}

/// A state, without dimension.
struct Found {
    outcome: InflationOutcome,
    x: Vec<f64>,
    pressure: f64,
    volume: f64,
    compressed: f64,
    steps: u32,
    iterations: u32,
}

struct Inflate<'a> {
    solver: &'a InflationSolver,
    activity: &'a Activity,
    start: Vec<f64>,
}

impl WithMaterial for Inflate<'_> {
    type Output = Found;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Found {
        let material = material(1.0);
        let surface = Surface {
            material: &material,
            activity: self.activity,
            heights: &self.solver.heights,
            bodies: &self.solver.bodies,
            share: 1.0,
        };
        let (laplacian, level) = (&*self.solver.solver.laplacian, &*self.solver.level);
        let mut search = Search {
            given: self.solver.given,
            tolerance: self.solver.solver.tolerance,
            limit: self.solver.solver.limit,
            scratches: [laplacian.scratch(), level.scratch()],
            laplacian,
            level,
            surface,
            steps: 0,
            iterations: 0,
        };
        search.raise(self.start, self.solver.load)
    }
}

/// Why a state was not found.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Failure {
    /// No stable state.
    Lost,
    /// The work limit, or an interruption.
    Work,
}

struct Search<'a, L> {
    given: Given,
    tolerance: f64,
    limit: WorkLimit,
    /// The inverse Laplacians for the components in the plane, and for heights.
    laplacian: &'a Laplacian,
    level: &'a Laplacian,
    scratches: [LaplacianScratch; 2],
    surface: Surface<'a, L>,
    steps: u32,
    iterations: u32,
}

/// A state and its pressure.
#[derive(Clone)]
struct State {
    x: Vec<f64>,
    pressure: f64,
}

/// The system of a step: K, at a pressure, plus ρ b bᵀ.
struct System<'a> {
    at: &'a Linearised,
    pressure: f64,
    /// b, and its image by the preconditioner.
    pressed: &'a [f64],
    image: &'a [f64],
    rho: f64,
}

/// How conjugate gradients ended.
#[derive(Clone, Copy, Debug, PartialEq)]
enum End {
    Solved,
    NegativeCurvature,
    /// Too many iterations, without negative curvature.
    Iterations,
}

impl<L: Material> Search<'_, L> {
    fn raise(&mut self, start: Vec<f64>, load: f64) -> Found {
        let mut state = State {
            x: start,
            pressure: 0.0,
        };
        let (mut reached, mut step) = (0.0, 1.0_f64);
        let mut outcome = InflationOutcome::Converged;
        let mut loads = 0;
        let is_lifted = self.surface.bodies.iter().any(|body| body.lift().load != 0.0);
        let is_loaded = load != 0.0 || is_lifted;
        if !is_loaded {
            outcome = match self.probe_flat(&state) {
                Ok(()) => InflationOutcome::Converged,
                Err(Failure::Work) => InflationOutcome::WorkLimit,
                Err(Failure::Lost) => InflationOutcome::LimitPoint {
                    last_stable: 0.0,
                    first_unstable: 0.0,
                },
            };
        }
        while is_loaded && reached < 1.0 {
            loads += 1;
            let share = f64::min(reached + step, 1.0);
            self.surface.share = share;
            let mut next = state.clone();
            match self.settle(&mut next, share * load, reached == 0.0) {
                Ok(()) => {
                    (state, reached) = (next, share);
                    continue;
                }
                Err(Failure::Work) => {
                    outcome = InflationOutcome::WorkLimit;
                    break;
                }
                Err(Failure::Lost) if step <= BRACKET || loads >= MOST_LOADS => {
                    outcome = InflationOutcome::LimitPoint {
                        last_stable: reached,
                        first_unstable: share,
                    };
                    break;
                }
                Err(Failure::Lost) => step = 0.5 * (share - reached),
            }
        }
        let volume = self.totals(&state.x).map_or(0.0, |totals| totals.volume);
        Found {
            outcome,
            pressure: state.pressure,
            volume,
            compressed: self
                .surface
                .linearise(&state.x)
                .map_or(0.0, |at| at.compressed(ROUNDING)),
            x: state.x,
            steps: self.steps,
            iterations: self.iterations,
        }
    }

    /// Returns whether the flat state is stable without pressure, or with the volume 0.
    fn probe_flat(&mut self, state: &State) -> Result<(), Failure> {
        let (mut forces, mut pressed) = (vec![0.0; state.x.len()], vec![0.0; state.x.len()]);
        self.surface
            .evaluate(&state.x, &mut forces, &mut pressed)
            .ok_or(Failure::Lost)?;
        let at = self.surface.linearise(&state.x).ok_or(Failure::Lost)?;
        let image = self.precondition(&at.poses, &pressed);
        let system = System {
            at: &at,
            pressure: 0.0,
            pressed: &pressed,
            image: &image,
            rho: match self.given {
                Given::Pressure => 0.0,
                Given::Volume => STIFF / dot(&pressed, &image),
            },
        };
        self.probe(&system)
    }

    fn totals(&self, x: &[f64]) -> Option<Totals> {
        let mut spare = vec![0.0; 2 * x.len()];
        let (forces, pressed) = spare.split_at_mut(x.len());
        self.surface.evaluate(x, forces, pressed)
    }

    /// Moves a state to the equilibrium at a load.
    fn settle(&mut self, state: &mut State, load: f64, from_flat: bool) -> Result<(), Failure> {
        if from_flat {
            self.guess(state, load);
        }
        match self.given {
            Given::Pressure => {
                state.pressure = load;
                self.minimise(state)
            }
            Given::Volume => self.fill(state, load),
        }
    }

    /// Leaves the flat state along the solution of Laplace's equation for the load: as far as the potential falls, or
    /// to the volume.
    fn guess(&mut self, state: &mut State, load: f64) {
        let (mut forces, mut pressed) = (vec![0.0; state.x.len()], vec![0.0; state.x.len()]);
        if self.surface.evaluate(&state.x, &mut forces, &mut pressed).is_none() {
            return;
        }
        let (poses, lifts) = (self.surface.poses(&state.x), self.surface.lifts());
        let lifted = self.precondition(&poses, &lifts);
        let mut shape = self.precondition(&poses, &pressed);
        if self.given == Given::Volume {
            state.x = combined(&state.x, 1.0, &lifted);
        } else {
            shape = combined(&lifted, load, &shape);
        }
        let moved = |size: f64| combined(&state.x, size, &shape);
        let size = match self.given {
            Given::Volume => (load - dot(&lifted, &pressed)) / dot(&shape, &pressed),
            Given::Pressure => {
                let potential = |size: f64| {
                    let totals = self.totals(&moved(size));
                    totals.map_or(f64::INFINITY, |totals| totals.energy - load * totals.volume)
                };
                // From the size of a membrane with the tension of its prestretch, by factors of two.
                let mut best = (potential(0.0), 0.0);
                let mut size = 1.0;
                let mut factor = None;
                for _ in 0..MOST_GUESSES {
                    let found = potential(size);
                    let falls = found < best.0;
                    if falls {
                        best = (found, size);
                    }
                    // Further out while the potential falls; without a fall at first, further in until it does.
                    let first = if falls { 2.0 } else { 0.5 };
                    let factor = *factor.get_or_insert(first);
                    if (factor > 1.0) != falls {
                        break;
                    }
                    size *= factor;
                }
                best.1
            }
        };
        state.x = self.surface.settled(moved(size));
        if self.given == Given::Volume && self.surface.evaluate(&state.x, &mut forces, &mut pressed).is_some() {
            state.pressure = dot(&forces, &shape) / dot(&pressed, &shape);
        }
    }

    /// Returns the size of the load, with which residuals are compared.
    fn pull(&self, pressure: f64, pressed: &[f64]) -> f64 {
        pressure.abs() * norm(pressed) + norm(&self.surface.lifts())
    }

    /// Minimises E − p Vol.
    fn minimise(&mut self, state: &mut State) -> Result<(), Failure> {
        let len = state.x.len();
        let [mut forces, mut pressed, mut trial_forces, mut trial_pressed] = [(); 4].map(|()| vec![0.0; len]);
        let p = state.pressure;
        let mut totals = self
            .surface
            .evaluate(&state.x, &mut forces, &mut pressed)
            .ok_or(Failure::Lost)?;
        let goal = self.tolerance * self.pull(p, &pressed);
        for _ in 0..MOST_STEPS {
            let residual = combined(&forces, -p, &pressed);
            let size = norm(&residual);
            let at = self.surface.linearise(&state.x).ok_or(Failure::Lost)?;
            let system = System {
                at: &at,
                pressure: p,
                pressed: &pressed,
                image: &pressed,
                rho: 0.0,
            };
            if size <= goal {
                return self.probe(&system);
            }
            let forcing = (size / self.pull(p, &pressed)).sqrt().clamp(1e-3, 0.1);
            let (step, end) = self.solve(&system, &residual, forcing)?;
            let slope = -dot(&residual, &step);
            let before = totals.energy - p * totals.volume;
            let mut accepted = false;
            for halvings in 0..MOST_HALVINGS {
                let length = 0.5_f64.powi(halvings);
                let trial = self.surface.settled(combined(&state.x, -length, &step));
                let Some(found) = self.surface.evaluate(&trial, &mut trial_forces, &mut trial_pressed) else {
                    continue;
                };
                let falls = found.energy - p * found.volume <= before + ARMIJO * length * slope;
                let is_smaller = norm(&combined(&trial_forces, -p, &trial_pressed)) < size;
                if falls || (is_smaller && end == End::Solved) {
                    state.x = trial;
                    totals = found;
                    std::mem::swap(&mut forces, &mut trial_forces);
                    std::mem::swap(&mut pressed, &mut trial_pressed);
                    accepted = true;
                    break;
                }
            }
            self.steps += 1;
            if !accepted {
                return Err(Failure::Lost);
            }
        }
        Err(Failure::Lost)
    }

    /// Finds the equilibrium with a volume.
    fn fill(&mut self, state: &mut State, volume: f64) -> Result<(), Failure> {
        let len = state.x.len();
        let (mut forces, mut pressed) = (vec![0.0; len], vec![0.0; len]);
        let lifts = self.surface.lifts();
        for _ in 0..MOST_STEPS {
            let totals = self
                .surface
                .evaluate(&state.x, &mut forces, &mut pressed)
                .ok_or(Failure::Lost)?;
            let p = state.pressure;
            let residual = combined(&forces, -p, &pressed);
            let missing = volume - totals.volume;
            let at = self.surface.linearise(&state.x).ok_or(Failure::Lost)?;
            let image = self.precondition(&at.poses, &pressed);
            let flexibility = dot(&pressed, &image);
            let system = System {
                at: &at,
                pressure: p,
                pressed: &pressed,
                image: &image,
                rho: STIFF / flexibility,
            };
            let reference = self.pull(p.abs().max(volume.abs() / flexibility), &pressed);
            // The volume may be that of a hub that is pulled out of the membrane above none.
            let largest = volume.abs() + dot(&lifts, &image).abs();
            if norm(&residual) <= self.tolerance * reference && missing.abs() <= 1e-10 * largest {
                return self.probe(&system);
            }
            let forcing = (norm(&residual) / reference).sqrt().clamp(1e-6, 1e-2);
            let right = combined(&residual, -system.rho * missing, &pressed);
            let (back, first) = self.solve(&system, &right, forcing)?;
            let (along, second) = self.solve(&system, &pressed, 1e-3 * forcing.min(1e-3))?;
            if first != End::Solved || second != End::Solved {
                return Err(Failure::Lost);
            }
            let rise = (missing + dot(&pressed, &back)) / dot(&pressed, &along);
            let step: Vec<f64> = along
                .iter()
                .zip(&back)
                .map(|(along, back)| rise * along - back)
                .collect();
            let length = (0..MOST_HALVINGS)
                .map(|halvings| 0.5_f64.powi(halvings))
                .find(|length| {
                    let trial = self.surface.settled(combined(&state.x, *length, &step));
                    self.totals(&trial).is_some()
                })
                .ok_or(Failure::Lost)?;
            state.x = self.surface.settled(combined(&state.x, length, &step));
            state.pressure += length * rise;
            self.steps += 1;
        }
        Err(Failure::Lost)
    }

    /// Returns whether a system is positive definite, as far as a random load shows.
    fn probe(&mut self, system: &System<'_>) -> Result<(), Failure> {
        let mut stream = Stream::new(0, "stability under pressure", 0);
        let mut load: Vec<f64> = (0..self.surface.len()).map(|_| stream.normal()).collect();
        self.surface.restrict(&system.at.poses, &mut load);
        match self.solve(system, &load, 1e-3)? {
            (_, End::Solved | End::Iterations) => Ok(()),
            (_, End::NegativeCurvature) => Err(Failure::Lost),
        }
    }

    /// Solves a system to a relative residual by preconditioned conjugate gradients.
    fn solve(&mut self, system: &System<'_>, right: &[f64], forcing: f64) -> Result<(Vec<f64>, End), Failure> {
        let mut solution = vec![0.0; right.len()];
        let mut residual = right.to_vec();
        let goal = forcing * norm(right);
        let mut z = self.preconditioned(system, &residual);
        let mut direction = z.clone();
        let mut product = dot(&residual, &z);
        let mut image = vec![0.0; right.len()];
        for iteration in 0..MOST_ITERATIONS {
            let work = WORK * u64::from(self.iterations);
            if self.limit.is_spent(work) || is_interrupted() {
                return Err(Failure::Work);
            }
            self.surface.tangent(system.at, system.pressure, &direction, &mut image);
            if system.rho != 0.0 {
                let factor = system.rho * dot(system.pressed, &direction);
                add(&mut image, factor, system.pressed);
            }
            self.iterations += 1;
            let curvature = dot(&direction, &image);
            if curvature.is_nan() || curvature <= 0.0 {
                if iteration == 0 {
                    solution.copy_from_slice(&direction);
                }
                return Ok((solution, End::NegativeCurvature));
            }
            let length = product / curvature;
            add(&mut solution, length, &direction);
            add(&mut residual, -length, &image);
            if norm(&residual) <= goal {
                return Ok((solution, End::Solved));
            }
            z = self.preconditioned(system, &residual);
            let next = dot(&residual, &z);
            let factor = next / product;
            product = next;
            direction.iter_mut().zip(&z).for_each(|(d, z)| *d = z + factor * *d);
        }
        Ok((solution, End::Iterations))
    }

    /// Applies the inverse of the Laplacian of each component, plus ρ b bᵀ.
    fn preconditioned(&mut self, system: &System<'_>, vector: &[f64]) -> Vec<f64> {
        let mut z = self.precondition(&system.at.poses, vector);
        if system.rho != 0.0 {
            let flexibility = dot(system.pressed, system.image);
            let factor = system.rho * dot(system.pressed, &z) / (1.0 + system.rho * flexibility);
            add(&mut z, -factor, system.image);
        }
        z
    }

    fn precondition(&mut self, poses: &[Pose], vector: &[f64]) -> Vec<f64> {
        let plane = vector.len() / 3;
        let single = |values: &[f64]| -> Vec<f32> { values.iter().map(|value| *value as f32).collect() };
        let mut z = vec![0.0_f32; 2 * plane];
        let [scratch, of_heights] = &mut self.scratches;
        self.laplacian
            .solve(&single(&vector[..2 * plane]), poses, &mut z, scratch);
        let mut all: Vec<f64> = z.iter().map(|value| f64::from(*value)).collect();
        let mut height = single(&vector[2 * plane..]);
        height.resize(2 * plane, 0.0);
        let flat = vec![Pose::REST; poses.len()];
        self.level.solve(&height, &flat, &mut z, of_heights);
        all.extend(z[..plane].iter().map(|value| f64::from(*value)));
        self.surface.restrict(poses, &mut all);
        all
    }
}

fn combined(a: &[f64], factor: f64, b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + factor * b).collect()
}
