//! What a design is for, from the text of its objective.

use std::path::Path;

use crate::base::{Dimension, Document, InputError, Node};

/// An objective.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Objective {
    /// Points and directions; of a wanted field, all that it is given at.
    pub aims: Vec<Aim>,
    /// The displacement in mm that is to be met along each direction, where one is.
    pub value_mm: Option<f64>,
    /// Whether each point has a displacement that it is to meet.
    pub vectors: bool,
}

/// A point and where it should move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Its place in mm from the lower left corner.
    pub point: [f64; 2],
    /// Counterclockwise from the x axis, degrees.
    pub direction: f64,
}

/// More points than these are a field: nobody reads them one by one.
const FEW: usize = 16;

impl Objective {
    /// Reads `{ point, direction }` or `{ points: [{ point, direction }, …] }`, with a `displacement` in place of a direction
    /// where one is wanted; other keys do not matter here.
    ///
    /// # Errors
    /// When the text is no YAML, or a point or direction cannot be read.
    pub fn read(text: &str) -> Result<Self, InputError> {
        let document = Document::from_text(Path::new("objective"), text)?;
        let root = &document.root;
        let aims = match (root.peek("points"), root.peek("point")) {
            (Some(points), _) => points.list("points")?,
            (None, Some(_)) => std::slice::from_ref(root),
            (None, None) => &[],
        };
        let value = root
            .peek("value")
            .map(|value| value.quantity("value", Dimension::Length));
        Ok(Self {
            vectors: aims.iter().any(|aim| aim.peek("displacement").is_some()),
            aims: aims.iter().map(aim).collect::<Result<_, _>>()?,
            value_mm: value.transpose()?.map(|value| value.value()),
        })
    }

    /// Whether a displacement is to be met, so that more of it is not better.
    #[must_use]
    pub fn is_met(&self) -> bool {
        self.vectors || self.value_mm.is_some()
    }

    /// The points that can be told one by one; none where a field is wanted.
    #[must_use]
    pub fn points(&self) -> &[Aim] {
        if self.aims.len() > FEW { &[] } else { &self.aims }
    }

    /// One of the numbers of each point, separated by spaces.
    #[must_use]
    pub fn list(&self, of: impl Fn(&Aim) -> f64) -> String {
        // Nine digits are more than a length or angle has, and hide what rounding adds.
        let round = |value: f64| (1e9 * value).round() / 1e9 + 0.0;
        let numbers: Vec<String> = self.points().iter().map(|aim| round(of(aim)).to_string()).collect();
        numbers.join(" ")
    }

    /// In words, on one line.
    #[must_use]
    pub fn description(&self) -> String {
        let one = |aim: &Aim| format!("({}, {}) mm at {:.4}", aim.point[0], aim.point[1], aim.direction + 0.0);
        let one = |aim: &Aim| format!("{}°", one(aim).trim_end_matches('0').trim_end_matches('.'));
        let what = match self.points() {
            [] => format!("a field, given at {} points", self.aims.len()),
            [aim] => one(aim),
            several => format!("the mean of {}", several.iter().map(one).collect::<Vec<_>>().join(", ")),
        };
        match (self.value_mm, self.vectors) {
            (Some(mm), _) => format!("{what} by {mm} mm"),
            (None, true) => format!("{what}, by a given length"),
            (None, false) => what,
        }
    }
}

fn aim(node: &Node) -> Result<Aim, InputError> {
    let missing = |key: &str| node.error(format!("an objective without `{key}`"));
    let point = node.peek("point").ok_or_else(|| missing("point"))?;
    let [x, y] = point.list("point")? else {
        return Err(point.error("`point` must have two coordinates"));
    };
    let length = |node: &Node| Ok::<f64, InputError>(node.quantity("point", Dimension::Length)?.value());
    let direction = match (node.peek("direction"), node.peek("displacement")) {
        (Some(direction), _) => direction.quantity("direction", Dimension::Angle)?.value(),
        (None, Some(displacement)) => {
            let [x, y] = displacement.list("displacement")? else {
                return Err(displacement.error("`displacement` must have two components"));
            };
            length(y)?.atan2(length(x)?).to_degrees()
        }
        (None, None) => return Err(missing("direction")),
    };
    Ok(Aim {
        point: [length(x)?, length(y)?],
        direction,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_directions_are_read_in_mm_and_degrees() {
        let one = Objective::read("{ point: [2.5 cm, 37.5], direction: 45 deg, measure: displacement }").unwrap();
        assert_eq!(one.list(|aim| aim.point[0]), "25");
        assert_eq!(one.description(), "(25, 37.5) mm at 45°");
        let two = Objective::read(
            "{ points: [{ point: [1, 2], direction: 0, weight: 2 }, { point: [3, 4], direction: -90 deg }], value: 1.00 mm }",
        )
        .unwrap();
        assert_eq!(two.list(|aim| aim.direction), "0 -90");
        assert_eq!(two.value_mm, Some(1.0));
        assert!(two.description().ends_with("by 1 mm"), "{}", two.description());
        let vector = Objective::read("{ point: [1, 2], displacement: [1 mm, 1 mm] }").unwrap();
        assert_eq!(
            (vector.list(|aim| aim.direction).as_str(), vector.is_met()),
            ("45", true)
        );
        let field = vec!["{ point: [1, 2], displacement: [0, 1] }"; 17].join(", ");
        let field = Objective::read(&format!("{{ points: [{field}] }}")).unwrap();
        assert_eq!(field.list(|aim| aim.direction), "");
        assert!(
            field.description().starts_with("a field, given at 17 points"),
            "{}",
            field.description()
        );
        assert!(Objective::read("{ point: [1, 2] }").is_err());
    }
}
