//! The files that a scene names.

use deaflow_base::{Node, NodeValue};

/// The section of the elastomer.
pub const MATERIAL: &str = "material";

/// The key that names the file of a material.
pub const FROM: &str = "from";

/// The keys that name a file: masks, drawings and tables of voltages.
const FILE_KEYS: [&str; 3] = ["mask", "file", "table"];

/// Returns the node that names the file of the material in a scene, if there is one.
#[must_use]
pub fn material_file(scene: &Node) -> Option<&Node> {
    scene.peek(MATERIAL)?.peek(FROM)
}

/// Returns the files of all masks, drawings, voltage tables and materials below a node, as named in the document.
#[must_use]
pub fn scene_files(node: &Node) -> Vec<String> {
    match node.value() {
        NodeValue::List(items) => items.iter().flat_map(scene_files).collect(),
        NodeValue::Map(entries) => {
            let each = entries.iter().flat_map(|(key, value)| match value.value() {
                NodeValue::Text(file) if FILE_KEYS.iter().any(|known| key.is_text(known)) => vec![file.clone()],
                _ => scene_files(value),
            });
            let material = material_file(node).map(Node::value);
            let material = material.and_then(|named| match named {
                NodeValue::Text(file) => Some(file.clone()),
                _ => None,
            });
            each.chain(material).collect()
        }
        _ => Vec::new(),
    }
}
