use super::*;
use deaflow_content::{
    BalanceCounts, Balanced, Components, DesignRows, Histograms, LongTexts, Observations, Packed, SampleRows,
    Solutions, Unstable, Verification,
};
use deaflow_field::{CORNERS, Field, OutcomeKind};
use deaflow_pattern::{Raster, Role};
use deaflow_pattern::{Symmetries, Symmetry};
use deaflow_scene::{Effects, Scene};
use deaflow_store::{Data, Dataset, Object, Provenance, Store};
use deaflow_surrogate::{Example, LeftOut, LeftOutReason, SPLIT_SEED};

/// Different patterns for k below 41, none with a symmetry.
fn pattern(k: usize) -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, y| (3 * x + y * y + k * x * y) % 41 < 17 && x > y / 2)
}

/// One corner moves.
fn field(mm: f64) -> Field {
    let mut values = vec![0.0; 2 * CORNERS * CORNERS];
    values[2 * (20 * CORNERS + 30)] = mm;
    Field::from_values(Raster::PAPER, values).unwrap()
}

fn balanced(patterns: &[Pattern], fields: &[Field], splits: &[Split]) -> Object {
    let words: Vec<&str> = splits.iter().map(|split| split.name()).collect();
    balanced_into(patterns, fields, &words)
}

fn balanced_into(patterns: &[Pattern], fields: &[Field], splits: &[&str]) -> Object {
    let n = patterns.len();
    let content = Balanced {
        patterns: patterns.to_vec(),
        displacement: Packed(fields.iter().flat_map(Field::values).copied().collect()),
        family: vec!["bezier".into(); n],
        split: words(splits),
        orbit: vec![String::new(); n],
        source: vec![0; n],
        symmetry: vec![0; n],
        bin: vec![0; n],
        max_displacement: vec![0.0; n],
        histogram: Histograms::default(),
        counts: BalanceCounts::default(),
        dropped: None,
        without: None,
        scene: Scene::vhb4910(),
    };
    content.object().of_kind("balance")
}

fn sample_rows(patterns: &[Pattern]) -> SampleRows {
    SampleRows {
        patterns: patterns.to_vec(),
        family: vec!["bezier".into(); patterns.len()],
        index: vec![0; patterns.len()],
        units: vec![0; patterns.len()],
        electrodes: None,
        covered: None,
    }
}

fn words(words: &[&str]) -> Vec<String> {
    words.iter().map(|word| (*word).to_owned()).collect()
}

fn kinds(words: &[&str]) -> Vec<OutcomeKind> {
    words.iter().map(|word| OutcomeKind::from_name(word).unwrap()).collect()
}

fn solved(patterns: &[Pattern], outcomes: &[&str], unstable: &[&str]) -> Object {
    let n = patterns.len();
    let content = Solutions {
        rows: sample_rows(patterns),
        outcome: kinds(outcomes),
        displacement: vec![field(1.0); n],
        max_displacement: vec![1.0; n],
        newton_iterations: Some(vec![1; n]),
        residual: Some(vec![0.0; n]),
        observations: Observations::default(),
        meshes: None,
        history: None,
        unstable: Unstable {
            rows: sample_rows(&vec![pattern(0); unstable.len()]),
            outcome: kinds(unstable),
            voltage_bracket: vec![[0.0; 2]; unstable.len()],
            time_bracket: None,
        },
        scene: Scene::vhb4910(),
        solver: None,
        effects: None,
    };
    content.object().of_kind("solve chunk")
}

struct Bench {
    _folder: tempfile::TempDir,
    store: Store,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        Self { _folder: folder, store }
    }

    fn put(&self, object: &Object) -> Artifact {
        let stored = self.store.put(object, &Provenance::default()).unwrap();
        self.store.artifact(&stored.digest).unwrap()
    }

    fn manifest(&self, chunks: &[Object]) -> Artifact {
        let parts = chunks.iter().map(|chunk| self.put(chunk).digest()).collect();
        self.put(&Object::manifest(Default::default(), parts).of_kind("solve"))
    }
}

