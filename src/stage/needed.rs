//! Checks of what a stage needs that the file already answers.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::ptr;

use super::scene;
use deaflow_base::{InputError, Node};
use deaflow_orchestrator::StageDeclaration;
use deaflow_pattern::Edges;
use deaflow_scene::{Difference, Scene};

/// Returns where `needs` names a stage.
pub fn named<'a>(stage: &StageDeclaration<'a>, name: &str) -> &'a Node {
    let needs = stage.node.peek("needs");
    let items = needs.and_then(|needs| needs.list("needs").ok()).unwrap_or_default();
    items
        .iter()
        .find(|item| item.is_text(name))
        .or(needs)
        .unwrap_or(stage.node)
}

/// Returns the number of needs of some kinds.
pub fn count(needs: &[StageDeclaration<'_>], kinds: &[&str]) -> usize {
    needs.iter().filter(|need| kinds.contains(&need.kind)).count()
}

/// Returns the error for a number of needs.
pub fn wrong_number(stage: &StageDeclaration<'_>, message: String, help: &str) -> InputError {
    stage.node.peek("needs").unwrap_or(stage.node).error(message).help(help)
}

/// The kinds of stages whose results are of the state of what they need.
const INHERITING: [&str; 4] = ["balance", "train", "calibrate", "audit"];

/// Returns what is found in a stage or in the nearest of the stages that its results are made from.
fn nearest<'a, T>(stage: &StageDeclaration<'a>, find: impl Fn(&StageDeclaration<'a>) -> Option<T>) -> Option<T> {
    let mut open = VecDeque::from([*stage]);
    let mut seen = BTreeSet::new();
    while let Some(next) = open.pop_front() {
        if let Some(found) = find(&next) {
            return Some(found);
        }
        if INHERITING.contains(&next.kind) && seen.insert(next.name) {
            open.extend(next.needs());
        }
    }
    None
}

/// Returns the state of the device of which a stage is; none if it is of all states.
pub fn state_of(stage: &StageDeclaration<'_>) -> Option<String> {
    nearest(stage, |stage| {
        let state = stage.node.peek(scene::STATE)?.text(scene::STATE).ok()?;
        Some(state.to_owned())
    })
}

/// Returns a stage that simulates, with its scene.
fn simulating<'a>(stage: &StageDeclaration<'a>) -> Option<(&'a Node, StageDeclaration<'a>)> {
    match stage.kind {
        "solve" | "import" | "verify" => stage.scene.map(|scene| (scene, *stage)),
        _ => None,
    }
}

/// Reads the scene of a stage that simulates.
fn read_of(stage: &StageDeclaration<'_>) -> Option<Scene> {
    match stage.kind {
        "verify" => scene::read_in_space(stage.node, stage.scene).ok(),
        _ => scene::read_in_state(stage.node, stage.scene).ok(),
    }
}

/// Returns how a stage draws patterns with edges within cells; none if its patterns are cells.
pub fn edges_within_cells(stage: &StageDeclaration<'_>) -> Option<Edges> {
    let edges = stage.node.peek("edges").filter(|_| stage.kind == "patterns")?;
    [Edges::Fitted, Edges::Coverage]
        .into_iter()
        .find(|word| edges.is_text(word.name()))
}

/// Describes edges within cells.
fn described(edges: Edges) -> &'static str {
    match edges {
        Edges::Fitted => "fitted edges",
        Edges::Coverage => "edges by coverage",
        Edges::Cells => "edges of cells",
    }
}

