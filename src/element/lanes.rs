//! The numbers of the element kernels: one number, or a vector register of neighbouring elements.
//!
//! The kernels are written once over [`Value`]. [`Wide`] is a vector register, of a width selected at run time by
//! `pulp`; with `f64` the same formulas serve tests, observables and assembly.
//!
//! Code over `Wide` uses the registers only where it is inlined into the function dispatched by `pulp`. So every
//! function is `inline(always)`, and loops replace closures passed to the standard library. Where that would copy much
//! code into many kernels, [`Value::out_of_line`] compiles it once.

use std::ops::{Add, Mul, Neg, Sub};

use pulp::{Scalar, Simd, WithSimd};

/// Rows of vectors are padded to a multiple of this, the largest number of lanes of any register.
pub const WIDEST: usize = 16;

/// Operations on the numbers of a kernel.
pub trait Value: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self> {
    /// Whether it has single precision, for which shorter series are exact.
    const SINGLE: bool;
    /// Returns a constant of the same kind as `self`.
    fn constant(self, value: f64) -> Self;
    /// self · factor + term.
    fn madd(self, factor: Self, term: Self) -> Self;
    /// 1/x.
    fn recip(self) -> Self;
    /// √x.
    fn sqrt(self) -> Self;
    /// The larger of the two, in each lane.
    fn max(self, other: Self) -> Self;
    /// The smaller of the two, in each lane.
    fn min(self, other: Self) -> Self;
    /// `yes` in the lanes where `self` is positive, `no` in the others.
    fn choose(self, yes: Self, no: Self) -> Self;
    /// Whether any lane is positive.
    fn any_positive(self) -> bool;
    /// Runs `work` compiled for the registers of `self`, for any target of the calling function.
    fn out_of_line<W: WithSimd>(self, work: W) -> W::Output;
}

impl Value for f64 {
    const SINGLE: bool = false;
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn madd(self, factor: Self, term: Self) -> Self {
        self * factor + term
    }
    #[inline(always)]
    fn recip(self) -> Self {
        1.0 / self
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn choose(self, yes: Self, no: Self) -> Self {
        if self > 0.0 { yes } else { no }
    }
    #[inline(always)]
    fn any_positive(self) -> bool {
        self > 0.0
    }
    #[inline(always)]
    fn out_of_line<W: WithSimd>(self, work: W) -> W::Output {
        work.with_simd(Scalar::new())
    }
}

/// A number of a register: `f64` for residuals, `f32` where a few digits are enough.
pub trait Real: Copy + Default + Send + Sync + 'static {
    /// [`Value::SINGLE`].
    const SINGLE: bool;
    /// A register.
    type Register<S: Simd>: Copy;
    /// Numbers in a register.
    fn lanes<S: Simd>() -> usize;
    /// Rounds to the nearest number.
    fn from_f64(value: f64) -> Self;
    /// Converts to `f64` exactly.
    fn to_f64(self) -> f64;
    /// The same number in all lanes.
    fn splat<S: Simd>(simd: S, value: f64) -> Self::Register<S>;
    /// The first numbers of a slice; missing ones are zero.
    fn load<S: Simd>(simd: S, slice: &[Self]) -> Self::Register<S>;
    /// The first numbers of a slice that is at least as long as a register.
    fn load_full<S: Simd>(slice: &[Self]) -> Self::Register<S>;
    /// Writes to the beginning of a slice that is at least as long as a register.
    fn store<S: Simd>(slice: &mut [Self], register: Self::Register<S>);
    /// The smallest lane.
    fn smallest<S: Simd>(simd: S, register: Self::Register<S>) -> f64;
    /// a + b.
    fn add<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// a − b.
    fn sub<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// a · b.
    fn mul<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// a · b + c.
    fn madd<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>, c: Self::Register<S>) -> Self::Register<S>;
    /// −a.
    fn neg<S: Simd>(simd: S, a: Self::Register<S>) -> Self::Register<S>;
    /// a / b.
    fn div<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// √a.
    fn sqrt<S: Simd>(simd: S, a: Self::Register<S>) -> Self::Register<S>;
    /// The larger, lane by lane.
    fn max<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// The smaller, lane by lane.
    fn min<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> Self::Register<S>;
    /// `yes` where `sign` is positive, `no` elsewhere.
    fn choose<S: Simd>(
        simd: S,
        sign: Self::Register<S>,
        yes: Self::Register<S>,
        no: Self::Register<S>,
    ) -> Self::Register<S>;
    /// Whether any lane is positive.
    fn any_positive<S: Simd>(simd: S, sign: Self::Register<S>) -> bool;
}

