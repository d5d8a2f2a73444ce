//! Materials in files of their own: `material: { from: FILE }`.
//!
//! A file of a material has the sections `material` and `properties` of a scene. They take the place of those that the
//! scene leaves out, before the scene is read: it is the same scene as with the values written out.

use std::path::Path;

use super::effects::Properties;
use super::model::{Material, SECTIONS, WHAT};
use super::named_files::{FROM, MATERIAL, material_file};
use deaflow_base::{Declared, Document, InputError, Node, NodeValue, Schema};

const PROPERTIES: &str = "properties";

/// The properties that are not of the elastomer.
const OF_ELECTRODES: [&str; 2] = ["electrode_stiffness", "sheet_resistance"];

/// Replaces the file of a material in a scene by its content. The path is relative to the file of the scene. Keys of
/// `material` and of `properties` in the scene replace those of the file.
///
/// # Errors
/// If the file cannot be read, is outside the folder of the scene, or has other sections or keys.
pub fn splice_material(scene: &mut Node) -> Result<(), InputError> {
    let Some(named) = material_file(scene) else {
        return Ok(());
    };
    let NodeValue::Text(_) = named.value() else {
        return Err(named
            .error(format!("`material.{FROM}` must be a file, found {}", named.found()))
            .help("for example { from: materials/vhb4910.yaml }"));
    };
    let own = scene.fields(WHAT, &SECTIONS)?.required(WHAT, MATERIAL)?.clone();
    own.fields(Material::WHAT, &keys())?;
    let folder = named.file().parent().unwrap_or(Path::new(""));
    let file = Document::beside(named, folder, MATERIAL, "scene")?.root;
    let sections = file.fields("the file of a material", &[MATERIAL, PROPERTIES])?;
    let material = sections.required("the file of a material", MATERIAL)?;
    material.fields("`material` in the file of a material", &Material::keys())?;
    scene.replace(MATERIAL, overridden(material, &own.without(FROM)));
    let Some(properties) = sections.optional(PROPERTIES) else {
        return Ok(());
    };
    let known = Properties::keys()
        .into_iter()
        .filter(|key| !OF_ELECTRODES.contains(key));
    properties.fields("`properties` of a material", &known.collect::<Vec<_>>())?;
    match scene.peek(PROPERTIES).cloned() {
        Some(own) => scene.replace(PROPERTIES, overridden(properties, &own)),
        None => scene.put(PROPERTIES, properties.clone()),
    }
    Ok(())
}

/// Refuses a file that has not been read. Scenes without a folder cannot name one.
pub(super) fn refuse_file(scene: &Node) -> Result<(), InputError> {
    match material_file(scene) {
        None => Ok(()),
        Some(named) => Err(named
            .error(format!("`material.{FROM}` is not allowed here"))
            .help("only a scene or a pipeline in a file can name the file of a material")),
    }
}

/// Returns a mapping in which the entries of another one replace its own. Anything but a mapping is returned as it is,
/// for its reader to refuse.
fn overridden(known: &Node, by: &Node) -> Node {
    let NodeValue::Map(entries) = by.value() else {
        return by.clone();
    };
    let mut merged = known.clone();
    by.keys().iter().for_each(|key| merged.remove(key));
    merged.extend(entries.clone());
    merged
}

fn keys() -> Vec<&'static str> {
    [FROM].into_iter().chain(Material::keys()).collect()
}

/// Returns the schema of the section `material`: written out, or a file and what replaces its values.
pub(super) fn schema() -> Schema {
    let file = Schema::new(serde_json::json!({ "type": "string" }));
    let file = file.description(
        "The file of a material in the folder of the scene or below it, with `material` and `properties`; keys of the \
         scene replace those of the file.",
    );
    let named = Material::fields().all_optional("The elastomer of a file, with other values where keys are given.");
    Schema::any_of([Material::fields().into(), named.required(FROM, file).into()])
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::PathBuf;

    use super::*;
    use crate::Scene;

    const REST: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }
drive: { voltage: 5 kV }
effects: { strain_stiffening: {} }
";

    const FILE: &str = "material: { model: neo-hookean, shear_modulus: 0.6 MPa, relative_permittivity: 2.8 }
properties:
  strain_stiffening: { model: gent, jm: 30 }
  density: 1000 kg/m3
