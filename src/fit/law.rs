//! Hyperelastic laws: nominal stress, its derivatives with respect to the parameters, and the curvature of the energy.
//!
//! The definitions are those of scenes (`deaflow-scene`, `effects/laws`). With ψᵢ = ∂W/∂Iᵢ and λ₃ = 1/λ₁λ₂,
//!
//! ```text
//! P₁ = 2(λ₁ − λ₃²/λ₁)(ψ₁ + λ₂²ψ₂)                     laws of the invariants
//! P₁ = Σ 2gₚ(λ₁^αₚ − λ₃^αₚ)/(αₚλ₁),   gₚ = ½μₚαₚ       Ogden
//! ```
//!
//! A term of Ogden's law is written with its part g of the shear modulus, which stays finite as α → 0.

use crate::deformation::Test;

/// A law without its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LawKind {
    /// Neo-Hookean: the base model.
    NeoHookean,
    /// Gent.
    Gent,
    /// Yeoh.
    Yeoh,
    /// Mooney–Rivlin.
    MooneyRivlin,
    /// Arruda–Boyce.
    ArrudaBoyce,
    /// Ogden with a number of terms.
    Ogden(usize),
}

/// A term of Ogden's law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OgdenTerm {
    /// g = ½μα, the part of the term in the shear modulus, in Pa.
    pub shear_modulus: f64,
    /// The exponent α.
    pub alpha: f64,
}

impl OgdenTerm {
    /// Returns the modulus μ = 2g/α in Pa, as scenes have it; infinite at α = 0.
    #[must_use]
    pub fn mu(self) -> f64 {
        2.0 * self.shear_modulus / self.alpha
    }
}

/// A law with its values; moduli in Pa.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "the fields are the parameters of scenes")]
pub enum Law {
    /// W = ½μ(I₁ − 3).
    NeoHookean { shear_modulus: f64 },
    /// W = −½μ Jm ln(1 − (I₁ − 3)/Jm).
    Gent { shear_modulus: f64, jm: f64 },
    /// W = ½μ(I₁ − 3) + C₂(I₁ − 3)² + C₃(I₁ − 3)³.
    Yeoh { shear_modulus: f64, c2: f64, c3: f64 },
    /// W = (½μ − C₂)(I₁ − 3) + C₂(I₂ − 3).
    MooneyRivlin { shear_modulus: f64, c2: f64 },
    /// Eight chains with Kröger's inverse Langevin function; μ is the network modulus, not the modulus at rest.
    ArrudaBoyce { shear_modulus: f64, locking_stretch: f64 },
    /// W = Σ (μₚ/αₚ)(λ₁^αₚ + λ₂^αₚ + λ₃^αₚ − 3).
    Ogden(Vec<OgdenTerm>),
}

/// Derivatives of an energy of I₁ and I₂, of which the part of I₂ is linear.
struct Invariants {
    /// ψ₁.
    first: f64,
    /// ∂ψ₁/∂I₁.
    curvature: f64,
    /// ψ₂.
    second: f64,
    /// The derivatives of ψ₁ and ψ₂ with respect to each parameter.
    by_parameter: Vec<[f64; 2]>,
}

impl LawKind {
    /// Returns the name of the law in scenes.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NeoHookean => "neo-hookean",
            Self::Gent => "gent",
            Self::Yeoh => "yeoh",
            Self::MooneyRivlin => "mooney-rivlin",
            Self::ArrudaBoyce => "arruda-boyce",
            Self::Ogden(_) => "ogden",
        }
    }

    /// Returns the names of the parameters, those of scenes; for Ogden `g_1`, `alpha_1`, `g_2`, …
    #[must_use]
    pub fn parameters(self) -> Vec<String> {
        let names: &[&str] = match self {
            Self::NeoHookean => &["shear_modulus"],
            Self::Gent => &["shear_modulus", "jm"],
            Self::Yeoh => &["shear_modulus", "c2", "c3"],
            Self::MooneyRivlin => &["shear_modulus", "c2"],
            Self::ArrudaBoyce => &["shear_modulus", "locking_stretch"],
            Self::Ogden(terms) => {
                return (1..=terms)
                    .flat_map(|p| [format!("g_{p}"), format!("alpha_{p}")])
                    .collect();
            }
        };
        names.iter().map(|&name| name.to_owned()).collect()
    }

    /// Returns the law with values in the order of [`LawKind::parameters`]; `None` if their number differs.
    #[must_use]
    pub fn with(self, values: &[f64]) -> Option<Law> {
        Some(match (self, values) {
            (Self::NeoHookean, &[shear_modulus]) => Law::NeoHookean { shear_modulus },
            (Self::Gent, &[shear_modulus, jm]) => Law::Gent { shear_modulus, jm },
            (Self::Yeoh, &[shear_modulus, c2, c3]) => Law::Yeoh { shear_modulus, c2, c3 },
            (Self::MooneyRivlin, &[shear_modulus, c2]) => Law::MooneyRivlin { shear_modulus, c2 },
            (Self::ArrudaBoyce, &[shear_modulus, locking_stretch]) => Law::ArrudaBoyce {
                shear_modulus,
                locking_stretch,
            },
            (Self::Ogden(terms), values) if values.len() == 2 * terms => Law::Ogden(
                values
                    .chunks_exact(2)
                    .map(|pair| OgdenTerm {
                        shear_modulus: pair[0],
                        alpha: pair[1],
                    })
                    .collect(),
            ),
            _ => return None,
        })
    }
}