#[test]
fn rows_come_in_order_with_their_labels_and_splits() {
    let bench = Bench::new();
    let patterns: Vec<Pattern> = (0..4).map(pattern).collect();
    let fields: Vec<Field> = (0..4).map(|k| field(0.5 + f64::from(k))).collect();
    let splits = [Split::Train, Split::Test, Split::Train, Split::Validation];
    let artifact = bench.put(&balanced(&patterns, &fields, &splits));
    let found = read(&[artifact], &Scene::vhb4910(), 8, &Dropped::default()).unwrap();
    assert!(found.left_out.is_empty() && found.unstable == 0);
    for (k, example) in found.examples.iter().enumerate() {
        assert_eq!((&example.pattern, example.split), (&patterns[k], splits[k]));
        assert_eq!(
            (&example.label, example.family.as_str()),
            (&Label::from(&fields[k]), "bezier")
        );
    }
    assert_eq!(found.examples.len(), 4);
}

#[test]
fn samples_that_did_not_converge_are_counted_and_left_out() {
    let bench = Bench::new();
    let first = solved(&[pattern(0), pattern(1)], &["converged", "converged"], &["pull-in"]);
    let second = solved(
        &[pattern(2), pattern(3)],
        &["iteration-limit", "estimated"],
        &["slack", "pull-in"],
    );
    let found = read(
        &[bench.manifest(&[first, second])],
        &Scene::vhb4910(),
        8,
        &Dropped::default(),
    )
    .unwrap();
    let kept: Vec<&Pattern> = found.examples.iter().map(|e| &e.pattern).collect();
    assert_eq!(kept, [&pattern(0), &pattern(1), &pattern(3)]);
    assert_eq!(found.unstable, 3);
    let expected = LeftOut {
        input: 0,
        row: 2,
        found_mm: 0.0,
        reason: LeftOutReason::NotConverged,
    };
    assert_eq!(found.left_out, [expected]);
}

#[test]
fn labels_that_cannot_be_true_are_left_out_and_named() {
    let bench = Bench::new();
    let patterns: Vec<Pattern> = (0..24).map(pattern).collect();
    let mut fields: Vec<Field> = (0..24).map(|k| field(1.0 + 0.05 * f64::from(k))).collect();
    fields[3] = field(100.0);
    fields[7] = field(45.0);
    let mut moved = field(1.0).values().to_vec();
    moved[0] = 0.25;
    fields[20] = Field::from_values(Raster::PAPER, moved).unwrap();
    let artifact = bench.put(&balanced(&patterns, &fields, &[Split::Train; 24]));
    let found = read(&[artifact], &Scene::vhb4910(), 8, &Dropped::default()).unwrap();
    assert_eq!(found.examples.len(), 21);
    assert!(found.examples.iter().all(|example| example.label.max_magnitude() < 3.0));
    let named: Vec<String> = found.left_out.iter().map(ToString::to_string).collect();
    assert_eq!(
        named[0],
        "row 3 of input 1: displacement 100.000 mm exceeds the side of the membrane, 50 mm"
    );
    assert!(
        named[1].starts_with("row 7 of input 1: displacement 45.000 mm is an outlier"),
        "{named:?}"
    );
    assert_eq!(named[2], "row 20 of input 1: the frame moves by 0.250 mm");
    assert_eq!(named.len(), 3);
    let names = found.left_out.iter().map(|left_out| left_out.reason.name());
    assert!(names.eq(["beyond-the-side", "outlier", "frame-moves"]));
}

