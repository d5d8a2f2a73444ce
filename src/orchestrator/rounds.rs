//! Unrolls stages that are repeated in rounds, before anything else is read: what such a stage made is fed back to
//! stages that it was made from, and these do their work again.
//!
//! A stage V with `rounds: N` needs, directly or not, stages of the kind that [`Kind::feedback_target`] names: its
//! targets. Round 1 is the pipeline as it is written. Round r has a stage `NAME-r` for each target, for V, and for each
//! stage between them:
//!
//! - a target needs what it needs in round 1, itself of round r − 1, and V of all earlier rounds; it has the same keys but
//!   for those of [`Kind::feedback_overrides`] and, before these, of `update` beside `rounds`;
//! - the others have the same keys and need the stages of their round where there are such, and else those of round 1.
//!
//! So no round changes one before it, and each stage of a round is a stage like any other: cached, planned, explained,
//! locked.

use super::entry::{Entry, Registry, read_entries};
use super::graph;
use super::kind::Kind;
use deaflow_base::{Fields, InputError, Node, NodeValue, Override, Schema};

/// The key that says how many rounds there are.
pub const ROUNDS: &str = "rounds";

/// The key that holds the keys in which targets differ from the second round on.
pub const UPDATE: &str = "update";

/// Rounds that a stage may have.
const MOST_ROUNDS: u64 = 20;

/// A stage that is done in rounds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rounds {
    /// Its names, round by round: the first is that of the file.
    pub stages: Vec<String>,
}

/// Puts overrides into the tree, and gives back those of stages that are not there: rounds may bring them.
///
/// # Errors
/// If an override has no place.
pub fn apply<'o>(root: &mut Node, overrides: &'o [Override]) -> Result<Vec<&'o Override>, InputError> {
    let mut late = Vec::new();
    for set in overrides {
        match set.path() {
            [stages, name, _, ..] if stages == "stages" && !has_stage(root, name) => late.push(set),
            _ => set.apply(root)?,
        }
    }
    Ok(late)
}

/// Unrolls the rounds of all stages, and then applies what was left of the overrides.
///
/// # Errors
/// If a stage cannot be read so far, the rounds cannot be unrolled, or an override has no place.
pub fn unroll(root: &mut Node, late: &[&Override], registry: &Registry) -> Result<Vec<Rounds>, InputError> {
    let rounds = unroll_stages(root, registry)?;
    for set in late {
        let path = set.path();
        let of_rounds = path.get(2).filter(|key| [ROUNDS, UPDATE].contains(&key.as_str()));
        if let Some(key) = of_rounds.filter(|_| has_stage(root, &path[1])) {
            let message = format!("--set {}: `{key}` belongs to the first round", path.join("."));
            return Err(InputError::new(message).help("set it for the stage that stands in the file"));
        }
        set.apply(root)?;
    }
    Ok(rounds)
}

/// The keys of a kind whose stages may be done in rounds.
pub fn schema(kind: &dyn Kind, fields: Fields, registry: &Registry) -> Fields {
    let Some(target) = target(kind, registry) else {
        return fields;
    };
    let word = target.name();
    let rounds = Schema::integer(1, MOST_ROUNDS)
        .description(&format!(
            "Rounds: from the second on, the stages of kind {word} that lead here learn from this stage as well, and \
             the stages in between are done again, as NAME-2, NAME-3, …"
        ))
        .default(1);
    let says = format!("Keys in which stages of kind {word} differ from the second round on.");
    let update = Schema::any_of(target.schema().into_iter().map(|keys| keys.all_optional(&says).into()));
    fields.optional(ROUNDS, rounds).optional(UPDATE, update)
}

fn has_stage(root: &Node, name: &str) -> bool {
    root.peek("stages").is_some_and(|stages| stages.peek(name).is_some())
}

/// The kind to which what stages of a kind made is fed back.
fn target(kind: &dyn Kind, registry: &Registry) -> Option<&'static dyn Kind> {
    let word = kind.feedback_target()?;
    registry.kinds.iter().copied().find(|other| other.name() == word)
}

fn unroll_stages(root: &mut Node, registry: &Registry) -> Result<Vec<Rounds>, InputError> {
    let Some(stages) = root.peek("stages") else {
        return Ok(Vec::new());
    };
    let entries = read_entries(stages, registry)?;
    let needs = |entry: &Entry<'_>| entry.needs.iter().map(|(need, _)| *need).collect();
    if graph::order(&entries.iter().map(needs).collect::<Vec<_>>()).is_err() {
        // A circle is told of as it stands in the file.
        return Ok(Vec::new());
    }
    let (mut rounds, mut more) = (Vec::new(), Vec::new());
    for (source, entry) in entries.iter().enumerate() {
        let (Some(target), Some(node)) = (target(entry.kind, registry), entry.node.peek(ROUNDS)) else {
            continue;
        };
        let last = node.integer(ROUNDS, 1, MOST_ROUNDS)?;
        let repetition = Repetition::new(&entries, source, target)?;
        if last > 1 && !repetition.again[source] {
            let message = format!(
                "`{}` cannot be done in rounds: no stage that it needs is of kind {}, which could learn",
                entry.name,
                target.name()
            );
            return Err(node
                .error(message)
                .help("leave `rounds` out, or let a stage in between need one"));
        }
        for round in 2..=last {
            for (name, stage) in repetition.round(round)? {
                refuse_clash(&entries, &more, &name, entry)?;
                more.push((name, stage));
            }
        }
        let names = (1..=last).map(|round| name_in(entry.name, round));
        rounds.push(Rounds {
            stages: names.collect(),
        });
    }
    rounds.retain(|rounds| rounds.stages.len() > 1);
    if let Some(stages) = root.child_mut("stages") {
        let named = |(name, stage): (String, Node)| (stage.with_value(NodeValue::Text(name)), stage);
        stages.extend(more.into_iter().map(named).collect());
    }
    Ok(rounds)
}

