//! One stage for each combination of values, with the needs that belong to it.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use super::axes::{FOREACH, combinations, declared, too_many, unused};
use super::matching::{Matching, combined, projected};
use super::settings::{Setting, Settings, joined, key, name, value_of};
use super::substitute::{Substitution, no_axis};
use super::template::{axes_in, is_template, place_of};
use super::{MANY_STAGES, Sweep};
use crate::entry::{Registry, misspelt, refuse_cycle_of, suggestion};
use crate::graph;
use crate::kind::Kind;
use crate::scene_from::{self, FROM, SCENE};
use crate::without::{WITHOUT, names_stage};
use deaflow_base::{InputError, Node, NodeValue};

/// The key that ends axes.
pub const GATHER: &str = "gather";

/// Where a stage whose kind collects finds which of its needs belong together. No file may have it.
pub const ROWS: &str = "rows";

/// Where it finds the kinds of its needs. No file may have it.
pub const KINDS: &str = "kinds";

/// Where a stage finds its own scene, where scenes differ. No file may have it.
pub const SWEPT_SCENE: &str = "scene of the sweep";

const NEEDS: &str = "needs";

/// Unrolls the sweeps of a pipeline of at most `most` stages.
///
/// # Errors
/// If axes cannot be read, stages need each other in a circle, values contradict each other, or there are too many
/// stages.
pub fn unroll(root: &mut Node, registry: &Registry, most: usize) -> Result<Vec<Sweep>, InputError> {
    let Some(stages) = root.peek("stages") else {
        return Ok(Vec::new());
    };
    let entries = stages.entries("stages")?;
    let scene_axes = root.peek(SCENE).map(axes_in).unwrap_or_default();
    let sweeps = entries.iter().any(|(_, node)| is_swept(node, registry)) || !scene_axes.is_empty();
    if !sweeps {
        return Ok(Vec::new());
    }
    let mut expansion = Expansion {
        templates: templates(entries, registry, most)?,
        registry,
        most,
        count: 0,
        scene: root.peek(SCENE).filter(|_| !scene_axes.is_empty()),
        scene_axes,
        substitution: Substitution::default(),
        scenes: BTreeMap::new(),
        instances: entries.iter().map(|_| Vec::new()).collect(),
    };
    let order = expansion.order()?;
    let used = expansion.used(&order);
    for place in order {
        expansion.expand(place)?;
    }
    expansion.check_used(&used)?;
    let (sweeps, unrolled) = expansion.unrolled();
    let list = stages.with_value(NodeValue::Map(unrolled));
    root.replace("stages", list);
    Ok(sweeps)
}

/// Whether a stage cannot be read as it stands in the file.
fn is_swept(node: &Node, registry: &Registry) -> bool {
    let own = [FOREACH, GATHER].into_iter().any(|key| node.peek(key).is_some());
    own || is_template(node) || registry.kind_of(node).is_some_and(Kind::collects)
}

/// Names stages by more axes where those that names carry have ended.
fn tell_apart(stage: &str, made: &mut [Instance]) {
    let names: BTreeSet<&str> = made.iter().map(|instance| instance.name.as_str()).collect();
    if names.len() == made.len() {
        return;
    }
    for instance in made {
        let words = instance.settings.iter_mut().filter(|setting| setting.is_word());
        words.for_each(|setting| setting.shown = true);
        instance.name = name(stage, &instance.settings);
    }
}

/// A stage as it stands in the file.
struct Template<'a> {
    name: &'a str,
    key: &'a Node,
    node: &'a Node,
    /// Its own axes, and what it needs with each of their combinations.
    own: Vec<(Settings, Vec<Need>)>,
    gather: Gather,
}

/// What a stage needs.
#[derive(Clone)]
struct Need {
    template: usize,
    /// The one stage of a sweep that is meant, where one is named.
    stage: Option<String>,
    /// The key that names it: `needs` or `without`.
    key: &'static str,
    node: Node,
}

/// Which axes of its needs end at a stage.
enum Gather {
    None,
    All,
    Axes(Vec<Node>),
}

