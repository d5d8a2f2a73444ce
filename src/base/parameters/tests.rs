use std::path::Path;

use serde_json::{Value, json};

use crate::{
    Canonical, Decimal, Declared, Document, Fields, InputError, Length, Map, Node, Parameter, Schema, Seed, parameters,
    variants, words,
};

words! {
    /// By what images are made.
    enum Symmetry {
        /// The square's.
        D4 = "d4",
        /// None.
        None = "none",
    }
}

parameters! {
    /// Where the unknowns stand.
    struct Mesh as "a mesh" {
        /// Elements along a cell.
        elements: u64 [1..=8] = 2,
    }
}

parameters! {
    /// All types at once.
    struct All as "a test" {
        /// How many.
        count: u32 [1..=100],
        /// Both ends.
        range: [Length; 2] [0.0..=1e4],
        /// How accurate.
        accuracy: Length [1e-9..=1e3] = "3 um",
        /// Share.
        share: Decimal [0.0..=1.0] = 0.5,
        /// Images.
        symmetry: Symmetry = Symmetry::D4,
        /// Epochs.
        patience: Option<u32> [1..=10],
        /// Sizes.
        sizes: Vec<u64> [(2..=50, 1..=3)] = vec![4],
        /// Numbers.
        seed: Seed,
    }
    include {
        /// The mesh.
        mesh: Mesh,
    }
    rules(distinct)
    check(All::consistent)
}

fn distinct(fields: Fields) -> Fields {
    fields.mutually_exclusive("patience", "share")
}

impl All {
    fn consistent(&self, map: &Map<'_>) -> Result<(), InputError> {
        match map.optional("patience").filter(|_| map.optional("share").is_some()) {
            Some(node) => Err(node.error("`patience` cannot stand beside `share`")),
            None => Ok(()),
        }
    }
}

parameters! {
    /// Nothing to say.
    struct Plain as "plain" {}
}

variants! {
    /// One of two.
    enum Either as "a choice" by "model" {
        "plain" => Plain(Plain),
        "mesh" => Mesh(Mesh),
    }
}

fn node(text: &str) -> Node {
    Document::from_text(Path::new("t"), text).unwrap().root
}

fn read(text: &str) -> Result<All, InputError> {
    All::read_with(&node(text), &["kind"])
}

fn refusal(text: &str) -> String {
    let error = read(text).unwrap_err();
    let help = miette::Diagnostic::help(&error)
        .map(|help| help.to_string())
        .unwrap_or_default();
    format!("{error}; {help}")
}

#[test]
fn one_declaration_reads_and_fills_in_defaults() {
    let all = read("{ kind: x, count: 3, range: [0, 2.5 mm], seed: 7, elements: 4 }").unwrap();
    assert_eq!(
        (all.count, all.accuracy.value(), all.seed, all.mesh.elements),
        (3, 0.003, Seed(7), 4)
    );
    assert_eq!(
        (all.symmetry, all.patience, all.sizes.as_slice()),
        (Symmetry::D4, None, &[4][..])
    );
    assert_eq!(all.range[1].to_string(), "2.5 mm");
    let known: Vec<String> = all
        .to_canonical()
        .leaves()
        .iter()
        .map(|(key, value)| format!("{key}={value}"))
        .collect();
    let expected = "accuracy=0.003 mm,count=3,elements=4,range=[0 mm, 2.5 mm],seed=7,share=0.5,sizes=[4],symmetry=d4";
    assert_eq!(known.join(","), expected);
}

#[test]
fn a_fraction_can_be_in_percent() {
    let base = "count: 3, range: [0, 2 mm], seed: 7";
    let share = |text: &str| read(&format!("{{ {base}, share: {text} }}")).map(|all| all.share.to_string());
    assert_eq!([share("25 %").unwrap(), share("'12.5%'").unwrap()], ["0.25", "0.125"]);
    let said = refusal(&format!("{{ {base}, share: 150 % }}"));
    assert!(
        said.contains("`share` is out of range: found \"150 %\"; allowed: 0 % to 100 %"),
        "{said}"
    );
    assert!(share("x %").is_err() && read(&format!("{{ {base}, accuracy: 25 % }}")).is_err());
}

#[test]
fn errors_name_the_key_and_what_is_allowed() {
    let base = "count: 3, range: [0, 2 mm], seed: 7";
    for (text, said) in [
        ("{ count: 3, seed: 1 }".to_owned(), "`range` is missing in a test"),
        (format!("{{ {base}, patence: 3 }}"), "did you mean `patience`?"),
        (
            "{ count: 101, range: [0, 1], seed: 1 }".to_owned(),
            "`count` must be an integer from 1 to 100, found 101",
        ),
        (
            "{ count: 1, range: [0], seed: 1 }".to_owned(),
            "`range` must have two values, found 1; for example [1 mm, 1 mm]",
        ),
        (format!("{{ {base}, symmetry: d5 }}"), "did you mean `d4`?"),
        (format!("{{ {base}, sizes: [] }}"), "`sizes` is empty; allowed: 1 to 3"),
        (format!("{{ {base}, share: 0.5, patience: 1 }}"), "cannot stand beside"),
        (
            format!("{{ {base}, elements: 9 }}"),
            "`elements` must be an integer from 1 to 8",
        ),
    ] {
        assert!(refusal(&text).contains(said), "{text}: {}", refusal(&text));
    }
}

#[test]
fn the_schema_agrees_with_the_reader() {
    let schema = Value::from(Schema::from(All::fields()));
    assert_eq!(schema["description"], "All types at once.");
    assert_eq!(schema["required"], json!(["count", "range", "seed"]));
    assert_eq!(schema["properties"]["accuracy"]["default"], "0.003 mm");
    assert_eq!(schema["properties"]["sizes"]["default"], json!([4]));
    assert_eq!(schema["properties"]["elements"]["maximum"], 8);
    assert_eq!(schema["properties"]["count"]["description"], "How many.");
    assert_eq!(schema["allOf"][0]["not"]["required"], json!(["patience", "share"]));
}

#[test]
fn a_tag_selects_the_keys() {
    let read = |text: &str| Either::read_with(&node(text), &[]);
    assert_eq!(
        read("{ model: mesh, elements: 3 }").unwrap(),
        Either::Mesh(Mesh { elements: 3 })
    );
    let canonical = read("{ model: plain }").unwrap().canonical().unwrap();
    assert_eq!(canonical, Canonical::map([("model", Canonical::from("plain"))]));
    for (text, said) in [
        (
            "{ model: plain, elements: 3 }",
            "unknown key `elements` with `model: plain`: it belongs to `model: mesh`",
        ),
        ("{ modl: plain }", "unknown key `modl` in a choice"),
        ("{ model: plane }", "`model` cannot be \"plane\""),
        ("{}", "`model` is missing in a choice"),
    ] {
        assert!(read(text).unwrap_err().to_string().contains(said), "{text}");
    }
    // What is missing has its words.
    let missing = read("{}").unwrap_err();
    let help = miette::Diagnostic::help(&missing).map(|help| help.to_string());
    assert_eq!(help.as_deref(), Some("allowed: plain, mesh"));
    let schema = Value::from(Either::schema(&()));
    assert_eq!(schema["anyOf"][1]["properties"]["model"]["const"], "mesh");
}
