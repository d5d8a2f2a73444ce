//! What a design is for, from the text of its objective.

use std::fmt;
use std::path::Path;

use deaflow_base::{Dimension, Document, InputError, Node};
use deaflow_scene::Scene;

/// An objective.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Objective {
    /// Points and directions; of a wanted field, all that it is given at.
    pub aims: Vec<Aim>,
    /// The displacement in mm that is to be met along each direction, where one is.
    pub value_mm: Option<f64>,
    /// Whether a displacement or an angle is to be met, so that more of it is not better.
    pub is_met: bool,
    /// When it is meant, in words, where that is not an equilibrium: `after 10 s`, or `at 40 Hz`.
    pub moment: Option<String>,
    /// The same in the syntax of pipelines.
    pub text: String,
}

/// A point or a rigid body and where it should move.
#[derive(Clone, Debug, PartialEq)]
pub struct Aim {
    /// Its place in mm from the lower left corner; of a body its centroid.
    pub point: [f64; 2],
    /// The number of the body, where one is meant.
    pub body: Option<usize>,
    /// Where it should move.
    pub way: Way,
    /// How far it should, in mm along x and y; none where as far as it gets, or where it should turn.
    pub by: Option<[f64; 2]>,
    /// The state of the device in which it should, where one is named.
    pub state: Option<String>,
    /// What it counts beside others, where that is not 1.
    pub weight: Option<String>,
}

/// Where something should move.
#[derive(Clone, Debug, PartialEq)]
pub enum Way {
    /// Counterclockwise from the x axis, degrees.
    Along(f64),
    /// It should turn, so as the objective says: `clockwise`, `counterclockwise`, or an angle.
    Turn(String),
}

impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Along(degrees) => rounded(*degrees).fmt(f),
            Self::Turn(how) => f.write_str(&how.replace(' ', "")),
        }
    }
}

/// Nine digits are more than a length or angle has, and hide what rounding adds.
fn rounded(value: f64) -> f64 {
    (1e9 * value).round() / 1e9 + 0.0
}

/// The measure of objectives of which a displacement or an angle is to be met.
const FROM_WANTED: &str = "distance";

/// More points than these are a field: nobody reads them one by one.
const FEW: usize = 16;

impl Objective {
    /// Reads `{ point, direction }` or `{ points: [{ point, direction }, …] }`, with a `displacement` in place of a direction
    /// where one is wanted, or a `body` of a scene in place of a point; other keys do not matter here.
    ///
    /// # Errors
    /// When the text is no YAML, or a point, body or direction cannot be read.
    pub fn read(text: &str, scene: &Scene) -> Result<Self, InputError> {
        let document = Document::from_text(Path::new("objective"), text)?;
        let root = &document.root;
        let aims = match (root.peek("points"), root.peek("point").or(root.peek("body"))) {
            (Some(points), _) => points.list("points")?,
            (None, Some(_)) => std::slice::from_ref(root),
            (None, None) => &[],
        };
        let value = root
            .peek("value")
            .map(|value| value.quantity("value", Dimension::Length));
        Ok(Self {
            is_met: is_measured_from_wanted(root),
            text: text.to_owned(),
            moment: [("time", "after"), ("frequency", "at")]
                .into_iter()
                .find_map(|(key, word)| {
                    let value = root.peek(key)?.text(key).ok()?;
                    Some(format!("{word} {value}"))
                }),
            aims: aims.iter().map(|one| aim(one, scene)).collect::<Result<_, _>>()?,
            value_mm: value.transpose()?.map(|value| value.value()),
        })
    }

    /// The points that can be told one by one; none where a field is wanted.
    #[must_use]
    pub fn points(&self) -> &[Aim] {
        if self.aims.len() > FEW { &[] } else { &self.aims }
    }

    /// A coordinate of each point in mm, separated by spaces.
    #[must_use]
    pub fn coordinates(&self, axis: usize) -> String {
        self.list(|aim| rounded(aim.point[axis]).to_string())
    }

