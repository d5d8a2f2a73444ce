//! How each side of the membrane is supported: held, free, on rollers, under a load, or on a rigid bar.

use std::ops::RangeInclusive;

use serde_json::json;

use super::leads::Edge;
use deaflow_base::{
    Canonical, Declared, Fields, Force, InputError, Length, Map, Mass, Node, NodeValue, Parameter, Schema, SpringRate,
    parameters, words,
};
use deaflow_pattern::{Symmetries, Symmetry};

/// The largest force in N and spring rate in N/m.
const STRONGEST: f64 = 1e6;
/// Displacements and distances in mm.
const LENGTHS: RangeInclusive<f64> = -1e4..=1e4;
/// The largest mass in kg.
const HEAVIEST: f64 = 1e3;

words! {
    /// A motion of a bar.
    pub enum BarMotion {
        /// Along x.
        X = "x",
        /// Along y.
        Y = "y",
        /// About the middle of the side.
        Turn = "turn",
    }
}

words! {
    /// A support without further data.
    enum Plain {
        /// All displacements are zero.
        Held = "held",
        /// Nothing acts on the side.
        Free = "free",
        /// The displacement normal to the side is zero.
        Roller = "roller",
    }
}

parameters! {
    /// A rigid bar along a whole side.
    pub struct Bar as "`bar`" {
        /// The dead force on the bar along x and y.
        pub load: Option<[Force; 2]> [-STRONGEST..=STRONGEST],
        /// Where the force acts: the distance along the side from its middle, upwards or to the right. The place turns
        /// with the bar.
        pub at: Option<Length> [LENGTHS],
        /// A spring between the middle of the bar and its initial position.
        pub spring: Option<SpringRate> [0.0..=STRONGEST],
        /// The motions that the bar makes; all three if not given, none but this displacement if that is given.
        pub moves: Option<Vec<BarMotion>> [((), 0..=3)],
        /// A given displacement of the bar along x and y, instead of a load and a spring.
        pub displacement: Option<[Length; 2]> [LENGTHS],
        /// The mass of the bar, uniform along the side, for motions and natural frequencies.
        pub mass: Option<Mass> [0.0..=HEAVIEST],
    }
    rules(at_needs_load)
    check(check_bar)
}

fn at_needs_load(fields: Fields) -> Fields {
    fields.rule(json!({ "dependentRequired": { "at": ["load"] } }))
}

parameters! {
    /// A support with data: one of these.
    struct Loaded as "the support of a side" {
        /// The total dead force on the side along x and y, uniform along the prestretched side.
        load: Option<[Force; 2]> [-STRONGEST..=STRONGEST],
        /// A rigid bar.
        bar: Option<Bar>,
    }
    rules(one_of)
    check(check_loaded)
}

fn one_of(fields: Fields) -> Fields {
    fields.exactly_one(&["load", "bar"])
}

fn check_loaded(loaded: &Loaded, map: &Map<'_>) -> Result<(), InputError> {
    match loaded.load.is_some() == loaded.bar.is_some() {
        true => Err(map
            .error("the support of a side must be either a `load` or a `bar`")
            .help("for example { load: [0 N, 0.5 N] } or { bar: { load: [0.5 N, 0 N] } }")),
        false => Ok(()),
    }
}

fn check_bar(bar: &Bar, map: &Map<'_>) -> Result<(), InputError> {
    check_load(bar, map)?;
    if bar.displacement.is_none() {
        return Ok(());
    }
    let moves = |motion| bar.moves.iter().flatten().any(|known| *known == motion);
    let other = ["load", "spring"].into_iter().find_map(|key| map.optional(key));
    if let Some(other) = other {
        return Err(other
            .error("a bar with a given `displacement` takes no load and no spring")
            .help("the force that the displacement needs is the `reaction` of the side"));
    }
    match moves(BarMotion::X) || moves(BarMotion::Y) {
        true => Err(map
            .required("`bar`", "moves")?
            .error("the displacement of this bar is given, so it can only turn")
            .help("allowed: [] or [turn]")),
        false => Ok(()),
    }
}

