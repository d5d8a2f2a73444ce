//! Stages that are done in rounds: what each round needs, what is built when there is one more, and what is refused.

use miette::Diagnostic;

use super::*;
use deaflow_base::NodeValue;

/// Adds the numbers of its inputs and `add`.
struct Toy {
    name: &'static str,
    needs: &'static [&'static str],
    feedback_target: Option<&'static str>,
    /// What it adds from the second round on.
    again: Option<&'static str>,
}

const TOYS: [Toy; 3] = [
    Toy {
        name: "learn",
        needs: &["count", "check", "learn"],
        feedback_target: None,
        again: Some("1"),
    },
    Toy {
        name: "guess",
        needs: &["learn", "count"],
        feedback_target: None,
        again: None,
    },
    Toy {
        name: "check",
        needs: &["guess"],
        feedback_target: Some("learn"),
        again: None,
    },
];

struct ToyStage(u64);

impl Kind for Toy {
    fn name(&self) -> &'static str {
        self.name
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: self.needs,
            least: 1,
            most: 50,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        vec![Fields::new("A toy.").optional("add", Schema::integer(0, 1000))]
    }

    fn feedback_target(&self) -> Option<&'static str> {
        self.feedback_target
    }

    fn feedback_overrides(&self, _: &Node) -> Result<Vec<(&'static str, NodeValue)>, InputError> {
        let add = self.again.map(|add| ("add", NodeValue::Number(add.to_owned())));
        Ok(add.into_iter().collect())
    }

    fn read(&self, stage: &Node, _: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let keys: &[&str] = match self.feedback_target {
            Some(_) => &["kind", "needs", "add", "rounds", "update"],
            None => &["kind", "needs", "add"],
        };
        let map = stage.fields("a toy", keys)?;
        let add = map.optional("add").map_or(Ok(0), |node| node.integer("add", 0, 1000))?;
        Ok(Box::new(ToyStage(add)))
    }
}

impl Stage for ToyStage {
    fn parameters(&self) -> Canonical {
        Canonical::map([("add", self.0.into())])
    }

    fn plan(&self, _: &[Input]) -> Plan {
        Plan::Whole { steps: 1 }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let mut sum = self.0;
        for input in job.inputs {
            sum += input.u64s("numbers")?.1.iter().sum::<u64>();
        }
        Ok(numbers(vec![sum]))
    }
}

/// `known` needs nothing that learns: it is done once.
const STAGES: &str = "
version: 1
name: toy
stages:
  data: { kind: count, count: 3 }
  model: { kind: learn, needs: [data], add: 20 }
  one: { kind: guess, needs: [model], add: 300 }
  two: { kind: guess, needs: [model] }
  known: { kind: guess, needs: [data] }
  checked: { kind: check, needs: [one, known, two], add: 5, rounds: 3 }
  aside: { kind: guess, needs: [model], add: 1 }
";

