//! Documents made at random and valid ones that were broken at random: read or refused, and never worse.

use std::path::Path;

use proptest::prelude::*;
use proptest::sample::select;
use proptest::test_runner::RngSeed;

use super::*;

const VALID: &str = "\
version: 1
name: tiny
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm }
  drive: &drive { voltage: 5.25 kV, \"other\": 'it''s' }
stages: # é
  small: { kind: sample, units: [2, 3], count: 60, again: *drive }
  block: |
    text
     more
  ? key
  : - 1e-5
    - ~
";

const TOKENS: [&str; 33] = [
    "[",
    "]",
    "{",
    "}",
    ": ",
    ":",
    "- ",
    "? ",
    "&a ",
    "*a",
    "!!str ",
    "!x",
    "\n",
    "\n  ",
    "\t",
    "\"",
    "'",
    "#",
    "|\n",
    ">-\n",
    "%YAML 1.2\n",
    "---\n",
    "...\n",
    "1e5",
    "0x",
    ".nan",
    "~",
    "é",
    "\u{feff}",
    "<<: ",
    "\\u12",
    ", ",
    "\r\n",
];

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(20),
        ..ProptestConfig::with_cases(cases)
    }
}

/// Reads a text and everything that a refusal could ask of what was read.
fn read(text: &str) {
    match Document::from_text(Path::new("t.yaml"), text) {
        Ok(document) => visit(&document.root, text),
        Err(error) => {
            let span = error.span.unwrap();
            assert!(
                text.get(span.offset()..span.offset() + span.len()).is_some(),
                "{span:?} in {text:?}"
            );
        }
    }
    // The same text may stand on the command line.
    if let Ok(set) = Override::parse(&format!("stages.small.count={text}")) {
        let mut root = Document::from_text(Path::new("t.yaml"), VALID).unwrap().root;
        set.apply(&mut root).unwrap();
    }
}

fn visit(node: &Node, text: &str) {
    assert!(node.place().starts_with("t.yaml:"));
    let (start, length) = node.span;
    assert!(text.get(start..start + length).is_some(), "{:?} in {text:?}", node.span);
    assert!(node.found().len() <= 10 * text.len() + 20);
    let refused = node.fields("it", &["version"]).err();
    assert!(refused.is_none_or(|error| !error.to_string().is_empty()));
    match node.value() {
        NodeValue::List(items) => items.iter().for_each(|item| visit(item, text)),
        NodeValue::Map(entries) => entries.iter().for_each(|(key, value)| {
            visit(key, text);
            visit(value, text);
        }),
        _ => {}
    }
}

proptest! {
    #![proptest_config(config(400))]

    #[test]
    fn random_texts_are_read_or_refused(text in ".{0,200}") {
        read(&text);
    }

    #[test]
    fn random_tokens_are_read_or_refused(tokens in prop::collection::vec(select(&TOKENS[..]), 0..60)) {
        read(&tokens.concat());
    }

    #[test]
    fn broken_documents_are_read_or_refused(
        edits in prop::collection::vec((0..VALID.len(), 0..40usize, select(&TOKENS[..])), 1..5),
    ) {
        let mut text = VALID.to_owned();
        for (at, length, token) in edits {
            let boundary = |at: usize| (0..=at.min(text.len())).rev().find(|&at| text.is_char_boundary(at)).unwrap_or(0);
            let range = boundary(at)..boundary(at + length).max(boundary(at));
            text.replace_range(range, token);
        }
        read(&text);
    }
}

#[test]
fn the_document_that_is_broken_is_whole() {
    let document = Document::from_text(Path::new("t.yaml"), VALID).unwrap();
    visit(&document.root, VALID);
    assert!(
        document
            .root
            .peek("stages")
            .unwrap()
            .peek("small")
            .unwrap()
            .peek("again")
            .is_some()
    );
}
