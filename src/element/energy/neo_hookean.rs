//! The base model: an incompressible neo-Hookean membrane in plane stress, with an ideal dielectric between electrodes.
//!
//! Per undeformed volume W = ½μ(tr FᵀF + J⁻² − 3) − S ½ε(V/H)²J² (Zhao and Suo, Appl. Phys. Lett. 91 (2007) 061921, for
//! the ideal dielectric elastomer). With F = λp f, J = λp² j, per prestretched area and in units of μH:
//!
//! ```text
//! w(f)  = ½ f:f + g(j) − 3/(2λp²),  g(j) = ½ a j⁻² − ½ S b j²,   a = λp⁻⁶, b = κλp², j = det f
//! p     = f + g′ cof f
//! dp    = df + g″ (cof f : df) cof f + g′ cof df
//! ```
//!
//! Without I − a cof f, p is ∇u + (g′ + a) cof f, which is zero at rest without voltage.

use super::{MODULI, Margins, MaterialPoint};
use crate::kinematics::{
    Tensor, add_scaled, cofactor, conformal_split, contract, deformation, determinant, squared_stretches,
};
use crate::lanes::Value;

/// The parameters of the base model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NeoHookean {
    /// a = λp⁻⁶: stiffness against thinning.
    pub thickness: f64,
    /// b = κλp²: electric stress at rest.
    pub pull: f64,
    /// 3/λp²: energy of the undeformed elastomer, times 2.
    undeformed: f64,
}

impl NeoHookean {
    /// Creates the material at prestretch λp and κ = ε(V/H)²/μ.
    #[must_use]
    pub fn new(prestretch: f64, kappa: f64) -> Self {
        Self::of(prestretch.powi(-6), kappa * prestretch * prestretch)
    }

    /// Creates the material of a and b.
    #[must_use]
    pub fn of(thickness: f64, pull: f64) -> Self {
        Self {
            thickness,
            pull,
            undeformed: 3.0 * thickness.cbrt(),
        }
    }

    /// Creates the material without thickness and voltage.
    #[must_use]
    pub const fn without_thickness() -> Self {
        Self {
            thickness: 0.0,
            pull: 0.0,
            undeformed: 0.0,
        }
    }

    /// Returns the material with the additional energy ½γ(tr c + j⁻²), in units of (1 + γ)μH: it has the same form.
    #[must_use]
    pub fn with_unrelaxed(self, gamma: f64) -> Self {
        let scale = 1.0 + gamma;
        Self::of((self.thickness + gamma) / scale, self.pull / scale)
    }

    /// Returns j − 1 without cancellation.
    #[inline(always)]
    fn dilation<V: Value>(gradient: Tensor<V>) -> V {
        gradient[0][0] + gradient[1][1] + determinant(gradient)
    }

    /// Returns g′ + a and g″ from j − 1.
    #[inline(always)]
    fn slopes<V: Value>(&self, dilation: V, active: V) -> (V, V) {
        let one = active.constant(1.0);
        let j = one + dilation;
        let inverse = j.recip();
        let pull = active.constant(-self.pull) * active;
        let cubic = active.constant(self.thickness) * inverse * (inverse * inverse);
        let relief = cubic * dilation * j.madd(j + one, one);
        (pull.madd(j, relief), (active.constant(3.0) * inverse).madd(cubic, pull))
    }

    /// Returns the weight of the null Lagrangian det ∇w in [`Margins::convexity`]. It is the same for active and bare
    /// cells, and was found by trial to be nearly optimal for patterns of both.
    fn null_weight(&self) -> f64 {
        -(2.0 * self.pull).min(0.9)
    }
}

impl MaterialPoint for NeoHookean {
    fn with_unrelaxed(&self, gamma: f64) -> Option<Self> {
        Some(Self::with_unrelaxed(*self, gamma))
    }

    #[inline(always)]
    fn energy<V: Value>(&self, f: Tensor<V>, active: V) -> V {
        let j = determinant(f);
        let inverse = j.recip();
        let thickness = active.constant(self.thickness) * inverse * inverse;
        let electric = active.constant(self.pull) * active * j * j;
        let rest = active.constant(self.undeformed);
        active.constant(0.5) * (contract(f, f) + thickness - electric - rest)
    }

