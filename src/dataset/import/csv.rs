//! Reader of tables in long form: one line per corner of each sample, in any order.

use std::collections::BTreeMap;
use std::path::Path;

use super::error::ImportError;
use super::rows::Rows;
use crate::Device;
use deaflow_base::{Row, Table, open_regular};
use deaflow_pattern::{Membrane, Raster};

/// The names of the columns.
pub const COLUMNS: [&str; 6] = ["sample", "x_mm", "y_mm", "ux_mm", "uy_mm", "electrode"];

/// Places in [`COLUMNS`]; `y_mm` and `uy_mm` follow `x_mm` and `ux_mm`.
const SAMPLE: usize = 0;
const X: usize = 1;
const UX: usize = 3;
const ELECTRODE: usize = 5;

/// The largest file, in bytes: about 5000 samples.
const MAX_BYTES: u64 = 1 << 29;

/// Length of the shortest line, in bytes.
const MIN_LINE_BYTES: u64 = 10;

/// Largest distance between a coordinate and its corner, in cells: coordinates may be rounded.
const CORNER_TOLERANCE: f64 = 0.01;

/// A sample that is being read.
struct PartialSample {
    raster: Raster,
    seen: Vec<bool>,
    cells: Vec<f64>,
    displacement: Vec<f64>,
}

/// The columns of a line.
struct Line<'a> {
    row: Row<'a>,
    /// The places of [`COLUMNS`].
    columns: [usize; COLUMNS.len()],
}

impl Line<'_> {
    fn text(&self, column: usize) -> &str {
        self.row.field(self.columns[column])
    }

    fn number(&self, column: usize) -> Result<f64, ImportError> {
        let text = self.text(column);
        let number = self.row.with_point(self.columns[column])?.parse();
        number.map_err(|_| {
            let shown: String = text.chars().take(20).collect();
            self.error(format!("`{}`: {shown:?} is not a number", COLUMNS[column]))
        })
    }

    /// Whether the line has a cell. Programs that write numbers only write NaN for none.
    fn has_cell(&self) -> bool {
        !["", "nan"].contains(&self.text(ELECTRODE).to_ascii_lowercase().as_str())
    }

    fn error(&self, why: impl Into<String>) -> ImportError {
        let (line, why) = (self.row.line, why.into());
        ImportError::Line { line, why }
    }
}

/// Reads all rows of a file, in the order of their sample numbers.
pub fn read(path: &Path, device: &Device) -> Result<Rows, ImportError> {
    let bytes = open_regular(path).and_then(|file| file.metadata());
    let bytes = bytes.map_err(|e| ImportError::Unreadable(e.to_string()))?.len();
    if bytes > MAX_BYTES {
        let why =
            format!("the file has {bytes} bytes, at most {MAX_BYTES} are allowed: write FILE.npz, or several files");
        return Err(ImportError::Unreadable(why));
    }
    let mut table = Table::open(path, MAX_BYTES)?;
    let columns = table.columns(COLUMNS)?;
    let lines = device.raster().corners() as u64;
    let mut samples: BTreeMap<u64, PartialSample> = BTreeMap::new();
    while let Some(row) = table.next_row()? {
        let line = Line { row, columns };
        let (sample, corner) = parse_corner(&line, &device.membrane)?;
        // Without this check a line of ten bytes would allocate about 50 kB.
        if !samples.contains_key(&sample) && (samples.len() as u64 + 1) * lines * MIN_LINE_BYTES > bytes {
            return Err(line.error("the file is too short for this number of samples"));
        }
        samples
            .entry(sample)
            .or_insert_with(|| PartialSample::new(device.raster()))
            .add_line(&line, corner)?;
    }
    into_rows(samples, device)
}

/// The largest sample number: beyond it not every whole number is a double.
const MAX_SAMPLE: f64 = 9_007_199_254_740_992.0;

/// Parses the sample number of a line, and column and row of its corner.
fn parse_corner(line: &Line<'_>, membrane: &Membrane) -> Result<(u64, [usize; 2]), ImportError> {
    // As `numpy.savetxt` writes it: 3.000000000000000000e+00.
    let sample = line.number(SAMPLE)?;
    if sample.fract() != 0.0 || !(0.0..=MAX_SAMPLE).contains(&sample) {
        return Err(line.error(format!("`sample` is {:?}, not a whole number", line.text(SAMPLE))));
    }
    let place = |axis: usize| {
        let side_mm = membrane.size_mm[axis];
        let most = membrane.raster.sides()[axis] as f64;
        let cells = line.number(X + axis)? * most / side_mm;
        let near = cells.round();
        match (cells - near).abs() <= CORNER_TOLERANCE && (0.0..=most).contains(&near) {
            true => Ok(near as usize),
            false => Err(line.error(format!(
                "no corner at {} mm: corners are {} mm apart, from 0 to {side_mm} mm",
                line.text(X + axis),
                side_mm / most
            ))),
        }
    };
    Ok((sample as u64, [place(0)?, place(1)?]))
}

impl PartialSample {
    fn new(raster: Raster) -> Self {
        Self {
            raster,
            seen: vec![false; raster.corners()],
            cells: vec![0.0; raster.cells()],
            displacement: vec![0.0; raster.corners() * 2],
        }
    }

    fn add_line(&mut self, line: &Line<'_>, [x, y]: [usize; 2]) -> Result<(), ImportError> {
        let [columns, rows] = self.raster.sides();
        let corner = y * (columns + 1) + x;
        if std::mem::replace(&mut self.seen[corner], true) {
            return Err(line.error("the corner has more than one line"));
        }
        self.displacement[2 * corner] = line.number(UX)?;
        self.displacement[2 * corner + 1] = line.number(UX + 1)?;
        match (x < columns && y < rows, line.has_cell()) {
            (true, false) => Err(line.error("`electrode` is empty, but there is a cell to the upper right")),
            // Programs that write a value at every corner write 0 there.
            (false, true) if line.number(ELECTRODE)? != 0.0 => {
                Err(line.error("`electrode` is given, but there is no cell to the upper right"))
            }
            (false, _) => Ok(()),
            (true, true) => {
                self.cells[y * columns + x] = line.number(ELECTRODE)?;
                Ok(())
            }
        }
    }
}

fn into_rows(samples: BTreeMap<u64, PartialSample>, device: &Device) -> Result<Rows, ImportError> {
    let mut all = Rows::default();
    for (row, (sample, found)) in samples.into_iter().enumerate() {
        if let Some(corner) = found.seen.iter().position(|seen| !seen) {
            let Membrane { raster, size_mm } = device.membrane;
            let [columns, rows] = raster.sides();
            return Err(ImportError::Corner {
                sample,
                x_mm: (corner % (columns + 1)) as f64 * size_mm[0] / columns as f64,
                y_mm: (corner / (columns + 1)) as f64 * size_mm[1] / rows as f64,
            });
        }
        all.append(Rows::new(&found.cells, found.displacement, row, device)?);
    }
    match all.is_empty() {
        true => Err(ImportError::Empty),
        false => Ok(all),
    }
}
