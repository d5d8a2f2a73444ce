//! Paths of membranes under a pressure or above a volume: with a rising volume or pressure, or a rising voltage.
//!
//! Where the pressure rises, states are found at given volumes, too: they are stable beyond the largest pressure,
//! which lies where dp/dVol, the inverse of bᵀK⁻¹b, is zero. Below it they are those at the pressure. With a rising
//! voltage the load is constant, and the path ends where no stable state is found.

use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_scene::{Pressurised, Scene};

use super::{NoPath, PathEnd, PathParameter};
use crate::effects::WithMaterial;
use crate::error::SetupError;
use crate::material::Material;
use crate::operator::Activity;
use crate::out_of_plane::{BRACKET, Failure, Given, InflationOutcome, InflationSolver, Peak, Search, State, combined};
use crate::solver::{MembraneSolver, SolveOptions};
use crate::work::WorkLimit;

/// Steps to the load or the voltage of the scene.
const STEPS: u32 = 40;
/// Largest first pressure, without dimension: membranes with a large prestretch rise by a hundredth of their side.
const FIRST: f64 = 0.05;
/// Most halvings of the first load.
const HALVINGS: i32 = 20;
/// Largest change of the volume of a step to a pressure, as a share of the volume.
const GROWTH: f64 = 0.15;
/// Most points of a path.
const MOST_POINTS: usize = 240;
/// Accuracy of the volume of the largest pressure, of which the pressure has the square; and most states to find it.
const TOP: f64 = 1e-4;
const MOST_TOPS: u32 = 20;

/// An equilibrium on a path under pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InflationPoint {
    /// Voltage in V.
    pub voltage: f64,
    /// Pressure in Pa.
    pub pressure: f64,
    /// Volume between the membrane and its plane, ml.
    pub volume: f64,
    /// The corner that moves most.
    pub peak: Peak,
    /// Displacement out of the plane at the corner of [`InflationPath::watched`], mm.
    pub watched_height: f64,
    /// Whether it is stable with what is given: its pressure, or its volume.
    pub stable: bool,
    /// Whether it is stable at its pressure.
    pub stable_at_pressure: bool,
    /// Share of the membrane that is compressed and would wrinkle.
    pub compressed: f64,
    /// Largest electric field of a cell relative to the breakdown field, E/E_B, by Huang's law without data.
    pub breakdown_ratio: f64,
}

/// The path of one pattern under pressure.
#[derive(Clone, Debug, PartialEq)]
pub struct InflationPath {
    /// What changes along it.
    pub parameter: PathParameter,
    /// Points in order from the flat state, or from the state without voltage.
    pub points: Vec<InflationPoint>,
    /// The point with the first maximum of the pressure over the volume, if there is one.
    pub largest_pressure: Option<usize>,
    /// Why it ends; at [`PathEnd::LimitPoint`] the last point is the limit.
    pub end: PathEnd,
    /// The cell corner (column, row) that moves most at the last point.
    pub watched: [usize; 2],
    /// Displacement of the last point in the plane, mm.
    pub displacement: Field,
    /// Displacement of the last point out of the plane at the corners of cells, mm.
    pub heights: Vec<f64>,
}

/// Follows paths of a scene with a pressure or a volume.
pub struct InflationPathSolver {
    parameter: PathParameter,
    solver: InflationSolver,
    /// The solver of the flat state in which the path starts.
    start: MembraneSolver,
    voltage: f64,
}

impl InflationPathSolver {
    /// Creates a solver of the paths along which something changes.
    ///
    /// # Errors
    /// If the scene has no pressure and no volume, or not the one that should change, or no voltage where that should,
    /// or it or an option is not simulated.
    pub fn new(scene: &Scene, options: SolveOptions, parameter: PathParameter) -> Result<Self, SetupError> {
        let changes = match (parameter, scene.pressurised().ok_or(SetupError::NoPressure)?) {
            (PathParameter::Voltage, _) => scene.voltage_v(),
            (PathParameter::Pressure, Pressurised::Pressure(load))
            | (PathParameter::Volume, Pressurised::Volume(load)) => load,
            _ => 0.0,
        };
        if changes == 0.0 {
            return Err(SetupError::PathUnderPressure {
                parameter: parameter.name(),
            });
        }
        if scene.geometry.bodies.iter().flatten().next().is_some() {
            return Err(SetupError::not_in_space(scene, "`bodies` along a path"));
        }
        let flat = scene.in_plane();
        let flat = match parameter {
            PathParameter::Voltage => flat.at_voltage(0.0),
            _ => flat,
        };
        Ok(Self {
            parameter,
            solver: InflationSolver::new(scene, options)?.within(WorkLimit::of_history(None)),
            start: MembraneSolver::new(&flat, options)?,
            voltage: scene.voltage_v(),
        })
    }

