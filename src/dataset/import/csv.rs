//! Separated values in long form: a line for each corner of each sample, in any order.

use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::Path;

use csv::StringRecord;

use super::error::ImportError;
use super::rows::Rows;
use crate::base::open_regular;
use crate::field::CORNERS;
use crate::pattern::CELLS;

/// The names of the columns.
pub const COLUMNS: [&str; 6] = ["sample", "x_mm", "y_mm", "ux_mm", "uy_mm", "electrode"];

/// Bytes of the longest file that is read: about 5000 samples.
const MAX_BYTES: u64 = 1 << 29;

/// Bytes of the shortest line.
const LINE: u64 = 10;

/// How far from a corner a line may stand, in cells: coordinates are rounded.
const NEAR: f64 = 0.01;

/// What has been read of a sample.
struct Sample {
    seen: Vec<bool>,
    cells: Vec<f64>,
    displacement: Vec<f64>,
}

/// The rows of a file, in the order of the numbers of their samples, on a membrane of that side in mm.
pub fn read(path: &Path, side_mm: f64) -> Result<Rows, ImportError> {
    let unreadable = |e: std::io::Error| ImportError::Unreadable(e.to_string());
    let file = open_regular(path).map_err(unreadable)?;
    let bytes = file.metadata().map_err(unreadable)?.len();
    if bytes > MAX_BYTES {
        let why = format!("it has {bytes} bytes, and at most {MAX_BYTES} are read: write FILE.npz, or several files");
        return Err(ImportError::Unreadable(why));
    }
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(BufReader::new(file));
    let broken = |e: csv::Error| ImportError::Unreadable(e.to_string());
    let header = reader.headers().map_err(broken)?;
    if !header.iter().eq(COLUMNS) {
        let found: Vec<&str> = header.iter().take(12).collect();
        return Err(ImportError::Columns(found.join(",")));
    }
    let mut samples: BTreeMap<u64, Sample> = BTreeMap::new();
    let mut record = StringRecord::new();
    while reader.read_record(&mut record).map_err(broken)? {
        let line = record.position().map_or(0, csv::Position::line);
        let wrong = |why: String| ImportError::Line { line, why };
        let number = corner_of(&record, side_mm).map_err(wrong)?;
        // A line takes ten bytes in the file and a new sample half a hundred thousand here.
        if !samples.contains_key(&number.0) && (samples.len() as u64 + 1) * (CORNERS * CORNERS) as u64 * LINE > bytes {
            return Err(wrong("the file has too few lines for so many samples".to_owned()));
        }
        samples
            .entry(number.0)
            .or_insert_with(Sample::new)
            .take(&record, number.1)
            .map_err(wrong)?;
    }
    collected(samples, side_mm)
}

/// The sample of a line, and the corner: column and row.
fn corner_of(record: &StringRecord, side_mm: f64) -> Result<(u64, [usize; 2]), String> {
    let sample = &record[0];
    let sample = sample
        .parse()
        .map_err(|_| format!("{sample:?} is no number of a sample"))?;
    let place = |text: &str| {
        let cells = number(text)? * CELLS as f64 / side_mm;
        let near = cells.round();
        match (cells - near).abs() <= NEAR && (0.0..=CELLS as f64).contains(&near) {
            true => Ok(near as usize),
            false => Err(format!(
                "{text} mm is no corner: these stand every {} mm from 0 to {side_mm}",
                side_mm / CELLS as f64
            )),
        }
    };
    Ok((sample, [place(&record[1])?, place(&record[2])?]))
}

fn number(text: &str) -> Result<f64, String> {
    let shown: String = text.chars().take(20).collect();
    text.parse().map_err(|_| format!("{shown:?} is not a number"))
}

impl Sample {
    fn new() -> Self {
        Self {
            seen: vec![false; CORNERS * CORNERS],
            cells: vec![0.0; CELLS * CELLS],
            displacement: vec![0.0; CORNERS * CORNERS * 2],
        }
    }

    fn take(&mut self, record: &StringRecord, [x, y]: [usize; 2]) -> Result<(), String> {
        let corner = y * CORNERS + x;
        if std::mem::replace(&mut self.seen[corner], true) {
            return Err("the corner has a line already".to_owned());
        }
        self.displacement[2 * corner] = number(&record[3])?;
        self.displacement[2 * corner + 1] = number(&record[4])?;
        let electrode = &record[5];
        match (x < CELLS && y < CELLS, electrode.is_empty()) {
            (true, true) => Err("`electrode` is empty, and there is a cell to the upper right".to_owned()),
            (false, false) => Err("`electrode` is given, and there is no cell to the upper right".to_owned()),
            (false, true) => Ok(()),
            (true, false) => {
                self.cells[y * CELLS + x] = number(electrode)?;
                Ok(())
            }
        }
    }
}

fn collected(samples: BTreeMap<u64, Sample>, side_mm: f64) -> Result<Rows, ImportError> {
    let mut all = Rows::default();
    for (row, (sample, found)) in samples.into_iter().enumerate() {
        if let Some(corner) = found.seen.iter().position(|seen| !seen) {
            let mm = |place: usize| place as f64 * side_mm / CELLS as f64;
            return Err(ImportError::Corner {
                sample,
                x_mm: mm(corner % CORNERS),
                y_mm: mm(corner / CORNERS),
            });
        }
        all.append(Rows::new(&found.cells, found.displacement, row, side_mm)?);
    }
    match all.is_empty() {
        true => Err(ImportError::Empty),
        false => Ok(all),
    }
}
