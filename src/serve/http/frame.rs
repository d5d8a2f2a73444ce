//! Arrays in a form that a browser reads without parsing: the length of a JSON document as 32 bits, the document, and
//! the numbers, little-endian, each array aligned to four bytes.

use serde_json::{Value, json};

/// An array.
pub enum Array {
    /// Numbers, as 32-bit floats.
    Numbers(Vec<usize>, Vec<f32>),
    /// Small integers.
    Bytes(Vec<usize>, Vec<u8>),
}

/// Writes a document and named arrays. The document gets the key `arrays`: name, type, shape, and start after the
/// document.
#[must_use]
pub fn frame(mut document: Value, arrays: &[(String, Array)]) -> Vec<u8> {
    let mut data: Vec<u8> = Vec::new();
    let mut listed = Vec::with_capacity(arrays.len());
    for (name, array) in arrays {
        let (kind, shape) = match array {
            Array::Numbers(shape, _) => ("f32", shape),
            Array::Bytes(shape, _) => ("u8", shape),
        };
        listed.push(json!({ "name": name, "type": kind, "shape": shape, "start": data.len() }));
        match array {
            Array::Numbers(_, numbers) => data.extend(numbers.iter().flat_map(|number| number.to_le_bytes())),
            Array::Bytes(_, bytes) => data.extend(bytes),
        }
        data.resize(data.len().next_multiple_of(4), 0);
    }
    document["arrays"] = Value::Array(listed);
    let mut text = document.to_string().into_bytes();
    // Padded, so that the numbers are aligned to four bytes.
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = (text.len() as u32).to_le_bytes().to_vec();
    bytes.extend(text);
    bytes.extend(data);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_begin_where_the_document_states() {
        let arrays = [
            ("a".to_owned(), Array::Bytes(vec![3], vec![7, 8, 9])),
            ("b".to_owned(), Array::Numbers(vec![1, 2], vec![0.5, -2.0])),
        ];
        let bytes = frame(json!({ "x": 1 }), &arrays);
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        assert_eq!((4 + length) % 4, 0);
        let document: Value = serde_json::from_slice(&bytes[4..4 + length]).unwrap();
        let data = &bytes[4 + length..];
        assert_eq!(
            (&document["x"], &document["arrays"][0]["start"]),
            (&json!(1), &json!(0))
        );
        assert_eq!(&data[..3], [7, 8, 9]);
        let start = document["arrays"][1]["start"].as_u64().unwrap() as usize;
        assert_eq!(f32::from_le_bytes(data[start + 4..start + 8].try_into().unwrap()), -2.0);
    }
}