    /// Follows the path of one pattern.
    ///
    /// # Errors
    /// If there is no stable first state.
    pub fn path(&self, pattern: &Pattern) -> Result<InflationPath, NoPath> {
        let flat = self.start.solve(pattern);
        if !flat.outcome.is_converged() {
            return Err(NoPath::Start);
        }
        let mut start = flat.displacement;
        start.resize(start.len() / 2 * 3, 0.0);
        let flat_solver = self.solver.flat();
        let follow = Follow {
            path: self,
            activity: &flat_solver.model.activity(&flat_solver.grid, pattern),
            points: Vec::new(),
            heights: Vec::new(),
            largest_pressure: None,
            last: State {
                x: start,
                pressure: 0.0,
            },
        };
        self.solver.flat().model.with(follow)
    }
}

/// A path that is being followed, and its last state.
struct Follow<'a> {
    path: &'a InflationPathSolver,
    activity: &'a Activity,
    points: Vec<InflationPoint>,
    /// Displacement of the corners of cells out of the plane at each point, mm.
    heights: Vec<Vec<f64>>,
    largest_pressure: Option<usize>,
    last: State,
}

/// A state at a volume.
#[derive(Clone)]
struct AtVolume {
    state: State,
    volume: f64,
    /// dp/dVol.
    rise: f64,
    /// dx/dVol.
    change: Vec<f64>,
}

impl WithMaterial for Follow<'_> {
    type Output = Result<InflationPath, NoPath>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(mut self, material: F) -> Result<InflationPath, NoPath> {
        let end = match self.path.parameter {
            PathParameter::Voltage => self.with_voltage(material)?,
            _ => {
                let law = material(1.0);
                let mut search = self.path.solver.search(&law, self.activity);
                self.with_volume(&mut search)
            }
        };
        let solver = &self.path.solver;
        let (displacement, heights) = solver.sample(&self.last.x);
        let watched = Peak::of(&displacement, &heights).corner;
        let [columns, _] = displacement.raster().corner_sides();
        let at = watched[1] * columns + watched[0];
        for (point, heights) in self.points.iter_mut().zip(&self.heights) {
            point.watched_height = heights[at];
        }
        Ok(InflationPath {
            parameter: self.path.parameter,
            points: self.points,
            largest_pressure: self.largest_pressure,
            end,
            watched,
            displacement,
            heights,
        })
    }
}