impl Law {
    /// Returns the kind of the law.
    #[must_use]
    pub fn kind(&self) -> LawKind {
        match self {
            Self::NeoHookean { .. } => LawKind::NeoHookean,
            Self::Gent { .. } => LawKind::Gent,
            Self::Yeoh { .. } => LawKind::Yeoh,
            Self::MooneyRivlin { .. } => LawKind::MooneyRivlin,
            Self::ArrudaBoyce { .. } => LawKind::ArrudaBoyce,
            Self::Ogden(terms) => LawKind::Ogden(terms.len()),
        }
    }

    /// Returns the parameters in the order of [`LawKind::parameters`].
    #[must_use]
    pub fn values(&self) -> Vec<f64> {
        match *self {
            Self::NeoHookean { shear_modulus } => vec![shear_modulus],
            Self::Gent { shear_modulus, jm } => vec![shear_modulus, jm],
            Self::Yeoh { shear_modulus, c2, c3 } => vec![shear_modulus, c2, c3],
            Self::MooneyRivlin { shear_modulus, c2 } => vec![shear_modulus, c2],
            Self::ArrudaBoyce {
                shear_modulus,
                locking_stretch,
            } => vec![shear_modulus, locking_stretch],
            Self::Ogden(ref terms) => terms.iter().flat_map(|t| [t.shear_modulus, t.alpha]).collect(),
        }
    }

    /// Returns the parameters with another modulus, for laws of one modulus whose other parameters are no moduli, and
    /// for others with those at zero.
    pub(crate) fn with_modulus(&self, modulus: f64) -> Vec<f64> {
        let mut values = self.values();
        if let Some(first) = values.first_mut() {
            *first = modulus;
        }
        values
    }

    /// Returns the shear modulus of the undeformed elastomer in Pa.
    #[must_use]
    pub fn modulus_at_rest(&self) -> Option<f64> {
        match self {
            Self::Ogden(terms) => Some(terms.iter().map(|term| term.shear_modulus).sum()),
            _ => self.invariants(3.0).map(|w| 2.0 * (w.first + w.second)),
        }
    }

    /// Returns the nominal stress in Pa at a stretch; `None` beyond the limit of extensibility.
    #[must_use]
    pub fn nominal_stress(&self, test: Test, stretch: f64) -> Option<f64> {
        self.stress_and_gradient(test, stretch).map(|(stress, _)| stress)
    }

    /// Returns the nominal stress in Pa at a stretch, and its derivatives with respect to the parameters in the order
    /// of [`LawKind::parameters`]; `None` beyond the limit of extensibility.
    #[must_use]
    pub fn stress_and_gradient(&self, test: Test, stretch: f64) -> Option<(f64, Vec<f64>)> {
        let [first, second, third] = test.squared_stretches(stretch);
        if let Self::Ogden(terms) = self {
            let logarithms = [0.5 * first.ln(), 0.5 * third.ln()];
            let mut stress = 0.0;
            let mut gradient = Vec::with_capacity(2 * terms.len());
            for term in terms {
                let [by_modulus, by_exponent] = power_difference(logarithms, term.alpha).map(|d| 2.0 * d / stretch);
                stress += term.shear_modulus * by_modulus;
                gradient.extend([by_modulus, term.shear_modulus * by_exponent]);
            }
            return Some((stress, gradient));
        }
        let factor = 2.0 * test.shear(stretch);
        let w = self.invariants(first + second + third)?;
        let gradient = w.by_parameter.iter().map(|[a, b]| factor * (a + second * b)).collect();
        Some((factor * (w.first + second * w.second), gradient))
    }

