//! The objective of a design, read from its text.

use std::fmt;
use std::path::Path;

use crate::format::{mm, mm_measured, three};
use deaflow_base::{Dimension, Document, InputError, Node, Parameter, four_digits, rounded_by};
use deaflow_field::REACTION_UNIT;
use deaflow_scene::{Edge, Scene, Shape};

/// An objective.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Objective {
    /// Points and their target motions; for a target field, all points at which it is given.
    pub targets: Vec<TargetPoint>,
    /// The target displacement in mm along each direction, if there is one.
    pub value_mm: Option<f64>,
    /// Whether a given displacement or angle is to be reached, so that a larger one is not better.
    pub is_met: bool,
    /// The time or frequency of the objective, if it is not an equilibrium: `after 10 s` or `at 40 Hz`.
    pub moment: Option<String>,
    /// What counts of electrodes as they may be fabricated, if it is robust: `worst of the masks`.
    pub robust: Option<String>,
    /// The distance in mm by which an arc length is an angle in rad, if all targets are rotations with the same one.
    pub arm_mm: Option<f64>,
    /// The volume in ml of a mean height of 1 mm, if all targets are volumes.
    pub ml_per_mm: Option<f64>,
    /// The objective in the syntax of pipelines.
    pub text: String,
}

/// A point, a rigid body or a region and its target motion.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetPoint {
    /// Its position in mm from the lower left corner; the centroid of a body or region.
    pub point: [f64; 2],
    /// The number of the body, if it is a body.
    pub body: Option<usize>,
    /// The side of the membrane, if it is a bar.
    pub bar: Option<Edge>,
    /// The side of the membrane, if it is the change of its force.
    pub reaction: Option<Edge>,
    /// Whether it is a region.
    pub is_region: bool,
    /// The target motion.
    pub motion: TargetMotion,
    /// The target displacement in mm along x and y; `None` if it is to be maximized, if the body is to rotate or if the
    /// area of the region is to change.
    pub by: Option<[f64; 2]>,
    /// The state of the device, if the objective names one.
    pub state: Option<String>,
    /// The weight, if it is not 1.
    pub weight: Option<String>,
}

/// The direction of a target motion.
#[derive(Clone, Debug, PartialEq)]
pub enum TargetMotion {
    /// Displacement in a direction, degrees counterclockwise from the x axis.
    Along(f64),
    /// Rotation, as in the objective: `clockwise`, `counterclockwise`, or an angle.
    Turn(String),
    /// Area strain, as in the objective: `largest`, `smallest`, or a share.
    Grow(String),
    /// Height, as in the objective: `up`, `down`, or a length.
    Rise(String),
    /// Volume, as in the objective: `largest`, `smallest`, or a volume.
    Fill(String),
}

impl fmt::Display for TargetMotion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Along(degrees) => rounded(*degrees).fmt(f),
            Self::Turn(how) | Self::Grow(how) | Self::Rise(how) | Self::Fill(how) => f.write_str(&how.replace(' ', "")),
        }
    }
}

/// Rounds to nine decimals, which hides rounding errors.
fn rounded(value: f64) -> f64 {
    (1e9 * value).round() / 1e9 + 0.0
}

/// The unit of volumes for people.
pub const VOLUME_UNIT: &str = "ml";

/// The measure of objectives whose displacement or angle is to be reached.
const DISTANCE: &str = "distance";

/// Objectives with more points are fields, whose points are not listed.
const MAX_LISTED: usize = 16;

