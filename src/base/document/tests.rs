use std::path::Path;

use super::*;
use crate::quantity::Dimension;

fn parse(text: &str) -> Node {
    Document::from_text(Path::new("t.yaml"), text).unwrap().root
}

fn underlined(error: &InputError) -> String {
    let span = error.span.unwrap();
    let text = error.source_code.as_ref().unwrap().inner();
    text[span.offset()..span.offset() + span.len()].to_owned()
}

#[test]
fn an_unknown_key_is_underlined_and_the_nearest_is_named() {
    let node = parse("a: { colour: red, size: 3 }\n");
    let error = node.peek("a").unwrap().fields("`a`", &["color", "size"]).err().unwrap();
    assert_eq!(underlined(&error), "colour");
    assert!(error.help.as_ref().unwrap().contains("did you mean `color`?"));
    // Another word is as far, and shorter: it is not meant.
    assert_eq!(
        nearest("volt", &["rest", "charge", "voltage", "waveform"]),
        Some("voltage")
    );
    assert_eq!(nearest("volt", &["rest", "charge"]), None);
}

#[test]
fn numbers_keep_their_decimal_text_and_values_their_position() {
    let node = parse("v: 5.250\nw: '7'\nx: [1, 2.5 mm]\n");
    let map = node.fields("it", &["v", "w", "x"]).unwrap();
    let v = map.required("it", "v").unwrap();
    assert_eq!(v.quantity("v", Dimension::Voltage).unwrap().base().to_string(), "5.25");
    assert_eq!(v.position(), "t.yaml:1");
    assert!(
        map.required("it", "w").unwrap().integer("w", 0, 9).is_err(),
        "a quoted 7 is a text"
    );
    let error = map.required("it", "x").unwrap().list("x").unwrap()[1]
        .quantity("x", Dimension::Voltage)
        .unwrap_err();
    assert_eq!(underlined(&error), "2.5 mm");
}

#[test]
fn overrides_replace_and_add_and_are_quoted_in_errors() {
    let mut node = parse("stages:\n  small: { count: 300 }\n");
    Override::parse("stages.small.count=400")
        .unwrap()
        .apply(&mut node)
        .unwrap();
    Override::parse("stages.small.seed=-1")
        .unwrap()
        .apply(&mut node)
        .unwrap();
    let small = node.peek("stages").unwrap().peek("small").unwrap();
    assert_eq!(small.peek("count").unwrap().integer("count", 1, 1000).unwrap(), 400);
    let error = small.peek("seed").unwrap().integer("seed", 0, u64::MAX).unwrap_err();
    assert_eq!(underlined(&error), "-1");
    assert_eq!(error.source_code.unwrap().name(), "--set stages.small.seed");
    let missing = Override::parse("stages.smal.count=4")
        .unwrap()
        .apply(&mut node)
        .unwrap_err();
    assert!(missing.help.unwrap().contains("small"));
}

#[test]
fn an_override_creates_missing_parts_of_a_scene_but_not_what_looks_misspelt() {
    let scene = "geometry: { side: 50 mm }\n";
    let apply = |node: &mut Node, set: Override| set.apply(node).map_err(|error| error.to_string());
    let has_density = |scene: &Node| {
        let part = scene.peek("properties");
        part.is_some_and(|part| part.peek("density").is_some())
    };
    let mut alone = parse(scene);
    apply(&mut alone, Override::of_scene("properties.density=960").unwrap()).unwrap();
    assert!(has_density(&alone));
    // The length `side` is no part.
    apply(&mut alone, Override::of_scene("geometry.sides.right=free").unwrap()).unwrap();
    let geometry = alone.peek("geometry").unwrap();
    assert_eq!(geometry.written(), "{ side: 50 mm, sides: { right: free } }");
    let misspelt = apply(&mut alone, Override::of_scene("geometri.side=1").unwrap()).unwrap_err();
    assert!(misspelt.contains("no `geometri` in the scene"), "{misspelt}");
    // The scene may have more parts than it has.
    let help = |text: &str| {
        Override::of_scene(text)
            .unwrap()
            .apply(&mut alone.clone())
            .unwrap_err()
            .help
    };
    let expected = "did you mean `geometry`? in the file: geometry, properties";
    assert_eq!(help("geometri.side=1").as_deref(), Some(expected));
    assert_eq!(help("geometry.x.y=null").as_deref(), Some("this value has no parts"));
    let mut pipeline = parse("scene: { geometry: { side: 50 mm } }\nstages: {}\n");
    apply(&mut pipeline, Override::parse("scene.properties.density=960").unwrap()).unwrap();
    assert!(has_density(pipeline.peek("scene").unwrap()));
    // A stage is not created.
    let stage = apply(&mut pipeline, Override::parse("stages.new.count=4").unwrap()).unwrap_err();
    assert!(stage.contains("no `new` in `stages`"), "{stage}");
}

