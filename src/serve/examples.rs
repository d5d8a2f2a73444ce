//! Devices of the gallery of the sketchpad: scenes that every server has.

use deaflow_base::InputError;
use deaflow_scene::Scene;
use deaflow_stage::direct;

/// The names of the scenes, and their texts.
const EXAMPLES: [(&str, &str); 2] = [
    ("lens (example)", include_str!("examples/lens.yaml")),
    (
        "push-pull (example)",
        include_str!("../../pipelines/scenes/push-pull.yaml"),
    ),
];

/// Reads the scenes, with their names.
///
/// # Errors
/// If one of them is not valid.
pub fn examples() -> Result<Vec<(String, Scene)>, InputError> {
    let read = |(name, text): &(&str, &str)| Ok(((*name).to_owned(), direct::scene_of_text(text)?));
    EXAMPLES.iter().map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scenes_are_valid_and_small() {
        let all = examples().unwrap();
        assert_eq!(all.len(), EXAMPLES.len());
        for (name, scene) in all {
            let [columns, rows] = scene.membrane().raster.sides();
            assert!(columns * rows <= 2500, "{name}");
        }
    }
}
