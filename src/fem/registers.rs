//! Work compiled for several kinds of vector registers, of which the machine at hand takes the widest that it has.
//!
//! Results are the same bits with 256 and with 512 bits: no sum depends on how many numbers a register holds.

use pulp::{Simd, WithSimd};

/// Whether the machine has no vector registers that kernels are compiled for.
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

/// Does work with registers of up to 256 bits.
#[inline]
pub fn dispatch<W: WithSimd>(work: W) -> W::Output {
    if are_scalar() {
        Simd::vectorize(pulp::Scalar::new(), work)
    } else {
        dispatch_vector(work)
    }
}

/// The same where there are vector registers.
///
/// # Panics
/// When [`are_scalar`].
#[inline]
pub fn dispatch_vector<W: WithSimd>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        let simd = pulp::x86::V3::try_new().expect("asked by are_scalar()");
        Simd::vectorize(simd, work)
    }
    #[cfg(not(target_arch = "x86_64"))]
    pulp::Arch::new().dispatch(work)
}

/// As [`dispatch`], with registers of 512 bits where there are: for what most solves wait for, since it is compiled once more.
#[inline]
pub fn dispatch_widest<W: WithSimd>(work: W) -> W::Output {
    if are_scalar() {
        Simd::vectorize(pulp::Scalar::new(), work)
    } else {
        dispatch_widest_vector(work)
    }
}

/// The same where there are vector registers.
///
/// # Panics
/// When [`are_scalar`].
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

    /// What a thread takes of the registers that there are.
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
    fn registers_change_no_bit_and_doing_without_them_only_rounding() {
        let stiffening = Effects {
            strain_stiffening: Some(Stiffening::Gent(Gent {
                jm: deaflow_base::Decimal::from_f64(100.0).unwrap(),
            })),
            wrinkling: Some(On {}),
            ..Effects::default()
        };
        // A checkerboard with a frame, whose rows end within a register.
        let active: Vec<u8> = (0..CELLS * CELLS)
            .map(|i| u8::from((i % CELLS / 3 + i / CELLS / 4).is_multiple_of(2)))
            .collect();
        let pattern = Pattern::from_cells(Raster::PAPER, &active).unwrap();
        let fringe = Effects {
            fringe_field: Some(On {}),
            ..Effects::default()
        };
        // Squares that rest at f = I, elements that are all alike but do not, and elements of many sides.
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
