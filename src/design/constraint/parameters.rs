//! The constraints of a design in YAML, as pipelines and artifacts contain them.

use std::fmt;

use super::{ConstraintError, Constraints, DesignDomain, Limits, Pad, Sides};
use crate::text::{flow_mapping, flow_value};
use deaflow_base::{
    Canonical, Decimal, Declared, InputError, Length, Map, Node, NodeValue, Parameter, Schema, parameters,
};
use deaflow_pattern::{Membrane, Pattern, Region};
use deaflow_scene::{Leads as LeadPlaces, Scene, Shape, Shapes};

/// The number of islands of a checkerboard.
const MAX_ISLANDS: u64 = 1250;

/// Smallest and largest length in mm.
const LENGTHS_MM: std::ops::RangeInclusive<f64> = 1e-6..=1e4;

parameters! {
    /// Constraints on designs.
    #[derive(Default)]
    struct DeclaredConstraints as "`constraints`" {
        /// Minimum width of electrodes and gaps.
        min_feature: Option<Length> [LENGTHS_MM],
        /// Minimum distance between electrodes of different groups; at least `min_feature`.
        gap: Option<Length> [LENGTHS_MM],
        /// Maximum number of separate electrode pieces of each group.
        islands: Option<u64> [1..=MAX_ISLANDS],
        /// Each piece must touch the frame (`true`), one of the listed sides of it, or contact pads: `{ shapes }` or `{
        /// cells }`.
        leads: Option<Leads>,
        /// Regions with electrodes, such as contact pads.
        keep_in: Option<Vec<KeepIn>> [((), 1..=1000)],
        /// Regions without electrodes.
        keep_out: KeepOut = KeepOut(Vec::new()),
        /// Minimum ratio of the breakdown field to the largest electric field.
        breakdown_margin: Option<Decimal> [1.0..=1e3],
        /// Minimum ratio of the pull-in voltage to the voltage.
        pull_in_margin: Option<Decimal> [1.0..=1e3],
    }
}

parameters! {
    /// Regions with electrodes of a group.
    struct GroupShapes as "`keep_in`" {
        /// The number of the group.
        group: u64 [1..=Pattern::MOST_GROUPS as u64],
        /// The shapes.
        shapes: Shapes,
    }
}

/// Regions with electrodes: one of group 1, or several of a group.
#[derive(Clone, Debug, PartialEq, Eq)]
enum KeepIn {
    Shape(Box<Shape>),
    Group(GroupShapes),
}

parameters! {
    /// Contact pads.
    struct PadShapes as "`leads`" {
        /// Their shapes.
        shapes: Shapes,
    }
}

/// Regions without electrodes, in the order of the YAML list.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct KeepOut(Vec<Shape>);

/// What each piece must touch.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Leads {
    /// Nothing.
    Off,
    /// Sides of the frame.
    Sides(Sides),
    /// Cells, as leads of a scene.
    Cells(LeadPlaces),
    /// Shapes.
    Shapes(PadShapes),
}

/// Constraints as declared in YAML, and converted for a membrane.
#[derive(Clone, Debug, PartialEq)]
pub struct ConstraintParameters {
    declared: DeclaredConstraints,
    constraints: Constraints,
}

