//! What a design is for, from the text of its objective.

use std::path::Path;

use crate::base::{Dimension, Document, InputError, Node};

/// An objective, as far as it has points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wanted {
    /// Points and directions; none where a whole field is wanted.
    pub aims: Vec<Aim>,
    /// The displacement in mm that is to be met, where it is not to be as large as can be.
    pub value_mm: Option<f64>,
}

/// A point and where it should move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Its place in mm from the lower left corner.
    pub point: [f64; 2],
    /// Counterclockwise from the x axis, degrees.
    pub direction: f64,
}

impl Wanted {
    /// Reads `{ point, direction }` or `{ points: [{ point, direction }, …] }`; other keys do not matter here.
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
            aims: aims.iter().map(aim).collect::<Result<_, _>>()?,
            value_mm: value.transpose()?.map(|value| value.value()),
        })
    }

    /// One of the numbers of each aim, separated by spaces.
    #[must_use]
    pub fn list(&self, of: impl Fn(&Aim) -> f64) -> String {
        let numbers: Vec<String> = self.aims.iter().map(|aim| (of(aim) + 0.0).to_string()).collect();
        numbers.join(" ")
    }

    /// In words, on one line.
    #[must_use]
    pub fn words(&self) -> String {
        let one = |aim: &Aim| format!("({}, {}) mm at {}°", aim.point[0], aim.point[1], aim.direction + 0.0);
        let aims: Vec<String> = self.aims.iter().map(one).collect();
        let what = match aims.as_slice() {
            [] => "a field".to_owned(),
            [one] => one.clone(),
            several => format!("the mean of {}", several.join(", ")),
        };
        match self.value_mm {
            Some(mm) => format!("{what} by {mm} mm"),
            None => what,
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
    let direction = node.peek("direction").ok_or_else(|| missing("direction"))?;
    Ok(Aim {
        point: [length(x)?, length(y)?],
        direction: direction.quantity("direction", Dimension::Angle)?.value(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_directions_are_read_in_mm_and_degrees() {
        let one = Wanted::read("{ point: [2.5 cm, 37.5], direction: 45 deg, measure: displacement }").unwrap();
        assert_eq!(one.list(|aim| aim.point[0]), "25");
        assert_eq!(one.words(), "(25, 37.5) mm at 45°");
        let two = Wanted::read(
            "{ points: [{ point: [1, 2], direction: 0, weight: 2 }, { point: [3, 4], direction: -90 deg }], value: 1.00 mm }",
        )
        .unwrap();
        assert_eq!(two.list(|aim| aim.direction), "0 -90");
        assert_eq!(two.value_mm, Some(1.0));
        assert!(two.words().ends_with("by 1 mm"), "{}", two.words());
        assert_eq!(Wanted::read("{ field: target.npy }").unwrap().words(), "a field");
        assert!(Wanted::read("{ point: [1, 2] }").is_err());
    }
}