#[test]
fn an_override_replaces_an_item_of_a_list() {
    let mut node = parse("scene:\n  geometry: { prestretch: [3, 2], bodies: [ { load: [1 N, 0 N] } ] }\n");
    let mut set = |text: &str| Override::parse(text).unwrap().apply(&mut node);
    set("scene.geometry.prestretch.1=2.5").unwrap();
    set("scene.geometry.bodies.0.load.0=3 N").unwrap();
    for (text, message, help) in [
        (
            "scene.geometry.prestretch.2=1",
            "`scene.geometry.prestretch` has no item `2`",
            "allowed: 0 to 1",
        ),
        ("scene.geometry.bodies.x.load=1", "has no item `x`", "allowed: 0"),
        (
            "scene.geometry.prestretch.0=null",
            "cannot be removed",
            "write the whole list",
        ),
    ] {
        let error = set(text).unwrap_err();
        assert!(error.to_string().contains(message), "{error}");
        assert_eq!(error.help.as_deref(), Some(help), "{text}");
    }
    let geometry = node.peek("scene").unwrap().peek("geometry").unwrap();
    assert_eq!(
        geometry.written(),
        "{ prestretch: [3, 2.5], bodies: [{ load: [3 N, 0 N] }] }"
    );
}

#[test]
fn an_override_finds_an_item_of_a_list_by_its_name() {
    let text =
        "stages: { d: { targets: [{ name: left, area: 0.3 }, { name: \"7\" }, { name: twin }, { name: twin }] } }";
    let mut node = parse(text);
    let mut set = |text: &str| Override::parse(text).unwrap().apply(&mut node);
    set("stages.d.targets.left.area=0.4").unwrap();
    // A number is that of an item, whatever names are there.
    set("stages.d.targets.1.area=0.5").unwrap();
    for (text, message, help) in [
        (
            "stages.d.targets.lft.area=1",
            "no item of `stages.d.targets` is named `lft`",
            "did you mean `left`? names: left, 7, twin",
        ),
        (
            "stages.d.targets.twin=1",
            "2 items of `stages.d.targets` are named `twin`",
            "names: left, 7, twin, twin; use a number: 2 or 3",
        ),
        (
            "stages.d.targets.7.area=1",
            "`stages.d.targets` has no item `7`",
            "allowed: 0 to 3",
        ),
    ] {
        let error = set(text).unwrap_err();
        assert!(error.to_string().contains(message), "{error}");
        assert_eq!(error.help.as_deref(), Some(help), "{text}");
    }
    let targets = node.peek("stages").unwrap().peek("d").unwrap();
    let written = targets.written();
    assert!(written.contains("{ name: left, area: 0.4 }"), "{written}");
    assert!(written.contains("area: 0.5 }, { name: twin }"), "{written}");
}

#[test]
fn an_item_of_a_list_that_is_not_there_cannot_be_set() {
    let mut node = parse("scene: { geometry: { side: 50 mm } }\n");
    let set = Override::parse("scene.geometry.load.0=1 N").unwrap();
    set.apply(&mut node).unwrap();
    let load = node
        .peek("scene")
        .unwrap()
        .peek("geometry")
        .unwrap()
        .peek("load")
        .unwrap();
    assert_eq!(
        load.list("load").unwrap_err().to_string(),
        "`load` must be a list, found item 0 alone: write the whole list"
    );
}

#[test]
fn a_forgotten_letter_is_likelier_than_a_wrong_one() {
    assert_eq!(nearest("sids", &["side", "size", "sides"]), Some("sides"));
    assert_eq!(nearest("sde", &["side", "size", "sides"]), Some("side"));
    assert_eq!(nearest("sidd", &["side", "size", "sides"]), Some("side"));
}

#[test]
fn an_override_of_null_removes_the_key() {
    let mut node = parse("stages:\n  small: { count: 300, seed: 1 }\n");
    let mut set = |text: &str| Override::parse(text).unwrap().apply(&mut node);
    set("stages.small.seed=null").unwrap();
    let error = set("stages.small.coutn=null").unwrap_err();
    assert_eq!(
        error.to_string(),
        "--set stages.small.coutn: there is no `coutn` to remove"
    );
    assert!(error.help.unwrap().contains("count"));
    let small = node.peek("stages").unwrap().peek("small").unwrap();
    assert!(small.peek("seed").is_none() && small.peek("count").is_some());
}