impl Gather {
    fn read(node: &Node, kind: Option<&'static dyn Kind>) -> Result<Self, InputError> {
        let collects = kind.is_some_and(Kind::collects);
        Ok(match node.peek(GATHER) {
            None if collects => Self::All,
            None => Self::None,
            Some(axes) if matches!(axes.value(), NodeValue::List(_)) => {
                let axes = axes.list(GATHER)?;
                axes.iter().try_for_each(|axis| axis.text(GATHER).map(|_| ()))?;
                Self::Axes(axes.to_vec())
            }
            Some(all) => match all.bool(GATHER)? {
                true => Self::All,
                false => Self::None,
            },
        })
    }

    fn ends(&self, axis: &str) -> bool {
        match self {
            Self::None => false,
            Self::All => true,
            Self::Axes(axes) => axes.iter().any(|other| other.is_text(axis)),
        }
    }
}

fn templates<'a>(
    entries: &'a [(Node, Node)],
    registry: &Registry,
    most: usize,
) -> Result<Vec<Template<'a>>, InputError> {
    let mut names = Vec::with_capacity(entries.len());
    for (key, _) in entries {
        names.push(key.text("a stage's name")?);
    }
    let places: BTreeMap<&str, usize> = names.iter().enumerate().map(|(place, name)| (*name, place)).collect();
    let template = |((key, node), name): (&'a (Node, Node), &&'a str)| {
        node.entries(&format!("stages.{name}"))?;
        let from = match registry.reads_scene(node) {
            true => scene_from::named(node)?,
            false => None,
        };
        let hidden = [ROWS, KINDS, SWEPT_SCENE].into_iter();
        for hidden in hidden.chain(from.is_none().then_some(SCENE)) {
            if let Some(value) = node.peek(hidden) {
                let help = match hidden {
                    SCENE => {
                        "the scene stands at the top of the file; \"${axis}\" in it is the value of a stage's axis"
                    }
                    _ => "rows follow from the axes of what the stage needs",
                };
                return Err(value
                    .error(format!("unknown key `{hidden}` in stage `{name}`"))
                    .help(help));
            }
        }
        let with_needs = |settings: Settings| {
            let mut all = needs(node, NEEDS, &settings, &places, &names)?;
            if has_without(node, registry) {
                all.extend(needs(node, WITHOUT, &settings, &places, &names)?);
            }
            if let Some(from) = from {
                let from = Substitution::default().of(from, &settings)?;
                all.push(need(&from, SCENE, &places, &names)?);
            }
            Ok((settings, all))
        };
        let own = combinations(node, most)?.into_iter().map(with_needs);
        Ok(Template {
            name,
            key,
            node,
            own: own.collect::<Result<_, InputError>>()?,
            gather: Gather::read(node, registry.kind_of(node))?,
        })
    };
    entries.iter().zip(&names).map(template).collect()
}

/// Whether the key `without` of a stage names stages.
fn has_without(node: &Node, registry: &Registry) -> bool {
    registry.kind_of(node).is_some_and(|kind| !kind.without().is_empty())
}

/// Returns the stages that a stage names under a key. Names of files are skipped.
fn needs(
    node: &Node,
    key: &'static str,
    own: &[Setting],
    places: &BTreeMap<&str, usize>,
    names: &[&str],
) -> Result<Vec<Need>, InputError> {
    let Some(list) = node.peek(key) else {
        return Ok(Vec::new());
    };
    let mut needs = Vec::new();
    for item in Substitution::default().of(list, own)?.list(key)? {
        let name = item.text(key)?;
        if key == WITHOUT && !names_stage(name) {
            continue;
        }
        needs.push(need(item, key, places, names)?);
    }
    Ok(needs)
}

/// Returns the stage that a node names.
fn need(item: &Node, key: &'static str, places: &BTreeMap<&str, usize>, names: &[&str]) -> Result<Need, InputError> {
    let name = item.text(key)?;
    let base = name.split_once('@').map_or(name, |(base, _)| base);
    let Some(&template) = places.get(base) else {
        let message = format!("no stage is named `{name}`");
        return Err(item.error(message).help(suggestion(name, names)));
    };
    Ok(Need {
        template,
        stage: (base != name).then(|| name.to_owned()),
        key,
        node: item.clone(),
    })
}

/// A stage of a sweep.
struct Instance {
    name: String,
    settings: Settings,
    /// The values that its scene may have.
    scene: Settings,
    node: Node,
}

