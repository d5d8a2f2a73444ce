//! The linear systems of Newton's method under pressure: preconditioned conjugate gradients.

use deaflow_base::{Stream, is_interrupted};

use super::goals::Goals;
use super::inflation::{Failure, Given, STIFF, Search};
use super::surface::Linearised;
use crate::eigenvalue::{add, dot};
use crate::material::Material;
use crate::rigid::Pose;

/// Most iterations of a system.
const MOST_ITERATIONS: u32 = 600;
/// Work of an iteration in units of `WorkLimit`: three components in double precision.
const WORK: u64 = 10;

/// The system of a step: K, at a pressure, plus ρ b bᵀ.
#[derive(Clone, Copy)]
pub(super) struct System<'a> {
    pub at: &'a Linearised,
    pub pressure: f64,
    /// b, and its image by the preconditioner.
    pub pressed: &'a [f64],
    pub image: &'a [f64],
    pub rho: f64,
    pub goals: Goals,
}

impl<'a> System<'a> {
    /// Returns the system of a state at a pressure with b and its image. ρ is zero unless a volume is given.
    pub fn of(given: Given, at: &'a Linearised, pressure: f64, [pressed, image]: [&'a [f64]; 2]) -> Self {
        Self {
            at,
            pressure,
            pressed,
            image,
            rho: match given {
                Given::Pressure => 0.0,
                Given::Volume => STIFF / dot(pressed, image),
            },
            goals: Goals::EQUAL,
        }
    }
}

/// How conjugate gradients ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum End {
    Solved,
    NegativeCurvature,
    /// Too many iterations, without negative curvature.
    Iterations,
}

impl<L: Material> Search<'_, L> {
    /// Returns whether a system is positive definite, as far as a random load shows.
    pub(super) fn probe(&mut self, system: &System<'_>) -> Result<(), Failure> {
        let mut stream = Stream::new(0, "stability under pressure", 0);
        let mut load: Vec<f64> = (0..self.surface.len()).map(|_| stream.normal()).collect();
        self.surface.restrict(&system.at.poses, &mut load);
        let system = System {
            goals: Goals::EQUAL,
            ..*system
        };
        match self.solve(&system, &load, 1e-3)? {
            (_, End::Solved | End::Iterations) => Ok(()),
            (_, End::NegativeCurvature) => Err(Failure::Lost),
        }
    }

    /// Solves a system to a relative residual by preconditioned conjugate gradients.
    pub(super) fn solve(
        &mut self,
        system: &System<'_>,
        right: &[f64],
        forcing: f64,
    ) -> Result<(Vec<f64>, End), Failure> {
        let mut solution = vec![0.0; right.len()];
        let mut residual = right.to_vec();
        let goal = forcing * system.goals.size(right);
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
            if system.goals.size(&residual) <= goal {
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

    /// Applies the inverse of the Laplacian of each component, times the tension out of the plane, with bodies in these
    /// poses.
    pub(super) fn precondition(&mut self, poses: &[Pose], vector: &[f64]) -> Vec<f64> {
        let plane = vector.len() / 3;
        let (planar, heights) = vector.split_at(2 * plane);
        let mut all = Vec::with_capacity(vector.len());
        let [of_plane, of_heights] = &mut self.scratches;
        invert(planar, 1.0, &mut all, |values, z| {
            self.laplacian.solve(values, poses, z, of_plane)
        });
        let level = vec![Pose::REST; poses.len()];
        invert(heights, 1.0 / self.tension, &mut all, |values, z| {
            self.level.solve(values, &level, z, of_heights);
        });
        self.surface.restrict(poses, &mut all);
        all
    }
}

/// Appends a multiple of the solution for one or two components.
fn invert(values: &[f64], factor: f64, out: &mut Vec<f64>, solve: impl FnOnce(&[f32], &mut [f32])) {
    let largest = values.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
    if largest == 0.0 {
        out.resize(out.len() + values.len(), 0.0);
        return;
    }
    // Of any size, also below the range of single precision.
    let mut single: Vec<f32> = values.iter().map(|value| (value / largest) as f32).collect();
    let both = if out.is_empty() { values.len() } else { out.len() };
    single.resize(both, 0.0);
    let mut z = vec![0.0_f32; both];
    solve(&single, &mut z);
    let scaled = z[..values.len()]
        .iter()
        .map(|value| factor * largest * f64::from(*value));
    out.extend(scaled);
}
