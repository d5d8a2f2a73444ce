//! Values as texts and as bytes: what is written is read as the same value.

use std::str::FromStr;

use bolero::check;
use deaflow::base::{ArtifactId, Canonical, Decimal, Digest, Dimension, Quantity, decode, encode};
use deaflow::fem::{Method, SolverParameters};
use deaflow::scene::Effects;

use super::checked::{check_message, checked};
use super::mutate::Seeds;

fn texts(valid: &[&str]) -> Vec<Vec<u8>> {
    valid.iter().map(|text| text.as_bytes().to_vec()).collect()
}

const NUMBERS: &[&str] = &[
    "-",
    "+",
    ".",
    "e",
    "E",
    "1e400",
    "e-400",
    "0",
    "_",
    "nan",
    "inf",
    " ",
    " mm",
    " kV",
    " Pa",
    "µ",
    "°",
    "deg",
    "/",
    "99999999999999999999999999999999999999999",
];

#[test]
fn numbers_and_quantities() {
    let seeds = Seeds::new(
        "quantity",
        texts(&["5.25 kV", "1e-3 mm", "45 kPa", "-0.5", "10 Hz", "30 deg", "2 s"]),
        NUMBERS,
    );
    let read = checked(&seeds, |bytes| {
        let text = String::from_utf8_lossy(bytes);
        match Decimal::from_str(&text) {
            Ok(number) => assert_eq!(Decimal::from_str(&number.to_string()).ok(), Some(number), "{text:?}"),
            Err(error) => check_message(&error.to_string()),
        }
        for dimension in [
            Dimension::Number,
            Dimension::Length,
            Dimension::Voltage,
            Dimension::Stress,
            Dimension::Angle,
        ] {
            match Quantity::parse(&text, dimension) {
                Ok(quantity) => {
                    let written = quantity.to_string();
                    assert_eq!(
                        Quantity::parse(&written, dimension).ok(),
                        Some(quantity),
                        "{text:?} {written:?}"
                    );
                }
                Err(error) => check_message(&error.to_string()),
            }
        }
        true
    });
    check!().with_iterations(2000).for_each(read);
}

#[test]
fn canonical_values() {
    let value = Canonical::map([
        ("number", 7u64.into()),
        ("list", Canonical::List(vec![Canonical::Null, "text".into()])),
        ("map", Canonical::map([("key", Canonical::from(Decimal::from(5)))])),
    ]);
    let seeds = Seeds::new("canonical", [encode(&value).unwrap()], &[]);
    let read = checked(&seeds, |bytes| {
        let read = decode::<Canonical>(bytes);
        if let Ok(value) = &read {
            assert_eq!(&decode::<Canonical>(&encode(value).unwrap()).unwrap(), value);
        }
        read.is_ok()
    });
    check!().with_iterations(1000).for_each(read);
}

#[test]
fn solvers_and_effects() {
    let valid = [
        "{ method: newton, elements_per_cell: 2, order: 1, tolerance: 1e-8 }",
        "{ method: chord:3, elements_per_cell: 1, order: 2 }",
        "{ method: newton, accuracy: 0.02 mm }",
        "{ strain_stiffening: { model: gent, jm: 30.04 }, fringe_field: {} }",
        "{ wrinkling: {} }",
    ];
    let seeds = Seeds::new(
        "solver",
        texts(&valid),
        &[
            "{", "}", ":", ",", "newton", "linear", "chord:", "{}", "1e-9", "~", "[", "\n",
        ],
    );
    let read = checked(&seeds, |bytes| {
        let text = String::from_utf8_lossy(bytes);
        match SolverParameters::from_text(&text) {
            Ok(solver) => {
                let written = solver.canonical([]).to_string();
                assert_eq!(SolverParameters::from_text(&written).ok(), Some(solver), "{written}");
            }
            Err(error) => check_message(&error.to_string()),
        }
        match Effects::from_text(&text) {
            Ok(effects) => assert_eq!(Effects::from_text(&effects.to_text()).ok(), Some(effects)),
            Err(error) => check_message(&error.to_string()),
        }
        if let Ok(method) = Method::from_str(&text) {
            assert_eq!(Method::from_str(&method.to_string()).ok(), Some(method));
        }
        true
    });
    check!().with_iterations(600).for_each(read);
}

#[test]
fn digests() {
    let seeds = Seeds::new(
        "digest",
        [Digest::of(b"x").to_string().into_bytes()],
        &["0", "F", "g", "é", " "],
    );
    let read = checked(&seeds, |bytes| {
        let text = String::from_utf8_lossy(bytes);
        match (Digest::from_str(&text), ArtifactId::from_str(&text)) {
            (Ok(digest), Ok(artifact)) => {
                let written = text.to_ascii_lowercase();
                assert_eq!((digest.to_string(), artifact.to_string()), (written.clone(), written));
            }
            (Err(error), Err(_)) => check_message(&error.to_string()),
            (one, other) => panic!("{text:?}: {one:?} {other:?}"),
        }
        true
    });
    check!().with_iterations(500).for_each(read);
}
