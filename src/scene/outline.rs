//! The properties of a device that sampling and training depend on.

use super::geometry::{Both, CELLS, Geometry, PRESTRETCH, SIDES};
use super::model::{SECTIONS, Scene, WHAT};
use deaflow_base::{Decimal, Declared, InputError, Length, Map, Node, NodeValue, Parameter};
use deaflow_pattern::{Bits, Membrane, PatternForm, Raster};

/// The properties of a device that sampling and training depend on. In a sweep they are the same for all values of an
/// axis, unless the axis changes one of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    /// The cells and sides; [`Outline::read`] sets the side of a square to 1 mm.
    pub membrane: Membrane,
    /// Prestretch along x and y; [`Outline::read`] sets a single number to 1.
    pub prestretch: [f64; 2],
    /// Whether there is a frame inside the rectangle.
    pub has_frame: bool,
    /// Whether there are rigid bodies.
    pub has_bodies: bool,
    /// The number of electrode groups.
    pub groups: usize,
}

impl Outline {
    /// Reads the outline from the mapping of a scene and ignores the other keys.
    ///
    /// # Errors
    /// When it has no geometry, or sides or cells are invalid.
    pub fn read(scene: &Node) -> Result<Self, InputError> {
        let sections = scene.fields(WHAT, &SECTIONS)?;
        let node = sections.required(WHAT, "geometry")?;
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
            has_frame: map.optional("frame").is_some(),
            has_bodies: map.optional("bodies").is_some(),
            groups: groups(&sections),
        })
    }

    /// Reads the cells that can carry electrodes from the mapping of a scene; `None` if all can.
    ///
    /// # Errors
    /// When the geometry is invalid.
    pub fn free_cells(scene: &Node) -> Result<Option<Bits>, InputError> {
        let node = geometry(scene)?;
        if ["frame", "bodies"].iter().all(|key| node.peek(key).is_none()) {
            return Ok(None);
        }
        let parts = Geometry::read_with(&node, &[])?.parts();
        Ok(parts.map(|parts| parts.free_cells()))
    }

    /// Reads the form of patterns on the device, with the actual sides, from the mapping of a scene.
    ///
    /// # Errors
    /// When the geometry is invalid.
    pub fn actual_form(scene: &Node) -> Result<PatternForm, InputError> {
        let groups = Self::read(scene)?.groups;
        Ok(PatternForm::on(
            &Geometry::read_with(&geometry(scene)?, &[])?.membrane(),
            groups,
        ))
    }

    /// Returns the form of patterns on the device.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        PatternForm::on(&self.membrane, self.groups)
    }
}

impl Scene {
    /// Returns the outline, with the actual sides.
    #[must_use]
    pub fn outline(&self) -> Outline {
        Outline {
            membrane: self.membrane(),
            prestretch: self.prestretch(),
            has_frame: self.geometry.frame.is_some(),
            has_bodies: self.geometry.bodies.is_some(),
            groups: self.groups(),
        }
    }
}

/// Returns the geometry of a scene. Patterns do not depend on thickness and prestretch, so that axes of a sweep may
/// stand there; any value takes their place.
fn geometry(scene: &Node) -> Result<Node, InputError> {
    let mut geometry = scene.fields(WHAT, &SECTIONS)?.required(WHAT, "geometry")?.clone();
    let any = [
        ("thickness", NodeValue::Text("1 mm".to_owned())),
        ("prestretch", NodeValue::Number("1".to_owned())),
    ];
    for (key, value) in any {
        let is_axis = |node: &&Node| matches!(node.value(), NodeValue::Text(text) if text.contains("${"));
        if let Some(node) = geometry.peek(key).filter(is_axis) {
            let any = node.with_value(value);
            geometry.put(key, any);
        }
    }
    Ok(geometry)
}

/// Returns the number of electrode groups of a scene whose drive or first state has not been checked.
fn groups(scene: &Map<'_>) -> usize {
    let first = || {
        scene
            .optional("states")?
            .entries("`states`")
            .ok()?
            .first()
            .map(|(_, state)| state)
    };
    let voltages = scene
        .optional("drive")
        .or_else(first)
        .and_then(|drive| drive.peek("voltages"));
    voltages
        .and_then(|voltages| voltages.list("voltages").ok())
        .map_or(1, <[Node]>::len)
}
