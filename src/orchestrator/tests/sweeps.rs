//! Stages that stand for several: which there are, what they need, what is built when there is one more value, and what
//! is refused.

use miette::Diagnostic;

use super::*;

/// Reads the scene's voltage, or which of its needs belong together.
struct Toy {
    name: &'static str,
    reads_scene: bool,
    collects: bool,
}

const TOYS: [Toy; 2] = [
    Toy {
        name: "simulate",
        reads_scene: true,
        collects: false,
    },
    Toy {
        name: "collect",
        reads_scene: false,
        collects: true,
    },
];

/// What it was told, as text.
struct ToyStage(String);

impl Kind for Toy {
    fn name(&self) -> &'static str {
        self.name
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["count", "divide", "sum", "simulate"],
            least: 1,
            most: 5000,
        }
    }

    fn reads_scene(&self) -> bool {
        self.reads_scene
    }

    fn collects(&self) -> bool {
        self.collects
    }

    fn schema(&self) -> Vec<Fields> {
        vec![Fields::new("A toy.")]
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields("a toy stage", &["kind", "needs", "say", "rows", "kinds"])?;
        let said = match (self.collects, scene) {
            (true, _) => rows(map.required("a toy stage", "rows")?),
            (_, Some(scene)) => {
                check_scene(scene)?;
                let voltage = scene.peek("drive").and_then(|drive| drive.peek("voltage"));
                voltage.map_or_else(String::new, Node::found)
            }
            _ => String::new(),
        };
        Ok(Box::new(ToyStage(said)))
    }
}

/// `axis=value, axis=value: stage number, stage number` for each row.
fn rows(node: &Node) -> String {
    let pairs = |node: &Node, between: &str| {
        let entries = node.entries("pairs").unwrap().iter();
        let pair = |(key, value): &(Node, Node)| {
            format!(
                "{}{between}{}",
                key.text("a key").unwrap(),
                value.text("a value").unwrap()
            )
        };
        entries.map(pair).collect::<Vec<_>>().join(", ")
    };
    let row = |row: &Node| {
        let parts = row.list("a row").unwrap();
        format!("{}: {}", pairs(&parts[0], "="), pairs(&parts[1], " "))
    };
    node.list("rows")
        .unwrap()
        .iter()
        .map(row)
        .collect::<Vec<_>>()
        .join("\n")
}

impl Stage for ToyStage {
    fn parameters(&self) -> Canonical {
        Canonical::map([("said", self.0.as_str().into())])
    }

    fn plan(&self, _: &[Input]) -> Plan {
        Plan::Whole { steps: 1 }
    }

    fn build(&self, _: &Job<'_>) -> Result<Object, StageError> {
        Ok(numbers(vec![self.0.len() as u64]))
    }
}

