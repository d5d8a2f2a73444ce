//! The independent validator: the crate `jsonschema`.

use std::collections::BTreeMap;

use jsonschema::Validator;
use serde_json::Value;

use super::documents::Kind;

/// Whether each document is valid.
pub fn verdicts(cases: &[(Kind, Value)]) -> Vec<bool> {
    let validator = |kind: Kind| jsonschema::draft202012::new(&kind.schema()).unwrap_or_else(|wrong| panic!("{wrong}"));
    let validators: BTreeMap<&str, Validator> = [Kind::Pipeline, Kind::Scene]
        .map(|kind| (kind.file(), validator(kind)))
        .into();
    cases
        .iter()
        .map(|(kind, document)| validators[kind.file()].is_valid(document))
        .collect()
}
