//! The constraints of a design as they stand in a pipeline and, word for word the same, in an artifact.

use super::{ConstraintError, Constraints, Limits, Region, Sides};
use crate::base::{Canonical, Decimal, Dimension, Fields, InputError, Map, Node, NodeValue, Quantity, Schema};

const KEYS: [&str; 6] = [
    "min_feature",
    "islands",
    "leads",
    "keep_out",
    "breakdown_margin",
    "pull_in_margin",
];

/// No pattern has more islands: every other cell.
const MOST_ISLANDS: u64 = 1250;

/// Bounds of a place in mm.
const PLACES: [f64; 2] = [-1e4, 1e4];

/// Bounds of a length in mm.
const LENGTHS: [f64; 2] = [1e-6, 1e4];

/// Bounds of a margin.
const MARGINS: [f64; 2] = [1.0, 1e3];

/// What is asked of a design, as it was written, and what it means for the membrane.
#[derive(Clone, Debug, PartialEq)]
pub struct ConstraintParameters {
    written: Written,
    constraints: Constraints,
}

#[derive(Clone, Debug, Default, PartialEq)]
struct Written {
    min_feature: Option<Quantity>,
    islands: Option<u64>,
    leads: Option<Sides>,
    keep_out: Vec<Shape>,
    breakdown_margin: Option<Decimal>,
    pull_in_margin: Option<Decimal>,
}

type Place = [Quantity; 2];

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    Rectangle([Place; 2]),
    Disc(Place, Quantity),
}

impl ConstraintParameters {
    /// Nothing asked.
    pub fn none() -> Self {
        Self {
            written: Written::default(),
            constraints: Constraints::default(),
        }
    }

    /// Reads the mapping under `constraints` for a membrane with a side in mm.
    ///
    /// # Errors
    /// When a key is unknown, a value is out of range, or the constraints contradict each other.
    pub fn read(node: &Node, side_mm: f64) -> Result<Self, InputError> {
        let map = node.fields("`constraints`", &KEYS)?;
        let length = |n: &Node| n.quantity_in("min_feature", Dimension::Length, LENGTHS[0], LENGTHS[1]);
        let written = Written {
            min_feature: map.optional("min_feature").map(length).transpose()?,
            islands: map
                .optional("islands")
                .map(|n| n.whole("islands", 1, MOST_ISLANDS))
                .transpose()?,
            leads: map.optional("leads").map_or(Ok(None), read_leads)?,
            keep_out: match map.optional("keep_out") {
                Some(list) => list
                    .list("keep_out")?
                    .iter()
                    .map(read_shape)
                    .collect::<Result<_, _>>()?,
                None => Vec::new(),
            },
            breakdown_margin: read_margin(&map, "breakdown_margin")?,
            pull_in_margin: read_margin(&map, "pull_in_margin")?,
        };
        let constraints = Constraints::new(written.limits(), side_mm).map_err(|e| placed(node, &map, &e))?;
        Ok(Self { written, constraints })
    }

    /// Refuses an area fraction, which stands at a node, that the constraints do not leave within a tolerance.
    ///
    /// # Errors
    /// When it is more than they leave, or less than the smallest electrode.
    pub fn check_area(&self, node: &Node, area: f64, tolerance: f64) -> Result<(), InputError> {
        self.constraints.check_area(area, tolerance).map_err(|error| {
            let help = match error {
                ConstraintError::TooLittleArea { .. } => "ask for more area, or a smaller `min_feature`",
                _ => "ask for less area, or keep less out",
            };
            node.error(error.to_string()).help(help)
        })
    }

