//! The material of an isotropic potential: stress, tangent and the margins of stability, in closed form.

use super::potential::{
    Invariants, MarginTerms, Potential, Slopes, energy_out_of_line, first_slopes_out_of_line, margin_terms_out_of_line,
    slopes_out_of_line,
};
use super::{MODULI, Margins, MaterialPoint, Rest};
use crate::kinematics::{Tensor, add_scaled, cofactor, conformal_split, contract, deformation};
use crate::lanes::Value;

/// The material of a potential.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Isotropic<P> {
    /// The potential.
    pub potential: P,
    weight: f64,
    largest_load: f64,
}

impl<P: Potential> Isotropic<P> {
    /// Creates the material of a potential.
    #[must_use]
    pub fn new(potential: P) -> Self {
        let rest = potential.slopes(&Invariants::new(0.0, 0.0), 0.0);
        let volumetric = rest.i + rest.ii + 2.0 * rest.ij + rest.jj;
        Self {
            // As in the base model; a stiffer membrane allows a larger weight.
            weight: -(2.0 * potential.load()).min(0.9 * rest.i),
            largest_load: 2.0 * volumetric / potential.softening().max(0.1),
            potential,
        }
    }

    #[inline(always)]
    fn form<V: Value>(f: Tensor<V>, s: &Slopes<V>) -> Form<V> {
        // In principal axes the diagonal of m⊗N is x = m₁N₁, y = m₂N₂; f:(m⊗N) = l₁x + l₂y and c:(m⊗N) = l₂x + l₁y.
        let (conformal, anticonformal) = conformal_split(f);
        let half = conformal.constant(0.5);
        let twice = s.ij + s.ij;
        Form {
            sums: half * conformal * (s.ii + twice + s.jj),
            mixed: half * (conformal * anticonformal).sqrt() * (s.ii - s.jj),
            differences: half * anticonformal * (s.ii - twice + s.jj),
        }
    }

    /// (m⊗N) : ∂²w/∂f² : (m⊗N) = 2φᵢ + Q(x, y), with a quadratic form Q and |x| + |y| ≤ 1: the minimum is 2φᵢ or on an
    /// edge of that square.
    #[inline(always)]
    fn ellipticity_of<V: Value>(q: &Form<V>, terms: &MarginTerms<V>) -> V {
        let equal = smallest_on_edge(q.sums, q.mixed, q.differences);
        let opposite = smallest_on_edge(q.differences, q.mixed, q.sums);
        let MarginTerms {
            slopes,
            bound,
            is_slack,
            ..
        } = *terms;
        let least = slopes.i + equal.min(opposite).min(bound.constant(0.0));
        is_slack.choose(bound, least.min(bound))
    }

    /// In principal axes the tangent splits into the shears, 2φᵢ ± φⱼ, and a two-by-two block of the stretches.
    #[inline(always)]
    fn convexity_of<V: Value>(&self, q: &Form<V>, s: &Slopes<V>) -> V {
        let shift = s.j - s.j.constant(self.weight);
        let (equal, opposite) = (
            s.i + shift + q.sums + q.sums,
            s.i - shift + q.differences + q.differences,
        );
        let half = s.j.constant(0.5);
        let (mean, gap) = (half * (equal + opposite), half * (equal - opposite));
        let off = q.mixed + q.mixed;
        let block = mean - gap.madd(gap, off * off).sqrt();
        block.min(s.i - shift.max(-shift))
    }
}

/// 4φᵢᵢ(f:d)² + 4φᵢⱼ(f:d)(c:d) + φⱼⱼ(c:d)² for d = diag(x, y) in principal axes, in x + y and x − y.
struct Form<V> {
    sums: V,
    mixed: V,
    differences: V,
}

/// Returns the minimum of a + 2b t + c t² with |t| ≤ 1.
#[inline(always)]
fn smallest_on_edge<V: Value>(a: V, b: V, c: V) -> V {
    let size = b.max(-b);
    let t = (size * c.max(c.constant(1e-30)).recip()).min(c.constant(1.0));
    let inside = (c * t - (size + size)).madd(t, a);
    inside.min(a - (size + size) + c)
}