    #[inline(always)]
    fn stress<V: Value>(&self, gradient: Tensor<V>, active: V) -> Tensor<V> {
        let (slope, _) = self.slopes(Self::dilation(gradient), active);
        let c = cofactor(deformation(gradient));
        add_scaled(gradient, slope, c)
    }

    #[inline(always)]
    fn tangent<V: Value>(&self, gradient: Tensor<V>, active: V, df: Tensor<V>) -> Tensor<V> {
        let (slope, curvature) = self.slopes(Self::dilation(gradient), active);
        let (c, dc) = (cofactor(deformation(gradient)), cofactor(df));
        let volumetric = curvature * contract(c, df);
        add_scaled(add_scaled(df, volumetric, c), slope, dc)
    }

    #[inline(always)]
    fn moduli<V: Value>(&self, gradient: Tensor<V>, active: V) -> [V; MODULI] {
        let (slope, curvature) = self.slopes(Self::dilation(gradient), active);
        let number = |value: f64| active.constant(value);
        [number(1.0), slope, number(0.0), number(0.0), curvature]
    }

    /// Exact, because j is a quadratic function of f: φ cof f at the midpoint, with φ = [g(j₁) − g(j₀)]/(j₁ − j₀).
    #[inline(always)]
    fn stress_between<V: Value>(&self, gradient: Tensor<V>, active: V, df: Tensor<V>) -> Tensor<V> {
        let number = |value: f64| active.constant(value);
        let middle = add_scaled(gradient, number(0.5), df);
        let (first, last) = (
            determinant(deformation(gradient)),
            determinant(deformation(add_scaled(gradient, number(1.0), df))),
        );
        let inverse = (first * last).recip();
        let sum = first + last;
        // a − ½a(j₀ + j₁)/(j₀²j₁²) − ½Sb(j₀ + j₁)
        let relief = number(self.thickness) * (number(1.0) - number(0.5) * sum * (inverse * inverse));
        let slope = relief - number(0.5 * self.pull) * active * sum;
        add_scaled(middle, slope, cofactor(deformation(middle)))
    }

    fn self_stress(&self, f: Tensor<f64>) -> Tensor<f64> {
        let c = cofactor(f);
        let entry = |i: usize, k: usize| f64::from(u8::from(i == k)) - self.thickness * c[i][k];
        [[entry(0, 0), entry(0, 1)], [entry(1, 0), entry(1, 1)]]
    }

    fn load(&self) -> f64 {
        self.pull
    }

    fn largest_load(&self) -> f64 {
        2.0 * (1.0 + 3.0 * self.thickness)
    }

    #[inline(always)]
    fn margins<V: Value>(&self, f: Tensor<V>, active: V) -> Margins<V> {
        let (slope, curvature) = self.slopes(determinant(f) - active.constant(1.0), active);
        let (one, curvature) = (active.constant(1.0), curvature.min(active.constant(0.0)));
        let [largest, _] = squared_stretches(f);
        // df : cof df is +|df|² on the conformal part and −|df|² on the other, so the tangent is diag(1 + δ, 1 − δ)
        // plus the rank-one volumetric term. The determinant by Sherman and Morrison gives its sign.
        let shift = slope - active.constant(self.null_weight());
        let (conformal, anticonformal) = conformal_split(f);
        let smallest = (one + shift).min(one - shift);
        let guarded = smallest.max(active.constant(1e-6));
        let (plus, minus) = ((one + shift).max(guarded), (one - shift).max(guarded));
        let flexibility = conformal * plus.recip() + anticonformal * minus.recip();
        Margins {
            // cof(m⊗N) is orthogonal to m⊗N, so only the volumetric part can be negative; its minimum is along the
            // largest stretch.
            ellipticity: curvature.madd(largest, one),
            convexity: smallest.min(curvature.madd(flexibility, one)),
            tension: one,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory;

    const F: Tensor<f64> = [[1.12, 0.07], [-0.11, 0.93]];
    const GRADIENT: Tensor<f64> = [[0.12, 0.07], [-0.11, -0.07]];
    const STEP: f64 = 1e-6;
    const ENTRIES: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 0), (1, 1)];

