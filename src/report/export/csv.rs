//! Comma-separated values: the layout that this program reads, and `numpy.loadtxt(FILE, delimiter=",")` as well.

use super::ascii;

/// Writes the cells, row by row from below, `columns` to a line, so that the first line is the lower edge. Notes come
/// first as comments.
#[must_use]
pub fn csv<'a>(notes: impl IntoIterator<Item = &'a str>, cells: &[u8], columns: usize) -> Vec<u8> {
    let mut text = String::new();
    for note in notes {
        let note = ascii(note, |c| c.to_string());
        text.push_str(&format!("# {note}\n"));
    }
    text.push_str(
        "# first line at the lower edge of the membrane, first value at the left; 1 = electrode, or the number of its \
         group, 0 = bare\n",
    );
    text.push_str(&cell_lines(cells, columns));
    text.into_bytes()
}

/// Writes cells as comma-separated values, a line for each row.
pub fn cell_lines(cells: &[u8], columns: usize) -> String {
    let line = |row: &[u8]| row.iter().map(u8::to_string).collect::<Vec<_>>().join(",") + "\n";
    cells.chunks(columns.max(1)).map(line).collect()
}