fn laboratory() -> Laboratory {
    static KINDS: [Toy; 3] = TOYS;
    let mut lab = Laboratory::new();
    lab.registry
        .kinds
        .extend(KINDS.iter().map(|kind| kind as &'static dyn Kind));
    lab
}

/// "name <- needs" of each stage.
fn lines(pipeline: &Pipeline) -> Vec<String> {
    let name = |place: &usize| pipeline.stages[*place].name.clone();
    let line = |spec: &StageSpec| {
        let needs: Vec<String> = spec.needs.iter().map(name).collect();
        format!("{} <- {}", spec.name, needs.join(" "))
    };
    pipeline.stages.iter().map(line).collect()
}

fn refusal(text: &str, sets: &[&str]) -> (String, String) {
    let lab = laboratory();
    let document = Document::from_text(Path::new("toy.yaml"), text).unwrap();
    let sets: Vec<Override> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    let error = Pipeline::read(document, &sets, &lab.registry).err().expect("refused");
    let help = Diagnostic::help(&error).map_or_else(String::new, |help| help.to_string());
    (error.to_string(), help)
}

#[test]
fn each_round_learns_from_all_before_it_and_does_the_rest_again() {
    let pipeline = laboratory().pipeline(STAGES, &[]);
    let expected = [
        "data <- ",
        "model <- data",
        "one <- model",
        "two <- model",
        "known <- data",
        "checked <- one known two",
        "aside <- model",
        "model-2 <- data model checked",
        "one-2 <- model-2",
        "two-2 <- model-2",
        "checked-2 <- one-2 known two-2",
        "model-3 <- data model-2 checked checked-2",
        "one-3 <- model-3",
        "two-3 <- model-3",
        "checked-3 <- one-3 known two-3",
    ];
    assert_eq!(lines(&pipeline), expected);
    let rounds = ["checked", "checked-2", "checked-3"].map(str::to_owned);
    assert_eq!(pipeline.rounds, [Rounds { stages: rounds.into() }]);
    let until = pipeline.selection(Some("checked-2")).unwrap();
    let names: Vec<&str> = until.iter().map(|&at| pipeline.stages[at].name.as_str()).collect();
    assert!(names.contains(&"model-2") && !names.iter().any(|name| name.ends_with("-3") || *name == "aside"));
}

#[test]
fn keys_are_those_of_the_first_round_but_for_what_learns() {
    let of = |sets: &[&str]| {
        let pipeline = laboratory().pipeline(STAGES, sets);
        let parameters = |name: &str| pipeline.stage(name).unwrap().stage().parameters().to_string();
        ["model", "model-2", "model-3", "one-3", "checked-2"].map(parameters)
    };
    let added = |values: [u64; 5]| values.map(|add| Canonical::map([("add", add.into())]).to_string());
    assert_eq!(of(&[]), added([20, 1, 1, 300, 5]));
    assert_eq!(of(&["stages.one.add=7"]), added([20, 1, 1, 7, 5]));
    assert_eq!(of(&["stages.checked.update={ add: 9 }"]), added([20, 9, 9, 300, 5]));
    // A stage of a round can be set by its own name.
    assert_eq!(
        of(&["stages.model-3.add=4", "stages.one-3.add=8"]),
        added([20, 1, 4, 8, 5])
    );
}

#[test]
fn one_more_round_builds_that_round_alone() {
    let lab = laboratory();
    let built = |text: &str, sets: &[&str]| -> Vec<String> {
        let (outcome, _) = lab.run_text(text, sets);
        let built = outcome.stages.iter().filter(|stage| stage.outcome == Outcome::Built);
        built.map(|stage| stage.name.clone()).collect()
    };
    assert_eq!(built(STAGES, &["stages.checked.rounds=1"]).len(), 7);
    assert_eq!(
        built(STAGES, &["stages.checked.rounds=2"]),
        ["model-2", "one-2", "two-2", "checked-2"]
    );
    assert_eq!(built(STAGES, &[]), ["model-3", "one-3", "two-3", "checked-3"]);
    // Names are no part of keys.
    let renamed = STAGES.replace("model", "network").replace("one", "first");
    for sets in [&[][..], &["stages.checked.rounds=1"], &["stages.checked.rounds=2"]] {
        assert_eq!(built(STAGES, sets), [""; 0]);
        assert_eq!(built(&renamed, sets), [""; 0]);
    }
    // The second round differs: what came before it stays.
    assert_eq!(
        built(STAGES, &["stages.checked.update={ add: 2 }", "stages.checked.rounds=2"]),
        ["model-2", "one-2", "two-2", "checked-2"]
    );
}

#[test]
fn rounds_that_cannot_be_are_refused() {
    let cases = [
        (
            STAGES.replace("aside:", "two-3:"),
            "`two-3` is a stage of the rounds of `checked`, and this one is named alike",
            "rename this stage",
        ),
        (
            STAGES.replace(
                "aside: { kind: guess, needs: [model], add: 1 }",
                "other: { kind: check, needs: [two], rounds: 2 }",
            ),
            "`model-2` is a stage of the rounds of `other` and of those of another stage",
            "one stage only",
        ),
        (
            STAGES.replace("[one, known, two]", "[known]"),
            "`checked` cannot be done in rounds: no stage that it needs is of kind learn, which could learn",
            "leave `rounds` out",
        ),
        (
            STAGES.replace("rounds: 3", "rounds: 21"),
            "`rounds` must be an integer from 1 to 20, found 21",
            "",
        ),
        (
            STAGES.replace("rounds: 3", "rounds: 2, update: { addd: 1 }"),
            "unknown key `addd` in `update`",
            "did you mean `add`?",
        ),
        (
            STAGES.replace("rounds: 3", "rounds: 2, update: { add: 1001 }"),
            "`add` must be an integer from 0 to 1000, found 1001",
            "",
        ),
        (
            STAGES.replace("aside: { kind: guess,", "aside: { kind: guess, rounds: 2,"),
            "unknown key `rounds` in a toy",
            "",
        ),
    ];
    for (text, message, advice) in cases {
        let (found, help) = refusal(&text, &[]);
        assert_eq!(found, message);
        assert!(help.contains(advice), "{found}: {help}");
    }
    let (found, help) = refusal(STAGES, &["stages.model-4.add=1"]);
    assert_eq!(found, "--set stages.model-4.add: no `model-4` in `stages`");
    assert!(help.contains("model-3"), "{help}");
    let (found, _) = refusal(STAGES, &["stages.checked-2.rounds=3"]);
    assert_eq!(
        found,
        "--set stages.checked-2.rounds: `rounds` belongs to the first round"
    );
}

#[test]
fn a_training_to_begin_with_has_done_its_part_after_the_first_round() {
    let text = STAGES
        .replace("needs: [data], add: 20", "needs: [data, base], add: 20")
        .replace("  data:", "  base: { kind: learn, needs: [data] }\n  data:");
    let found = lines(&laboratory().pipeline(&text, &[]));
    assert!(found.contains(&"model-2 <- data model checked".to_owned()), "{found:?}");
    assert!(!found.iter().any(|line| line.starts_with("base-")), "{found:?}");
}

#[test]
fn circles_are_still_refused() {
    let text = STAGES.replace("needs: [data], add: 20", "needs: [data, checked], add: 20");
    let (found, _) = refusal(&text, &[]);
    assert!(found.starts_with("the stages need each other in a cycle:"), "{found}");
}