impl<P: Potential> MaterialPoint for Isotropic<P> {
    const SEVERAL_BRANCHES: bool = P::SEVERAL_BRANCHES;
    const WRINKLES: bool = P::WRINKLES;
    const STORES_MODULI: bool = true;

    #[inline(always)]
    fn energy<V: Value>(&self, f: Tensor<V>, active: V) -> V {
        energy_out_of_line(&self.potential, &Invariants::of(displacement(f)), active)
    }

    #[inline(always)]
    fn stress<V: Value>(&self, gradient: Tensor<V>, active: V) -> Tensor<V> {
        // 2φᵢ(I + ∇u) + φⱼ(I + cof ∇u), minus the self-stress.
        let [pressure, i, j] = first_slopes_out_of_line(&self.potential, &Invariants::of(gradient), active);
        let c = cofactor(gradient);
        [
            [
                i.madd(gradient[0][0], j.madd(c[0][0], pressure)),
                i.madd(gradient[0][1], j * c[0][1]),
            ],
            [
                i.madd(gradient[1][0], j * c[1][0]),
                i.madd(gradient[1][1], j.madd(c[1][1], pressure)),
            ],
        ]
    }

    #[inline(always)]
    fn tangent<V: Value>(&self, gradient: Tensor<V>, active: V, df: Tensor<V>) -> Tensor<V> {
        tangent_from(gradient, self.moduli(gradient, active), df)
    }

    #[inline(always)]
    fn moduli<V: Value>(&self, gradient: Tensor<V>, active: V) -> [V; MODULI] {
        let s = slopes_out_of_line(&self.potential, &Invariants::of(gradient), active);
        [s.i, s.j, s.ii, s.ij, s.jj]
    }

    fn self_stress(&self, f: Tensor<f64>) -> Tensor<f64> {
        let Rest { i, j } = self.potential.rest();
        let c = cofactor(f);
        [[j * c[0][0] + i, j * c[0][1]], [j * c[1][0], j * c[1][1] + i]]
    }

    #[inline(always)]
    fn admissible<V: Value>(&self, gradient: Tensor<V>) -> V {
        self.potential.admissible(&Invariants::of(gradient))
    }

    fn load(&self) -> f64 {
        self.potential.load()
    }

    fn largest_load(&self) -> f64 {
        self.largest_load
    }

    #[inline(always)]
    fn margins<V: Value>(&self, f: Tensor<V>, active: V) -> Margins<V> {
        let terms = margin_terms_out_of_line(&self.potential, &Invariants::of(displacement(f)), active);
        let q = Self::form(f, &terms.slopes);
        Margins {
            ellipticity: Self::ellipticity_of(&q, &terms),
            convexity: self.convexity_of(&q, &terms.slopes),
            tension: terms.tension,
        }
    }
}

/// Returns the tangent along `df` of any isotropic potential from its moduli at a point.
#[inline(always)]
pub fn tangent_from<V: Value>(gradient: Tensor<V>, moduli: [V; MODULI], df: Tensor<V>) -> Tensor<V> {
    let [i, j, ii, ij, jj] = moduli;
    let f = deformation(gradient);
    let (c, dc) = (cofactor(f), cofactor(df));
    let (along, across) = (contract(f, df), contract(c, df));
    let (first, second) = (ii.madd(along, ij * across), ij.madd(along, jj * across));
    let zero = along.constant(0.0);
    let direct = add_scaled(add_scaled([[zero; 2]; 2], i, df), j, dc);
    add_scaled(add_scaled(direct, first, f), second, c)
}