/// Refuses a place without a load, and a load that nothing can follow.
fn check_load(bar: &Bar, map: &Map<'_>) -> Result<(), InputError> {
    let [x, y, turns] = bar.moves();
    let is_turned = turns && bar.at_mm() != 0.0;
    if let Some(at) = map.optional("at") {
        if bar.load.is_none() {
            return Err(at
                .error("`at` is the place of the `load` of a bar, and this bar has no load")
                .help("allowed: `at` with `load: [FORCE, FORCE]`; or remove it"));
        }
        if !turns && bar.at_mm() != 0.0 {
            return Err(at
                .error("the bar does not turn, so the place of its load has no effect")
                .help("allowed: 0 mm; or add `turn` to `moves`"));
        }
    }
    let blocked = [("x", x), ("y", y)].into_iter().zip(bar.load_n());
    let blocked = blocked.filter(|((_, moves), force)| !moves && *force != 0.0);
    match blocked
        .map(|((axis, _), force)| (axis, force))
        .next()
        .filter(|_| !is_turned && bar.displacement.is_none())
    {
        None => Ok(()),
        Some((axis, force)) => Err(map
            .required("`bar`", "load")?
            .error(format!(
                "the load of this bar is {force} N along {axis}, but the bar does not move along {axis}"
            ))
            .help(format!("allowed: 0 N along {axis}; or add `{axis}` to `moves`"))),
    }
}

/// What can be written for a side.
const ALLOWED: &str = "allowed: held, free, roller, { load: [FORCE, FORCE] }, { bar: … }";

/// How a side is supported.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub enum SideSupport {
    /// All displacements are zero.
    #[default]
    Held,
    /// Nothing acts on the side.
    Free,
    /// The displacement normal to the side is zero.
    Roller,
    /// A total dead force along x and y, uniform along the prestretched side.
    Load([Force; 2]),
    /// A rigid bar.
    Bar(Bar),
}

impl SideSupport {
    /// The name of its definition in schemas.
    pub(super) const DEFINITION: &'static str = "side";

    /// Returns the definition in schemas.
    pub(super) fn definition() -> Schema {
        Schema::any_of([Plain::schema(&()), Loaded::schema(&())])
    }

    /// Returns the word of the support.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Held => "held",
            Self::Free => "free",
            Self::Roller => "roller",
            Self::Load(_) => "load",
            Self::Bar(_) => "bar",
        }
    }

    /// Returns the components of the displacement, along x and y, that a side keeps at zero.
    #[must_use]
    pub fn holds(&self, edge: Edge) -> [bool; 2] {
        match self {
            Self::Held => [true; 2],
            Self::Roller => [0, 1].map(|axis| axis == edge.normal_axis()),
            Self::Free | Self::Load(_) | Self::Bar(_) => [false; 2],
        }
    }

    /// Returns the bar, if there is one.
    #[must_use]
    pub fn bar(&self) -> Option<&Bar> {
        match self {
            Self::Bar(bar) => Some(bar),
            _ => None,
        }
    }

    /// Returns the dead force of a load in N.
    #[must_use]
    pub fn load_n(&self) -> Option<[f64; 2]> {
        match self {
            Self::Load(load) => Some(load.map(|force| force.value())),
            _ => None,
        }
    }

    /// Returns the force on the side in N, and where it acts: mm from the middle, upwards or to the right; `None` if
    /// there is none.
    #[must_use]
    pub fn force(&self) -> Option<([f64; 2], f64)> {
        let (force, at) = match self {
            Self::Bar(bar) => (bar.load_n(), bar.at_mm()),
            other => (other.load_n()?, 0.0),
        };
        (force != [0.0; 2]).then_some((force, at))
    }
}

impl Edge {
    /// Returns the axis along the normal of the side: 0 for x, 1 for y.
    #[must_use]
    pub fn normal_axis(self) -> usize {
        match self {
            Self::Left | Self::Right => 0,
            Self::Bottom | Self::Top => 1,
        }
    }