struct Expansion<'a> {
    templates: Vec<Template<'a>>,
    registry: &'a Registry,
    most: usize,
    count: usize,
    /// The scene of the file, where it has axes.
    scene: Option<&'a Node>,
    scene_axes: Vec<String>,
    substitution: Substitution,
    /// Scenes by the values of its axes.
    scenes: BTreeMap<String, Node>,
    instances: Vec<Vec<Instance>>,
}

/// The stages that one need of a template may mean.
struct Candidates<'i> {
    template: usize,
    /// The key that names them.
    key: &'static str,
    /// All stages of that template.
    instances: &'i [Instance],
    /// The one that is named; its axes are not those of the stage that needs it.
    named: Option<usize>,
}

/// The stages of each template that is needed, to be found by their values.
type Matchings<'i> = BTreeMap<usize, Matching<'i>>;

impl<'i> Candidates<'i> {
    /// Those that contradict no value.
    fn of(&self, settings: &[Setting], matchings: &mut Matchings<'i>) -> Vec<&'i Instance> {
        let places = match self.named {
            Some(place) => vec![place],
            None => matchings
                .entry(self.template)
                .or_insert_with(|| {
                    Matching::new(self.instances.iter().map(|instance| &instance.settings[..]).collect())
                })
                .of(settings),
        };
        places.into_iter().map(|place| &self.instances[place]).collect()
    }

    /// The values that count of one of them.
    fn settings(&self, instance: &'i Instance) -> &'i [Setting] {
        match self.named {
            Some(_) => &[],
            None => &instance.settings,
        }
    }
}

impl<'a> Expansion<'a> {
    /// The templates, what is needed first.
    fn order(&self) -> Result<Vec<usize>, InputError> {
        let needs = |template: &Template<'_>| {
            let needs = template.own.iter().flat_map(|(_, needs)| needs);
            let mut places: Vec<usize> = needs.map(|need| need.template).collect();
            places.sort_unstable();
            places.dedup();
            places
        };
        graph::order(&self.templates.iter().map(needs).collect::<Vec<_>>()).map_err(|cycle| {
            let keys: Vec<(&str, &Node)> = cycle
                .iter()
                .map(|&at| (self.templates[at].name, self.templates[at].key))
                .collect();
            refuse_cycle_of(&keys)
        })
    }

    /// The axes that change something in each template or in what needs it: they are asked for there, or choose among
    /// needs.
    fn used(&self, order: &[usize]) -> Vec<BTreeSet<String>> {
        let count = self.templates.len();
        let (mut used, mut has): (Vec<BTreeSet<String>>, Vec<BTreeSet<String>>) =
            (vec![BTreeSet::new(); count], vec![BTreeSet::new(); count]);
        let needs = |template: &Template<'_>| -> BTreeSet<usize> {
            let needs = template.own.iter().flat_map(|(_, needs)| needs);
            needs.map(|need| need.template).collect()
        };
        for &place in order {
            let template = &self.templates[place];
            used[place].extend(axes_in(template.node));
            if self.registry.kind_of(template.node).is_some_and(Kind::reads_scene) {
                used[place].extend(self.scene_axes.iter().cloned());
            }
            let own = template.own.iter().flat_map(|(settings, _)| settings);
            let own: BTreeSet<String> = own.map(|setting| setting.axis.to_string()).collect();
            for need in needs(template) {
                // An axis of both: the values here choose among those there.
                let both: Vec<String> = own.intersection(&has[need]).cloned().collect();
                used[place].extend(both.iter().cloned());
                used[need].extend(both);
                let of_need = has[need].clone();
                has[place].extend(of_need);
            }
            has[place].extend(own);
        }
        for &place in order.iter().rev() {
            for need in needs(&self.templates[place]) {
                let asked = used[place].clone();
                used[need].extend(asked);
            }
        }
        used
    }

    /// Refuses axes that change nothing.
    fn check_used(&self, used: &[BTreeSet<String>]) -> Result<(), InputError> {
        for (template, used) in self.templates.iter().zip(used) {
            for (place, axes) in declared(template.node)? {
                if !axes.iter().any(|axis| used.contains(&**axis)) {
                    return Err(unused(&place, &axes, &format!("`{}`", template.name)));
                }
            }
        }
        Ok(())
    }