/// ∇u = f − I.
#[inline(always)]
fn displacement<V: Value>(f: Tensor<V>) -> Tensor<V> {
    let one = f[0][0].constant(1.0);
    [[f[0][0] - one, f[0][1]], [f[1][0], f[1][1] - one]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::{Compound, Decaying, NeoHookeanEnergy, Ogden, Stiff, Stiffened};
    use deaflow_base::Decimal;
    use deaflow_linalg::{Mat, eigen};
    use deaflow_scene::laws::{ArrudaBoyce, Gent, StiffeningLaw};

    fn decimal(value: f64) -> Decimal {
        Decimal::from_f64(value).unwrap()
    }

    fn stiffened(law: &dyn StiffeningLaw) -> Stiffened {
        Stiffened::new(&law.form(1.0), 3.0).unwrap()
    }

    /// Materials of three laws with electrodes.
    fn materials(kappa: f64) -> [Isotropic<Compound<Stiffened>>; 3] {
        let elastic = [
            stiffened(&Gent { jm: decimal(25.0) }),
            stiffened(&ArrudaBoyce {
                locking_stretch: decimal(3.5),
            }),
            Stiffened::Stretches(Ogden::new(&[(1.0, 1.3), (0.01, 4.0), (-0.1, -2.0)], 3.0)),
        ];
        elastic.map(|e| Isotropic::new(Compound::new(3.0, e, Decaying::ideal(3.0, kappa), Stiff { ratio: 0.1 })))
    }

    fn gradients() -> [Tensor<f64>; 4] {
        [
            [[0.12, 0.07], [-0.11, -0.07]],
            [[0.0; 2]; 2],
            [[0.2, 0.1], [0.1, -0.3]],
            [[-0.2, 0.0], [0.0, -0.2]],
        ]
    }

    #[test]
    fn ellipticity_is_the_smallest_acoustic_eigenvalue() {
        for (material, gradient) in [0.02, 0.12, 0.3]
            .iter()
            .flat_map(|&k| materials(k))
            .flat_map(|l| gradients().map(|g| (l, g)))
        {
            let mut smallest = f64::INFINITY;
            for (m, n) in (0..180 * 180).map(|i| (f64::from(i / 180), f64::from(i % 180))) {
                let (sm, cm) = m.to_radians().sin_cos();
                let (sn, cn) = n.to_radians().sin_cos();
                let d = [[cm * cn, cm * sn], [sm * cn, sm * sn]];
                smallest = smallest.min(contract(d, material.tangent(gradient, 1.0, d)));
            }
            let found = material.ellipticity(deformation(gradient), 1.0);
            assert!(
                found < smallest + 1e-9 && smallest < found + 3e-3 * (1.0 + found.abs()),
                "{found} {smallest}"
            );
        }
    }

    #[test]
    fn convexity_is_the_smallest_eigenvalue_of_the_shifted_tangent() {
        let mut seen = [0, 0];
        for (material, gradient) in [0.01, 0.04, 0.08, 0.2]
            .iter()
            .flat_map(|&k| materials(k))
            .flat_map(|l| gradients().map(|g| (l, g)))
        {
            for active in [0.0, 1.0] {
                let units = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(i, k)| {
                    let mut d = [[0.0; 2]; 2];
                    d[i][k] = 1.0;
                    d
                });
                let shifted = |a: usize, b: usize| {
                    let tangent = contract(units[a], material.tangent(gradient, active, units[b]));
                    tangent - material.weight * contract(units[a], cofactor(units[b]))
                };
                let eigenvalues = eigen(&Mat::from_fn(4, 4, shifted)).unwrap().values;
                let found = material.margins(deformation(gradient), active).convexity;
                assert!(
                    (found - eigenvalues[0]).abs() < 1e-11 * (1.0 + found.abs()),
                    "{found} {eigenvalues:?}"
                );
                seen[usize::from(found > 0.0)] += 1;
            }
        }
        assert!(seen[0] > 5 && seen[1] > 5, "{seen:?}");
    }

    #[test]
    fn margins_equal_those_of_the_base_model() {
        for kappa in [0.0255, 0.1, 0.15] {
            let base = super::super::NeoHookean::new(3.0, kappa);
            let compound = Compound::new(
                3.0,
                NeoHookeanEnergy::new(3.0),
                Decaying::ideal(3.0, kappa),
                Stiff { ratio: 0.0 },
            );
            let material = Isotropic::new(compound);
            assert!((material.largest_load() - base.largest_load()).abs() < 1e-14);
            for f in gradients().map(deformation) {
                assert!((material.ellipticity(f, 1.0) - base.ellipticity(f, 1.0)).abs() < 1e-13);
                assert_eq!(
                    material.margins(f, 1.0).convexity > 0.0,
                    base.margins(f, 1.0).convexity > 0.0
                );
            }
        }
    }
}