impl Follow<'_> {
    /// Keeps a point of the path; `stable` holds with what is given, and at the pressure.
    fn keep<L: Material>(&mut self, search: &mut Search<'_, L>, state: State, voltage: f64, stable: [bool; 2]) {
        let solver = &self.path.solver;
        let (displacement, heights) = solver.sample(&state.x);
        let [pascals, millilitres] = solver.units();
        self.points.push(InflationPoint {
            voltage,
            pressure: pascals * state.pressure,
            volume: millilitres * search.volume(&state.x),
            peak: Peak::of(&displacement, &heights),
            // Which corner is watched is known at the end of the path.
            watched_height: 0.0,
            stable: stable[0],
            stable_at_pressure: stable[1],
            compressed: search.compressed(&state.x),
            breakdown_ratio: solver.breakdown_ratio(search, &state.x, voltage),
        });
        self.heights.push(heights);
        self.last = state;
    }

    /// Raises the voltage at the load of the scene.
    fn with_voltage<L: Material, F: Fn(f64) -> L + Sync>(&mut self, material: F) -> Result<PathEnd, NoPath> {
        let (solver, full) = (&self.path.solver, self.path.voltage);
        let law = material(0.0);
        let mut search = solver.search(&law, self.activity);
        let (state, outcome) = search.raise(self.last.x.clone(), solver.load());
        if outcome != InflationOutcome::Converged {
            return Err(NoPath::Start);
        }
        let stable = self.stability(&mut search, &state);
        self.keep(&mut search, state, 0.0, stable);
        let mut tension = search.tension;
        let (mut reached, mut step) = (0.0, 1.0 / f64::from(STEPS));
        // The state before the last one, and its share of the voltage.
        let mut before: Option<(Vec<f64>, f64)> = None;
        while reached < 1.0 {
            if self.points.len() >= MOST_POINTS {
                return Ok(PathEnd::Points);
            }
            let share = f64::min(reached + step, 1.0);
            let law = material(share * share);
            let mut search = solver.search(&law, self.activity);
            search.tension = tension;
            let mut next = self.last.clone();
            if let Some((x, at)) = &before {
                let back: Vec<f64> = combined(&next.x, -1.0, x);
                next.x = combined(&next.x, (share - reached) / (reached - at), &back);
            }
            match search.settle(&mut next, solver.load(), false) {
                Ok(()) => {
                    before = Some((self.last.x.clone(), reached));
                    let stable = self.stability(&mut search, &next);
                    self.keep(&mut search, next, share * full, stable);
                    tension = search.tension;
                    reached = share;
                }
                Err(Failure::Work) => return Ok(PathEnd::Lost),
                Err(Failure::Lost) if share - reached <= BRACKET * share => return Ok(PathEnd::LimitPoint),
                // Without the state before, in case that it pointed elsewhere.
                Err(Failure::Lost) => (step, before) = (0.5 * (share - reached), None),
            }
        }
        Ok(PathEnd::Complete)
    }

    /// Returns whether an equilibrium is stable with what is given, and at its pressure.
    fn stability<L: Material>(&self, search: &mut Search<'_, L>, state: &State) -> [bool; 2] {
        match search.given {
            Given::Pressure => [true; 2],
            Given::Volume => [true, search.per_volume(state).is_ok_and(|(rise, _)| rise > 0.0)],
        }
    }

    /// Raises the volume to that of the scene, to its pressure, or to the largest pressure.
    fn with_volume<L: Material>(&mut self, search: &mut Search<'_, L>) -> PathEnd {
        match self.raise_volume(search) {
            Ok(end) => end,
            Err(Failure::Lost) => PathEnd::LimitPoint,
            Err(Failure::Work) => PathEnd::Lost,
        }
    }

    fn raise_volume<L: Material>(&mut self, search: &mut Search<'_, L>) -> Result<PathEnd, Failure> {
        let (load, voltage) = (self.path.solver.load(), self.path.voltage);
        let by_pressure = search.given == Given::Pressure;
        let flat = self.last.clone();
        let is_stable = search.probe_flat(&flat).is_ok();
        self.keep(search, flat.clone(), voltage, [is_stable; 2]);
        let mut here = first(search, &flat, load)?;
        self.keep_at(search, &here, voltage);
        while by_pressure || here.volume / load < 1.0 {
            if self.points.len() >= MOST_POINTS {
                return Ok(PathEnd::Points);
            }
            let next = further(search, &here, load)?;
            if here.rise > 0.0 && next.rise <= 0.0 && self.largest_pressure.is_none() {
                let top = largest(search, &here, &next)?;
                if by_pressure && top.state.pressure / load >= 1.0 {
                    return self.reach(search, &here, &top);
                }
                self.largest_pressure = Some(self.points.len());
                // The last stable state, on whichever side of it.
                let top = AtVolume {
                    rise: top.rise.abs(),
                    ..top
                };
                self.keep_at(search, &top, voltage);
                if by_pressure {
                    return Ok(PathEnd::LimitPoint);
                }
            }
            if by_pressure && next.state.pressure / load >= 1.0 {
                return self.reach(search, &here, &next);
            }
            self.keep_at(search, &next, voltage);
            here = next;
        }
        Ok(PathEnd::Complete)
    }

    /// Keeps a state that is stable at its volume.
    fn keep_at<L: Material>(&mut self, search: &mut Search<'_, L>, at: &AtVolume, voltage: f64) {
        let is_stable = at.rise > 0.0;
        let stable = [is_stable || search.given == Given::Volume, is_stable];
        self.keep(search, at.state.clone(), voltage, stable);
    }

    /// Ends at the pressure of the scene, between two states.
    fn reach<L: Material>(
        &mut self,
        search: &mut Search<'_, L>,
        below: &AtVolume,
        above: &AtVolume,
    ) -> Result<PathEnd, Failure> {
        let load = self.path.solver.load();
        let [low, high] = [below, above].map(|at| at.state.pressure);
        let apart = combined(&above.state.x, -1.0, &below.state.x);
        let mut state = State {
            x: combined(&below.state.x, (load - low) / (high - low), &apart),
            pressure: load,
        };
        search.settle(&mut state, load, false)?;
        self.keep(search, state, self.path.voltage, [true; 2]);
        Ok(PathEnd::Complete)
    }
}

