//! A viscous branch at a point that is stretched along the path of a test.
//!
//! A branch is an incompressible neo-Hookean spring of modulus G with a state that follows the strain with the time τ.
//! The laws are those of scenes (`effects: viscoelasticity`), here in principal directions, with C = diag(λᵢ²):
//!
//! ```text
//! linear   Ȧᵢ = (λᵢ⁻² − Aᵢ)/τ                                     P = G(A₁λ₁ − A₃λ₃²/λ₁)
//! finite   ḃᵢ = (βᵢ − (β₁ + β₂ + β₃)/3)/τ,   βᵢ = λᵢ² e^(−bᵢ)       P = G(β₁ − β₃)/λ₁
//! ```
//!
//! bᵢ is the logarithm of the eigenvalue of A⁻¹, which the flow of Reese and Govindjee (Int. J. Solids Struct. 35
//! (1998) 3455) keeps unimodular: b₂ = −b₁ − b₃. So two numbers are the state of either law, and a sudden stretch
//! leaves them as they are.

use crate::deformation::Test;

/// The law by which viscous branches flow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ViscousLaw {
    /// Ȧ = (C⁻¹ − A)/τ.
    #[default]
    Linear,
    /// The flow of Reese and Govindjee.
    Finite,
}

/// The numbers of a state: those of directions 1 and 3.
pub(crate) const STATES: usize = 2;

/// The state of a branch.
pub(crate) type State = [f64; STATES];

/// The rate of a state times τ, with its derivatives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rate {
    pub value: State,
    /// The derivative of each number (first index) with respect to each number of the state.
    pub by_state: [State; STATES],
    pub by_stretch: State,
}

/// The nominal stress for the modulus 1, with its derivatives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stress {
    pub value: f64,
    pub by_state: State,
    pub by_stretch: f64,
}

/// Returns how the logarithms of λ₁, λ₂ and λ₃ follow that of λ.
fn powers(test: Test) -> [f64; 3] {
    let [first, second] = test.path();
    [first, second, -first - second]
}

impl ViscousLaw {
    /// Returns the state of a branch that has relaxed at a stretch.
    pub(crate) fn relaxed(self, test: Test, stretch: f64) -> State {
        let [first, _, third] = powers(test);
        match self {
            Self::Linear => [first, third].map(|power| stretch.powf(-2.0 * power)),
            Self::Finite => [first, third].map(|power| 2.0 * power * stretch.ln()),
        }
    }

    /// Returns the rate of a state at a stretch, times τ.
    pub(crate) fn rate(self, test: Test, stretch: f64, state: State) -> Rate {
        let [first, second, third] = powers(test);
        match self {
            Self::Linear => {
                let relaxed = self.relaxed(test, stretch);
                Rate {
                    value: [relaxed[0] - state[0], relaxed[1] - state[1]],
                    by_state: [[-1.0, 0.0], [0.0, -1.0]],
                    by_stretch: [-2.0 * first * relaxed[0] / stretch, -2.0 * third * relaxed[1] / stretch],
                }
            }
            Self::Finite => {
                let [one, three] = elastic(test, stretch, state);
                let two = stretch.powf(2.0 * second) * (state[0] + state[1]).exp();
                let mean = (one + two + three) / 3.0;
                let mean_by_state = [(two - one) / 3.0, (two - three) / 3.0];
                let slopes = [first * one, second * two, third * three].map(|slope| 2.0 * slope / stretch);
                let mean_by_stretch = slopes.iter().sum::<f64>() / 3.0;
                Rate {
                    value: [one - mean, three - mean],
                    by_state: [
                        [-one - mean_by_state[0], -mean_by_state[1]],
                        [-mean_by_state[0], -three - mean_by_state[1]],
                    ],
                    by_stretch: [slopes[0] - mean_by_stretch, slopes[2] - mean_by_stretch],
                }
            }
        }
    }

