//! The membrane of a scene: its sides, cells, thickness and prestretch.

use std::ops::RangeInclusive;

use serde_json::json;

use super::model::{SECTIONS, WHAT};
use crate::base::{
    Canonical, Decimal, Declared, Fields, InputError, Length, Map, Node, NodeValue, Parameter, Schema, parameters,
};
use crate::pattern::{Membrane, Raster};

/// A value along x and one along y; as one where they are equal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Both<T>(pub [T; 2]);

impl<T: Parameter + Clone + PartialEq> Parameter for Both<T> {
    type Limits = T::Limits;
    type Literal = T::Literal;

    fn read(node: &Node, key: &str, limits: &T::Limits) -> Result<Self, InputError> {
        match node.value() {
            NodeValue::List(_) => <[T; 2]>::read(node, key, limits).map(Self),
            _ => T::read(node, key, limits).map(|value| Self([value.clone(), value])),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match &self.0 {
            [x, y] if x == y => x.canonical(),
            both => both.canonical(),
        }
    }

    fn schema(limits: &T::Limits) -> Schema {
        Schema::any_of([T::schema(limits), <[T; 2]>::schema(limits)])
    }

    fn literal(literal: T::Literal) -> Self {
        let value = T::literal(literal);
        Self([value.clone(), value])
    }
}

parameters! {
    /// The membrane, prestretched and clamped on a rigid frame. What is two values is along x and y.
    pub struct Geometry as "`geometry`" {
        /// Side of a square membrane, prestretched.
        pub side: Option<Length> [SIDES],
        /// Sides of the prestretched membrane, in place of `side`.
        pub size: Option<[Length; 2]> [SIDES],
        /// Undeformed thickness, before prestretch.
        pub thickness: Length [1e-4..=1e3],
        /// Prestretch: one number where it is equibiaxial.
        pub prestretch: Both<Decimal> [PRESTRETCH],
        /// Cells along the sides: one number where they are as many.
        pub cells: Both<usize> [CELLS],
    }
    rules(side_or_size)
    check(check_size)
}

fn side_or_size(fields: Fields) -> Fields {
    fields.rule(json!({ "oneOf": [{ "required": ["side"] }, { "required": ["size"] }] }))
}

/// What those need to know of a membrane who draw patterns on it or learn from them. Of a scene that is swept it is the same for all values of
/// an axis, unless the axis stands in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    /// Its cells and its sides; [`Outline::read`] says 1 mm of those of a square, however large it is.
    pub membrane: Membrane,
    /// Prestretch along x and y; [`Outline::read`] says 1 and 1 where it is one number.
    pub prestretch: [f64; 2],
}

impl Outline {
    /// The outline in the mapping of a scene. All else in it is left alone.
    ///
    /// # Errors
    /// When it has no geometry, or sides or cells cannot be read.
    pub fn read(scene: &Node) -> Result<Self, InputError> {
        let node = scene.fields(WHAT, &SECTIONS)?.required(WHAT, "geometry")?;
        let map = node.fields(Geometry::WHAT, &Geometry::keys())?;
        let Both([columns, rows]) = map.read(Geometry::WHAT, "cells", &CELLS, None)?;
        let size = match map.optional("size") {
            Some(size) => <[Length; 2]>::read(size, "size", &SIDES)?.map(|side| side.value()),
            None => [1.0; 2],
        };
        let prestretch = match map.optional("prestretch") {
            Some(node) if matches!(node.value(), NodeValue::List(_)) => {
                <[Decimal; 2]>::read(node, "prestretch", &PRESTRETCH)?.map(Decimal::to_f64)
            }
            _ => [1.0; 2],
        };
        let size_mm = if size[0] == size[1] { [1.0; 2] } else { size };
        Ok(Self {
            membrane: Membrane {
                raster: Raster::new(columns, rows).expect("cells are in range"),
                size_mm,
            },
            prestretch,
        })
    }
}

const SIDES: RangeInclusive<f64> = 1e-3..=1e4;
const PRESTRETCH: RangeInclusive<f64> = 1.0..=10.0;
const CELLS: RangeInclusive<u64> = 1..=Raster::MOST as u64;

fn check_size(geometry: &Geometry, map: &Map<'_>) -> Result<(), InputError> {
    match (&geometry.side, &geometry.size) {
        (Some(_), None) | (None, Some(_)) => Ok(()),
        (None, None) => map.required("`geometry`", "side").map(|_| ()),
        (Some(_), Some(_)) => Err(map
            .required("`geometry`", "size")?
            .error("`size` and `side` cannot stand beside each other")
            .help("give `side` of a square membrane, or `size: [along x, along y]`")),
    }
}

impl Geometry {
    /// A square membrane with the raster of the source paper: its side and thickness in mm, and its prestretch.
    ///
    /// # Panics
    /// When a number is not finite.
    #[must_use]
    pub fn square(side: f64, thickness: f64, prestretch: f64) -> Self {
        let finite = "a finite number";
        Self {
            side: Some(Length::from_f64(side).expect(finite)),
            size: None,
            thickness: Length::from_f64(thickness).expect(finite),
            prestretch: Both::literal(prestretch),
            cells: Both(Raster::PAPER.sides()),
        }
    }

    /// The same geometry in the one way of saying it that is canonical: a square has a side.
    #[must_use]
    pub fn normalised(self) -> Self {
        match &self.size {
            Some([x, y]) if x == y => Self {
                side: Some(*x),
                size: None,
                ..self
            },
            _ => self,
        }
    }

    /// Its outline, with its true sides.
    #[must_use]
    pub fn outline(&self) -> Outline {
        Outline {
            membrane: self.membrane(),
            prestretch: self.prestretch.0.each_ref().map(|stretch| stretch.to_f64()),
        }
    }

    /// What patterns are drawn on.
    ///
    /// # Panics
    /// Never: a geometry has been checked.
    #[must_use]
    pub fn membrane(&self) -> Membrane {
        let Both([columns, rows]) = self.cells;
        let size_mm = match (&self.size, &self.side) {
            (Some(size), _) => size.each_ref().map(|side| side.value()),
            (None, side) => [side.as_ref().map_or(0.0, |side| side.value()); 2],
        };
        Membrane {
            raster: Raster::new(columns, rows).expect("cells are in range"),
            size_mm,
        }
    }
}