    fn expand(&mut self, place: usize) -> Result<(), InputError> {
        let own = std::mem::take(&mut self.templates[place].own);
        self.check_gathered(&self.templates[place], &own)?;
        let mut substitution = std::mem::take(&mut self.substitution);
        let mut made = Vec::new();
        let mut matchings = Matchings::new();
        for (settings, needs) in &own {
            let template = &self.templates[place];
            made.extend(self.of_combination(template, settings, needs, &mut matchings, &mut substitution)?);
            if self.count + made.len() > self.most {
                return Err(too_many(template.key, self.most));
            }
        }
        self.substitution = substitution;
        self.count += made.len();
        tell_apart(self.templates[place].name, &mut made);
        for instance in &mut made {
            self.put_scene(place, instance)?;
        }
        self.instances[place] = made;
        Ok(())
    }

    /// Refuses axes that nothing which a stage needs has.
    fn check_gathered(&self, template: &Template<'_>, own: &[(Settings, Vec<Need>)]) -> Result<(), InputError> {
        let Gather::Axes(axes) = &template.gather else {
            return Ok(());
        };
        let needs = own.iter().flat_map(|(_, needs)| needs);
        let instances = needs.flat_map(|need| &self.instances[need.template]);
        let known: BTreeSet<&str> = instances.flat_map(|of| &of.settings).map(|s| &*s.axis).collect();
        let unknown = axes.iter().find(|axis| !known.iter().any(|name| axis.is_text(name)));
        unknown.map_or(Ok(()), |axis| {
            let found = axis.text(GATHER)?;
            let known: Vec<&str> = known.into_iter().collect();
            let message = format!("nothing that `{}` needs has an axis `{found}`", template.name);
            Err(match known.is_empty() {
                true => axis.error(message).help("what it needs has no axes"),
                false => axis.error(message).help(suggestion(found, &known)),
            })
        })
    }