impl ConstraintParameters {
    /// The YAML keys of constraints.
    #[must_use]
    pub fn keys() -> Vec<&'static str> {
        DeclaredConstraints::keys()
    }

    /// No constraints.
    #[must_use]
    pub fn none(membrane: Membrane) -> Self {
        Self {
            declared: DeclaredConstraints::default(),
            constraints: Constraints::none(membrane),
        }
    }

    /// No constraints in a scene.
    ///
    /// # Errors
    /// If its frame and bodies leave no cell for electrodes.
    pub fn none_in(scene: &Scene) -> Result<Self, ConstraintError> {
        Ok(Self {
            constraints: Constraints::new(Limits::default(), scene)?,
            ..Self::none(scene.membrane())
        })
    }

    /// Reads the mapping under `constraints` for a membrane or a scene.
    ///
    /// # Errors
    /// If a key is unknown, a value is out of range, or the constraints contradict each other.
    pub fn read(node: &Node, domain: impl Into<DesignDomain>) -> Result<Self, InputError> {
        let map = node.fields(DeclaredConstraints::WHAT, &DeclaredConstraints::keys())?;
        let declared = DeclaredConstraints::read_map(&map)?;
        let constraints = Constraints::new(declared.limits(), domain).map_err(|e| located(node, &map, &e))?;
        Ok(Self { declared, constraints })
    }

    /// [`Constraints::check_area`] with an error located at a node.
    ///
    /// # Errors
    /// As [`Constraints::check_area`].
    pub fn check_area(&self, node: &Node, area: f64, tolerance: f64) -> Result<(), InputError> {
        self.constraints.check_area(area, tolerance).map_err(|error| {
            let help = match error {
                ConstraintError::AreaTooSmall { .. } => "increase `area`, or reduce `min_feature`",
                ConstraintError::AreaBelowKeepIn { .. } => "increase `area`, or reduce `keep_in`",
                ConstraintError::AreaBetweenCells { .. } => "increase `area`, or use more cells",
                _ => "reduce `area`, or `keep_out`",
            };
            node.error(error.to_string()).help(help)
        })
    }

    /// [`Constraints::check_area_of_cells`] with an error located at a node.
    ///
    /// # Errors
    /// As [`Constraints::check_area_of_cells`].
    pub fn check_area_of_cells(&self, node: &Node, area: f64, tolerance: f64) -> Result<(), InputError> {
        let checked = self.constraints.check_area_of_cells(area, tolerance);
        checked.map_err(|error| {
            let help = "use one of these areas, increase `area_tolerance`, or use more cells";
            node.error(error.to_string()).help(help)
        })
    }

    /// The schema of [`ConstraintParameters::read`].
    #[must_use]
    pub fn schema() -> Schema {
        DeclaredConstraints::schema(&())
    }

    /// The canonical value.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        self.declared.to_canonical()
    }

    /// The constraints in YAML on one line; `{}` without constraints.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut entries = Vec::new();
        self.declared.entries(&mut entries);
        let text = |(key, value): (&'static str, Canonical)| match key {
            // The canonical value is sorted; the text keeps the given order.
            "keep_out" => (key, self.declared.keep_out.to_string()),
            key => (key, flow_value(&value)),
        };
        flow_mapping(entries.into_iter().map(text))
    }

    /// The constraints on the patterns of the membrane.
    #[must_use]
    pub fn constraints(&self) -> &Constraints {
        &self.constraints
    }
}

impl DeclaredConstraints {
    fn limits(&self) -> Limits {
        Limits {
            min_feature_mm: self.min_feature.map(|width| width.value()),
            gap_mm: self.gap.map(|width| width.value()),
            islands: self.islands.map(|n| n as usize),
            leads: match self.leads {
                Some(Leads::Sides(sides)) => Some(sides),
                _ => None,
            },
            pads: match &self.leads {
                Some(Leads::Shapes(pads)) => pads.shapes.regions().into_iter().map(Pad::Region).collect(),
                Some(Leads::Cells(LeadPlaces::Cells(cells))) => cells.iter().copied().map(Pad::Cell).collect(),
                _ => Vec::new(),
            },
            keep_in: self.keep_in.iter().flatten().flat_map(KeepIn::regions).collect(),
            keep_out: self.keep_out.0.iter().map(Shape::region).collect(),
            breakdown_margin: self.breakdown_margin.map(Decimal::to_f64),
            pull_in_margin: self.pull_in_margin.map(Decimal::to_f64),
        }
    }
}

impl Parameter for KeepOut {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let shapes = node.list(key)?.iter();
        shapes
            .map(|shape| Shape::read(shape, key, &()))
            .collect::<Result<_, _>>()
            .map(Self)
    }

    /// Sorted, without duplicates: the order has no effect.
    fn canonical(&self) -> Option<Canonical> {
        let mut shapes: Vec<Canonical> = self.0.iter().filter_map(Shape::canonical).collect();
        shapes.sort();
        shapes.dedup();
        (!shapes.is_empty()).then_some(Canonical::List(shapes))
    }

    fn schema((): &()) -> Schema {
        Schema::list(Shape::schema(&()), 0, usize::MAX)
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl fmt::Display for KeepOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shapes = self.0.iter().filter_map(Shape::canonical);
        f.write_str(&flow_value(&Canonical::List(shapes.collect())))
    }
}