/// Refuses patterns with edges within cells, for a stage that knows the cells of patterns alone.
///
/// # Errors
/// If a need has such patterns.
pub fn no_edges_within_cells(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    for need in needs {
        let (mut open, mut seen) = (VecDeque::from([*need]), BTreeSet::new());
        while let Some(next) = open.pop_front() {
            if let Some(edges) = edges_within_cells(&next).map(described) {
                let message = format!(
                    "the patterns of `{}` have {edges}, but a stage of kind `{}` knows the cells of patterns alone",
                    next.name, stage.kind
                );
                let help = format!("use `edges: cells` in `{}`; {edges} can be solved", next.name);
                return Err(named(stage, need.name).error(message).help(help));
            }
            if seen.insert(next.name) {
                open.extend(next.needs());
            }
        }
    }
    Ok(())
}

/// Refuses patterns with different kinds of edges in one stage, whose artifacts have other arrays.
///
/// # Errors
/// If the needs have several.
pub fn one_kind_of_edges(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let first = needs.iter().find_map(|need| Some((need, edges_within_cells(need)?)));
    let Some((first, edges)) = first else {
        return Ok(());
    };
    match needs.iter().find(|need| edges_within_cells(need) != Some(edges)) {
        None => Ok(()),
        Some(other) => Err(named(stage, other.name)
            .error(format!(
                "`{}` has patterns with {}, and `{}` has patterns without",
                first.name,
                described(edges),
                other.name
            ))
            .help("solve them in two stages")),
    }
}

/// Returns the scene that the needs of a stage were made with; `None` if none of them simulates.
pub fn scene_of(needs: &[StageDeclaration<'_>]) -> Option<Scene> {
    let (_, origin) = needs.iter().find_map(|need| nearest(need, simulating))?;
    read_of(&origin)
}

/// Refuses needs of different states of the device, or of different scenes.
///
/// # Errors
/// As [`one_state`]; or if two needs, or what they are made from, have different scenes.
pub fn one_device(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    one_state(stage, needs)?;
    one_scene(stage, needs)
}

/// Refuses needs of different scenes, as sweeps make them: no network and no calibration is of two scenes.
fn one_scene(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let read = |stage: &StageDeclaration<'_>| read_of(stage).map(|scene| scene.without_time());
    let mut origins = needs
        .iter()
        .filter_map(|need| Some((need.name, nearest(need, simulating)?)));
    let Some((first, (node, origin))) = origins.next() else {
        return Ok(());
    };
    let mut of_first = None;
    for (name, (_, other)) in origins.filter(|(_, (other, _))| !ptr::eq(*other, node)) {
        let one = of_first.get_or_insert_with(|| read(&origin));
        let (Some(one), Some(other)) = (one.as_ref(), read(&other)) else {
            continue;
        };
        if *one != other {
            let differences = Difference::listed(&one.differences(&other));
            return Err(named(stage, name)
                .error(format!("`{first}` and `{name}` have different scenes: {differences}"))
                .help("a stage reads results of one scene; use a stage for each scene"));
        }
    }
    Ok(())
}

/// Refuses labels of devices with sides that are not held that count from the mount: networks learn displacements from
/// rest, which only solved samples and verified designs have.
///
/// # Errors
/// If a need has such labels.
pub fn labels_from_rest(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let counts_from_mount = |need: &&StageDeclaration<'_>| {
        let scene = || nearest(need, simulating).and_then(|(_, origin)| read_of(&origin));
        ["balance", "import"].contains(&need.kind) && scene().is_some_and(|scene| scene.geometry.sides.is_some())
    };
    match needs.iter().find(counts_from_mount) {
        None => Ok(()),
        Some(need) => Err(named(stage, need.name)
            .error(format!(
                "the displacements of `{}` count from the mount, and networks of a device with `sides` that are not \
                 held predict those from rest",
                need.name
            ))
            .help("name stages of kind `solve` in place of it; `symmetry: d4` of a training makes the images")),
    }
}

/// Refuses needs of different states of the device: no network and no calibration is of two states.
///
/// # Errors
/// If two needs, or what they are made from, name different states.
pub fn one_state(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let mut states = needs.iter().filter_map(|need| Some((need.name, state_of(need)?)));
    let Some((first, one)) = states.next() else {
        return Ok(());
    };
    match states.find(|(_, other)| *other != one) {
        None => Ok(()),
        Some((name, other)) => Err(named(stage, name)
            .error(format!("`{first}` is of state `{one}` and `{name}` of state `{other}`"))
            .help("a stage reads labels of one state; use a stage for each state")),
    }
}