fn name_in(name: &str, round: u64) -> String {
    match round {
        1 => name.to_owned(),
        round => format!("{name}-{round}"),
    }
}

fn refuse_clash(
    entries: &[Entry<'_>],
    more: &[(String, Node)],
    name: &str,
    source: &Entry<'_>,
) -> Result<(), InputError> {
    let what = format!("`{name}` is a stage of the rounds of `{}`", source.name);
    if let Some(other) = entries.iter().find(|other| other.name == name) {
        let message = format!("{what}, and this one is named alike");
        return Err(other.key.error(message).help("rename this stage"));
    }
    match more.iter().find(|(other, _)| other == name) {
        Some(_) => Err(source
            .key
            .error(format!("{what} and of those of another stage"))
            .help("a stage is done again in the rounds of one stage only: let one stage need what both need")),
        None => Ok(()),
    }
}

/// What is done again in the rounds of a stage.
struct Repetition<'a> {
    entries: &'a [Entry<'a>],
    source: usize,
    target: &'static dyn Kind,
    /// Of each stage, whether it is done again.
    again: Vec<bool>,
    /// Keys in which the stages that learn differ.
    update: &'a [(Node, Node)],
}

impl<'a> Repetition<'a> {
    fn new(entries: &'a [Entry<'a>], source: usize, target: &'static dyn Kind) -> Result<Self, InputError> {
        let mut repetition = Self {
            entries,
            source,
            target,
            again: Vec::new(),
            update: &[],
        };
        if let Some(update) = entries[source].node.peek(UPDATE) {
            let families = target.schema();
            let keys: Vec<&str> = families.iter().flat_map(Fields::keys).collect();
            update.fields(&format!("`{UPDATE}`"), &keys)?;
            repetition.update = update.entries(UPDATE)?;
        }
        repetition.again = repetition.done_again();
        Ok(repetition)
    }

    fn is_target(&self, index: usize) -> bool {
        self.entries[index].kind.name() == self.target.name()
    }

    /// The stages between the source and the nearest stages that learn, both included.
    fn done_again(&self) -> Vec<bool> {
        let needs = |index: usize| self.entries[index].needs.iter().map(|(need, _)| *need);
        let mut within = vec![false; self.entries.len()];
        let mut open = vec![self.source];
        while let Some(index) = open.pop() {
            if !std::mem::replace(&mut within[index], true) && !self.is_target(index) {
                open.extend(needs(index));
            }
        }
        let learns = |index: usize| within[index] && self.is_target(index);
        let mut again: Vec<bool> = (0..within.len()).map(learns).collect();
        loop {
            let leads = |index: &usize| within[*index] && !again[*index] && needs(*index).any(|need| again[need]);
            let Some(next) = (0..within.len()).find(leads) else {
                return again;
            };
            again[next] = true;
        }
    }

    /// The stages of a round from the second on, by their names, in the order of the file.
    fn round(&self, round: u64) -> Result<Vec<(String, Node)>, InputError> {
        let again = (0..self.entries.len()).filter(|&index| self.again[index]);
        let stage = |index: usize| {
            let mut stage = self.entries[index].node.clone();
            if index == self.source {
                stage.remove(ROUNDS);
                stage.remove(UPDATE);
            }
            if self.is_target(index) {
                self.override_keys(&mut stage)?;
            }
            let needs = if self.is_target(index) {
                self.needs_of_target(index, round)
            } else {
                self.needs_in(index, round)
            };
            let list = stage.peek("needs").unwrap_or(&stage).with_value(NodeValue::List(needs));
            stage.put("needs", list);
            Ok((name_in(self.entries[index].name, round), stage))
        };
        again.map(stage).collect()
    }

    fn override_keys(&self, stage: &mut Node) -> Result<(), InputError> {
        for (key, value) in self.target.feedback_overrides(stage)? {
            let value = stage.peek(key).unwrap_or(stage).with_value(value);
            stage.put(key, value);
        }
        for (key, value) in self.update {
            stage.put(key.text("a key")?, value.clone());
        }
        Ok(())
    }

    /// Needs of a stage that learns: another training that it began with has done its part.
    fn needs_of_target(&self, index: usize, round: u64) -> Vec<Node> {
        let entry = &self.entries[index];
        let own = entry.listed().iter().filter(|(need, _)| !self.is_target(*need));
        let mut needs: Vec<Node> = own.map(|(_, node)| (*node).clone()).collect();
        let text = |name: &str, round| entry.key.with_value(NodeValue::Text(name_in(name, round)));
        needs.push(text(entry.name, round - 1));
        needs.extend((1..round).map(|earlier| text(self.entries[self.source].name, earlier)));
        needs
    }

    fn needs_in(&self, index: usize, round: u64) -> Vec<Node> {
        let needs = self.entries[index].listed().iter();
        let named = |(need, node): &(usize, &Node)| match self.again[*need] {
            true => node.with_value(NodeValue::Text(name_in(self.entries[*need].name, round))),
            false => (*node).clone(),
        };
        needs.map(named).collect()
    }
}
