//! Dispatch of work compiled for several widths of vector registers to the widest that the CPU supports.
//!
//! Results are identical with 256 and 512 bits: no sum depends on the number of lanes.

use pulp::{Simd, WithSimd};

/// Returns whether the CPU has no vector registers that kernels are compiled for.
#[must_use]
pub fn are_scalar() -> bool {
    #[cfg(test)]
    if tests::ALLOWED.get() == tests::Allowed::Scalar {
        return true;
    }
    #[cfg(target_arch = "x86_64")]
    {
        pulp::x86::V3::try_new().is_none()
    }
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// Runs work with registers of up to 256 bits.
#[inline]
pub fn dispatch<W: WithSimd>(work: W) -> W::Output {
    if are_scalar() {
        Simd::vectorize(pulp::Scalar::new(), work)
    } else {
        dispatch_vector(work)
    }
}

/// As [`dispatch`], for a CPU with vector registers.
///
/// # Panics
/// If [`are_scalar`].
#[inline]
pub fn dispatch_vector<W: WithSimd>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        let simd = pulp::x86::V3::try_new().expect("are_scalar() is false");
        Simd::vectorize(simd, work)
    }
    #[cfg(not(target_arch = "x86_64"))]
    pulp::Arch::new().dispatch(work)
}

/// As [`dispatch`], with AVX-512 if supported. It compiles the work once more, so it is used only for the longest parts
/// of a solve.
#[inline]
pub fn dispatch_widest<W: WithSimd>(work: W) -> W::Output {
    if are_scalar() {
        Simd::vectorize(pulp::Scalar::new(), work)
    } else {
        dispatch_widest_vector(work)
    }
}

/// As [`dispatch_widest`], for a CPU with vector registers.
///
/// # Panics
/// If [`are_scalar`].
#[inline]
pub fn dispatch_widest_vector<W: WithSimd>(work: W) -> W::Output {
    #[cfg(test)]
    if tests::ALLOWED.get() == tests::Allowed::Narrow {
        return dispatch_vector(work);
    }
    #[cfg(all(target_arch = "x86_64", feature = "avx512"))]
    if let Some(simd) = pulp::x86::V4::try_new() {
        return Simd::vectorize(simd, work);
    }
    dispatch_vector(work)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use deaflow_field::{Mesh, Order};
    use deaflow_pattern::{CELLS, Pattern, Raster};
    use deaflow_scene::laws::Gent;
    use deaflow_scene::{Effects, On, Scene, Stiffening};

    use crate::{MembraneSolver, SolveOptions};

    /// Registers that a thread may use.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub(super) enum Allowed {
        /// None.
        Scalar,
        /// Up to 256 bits.
        Narrow,
        /// All.
        Widest,
    }

    thread_local! {
        pub(super) static ALLOWED: Cell<Allowed> = const { Cell::new(Allowed::Widest) };
    }

    #[test]
    fn results_are_identical_for_all_registers_and_equal_to_rounding_without() {
        let stiffening = Effects {
            strain_stiffening: Some(Stiffening::Gent(Gent {
                jm: deaflow_base::Decimal::from_f64(100.0).unwrap(),
            })),
            wrinkling: Some(On {}),
            ..Effects::default()
        };
        // A checkerboard whose rows end within a register.
        let active: Vec<u8> = (0..CELLS * CELLS)
            .map(|i| u8::from((i % CELLS / 3 + i / CELLS / 4).is_multiple_of(2)))
            .collect();
        let pattern = Pattern::from_cells(Raster::PAPER, &active).unwrap();
        let fringe = Effects {
            fringe_field: Some(On {}),
            ..Effects::default()
        };
        // Squares that rest at f = I, equal rectangles that rest at other f, and elements of several sizes.
        let mut scenes = [Effects::default(), stiffening, fringe]
            .map(|effects| Scene::vhb4910().with_effects(effects))
            .to_vec();
        let mut uneven = scenes[1].clone();
        uneven.geometry.prestretch.0[0] = deaflow_base::Decimal::from_f64(3.2).unwrap();
        scenes.push(uneven);
        for scene in scenes {
            for mesh in [
                Mesh::new(1, Order::Bilinear),
                Mesh::new(3, Order::Bilinear),
                Mesh::biquadratic(1),
            ] {
                let solver = MembraneSolver::new(&scene, SolveOptions::on(mesh)).unwrap();
                let [wide, narrow, scalar] = [Allowed::Widest, Allowed::Narrow, Allowed::Scalar].map(|allowed| {
                    ALLOWED.set(allowed);
                    solver.solve(&pattern)
                });
                ALLOWED.set(Allowed::Widest);
                assert!(wide.outcome.is_converged());
                assert_eq!(wide.displacement, narrow.displacement);
                assert_eq!(wide.krylov_iterations, narrow.krylov_iterations);
                let pairs = || wide.displacement.iter().zip(&scalar.displacement);
                let largest = pairs().fold(0.0, |largest: f64, (u, _)| largest.max(u.abs()));
                let worst = pairs().fold(0.0, |worst: f64, (a, b)| worst.max((a - b).abs()));
                assert!(worst > 0.0 && worst < 1e-8 * largest, "{worst:e} of {largest:e}");
            }
        }
    }
}