    /// Returns the nominal stresses in Pa along two directions at their stretches; `None` beyond the limit of
    /// extensibility. With λ₃ = 1/λ₁λ₂ free of stress, P₁ = 2(λ₁ − λ₃²/λ₁)(ψ₁ + λ₂²ψ₂), or Σ 2g(λ₁^α − λ₃^α)/(αλ₁) of
    /// Ogden's law.
    #[must_use]
    pub fn nominal_stresses(&self, stretches: [f64; 2]) -> Option<[f64; 2]> {
        let [a, b] = stretches;
        let third = 1.0 / (a * b);
        if let Self::Ogden(terms) = self {
            let along = |stretch: f64| {
                let logarithms = [stretch.ln(), third.ln()];
                let term = |term: &OgdenTerm| term.shear_modulus * power_difference(logarithms, term.alpha)[0];
                terms.iter().map(term).sum::<f64>() * 2.0 / stretch
            };
            return Some([along(a), along(b)]);
        }
        let w = self.invariants(a * a + b * b + third * third)?;
        let along = |own: f64, other: f64| 2.0 * (own - third * third / own) * (w.first + other * other * w.second);
        Some([along(a, b), along(b, a)])
    }

    /// Returns the derivative of the nominal stress with respect to the stretch in Pa; `None` beyond the limit of
    /// extensibility. From nλP = ∂W/∂l with l = ln λ and n loaded directions.
    #[must_use]
    pub fn slope(&self, test: Test, stretch: f64) -> Option<f64> {
        let ([a, b], l) = (test.path(), stretch.ln());
        let [h11, h12, h22] = self.hessian([a * l, b * l])?;
        let loaded = if test == Test::Equibiaxial { 2.0 } else { 1.0 };
        let curvature = (a * a * h11 + 2.0 * a * b * h12 + b * b * h22) / loaded;
        Some((curvature - stretch * self.nominal_stress(test, stretch)?) / (stretch * stretch))
    }

    /// Returns the Hessian of the energy in (ln λ₁, ln λ₂) in Pa, as (11, 12, 22); `None` beyond the limit of
    /// extensibility.
    #[must_use]
    pub fn hessian(&self, logarithms: [f64; 2]) -> Option<[f64; 3]> {
        let [l1, l2] = logarithms;
        let l3 = -l1 - l2;
        if let Self::Ogden(terms) = self {
            return Some(terms.iter().fold([0.0; 3], |sum, term| {
                let [a, b, c] = [l1, l2, l3].map(|l| 2.0 * term.shear_modulus * (term.alpha * l).exp());
                [sum[0] + a + c, sum[1] + c, sum[2] + b + c]
            }));
        }
        let [a, b, c] = [l1, l2, l3].map(|l| (2.0 * l).exp());
        let w = self.invariants(a + b + c)?;
        let slope = [2.0 * (a - c), 2.0 * (b - c)];
        let entry =
            |first: f64, second: f64, slopes: f64| 4.0 * (w.first * first + w.second * second) + w.curvature * slopes;
        Some([
            entry(a + c, 1.0 / a + 1.0 / c, slope[0] * slope[0]),
            entry(c, 1.0 / c, slope[0] * slope[1]),
            entry(b + c, 1.0 / b + 1.0 / c, slope[1] * slope[1]),
        ])
    }

    /// Returns the laws with fewer parameters to which this one reduces where a parameter has no influence.
    #[must_use]
    pub(crate) fn reduced(&self) -> Vec<Self> {
        match *self {
            Self::NeoHookean { .. } => Vec::new(),
            Self::Gent { shear_modulus, .. }
            | Self::Yeoh { shear_modulus, .. }
            | Self::MooneyRivlin { shear_modulus, .. }
            | Self::ArrudaBoyce { shear_modulus, .. } => vec![Self::NeoHookean { shear_modulus }],
            Self::Ogden(ref terms) if terms.len() < 2 => Vec::new(),
            Self::Ogden(ref terms) => {
                let without = |p: usize| {
                    let mut fewer = terms.clone();
                    fewer.remove(p);
                    Self::Ogden(fewer)
                };
                let merged = |p: usize| {
                    let mut fewer = terms.clone();
                    let first = fewer.remove(p);
                    let second = fewer[p];
                    let shear_modulus = first.shear_modulus + second.shear_modulus;
                    let moment = first.shear_modulus * first.alpha + second.shear_modulus * second.alpha;
                    let alpha = moment / shear_modulus;
                    fewer[p] = OgdenTerm { shear_modulus, alpha };
                    Self::Ogden(fewer)
                };
                let merged = (0..terms.len() - 1).map(merged);
                (0..terms.len()).map(without).chain(merged).collect()
            }
        }
    }

