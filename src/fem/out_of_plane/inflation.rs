//! A membrane under a pressure that follows its surface, or above a given volume of an incompressible fluid, and under
//! forces out of the plane on bodies.
//!
//! From the flat state the pressure, or the volume, is raised with these forces by steps, which are halved where no
//! stable state is found. At a pressure p the potential E − p Vol is minimised by Newton's method with a line search;
//! at a volume the pressure is the multiplier of the constraint, and each step solves a bordered system. There
//! K + ρ b bᵀ is positive definite also past the largest pressure, where K is not: the solution of the bordered system
//! is the same for any ρ.

use std::sync::Arc;

use super::flat::{FlatStability, NO_TENSION, OutOfPlane};
use super::goals::Goals;
use super::lifted::{Lifted, bodies};
use super::surface::{Linearised, Surface, Totals};
use super::system::{End, System};
use crate::effects::{WithMaterial, breakdown_strength_or_default, largest_ratio};
use crate::eigenvalue::dot;
use crate::error::SetupError;
use crate::material::Material;
use crate::newton::norm;
use crate::operator::{Activity, Operator};
use crate::precondition::{Laplacian, LaplacianScratch};
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
/// Distance between a stable state and none at which the search ends, relative to their loads.
pub(crate) const BRACKET: f64 = 5e-4;
/// Share of the load below which no state is searched.
const SMALLEST: f64 = 1e-6;
/// A load without dimension that counts as none: squares of its forces would not be numbers.
const NONE: f64 = 1e-100;
/// Most loads at which a state is searched.
const MOST_LOADS: u32 = 60;
/// Decrease of the potential, relative to that of the linear model, that a step has to reach.
const ARMIJO: f64 = 1e-4;
/// The same where the potential is known to rounding only: share of the slope along a step that may be left.
const LEFT: f64 = 0.9;
/// ρ in units of the stiffness of the membrane against a pressure.
pub(super) const STIFF: f64 = 10.0;
/// Residual of the change of a state with its volume.
const ALONG: f64 = 1e-8;
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
    /// Largest electric field of a cell relative to the breakdown field, E/E_B, by Huang's law without data.
    pub breakdown_ratio: f64,
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

/// The largest displacement of a membrane in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Its size, mm.
    pub mm: f64,
    /// The part of it out of the plane, mm.
    pub height: f64,
    /// Column and row of its corner of cells.
    pub corner: [usize; 2],
}

impl Peak {
    /// Finds the corner of cells that moves most.
    #[must_use]
    pub fn of(displacement: &Field, heights: &[f64]) -> Self {
        let [columns, _] = displacement.raster().corner_sides();
        let corners = heights.iter().enumerate().map(|(at, height)| {
            let corner = [at % columns, at / columns];
            let [u, v] = displacement.at_corner(corner[0], corner[1]);
            Self {
                mm: u.hypot(v).hypot(*height),
                height: *height,
                corner,
            }
        });
        let none = Self {
            mm: 0.0,
            height: 0.0,
            corner: [0; 2],
        };
        corners.fold(none, |best, one| if one.mm > best.mm { one } else { best })
    }
}