impl Objective {
    /// Reads `{ point, direction }` or `{ points: [{ point, direction }, …] }`, with a target `displacement` instead of
    /// a direction or a `body` of a scene instead of a point; other keys are ignored.
    ///
    /// # Errors
    /// If the text is not YAML, or a point, body or direction is invalid.
    pub fn read(text: &str, scene: &Scene) -> Result<Self, InputError> {
        let document = Document::from_text(Path::new("objective"), text)?;
        let root = &document.root;
        let targets = match (root.peek("points"), one_target(root)) {
            (Some(points), _) => points.list("points")?,
            (None, Some(_)) => std::slice::from_ref(root),
            (None, None) => &[],
        };
        let targets: Vec<TargetPoint> = targets
            .iter()
            .map(|one| target_point(one, scene))
            .collect::<Result<_, _>>()?;
        let value = root
            .peek("value")
            .map(|value| value.quantity("value", Dimension::Length));
        Ok(Self {
            is_met: is_measured_as_distance(root),
            robust: root.peek("robust").map(robust_words),
            text: text.to_owned(),
            moment: [("time", "after"), ("frequency", "at")]
                .into_iter()
                .find_map(|(key, word)| {
                    let value = root.peek(key)?.text(key).ok()?;
                    Some(format!("{word} {value}"))
                }),
            arm_mm: arm_mm(&targets, scene),
            ml_per_mm: ml_per_mm(&targets, scene),
            targets,
            value_mm: value.transpose()?.map(|value| value.value()),
        })
    }