    /// What [`ConstraintParameters::read`] accepts.
    pub fn schema() -> Schema {
        let length = || Schema::quantity(Dimension::Length, LENGTHS[0], LENGTHS[1]);
        let place = || Schema::list(Schema::quantity(Dimension::Length, PLACES[0], PLACES[1]), 2, 2);
        let margin = |says: &str| Schema::number(MARGINS[0], MARGINS[1]).says(says);
        let disc = Fields::new("A disc.")
            .required("centre", place().says("Its centre, such as [25 mm, 25 mm]."))
            .required("radius", length().says("Its radius."));
        let corners = Schema::list(place(), 2, 2).says("Two opposite corners.");
        let shapes = [
            Fields::new("A rectangle.").required("rectangle", corners).into(),
            Fields::new("A disc.").required("disc", disc.into()).into(),
        ];
        let sides = Schema::list(Schema::word(&Sides::NAMES), 1, Sides::NAMES.len());
        let leads = Schema::any_of([Schema::new(serde_json::json!({ "type": "boolean" })), sides]);
        let islands = Schema::whole(1, MOST_ISLANDS).says("Pieces of electrode at most.");
        Fields::new("What designs must keep to.")
            .optional("min_feature", length().says("Least width of electrodes and gaps."))
            .optional("islands", islands)
            .optional(
                "leads",
                leads.says("Whether every piece touches the frame, or one of these sides of it."),
            )
            .optional(
                "keep_out",
                Schema::list(Schema::any_of(shapes), 0, usize::MAX).says("Where no cell is active."),
            )
            .optional(
                "breakdown_margin",
                margin("How many times the largest electric field is below breakdown."),
            )
            .optional(
                "pull_in_margin",
                margin("How many times the voltage is below that of pull-in."),
            )
            .into()
    }

    /// The canonical value: the same however it is written.
    pub fn canonical(&self) -> Canonical {
        let w = &self.written;
        let sides = |sides: Sides| {
            let wanted = sides.named().into_iter().filter(|(_, wanted)| *wanted);
            Canonical::List(wanted.map(|(name, _)| name.into()).collect())
        };
        let mut keep_out: Vec<Canonical> = w.keep_out.iter().map(Shape::canonical).collect();
        keep_out.sort();
        keep_out.dedup();
        let or_null = |value: Option<Canonical>| value.unwrap_or(Canonical::Null);
        Canonical::map([
            ("min_feature", or_null(w.min_feature.as_ref().map(Canonical::from))),
            ("islands", or_null(w.islands.map(Canonical::from))),
            ("leads", or_null(w.leads.map(sides))),
            ("keep_out", Canonical::List(keep_out)),
            ("breakdown_margin", or_null(w.breakdown_margin.map(Canonical::from))),
            ("pull_in_margin", or_null(w.pull_in_margin.map(Canonical::from))),
        ])
    }

    /// The constraints in their own YAML syntax on one line; `{}` where there are none.
    pub fn to_text(&self) -> String {
        let w = &self.written;
        let mut keys = Vec::new();
        if let Some(width) = &w.min_feature {
            keys.push(format!("min_feature: {width}"));
        }
        if let Some(islands) = w.islands {
            keys.push(format!("islands: {islands}"));
        }
        match w.leads {
            None => {}
            Some(Sides::ALL) => keys.push("leads: true".to_owned()),
            Some(sides) => keys.push(format!("leads: [{sides}]")),
        }
        if !w.keep_out.is_empty() {
            let shapes: Vec<String> = w.keep_out.iter().map(Shape::to_text).collect();
            keys.push(format!("keep_out: [{}]", shapes.join(", ")));
        }
        for (name, margin) in [
            ("breakdown_margin", w.breakdown_margin),
            ("pull_in_margin", w.pull_in_margin),
        ] {
            keys.extend(margin.map(|margin| format!("{name}: {margin}")));
        }
        match keys.is_empty() {
            true => "{}".to_owned(),
            false => format!("{{ {} }}", keys.join(", ")),
        }
    }

    /// What they mean for the membrane.
    pub fn constraints(&self) -> &Constraints {
        &self.constraints
    }
}

impl Written {
    fn limits(&self) -> Limits {
        Limits {
            min_feature_mm: self.min_feature.map(|width| width.value()),
            islands: self.islands.map(|n| n as usize),
            leads: self.leads,
            keep_out: self.keep_out.iter().map(Shape::region).collect(),
            breakdown_margin: self.breakdown_margin.map(Decimal::to_f64),
            pull_in_margin: self.pull_in_margin.map(Decimal::to_f64),
        }
    }
}

impl Shape {
    fn region(&self) -> Region {
        let place = |place: &Place| [place[0].value(), place[1].value()];
        match self {
            Self::Rectangle([from, to]) => Region::Rectangle([place(from), place(to)]),
            Self::Disc(centre, radius) => Region::Disc {
                centre: place(centre),
                radius: radius.value(),
            },
        }
    }

    fn canonical(&self) -> Canonical {
        let place = |place: &Place| place.iter().collect::<Canonical>();
        match self {
            Self::Rectangle(corners) => {
                let corners = Canonical::List(corners.iter().map(place).collect());
                Canonical::map([("rectangle", corners)])
            }
            Self::Disc(centre, radius) => {
                let disc = Canonical::map([("centre", place(centre)), ("radius", Canonical::from(radius))]);
                Canonical::map([("disc", disc)])
            }
        }
    }

