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
mod tests;