    /// Returns the unit of its values in files: mN for forces of sides.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        let is_reaction = self.targets.iter().any(|target| target.reaction.is_some());
        if is_reaction { REACTION_UNIT } else { "mm" }
    }

    /// Returns the unit of its values for people: ml for volumes, which files have as mean heights.
    #[must_use]
    pub fn shown_unit(&self) -> &'static str {
        match self.ml_per_mm {
            Some(_) => VOLUME_UNIT,
            None => self.unit(),
        }
    }

    /// Converts a value to [`Self::shown_unit`].
    #[must_use]
    pub fn shown(&self, value: f64) -> f64 {
        self.ml_per_mm.unwrap_or(1.0) * value
    }

    /// Writes a value with its unit; an arc length with its angle.
    #[must_use]
    pub fn text(&self, value: f64) -> String {
        format!(
            "{} {}{}",
            mm(self.shown(value)),
            self.shown_unit(),
            self.converted(value)
        )
    }

    /// Writes the same rounded by the estimated error, which follows if it is known.
    #[must_use]
    pub fn text_measured(&self, value: f64, error: Option<f64>) -> String {
        let number = self.number_measured(value, error);
        format!("{number} {}{}", self.shown_unit(), self.converted(value))
    }

    /// Writes the same without the unit and the angle.
    pub(super) fn number_measured(&self, value: f64, error: Option<f64>) -> String {
        mm_measured(self.shown(value), error.map(|error| self.shown(error)))
    }

    /// Writes a difference or an error with its unit and three digits.
    #[must_use]
    pub fn difference_text(&self, value: f64) -> String {
        format!(
            "{} {}{}",
            three(self.shown(value)),
            self.shown_unit(),
            self.converted(value)
        )
    }

    /// Rounds a value by its estimated error, if that is known; without its unit.
    #[must_use]
    pub fn rounded(&self, value: f64, error: Option<f64>) -> String {
        let shown = self.shown(value);
        error.map_or_else(|| mm(shown), |error| rounded_by(shown, self.shown(error)))
    }

    /// Returns what its values are.
    #[must_use]
    pub fn quantity(&self) -> &'static str {
        let all = |is: fn(&TargetPoint) -> bool| !self.targets.is_empty() && self.targets.iter().all(is);
        if all(|target| matches!(target.motion, TargetMotion::Rise(_))) {
            "change of the height"
        } else if all(|target| matches!(target.motion, TargetMotion::Fill(_))) {
            quantity(VOLUME_UNIT)
        } else if all(|target| target.is_region) {
            "change of the radius"
        } else if all(TargetPoint::is_rotation) {
            "arc length"
        } else {
            quantity(self.unit())
        }
    }

    /// Returns the angle in degrees of a value in mm, if values are arc lengths of rotations.
    #[must_use]
    pub fn degrees(&self, value_mm: f64) -> Option<f64> {
        self.arm_mm.map(|arm| (value_mm / arm).to_degrees())
    }

    /// Returns the volume in ml of a value in mm, if values are mean heights of volumes.
    #[must_use]
    pub fn millilitres(&self, value_mm: f64) -> Option<f64> {
        self.ml_per_mm.map(|ml_per_mm| ml_per_mm * value_mm)
    }

    /// Writes the angle of an arc length in mm, to be put behind it, as ` (5.670°)`; nothing for other values.
    #[must_use]
    pub fn converted(&self, value_mm: f64) -> String {
        let degrees = self.degrees(value_mm);
        degrees.map_or_else(String::new, |degrees| format!(" ({}°)", four_digits(degrees)))
    }

    /// Returns the points that are listed; none for a field.
    #[must_use]
    pub fn points(&self) -> &[TargetPoint] {
        if self.targets.len() > MAX_LISTED {
            &[]
        } else {
            &self.targets
        }
    }

    /// Says what the value of a robust objective is; `None` of other objectives.
    #[must_use]
    pub fn robust_text(&self, value: Option<f64>) -> Option<String> {
        let (words, value) = (self.robust.as_ref()?, value?);
        Some(format!("{words} {}", self.text(value)))
    }

    /// Returns a coordinate of each point in mm, separated by spaces.
    #[must_use]
    pub fn coordinates(&self, axis: usize) -> String {
        self.list(|target| rounded(target.point[axis]).to_string())
    }

    /// Returns the direction of each point in degrees, separated by spaces.
    #[must_use]
    pub fn directions(&self) -> String {
        self.list(|target| target.motion.to_string())
    }

    /// Returns the objective in the syntax of pipelines; for a field, the number of its points.
    #[must_use]
    pub fn short_text(&self) -> String {
        match self.points() {
            [] => self.description(),
            _ => self.text.clone(),
        }
    }

    fn list(&self, of: impl Fn(&TargetPoint) -> String) -> String {
        let words: Vec<String> = self.points().iter().map(of).collect();
        words.join(" ")
    }

    /// Says what is measured, and of what, on one line.
    #[must_use]
    pub fn words(&self) -> String {
        let described = self.description();
        // The description of a volume names it.
        let quantity = match self.ml_per_mm {
            Some(_) => "change",
            None => self.quantity(),
        };
        match described.strip_prefix("the mean of ") {
            Some(several) => format!("mean {quantity} of {several}"),
            None => format!("{quantity} of {described}"),
        }
    }

    /// Describes the objective on one line.
    #[must_use]
    pub fn description(&self) -> String {
        let one = TargetPoint::description;
        let what = match self.points() {
            [] => format!("a field, given at {} points", self.targets.len()),
            [target] => one(target),
            several => format!("the mean of {}", several.iter().map(one).collect::<Vec<_>>().join(", ")),
        };
        let what = match self.value_mm {
            Some(mm) => format!("{what} by {mm} mm"),
            None => what,
        };
        let what = match &self.robust {
            Some(_) => format!("{what}, robust (values are those as drawn)"),
            None => what,
        };
        match &self.moment {
            Some(moment) => format!("{what} {moment}"),
            None => what,
        }
    }
}

impl TargetPoint {
    /// Whether the target is at a point, and not the volume below the membrane.
    #[must_use]
    pub fn has_point(&self) -> bool {
        !matches!(self.motion, TargetMotion::Fill(_))
    }

    /// Whether a body or a bar is to rotate.
    fn is_rotation(&self) -> bool {
        matches!(self.motion, TargetMotion::Turn(_))
    }

