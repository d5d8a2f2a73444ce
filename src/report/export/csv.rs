//! Comma-separated values: the layout that this program reads itself, and `numpy.loadtxt(FILE, delimiter=",")` too.

use super::ascii;

/// The cells, row by row from below, `columns` to a line, so that the first line is at the lower edge. Title and notes come
/// first as comments.
#[must_use]
pub fn csv<'a>(notes: impl IntoIterator<Item = &'a str>, cells: &[u8], columns: usize) -> Vec<u8> {
    let mut text = String::new();
    for note in notes {
        let note = ascii(note, |c| c.to_string());
        text.push_str(&format!("# {note}\n"));
    }
    text.push_str("# first line at the lower edge of the membrane, first value at the left; 1 = electrode, or the number of its group, 0 = bare\n");
    for row in cells.chunks(columns.max(1)) {
        let values: Vec<String> = row.iter().map(u8::to_string).collect();
        text.push_str(&values.join(","));
        text.push('\n');
    }
    text.into_bytes()
}