macro_rules! real {
    ($t:ident, $register:ident, $lanes:ident, $slice:ident, $slice_mut:ident, $splat:ident, $partial:ident,
     $reduce:ident, $largest:ident, $greater:ident, $select:ident, $madd:ident, $neg:ident, $sqrt:ident,
     $($method:ident $with:ident),*) => {
        impl Real for $t {
            const SINGLE: bool = size_of::<$t>() == size_of::<f32>();
            type Register<S: Simd> = S::$register;
            #[inline(always)]
            fn lanes<S: Simd>() -> usize {
                S::$lanes
            }
            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as Self
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn splat<S: Simd>(simd: S, value: f64) -> S::$register {
                simd.$splat(value as Self)
            }
            #[inline(always)]
            fn load<S: Simd>(simd: S, slice: &[Self]) -> S::$register {
                simd.$partial(slice)
            }
            #[inline(always)]
            fn load_full<S: Simd>(slice: &[Self]) -> S::$register {
                S::$slice(&slice[..S::$lanes]).0[0]
            }
            #[inline(always)]
            fn store<S: Simd>(slice: &mut [Self], register: S::$register) {
                S::$slice_mut(&mut slice[..S::$lanes]).0[0] = register;
            }
            #[inline(always)]
            fn smallest<S: Simd>(simd: S, register: S::$register) -> f64 {
                f64::from(simd.$reduce(register))
            }
            #[inline(always)]
            fn madd<S: Simd>(simd: S, a: S::$register, b: S::$register, c: S::$register) -> S::$register {
                simd.$madd(a, b, c)
            }
            #[inline(always)]
            fn neg<S: Simd>(simd: S, a: S::$register) -> S::$register {
                simd.$neg(a)
            }
            #[inline(always)]
            fn sqrt<S: Simd>(simd: S, a: S::$register) -> S::$register {
                simd.$sqrt(a)
            }
            #[inline(always)]
            fn choose<S: Simd>(simd: S, sign: S::$register, yes: S::$register, no: S::$register) -> S::$register {
                simd.$select(simd.$greater(sign, simd.$splat(0.0)), yes, no)
            }
            #[inline(always)]
            fn any_positive<S: Simd>(simd: S, sign: S::$register) -> bool {
                simd.$largest(sign) > 0.0
            }
            $(#[inline(always)]
            fn $method<S: Simd>(simd: S, a: S::$register, b: S::$register) -> S::$register {
                simd.$with(a, b)
            })*
        }
    };
}
real!(
    f64, f64s, F64_LANES, as_simd_f64s, as_mut_simd_f64s, splat_f64s, partial_load_f64s, reduce_min_f64s,
    reduce_max_f64s, greater_than_f64s, select_f64s, mul_add_e_f64s, neg_f64s, sqrt_f64s,
    add add_f64s, sub sub_f64s, mul mul_f64s, div div_f64s, max max_f64s, min min_f64s
);
real!(
    f32, f32s, F32_LANES, as_simd_f32s, as_mut_simd_f32s, splat_f32s, partial_load_f32s, reduce_min_f32s,
    reduce_max_f32s, greater_than_f32s, select_f32s, mul_add_e_f32s, neg_f32s, sqrt_f32s,
    add add_f32s, sub sub_f32s, mul mul_f32s, div div_f32s, max max_f32s, min min_f32s
);

/// A register with the proof that the CPU supports it.
#[derive(Clone, Copy)]
pub struct Wide<S: Simd, T: Real> {
    simd: S,
    register: T::Register<S>,
}

impl<S: Simd, T: Real> Wide<S, T> {
    /// The same number in all lanes.
    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        Self::of(simd, T::splat(simd, value))
    }

    /// The first numbers of a slice that is at least as long as a register.
    #[inline(always)]
    pub fn load(simd: S, slice: &[T]) -> Self {
        Self::of(simd, T::load_full::<S>(slice))
    }

    /// All numbers of a slice shorter than a register, then zeros.
    #[inline(always)]
    pub fn load_part(simd: S, slice: &[T]) -> Self {
        Self::of(simd, T::load(simd, slice))
    }

    /// Writes to the beginning of a slice that is at least as long as a register.
    #[inline(always)]
    pub fn store(self, slice: &mut [T]) {
        T::store::<S>(slice, self.register);
    }

    /// The smallest lane.
    #[inline(always)]
    pub fn smallest(self) -> f64 {
        T::smallest(self.simd, self.register)
    }

    #[inline(always)]
    fn of(simd: S, register: T::Register<S>) -> Self {
        Self { simd, register }
    }
}

macro_rules! wide_operator {
    ($($operator:ident $method:ident),*) => {$(
        impl<S: Simd, T: Real> $operator for Wide<S, T> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self::of(self.simd, T::$method(self.simd, self.register, other.register))
            }
        }
    )*};
}
wide_operator!(Add add, Sub sub, Mul mul);

impl<S: Simd, T: Real> Neg for Wide<S, T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::of(self.simd, T::neg(self.simd, self.register))
    }
}

impl<S: Simd, T: Real> Value for Wide<S, T> {
    const SINGLE: bool = T::SINGLE;
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self::splat(self.simd, value)
    }
    #[inline(always)]
    fn madd(self, factor: Self, term: Self) -> Self {
        let register = T::madd(self.simd, self.register, factor.register, term.register);
        Self::of(self.simd, register)
    }
    #[inline(always)]
    fn recip(self) -> Self {
        let one = T::splat(self.simd, 1.0);
        Self::of(self.simd, T::div(self.simd, one, self.register))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self::of(self.simd, T::sqrt(self.simd, self.register))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::of(self.simd, T::max(self.simd, self.register, other.register))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::of(self.simd, T::min(self.simd, self.register, other.register))
    }
    #[inline(always)]
    fn choose(self, yes: Self, no: Self) -> Self {
        let register = T::choose(self.simd, self.register, yes.register, no.register);
        Self::of(self.simd, register)
    }
    #[inline(always)]
    fn any_positive(self) -> bool {
        T::any_positive(self.simd, self.register)
    }
    #[inline(always)]
    fn out_of_line<W: WithSimd>(self, work: W) -> W::Output {
        self.simd.vectorize(work)
    }
}