    /// Describes the target of one point.
    fn description(&self) -> String {
        let what = match (self.body, self.bar, self.reaction) {
            (Some(body), ..) => format!("body {body}"),
            (None, Some(bar), _) => format!("the bar on the {} side", bar.name()),
            (None, None, Some(side)) => format!("the {} side on the membrane", side.name()),
            (None, None, None) if self.is_region => {
                let [x, y] = self.point.map(rounded);
                format!("the region about ({x}, {y}) mm")
            }
            (None, None, None) if matches!(self.motion, TargetMotion::Fill(_)) => {
                "the volume below the membrane".to_owned()
            }
            (None, None, None) => format!("({}, {}) mm", self.point[0], self.point[1]),
        };
        let motion = match (&self.motion, self.by) {
            (TargetMotion::Along(_), Some([x, y])) => format!("by ({}, {}) mm", rounded(x), rounded(y)),
            (TargetMotion::Along(degrees), None) => {
                let degrees = format!("{:.4}", degrees + 0.0);
                format!("at {}°", degrees.trim_end_matches('0').trim_end_matches('.'))
            }
            (TargetMotion::Turn(how), _) => format!("rotated {how}"),
            (TargetMotion::Grow(how), _) => match how.starts_with(char::is_alphabetic) {
                true => format!("with the {how} area strain"),
                false => format!("with an area strain of {how}"),
            },
            (TargetMotion::Rise(how), _) => format!("({how})"),
            (TargetMotion::Fill(how), _) => format!("by the voltage ({how})"),
        };
        let state = self
            .state
            .as_ref()
            .map_or(String::new(), |state| format!(" in state {state}"));
        let weight = self
            .weight
            .as_ref()
            .map_or(String::new(), |weight| format!(" (weight {weight})"));
        format!("{what} {motion}{state}{weight}")
    }
}

/// Stored objectives always have their measure.
fn is_measured_as_distance(objective: &Node) -> bool {
    objective
        .peek("measure")
        .is_some_and(|measure| measure.is_text(DISTANCE))
}

/// Says which value of a `robust` objective counts.
fn robust_words(robust: &Node) -> String {
    match robust
        .peek("mean_minus")
        .and_then(|factor| factor.text("mean_minus").ok())
    {
        Some("1") => "mean of the masks less a standard deviation".to_owned(),
        Some(factor) => format!("mean of the masks less {factor} standard deviations"),
        None => "worst of the masks".to_owned(),
    }
}

/// Returns the common arm of rotations; `None` if a target is no rotation, or arms differ.
fn arm_mm(targets: &[TargetPoint], scene: &Scene) -> Option<f64> {
    let arm = |target: &TargetPoint| match (target.is_rotation(), target.body, target.bar) {
        (true, Some(body), _) => scene.corners_of_body(body)?.arm_mm(),
        (true, None, Some(bar)) => scene.arm_of_bar_mm(bar),
        _ => None,
    };
    let first = arm(targets.first()?)?;
    let is_same = |target: &TargetPoint| arm(target) == Some(first);
    targets[1..].iter().all(is_same).then_some(first)
}

/// Returns the volume in ml of a mean height of 1 mm over the rectangle of the membrane; `None` if a target is no
/// volume.
fn ml_per_mm(targets: &[TargetPoint], scene: &Scene) -> Option<f64> {
    let is_volume = |target: &TargetPoint| matches!(target.motion, TargetMotion::Fill(_));
    let all = !targets.is_empty() && targets.iter().all(is_volume);
    all.then(|| scene.membrane().ml_per_mm())
}

/// Returns what values in a unit are.
#[must_use]
pub fn quantity(unit: &str) -> &'static str {
    match unit {
        REACTION_UNIT => "change of the force",
        VOLUME_UNIT => "change of the volume",
        _ => "displacement",
    }
}

/// The key of an objective with one point, body, bar, region or force.
fn one_target(root: &Node) -> Option<&Node> {
    ["point", "body", "bar", "reaction", "region", "volume"]
        .into_iter()
        .find_map(|key| root.peek(key))
}