    fn to_text(&self) -> String {
        match self {
            Self::Rectangle([[a, b], [c, d]]) => format!("{{ rectangle: [[{a}, {b}], [{c}, {d}]] }}"),
            Self::Disc([x, y], radius) => format!("{{ disc: {{ centre: [{x}, {y}], radius: {radius} }} }}"),
        }
    }
}

fn read_margin(map: &Map<'_>, key: &str) -> Result<Option<Decimal>, InputError> {
    let read = |node: &Node| {
        let margin = node.quantity_in(key, Dimension::Number, MARGINS[0], MARGINS[1])?;
        Ok(margin.base())
    };
    map.optional(key).map(read).transpose()
}

/// `true` is the whole frame, `false` is none.
fn read_leads(node: &Node) -> Result<Option<Sides>, InputError> {
    match node.value() {
        NodeValue::Bool(wanted) => return Ok(wanted.then_some(Sides::ALL)),
        NodeValue::List(_) => {}
        _ => {
            let message = format!("`leads` must be true, false or a list of sides, found {}", node.found());
            let help = format!("sides: {}", Sides::NAMES.join(", "));
            return Err(node.error(message).help(help));
        }
    }
    let mut sides = Sides::default();
    for side in node.list("leads")? {
        match side.word("leads", &Sides::NAMES)? {
            "left" => sides.left = true,
            "right" => sides.right = true,
            "bottom" => sides.bottom = true,
            _ => sides.top = true,
        }
    }
    Ok(Some(sides))
}

fn read_shape(node: &Node) -> Result<Shape, InputError> {
    let shapes = ["rectangle", "disc"];
    let own = shapes.iter().position(|shape| node.peek(shape).is_some());
    let map = node.fields(
        "a region of `keep_out`",
        own.map_or(&shapes[..], |own| &shapes[own..=own]),
    )?;
    match (map.optional("rectangle"), map.optional("disc")) {
        (Some(corners), None) => {
            let [from, to] = corners.list("rectangle")? else {
                return Err(corners
                    .error(format!("`rectangle` must be two opposite corners, found {}", corners.found()))
                    .help("for example [[0 mm, 0 mm], [5 mm, 5 mm]]"));
            };
            Ok(Shape::Rectangle([read_place(from, "rectangle")?, read_place(to, "rectangle")?]))
        }
        (None, Some(disc)) => {
            let what = "`disc`";
            let map = disc.fields(what, &["centre", "radius"])?;
            let radius = map.required(what, "radius")?;
            Ok(Shape::Disc(
                read_place(map.required(what, "centre")?, "centre")?,
                radius.quantity_in("radius", Dimension::Length, LENGTHS[0], LENGTHS[1])?,
            ))
        }
        _ => Err(node
            .error("a region of `keep_out` is either a `rectangle` or a `disc`")
            .help("for example { rectangle: [[0 mm, 0 mm], [5 mm, 5 mm]] } or { disc: { centre: [25 mm, 25 mm], radius: 3 mm } }")),
    }
}

fn read_place(node: &Node, field: &str) -> Result<Place, InputError> {
    let [x, y] = node.list(field)? else {
        return Err(node
            .error(format!("a place in `{field}` must have two coordinates"))
            .help("for example [25 mm, 25 mm]"));
    };
    let read = |node: &Node| node.quantity_in(field, Dimension::Length, PLACES[0], PLACES[1]);
    Ok([read(x)?, read(y)?])
}