    /// Returns the nominal stress of a branch with the modulus 1.
    pub(crate) fn stress(self, test: Test, stretch: f64, state: State) -> Stress {
        let [first, _, third] = powers(test);
        match self {
            Self::Linear => {
                let across = stretch.powf(2.0 * third - 1.0);
                Stress {
                    value: state[0] * stretch - state[1] * across,
                    by_state: [stretch, -across],
                    by_stretch: state[0] - (2.0 * third - 1.0) * state[1] * across / stretch,
                }
            }
            Self::Finite => {
                let [one, three] = elastic(test, stretch, state);
                let value = (one - three) / stretch;
                Stress {
                    value,
                    by_state: [-one / stretch, three / stretch],
                    by_stretch: (2.0 * (first * one - third * three) / stretch - value) / stretch,
                }
            }
        }
    }
}

/// Returns the squares β₁ and β₃ of the elastic stretches of the finite law.
fn elastic(test: Test, stretch: f64, state: State) -> State {
    let [first, _, third] = powers(test);
    [
        stretch.powf(2.0 * first) * (-state[0]).exp(),
        stretch.powf(2.0 * third) * (-state[1]).exp(),
    ]
}

#[cfg(test)]
mod tests {
    use super::{STATES, ViscousLaw};
    use crate::Test;

    const LAWS: [ViscousLaw; 2] = [ViscousLaw::Linear, ViscousLaw::Finite];

    fn near(found: f64, known: f64) {
        assert!(
            (found - known).abs() <= 1e-8 * known.abs().max(1.0),
            "{found}, not {known}"
        );
    }

    #[test]
    fn derivatives_agree_with_central_differences() {
        let (stretch, state, step) = (1.7, [0.6, 0.3], 1e-6);
        for (law, test) in LAWS.into_iter().flat_map(|law| Test::ALL.map(|test| (law, test))) {
            let (rate, stress) = (law.rate(test, stretch, state), law.stress(test, stretch, state));
            let moved = |by: f64| {
                (
                    law.rate(test, stretch + by, state).value,
                    law.stress(test, stretch + by, state).value,
                )
            };
            let (ahead, behind) = (moved(step), moved(-step));
            near(stress.by_stretch, (ahead.1 - behind.1) / (2.0 * step));
            for i in 0..STATES {
                near(rate.by_stretch[i], (ahead.0[i] - behind.0[i]) / (2.0 * step));
                let moved = |by: f64| {
                    let mut state = state;
                    state[i] += by;
                    (
                        law.rate(test, stretch, state).value,
                        law.stress(test, stretch, state).value,
                    )
                };
                let (ahead, behind) = (moved(step), moved(-step));
                near(stress.by_state[i], (ahead.1 - behind.1) / (2.0 * step));
                for j in 0..STATES {
                    near(rate.by_state[j][i], (ahead.0[j] - behind.0[j]) / (2.0 * step));
                }
            }
        }
    }

    /// A relaxed branch has no stress and does not flow; a sudden stretch is that of the spring in both laws.
    #[test]
    fn branches_are_springs_at_first_and_carry_nothing_when_relaxed() {
        for (law, test) in LAWS.into_iter().flat_map(|law| Test::ALL.map(|test| (law, test))) {
            let relaxed = law.relaxed(test, 2.3);
            near(law.stress(test, 2.3, relaxed).value, 0.0);
            assert!(law.rate(test, 2.3, relaxed).value.iter().all(|rate| rate.abs() < 1e-14));
            near(law.stress(test, 2.3, law.relaxed(test, 1.0)).value, test.shear(2.3));
        }
    }

    /// At small strains both laws flow alike.
    #[test]
    fn both_laws_agree_at_small_strains() {
        for test in Test::ALL {
            let [linear, finite] = LAWS.map(|law| {
                let state = law.relaxed(test, 1.0);
                let rate = law.rate(test, 1.0 + 1e-5, state).value;
                law.stress(test, 1.0 + 1e-5, state)
                    .by_state
                    .iter()
                    .zip(rate)
                    .map(|(s, r)| s * r)
                    .sum::<f64>()
            });
            assert!((linear / finite - 1.0).abs() < 1e-4, "{test:?}: {linear} {finite}");
        }
    }
}