    /// Where each point should move, in degrees, separated by spaces.
    #[must_use]
    pub fn ways(&self) -> String {
        self.list(|aim| aim.way.to_string())
    }

    /// The objective in the syntax of pipelines; of a field how many points it is given at.
    #[must_use]
    pub fn short_text(&self) -> String {
        match self.points() {
            [] => self.description(),
            _ => self.text.clone(),
        }
    }

    fn list(&self, of: impl Fn(&Aim) -> String) -> String {
        let words: Vec<String> = self.points().iter().map(of).collect();
        words.join(" ")
    }

    /// In words, on one line.
    #[must_use]
    pub fn description(&self) -> String {
        let one = Aim::description;
        let what = match self.points() {
            [] => format!("a field, given at {} points", self.aims.len()),
            [aim] => one(aim),
            several => format!("the mean of {}", several.iter().map(one).collect::<Vec<_>>().join(", ")),
        };
        let what = match self.value_mm {
            Some(mm) => format!("{what} by {mm} mm"),
            None => what,
        };
        match &self.moment {
            Some(moment) => format!("{what} {moment}"),
            None => what,
        }
    }
}

impl Aim {
    /// In words.
    fn description(&self) -> String {
        let what = match self.body {
            None => format!("({}, {}) mm", self.point[0], self.point[1]),
            Some(body) => format!("body {body}"),
        };
        let way = match (&self.way, self.by) {
            (Way::Along(_), Some([x, y])) => format!("by ({}, {}) mm", rounded(x), rounded(y)),
            (Way::Along(degrees), None) => {
                let degrees = format!("{:.4}", degrees + 0.0);
                format!("at {}°", degrees.trim_end_matches('0').trim_end_matches('.'))
            }
            (Way::Turn(how), _) => format!("turned {how}"),
        };
        let state = self
            .state
            .as_ref()
            .map_or(String::new(), |state| format!(" in state {state}"));
        let weight = self
            .weight
            .as_ref()
            .map_or(String::new(), |weight| format!(" (weight {weight})"));
        format!("{what} {way}{state}{weight}")
    }
}

/// Whether the objective of this text is a displacement or an angle that is to be met; not where the text is none.
pub fn is_to_be_met(text: &str) -> bool {
    let document = Document::from_text(Path::new("objective"), text);
    document.is_ok_and(|document| is_measured_from_wanted(&document.root))
}

/// Objectives say how they are measured, even where nobody wrote it.
fn is_measured_from_wanted(objective: &Node) -> bool {
    objective
        .peek("measure")
        .is_some_and(|measure| measure.is_text(FROM_WANTED))
}

fn aim(node: &Node, scene: &Scene) -> Result<Aim, InputError> {
    let body = node
        .peek("body")
        .map(|body| body.integer("body", 0, u64::MAX))
        .transpose()?;
    let body = body.map(|body| body as usize);
    Ok(Aim {
        point: match body {
            Some(body) => {
                let centroid = scene.centroid_of_body(body);
                centroid.ok_or_else(|| node.error(format!("an objective for body {body}, which the scene has not")))?
            }
            None => pair(node.peek("point").ok_or_else(|| missing(node, "point"))?, "point")?,
        },
        body,
        way: way(node)?,
        by: vector(node).map(|(key, vector)| pair(vector, key)).transpose()?,
        weight: words(node, "weight")?,
        state: words(node, "state")?,
    })
}

fn way(node: &Node) -> Result<Way, InputError> {
    if let Some(rotation) = node.peek("rotation") {
        return Ok(Way::Turn(rotation.text("rotation")?.to_owned()));
    }
    match (node.peek("direction"), vector(node)) {
        (Some(direction), _) => {
            let degrees = direction.quantity("direction", Dimension::Angle)?.value();
            Ok(Way::Along(degrees))
        }
        (None, Some((key, vector))) => {
            let [x, y] = pair(vector, key)?;
            Ok(Way::Along(y.atan2(x).to_degrees()))
        }
        (None, None) => Err(missing(node, "direction")),
    }
}