#[test]
fn all_images_of_a_pattern_are_in_one_part_whichever_input_they_stand_in() {
    let bench = Bench::new();
    let images: Vec<Pattern> = Symmetry::ALL.iter().map(|g| pattern(0).transformed(*g)).collect();
    let others: Vec<Pattern> = (1..40).map(pattern).collect();
    let of_samples = bench.manifest(&[solved(&[&images[..4], &others].concat(), &["converged"; 43], &[])]);
    let alone = read(
        std::slice::from_ref(&of_samples),
        &Scene::vhb4910(),
        8,
        &Dropped::default(),
    )
    .unwrap();
    let parts = |found: &Examples| found.examples.iter().map(|e| e.split).collect::<Vec<_>>();
    assert!(parts(&alone)[..4].iter().all(|split| *split == parts(&alone)[0]));
    assert_eq!(
        parts(&alone)[5],
        Split::of(&others[1].orbit(Symmetries::SQUARE), SPLIT_SEED)
    );
    assert!(Split::ALL.iter().all(|split| parts(&alone).contains(split)));
    // The split of a balanced input counts, wherever it is in the list; of two that disagree, the first.
    let elsewhere = Split::ALL.into_iter().find(|split| *split != parts(&alone)[0]).unwrap();
    let fields = [field(1.0), field(1.0)];
    let known = bench.put(&balanced(&images[4..6], &fields, &[elsewhere; 2]));
    let other = bench.put(&balanced(&images[6..], &fields, &[parts(&alone)[0]; 2]));
    for inputs in [
        [of_samples.clone(), known.clone(), other.clone()],
        [known.clone(), other.clone(), of_samples.clone()],
    ] {
        let found = read(&inputs, &Scene::vhb4910(), 8, &Dropped::default()).unwrap();
        let of_orbit = found
            .examples
            .iter()
            .filter(|e| e.pattern.orbit(Symmetries::SQUARE) == images[0].orbit(Symmetries::SQUARE));
        let splits: Vec<Split> = of_orbit.map(|example| example.split).collect();
        assert_eq!(splits, [elsewhere; 8]);
    }
}

#[test]
fn empty_and_full_patterns_are_examples_like_others() {
    let bench = Bench::new();
    let uniform = [
        Pattern::from_fn(Raster::PAPER, |_, _| false),
        Pattern::from_fn(Raster::PAPER, |_, _| true),
    ];
    let still = [field(0.0), field(0.0)];
    let artifact = bench.put(&balanced(&uniform, &still, &[Split::Train; 2]));
    let found = read(&[artifact], &Scene::vhb4910(), 8, &Dropped::default()).unwrap();
    assert!(found.examples.len() == 2 && found.left_out.is_empty());
}

#[test]
fn inputs_without_any_label_to_learn_from_are_refused_with_the_reason() {
    let bench = Bench::new();
    let none = bench.put(&balanced(&[pattern(0)], &[field(100.0)], &[Split::Train]));
    let error = read(&[none], &Scene::vhb4910(), 8, &Dropped::default())
        .err()
        .unwrap()
        .to_string();
    assert!(
        error.starts_with("there are no labels to train on; row 0 of input 1: displacement 100.000 mm"),
        "{error}"
    );
    let unstable = bench.manifest(&[solved(&[], &[], &["pull-in", "slack"])]);
    let error = read(&[unstable], &Scene::vhb4910().at_voltage(12e3), 8, &Dropped::default())
        .err()
        .unwrap();
    let StageError::Advised { source, help } = error else {
        panic!("the error has no advice: {error}");
    };
    assert!(
        source.to_string().ends_with("2 samples have no stable solution"),
        "{source}"
    );
    assert!(help.contains("10.98 kV"), "{help}");
    let mut torn = balanced(&[pattern(0)], &[field(1.0)], &[Split::Train]);
    torn.datasets.remove("split");
    let none = Dataset::new("", "d", &[0], Data::Text(Vec::new()));
    let torn = torn.with("split", none);
    let error = read(&[bench.put(&torn)], &Scene::vhb4910(), 8, &Dropped::default())
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("differ in length"), "{error}");
    let odd = balanced_into(&[pattern(0)], &[field(1.0)], &["elsewhere"]);
    let error = read(&[bench.put(&odd)], &Scene::vhb4910(), 8, &Dropped::default())
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("unknown split \"elsewhere\""), "{error}");
}

/// A verify stage's artifact: fields of the rows that have one.
fn verified(patterns: &[Pattern], outcomes: &[&str], fields: &[Field]) -> Object {
    let (n, m) = (patterns.len(), fields.len());
    let text = || vec![String::new(); n];
    let content = Verification {
        rows: DesignRows {
            case: text(),
            name: text(),
            role: vec![Role::Ga; n],
            area_target: text(),
            evaluator: text(),
            member: vec![0; n],
            units: vec![0; n],
            patterns: patterns.to_vec(),
            area: vec![0.5; n],
            predicted: vec![field(1.0); n],
            objective: LongTexts(text()),
            constraints: LongTexts(text()),
            status: LongTexts(text()),
            interval: None,
            states: None,
        },
        outcome: kinds(outcomes),
        displacement: fields.to_vec(),
        difference: fields.to_vec(),
        states: None,
        space: None,
        history: None,
        component: Components {
            predicted: vec![1.0; n],
            simulated: vec![1.0; m],
            error: vec![0.0; m],
            error_known: vec![1; m],
            in_time: None,
            distance: vec![0.0; m],
        },
        scene: Scene::vhb4910(),
        solver: String::new(),
        effects: Effects::default(),
    };
    content.object().of_kind("verify")
}