/// What is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Given {
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
    /// Checks that a scene has a pressure or a volume, or bodies that move out of the plane, and nothing that is not
    /// simulated with them.
    ///
    /// # Errors
    /// If it has none, or sides that are not held, a charge or a fringe field.
    pub fn check(scene: &Scene) -> Result<(), SetupError> {
        if !scene.is_in_space() {
            return Err(SetupError::NoPressure);
        }
        let excluded = [
            (scene.geometry.sides.is_some(), "`sides` that are not held"),
            (scene.drive.charge.is_some(), "a `charge`"),
            (scene.effects.fringe_field.is_some(), "`fringe_field`"),
        ];
        match excluded.into_iter().find(|(is_on, _)| *is_on) {
            Some((_, with)) => Err(SetupError::not_in_space(scene, with)),
            None => Ok(()),
        }
    }

    /// Creates a solver for a scene with a pressure or a volume, or with bodies that move out of the plane.
    ///
    /// # Errors
    /// If the scene has none, has sides that are not held or effects that are not simulated with it, or an option is
    /// out of range.
    pub fn new(scene: &Scene, options: SolveOptions) -> Result<Self, SetupError> {
        Self::check(scene)?;
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

    /// Prepares the search of equilibria with a law.
    pub(crate) fn search<'a, L: Material>(&'a self, law: &'a L, activity: &'a Activity) -> Search<'a, L> {
        let (laplacian, level) = (&*self.solver.laplacian, &*self.level);
        Search {
            given: self.given,
            tolerance: self.solver.tolerance,
            limit: self.solver.limit,
            scratches: [laplacian.scratch(), level.scratch()],
            laplacian,
            level,
            surface: Surface {
                material: law,
                activity,
                heights: &self.heights,
                bodies: &self.bodies,
                share: 1.0,
            },
            tension: 1.0,
            steps: 0,
            iterations: 0,
        }
    }

    /// Returns the solver of flat states.
    pub(crate) fn flat(&self) -> &MembraneSolver {
        &self.solver
    }

    /// Returns the load without dimension.
    pub(crate) fn load(&self) -> f64 {
        self.load
    }

    /// Returns Pa and ml of one unit.
    pub(crate) fn units(&self) -> [f64; 2] {
        self.units
    }

    /// Returns a displacement in the plane, and out of it, at the corners of cells.
    pub(crate) fn sample(&self, x: &[f64]) -> (Field, Vec<f64>) {
        let (planar, height) = x.split_at(2 * (x.len() / 3));
        (self.solver.grid.sample(planar), self.solver.grid.sample_heights(height))
    }

    /// Returns the largest E/E_B of the cells in a state at a voltage in V, by Huang's law without data.
    pub(crate) fn breakdown_ratio<L: Material>(&self, search: &Search<'_, L>, x: &[f64], voltage: f64) -> f64 {
        let scene = &self.solver.scene;
        let (thickness, prestretched) = (scene.thickness_mm(), scene.mean_prestretch().powi(2));
        let of_cell = |[stretch, activity]: [f64; 2]| {
            let stretch = prestretched * stretch;
            [1e3 * voltage * activity.sqrt() / thickness * stretch, stretch]
        };
        let cells = search.surface.stretched_cells(x).into_iter().map(of_cell);
        largest_ratio(&breakdown_strength_or_default(scene), thickness, cells)
    }

    /// Finds the equilibrium of a pattern.
    #[must_use]
    pub fn solve(&self, pattern: &Pattern) -> Inflated {
        self.inflated(self.find(pattern))
    }

    /// Finds the equilibrium of a pattern, without dimension.
    pub(super) fn find(&self, pattern: &Pattern) -> Found {
        let flat = self.solver.solve(pattern);
        let mut x = flat.displacement;
        x.resize(3 * (x.len() / 2), 0.0);
        let mut found = match flat.outcome.is_converged() {
            true => self.raise(&self.solver.model.activity(&self.solver.grid, pattern), x),
            false => Found {
                outcome: InflationOutcome::Flat(flat.outcome),
                state: State { x, pressure: 0.0 },
                tension: 1.0,
                volume: 0.0,
                compressed: 0.0,
                breakdown_ratio: 0.0,
                steps: 0,
                iterations: 0,
            },
        };
        found.steps += flat.newton_iterations;
        found.iterations += flat.krylov_iterations;
        found
    }

    /// Finds the equilibrium of electrodes from their flat state.
    pub(super) fn raise(&self, activity: &Activity, start: Vec<f64>) -> Found {
        self.solver.model.with(Inflate {
            solver: self,
            activity,
            start,
        })
    }

    /// Finds the equilibrium of a pattern from that of another one with nearly the same electrodes; from the flat state
    /// where there is none near it.
    pub(super) fn find_near(&self, pattern: &Pattern, start: &Found) -> Found {
        let near = (start.outcome == InflationOutcome::Converged).then(|| {
            self.solver.model.with(InflateNear {
                solver: self,
                activity: &self.solver.model.activity(&self.solver.grid, pattern),
                start,
            })
        });
        near.flatten().unwrap_or_else(|| self.find(pattern))
    }

    /// Returns an equilibrium in units of the scene.
    pub(super) fn inflated(&self, found: Found) -> Inflated {
        let (displacement, heights) = self.sample(&found.state.x);
        let (planar, height) = found.state.x.split_at(2 * (found.state.x.len() / 3));
        Inflated {
            outcome: found.outcome,
            displacement,
            heights,
            pressure: self.units[0] * found.state.pressure,
            volume: self.units[1] * found.volume,
            bodies: self.motions(planar, height),
            compressed: found.compressed,
            breakdown_ratio: found.breakdown_ratio,
            newton_iterations: found.steps,
            krylov_iterations: found.iterations,
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

/// A state with what follows from it, without dimension.
#[derive(Clone)]
pub(super) struct Found {
    pub outcome: InflationOutcome,
    pub state: State,
    /// That of [`Search`].
    pub tension: f64,
    volume: f64,
    compressed: f64,
    breakdown_ratio: f64,
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
        let law = material(1.0);
        let mut search = self.solver.search(&law, self.activity);
        let (state, outcome) = search.raise(self.start, self.solver.load);
        Found::new(self.solver, &search, state, outcome)
    }
}

struct InflateNear<'a> {
    solver: &'a InflationSolver,
    activity: &'a Activity,
    start: &'a Found,
}