    /// Returns the corners at the ends of the side of a raster with these columns and rows, upwards or to the right.
    #[must_use]
    pub fn ends(self, [columns, rows]: [usize; 2]) -> [[usize; 2]; 2] {
        match self {
            Self::Left => [[0, 0], [0, rows]],
            Self::Right => [[columns, 0], [columns, rows]],
            Self::Bottom => [[0, 0], [columns, 0]],
            Self::Top => [[0, rows], [columns, rows]],
        }
    }

    /// Returns the outward normal.
    #[must_use]
    pub fn normal(self) -> [f64; 2] {
        match self {
            Self::Left => [-1.0, 0.0],
            Self::Right => [1.0, 0.0],
            Self::Bottom => [0.0, -1.0],
            Self::Top => [0.0, 1.0],
        }
    }

    /// Returns the two sides that meet this one at a corner.
    fn neighbours(self) -> [Self; 2] {
        match self.normal_axis() {
            0 => [Self::Bottom, Self::Top],
            _ => [Self::Left, Self::Right],
        }
    }

    /// Returns the middle of the side of a membrane of a size.
    #[must_use]
    pub fn middle(self, size: [f64; 2]) -> [f64; 2] {
        let axis = self.normal_axis();
        let mut middle = size.map(|side| 0.5 * side);
        middle[axis] = match self {
            Self::Left | Self::Bottom => 0.0,
            Self::Right | Self::Top => size[axis],
        };
        middle
    }
}