    fn nudged(i: usize, k: usize, by: f64) -> Tensor<f64> {
        let mut gradient = GRADIENT;
        gradient[i][k] += by;
        gradient
    }

    #[test]
    fn stress_and_tangent_are_derivatives_of_the_energy() {
        for (prestretch, kappa) in [(1.0, 0.1), (3.0, 0.0255), (3.0, 0.1), (6.0, 0.0)] {
            let material = NeoHookean::new(prestretch, kappa);
            for (active, (i, k)) in [0.0, 1.0].into_iter().flat_map(|s| ENTRIES.map(|at| (s, at))) {
                let (up, down) = (nudged(i, k, STEP), nudged(i, k, -STEP));
                let energy = |gradient| material.energy(deformation(gradient), active);
                let slope = (energy(up) - energy(down)) / (2.0 * STEP);
                let piola = material.stress(GRADIENT, active)[i][k] + material.self_stress(F)[i][k];
                assert!((slope - piola).abs() < 1e-8);
                let mut direction = [[0.0; 2]; 2];
                direction[i][k] = 1.0;
                let tangent = material.tangent(GRADIENT, active, direction);
                let (p, m) = (material.stress(up, active), material.stress(down, active));
                for (r, c) in ENTRIES {
                    assert!(((p[r][c] - m[r][c]) / (2.0 * STEP) - tangent[r][c]).abs() < 1e-8);
                }
            }
        }
    }

    #[test]
    fn the_work_of_a_step_is_the_change_of_energy() {
        let material = NeoHookean::new(3.0, 0.0255);
        let changes = [[[0.2, -0.1], [0.07, 0.15]], [[1e-4, 2e-4], [-3e-4, 1e-4]]];
        for (active, df) in [0.0, 1.0].into_iter().flat_map(|s| changes.map(|df| (s, df))) {
            let end = add_scaled(F, 1.0, df);
            let middle = add_scaled(F, 0.5, df);
            let null = contract(material.self_stress(middle), df);
            let change = material.energy(end, active) - material.energy(F, active);
            let own = contract(material.stress_between(GRADIENT, active, df), df) + null;
            assert!((own - change).abs() < 4e-16, "{own} {change}");
            // The default implementation.
            struct Default(NeoHookean);
            impl MaterialPoint for Default {
                fn energy<V: Value>(&self, f: Tensor<V>, active: V) -> V {
                    self.0.energy(f, active)
                }
                fn stress<V: Value>(&self, gradient: Tensor<V>, active: V) -> Tensor<V> {
                    self.0.stress(gradient, active)
                }
                fn tangent<V: Value>(&self, gradient: Tensor<V>, active: V, df: Tensor<V>) -> Tensor<V> {
                    self.0.tangent(gradient, active, df)
                }
                fn moduli<V: Value>(&self, gradient: Tensor<V>, active: V) -> [V; MODULI] {
                    self.0.moduli(gradient, active)
                }
                fn self_stress(&self, f: Tensor<f64>) -> Tensor<f64> {
                    self.0.self_stress(f)
                }
                fn largest_load(&self) -> f64 {
                    self.0.largest_load()
                }
                fn load(&self) -> f64 {
                    self.0.load()
                }
                fn margins<V: Value>(&self, f: Tensor<V>, active: V) -> Margins<V> {
                    self.0.margins(f, active)
                }
            }
            let default = contract(Default(material).stress_between(GRADIENT, active, df), df) + null;
            assert!((default - change).abs() < 1e-15, "{default} {change}");
        }
    }

    #[test]
    fn unrelaxed_branches_give_a_material_of_the_same_form() {
        // A null Lagrangian vanishes along m⊗N.
        let (material, gamma) = (NeoHookean::new(3.0, 0.03), 0.7);
        let slow = material.with_unrelaxed(gamma);
        for (active, angle) in [(0.0, 0.3), (1.0, 0.3), (1.0, 1.9), (0.4, -0.6)] {
            let (m, n) = ([f64::cos(angle), f64::sin(angle)], [0.8, -0.6]);
            let df = m.map(|m| n.map(|n| m * n));
            let of_branches = memory::tangent([gamma, 0.0, gamma, gamma], GRADIENT, df);
            let sum = contract(df, material.tangent(GRADIENT, active, df)) + contract(df, of_branches);
            let own = (1.0 + gamma) * contract(df, slow.tangent(GRADIENT, active, df));
            assert!((sum - own).abs() < 1e-14, "{sum} {own}");
        }
        assert_eq!(material.with_unrelaxed(0.0), material);
    }

