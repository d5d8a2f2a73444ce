//! What effects that leave the displacement alone say about a solution.

/// One entry for each effect that is on; without such effects nothing is computed and nothing is kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observation {
    /// Dielectric breakdown: the largest E/E_B over the cells; the membrane fails at 1.
    pub breakdown_ratio: Option<f64>,
}

impl Observation {
    /// Whether nothing was observed.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
