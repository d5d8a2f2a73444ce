//! Dielectric breakdown: the breakdown strength of the elastomer.

use deaflow_base::{ElectricField, parameters, variants};

variants! {
    /// The field is compared with the breakdown strength of the elastomer.
    pub enum Breakdown as "`dielectric_breakdown`" by "law" {
        "huang" => Huang(HuangStrength),
        "constant" => Constant(ConstantStrength),
    }
}

parameters! {
    /// E_B = 51 H^(−0.25) λ^(0.63) in MV/m with the undeformed thickness H in mm and the equibiaxial stretch λ of equal
    /// area (Huang, Shian, Diebold, Suo, Clarke, Appl. Phys. Lett. 101 (2012) 122905, for VHB 4905 and 4910).
    pub struct HuangStrength as "`law: huang`" {}
}

parameters! {
    /// A constant breakdown strength.
    pub struct ConstantStrength as "`law: constant`" {
        /// The breakdown strength.
        pub field: ElectricField [1.0..=1e12],
    }
}

impl Breakdown {
    /// From this share of the breakdown field on, a pattern is close to breakdown.
    pub const NEAR: f64 = 0.8;

    /// Returns the breakdown strength in V/m for an undeformed thickness in mm and an area stretch J.
    #[must_use]
    pub fn strength(&self, thickness_mm: f64, area_stretch: f64) -> f64 {
        match self {
            Self::Huang(_) => 51e6 * thickness_mm.powf(-0.25) * area_stretch.powf(0.315),
            Self::Constant(constant) => constant.field.value(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn breakdown_follows_the_published_law() {
        // 51 · 0.5^(−0.25) · 5^0.63 MV/m = 51 · 1.189207 · 2.756456
        let field = Breakdown::Huang(HuangStrength {}).strength(0.5, 25.0);
        assert!((field / 167.177_866e6 - 1.0).abs() < 1e-8, "{field}");
    }
}
