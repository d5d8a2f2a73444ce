//! Separated values in long form: a line for each corner of each sample, in any order.

use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::Path;

use csv::StringRecord;

use super::error::ImportError;
use super::rows::Rows;
use crate::Device;
use deaflow_base::open_regular;
use deaflow_pattern::{Membrane, Raster};

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
    raster: Raster,
    seen: Vec<bool>,
    cells: Vec<f64>,
    displacement: Vec<f64>,
}

/// The rows of a file, in the order of the numbers of their samples.
pub fn read(path: &Path, device: &Device) -> Result<Rows, ImportError> {
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
    let lines = device.raster().corners() as u64;
    let mut samples: BTreeMap<u64, Sample> = BTreeMap::new();
    let mut record = StringRecord::new();
    while reader.read_record(&mut record).map_err(broken)? {
        let line = record.position().map_or(0, csv::Position::line);
        let wrong = |why: String| ImportError::Line { line, why };
        let number = corner_of(&record, &device.membrane).map_err(wrong)?;
        // A line takes ten bytes in the file and a new sample half a hundred thousand here.
        if !samples.contains_key(&number.0) && (samples.len() as u64 + 1) * lines * LINE > bytes {
            return Err(wrong("the file has too few lines for so many samples".to_owned()));
        }
        samples
            .entry(number.0)
            .or_insert_with(|| Sample::new(device.raster()))
            .take(&record, number.1)
            .map_err(wrong)?;
    }
    collected(samples, device)
}

/// The sample of a line, and the corner: column and row.
fn corner_of(record: &StringRecord, membrane: &Membrane) -> Result<(u64, [usize; 2]), String> {
    let sample = &record[0];
    let sample = sample
        .parse()
        .map_err(|_| format!("{sample:?} is no number of a sample"))?;
    let place = |axis: usize| {
        let (text, side_mm) = (&record[1 + axis], membrane.size_mm[axis]);
        let most = membrane.raster.sides()[axis] as f64;
        let cells = number(text)? * most / side_mm;
        let near = cells.round();
        match (cells - near).abs() <= NEAR && (0.0..=most).contains(&near) {
            true => Ok(near as usize),
            false => Err(format!(
                "{text} mm is no corner: these stand every {} mm from 0 to {side_mm}",
                side_mm / most
            )),
        }
    };
    Ok((sample, [place(0)?, place(1)?]))
}

fn number(text: &str) -> Result<f64, String> {
    let shown: String = text.chars().take(20).collect();
    text.parse().map_err(|_| format!("{shown:?} is not a number"))
}

impl Sample {
    fn new(raster: Raster) -> Self {
        Self {
            raster,
            seen: vec![false; raster.corners()],
            cells: vec![0.0; raster.cells()],
            displacement: vec![0.0; raster.corners() * 2],
        }
    }

    fn take(&mut self, record: &StringRecord, [x, y]: [usize; 2]) -> Result<(), String> {
        let [columns, rows] = self.raster.sides();
        let corner = y * (columns + 1) + x;
        if std::mem::replace(&mut self.seen[corner], true) {
            return Err("the corner has a line already".to_owned());
        }
        self.displacement[2 * corner] = number(&record[3])?;
        self.displacement[2 * corner + 1] = number(&record[4])?;
        let electrode = &record[5];
        match (x < columns && y < rows, electrode.is_empty()) {
            (true, true) => Err("`electrode` is empty, and there is a cell to the upper right".to_owned()),
            (false, false) => Err("`electrode` is given, and there is no cell to the upper right".to_owned()),
            (false, true) => Ok(()),
            (true, false) => {
                self.cells[y * columns + x] = number(electrode)?;
                Ok(())
            }
        }
    }
}

fn collected(samples: BTreeMap<u64, Sample>, device: &Device) -> Result<Rows, ImportError> {
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
