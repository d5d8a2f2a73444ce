//! Actions and their keys. The key of an action is computed from everything that determines its result.

use serde::{Deserialize, Serialize};

use deaflow_base::{ActionKey, ArtifactId, Canonical, EncodingError, encode};

/// Suffix of the kind of the action of a chunk.
const CHUNK: &str = " chunk";

/// Returns the kind of the stage for the kind of its action or of the action of one of its chunks.
#[must_use]
pub fn stage_kind(action_kind: &str) -> &str {
    action_kind.strip_suffix(CHUNK).unwrap_or(action_kind)
}

/// One piece of work: a stage, or a chunk of one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Action {
    /// Kind of the stage; that of a chunk has a suffix, so that both have different keys.
    pub kind: String,
    /// RECIPE number of the kind.
    pub recipe: u32,
    /// Canonical parameters.
    pub parameters: Canonical,
    /// The input artifacts, in order.
    pub inputs: Vec<ArtifactId>,
}

impl Action {
    /// Returns the action of a stage; `None` if an input is not built yet.
    #[must_use]
    pub fn of_stage(kind: &str, recipe: u32, parameters: &Canonical, inputs: &[Option<ArtifactId>]) -> Option<Self> {
        Some(Self {
            kind: kind.to_owned(),
            recipe,
            parameters: parameters.clone(),
            inputs: inputs.iter().copied().collect::<Option<_>>()?,
        })
    }

    /// Returns the action of a chunk; `None` if an input is not built yet.
    #[must_use]
    pub fn of_chunk(kind: &str, recipe: u32, parameters: &Canonical, inputs: &[Option<ArtifactId>]) -> Option<Self> {
        Self::of_stage(&format!("{kind}{CHUNK}"), recipe, parameters, inputs)
    }

    /// Returns the action key: the BLAKE3 digest of the canonical encoding.
    ///
    /// # Errors
    /// If the parameters are too large to be encoded.
    pub fn key(&self) -> Result<ActionKey, EncodingError> {
        Ok(ActionKey::of(&encode(self)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_key_depends_on_each_part_and_on_no_order_of_writing() {
        let number = |n: u64| Canonical::from(n);
        let a = Canonical::map([("seed", number(1)), ("count", number(300))]);
        let b = Canonical::map([("count", number(300)), ("seed", number(1))]);
        let one = Some(ArtifactId::of(b"1"));
        let two = Some(ArtifactId::of(b"2"));
        let base = Action::of_stage("solve", 1, &a, &[one, two]).unwrap();
        let key = |action: Option<Action>| action.unwrap().key().unwrap();
        assert_eq!(
            key(Some(base.clone())),
            key(Action::of_stage("solve", 1, &b, &[one, two]))
        );
        let others = [
            Action::of_stage("sample", 1, &a, &[one, two]),
            Action::of_stage("solve", 2, &a, &[one, two]),
            Action::of_stage("solve", 1, &number(1), &[one, two]),
            Action::of_stage("solve", 1, &a, &[two, one]),
            Action::of_chunk("solve", 1, &a, &[one, two]),
        ];
        for other in others {
            assert_ne!(key(Some(base.clone())), key(other));
        }
        assert_eq!(Action::of_stage("solve", 1, &a, &[one, None]), None);
    }

    #[test]
    fn the_encoding_is_pinned() {
        // Computed once with this code: a change of the encoding would orphan every store without a word.
        let parameters = Canonical::map([("count", Canonical::from(300u64)), ("family", "bezier".into())]);
        let action = Action::of_stage("sample", 1, &parameters, &[]).unwrap();
        assert_eq!(action.key().unwrap().short(), "e13e4cb12f56");
    }
}