";

    /// A folder with the file of a material, and a scene with the section `material` and further sections.
    struct Files(tempfile::TempDir);

    impl Files {
        fn new(material: &str) -> Self {
            let folder = tempfile::tempdir().unwrap();
            fs::create_dir(folder.path().join("materials")).unwrap();
            fs::write(folder.path().join("materials/silicone.yaml"), material).unwrap();
            Self(folder)
        }

        fn read(&self, sections: &str) -> Result<Scene, InputError> {
            let file: PathBuf = self.0.path().join("scene.yaml");
            fs::write(&file, format!("{REST}{sections}")).unwrap();
            Scene::load(&file)
        }

        fn refusal(&self, sections: &str) -> (String, String) {
            let error = self.read(sections).unwrap_err();
            let help = miette::Diagnostic::help(&error).map(|help| help.to_string());
            (error.to_string(), help.unwrap_or_default())
        }
    }

    #[test]
    fn a_scene_with_a_file_is_the_scene_with_its_values() {
        let files = Files::new(FILE);
        let named = files.read("material: { from: materials/silicone.yaml }").unwrap();
        let written = Scene::from_text(&format!("{REST}{FILE}")).unwrap();
        assert_eq!(named, written);
        assert_eq!(named.to_text(), written.to_text());
    }

    #[test]
    fn keys_of_the_scene_replace_those_of_the_file() {
        let files = Files::new(FILE);
        let named = files.read(
            "material: { from: materials/silicone.yaml, shear_modulus: 1 MPa }
properties: { strain_stiffening: { model: yeoh, c2: 1 kPa, c3: 0 Pa } }",
        );
        let written = "material: { model: neo-hookean, shear_modulus: 1 MPa, relative_permittivity: 2.8 }
properties: { strain_stiffening: { model: yeoh, c2: 1 kPa, c3: 0 Pa }, density: 1000 kg/m3 }";
        assert_eq!(named.unwrap(), Scene::from_text(&format!("{REST}{written}")).unwrap());
    }

    #[test]
    fn values_of_the_file_are_refused_at_their_place() {
        let files = Files::new("material: { model: neo-hookean, shear_modulus: 1 kPa, relative_permittivity: 0.5 }\n");
        let mut scene = Document::from_text(
            &files.0.path().join("scene.yaml"),
            &format!("{REST}material: {{ from: materials/silicone.yaml }}"),
        );
        let root = &mut scene.as_mut().unwrap().root;
        splice_material(root).unwrap();
        let value = root
            .peek("material")
            .and_then(|material| material.peek("relative_permittivity"));
        assert!(value.unwrap().position().ends_with("materials/silicone.yaml:1"));
        let (said, _) = files.refusal("material: { from: materials/silicone.yaml }");
        assert!(said.contains("`relative_permittivity` is out of range"), "{said}");
    }

    #[test]
    fn other_files_and_other_sections_are_refused() {
        let files = Files::new(FILE);
        fs::write(files.0.path().join("materials/scene.yaml"), format!("{REST}{FILE}")).unwrap();
        let electrodes = format!("{FILE}  sheet_resistance: 10 kOhm\n");
        fs::write(files.0.path().join("materials/electrodes.yaml"), electrodes).unwrap();
        let nested = "material: { from: silicone.yaml }\n";
        fs::write(files.0.path().join("materials/nested.yaml"), nested).unwrap();
        let outside = tempfile::NamedTempFile::new().unwrap();
        let elsewhere = outside.path().display().to_string();
        for (named, said, help) in [
            (
                "missing.yaml",
                "missing.yaml does not exist",
                "relative to the file of the scene",
            ),
            (
                elsewhere.as_str(),
                "is outside the folder of the scene",
                "put it into the folder of the scene",
            ),
            (
                "materials/scene.yaml",
                "unknown key `geometry` in the file of a material",
                "allowed: material, properties",
            ),
            (
                "materials/electrodes.yaml",
                "unknown key `sheet_resistance`",
                "allowed: strain_stiffening",
            ),
            ("materials/nested.yaml", "unknown key `from`", "allowed: model"),
            ("[a]", "must be a file", "for example"),
        ] {
            let (found, advice) = files.refusal(&format!("material: {{ from: {named} }}"));
            assert!(
                found.contains(said) && advice.contains(help),
                "{named}: {found} {advice}"
            );
        }
        let (found, advice) = files.refusal("material: { from: materials/silicone.yaml, modulus: 1 kPa }");
        assert!(
            found.contains("unknown key `modulus`") && advice.contains("from"),
            "{found} {advice}"
        );
        let text = format!("{REST}material: {{ from: materials/silicone.yaml }}");
        let unread = Scene::from_text(&text).unwrap_err().to_string();
        assert!(unread.contains("`material.from` is not allowed here"), "{unread}");
    }
}