/// The refusal at the key that it is about.
fn placed(node: &Node, map: &Map<'_>, error: &ConstraintError) -> InputError {
    let at = match error {
        ConstraintError::Number { name, .. } => map.optional(name),
        ConstraintError::Feature { .. } => map.optional("min_feature"),
        ConstraintError::Outside { number, .. } => {
            let list = map.optional("keep_out").and_then(|list| list.list("keep_out").ok());
            list.and_then(|list| list.get(number - 1))
        }
        ConstraintError::NoSide | ConstraintError::Side { .. } => map.optional("leads"),
        ConstraintError::NoRoom => map.optional("keep_out"),
        ConstraintError::TooMuchArea { .. } | ConstraintError::TooLittleArea { .. } => None,
    };
    at.unwrap_or(node).error(error.to_string())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::base::Document;

    fn node(text: &str) -> Node {
        Document::from_text(Path::new("t"), text).unwrap().root
    }

    fn read(text: &str) -> Result<ConstraintParameters, InputError> {
        ConstraintParameters::read(&node(text), 50.0)
    }

    const RICH: &str = "{ min_feature: 2 mm, islands: 1, leads: [top, left], keep_out: [{ rectangle: [[0, 0], [5 mm, 0.5 cm]] }, \
                        { disc: { centre: [25 mm, 25], radius: 3 } }], breakdown_margin: 1.5, pull_in_margin: 1.20 }";

    #[test]
    fn constraints_survive_their_own_text() {
        for text in [RICH, "{ leads: true }", "{ islands: 3 }", "{ pull_in_margin: 2 }", "{}"] {
            let wanted = read(text).unwrap();
            let again = read(&wanted.to_text()).unwrap();
            assert_eq!(
                (again.canonical(), again.to_text()),
                (wanted.canonical(), wanted.to_text())
            );
            assert_eq!(again.constraints(), wanted.constraints());
        }
        let expected = "{ min_feature: 2 mm, islands: 1, leads: [left, top], keep_out: [{ rectangle: [[0 mm, 0 mm], \
                        [5 mm, 5 mm]] }, { disc: { centre: [25 mm, 25 mm], radius: 3 mm } }], breakdown_margin: 1.5, \
                        pull_in_margin: 1.2 }";
        assert_eq!(read(RICH).unwrap().to_text(), expected);
        assert_eq!(ConstraintParameters::none().to_text(), "{}");
        assert_eq!(ConstraintParameters::none(), read("{}").unwrap());
    }

    #[test]
    fn what_means_the_same_has_one_canonical_value() {
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
    fn what_is_read_is_what_is_asked() {
        let wanted = read(RICH).unwrap();
        let limits = wanted.constraints().limits();
        assert_eq!((limits.min_feature_mm, limits.islands), (Some(2.0), Some(1)));
        assert_eq!((limits.breakdown_margin, limits.pull_in_margin), (Some(1.5), Some(1.2)));
        assert_eq!(wanted.constraints().feature_cells(), 2);
        assert!(!wanted.constraints().allowed()[0] && wanted.constraints().allowed()[2499]);
    }

    #[test]
    fn refusals_name_the_field_and_what_is_allowed() {
        for (text, words) in [
            ("{ min_feature: 2 V }", "unknown unit \"V\" for a length"),
            ("{ min_feature: 60 mm }", "60 mm, more than the membrane of 50 mm"),
            ("{ min_feature: 0 mm }", "`min_feature` is out of range"),
            (
                "{ islands: 0 }",
                "`islands` must be a whole number from 1 to 1250, found 0",
            ),
            ("{ leads: some }", "`leads` must be true, false or a list of sides"),
            ("{ leads: [lefft] }", "`leads` cannot be \"lefft\""),
            ("{ leads: [] }", "names no side"),
            ("{ keep_out: [{ square: 1 }] }", "unknown key `square`"),
            ("{ keep_out: [{}] }", "either a `rectangle` or a `disc`"),
            ("{ keep_out: [{ rectangle: [[0, 0]] }] }", "two opposite corners"),
            ("{ keep_out: [{ rectangle: [[0, 0], [1]] }] }", "two coordinates"),
            ("{ keep_out: [{ disc: { centre: [1, 1] } }] }", "`radius` is missing"),
            (
                "{ keep_out: [{ rectangle: [[60, 0], [70, 5]] }] }",
                "holds no cell of the membrane",
            ),
            ("{ keep_out: [{ rectangle: [[0, 0], [50, 50]] }] }", "leave no room"),
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
    fn an_area_that_is_not_left_is_refused() {
        let wanted = read("{ keep_out: [{ rectangle: [[0, 0], [25, 50]] }], min_feature: 10 mm }").unwrap();
        let check = |area: f64| wanted.check_area(&node("1"), area, 0.005);
        assert!(check(0.5).is_ok() && check(0.504).is_ok() && check(0.0).is_ok());
        assert!(check(0.6).unwrap_err().to_string().contains("leave 0.5000 at most"));
        assert!(check(0.02).unwrap_err().to_string().contains("the smallest electrode"));
        assert!(ConstraintParameters::none().check_area(&node("1"), 1.0, 0.0).is_ok());
    }
}