impl KeepIn {
    /// The group of each region.
    fn regions(&self) -> Vec<(usize, Region)> {
        match self {
            Self::Shape(shape) => vec![(1, shape.region())],
            Self::Group(of) => {
                let regions = of.shapes.regions().into_iter();
                regions.map(|region| (of.group as usize, region)).collect()
            }
        }
    }
}

impl Parameter for KeepIn {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        match node.peek("group") {
            Some(_) => GroupShapes::read_with(node, &[]).map(Self::Group),
            None => Shape::read(node, key, &()).map(|shape| Self::Shape(Box::new(shape))),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match self {
            Self::Shape(shape) => shape.canonical(),
            Self::Group(of) => Some(of.to_canonical()),
        }
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([GroupShapes::schema(&()), Shape::schema(&())])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl Parameter for Leads {
    type Limits = ();
    type Literal = Self;

    /// `true` means all sides, `false` no leads.
    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        match (node.as_bool(), node.value()) {
            (Some(true), _) => return Ok(Self::Sides(Sides::ALL)),
            (Some(false), _) => return Ok(Self::Off),
            (None, NodeValue::Map(_)) if node.peek("cells").is_some() => {
                return LeadPlaces::read(node, key, &()).map(Self::Cells);
            }
            (None, NodeValue::Map(_)) => return PadShapes::read_with(node, &[]).map(Self::Shapes),
            (None, NodeValue::List(_)) => {}
            _ => {
                let message = format!(
                    "`{key}` must be true, false, a list of sides, or {{ shapes }} or {{ cells }}, found {}",
                    node.found()
                );
                let help = format!(
                    "sides: {}; leads at a place are `leads` of the scene, to which searches keep",
                    Sides::NAMES.join(", ")
                );
                return Err(node.error(message).help(help));
            }
        }
        let mut sides = Sides::default();
        for side in node.list(key)? {
            match side.word(key, &Sides::NAMES)? {
                "left" => sides.left = true,
                "right" => sides.right = true,
                "bottom" => sides.bottom = true,
                _ => sides.top = true,
            }
        }
        Ok(Self::Sides(sides))
    }

    fn canonical(&self) -> Option<Canonical> {
        let sides = match self {
            Self::Off => return None,
            Self::Cells(cells) => return cells.canonical(),
            Self::Shapes(shapes) => return Some(shapes.to_canonical()),
            Self::Sides(sides) => *sides,
        };
        if sides == Sides::ALL {
            return Some(Canonical::Bool(true));
        }
        let required = sides.named().into_iter().filter(|(_, required)| *required);
        Some(Canonical::List(required.map(|(name, _)| name.into()).collect()))
    }