impl WithMaterial for InflateNear<'_> {
    type Output = Option<Found>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Option<Found> {
        let (law, load) = (material(1.0), self.solver.load);
        let mut search = self.solver.search(&law, self.activity);
        // Without a load stability is another question.
        if !search.is_loaded(load) {
            return None;
        }
        search.tension = self.start.tension;
        let mut state = self.start.state.clone();
        search.settle(&mut state, load, false).ok()?;
        Some(Found::new(self.solver, &search, state, InflationOutcome::Converged))
    }
}

impl Found {
    fn new<L: Material>(
        solver: &InflationSolver,
        search: &Search<'_, L>,
        state: State,
        outcome: InflationOutcome,
    ) -> Self {
        Self {
            outcome,
            volume: search.volume(&state.x),
            compressed: search.compressed(&state.x),
            breakdown_ratio: solver.breakdown_ratio(search, &state.x, solver.solver.scene.voltage_v()),
            state,
            tension: search.tension,
            steps: search.steps,
            iterations: search.iterations,
        }
    }
}

/// Why a state was not found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Failure {
    /// No stable state.
    Lost,
    /// The work limit, or an interruption.
    Work,
}

pub(crate) struct Search<'a, L> {
    pub given: Given,
    tolerance: f64,
    pub(super) limit: WorkLimit,
    /// The inverse Laplacians for the components in the plane, and for heights.
    pub(super) laplacian: &'a Laplacian,
    pub(super) level: &'a Laplacian,
    pub(super) scratches: [LaplacianScratch; 2],
    pub(super) surface: Surface<'a, L>,
    /// Tension against small motions out of the plane, in units of that of a large prestretch: for the preconditioner.
    pub tension: f64,
    pub steps: u32,
    pub iterations: u32,
}

/// A state and its pressure.
#[derive(Clone)]
pub(crate) struct State {
    pub x: Vec<f64>,
    pub pressure: f64,
}

