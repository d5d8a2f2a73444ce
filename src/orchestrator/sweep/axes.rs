//! The axes that a stage, or an item of a list, declares by `foreach`.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use super::settings::{AxisValue, Setting, Settings, text_of};
use super::template::axes_in;
use deaflow_base::{Dimension, InputError, Node, NodeValue, Quantity, is_plain_name};

/// The key of the axes.
pub const FOREACH: &str = "foreach";

/// The key of axes that go in step.
const ZIP: &str = "zip";

/// Axes that go in step: one alone, or those of a `zip`. Each holds its settings in order.
struct Group {
    /// Where it stands.
    place: Node,
    steps: Vec<Settings>,
}

/// The combinations of values that a mapping asks for by `foreach`; one without any axis where it asks for none.
///
/// # Errors
/// If the axes cannot be read, or are more than `most` combinations.
pub fn combinations(node: &Node, most: usize) -> Result<Vec<Settings>, InputError> {
    let Some(foreach) = node.peek(FOREACH) else {
        return Ok(vec![Vec::new()]);
    };
    let groups = groups(foreach)?;
    let count = groups
        .iter()
        .try_fold(1usize, |n, group| n.checked_mul(group.steps.len()));
    if count.is_none_or(|count| count > most) {
        return Err(too_many(foreach, most));
    }
    let mut all: Vec<Settings> = vec![Vec::new()];
    for group in &groups {
        let longer = |own: Settings| group.steps.iter().map(move |step| [&own[..], step].concat());
        all = all.into_iter().flat_map(longer).collect();
    }
    Ok(all)
}

/// Where axes stand that go in step, and their names.
pub type Declaration = (Node, Vec<Rc<str>>);

/// The axes that a mapping declares by `foreach`, with their places: those that go in step together.
///
/// # Errors
/// If they cannot be read.
pub fn declared(node: &Node) -> Result<Vec<Declaration>, InputError> {
    let groups = node.peek(FOREACH).map_or(Ok(Vec::new()), groups)?;
    let names = |group: &Group| group.steps[0].iter().map(|setting| setting.axis.clone()).collect();
    Ok(groups
        .into_iter()
        .map(|group| (group.place.clone(), names(&group)))
        .collect())
}

/// A refusal of axes that change nothing: their stages or items would be the same.
pub fn unused(place: &Node, axes: &[Rc<str>], of: &str) -> InputError {
    let axis = axes.first().map_or("", |axis| axis);
    place
        .error(format!("the axis `{axis}` of {of} is used nowhere"))
        .help(format!(
            "write \"${{{axis}}}\" for the value that it changes, or leave the axis out"
        ))
}

/// A refusal of more stages than are allowed.
pub fn too_many(node: &Node, most: usize) -> InputError {
    let help = match most {
        super::MOST_STAGES => format!("allowed: at most {most}, and {} with `--many`", super::MANY_STAGES),
        _ => format!("allowed: at most {most}"),
    };
    node.error(format!("a sweep of more than {most} stages")).help(help)
}

fn groups(foreach: &Node) -> Result<Vec<Group>, InputError> {
    let entries = foreach.entries(FOREACH)?;
    let mut groups = Vec::new();
    for (key, values) in entries {
        if !key.is_text(ZIP) {
            if matches!(values.value(), NodeValue::Map(_)) {
                let message = format!(
                    "the axis {} must be a list of values, found {}",
                    key.quoted(),
                    values.found()
                );
                return Err(values
                    .error(message)
                    .help("axes that go in step stand under `zip`: zip: { a: [1, 2], b: [3, 4] }"));
            }
            groups.push(zipped(&[(key, values)], key)?);
            continue;
        }
        let zips = match values.value() {
            NodeValue::List(zips) => zips.iter().collect(),
            _ => vec![values],
        };
        for zip in zips {
            let axes: Vec<(&Node, &Node)> = zip.entries(ZIP)?.iter().map(|(key, values)| (key, values)).collect();
            groups.push(zipped(&axes, zip)?);
        }
    }
    if groups.is_empty() {
        return Err(foreach
            .error("`foreach` has no axis")
            .help("write it as foreach: { voltage: [3 kV, 4 kV] }"));
    }
    let mut seen = BTreeSet::new();
    for setting in groups.iter().flat_map(|group| &group.steps[0]) {
        if !seen.insert(setting.axis.clone()) {
            return Err(foreach.error(format!("the axis `{}` is there twice", setting.axis)));
        }
    }
    Ok(groups)
}

