//! What a processor can do, as far as results depend on it: sums are formed in the order that its widest instructions have.

use serde::{Deserialize, Serialize};

/// Levels of x86-64 (x86-64 psABI, section 3.1.1). The numerical kernels use v3 wherever it is there; what
/// they use beyond it, registers of 512 bits, changes no result.
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
    /// The levels in words.
    pub const WORDS: [&'static str; 2] = [Self::Any.word(), Self::V3.word()];

    /// The level of a word.
    #[must_use]
    pub fn of_word(word: &str) -> Option<Self> {
        [Self::Any, Self::V3].into_iter().find(|level| level.word() == word)
    }

    /// In words.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Any => "any",
            Self::V3 => "x86-64-v3",
        }
    }

    /// That of this machine.
    #[must_use]
    pub fn of_this_machine() -> Self {
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
    fn words_and_levels_are_the_same() {
        for word in CpuLevel::WORDS {
            let level = CpuLevel::of_word(word).unwrap();
            assert_eq!(level.word(), word);
            assert_eq!(serde_json::to_value(level).unwrap(), word);
        }
        assert_eq!(CpuLevel::of_word("x86-64-v4"), None);
        assert!(CpuLevel::Any < CpuLevel::V3);
    }
}