fn laboratory() -> Laboratory {
    let mut lab = Laboratory::new();
    lab.registry
        .kinds
        .extend(TOYS.iter().map(|toy| toy as &'static dyn Kind));
    lab
}

fn shape(pipeline: &Pipeline) -> Vec<String> {
    let name = |&need: &usize| pipeline.stages[need].name.as_str();
    let line = |spec: &StageSpec| {
        let needs: Vec<&str> = spec.needs.iter().map(name).collect();
        format!("{} <- {}", spec.name, needs.join(" ")).trim_end().to_owned()
    };
    pipeline.stages.iter().map(line).collect()
}

fn stages(text: &str) -> Pipeline {
    let text = format!("version: 1\nname: toy\nscene: {{ drive: {{ voltage: 5 }} }}\nstages:\n{text}");
    laboratory().pipeline(&text, &[])
}

fn refusal(text: &str) -> (String, String) {
    let text = format!("version: 1\nname: toy\nscene: {{ drive: {{ voltage: 5 }} }}\nstages:\n{text}");
    refusal_of(&text)
}

fn refusal_of(text: &str) -> (String, String) {
    let document = Document::from_text(Path::new("toy.yaml"), text).unwrap();
    let error = Pipeline::read(document, &[], &laboratory().registry)
        .err()
        .expect("refused");
    let help = Diagnostic::help(&error).map_or_else(String::new, |help| help.to_string());
    (error.to_string(), help)
}

const SWEEP: &str = "
  small:  { kind: count, foreach: { n: [10, 20] }, count: \"${n}\" }
  halved: { kind: divide, needs: [small], foreach: { by: [2, 5] }, by: \"${by}\" }
  total:  { kind: sum, needs: [halved, small] }
  all:    { kind: simulate, needs: [total], gather: true }
";

#[test]
fn axes_multiply_and_go_on_to_what_needs_them_until_they_are_gathered() {
    let pipeline = stages(SWEEP);
    let expected = [
        "small@n=10 <-",
        "small@n=20 <-",
        "halved@by=2,n=10 <- small@n=10",
        "halved@by=2,n=20 <- small@n=20",
        "halved@by=5,n=10 <- small@n=10",
        "halved@by=5,n=20 <- small@n=20",
        "total@by=2,n=10 <- halved@by=2,n=10 small@n=10",
        "total@by=2,n=20 <- halved@by=2,n=20 small@n=20",
        "total@by=5,n=10 <- halved@by=5,n=10 small@n=10",
        "total@by=5,n=20 <- halved@by=5,n=20 small@n=20",
        "all <- total@by=2,n=10 total@by=2,n=20 total@by=5,n=10 total@by=5,n=20",
    ];
    assert_eq!(shape(&pipeline), expected);
    let sweeps: Vec<(&str, usize)> = pipeline
        .sweeps
        .iter()
        .map(|s| (s.name.as_str(), s.stages.len()))
        .collect();
    assert_eq!(sweeps, [("small", 2), ("halved", 4), ("total", 4)]);
    assert_eq!(pipeline.selection(Some("halved")).unwrap().len(), 6);
    assert_eq!(pipeline.selection(Some("halved@by=5,n=10")).unwrap().len(), 2);
}

#[test]
fn one_more_value_builds_one_more_stage_each() {
    let lab = laboratory();
    let text = format!("version: 1\nname: toy\nstages:{SWEEP}").replace("gather: true", "gather: [by, n]");
    let built = |text: &str| -> Vec<String> {
        let (outcome, _) = lab.run_text(text, &[]);
        let built = outcome.stages.iter().filter(|stage| stage.outcome == Outcome::Built);
        built.map(|stage| stage.name.clone()).collect()
    };
    assert_eq!(built(&text).len(), 11);
    assert!(built(&text).is_empty());
    assert_eq!(
        built(&text.replace("[10, 20]", "[20, 10, 30]")),
        [
            "small@n=30",
            "halved@by=2,n=30",
            "halved@by=5,n=30",
            "total@by=2,n=30",
            "total@by=5,n=30",
            "all"
        ]
    );
    // Axes are no part of keys: what the sweep made is there for the plain stage.
    let plain = "version: 1\nname: plain\nstages:\n  few: { kind: count, count: 30 }\n";
    assert!(built(plain).is_empty());
}

#[test]
fn zipped_axes_go_in_step_and_the_first_names_them() {
    let pipeline = stages(
        "
  small: { kind: count, foreach: { zip: { n: [10, 20], from: [1, 1] } }, count: \"${n}\", offset: \"${from}\" }
  more:  { kind: count, foreach: { zip: [{ a: [1, 1], b: [2, 3] }, { c: [7, 8], d: [[1], [2]] }] }, count: \"${c}${b}\" }
  both:  { kind: sum, needs: [small] }
  last:  { kind: sum, needs: [small], gather: [n] }
  large: { kind: count, foreach: { zip: { n: [10, 20], m: [3, 4] } }, count: \"${n}\" }
  late:  { kind: sum, needs: [large], gather: [n] }
",
    );
    assert_eq!(
        shape(&pipeline),
        [
            "small@n=10 <-",
            "small@n=20 <-",
            "more@a=1,b=2,c=7 <-",
            "more@a=1,b=2,c=8 <-",
            "more@a=1,b=3,c=7 <-",
            "more@a=1,b=3,c=8 <-",
            "both@n=10 <- small@n=10",
            "both@n=20 <- small@n=20",
            "last <- small@n=10 small@n=20",
            "large@n=10 <-",
            "large@n=20 <-",
            // The axis that named the steps has ended: the other names them.
            "late@m=3 <- large@n=10",
            "late@m=4 <- large@n=20",
        ]
    );
}

#[test]
fn a_stage_of_its_own_axes_needs_those_of_the_same_values() {
    let pipeline = stages(
        "
  small: { kind: count, foreach: { n: [10, 20, 30] }, count: \"${n}\" }
  large: { kind: count, count: 40 }
  some:  { kind: sum, needs: [small, large], foreach: { n: [30, 10] } }
  one:   { kind: sum, needs: [\"small@n=20\"] }
  which: { kind: sum, foreach: { of: [large, one] }, needs: [\"${of}\"] }
  by:    { kind: simulate, needs: [some], gather: [n] }
",
    );
    assert_eq!(
        shape(&pipeline)[4..],
        [
            "some@n=30 <- small@n=30 large",
            "some@n=10 <- small@n=10 large",
            "one <- small@n=20",
            "which@of=large <- large",
            "which@of=one <- one",
            "by <- some@n=30 some@n=10",
        ]
    );
}

#[test]
fn values_stand_where_they_are_asked_for() {
    let lab = laboratory();
    let text = "
version: 1
name: toy
scene: { drive: { voltage: \"${voltage}\" } }
stages:
  small: { kind: count, count: 10 }
  solved:
    kind: simulate
    needs: [small]
    foreach: { voltage: [3000, 4000] }
    say: [\"$${voltage}\", \"${voltage} V\", { foreach: { k: [1, 2] }, at: \"${k} of ${voltage}\" }]
";
    let pipeline = lab.pipeline(text, &[]);
    let said = |name: &str| pipeline.stage(name).unwrap().stage().parameters().to_string();
    assert!(
        said("solved@voltage=3000").contains("3000"),
        "{}",
        said("solved@voltage=3000")
    );
    assert!(said("solved@voltage=4000").contains("4000"));
    let swept = lab.pipeline(text, &["stages.solved.foreach.voltage=[1, 2, 3]"]);
    assert_eq!(swept.sweeps[0].stages.len(), 3);
    let without = text
        .replace("foreach: { voltage: [3000, 4000] }", "")
        .replace("say:", "#");
    let (why, help) = refusal_of(&without);
    assert_eq!(why, "no axis is named `voltage`");
    assert!(help.contains("foreach: { voltage"), "{help}");
    let misspelt = text.replace("voltage: \"${voltage}\"", "voltage: \"${voltge}\"");
    let (why, help) = refusal_of(&misspelt);
    assert_eq!(why, "no axis is named `voltge`");
    assert_eq!(help, "did you mean `voltage`? available: voltage");
    // The same in a scene in a file.
    let (scene, file) = ("scene.yaml", lab.folder.path().join("toy.yaml"));
    std::fs::write(file.with_file_name(scene), "drive: { voltage: \"${voltge}\" }\n").unwrap();
    let line = text.lines().find(|line| line.starts_with("scene:")).unwrap();
    std::fs::write(&file, text.replace(line, "scene: scene.yaml")).unwrap();
    let error = Pipeline::load(&file, &[], &lab.registry).err().unwrap();
    let help = Diagnostic::help(&error).map(|help| help.to_string());
    assert_eq!(error.to_string(), "no axis is named `voltge`");
    assert_eq!(help.as_deref(), Some("did you mean `voltage`? available: voltage"));
    // Another stage has the axis.
    let other = without.replace("count: 10 }", "count: \"${voltage}\", foreach: { voltage: [1, 2] } }");
    let (why, _) = refusal_of(&other.replace("needs: [small]", ""));
    assert_eq!(why, "the scene has the axis `voltage`, and stage `solved` has not");
}

#[test]
fn a_value_of_nothing_leaves_its_key_out() {
    let pipeline = stages("  small: { kind: count, foreach: { from: [null, 7] }, count: 10, offset: \"${from}\" }\n");
    let said = |name: &str| pipeline.stage(name).unwrap().stage().parameters().to_string();
    assert!(
        said("small@from=none").contains("offset: 0"),
        "{}",
        said("small@from=none")
    );
    assert!(said("small@from=7").contains("offset: 7"));
}

#[test]
fn a_collecting_stage_is_told_what_belongs_together() {
    let pipeline = stages(
        "
  small:  { kind: count, foreach: { n: [10, 20] }, count: \"${n}\" }
  halved: { kind: divide, needs: [small], foreach: { by: [2, 5] }, by: \"${by}\" }
  large:  { kind: count, count: 40 }
  table:  { kind: collect, needs: [halved, large, small] }
",
    );
    let said = pipeline.stage("table").unwrap().stage().parameters().to_string();
    for row in [
        "by=2, n=10: halved 0, large 4, small 5",
        "by=2, n=20: halved 1, large 4, small 6",
        "by=5, n=10: halved 2, large 4, small 5",
        "by=5, n=20: halved 3, large 4, small 6",
    ] {
        assert!(said.contains(row), "{said}");
    }
}

#[test]
fn what_contradicts_itself_is_refused() {
    let many = (0..1001).map(|n| n.to_string()).collect::<Vec<_>>().join(", ");
    let many = format!("  a: {{ kind: count, foreach: {{ n: [{many}] }}, count: \"${{n}}\" }}");
    let axes: String = (0..12)
        .map(|k| format!("a{k}: [1, 2, 3, 4, 5, 6, 7, 8, 9], "))
        .collect();
    let vast = format!("  a: {{ kind: count, foreach: {{ {axes} }}, count: 1 }}");
    for (text, why, advice) in [
        (
            "  a: { kind: count, count: \"${n}\" }",
            "no axis is named `n`",
            "foreach: { n:",
        ),
        (
            "  a: { kind: count, foreach: { count: [1] }, count: \"${cuont}\" }",
            "no axis is named `cuont`",
            "did you mean `count`",
        ),
        (
            "  a: { kind: count, foreach: {}, count: 1 }",
            "has no axis",
            "foreach: {",
        ),
        (
            "  a: { kind: count, foreach: { n: [] }, count: 1 }",
            "at least one value",
            "",
        ),
        (
            "  a: { kind: count, foreach: { n: [1, 1] }, count: 1 }",
            "has this value twice",
            "",
        ),
        (
            "  a: { kind: count, foreach: { zip: { n: [1, 2, 1], m: [3, 3, 3] } }, count: 1 }",
            "`zip` has these values twice: `n=1, m=3`",
            "",
        ),
        (
            "  a: { kind: count, foreach: { zip: { v: [3 kV, 3000 V], m: [3, 3] } }, count: 1 }",
            "`zip` has these values twice: `v=3000V, m=3`",
            "",
        ),
        (
            "  a: { kind: count, foreach: { n: 3 }, count: 1 }",
            "must be a list",
            "",
        ),
        (
            "  a: { kind: count, foreach: { \"a b\": [3] }, count: 1 }",
            "cannot be named",
            "letters",
        ),
        (
            "  a: { kind: count, foreach: { zip: { n: [1, 2], m: [1] } }, count: 1 }",
            "`m` has 1 values, and `n` has 2",
            "as many values",
        ),
        (
            "  a: { kind: count, foreach: { n: [1], zip: { n: [1] } }, count: 1 }",
            "there twice",
            "",
        ),
        (
            "  a: { kind: count, foreach: { n: [\"a/b\", \"a:b\"] }, count: 1 }",
            "stages of one name",
            "zip",
        ),
        (
            "  a: { kind: count, count: 1, rows: [] }\n  b: { kind: sum, needs: [a], gather: true }",
            "unknown key `rows`",
            "",
        ),
        (
            "  a: { kind: count, count: 1, scene: {} }\n  b: { kind: sum, needs: [a], gather: true }",
            "unknown key `scene`",
            "",
        ),
        ("  a: { kind: count, count: 1, scene: {} }", "unknown key `scene`", ""),
        ("  a@b: { kind: count, count: 1 }", "cannot be named \"a@b\"", "letters"),
        (
            "  a: { kind: count, count: 1 }\n  b: { kind: sum, needs: [c], gather: true }",
            "no stage is named `c`",
            "",
        ),
        (
            "  a: { kind: count, foreach: { n: [1] }, count: 1 }\n  b: { kind: sum, needs: [\"a@n=2\"] }",
            "no stage is named `a@n=2`",
            "a@n=1",
        ),
        (
            "  a: { kind: count, foreach: { n: [1] }, count: 1 }\n  b: { kind: sum, needs: [a], foreach: { n: [2] } }",
            "no stage of `a` has the values",
            "",
        ),
        (
            "  a: { kind: count, foreach: { n: [1] }, count: 1 }\n  c: { kind: count, foreach: { n: [2] }, count: 1 \
             }\n  b: { kind: sum, needs: [a, c] }",
            "no values of their axes in common",
            "",
        ),
        (
            "  a: { kind: sum, needs: [b], foreach: { n: [1] } }\n  b: { kind: sum, needs: [a] }",
            "in a cycle: `a` needs `b` needs `a`",
            "",
        ),
        (
            "  a: { kind: count, foreach: { n: [1, 2] }, count: 1 }",
            "the axis `n` of `a` is used nowhere",
            "\"${n}\"",
        ),
        (
            "  a: { kind: count, foreach: { n: [1, 2] }, count: 3 }\n  b: { kind: sum, needs: [a], foreach: { m: [1] } }",
            "the axis `n` of `a` is used nowhere",
            "",
        ),
        (
            "  a: { kind: count, foreach: { n: [1], m: [\"${n}\"] }, count: \"${n}${m}\" }",
            "asks for the axis `n`",
            "stand for themselves",
        ),
        (
            "  a: { kind: count, foreach: { zipp: { n: [1], m: [2] } }, count: \"${n}\" }",
            "`zipp` must be a list of values",
            "`zip`",
        ),
        (
            "  a: { kind: count, foreach: { by: [1] }, count: 1 }\n  b: { kind: sum, needs: [a], gather: [bye] }",
            "nothing that `b` needs has an axis `bye`",
            "did you mean `by`? available: by",
        ),
        (
            "  a: { kind: count, foreach: { n: [1] }, count: \"${n\" }",
            "without `}`",
            "",
        ),
        (&many, "more than 1000 stages", "`--many`"),
        (&vast, "more than 1000 stages", "`--many`"),
    ] {
        let (found, help) = refusal(text);
        assert!(found.contains(why) && help.contains(advice), "{text}\n{found}\n{help}");
    }
}

#[test]
fn more_stages_have_to_be_asked_for() {
    let mut lab = laboratory();
    let values = |n: usize| (1..=n).map(|n| n.to_string()).collect::<Vec<_>>().join(", ");
    let text = |n: usize| {
        format!(
            "version: 1\nname: toy\nstages:\n  a: {{ kind: count, foreach: {{ n: [{}] }}, count: \"${{n}}\" }}\n",
            values(n)
        )
    };
    assert_eq!(lab.pipeline(&text(1000), &[]).stages.len(), 1000);
    lab.registry.most_stages = MANY_STAGES;
    assert_eq!(lab.pipeline(&text(1001), &[]).stages.len(), 1001);
}