/// Refuses samples that a model was trained on: its errors on these do not predict its errors on others.
///
/// # Errors
/// If a model and samples that its training reads are both needed.
pub fn unseen(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let reads = |model: &&StageDeclaration<'_>, samples: &str| {
        model
            .needs()
            .any(|need| need.name == samples || (need.kind == "balance" && need.needs().any(|of| of.name == samples)))
    };
    // Of a balanced set the test rows are read, which no training uses.
    for samples in needs.iter().filter(|need| ["solve", "import"].contains(&need.kind)) {
        let mut models = needs.iter().filter(|need| need.kind == "train");
        if let Some(model) = models.find(|model| reads(model, samples.name)) {
            let message = format!(
                "the model `{}` was trained on the samples `{}`",
                model.name, samples.name
            );
            return Err(named(stage, samples.name)
                .error(message)
                .help("draw others with another seed, or use the test rows of a `balance` stage"));
        }
    }
    Ok(())
}

/// Refuses calibrations of models that a stage does not need.
///
/// # Errors
/// If a calibration is of another model.
pub fn own_calibrations(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    for calibration in needs.iter().filter(|need| need.kind == "calibrate") {
        let models: Vec<&str> = calibration
            .needs()
            .filter(|need| need.kind == "train")
            .map(|need| need.name)
            .collect();
        if !needs.iter().any(|need| models.contains(&need.name)) {
            let models = models.join("`, `");
            let message = format!(
                "the calibration `{}` is of the model `{models}`, which `needs` does not name",
                calibration.name
            );
            return Err(named(stage, calibration.name).error(message).help(format!(
                "add `{models}` to `needs`, or name a calibration of a model in `needs`"
            )));
        }
    }
    Ok(())
}

/// Refuses verified designs of a device of which no network is trained.
///
/// # Errors
/// If a need is a verify stage in a scene with states, or of a membrane that leaves its plane.
pub fn no_designs_without_networks(
    stage: &StageDeclaration<'_>,
    needs: &[StageDeclaration<'_>],
) -> Result<(), InputError> {
    for need in needs.iter().filter(|need| need.kind == "verify") {
        let Some(scene) = need.scene.and_then(|node| scene::read(node).ok()) else {
            continue;
        };
        let refused = |what: &str, help: &str| {
            let error = named(stage, need.name).error(format!("`{}` simulates {what}", need.name));
            Err(error.help(format!("remove it from `needs`, or remove `rounds`{help}")))
        };
        if scene.is_in_space() {
            return refused("a membrane that leaves its plane, of which there are no networks", "");
        }
        if !scene.states.is_empty() {
            return refused(
                "all states of the device, and a network is of one state",
                "; solve patterns in a `state` to train on more",
            );
        }
    }
    Ok(())
}

/// Refuses a file of measurements that several of the needs read: its numbers would count twice.
pub fn measured_once(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let mut seen: BTreeMap<PathBuf, &str> = BTreeMap::new();
    for need in needs {
        let files = need.node.peek("files").and_then(|files| files.list("files").ok());
        for entry in files.unwrap_or_default() {
            let Some(Ok(name)) = entry.peek("file").map(|file| file.text("file")) else {
                continue;
            };
            let path = entry.file().parent().unwrap_or(Path::new("")).join(name);
            let path = path.canonicalize().unwrap_or(path);
            if let Some(other) = seen.insert(path, need.name).filter(|other| *other != need.name) {
                let message = format!("`{}` and `{other}` read the same file {name}", need.name);
                return Err(wrong_number(stage, message, "name one of them"));
            }
        }
    }
    Ok(())
}