fn target_point(node: &Node, scene: &Scene) -> Result<TargetPoint, InputError> {
    let body = node
        .peek("body")
        .map(|body| body.integer("body", 0, u64::MAX))
        .transpose()?;
    let body = body.map(|body| body as usize);
    let side = |key| node.peek(key).map(|side| Edge::read(side, key, &())).transpose();
    let (bar, reaction) = (side("bar")?, side("reaction")?);
    let region = node.peek("region").map(|region| centroid(region, scene)).transpose()?;
    Ok(TargetPoint {
        point: match (body, bar.or(reaction), region) {
            (.., Some(centroid)) => centroid,
            (Some(body), ..) => {
                let centroid = scene.centroid_of_body(body);
                centroid.ok_or_else(|| {
                    node.error(format!(
                        "the objective names body {body}, but the scene has no such body"
                    ))
                })?
            }
            (None, Some(side), None) => side.middle(scene.membrane().size_mm),
            (None, None, None) if node.peek("volume").is_some() => scene.membrane().size_mm.map(|side| 0.5 * side),
            (None, None, None) => pair(node.peek("point").ok_or_else(|| missing(node, "point"))?, "point")?,
        },
        body,
        bar,
        reaction,
        is_region: region.is_some(),
        motion: motion(node)?,
        by: vector(node).map(|(key, vector)| pair(vector, key)).transpose()?,
        weight: text_of(node, "weight")?,
        state: text_of(node, "state")?,
    })
}

/// Returns the centroid of a region in mm: the mean of the centres of its cells.
fn centroid(region: &Node, scene: &Scene) -> Result<[f64; 2], InputError> {
    let membrane = scene.membrane();
    let cells = Shape::read(region, "region", &())?.region().cells(membrane);
    let [columns, rows] = membrane.raster.sides();
    let all = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
    let (mut sum, mut count) = ([0.0; 2], 0.0_f64);
    for [x, y] in all.filter(|[x, y]| cells.has(*x, *y)) {
        let [a, b] = membrane.centre_mm(x, y);
        sum = [sum[0] + a, sum[1] + b];
        count += 1.0;
    }
    match count > 0.0 {
        true => Ok(sum.map(|sum| sum / count)),
        false => Err(region.error("the region contains no cell centre of the membrane")),
    }
}

fn motion(node: &Node) -> Result<TargetMotion, InputError> {
    if let Some(rotation) = node.peek("rotation") {
        return Ok(TargetMotion::Turn(rotation.text("rotation")?.to_owned()));
    }
    if let Some(strain) = node.peek("area_strain") {
        return Ok(TargetMotion::Grow(strain.text("area_strain")?.to_owned()));
    }
    if let Some(height) = node.peek("height") {
        return Ok(TargetMotion::Rise(height.text("height")?.to_owned()));
    }
    if let Some(volume) = node.peek("volume") {
        return Ok(TargetMotion::Fill(volume.text("volume")?.to_owned()));
    }
    match (node.peek("direction"), vector(node)) {
        (Some(direction), _) => {
            let degrees = direction.quantity("direction", Dimension::Angle)?.value();
            Ok(TargetMotion::Along(degrees))
        }
        (None, Some((key, vector))) => {
            let [x, y] = pair(vector, key)?;
            Ok(TargetMotion::Along(y.atan2(x).to_degrees()))
        }
        (None, None) => Err(missing(node, "direction")),
    }
}

/// Returns the text of a key, if the key is there.
fn text_of(node: &Node, key: &str) -> Result<Option<String>, InputError> {
    let found = node.peek(key).map(|found| found.text(key).map(str::to_owned));
    found.transpose()
}

/// Returns the target displacement of a point or a body, with its key.
fn vector(node: &Node) -> Option<(&'static str, &Node)> {
    let keys = ["displacement", "translation"];
    keys.into_iter().find_map(|key| Some((key, node.peek(key)?)))
}

fn missing(node: &Node, key: &str) -> InputError {
    node.error(format!("the objective has no `{key}`"))
}