    #[test]
    fn moduli_determine_the_tangent_with_and_without_a_memory() {
        let (material, df) = (NeoHookean::new(3.0, 0.03), [[0.2, -0.1], [0.07, 0.15]]);
        let remembered = [0.9, 0.2, 1.3, 0.7];
        let moduli = material.moduli(GRADIENT, 0.6);
        let of_material = material.tangent(GRADIENT, 0.6, df);
        let of_memory = memory::tangent(remembered, GRADIENT, df);
        let both = memory::moduli_with_memory(moduli, remembered, GRADIENT);
        let found = memory::tangent_from(GRADIENT, both, df);
        for (i, k) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            assert!((found[i][k] - of_material[i][k] - of_memory[i][k]).abs() < 1e-15);
        }
    }

    #[test]
    fn energy_is_the_dimensional_one_divided_by_its_scale() {
        // PHYSICS: W = ½μ(tr FᵀF + J⁻² − 3) − ½ε(V/H)²J², over λp² for the prestretched area.
        let (prestretch, kappa) = (3.0_f64, 0.02);
        let scaled = F.map(|row| row.map(|v| prestretch * v));
        let j = determinant(scaled);
        let w = 0.5 * (contract(scaled, scaled) + j.powi(-2) - 3.0) - 0.5 * kappa * j * j;
        let material = NeoHookean::new(prestretch, kappa);
        assert!((material.energy(F, 1.0) - w / (prestretch * prestretch)).abs() < 1e-14);
    }

    #[test]
    fn ellipticity_is_the_smallest_acoustic_eigenvalue() {
        for kappa in [0.0255, 0.1, 0.15] {
            let material = NeoHookean::new(3.0, kappa);
            let mut smallest = f64::INFINITY;
            for m in 0..360 {
                for n in 0..360 {
                    let (sm, cm) = f64::from(m).to_radians().sin_cos();
                    let (sn, cn) = f64::from(n).to_radians().sin_cos();
                    let d = [[cm * cn, cm * sn], [sm * cn, sm * sn]];
                    smallest = smallest.min(contract(d, material.tangent(GRADIENT, 1.0, d)));
                }
            }
            assert!((material.ellipticity(F, 1.0) - smallest).abs() < 1e-3);
        }
    }

    #[test]
    fn uniform_active_membrane_loses_ellipticity_at_the_closed_form_field() {
        // H12: Ē = √(λ⁻² + 3λ⁻⁸) = 0.334018500209 at λp = 3.
        let critical = 0.334_018_500_209_f64.powi(2);
        let identity = [[1.0, 0.0], [0.0, 1.0]];
        let margin = |kappa: f64| NeoHookean::new(3.0, kappa).ellipticity(identity, 1.0);
        assert!(margin(critical * (1.0 - 1e-9)) > 0.0 && margin(critical * (1.0 + 1e-9)) < 0.0);
    }

    #[test]
    fn convexity_implies_a_positive_shifted_tangent() {
        for kappa in [0.01, 0.0255, 0.04, 0.06, 0.09] {
            let material = NeoHookean::new(3.0, kappa);
            for active in [0.0, 1.0] {
                let mut smallest = f64::INFINITY;
                for trial in 0..20_000_i32 {
                    let angle = |k: f64| (f64::from(trial) * k).sin();
                    let d = [[angle(1.0), angle(2.3)], [angle(3.7), angle(5.9)]];
                    let shifted = contract(d, material.tangent(GRADIENT, active, d))
                        - 2.0 * material.null_weight() * determinant(d);
                    smallest = smallest.min(shifted / contract(d, d));
                }
                assert_eq!(
                    material.margins(F, active).convexity > 0.0,
                    smallest > 0.0,
                    "κ = {kappa}, S = {active}"
                );
            }
        }
    }
}