    /// The stages of a template with one combination of its own axes.
    fn of_combination<'i>(
        &'i self,
        template: &Template<'_>,
        own: &Settings,
        needs: &[Need],
        matchings: &mut Matchings<'i>,
        substitution: &mut Substitution,
    ) -> Result<Vec<Instance>, InputError> {
        let (mut candidates, mut lists) = (Vec::with_capacity(needs.len()), Vec::with_capacity(needs.len()));
        for need in needs {
            let these = self.candidates(need)?;
            let found = these.of(own, matchings);
            if found.is_empty() {
                let needed = self.templates[need.template].name;
                let message = format!(
                    "no stage of `{needed}` has the values of the axes of `{}`",
                    template.name
                );
                return Err(need.node.error(message));
            }
            let settings: Vec<&[Setting]> = found.into_iter().map(|instance| these.settings(instance)).collect();
            lists.push(projected(&settings, &|axis| !template.gather.ends(axis)));
            candidates.push(these);
        }
        let lists: Vec<Vec<&[Setting]>> = lists
            .iter()
            .map(|list| list.iter().map(Vec::as_slice).collect())
            .collect();
        let rows = combined(&lists, self.most).ok_or_else(|| too_many(template.key, self.most))?;
        if rows.is_empty() {
            let message = format!(
                "the needs of `{}` have no values of their axes in common",
                template.name
            );
            return Err(template.key.error(message));
        }
        let mut stripped = template.node.clone();
        [FOREACH, GATHER, NEEDS].iter().for_each(|key| stripped.remove(key));
        let mut instances = Vec::with_capacity(rows.len());
        for row in rows {
            let settings = joined(own, &row);
            let needed = candidates.iter().map(|these| these.of(&settings, matchings)).collect();
            let node = substitution.of(&stripped, &settings)?;
            instances.push(self.instance(template, node, settings, &candidates, needed)?);
        }
        Ok(instances)
    }

    fn candidates(&self, need: &Need) -> Result<Candidates<'_>, InputError> {
        let instances = &self.instances[need.template][..];
        let named = match &need.stage {
            None => None,
            Some(name) => Some(
                instances
                    .iter()
                    .position(|instance| instance.name == *name)
                    .ok_or_else(|| {
                        let names: Vec<&str> = instances.iter().map(|instance| instance.name.as_str()).collect();
                        let refused = need.node.error(format!("no stage is named `{name}`"));
                        refused.help(suggestion(name, &names))
                    })?,
            ),
        };
        Ok(Candidates {
            template: need.template,
            key: need.key,
            instances,
            named,
        })
    }

    fn instance(
        &self,
        template: &Template<'_>,
        mut node: Node,
        settings: Settings,
        candidates: &[Candidates<'_>],
        needed: Vec<Vec<&Instance>>,
    ) -> Result<Instance, InputError> {
        let text = |instance: &&Instance| template.key.with_value(NodeValue::Text(instance.name.clone()));
        let named_by = |key: &str| {
            let named = candidates.iter().zip(&needed).filter(|(these, _)| these.key == key);
            named.flat_map(|(_, stages)| stages).map(text).collect::<Vec<Node>>()
        };
        if let Some(list) = template.node.peek(NEEDS) {
            node.put(NEEDS, list.with_value(NodeValue::List(named_by(NEEDS))));
        }
        if let Some(list) = node.peek(WITHOUT).filter(|_| has_without(&node, self.registry)) {
            let items = list.list(WITHOUT)?.iter();
            let files = items.filter(|item| item.text(WITHOUT).is_ok_and(|name| !names_stage(name)));
            let items = files.cloned().chain(named_by(WITHOUT)).collect();
            node.put(WITHOUT, list.with_value(NodeValue::List(items)));
        }
        if let Some(from) = node.peek(SCENE).and_then(|scene| scene.peek(FROM)) {
            let scene = match &named_by(SCENE)[..] {
                [one] => from.with_value(NodeValue::Map(vec![(
                    from.with_value(NodeValue::Text(FROM.to_owned())),
                    one.clone(),
                )])),
                several => {
                    let message = format!("a stage has one scene, and {} stages are named", several.len());
                    return Err(from
                        .error(message)
                        .help("name one stage of the sweep, as in `from: fitted@r=3mm`"));
                }
            };
            node.put(SCENE, scene);
        }
        if self.registry.kind_of(&node).is_some_and(Kind::collects) {
            node.put(ROWS, self.rows(template, candidates, &needed)?);
            node.put(KINDS, self.kinds(template, candidates));
        }
        // A stage that needs one stage of a sweep by its name is of the scene of that one.
        let named = candidates.iter().filter_map(|these| these.instances.get(these.named?));
        let named: Vec<&Instance> = named.collect();
        let mut implied = named
            .iter()
            .fold(Vec::new(), |all, instance| joined(&all, &instance.scene));
        let agree = |setting: &Setting, instance: &&Instance| {
            let other = value_of(&instance.scene, &setting.axis);
            other.is_none_or(|other| other.text == setting.value.text)
        };
        implied.retain(|setting| named.iter().all(|instance| agree(setting, instance)));
        Ok(Instance {
            name: name(template.name, &settings),
            scene: joined(&settings, &implied),
            settings,
            node,
        })
    }

    /// The kinds of what a collecting stage needs, by the names of the file.
    fn kinds(&self, template: &Template<'_>, candidates: &[Candidates<'_>]) -> Node {
        let at = |value: NodeValue| template.key.with_value(value);
        let kind = |these: &Candidates<'_>| {
            let of = &self.templates[these.template];
            let kind = self.registry.kind_of(of.node).map_or("", Kind::name);
            let text = |text: &str| at(NodeValue::Text(text.to_owned()));
            (text(of.name), text(kind))
        };
        at(NodeValue::Map(candidates.iter().map(kind).collect()))
    }

    /// Which of the needs of a collecting stage belong together: a list of pairs, the values of axes by their names,
    /// and the numbers of needs by the names of the file.
    fn rows(
        &self,
        template: &Template<'_>,
        candidates: &[Candidates<'_>],
        needed: &[Vec<&Instance>],
    ) -> Result<Node, InputError> {
        let at = |value: NodeValue| template.key.with_value(value);
        let text = |text: &str| at(NodeValue::Text(text.to_owned()));
        let settings = |(these, found): (&Candidates<'_>, &Vec<&Instance>)| -> Vec<Settings> {
            found.iter().map(|instance| these.settings(instance).to_vec()).collect()
        };
        let lists: Vec<Vec<Settings>> = candidates.iter().zip(needed).map(settings).collect();
        let lists: Vec<Vec<&[Setting]>> = lists
            .iter()
            .map(|list| list.iter().map(Vec::as_slice).collect())
            .collect();
        let rows = combined(&lists, MANY_STAGES).ok_or_else(|| too_many(template.key, MANY_STAGES))?;
        let mut matchings: Vec<Matching<'_>> = lists.iter().map(|list| Matching::new(list.clone())).collect();
        let row = |row: Settings| {
            let axes = row.iter().map(|s| (text(&s.axis), s.value.node.clone())).collect();
            let (mut first, mut own) = (0, Vec::new());
            for (k, matching) in matchings.iter_mut().enumerate() {
                if let Some(place) = matching.of(&row).first() {
                    let name = text(self.templates[candidates[k].template].name);
                    own.push((name, at(NodeValue::Number((first + place).to_string()))));
                }
                first += lists[k].len();
            }
            at(NodeValue::List(vec![at(NodeValue::Map(axes)), at(NodeValue::Map(own))]))
        };
        Ok(at(NodeValue::List(rows.into_iter().map(row).collect())))
    }

    /// Gives a stage that reads the scene the scene with its own values.
    fn put_scene(&mut self, place: usize, instance: &mut Instance) -> Result<(), InputError> {
        let Some(scene) = self.scene else { return Ok(()) };
        if !self.registry.kind_of(&instance.node).is_some_and(Kind::reads_scene) {
            return Ok(());
        }
        let own = instance
            .scene
            .iter()
            .filter(|s| self.scene_axes.iter().any(|axis| **axis == *s.axis));
        let own: Settings = own.cloned().collect();
        if let Some(missing) = self
            .scene_axes
            .iter()
            .find(|axis| own.iter().all(|s| *s.axis != ***axis))
        {
            let message = format!(
                "the scene has the axis `{missing}`, and stage `{}` has not",
                self.templates[place].name
            );
            if let Some(key) = misspelt(self.templates[place].node, FOREACH, |_| false) {
                let unknown = format!(
                    "unknown key `{}` in stage `{}`",
                    key.quoted().trim_matches('`'),
                    self.templates[place].name
                );
                return Err(key.error(unknown).help(format!("did you mean `{FOREACH}`?")));
            }
            let names = self.axes()?;
            if let Some(at) = place_of(scene, missing).filter(|_| !names.contains(&**missing)) {
                let names: Vec<&str> = names.iter().map(|name| &**name).collect();
                let place = format!("in stage `{}` and those that it needs", self.templates[place].name);
                return Err(no_axis(at, missing, &names, &place));
            }
            let help = format!("add foreach: {{ {missing}: [ … ] }} to the stage or to one that it needs");
            return Err(self.templates[place].key.error(message).help(help));
        }
        let known = key(&own);
        if !self.scenes.contains_key(&known) {
            let scene = self.substitution.of(scene, &own)?;
            self.scenes.insert(known.clone(), scene);
        }
        if let Some(scene) = self.scenes.get(&known) {
            instance.node.put(SWEPT_SCENE, scene.clone());
        }
        Ok(())
    }

    /// The names of the axes that stages declare.
    fn axes(&self) -> Result<BTreeSet<Rc<str>>, InputError> {
        let mut names = BTreeSet::new();
        for template in &self.templates {
            names.extend(declared(template.node)?.into_iter().flat_map(|(_, axes)| axes));
        }
        Ok(names)
    }

    /// The sweeps, and the stages by their names in the order of the file.
    fn unrolled(self) -> (Vec<Sweep>, Vec<(Node, Node)>) {
        let (mut sweeps, mut stages) = (Vec::new(), Vec::new());
        for (template, instances) in self.templates.iter().zip(self.instances) {
            if instances.iter().any(|instance| !instance.settings.is_empty()) {
                sweeps.push(Sweep {
                    name: template.name.to_owned(),
                    stages: instances.iter().map(|instance| instance.name.clone()).collect(),
                });
            }
            for instance in instances {
                let key = template.key.with_value(NodeValue::Text(instance.name));
                stages.push((key, instance.node));
            }
        }
        (sweeps, stages)
    }
}