impl Parameter for SideSupport {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        if matches!(node.value(), NodeValue::Map(_)) {
            let Loaded { load, bar } = Loaded::read_with(node, &[])?;
            return Ok(match (load, bar) {
                (Some(load), _) => Self::Load(load),
                (None, Some(bar)) => Self::Bar(bar),
                (None, None) => unreachable!("one of them is given"),
            });
        }
        let plain = Plain::read(node, key, &()).map_err(|error| error.help(ALLOWED))?;
        Ok(match plain {
            Plain::Held => Self::Held,
            Plain::Free => Self::Free,
            Plain::Roller => Self::Roller,
        })
    }

    fn canonical(&self) -> Option<Canonical> {
        let loaded = |load, bar| Some(Loaded { load, bar }.to_canonical());
        match self {
            Self::Held => None,
            Self::Free => Plain::Free.canonical(),
            Self::Roller => Plain::Roller.canonical(),
            Self::Load(load) => loaded(Some(*load), None),
            Self::Bar(bar) => loaded(None, Some(bar.clone())),
        }
    }

    fn schema((): &()) -> Schema {
        Schema::reference(Self::DEFINITION)
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

parameters! {
    /// How the sides of the membrane are supported; held where not given.
    pub struct Sides as "`sides`" {
        /// The left side.
        pub left: Option<SideSupport>,
        /// The right side.
        pub right: Option<SideSupport>,
        /// The lower side.
        pub bottom: Option<SideSupport>,
        /// The upper side.
        pub top: Option<SideSupport>,
    }
    check(check)
}

const HELD: &SideSupport = &SideSupport::Held;

impl Sides {
    /// Returns the support of a side.
    #[must_use]
    pub fn of(&self, edge: Edge) -> &SideSupport {
        let given = match edge {
            Edge::Left => &self.left,
            Edge::Right => &self.right,
            Edge::Bottom => &self.bottom,
            Edge::Top => &self.top,
        };
        given.as_ref().unwrap_or(HELD)
    }

    /// Returns all sides with their supports.
    pub fn iter(&self) -> impl Iterator<Item = (Edge, &SideSupport)> {
        Edge::ALL.into_iter().map(|edge| (edge, self.of(edge)))
    }

    /// Returns the sides with bars.
    pub fn bars(&self) -> impl Iterator<Item = (Edge, &Bar)> {
        self.iter().filter_map(|(edge, side)| Some((edge, side.bar()?)))
    }

    /// Returns whether some displacement is free on the low (0) or high (1) side along an axis.
    #[must_use]
    pub fn moves(&self, axis: usize, end: usize) -> bool {
        let mut along = Edge::ALL.into_iter().filter(|edge| edge.normal_axis() == axis);
        along.nth(end).is_some_and(|edge| self.of(edge) != HELD)
    }

    /// Returns the canonical form, in which sides that are held are not given; `None` if all are.
    #[must_use]
    pub fn normalised(self) -> Option<Self> {
        let given = |side: Option<SideSupport>| side.filter(|side| *side != SideSupport::Held);
        let sides = Self {
            left: given(self.left),
            right: given(self.right),
            bottom: given(self.bottom),
            top: given(self.top),
        };
        let are_held = sides.iter().all(|(_, side)| side == HELD);
        (!are_held).then_some(sides)
    }

    /// Returns the sides without forces on them; `None` if all forces are zero.
    #[must_use]
    pub(super) fn without_loads(&self) -> Option<Self> {
        let is_loaded = self.iter().any(|(_, side)| side.force().is_some());
        is_loaded.then(|| {
            let unloaded = self.map_bars(|bar| Bar {
                load: None,
                at: None,
                ..bar
            });
            unloaded.map(|side| match side {
                SideSupport::Load(_) => SideSupport::Free,
                other => other.clone(),
            })
        })
    }

    /// Returns the sides with bars of given motions in their initial position; `None` if all are there.
    #[must_use]
    pub(super) fn without_displacements(&self) -> Option<Self> {
        let mut moved = self.bars().filter_map(|(_, bar)| bar.displacement_mm());
        moved.any(|by| by != [0.0; 2]).then(|| {
            self.map_bars(|bar| Bar {
                displacement: bar.displacement.map(|_| [Length::literal("0 mm"); 2]),
                ..bar
            })
        })
    }

    /// Returns the sides without the masses of bars.
    #[must_use]
    pub(super) fn without_masses(&self) -> Self {
        self.map_bars(|bar| Bar { mass: None, ..bar })
    }

    fn map_bars(&self, change: impl Fn(Bar) -> Bar) -> Self {
        self.map(|side| match side {
            SideSupport::Bar(bar) => SideSupport::Bar(change(bar.clone())),
            other => other.clone(),
        })
    }

    fn map(&self, change: impl Fn(&SideSupport) -> SideSupport) -> Self {
        let each = |side: &Option<SideSupport>| side.as_ref().map(&change);
        Self {
            left: each(&self.left),
            right: each(&self.right),
            bottom: each(&self.bottom),
            top: each(&self.top),
        }
    }

    /// Returns the symmetries that map each side to one with the same support.
    pub(super) fn symmetries(&self, of: Symmetries) -> Symmetries {
        of.filter(|g| {
            self.iter().all(|(edge, side)| {
                let normal = g.apply_vector(edge.normal());
                let image = Edge::ALL.into_iter().find(|edge| edge.normal() == normal);
                image.is_some_and(|image| Action::of(edge, side).image(g) == Action::of(image, self.of(image)))
            })
        })
    }
}

/// What a side does, as vectors that symmetries map.
#[derive(PartialEq)]
struct Action {
    has_bar: bool,
    /// Whether x and y are held, or do not move by themselves on a bar.
    fixed: [bool; 2],
    turns: bool,
    load: [f64; 2],
    given: [f64; 2],
    /// From the middle of the side to the place of the load.
    arm: [f64; 2],
    spring: f64,
    mass: f64,
}

impl Action {
    fn of(edge: Edge, side: &SideSupport) -> Self {
        let mut action = Self {
            has_bar: side.bar().is_some(),
            fixed: side.holds(edge),
            turns: true,
            load: side.load_n().unwrap_or_default(),
            given: [0.0; 2],
            arm: [0.0; 2],
            spring: 0.0,
            mass: 0.0,
        };
        if let Some(bar) = side.bar() {
            let [x, y, turns] = bar.moves();
            action.arm[1 - edge.normal_axis()] = bar.at_mm();
            action = Self {
                fixed: [!x, !y],
                turns,
                load: bar.load_n(),
                given: bar.displacement_mm().unwrap_or_default(),
                spring: bar.spring_n_per_m(),
                mass: bar.mass_kg(),
                ..action
            };
        }
        action
    }

    /// Returns the image under a symmetry.
    fn image(self, g: Symmetry) -> Self {
        let [x, y] = self.fixed;
        Self {
            fixed: if g.exchanges_axes() { [y, x] } else { [x, y] },
            load: g.apply_vector(self.load),
            given: g.apply_vector(self.given),
            arm: g.apply_vector(self.arm),
            ..self
        }
    }
}

impl Bar {
    /// Returns the force in N.
    #[must_use]
    pub fn load_n(&self) -> [f64; 2] {
        self.load.map_or([0.0; 2], |load| load.map(|force| force.value()))
    }

    /// Returns the distance of the force from the middle of the side in mm.
    #[must_use]
    pub fn at_mm(&self) -> f64 {
        self.at.map_or(0.0, |at| at.value())
    }

    /// Returns the spring rate in N/m.
    #[must_use]
    pub fn spring_n_per_m(&self) -> f64 {
        self.spring.map_or(0.0, |spring| spring.value())
    }

    /// Returns the mass in kg.
    #[must_use]
    pub fn mass_kg(&self) -> f64 {
        self.mass.map_or(0.0, |mass| mass.value())
    }

    /// Returns the given displacement in mm.
    #[must_use]
    pub fn displacement_mm(&self) -> Option<[f64; 2]> {
        self.displacement.map(|by| by.map(|length| length.value()))
    }

    /// Returns whether the bar moves along x, along y, and turns, by itself.
    #[must_use]
    pub fn moves(&self) -> [bool; 3] {
        let all = [BarMotion::X, BarMotion::Y, BarMotion::Turn];
        match (&self.moves, &self.displacement) {
            (Some(moves), _) => all.map(|motion| moves.contains(&motion)),
            (None, None) => [true; 3],
            (None, Some(_)) => [false; 3],
        }
    }
}

fn check(sides: &Sides, map: &Map<'_>) -> Result<(), InputError> {
    for (edge, bar) in sides.bars() {
        let name = edge.name();
        let node = map.required("`sides`", name)?;
        for other in edge.neighbours() {
            let beside = other.name();
            match sides.of(other) {
                SideSupport::Held => {
                    return Err(node
                        .error(format!(
                            "the bar on the {name} side ends at the {beside} side, which is held"
                        ))
                        .help(format!("free the {beside} side, or put it on a roller")));
                }
                SideSupport::Bar(_) => {
                    return Err(node
                        .error(format!("the bars on the {name} and the {beside} side meet at a corner"))
                        .help("use bars on opposite sides only"));
                }
                SideSupport::Roller => {
                    let across = other.normal_axis();
                    let [x, y, turns] = bar.moves();
                    let given = bar.displacement_mm().unwrap_or_default();
                    if [x, y][across] || turns || given[across] != 0.0 {
                        let along = ["y", "x"][across];
                        return Err(node
                            .error(format!(
                                "the bar on the {name} side ends on the roller of the {beside} side, so it moves along \
                                 {along} only"
                            ))
                            .help(format!("give the bar `moves: [{along}]`")));
                    }
                }
                SideSupport::Free | SideSupport::Load(_) => {}
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::Scene;

    fn sides(text: &str) -> Result<Scene, String> {
        let text = format!(
            "{{ geometry: {{ size: [40 mm, 20 mm], thickness: 1 mm, prestretch: [2, 1], cells: [20, 10], sides: {text} \
             }}, material: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {{ \
             voltage: 4 kV }} }}"
        );
        Scene::from_text(&text).map_err(|error| error.to_string())
    }

    #[test]
    fn sides_that_are_held_are_in_no_key() {
        let plain = sides("{}").unwrap();
        assert_eq!(plain.geometry.sides, None);
        assert_eq!(
            sides("{ left: held, top: held }").unwrap().canonical(),
            plain.canonical()
        );
        let bar = sides("{ right: { bar: { load: [0.5 N, 0 N], at: 4 mm } }, top: free, bottom: free }").unwrap();
        let text = bar.to_text();
        assert!(text.contains("top: free") && !text.contains("left"), "{text}");
        assert_eq!(Scene::from_text(&text).unwrap(), bar);
    }

    #[test]
    fn masses_of_bars_count_with_inertia_only() {
        let of = |mass: &str, effects: &str| {
            let bars = format!(
                "right: {{ bar: {{ load: [1 N, 0 N]{mass} }} }}, left: {{ bar: {{ load: [-1 N, 0 N], spring: 1 N/m }} }}, \
                 top: free, bottom: free"
            );
            let bars = bars.replace("[1 N, 0 N]", "[1 N, 0 N], spring: 1 N/m");
            let text = sides(&format!("{{ {bars} }}")).unwrap().to_text();
            Scene::from_text(&text.replace("effects: {}", effects)).unwrap()
        };
        for (effects, counts) in [
            ("effects: {}", false),
            (
                "effects: { viscoelasticity: { branches: [{ modulus: 1 kPa, time: 1 s }] } }",
                false,
            ),
            ("effects: { inertia: { density: 960 kg/m3 } }", true),
            ("effects: auto", true),
        ] {
            let (light, heavy) = (of("", effects), of(", mass: 20 g", effects));
            assert_ne!(light.canonical(), heavy.canonical());
            assert_eq!(light.simulated() != heavy.simulated(), counts, "{effects}");
            assert_eq!(
                light.symmetries().count() != heavy.symmetries().count(),
                counts,
                "{effects}"
            );
            let text = heavy.to_text();
            assert!(text.contains("mass: 0.02"), "{text}");
            assert_eq!(Scene::from_text(&text).unwrap(), heavy);
        }
    }

    #[test]
    fn symmetries_map_sides_to_sides_with_the_same_support() {
        for (text, count) in [
            ("{ left: free, right: free }", 4),
            ("{ right: free }", 2),
            ("{ right: { bar: { load: [1 N, 0 N] } }, top: free, bottom: free }", 2),
            (
                "{ right: { bar: { load: [1 N, 0 N], at: 4 mm } }, top: free, bottom: free }",
                1,
            ),
            ("{ right: { bar: { load: [0 N, 1 N] } }, top: free, bottom: free }", 1),
            ("{ right: roller, left: roller }", 4),
            ("{ top: { load: [0 N, 1 N] }, bottom: { load: [0 N, -1 N] } }", 4),
            ("{ top: { load: [0 N, 1 N] }, bottom: { load: [0 N, 1 N] } }", 2),
        ] {
            assert_eq!(sides(text).unwrap().symmetries().count(), count, "{text}");
        }
    }

    #[test]
    fn corners_that_two_supports_share_are_checked() {
        for (text, expected) in [
            ("{ right: { bar: {} } }", "ends at the bottom side, which is held"),
            (
                "{ right: { bar: {} }, top: { bar: {} }, bottom: free, left: free }",
                "meet at a corner",
            ),
            (
                "{ right: { bar: {} }, top: free, bottom: roller }",
                "moves along x only",
            ),
            ("{ right: { load: [1 N, 0 N], bar: {} } }", "either a `load` or a `bar`"),
            (
                "{ right: { bar: { at: 4 mm } }, top: free, bottom: free }",
                "this bar has no load",
            ),
            (
                "{ right: { bar: { displacement: [1 mm, 0 mm], at: 4 mm } }, top: free, bottom: free }",
                "this bar has no load",
            ),
            (
                "{ right: { bar: { moves: [x], load: [1 N, 0 N], at: 4 mm } }, top: free, bottom: free }",
                "does not turn",
            ),
            (
                "{ right: { bar: { moves: [x], load: [1 N, 0.5 N] } }, top: free, bottom: free }",
                "0.5 N along y, but the bar does not move along y",
            ),
            (
                "{ right: { bar: { moves: [turn], load: [1 N, 0 N] } }, top: free, bottom: free }",
                "1 N along x, but",
            ),
            (
                "{ right: { bar: { displacement: [1 mm, 0 mm], load: [1 N, 0 N] } }, top: free, bottom: free }",
                "takes no load",
            ),
            (
                "{ right: { bar: { displacement: [1 mm, 0 mm], spring: 2 N/m } }, top: free, bottom: free }",
                "no spring",
            ),
            (
                "{ right: { bar: { displacement: [1 mm, 0 mm], moves: [x] } }, top: free, bottom: free }",
                "only turn",
            ),
            (
                "{ left: free, right: { bar: { load: [1 N, 0 N] } }, top: free, bottom: free }",
                "nothing holds the membrane along x",
            ),
            (
                "{ left: roller, right: { load: [1 N, 0.1 N] }, top: free, bottom: free }",
                "nothing holds the membrane along y",
            ),
            (
                "{ left: { load: [0 N, -1 N] }, right: { load: [0 N, 1 N] }, top: free, bottom: free }",
                "nothing keeps the membrane from turning",
            ),
            (
                "{ left: free, right: { bar: { moves: [turn], load: [1 N, 0 N], at: 4 mm } }, top: free, bottom: free \
                 }",
                "nothing keeps the membrane from turning",
            ),
            (
                "{ left: { bar: { moves: [y, turn] } }, right: { bar: { moves: [turn] } }, top: free, bottom: free }",
                "nothing keeps the membrane from turning",
            ),
        ] {
            let error = sides(text).unwrap_err();
            assert!(error.contains(expected), "{text}: {error}");
        }
        for text in [
            "{ right: { bar: { moves: [x] } }, top: free, bottom: roller }",
            "{ right: { bar: { moves: [x], load: [1 N, 0 N], at: 0 mm } }, top: free, bottom: roller }",
            "{ right: { bar: { moves: [turn], load: [1 N, 0 N], at: 4 mm } }, top: free, bottom: free }",
            "{ left: free, right: { bar: { spring: 1 N/m, moves: [x, y] } }, top: free, bottom: free }",
            "{ left: roller, right: free, bottom: roller, top: free }",
        ] {
            assert!(sides(text).unwrap().geometry.floating().is_none(), "{text}");
        }
    }
    #[test]
    fn motions_of_the_whole_that_nothing_resists_are_found() {
        use crate::{Edge, Floating, Pivot};
        let free = |along, turn| Floating { along, turn };
        for (text, expected) in [
            (
                "{ left: free, right: free, top: free, bottom: free }",
                free([true; 2], Some(Pivot::Any)),
            ),
            (
                "{ left: free, right: { bar: {} }, top: free, bottom: free }",
                free([true; 2], Some(Pivot::Any)),
            ),
            (
                "{ left: roller, right: { load: [1 N, 0 N] }, top: free, bottom: free }",
                free([false, true], None),
            ),
            (
                "{ left: free, right: { bar: { moves: [turn] } }, top: free, bottom: free }",
                free([false; 2], Some(Pivot::Bar(Edge::Right))),
            ),
            (
                "{ left: free, right: { bar: { moves: [x, turn] } }, top: free, bottom: free }",
                free([true, false], Some(Pivot::Bar(Edge::Right))),
            ),
            (
                "{ left: { bar: { load: [-1 N, 0 N], at: 2 mm } }, right: { bar: { load: [1 N, 0 N], at: 2 mm } }, \
                 top: free, bottom: free }",
                free([true; 2], None),
            ),
            (
                "{ left: { load: [0 N, -0.5 N] }, right: { load: [0 N, 0.5 N] }, top: { load: [1 N, 0 N] }, bottom: { \
                 load: [-1 N, 0 N] } }",
                free([true; 2], None),
            ),
        ] {
            let found = sides(text).map(|scene| scene.geometry.floating());
            assert_eq!(found, Ok(expected), "{text}");
        }
    }
}