/// Axes in step. Names carry the first axis alone where that tells the steps apart.
fn zipped(axes: &[(&Node, &Node)], place: &Node) -> Result<Group, InputError> {
    let mut steps: Vec<Settings> = Vec::new();
    let Some(((_, first), others)) = axes.split_first() else {
        return Err(place.error("`zip` has no axes"));
    };
    let count = first.list("the values of an axis")?.len();
    for (key, values) in others {
        let found = values.list("the values of an axis")?.len();
        if found != count {
            let message = format!(
                "{} has {found} values, and {} has {count}",
                key.quoted(),
                axes[0].0.quoted()
            );
            return Err(values.error(message).help("axes under `zip` have as many values each"));
        }
    }
    for (at, (key, values)) in axes.iter().enumerate() {
        let axis = axis_name(key)?;
        for (step, node) in values.list("the values of an axis")?.iter().enumerate() {
            if let Some(other) = axes_in(node).first() {
                let message = format!("a value of the axis `{axis}` asks for the axis `{other}`");
                return Err(node.error(message).help("values of axes stand for themselves"));
            }
            if at == 0 {
                steps.push(Vec::new());
            }
            steps[step].push(Setting {
                axis: axis.clone(),
                value: Rc::new(AxisValue {
                    text: text_of(node),
                    node: node.clone(),
                }),
                shown: true,
            });
        }
    }
    if steps.is_empty() {
        return Err(first.error("an axis needs at least one value"));
    }
    name_by(&mut steps, axes)?;
    Ok(Group {
        place: place.clone(),
        steps,
    })
}

/// Numbers the values of an axis; equal ones have one number. `3 kV` and `3000 V` are equal.
fn numbered<'a>(values: impl Iterator<Item = &'a str>) -> Vec<usize> {
    let mut seen: BTreeMap<(Option<Dimension>, String), usize> = BTreeMap::new();
    let number = |(at, text): (usize, &str)| {
        let quantity = |dimension| {
            Some((
                Some(dimension),
                Quantity::parse(text, dimension).ok()?.base().to_string(),
            ))
        };
        let readings = std::iter::once((None, text.to_owned())).chain(Dimension::ALL.into_iter().filter_map(quantity));
        let readings: Vec<_> = readings.collect();
        let number = readings
            .iter()
            .find_map(|reading| seen.get(reading))
            .copied()
            .unwrap_or(at);
        for reading in readings {
            seen.insert(reading, number);
        }
        number
    };
    values.enumerate().map(number).collect()
}

/// Refuses steps with the same values on all axes: they would be equal rows.
fn check_different(steps: &[Settings], axes: &[(&Node, &Node)]) -> Result<(), InputError> {
    let of_axis = |axis: usize| numbered(steps.iter().map(move |step| step[axis].value.text.as_str()));
    let numbers: Vec<Vec<usize>> = (0..axes.len()).map(of_axis).collect();
    let mut seen = BTreeSet::new();
    let is_new = |step: usize| seen.insert(numbers.iter().map(|of| of[step]).collect::<Vec<_>>());
    let news: Vec<bool> = (0..steps.len()).map(is_new).collect();
    let Some(twice) = steps
        .iter()
        .zip(news)
        .find_map(|(step, is_new)| (!is_new).then_some(step))
    else {
        return Ok(());
    };
    let message = match axes {
        [(axis, _)] => format!("{} has this value twice", axis.quoted()),
        _ => {
            let values: Vec<String> = twice.iter().map(|s| format!("{}={}", s.axis, s.value.text)).collect();
            format!("`zip` has these values twice: `{}`", values.join(", "))
        }
    };
    Err(twice[0].value.node.error(message))
}

/// Decides which axes names carry: the first where its values are all different; else all of one word each.
fn name_by(steps: &mut [Settings], axes: &[(&Node, &Node)]) -> Result<(), InputError> {
    let of_first = steps.iter().map(|step| &step[0]);
    let different: BTreeSet<&str> = of_first.clone().map(|setting| setting.value.text.as_str()).collect();
    let first_is_enough = different.len() == steps.len() && (axes.len() == 1 || of_first.clone().all(Setting::is_word));
    check_different(steps, axes)?;
    for step in steps.iter_mut() {
        for (at, setting) in step.iter_mut().enumerate() {
            setting.shown = match first_is_enough {
                true => at == 0,
                false => setting.is_word(),
            };
        }
    }
    let names: BTreeSet<String> = steps.iter().map(|step| super::settings::name("", step)).collect();
    if names.len() < steps.len() {
        let mut seen = BTreeSet::new();
        let name = |step: &Settings| super::settings::name("", step);
        let twice = steps.iter().map(name).find(|name| !seen.insert(name.clone()));
        let message = format!(
            "two values give stages of one name: `STAGE{}`",
            twice.unwrap_or_default()
        );
        let help = "zip them with an axis of different words, which names the stages";
        return Err(axes[0].1.error(message).help(help));
    }
    Ok(())
}

fn axis_name(key: &Node) -> Result<Rc<str>, InputError> {
    let name = key.text("the name of an axis")?;
    if !is_plain_name(name, 60) {
        let help = "allowed: at most 60 letters, digits, '_' and '-'";
        return Err(key.error(format!("an axis cannot be named {name:?}")).help(help));
    }
    Ok(name.into())
}