/// What stands under a key, where there is something.
fn words(node: &Node, key: &str) -> Result<Option<String>, InputError> {
    let found = node.peek(key).map(|found| found.text(key).map(str::to_owned));
    found.transpose()
}

/// What is wanted of a point or a body, with its key.
fn vector(node: &Node) -> Option<(&'static str, &Node)> {
    let keys = ["displacement", "translation"];
    keys.into_iter().find_map(|key| Some((key, node.peek(key)?)))
}

fn missing(node: &Node, key: &str) -> InputError {
    node.error(format!("an objective without `{key}`"))
}

/// Two lengths in mm.
fn pair(node: &Node, key: &str) -> Result<[f64; 2], InputError> {
    let [x, y] = node.list(key)? else {
        return Err(node.error(format!("`{key}` must have two components")));
    };
    let length = |node: &Node| Ok::<f64, InputError>(node.quantity(key, Dimension::Length)?.value());
    Ok([length(x)?, length(y)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Objective, InputError> {
        Objective::read(text, &Scene::vhb4910())
    }

    #[test]
    fn points_and_directions_are_read_in_mm_and_degrees() {
        let one = read("{ point: [2.5 cm, 37.5], direction: 45 deg, measure: displacement }").unwrap();
        assert_eq!(one.coordinates(0), "25");
        assert_eq!(one.description(), "(25, 37.5) mm at 45°");
        let two = read(
            "{ points: [{ point: [1, 2], direction: 0, weight: 2 }, { point: [3, 4], direction: -90 deg }], value: 1.00 mm }",
        )
        .unwrap();
        assert_eq!(two.ways(), "0 -90");
        assert_eq!(two.value_mm, Some(1.0));
        assert!(two.description().ends_with("by 1 mm"), "{}", two.description());
        let vector = read("{ point: [1, 2], displacement: [1 mm, 1 mm], measure: distance }").unwrap();
        assert_eq!((vector.ways().as_str(), vector.is_met), ("45", true));
        assert_eq!(vector.description(), "(1, 2) mm by (1, 1) mm");
        assert!(
            two.description().contains("(1, 2) mm at 0° (weight 2), "),
            "{}",
            two.description()
        );
        let field = vec!["{ point: [1, 2], displacement: [0, 1] }"; 17].join(", ");
        let field = read(&format!("{{ points: [{field}] }}")).unwrap();
        assert_eq!(field.ways(), "");
        assert!(
            field.description().starts_with("a field, given at 17 points"),
            "{}",
            field.description()
        );
        assert!(read("{ point: [1, 2] }").is_err());
    }

    #[test]
    fn bodies_are_where_their_centroids_are() {
        let scene = Scene::from_text(
            "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 25, bodies: [{ rectangle: [[20 mm, 22 mm], [30 mm, 26 mm]] }] }\n\
             material: { model: neo-hookean, shear_modulus: 24.3 kPa, relative_permittivity: 4.7 }\n\
             states: { push: { voltage: 5 kV }, pull: { voltage: 1 kV } }\n",
        )
        .unwrap();
        let of = |text: &str| Objective::read(text, &scene).unwrap();
        let turned = of(
            "{ points: [{ body: 0, rotation: counterclockwise, state: push }, { body: 0, direction: 180 deg, state: pull }] }",
        );
        assert_eq!(turned.coordinates(1), "24 24");
        assert_eq!(turned.ways(), "counterclockwise 180");
        assert_eq!(
            turned.description(),
            "the mean of body 0 turned counterclockwise in state push, body 0 at 180° in state pull"
        );
        assert!(!turned.is_met && of("{ body: 0, rotation: 5 deg, measure: distance }").is_met);
        assert!(is_to_be_met("{ body: 0, rotation: 5 deg, measure: distance }") && !is_to_be_met("["));
        assert!(Objective::read("{ body: 1, direction: 0 }", &scene).is_err());
    }
}