#[test]
fn verified_designs_are_learnt_from_each_once_whatever_the_others_look_like() {
    let bench = Bench::new();
    let patterns: Vec<Pattern> = (0..30).map(pattern).collect();
    let fields: Vec<Field> = (0..20).map(|_| field(0.02)).collect();
    let known = balanced(&patterns[..20], &fields, &[Split::Train; 20]);
    // A hundred times the displacement of the samples: as a sample such a label would be left out.
    let round = [
        verified(
            &patterns[20..23],
            &["converged", "pull-in", "converged"],
            &[field(2.0), field(2.5)],
        ),
        verified(
            &patterns[22..25],
            &["converged", "converged", "converged"],
            &[field(2.5), field(100.0), field(1.5)],
        ),
    ];
    let inputs = [bench.put(&known), bench.put(&round[0]), bench.put(&round[1])];
    let found = read(&inputs, &Scene::vhb4910(), 5, &Dropped::default()).unwrap();
    let taken: Vec<(&Pattern, u32, f64)> = found.examples[20..]
        .iter()
        .map(|e| (&e.pattern, e.repeats, e.label.max_magnitude()))
        .collect();
    let expected = [(20, 2.0), (22, 2.5), (24, 1.5)].map(|(k, peak)| (&patterns[k], 5, peak));
    assert_eq!(taken, expected);
    let learnt = |e: &Example| e.split == Split::Train && e.family == "verified";
    assert!(found.examples[20..].iter().all(learnt) && found.examples[..20].iter().all(|e| e.repeats == 1));
    assert_eq!(found.unstable, 1);
    let named: Vec<String> = found.left_out.iter().map(ToString::to_string).collect();
    assert_eq!(
        named,
        ["row 1 of input 3: displacement 100.000 mm exceeds the side of the membrane, 50 mm"]
    );
}

#[test]
fn verified_designs_change_nothing_of_what_is_held_out() {
    let bench = Bench::new();
    let patterns: Vec<Pattern> = (0..40).map(pattern).collect();
    let solved = bench.manifest(&[solved(&patterns, &["converged"; 40], &[])]);
    let held_out = |found: &Examples| {
        let held_out = found.examples.iter().filter(|e| e.split != Split::Train);
        held_out.map(|e| (e.pattern.clone(), e.split)).collect::<Vec<_>>()
    };
    let alone = read(std::slice::from_ref(&solved), &Scene::vhb4910(), 8, &Dropped::default()).unwrap();
    // Images of all samples, and other patterns.
    let images: Vec<Pattern> = patterns.iter().map(|p| p.transformed(Symmetry::ALL[3])).collect();
    let fresh: Vec<Pattern> = (0..4)
        .map(|k| Pattern::from_fn(Raster::PAPER, |x, _| x < 20 + k))
        .collect();
    let all = [images, fresh].concat();
    let fields: Vec<Field> = all.iter().map(|_| field(1.0)).collect();
    let verified = bench.put(&verified(&all, &["converged"; 44], &fields));
    // The order of the inputs is nothing to it.
    for inputs in [[solved.clone(), verified.clone()], [verified, solved]] {
        let found = read(&inputs, &Scene::vhb4910(), 8, &Dropped::default()).unwrap();
        assert_eq!(held_out(&found), held_out(&alone));
        let refused = held_out(&alone).len();
        assert!(refused > 3, "{refused}");
        assert!(found.left_out.len() == refused && found.left_out.iter().all(|l| l.reason == LeftOutReason::HeldOut));
        assert_eq!(found.examples.len(), 84 - refused);
    }
}
