//! Work compiled for several kinds of vector registers, of which the machine at hand takes the widest that it has.
//!
//! Results are the same bits with 256 and with 512 bits: no sum depends on how many numbers a register holds.

use pulp::{Simd, WithSimd};

/// Does work with registers of up to 256 bits.
#[inline]
pub fn dispatch<W: WithSimd>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        match pulp::x86::V3::try_new() {
            Some(simd) => Simd::vectorize(simd, work),
            None => Simd::vectorize(pulp::Scalar::new(), work),
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    pulp::Arch::new().dispatch(work)
}

/// The same with registers of 512 bits where there are: for what most solves wait for, since it is compiled once more.
#[inline]
pub fn dispatch_widest<W: WithSimd>(work: W) -> W::Output {
    #[cfg(test)]
    if tests::NARROW.get() {
        return dispatch(work);
    }
    #[cfg(all(target_arch = "x86_64", feature = "avx512"))]
    if let Some(simd) = pulp::x86::V4::try_new() {
        return Simd::vectorize(simd, work);
    }
    dispatch(work)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use deaflow_field::{Mesh, Order};
    use deaflow_pattern::{CELLS, Pattern, Raster};
    use deaflow_scene::laws::Gent;
    use deaflow_scene::{Effects, On, Scene, Stiffening};

    use crate::{MembraneSolver, SolveOptions};

    thread_local! {
        /// Whether this thread does without registers of 512 bits.
        pub(super) static NARROW: Cell<bool> = const { Cell::new(false) };
    }

    #[test]
    fn wider_registers_change_no_bit() {
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
        for effects in [Effects::default(), stiffening] {
            let scene = Scene::vhb4910().with_effects(effects);
            for mesh in [
                Mesh::new(1, Order::Bilinear),
                Mesh::new(3, Order::Bilinear),
                Mesh::biquadratic(1),
            ] {
                let solver = MembraneSolver::new(&scene, SolveOptions::on(mesh)).unwrap();
                let [wide, narrow] = [false, true].map(|narrow| {
                    NARROW.set(narrow);
                    solver.solve(&pattern)
                });
                NARROW.set(false);
                assert!(wide.outcome.is_converged());
                assert_eq!(wide.displacement, narrow.displacement);
                assert_eq!(wide.krylov_iterations, narrow.krylov_iterations);
            }
        }
    }
}
