//! Reader of CSV files in long form: one line per corner of each sample, in any order.

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

/// Reads all rows of a file, in the order of their sample numbers.
pub fn read(path: &Path, device: &Device) -> Result<Rows, ImportError> {
    let unreadable = |e: std::io::Error| ImportError::Unreadable(e.to_string());
    let file = open_regular(path).map_err(unreadable)?;
    let bytes = file.metadata().map_err(unreadable)?.len();
    if bytes > MAX_BYTES {
        let why =
            format!("the file has {bytes} bytes, at most {MAX_BYTES} are allowed: write FILE.npz, or several files");
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
    let mut samples: BTreeMap<u64, PartialSample> = BTreeMap::new();
    let mut record = StringRecord::new();
    while reader.read_record(&mut record).map_err(broken)? {
        let line = record.position().map_or(0, csv::Position::line);
        let wrong = |why: String| ImportError::Line { line, why };
        let (sample, corner) = parse_corner(&record, &device.membrane).map_err(wrong)?;
        // Without this check a line of ten bytes would allocate about 50 kB.
        if !samples.contains_key(&sample) && (samples.len() as u64 + 1) * lines * MIN_LINE_BYTES > bytes {
            return Err(wrong("the file is too short for this number of samples".to_owned()));
        }
        samples
            .entry(sample)
            .or_insert_with(|| PartialSample::new(device.raster()))
            .add_line(&record, corner)
            .map_err(wrong)?;
    }
    into_rows(samples, device)
}

/// Parses the sample number of a line, and column and row of its corner.
fn parse_corner(record: &StringRecord, membrane: &Membrane) -> Result<(u64, [usize; 2]), String> {
    let sample = record[0]
        .parse()
        .map_err(|_| format!("`sample` is {:?}, not a whole number", &record[0]))?;
    let place = |axis: usize| {
        let (text, side_mm) = (&record[1 + axis], membrane.size_mm[axis]);
        let most = membrane.raster.sides()[axis] as f64;
        let cells = number(text)? * most / side_mm;
        let near = cells.round();
        match (cells - near).abs() <= CORNER_TOLERANCE && (0.0..=most).contains(&near) {
            true => Ok(near as usize),
            false => Err(format!(
                "no corner at {text} mm: corners are {} mm apart, from 0 to {side_mm} mm",
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

impl PartialSample {
    fn new(raster: Raster) -> Self {
        Self {
            raster,
            seen: vec![false; raster.corners()],
            cells: vec![0.0; raster.cells()],
            displacement: vec![0.0; raster.corners() * 2],
        }
    }

    fn add_line(&mut self, record: &StringRecord, [x, y]: [usize; 2]) -> Result<(), String> {
        let [columns, rows] = self.raster.sides();
        let corner = y * (columns + 1) + x;
        if std::mem::replace(&mut self.seen[corner], true) {
            return Err("the corner has more than one line".to_owned());
        }
        self.displacement[2 * corner] = number(&record[3])?;
        self.displacement[2 * corner + 1] = number(&record[4])?;
        let electrode = &record[5];
        match (x < columns && y < rows, electrode.is_empty()) {
            (true, true) => Err("`electrode` is empty, but there is a cell to the upper right".to_owned()),
            (false, false) => Err("`electrode` is given, but there is no cell to the upper right".to_owned()),
            (false, true) => Ok(()),
            (true, false) => {
                self.cells[y * columns + x] = number(electrode)?;
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
