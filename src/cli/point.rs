//! The displacement of a point along a direction.

use clap::Args;
use serde_json::{Value, json};

use super::CliError;
use super::arguments::{Coordinates, coordinates, quantity};
use deaflow_base::{Dimension, Quantity};
use deaflow_field::Field;
use deaflow_scene::Scene;

/// A point of the membrane and a direction.
#[derive(Clone, Debug, Args)]
pub struct PointArguments {
    /// Also report the displacement of this point, measured from the lower left corner, as in "25 mm, 25 mm"
    #[arg(long = "point", value_name = "X,Y", value_parser = coordinates, allow_hyphen_values = true)]
    point: Option<Coordinates>,
    /// Report the component along this direction, counterclockwise from the x axis, as in "90 deg"
    #[arg(long, value_name = "ANGLE", value_parser = direction, requires = "point", allow_hyphen_values = true)]
    direction: Option<Quantity>,
}

fn direction(text: &str) -> Result<Quantity, String> {
    quantity(text, Dimension::Angle)
}

/// What follows the title of a displacement from the mount, where that is not at rest.
pub const FROM_MOUNT: &str = " from the mount";

/// A point of a membrane and a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// In mm from the lower left corner.
    pub point_mm: [f64; 2],
    /// In degrees from the x axis; none for the magnitude of the displacement.
    degrees: Option<f64>,
    cell_mm: [f64; 2],
    /// Whether the state at rest differs from the mount: not all sides are held.
    has_rest: bool,
}

impl PointArguments {
    /// Whether a point is given.
    pub fn is_given(&self) -> bool {
        self.point.is_some()
    }

    /// Returns the point on the membrane of a scene, if one is given.
    ///
    /// # Errors
    /// When the point is outside.
    pub fn on(&self, scene: &Scene) -> Result<Option<Probe>, CliError> {
        let Some(point) = self.point else {
            return Ok(None);
        };
        let membrane = scene.membrane();
        let (cell_mm, cells) = (membrane.cell_mm(), membrane.raster.sides());
        let sides: [f64; 2] = std::array::from_fn(|k| cell_mm[k] * cells[k] as f64);
        let point_mm = point.mm();
        if !(0..2).all(|k| (0.0..=sides[k]).contains(&point_mm[k])) {
            let [x, y] = point_mm;
            return Err(
                CliError::bad_input(format!("--point {x} mm, {y} mm is outside the membrane"))
                    .help(format!("allowed: 0 to {} mm and 0 to {} mm", sides[0], sides[1])),
            );
        }
        Ok(Some(Probe {
            point_mm,
            degrees: self.direction.map(|direction| direction.value()),
            cell_mm,
            has_rest: scene.geometry.sides.is_some(),
        }))
    }
}

impl Probe {
    /// Returns the displacement there along the direction, or its magnitude without one, mm.
    pub fn of(&self, field: &Field) -> f64 {
        let u = field.at(self.place());
        self.along(u).unwrap_or_else(|| u[0].hypot(u[1]))
    }

    /// Returns the point in cells.
    fn place(&self) -> [f64; 2] {
        std::array::from_fn(|k| self.point_mm[k] / self.cell_mm[k])
    }

    /// Returns the component of a displacement along the direction; `None` without one.
    pub fn along(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let (sine, cosine) = self.degrees?.to_radians().sin_cos();
        Some(x * cosine + y * sine)
    }

    /// Whether a direction is given.
    pub fn has_direction(&self) -> bool {
        self.degrees.is_some()
    }

    /// Returns the displacement there along x, y and out of the plane, mm; `None` if heights in mm do not belong to the
    /// field.
    pub fn in_space(&self, field: &Field, heights: &[f64]) -> Option<[f64; 3]> {
        let field = field.clone().in_space(heights.to_vec(), 0.0).ok()?;
        let [x, y] = field.at(self.place());
        Some([x, y, field.height_at(self.place())])
    }

    /// Returns the displacements of patterns, NaN for missing ones, and a description of the point, for a file.
    pub fn of_all(self, along_mm: impl Iterator<Item = Option<f64>>) -> (Vec<f64>, String) {
        let values = along_mm.map(|mm| mm.unwrap_or(f64::NAN)).collect();
        (values, self.described())
    }

    /// Describes the point and its direction, for a file.
    pub fn described(&self) -> String {
        let [x, y] = self.point_mm;
        let along = self
            .degrees
            .map_or_else(String::new, |degrees| format!(", {degrees} deg"));
        format!("{x} mm, {y} mm{along}")
    }

    /// Returns the title of a column.
    pub fn title(&self) -> String {
        let place = self.title_of_place();
        self.degrees
            .map_or_else(|| place.clone(), |degrees| format!("{place} along {degrees} deg"))
    }

    /// The same without the direction.
    pub fn title_of_place(&self) -> String {
        let [x, y] = self.point_mm;
        format!("at {x}, {y} mm")
    }

    /// Returns the title of a column with displacements from the mount, which it says where these differ from those
    /// from rest.
    pub fn title_from_mount(&self) -> String {
        self.title() + if self.has_rest { FROM_MOUNT } else { "" }
    }

    /// The same with displacements from rest.
    pub fn title_from_rest(&self) -> String {
        self.title_from("rest")
    }

    /// The same with displacements from another state than the mount, if such states differ from it.
    pub fn title_from(&self, state: &str) -> String {
        match self.has_rest {
            true => format!("{} from {state}", self.title()),
            false => self.title(),
        }
    }

    /// Describes the point for programs.
    pub fn document(&self) -> Value {
        json!({ "point_mm": self.point_mm, "direction_deg": self.degrees })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_moves_along_a_direction() {
        let scene = Scene::vhb4910();
        let raster = scene.membrane().raster;
        let values = (0..raster.corners()).flat_map(|_| [0.3, 0.4]).collect();
        let field = Field::from_values(raster, values).unwrap();
        let asked = |at: &str, along: &str| PointArguments {
            point: Some(coordinates(at).unwrap()),
            direction: Some(direction(along).unwrap()),
        };
        let of = |at: &str, along: &str| asked(at, along).on(&scene).unwrap().unwrap().of(&field);
        assert!((of("25 mm, 25 mm", "0 deg") - 0.3).abs() < 1e-12);
        assert!((of("[10, 50]", "90") - 0.4).abs() < 1e-12);
        assert!((of("0,0", "-90 deg") + 0.4).abs() < 1e-12);
        let size = PointArguments {
            direction: None,
            ..asked("25 mm, 25 mm", "0 deg")
        };
        let size = size.on(&scene).unwrap().unwrap();
        assert!(
            (size.of(&field) - 0.5).abs() < 1e-12,
            "without a direction it is the size"
        );
        assert_eq!(size.title(), "at 25, 25 mm");
        let outside = asked("25 mm, 51 mm", "0 deg").on(&scene).unwrap_err();
        assert!(outside.message().contains("outside the membrane"));
        assert!(coordinates("25 mm").is_err() && coordinates("1 V, 2 mm").is_err() && direction("3 mm").is_err());
        let none = PointArguments {
            point: None,
            direction: None,
        };
        assert_eq!(none.on(&scene).unwrap(), None);
    }
}
