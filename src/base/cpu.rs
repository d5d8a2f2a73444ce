//! The instruction set of the processor. Results depend on it, since the order of sums follows the widest instructions.

use serde::{Deserialize, Serialize};

/// Levels of x86-64 (x86-64 psABI, section 3.1.1). The numerical kernels use v3 if available. They may also use
/// AVX-512, which does not change results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum CpuLevel {
    /// Any processor.
    #[serde(rename = "any")]
    Any,
    /// AVX2 and FMA.
    #[serde(rename = "x86-64-v3")]
    V3,
}

impl CpuLevel {
    /// The names of the levels.
    pub const NAMES: [&'static str; 2] = [Self::Any.name(), Self::V3.name()];

    /// Returns the level with a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Any, Self::V3].into_iter().find(|level| level.name() == name)
    }

    /// The name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Any => "any",
            Self::V3 => "x86-64-v3",
        }
    }

    /// Returns the level of this machine.
    #[must_use]
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let has = std::is_x86_feature_detected!("avx2")
                && std::is_x86_feature_detected!("fma")
                && std::is_x86_feature_detected!("bmi2");
            if has {
                return Self::V3;
            }
        }
        Self::Any
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_serialised_levels_are_equal() {
        for name in CpuLevel::NAMES {
            let level = CpuLevel::from_name(name).unwrap();
            assert_eq!(level.name(), name);
            assert_eq!(serde_json::to_value(level).unwrap(), name);
        }
        assert_eq!(CpuLevel::from_name("x86-64-v4"), None);
        assert!(CpuLevel::Any < CpuLevel::V3);
    }
}