#[test]
fn invalid_and_malicious_documents_are_rejected_with_a_position() {
    for text in ["a: [1, 2", "a: 1\na: 2\n", "a: &x [*x]\n", "\u{7}", "- a\nb: c", ""] {
        let outcome = Document::from_text(Path::new("t.yaml"), text);
        if let Ok(document) = outcome {
            assert!(document.root.fields("it", &["a"]).is_err(), "{text:?}");
        }
    }
    let error = Document::from_text(Path::new("t.yaml"), "a: 1\nb: é ]\nc: [\n")
        .err()
        .unwrap();
    let span = error.span.unwrap();
    assert!(
        error.source_code.unwrap().inner()[..span.offset()].contains('\n'),
        "the place is not the first line"
    );
    let bomb = "a: &a [x,x,x,x,x,x,x,x,x]\n\
                b: &b [*a,*a,*a,*a,*a,*a,*a,*a,*a]\n\
                c: &c [*b,*b,*b,*b,*b,*b,*b,*b,*b]\n\
                d: &d [*c,*c,*c,*c,*c,*c,*c,*c,*c]\n\
                e: &e [*d,*d,*d,*d,*d,*d,*d,*d,*d]\n\
                f: &f [*e,*e,*e,*e,*e,*e,*e,*e,*e]\n\
                g: [*f,*f,*f,*f,*f,*f,*f,*f,*f]\n";
    assert!(Document::from_text(Path::new("t.yaml"), bomb).is_err());
}

#[test]
fn a_duplicate_key_is_reported_without_advice_for_programmers() {
    let error = Document::from_text(Path::new("t.yaml"), "a: 1\na: 2\n").unwrap_err();
    assert!(error.message.contains("duplicate mapping key: a"), "{}", error.message);
    assert!(!error.message.contains("Policy"), "{}", error.message);
    assert_eq!(underlined(&error), "a");
}

#[test]
fn numbers_have_defaults_and_bounds() {
    let node = parse("a: 0.25\nb: 7\n");
    let map = node.fields("it", &["a", "b"]).unwrap();
    assert_eq!(map.number("a", 0.5, 0.0, 1.0).unwrap().to_string(), "0.25");
    assert_eq!(map.number("c", 0.5, 0.0, 1.0).unwrap().to_string(), "0.5");
    assert!(map.number("b", 0.5, 0.0, 1.0).is_err());
}

#[test]
fn long_words_and_messages_are_clipped() {
    let long = "x".repeat(1 << 20);
    assert_eq!(nearest(&long, &[&"y".repeat(1 << 20)]), None);
    let error = parse("a: 1\n").error(format!("found {long}")).help(long);
    assert!(error.message.starts_with("found xx") && error.message.contains(" … "));
    assert!(error.message.len() < 3000 && error.help.unwrap().len() < 3000);
}

#[test]
fn words_are_booleans_only_where_a_boolean_is_read() {
    let document = Document::from_text(Path::new("x.yaml"), "y: on\nn: No\ntrue: y\n").unwrap();
    let root = document.root;
    assert!(root.peek("y").unwrap().bool("y").unwrap());
    assert!(!root.peek("n").unwrap().bool("n").unwrap());
    assert_eq!(root.peek("y").unwrap().text("y").unwrap(), "on");
    let (_, last) = &root.entries("it").unwrap()[2];
    assert_eq!(last.text("it").unwrap(), "y");
    assert!(last.bool("it").is_err());
}

#[test]
fn a_value_is_shown_as_written() {
    let text = "drive: { voltage: 5.25 kV }\npoint: [25 mm, 2.5 cm]\neffects: {}\n";
    let document = Document::from_text(Path::new("scene"), text).unwrap();
    assert_eq!(
        document.root.written_entries(),
        ["drive: { voltage: 5.25 kV }", "point: [25 mm, 2.5 cm]", "effects: {}"]
    );
}

#[test]
fn numbers_of_many_digits_are_read_and_integers_are_never_rounded() {
    let node =
        parse("a: 5.000000000000000409e-06\nb: \"2.061664879999778677e+01 kV\"\nc: 1e400\nd: 9007199254740993\n");
    let at = |key: &str| node.peek(key).unwrap();
    let volts = |key: &str| at(key).quantity_in(key, Dimension::Voltage, 0.0, 1e6);
    assert_eq!(volts("a").unwrap().base().to_string(), "0.000005");
    assert_eq!(volts("b").unwrap().value(), 20_616.648_799_997_787);
    let far = volts("c").unwrap_err();
    assert_eq!(far.message, "`c` is out of range: found 1e400");
    assert_eq!(far.help.as_deref(), Some("allowed: 0 V to 1000000 V"));
    assert_eq!(at("d").integer("d", 0, u64::MAX).unwrap(), 9_007_199_254_740_993);
    let seeds = parse("a: 9223372036854775807\nb: 92233720368547758070\nc: 1234567890123456789.0\n");
    let seed = |key: &str| seeds.peek(key).unwrap().integer(key, 0, i64::MAX as u64);
    assert_eq!(seed("a").unwrap(), i64::MAX as u64);
    assert!(seed("b").is_err() && seed("c").is_err());
}