/// Finds the first state beyond the flat one.
fn first<L: Material>(search: &mut Search<'_, L>, flat: &State, load: f64) -> Result<AtVolume, Failure> {
    let size = load.abs() / f64::from(STEPS);
    let size = match search.given {
        Given::Pressure => size.min(FIRST),
        Given::Volume => size,
    };
    for halvings in 0..HALVINGS {
        let mut state = flat.clone();
        match search.settle(&mut state, size.copysign(load) * 0.5_f64.powi(halvings), true) {
            Ok(()) => return at_volume(search, state),
            Err(Failure::Lost) => {}
            Err(Failure::Work) => return Err(Failure::Work),
        }
    }
    Err(Failure::Lost)
}

fn at_volume<L: Material>(search: &mut Search<'_, L>, state: State) -> Result<AtVolume, Failure> {
    let (rise, change) = search.per_volume(&state)?;
    Ok(AtVolume {
        volume: search.volume(&state.x),
        state,
        rise,
        change,
    })
}

/// Finds the next state at a larger volume.
fn further<L: Material>(search: &mut Search<'_, L>, here: &AtVolume, load: f64) -> Result<AtVolume, Failure> {
    let size = load.abs() / f64::from(STEPS);
    let mut by = match search.given {
        Given::Volume => size.min((load - here.volume).abs()),
        Given::Pressure if here.rise > 0.0 => (size / here.rise).min(GROWTH * here.volume.abs()),
        Given::Pressure => GROWTH * here.volume.abs(),
    };
    loop {
        // To the last bit at the end.
        let volume = match search.given {
            Given::Volume if by >= (load - here.volume).abs() => load,
            _ => here.volume + by.copysign(load),
        };
        match to_volume(search, here, volume) {
            Err(Failure::Lost) if by > BRACKET * here.volume.abs() => by *= 0.5,
            found => return found,
        }
    }
}

/// Moves a state to another volume, along the tangent of the path first.
fn to_volume<L: Material>(search: &mut Search<'_, L>, from: &AtVolume, volume: f64) -> Result<AtVolume, Failure> {
    let by = volume - from.volume;
    let mut state = State {
        x: combined(&from.state.x, by, &from.change),
        pressure: from.state.pressure + by * from.rise,
    };
    search.fill(&mut state, volume)?;
    // The given volume, so that the last one is that of the scene to the last bit.
    Ok(AtVolume {
        volume,
        ..at_volume(search, state)?
    })
}

/// Finds the largest pressure between a state where it rises and one where it falls: by the method of Illinois for
/// dp/dVol = 0.
fn largest<L: Material>(
    search: &mut Search<'_, L>,
    rising: &AtVolume,
    falling: &AtVolume,
) -> Result<AtVolume, Failure> {
    let (mut low, mut high) = (rising.clone(), falling.clone());
    let mut weights = [low.rise, high.rise];
    let mut before = None;
    for _ in 0..MOST_TOPS {
        let volume = (low.volume * weights[1] - high.volume * weights[0]) / (weights[1] - weights[0]);
        let nearer = match (volume - low.volume).abs() < (volume - high.volume).abs() {
            true => &low,
            false => &high,
        };
        let is_near = (volume - nearer.volume).abs() <= TOP * volume.abs();
        let found = to_volume(search, nearer, volume)?;
        if is_near {
            return Ok(found);
        }
        // An end that stays twice counts half.
        let rises = found.rise > 0.0;
        let factor = if before == Some(rises) { 0.5 } else { 1.0 };
        before = Some(rises);
        if rises {
            weights = [found.rise, factor * weights[1]];
            low = found;
        } else {
            weights = [factor * weights[0], found.rise];
            high = found;
        }
    }
    Err(Failure::Lost)
}
