//! An elastomer of a hyperelastic spring and viscous branches, and the parameters that data about it depend on.

use crate::branch::ViscousLaw;
use crate::curve::FitError;
use crate::law::{Law, LawKind};

/// An elastomer without its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Elastomer {
    /// The law of the spring that remains at equilibrium.
    pub law: LawKind,
    /// The number of viscous branches.
    pub branches: usize,
    /// The law by which they flow.
    pub viscous: ViscousLaw,
}

/// The modulus in Pa and the time in s of a branch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Branch {
    pub modulus: f64,
    pub time: f64,
}

impl Elastomer {
    /// Returns an elastomer without branches.
    #[must_use]
    pub fn elastic(law: LawKind) -> Self {
        Self {
            law,
            branches: 0,
            viscous: ViscousLaw::default(),
        }
    }

    /// Returns the names of the parameters: those of [`LawKind::parameters`], then `branch_modulus_1` in Pa,
    /// `branch_time_1` in s, `branch_modulus_2`, …
    #[must_use]
    pub fn parameters(&self) -> Vec<String> {
        let numbered = |i: usize| [format!("branch_modulus_{i}"), format!("branch_time_{i}")];
        let mut names = self.law.parameters();
        names.extend((1..=self.branches).flat_map(numbered));
        names
    }

    /// Returns the spring and the branches with the values that follow [`Self::parameters`]; more values may follow.
    pub(crate) fn with(&self, values: &[f64]) -> Option<(Law, Vec<Branch>)> {
        let first = self.law.parameters().len();
        let law = self.law.with(values.get(..first)?)?;
        let branches = values.get(first..first + 2 * self.branches)?.chunks_exact(2);
        let branches = branches.map(|pair| Branch {
            modulus: pair[0],
            time: pair[1],
        });
        Some((law, branches.collect()))
    }
}

/// A parameter that a set of data needs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Need {
    pub name: String,
    /// The value if none is given.
    pub default: Option<f64>,
}

impl Need {
    /// Returns parameters without defaults.
    pub fn all(names: Vec<String>) -> Vec<Self> {
        names.into_iter().map(|name| Self { name, default: None }).collect()
    }
}

/// A number that a model returns, and its derivatives with respect to the parameters that the model needs.
pub(crate) type Number = (f64, Vec<f64>);

/// A model of the numbers of a set of data.
pub(crate) trait Response {
    /// Returns the parameters.
    fn needs(&self) -> Vec<Need>;

    /// Returns the numbers at values of the parameters; `None` if there is no state.
    fn respond(&self, values: &[f64]) -> Option<Vec<Number>>;

    /// Returns an error that must end the fit.
    fn failure(&self) -> Option<FitError> {
        None
    }
}