/// Reads two lengths in mm.
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
            "{ points: [{ point: [1, 2], direction: 0, weight: 2 }, { point: [3, 4], direction: -90 deg }], \
             value: 1.00 mm }",
        )
        .unwrap();
        assert_eq!(two.directions(), "0 -90");
        assert_eq!(two.value_mm, Some(1.0));
        assert!(two.description().ends_with("by 1 mm"), "{}", two.description());
        let vector = read("{ point: [1, 2], displacement: [1 mm, 1 mm], measure: distance }").unwrap();
        assert_eq!((vector.directions().as_str(), vector.is_met), ("45", true));
        assert_eq!(vector.description(), "(1, 2) mm by (1, 1) mm");
        assert!(
            two.description().contains("(1, 2) mm at 0° (weight 2), "),
            "{}",
            two.description()
        );
        let field = vec!["{ point: [1, 2], displacement: [0, 1] }"; 17].join(", ");
        let field = read(&format!("{{ points: [{field}] }}")).unwrap();
        assert_eq!(field.directions(), "");
        assert!(
            field.description().starts_with("a field, given at 17 points"),
            "{}",
            field.description()
        );
        assert!(read("{ point: [1, 2] }").is_err());
        let robust = |how: &str| {
            read(&format!("{{ point: [1, 2], direction: 0, robust: {how} }}"))
                .unwrap()
                .robust
        };
        assert_eq!(robust("{ worst: [-0.3 mm, 0 mm] }").unwrap(), "worst of the masks");
        assert_eq!(
            robust("{ mean_minus: 2, mask: 0.1 mm }").unwrap(),
            "mean of the masks less 2 standard deviations"
        );
        assert_eq!(
            robust("{ mean_minus: 1, mask: 0.1 mm }").unwrap(),
            "mean of the masks less a standard deviation"
        );
    }

    #[test]
    fn bodies_are_at_their_centroids() {
        let scene = Scene::from_text(
            "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 25, \
             bodies: [{ rectangle: [[20 mm, 22 mm], [30 mm, 26 mm]] }] }\n\
             material: { model: neo-hookean, shear_modulus: 24.3 kPa, relative_permittivity: 4.7 }\n\
             states: { push: { voltage: 5 kV }, pull: { voltage: 1 kV } }\n",
        )
        .unwrap();
        let of = |text: &str| Objective::read(text, &scene).unwrap();
        let turned = of("{ points: [{ body: 0, rotation: counterclockwise, state: push }, \
             { body: 0, direction: 180 deg, state: pull }] }");
        assert_eq!(turned.coordinates(1), "24 24");
        assert_eq!(turned.directions(), "counterclockwise 180");
        assert_eq!(
            turned.description(),
            "the mean of body 0 rotated counterclockwise in state push, body 0 at 180° in state pull"
        );
        assert_eq!((turned.quantity(), turned.degrees(1.0)), ("displacement", None));
        let rotated = of("{ body: 0, rotation: 5 deg, measure: distance }");
        assert!(!turned.is_met && rotated.is_met);
        // The corners of the body of 10 mm × 4 mm are 5.385 mm from its centroid.
        let arc = 29_f64.sqrt() * 5_f64.to_radians();
        assert!((rotated.degrees(arc).unwrap() - 5.0).abs() < 1e-12);
        assert_eq!(
            (rotated.converted(arc).as_str(), rotated.quantity()),
            (" (5.000°)", "arc length")
        );
        assert_eq!(
            of("{ body: 0, direction: 0, measure: displacement }").converted(1.0),
            ""
        );
        assert!(Objective::read("{ body: 1, direction: 0 }", &scene).is_err());
        let region = "region: { rectangle: [[10 mm, 20 mm], [14 mm, 30 mm]] }";
        let grown = of(&format!("{{ {region}, area_strain: largest, measure: displacement }}"));
        assert_eq!((grown.quantity(), grown.unit()), ("change of the radius", "mm"));
        assert_eq!(
            grown.description(),
            "the region about (12, 25) mm with the largest area strain"
        );
        let met = of(&format!("{{ {region}, area_strain: 5 %, measure: distance }}"));
        assert_eq!(
            met.description(),
            "the region about (12, 25) mm with an area strain of 5 %"
        );
        assert_eq!((met.coordinates(1).as_str(), met.is_met), ("25", true));
    }
}