    /// Returns the derivatives of the energy at I₁; `None` beyond the limit of extensibility, and for Ogden's law.
    fn invariants(&self, i1: f64) -> Option<Invariants> {
        let j = i1 - 3.0;
        let ([first, curvature, second], by_parameter) = match *self {
            Self::NeoHookean { shear_modulus: mu } => ([0.5 * mu, 0.0, 0.0], vec![[0.5, 0.0]]),
            Self::Gent { shear_modulus: mu, jm } => {
                if j >= jm {
                    return None;
                }
                let m = 1.0 / (1.0 - j / jm);
                let by_jm = -0.5 * mu * m * m * j / (jm * jm);
                let energy = [0.5 * mu * m, 0.5 * mu * m * m / jm, 0.0];
                (energy, vec![[0.5 * m, 0.0], [by_jm, 0.0]])
            }
            Self::Yeoh {
                shear_modulus: mu,
                c2,
                c3,
            } => {
                let first = 0.5 * mu + 2.0 * c2 * j + 3.0 * c3 * j * j;
                let by_parameter = vec![[0.5, 0.0], [2.0 * j, 0.0], [3.0 * j * j, 0.0]];
                ([first, 2.0 * c2 + 6.0 * c3 * j, 0.0], by_parameter)
            }
            Self::MooneyRivlin { shear_modulus: mu, c2 } => ([0.5 * mu - c2, 0.0, c2], vec![[0.5, 0.0], [-1.0, 1.0]]),
            Self::ArrudaBoyce {
                shear_modulus: mu,
                locking_stretch,
            } => {
                let scale = 3.0 * locking_stretch * locking_stretch;
                let y = i1 / scale;
                if y >= 1.0 {
                    return None;
                }
                let m = 1.0 / 3.0 - y / 15.0 - 2.0 * y * y / 15.0 + 2.0 / (3.0 * (1.0 - y));
                let slope = -1.0 / 15.0 - 4.0 * y / 15.0 + 2.0 / (3.0 * (1.0 - y) * (1.0 - y));
                let by_locking = -mu * slope * y / locking_stretch;
                let energy = [0.5 * mu * m, 0.5 * mu * slope / scale, 0.0];
                (energy, vec![[0.5 * m, 0.0], [by_locking, 0.0]])
            }
            Self::Ogden(_) => return None,
        };
        Some(Invariants {
            first,
            curvature,
            second,
            by_parameter,
        })
    }
}

/// Returns (e^(αa) − e^(αb))/α and its derivative with respect to α, which are finite at α = 0.
fn power_difference([a, b]: [f64; 2], alpha: f64) -> [f64; 2] {
    let [x, y] = [alpha * a, alpha * b];
    [
        a * exponential_quotient(x) - b * exponential_quotient(y),
        a * a * exponential_quotient_slope(x) - b * b * exponential_quotient_slope(y),
    ]
}

/// Returns (eˣ − 1)/x.
fn exponential_quotient(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { x.exp_m1() / x }
}

