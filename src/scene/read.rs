//! Reads a scene from a document, refusing what is unknown, missing or out of range.

use std::path::Path;

use super::effects::Effects;
use super::model::{Drive, Geometry, Law, Material, Scene};
use super::read_effects::{Request, read_effects, read_properties};
use crate::base::{Dimension, Document, InputError, Node};
use crate::pattern::CELLS;

/// The sections of a scene.
pub const SECTIONS: [&str; 5] = ["geometry", "material", "drive", "effects", "properties"];

impl Scene {
    /// Reads a scene from a YAML file.
    ///
    /// # Errors
    /// When the file cannot be read or is not a scene.
    pub fn load(path: &Path) -> Result<Self, InputError> {
        Self::read(&Document::load(path)?.root)
    }

    /// Reads a scene from text, such as an artifact's `scene` attribute.
    ///
    /// # Errors
    /// When the text is not a scene.
    pub fn from_text(text: &str) -> Result<Self, InputError> {
        Self::read(&Document::from_text(Path::new("scene"), text)?.root)
    }

    /// Reads a scene from a node of a document.
    ///
    /// # Errors
    /// When a key is unknown or missing, or a value is out of range.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let scene = node.fields("the scene", &SECTIONS)?;
        let material = read_material(scene.required("the scene", "material")?)?;
        let modulus = material.shear_modulus.value();
        let properties = read_properties(scene.optional("properties"), modulus)?;
        let (effects, auto) = match read_effects(scene.optional("effects"), &properties, modulus)? {
            Request::Auto => (Effects::default(), true),
            Request::Named(effects) => (effects, false),
        };
        Ok(Self {
            geometry: read_geometry(scene.required("the scene", "geometry")?)?,
            material,
            drive: read_drive(scene.required("the scene", "drive")?)?,
            effects,
            auto,
            properties,
        })
    }
}

fn read_geometry(node: &Node) -> Result<Geometry, InputError> {
    let what = "`geometry`";
    let map = node.fields(what, &["side", "thickness", "prestretch", "cells"])?;
    let cells = map.required(what, "cells")?;
    if cells.whole("cells", 1, 100_000)? != CELLS as u64 {
        return Err(cells
            .error(format!(
                "`cells` is {}: patterns have {CELLS} × {CELLS} cells",
                cells.found()
            ))
            .help(format!("allowed: {CELLS}")));
    }
    Ok(Geometry {
        side: map
            .required(what, "side")?
            .quantity_in("side", Dimension::Length, 1e-3, 1e4)?,
        thickness: map
            .required(what, "thickness")?
            .quantity_in("thickness", Dimension::Length, 1e-4, 1e3)?,
        prestretch: map
            .required(what, "prestretch")?
            .quantity_in("prestretch", Dimension::Number, 1.0, 10.0)?,
    })
}

fn read_material(node: &Node) -> Result<Material, InputError> {
    let what = "`material`";
    let map = node.fields(what, &["model", "shear_modulus", "relative_permittivity"])?;
    map.required(what, "model")?.word("model", &[Law::NeoHookean.name()])?;
    Ok(Material {
        law: Law::NeoHookean,
        shear_modulus: map.required(what, "shear_modulus")?.quantity_in(
            "shear_modulus",
            Dimension::Stress,
            1.0,
            1e9,
        )?,
        relative_permittivity: map.required(what, "relative_permittivity")?.quantity_in(
            "relative_permittivity",
            Dimension::Number,
            1.0,
            1e4,
        )?,
    })
}

fn read_drive(node: &Node) -> Result<Drive, InputError> {
    let what = "`drive`";
    if let Some((key, _)) = node.entries(what)?.iter().find(|(key, _)| key.is_text("charge")) {
        return Err(key
            .error("a drive by charge is not available yet")
            .help("allowed: voltage, frequency, duration"));
    }
    let map = node.fields(what, &["voltage", "frequency", "duration"])?;
    let optional = |key, dimension| {
        let node = map.optional(key);
        node.map(|node: &Node| node.quantity_in(key, dimension, 1e-9, 1e9))
            .transpose()
    };
    Ok(Drive {
        voltage: map
            .required(what, "voltage")?
            .quantity_in("voltage", Dimension::Voltage, 0.0, 1e6)?,
        frequency: optional("frequency", Dimension::Frequency)?,
        duration: optional("duration", Dimension::Time)?,
    })
}