    fn schema((): &()) -> Schema {
        let sides = Schema::list(Schema::word(&Sides::NAMES), 1, Sides::NAMES.len());
        Schema::any_of([Schema::bool(), sides, PadShapes::schema(&()), LeadPlaces::schema(&())])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

/// The error, located at the key that causes it.
fn located(node: &Node, map: &Map<'_>, error: &ConstraintError) -> InputError {
    let at = match error {
        ConstraintError::Number { name, .. } => map.optional(name),
        ConstraintError::Feature { .. } => map.optional("min_feature"),
        ConstraintError::Gap { .. } | ConstraintError::OneGroup => map.optional("gap").or(map.optional("min_feature")),
        ConstraintError::Outside { number, .. } | ConstraintError::Mask { number, .. } => {
            let list = map.optional("keep_out").and_then(|list| list.list("keep_out").ok());
            list.and_then(|list| list.get(number - 1))
        }
        ConstraintError::Group { number, .. } | ConstraintError::KeepIn { number, .. } => {
            // Entries of a group may have several regions.
            let list = map.optional("keep_in").and_then(|list| list.list("keep_in").ok());
            list.filter(|list| list.iter().all(|one| one.peek("group").is_none()))
                .and_then(|list| list.get(number - 1))
                .or(map.optional("keep_in"))
        }
        ConstraintError::Near { .. } => map.optional("keep_in"),
        ConstraintError::NoPad => map.optional("leads"),
        ConstraintError::NoSide | ConstraintError::Side { .. } | ConstraintError::NoLead => {
            map.optional("leads").or(map.optional("keep_out"))
        }
        ConstraintError::NoSpace => map.optional("keep_out"),
        ConstraintError::AreaTooLarge { .. }
        | ConstraintError::AreaTooSmall { .. }
        | ConstraintError::AreaBetweenCells { .. }
        | ConstraintError::AreaBelowKeepIn { .. } => None,
    };
    at.unwrap_or(node).error(error.to_string())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    const MEMBRANE: Membrane = Membrane::square(50.0);

    use super::*;
    use deaflow_base::Document;
    use deaflow_pattern::Raster;

    fn node(text: &str) -> Node {
        Document::from_text(Path::new("t"), text).unwrap().root
    }

    fn read(text: &str) -> Result<ConstraintParameters, InputError> {
        ConstraintParameters::read(&node(text), MEMBRANE)
    }

    const RICH: &str = "{ min_feature: 2 mm, islands: 1, leads: [top, left], \
                        keep_out: [{ rectangle: [[0, 0], [5 mm, 0.5 cm]] }, { disc: { centre: [25 mm, 25], radius: 3 } }], \
                        breakdown_margin: 1.5, pull_in_margin: 1.20 }";

    #[test]
    fn constraints_round_trip_through_text() {
        for text in [
            "{ leads: { cells: [[0, 25], [0, 26]] }, keep_in: [{ rectangle: [[0, 20 mm], [4 mm, 30 mm]] }, { group: 1, shapes: [{ disc: { centre: [30, 25], radius: 2 } }] }] }",
            "{ leads: { shapes: [{ disc: { centre: [25, 25], radius: 3 } }] }, min_feature: 2 mm }",
            RICH,
            "{ leads: true }",
            "{ islands: 3 }",
            "{ pull_in_margin: 2 }",
            "{}",
        ] {
            let parameters = read(text).unwrap();
            let read_again = read(&parameters.to_text()).unwrap();
            assert_eq!(
                (read_again.canonical(), read_again.to_text()),
                (parameters.canonical(), parameters.to_text())
            );
            assert_eq!(read_again.constraints(), parameters.constraints());
        }
        let expected = "{ min_feature: 2 mm, islands: 1, leads: [left, top], keep_out: [{ rectangle: [[0 mm, 0 mm], \
                        [5 mm, 5 mm]] }, { disc: { centre: [25 mm, 25 mm], radius: 3 mm } }], breakdown_margin: 1.5, \
                        pull_in_margin: 1.2 }";
        assert_eq!(read(RICH).unwrap().to_text(), expected);
        assert_eq!(ConstraintParameters::none(MEMBRANE).to_text(), "{}");
        assert_eq!(ConstraintParameters::none(MEMBRANE), read("{}").unwrap());
    }

    #[test]
    fn equal_constraints_have_one_canonical_value() {
        let canonical = |text: &str| read(text).unwrap().canonical();
        assert_eq!(
            canonical("{ leads: true }"),
            canonical("{ leads: [left, top, right, bottom] }")
        );
        assert_eq!(canonical("{ leads: false, keep_out: [] }"), canonical("{}"));
        assert_eq!(canonical("{ min_feature: 0.2 cm }"), canonical("{ min_feature: 2 }"));
        let disc = "{ disc: { centre: [9, 9], radius: 2 } }";
        let corner = "{ rectangle: [[0, 0], [5, 5]] }";
        assert_eq!(
            canonical(&format!("{{ keep_out: [{disc}, {corner}] }}")),
            canonical(&format!("{{ keep_out: [{corner}, {disc}, {corner}] }}"))
        );
        assert_ne!(canonical("{ leads: [left] }"), canonical("{ leads: [right] }"));
    }

    #[test]
    fn constraints_are_read_from_yaml() {
        let parameters = read(RICH).unwrap();
        let limits = parameters.constraints().limits();
        assert_eq!((limits.min_feature_mm, limits.islands), (Some(2.0), Some(1)));
        assert_eq!((limits.breakdown_margin, limits.pull_in_margin), (Some(1.5), Some(1.2)));
        assert_eq!(parameters.constraints().feature_cells(), [2; 2]);
        assert!(!parameters.constraints().allowed().has(0, 0) && parameters.constraints().allowed().has(49, 49));
    }

    #[test]
    fn errors_name_the_key_and_the_allowed_values() {
        for (text, words) in [
            ("{ min_feature: 2 V }", "unknown unit \"V\" for a length"),
            ("{ min_feature: 60 mm }", "60 mm, larger than the membrane of 50 mm"),
            ("{ min_feature: 0 mm }", "`min_feature` is out of range"),
            ("{ islands: 0 }", "`islands` must be an integer from 1 to 1250, found 0"),
            (
                "{ leads: some }",
                "`leads` must be true, false, a list of sides, or { shapes }",
            ),
            ("{ leads: [lefft] }", "`leads` cannot be \"lefft\""),
            ("{ leads: [] }", "names no side"),
            ("{ keep_out: [{ square: 1 }] }", "unknown key `square`"),
            (
                "{ keep_out: [{}] }",
                "a shape must have one of `rectangle`, `disc`, `ellipse`",
            ),
            (
                "{ keep_out: [{ rectangle: [[0, 0]] }] }",
                "`rectangle` must have two values",
            ),
            (
                "{ keep_out: [{ rectangle: [[0, 0], [1]] }] }",
                "must have two values, found 1",
            ),
            ("{ keep_out: [{ disc: { centre: [1, 1] } }] }", "`radius` is missing"),
            (
                "{ keep_out: [{ rectangle: [[60, 0], [70, 5]] }] }",
                "contains no cell centre of the membrane",
            ),
            ("{ keep_out: [{ rectangle: [[0, 0], [50, 50]] }] }", "leave no space"),
            (
                "{ leads: [left], keep_out: [{ rectangle: [[0, 0], [1, 50]] }] }",
                "the frame on the left",
            ),
            ("{ breakdown_margin: 0.9 }", "`breakdown_margin` is out of range"),
            ("{ pull_in_margin: high }", "`pull_in_margin`"),
            ("{ min_features: 2 mm }", "unknown key `min_features`"),
            ("[1]", "must be a mapping"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
    }

    #[test]
    fn an_impossible_area_is_refused() {
        let parameters = read("{ keep_out: [{ rectangle: [[0, 0], [25, 50]] }], min_feature: 10 mm }").unwrap();
        let check = |area: f64| parameters.check_area(&node("1"), area, 0.005);
        assert!(check(0.5).is_ok() && check(0.504).is_ok() && check(0.0).is_ok());
        assert!(check(0.6).unwrap_err().to_string().contains("at most 0.5000"));
        assert!(check(0.02).unwrap_err().to_string().contains("the smallest electrode"));
        assert!(
            ConstraintParameters::none(MEMBRANE)
                .check_area(&node("1"), 1.0, 0.0)
                .is_ok()
        );
    }

    #[test]
    fn an_area_between_those_of_two_numbers_of_cells_is_refused() {
        let membrane = Membrane {
            raster: Raster::new(8, 8).unwrap(),
            ..MEMBRANE
        };
        let parameters = ConstraintParameters::none(membrane);
        let check = |area: f64, tolerance: f64| parameters.check_area_of_cells(&node("1"), area, tolerance);
        // A cell is 1/64 = 0.015625.
        for (area, tolerance) in [(0.02, 0.005), (0.0156, 0.001), (0.5, 0.0), (1.0, 0.0), (0.0, 0.0)] {
            assert!(check(area, tolerance).is_ok(), "{area} {tolerance}");
        }
        let tiny = parameters.check_area(&node("1"), 1e-3, 0.005).unwrap_err().to_string();
        assert!(
            tiny.contains("on 64 cells; the nearest are 0.0000 and 0.0156"),
            "{tiny}"
        );
        assert!(parameters.check_area(&node("1"), 0.012, 0.005).is_ok());
        let error = check(0.02, 0.001).unwrap_err().to_string();
        assert!(
            error.contains("0.02 within 0.001 is not possible on 64 cells; the nearest are 0.0156 and 0.0312"),
            "{error}"
        );
    }
}