/// Returns the derivative of (eˣ − 1)/x, by its series Σ n xⁿ⁻¹/(n + 1)! where the closed form would cancel.
fn exponential_quotient_slope(x: f64) -> f64 {
    if x.abs() > 0.5 {
        return (x.exp() - exponential_quotient(x)) / x;
    }
    let mut term = 0.5;
    let mut sum = term;
    for n in 2..16 {
        let n = f64::from(n);
        term *= x * n / ((n - 1.0) * (n + 1.0));
        sum += term;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::{Law, LawKind, OgdenTerm};
    use crate::Test;

    fn laws() -> [Law; 6] {
        let shear_modulus = 50e3;
        let term = |mu: f64, alpha: f64| OgdenTerm {
            shear_modulus: 0.5e3 * mu * alpha,
            alpha,
        };
        [
            Law::MooneyRivlin { shear_modulus, c2: 3e3 },
            Law::Yeoh {
                shear_modulus,
                c2: -400.0,
                c3: 20.0,
            },
            Law::Gent {
                shear_modulus,
                jm: 60.0,
            },
            Law::ArrudaBoyce {
                shear_modulus,
                locking_stretch: 4.2,
            },
            Law::Ogden(vec![term(60.0, 1.5), term(0.01, 5.0)]),
            Law::NeoHookean { shear_modulus },
        ]
    }

    /// From an independent program, in kPa; uniaxial 2.5, equibiaxial 2, pure shear 2.5.
    #[test]
    fn stresses_agree_with_an_independent_program() {
        let known = [
            [108.576, 133.875, 121.8],
            [106.442622, 88.5454541, 110.2966526],
            [125.4691689, 107.5085324, 131.4624933],
            [127.6722501, 108.9282013, 133.565703],
            [83.18718911, 81.26280886, 89.18734074],
        ];
        let at = [(Test::Uniaxial, 2.5), (Test::Equibiaxial, 2.0), (Test::PureShear, 2.5)];
        for (law, known) in laws().iter().zip(known) {
            for ((test, stretch), known) in at.into_iter().zip(known) {
                let stress = law.nominal_stress(test, stretch).unwrap() / 1e3;
                assert!(
                    (stress / known - 1.0).abs() < 6e-10,
                    "{law:?} {test:?}: {stress}, not {known}"
                );
            }
        }
        // The same by stretches along both directions: one of a uniaxial or pure shear test has none across it.
        for law in &laws() {
            for (test, stretch) in at {
                let [_, across, _] = test.squared_stretches(stretch).map(f64::sqrt);
                let [along, _] = law.nominal_stresses([stretch, across]).unwrap();
                let known = law.nominal_stress(test, stretch).unwrap();
                assert!(
                    (along / known - 1.0).abs() < 1e-12,
                    "{law:?} {test:?}: {along}, not {known}"
                );
            }
        }
        let rest = laws()[3].modulus_at_rest().unwrap();
        assert!((rest / 51792.81611 - 1.0).abs() < 1e-10, "{rest}");
    }

    #[test]
    fn derivatives_agree_with_central_differences() {
        let mut all = laws().to_vec();
        let near_zero = [(30e3, 0.0), (20e3, 1e-7), (5e3, -0.2)];
        all.push(Law::Ogden(
            near_zero
                .map(|(shear_modulus, alpha)| OgdenTerm { shear_modulus, alpha })
                .to_vec(),
        ));
        for law in &all {
            let values = law.values();
            for (test, stretch) in Test::ALL
                .into_iter()
                .flat_map(|test| [(test, 0.7), (test, 1.02), (test, 2.1)])
            {
                let (stress, gradient) = law.stress_and_gradient(test, stretch).unwrap();
                for (index, slope) in gradient.iter().enumerate() {
                    let step = 1e-5 * values[index].abs().max(1.0);
                    let moved = |by: f64| {
                        let mut values = values.clone();
                        values[index] += by;
                        law.kind().with(&values).unwrap().nominal_stress(test, stretch).unwrap()
                    };
                    let difference = (moved(step) - moved(-step)) / (2.0 * step);
                    let tolerance = 1e-8 * slope.abs() + 1e-11 * stress.abs() / step;
                    assert!(
                        (slope - difference).abs() <= tolerance,
                        "{law:?} {test:?} {index}: {slope} {difference}"
                    );
                }
            }
        }
    }

    /// On each path, n P = ∂W/∂ln λ / λ with n = 2 for two loaded directions.
    #[test]
    fn hessians_agree_with_differences_of_the_stress() {
        for law in &laws() {
            for (test, stretch) in Test::ALL.into_iter().flat_map(|test| [(test, 0.7), (test, 2.1)]) {
                let [a, b] = test.path();
                let logarithm = f64::ln(stretch);
                let [h11, h12, h22] = law.hessian([a * logarithm, b * logarithm]).unwrap();
                let curvature = a * a * h11 + 2.0 * a * b * h12 + b * b * h22;
                let loaded = if test == Test::Equibiaxial { 2.0 } else { 1.0 };
                let work = |l: f64| loaded * law.nominal_stress(test, l.exp()).unwrap() * l.exp();
                let difference = (work(logarithm + 1e-5) - work(logarithm - 1e-5)) / 2e-5;
                assert!(
                    (curvature / difference - 1.0).abs() < 1e-8,
                    "{law:?} {test:?}: {curvature} {difference}"
                );
            }
        }
    }

    #[test]
    fn limits_of_extensibility_have_no_stress() {
        let [_, _, gent, arruda_boyce, ..] = laws();
        assert_eq!(gent.nominal_stress(Test::Uniaxial, 8.0), None);
        assert_eq!(arruda_boyce.nominal_stress(Test::Uniaxial, 8.0), None);
        assert_eq!(LawKind::Gent.with(&[1.0]), None);
    }
}
