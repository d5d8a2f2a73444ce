//! The independent validator: the package `jsonschema` of Python.

use std::io::Write;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use super::documents::Kind;

const CHECK: &str = r#"
import sys, json
from jsonschema import Draft202012Validator as Validator
given = json.load(sys.stdin)
validators = {}
for name, schema in given["schemas"].items():
    Validator.check_schema(schema)
    validators[name] = Validator(schema)
print(json.dumps([validators[name].is_valid(document) for name, document in given["cases"]]))
"#;

fn python() -> &'static str {
    let has_it = |python: &&str| {
        let tried = Command::new(python).args(["-c", "import jsonschema"]).output();
        tried.is_ok_and(|output| output.status.success())
    };
    let known = ["/usr/bin/python3", "python3"].into_iter().find(has_it);
    known.expect("no python3 with jsonschema: `make test` installs it")
}

/// Whether each document is valid.
pub fn verdicts(cases: &[(Kind, Value)]) -> Vec<bool> {
    let cases: Vec<Value> = cases
        .iter()
        .map(|(kind, document)| json!([kind.file(), document]))
        .collect();
    let schemas = [Kind::Pipeline, Kind::Scene].map(|kind| (kind.file().to_owned(), kind.schema()));
    let given = json!({ "schemas": Value::from_iter(schemas), "cases": cases });
    let mut child = Command::new(python())
        .args(["-c", CHECK])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child
        .stdin
        .take()
        .unwrap()
        .write_all(given.to_string().as_bytes())
        .unwrap();
    let ended = child.wait_with_output().unwrap();
    assert!(ended.status.success(), "the validator failed");
    serde_json::from_slice(&ended.stdout).unwrap()
}