impl<L: Material> Search<'_, L> {
    /// Raises the load from a flat state.
    pub fn raise(&mut self, start: Vec<f64>, load: f64) -> (State, InflationOutcome) {
        let mut state = State {
            x: start,
            pressure: 0.0,
        };
        let (mut reached, mut step) = (0.0, 1.0_f64);
        let mut outcome = InflationOutcome::Converged;
        let mut loads = 0;
        let is_loaded = self.is_loaded(load);
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
                Err(Failure::Lost) if share - reached <= BRACKET * share || share < SMALLEST || loads >= MOST_LOADS => {
                    outcome = InflationOutcome::LimitPoint {
                        last_stable: reached,
                        first_unstable: share,
                    };
                    break;
                }
                Err(Failure::Lost) => step = 0.5 * (share - reached),
            }
        }
        (state, outcome)
    }

    /// Returns whether a load, or a force on a body, moves the membrane out of its plane.
    fn is_loaded(&self, load: f64) -> bool {
        let is_lifted = self.surface.bodies.iter().any(|body| body.lift().load != 0.0);
        load.abs() >= NONE || is_lifted
    }

    /// Returns the volume between a state and its plane; 0 where the law is not defined.
    pub fn volume(&self, x: &[f64]) -> f64 {
        self.totals(x).map_or(0.0, |totals| totals.volume)
    }

    /// Returns the share of the membrane that is compressed.
    pub fn compressed(&self, x: &[f64]) -> f64 {
        let at = self.surface.linearise(x);
        at.map_or(0.0, |at| at.compressed(ROUNDING))
    }

    /// Returns whether the flat state, which is stable in its plane, is stable out of it without pressure, or with the
    /// volume 0.
    pub fn probe_flat(&mut self, state: &State) -> Result<(), Failure> {
        // Bodies, which have a height here, stay in the plane there.
        if self.surface.bodies.is_empty() {
            let activity = self.surface.activity;
            let flat = FlatStability::new(activity.grid()).ok_or(Failure::Lost)?;
            let planar = &state.x[..2 * (state.x.len() / 3)];
            let operator = Operator::new(self.surface.material, activity);
            if flat.unstable_beyond(NO_TENSION, &operator, planar) == Some(0) {
                return Ok(());
            }
            if self.given == Given::Pressure {
                return Err(Failure::Lost);
            }
        }
        // A volume holds one motion.
        let (at, pressed, image) = self.pressed_at(&state.x)?;
        self.probe(&System::of(self.given, &at, 0.0, [&pressed, &image]))
    }

    /// Returns the tangent at a state, b, and its image by the preconditioner.
    pub(super) fn pressed_at(&mut self, x: &[f64]) -> Result<(Linearised, Vec<f64>, Vec<f64>), Failure> {
        let [mut forces, mut pressed] = [(); 2].map(|()| vec![0.0; x.len()]);
        self.surface
            .evaluate(x, &mut forces, &mut pressed)
            .ok_or(Failure::Lost)?;
        let at = self.surface.linearise(x).ok_or(Failure::Lost)?;
        let image = self.precondition(&at.poses, &pressed);
        Ok((at, pressed, image))
    }

    fn totals(&self, x: &[f64]) -> Option<Totals> {
        let mut spare = vec![0.0; 2 * x.len()];
        let (forces, pressed) = spare.split_at_mut(x.len());
        self.surface.evaluate(x, forces, pressed)
    }

    /// Moves a state to the equilibrium at a load.
    pub fn settle(&mut self, state: &mut State, load: f64, from_flat: bool) -> Result<(), Failure> {
        if from_flat {
            self.leave(state, load);
        }
        match self.given {
            Given::Pressure => {
                state.pressure = load;
                self.minimise(state)
            }
            Given::Volume => self.fill(state, load),
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
        let goals = Goals::new(self.tolerance * self.pull(p, &pressed), &totals);
        for _ in 0..MOST_STEPS {
            let residual = combined(&forces, -p, &pressed);
            let size = goals.size(&residual);
            let at = self.surface.linearise(&state.x).ok_or(Failure::Lost)?;
            let system = System {
                at: &at,
                pressure: p,
                pressed: &pressed,
                image: &pressed,
                rho: 0.0,
                goals,
            };
            if size <= 1.0 {
                return self.probe(&system);
            }
            let forcing = (self.tolerance * size).sqrt().clamp(1e-3, 0.1);
            let (step, end) = self.solve(&system, &residual, forcing)?;
            let slope = -dot(&residual, &step);
            let mut accepted = false;
            for halvings in 0..MOST_HALVINGS {
                let length = 0.5_f64.powi(halvings);
                let trial = self.surface.settled(combined(&state.x, -length, &step));
                let Some(found) = self.surface.evaluate(&trial, &mut trial_forces, &mut trial_pressed) else {
                    continue;
                };
                let rise = found.energy - totals.energy - p * (found.volume - totals.volume);
                let left = combined(&trial_forces, -p, &trial_pressed);
                let falls = match rise.abs() > Goals::of_energy(&totals) {
                    true => rise <= ARMIJO * length * slope,
                    false => dot(&left, &step).abs() <= LEFT * slope.abs(),
                };
                let is_smaller = goals.size(&left) < size;
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
    pub fn fill(&mut self, state: &mut State, volume: f64) -> Result<(), Failure> {
        let len = state.x.len();
        let (mut forces, mut pressed) = (vec![0.0; len], vec![0.0; len]);
        let lifts = self.surface.lifts();
        let mut totals = self
            .surface
            .evaluate(&state.x, &mut forces, &mut pressed)
            .ok_or(Failure::Lost)?;
        for _ in 0..MOST_STEPS {
            let p = state.pressure;
            let residual = combined(&forces, -p, &pressed);
            let missing = volume - totals.volume;
            let at = self.surface.linearise(&state.x).ok_or(Failure::Lost)?;
            let image = self.precondition(&at.poses, &pressed);
            let flexibility = dot(&pressed, &image);
            let reference = self.pull(p.abs().max(volume.abs() / flexibility), &pressed);
            let system = System {
                at: &at,
                pressure: p,
                pressed: &pressed,
                image: &image,
                rho: STIFF / flexibility,
                goals: Goals::new(self.tolerance * reference, &totals),
            };
            // The volume may be that of a hub that is pulled out of the membrane above none.
            let largest = volume.abs() + dot(&lifts, &image).abs();
            let size = system.goals.size(&residual);
            if size <= 1.0 && missing.abs() <= 1e-10 * largest {
                return self.probe(&system);
            }
            let forcing = (self.tolerance * size).sqrt().clamp(1e-6, 1e-2);
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
            let mut halved = (0..MOST_HALVINGS).map(|halvings| 0.5_f64.powi(halvings));
            let shortened = halved.find_map(|length| {
                let trial = self.surface.settled(combined(&state.x, length, &step));
                let found = self.surface.evaluate(&trial, &mut forces, &mut pressed)?;
                Some((length, trial, found))
            });
            let (length, trial, found) = shortened.ok_or(Failure::Lost)?;
            (state.x, totals) = (trial, found);
            state.pressure += length * rise;
            self.steps += 1;
        }
        Err(Failure::Lost)
    }

    /// Returns dp/dVol along the equilibria through a state, and the change of the state with the volume.
    pub fn per_volume(&mut self, state: &State) -> Result<(f64, Vec<f64>), Failure> {
        let (at, pressed, image) = self.pressed_at(&state.x)?;
        let system = System::of(Given::Volume, &at, state.pressure, [&pressed, &image]);
        let (along, end) = self.solve(&system, &pressed, ALONG)?;
        if end != End::Solved {
            return Err(Failure::Lost);
        }
        let flexibility = dot(&pressed, &along);
        let change = along.iter().map(|along| along / flexibility).collect();
        Ok((1.0 / flexibility - system.rho, change))
    }
}

pub(crate) fn combined(a: &[f64], factor: f64, b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + factor * b).collect()
}
