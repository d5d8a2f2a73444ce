//! Reads patterns from images in PNG, JPEG, TIFF and BMP: dark pixels are electrodes, as in the figures of the source
//! paper; the top row is the upper edge. If all visible pixels have one colour, the opaque ones are electrodes.
//!
//! An image with a pixel, or a block of equal pixels, per cell is read exactly. In any other image of one group a cell
//! is an electrode if at least half of it is dark, and a note compares the area of the cells with that of the picture.
//! The sides of an image have the ratio of the numbers of cells or, with square pixels, that of the membrane; in both
//! cases the image covers the membrane.
//! With several electrode groups, the index in a palette is the number of the group; without a palette, group g of n
//! has the grey level (g − 1)/n from black to white, so there is no coverage.

mod format;
mod others;
mod png;
#[cfg(test)]
mod tests;

use std::path::Path;

pub use format::PictureFormat;

use super::coverage::Coverage;
use super::file::{FilePatterns, PatternFileError, bytes};
use super::raster::{Pattern, PatternForm, Raster};
use deaflow_base::four_digits;

/// Largest number of pixels along the side of a cell of several groups.
const LARGEST_BLOCK: usize = 64;

/// Largest number of pixels of an image; decoded, it takes at most 200 MB, whatever its header claims.
const MOST_PIXELS: usize = 3200 * 3200;

const MAX_BYTES: u64 = 64 << 20;

/// The usual share of a cell that makes it an electrode, and the brightness between dark and light.
pub(super) const HALF: f64 = 0.5;

/// What becomes of an image that does not show the cells one by one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Greys {
    /// It is read by coverage.
    Covered,
    /// It is refused.
    Refused,
}

fn allowed(form: PatternForm) -> String {
    let ([columns, rows], groups) = (form.raster.sides(), form.groups);
    let of_membrane = match form.cell_ratio() {
        1.0 => String::new(),
        ratio => format!(
            " or that of the membrane, {}",
            four_digits(columns as f64 / (rows as f64 * ratio))
        ),
    };
    if groups == 1 {
        return format!(
            "allowed: {columns} × {rows} pixels, or more or fewer with the same ratio of width and height{of_membrane}, \
             up to {MOST_PIXELS} in all; dark = electrode, light = bare"
        );
    }
    let level = |group: usize| format!("group {group} = {:.0} %", 100.0 * (group - 1) as f64 / groups as f64);
    let levels: Vec<String> = (1..=groups).map(level).collect();
    format!(
        "allowed: {columns} × {rows} pixels, or whole numbers of equal pixels per cell (to {LARGEST_BLOCK} along a side) \
         with the same ratio of width and height{of_membrane}; the number of the group as palette index, or as \
         brightness: {}, bare = 100 %; no smoothing when scaling",
        levels.join(", ")
    )
}

/// Returns the numbers of columns and rows of an image with one pixel per cell.
pub(super) fn sides(path: &Path, format: PictureFormat) -> Result<[usize; 2], PatternFileError> {
    let bytes = bytes(path, MAX_BYTES)?;
    format.check(&bytes)?;
    match format {
        PictureFormat::Png => png::sides(&bytes),
        other => others::sides(&bytes, other),
    }
}

/// Reads the pattern of an image. In one that is read by coverage, a cell is an electrode from this dark share on.
pub(super) fn read(
    path: &Path,
    format: PictureFormat,
    form: PatternForm,
    greys: Greys,
    threshold: f64,
) -> Result<FilePatterns, PatternFileError> {
    let image = Image::decode(&bytes(path, MAX_BYTES)?, format, form)?;
    let mut notes = image.notes();
    let is_covered = form.groups == 1 && greys == Greys::Covered && image.has_ratio_of(form);
    let exact = match threshold == HALF || !is_covered {
        true => Some(image.exact(form)),
        false => None,
    };
    let pattern = match exact {
        None | Some(Err(_)) if is_covered => {
            let (pattern, dark) = image.covered(form.raster, threshold);
            let percent = |share: f64| format!("{:.1} %", 100.0 * share);
            let [darkest, lightest] = image.extremes();
            let levels = match (darkest, lightest) {
                (0.0, 1.0) => String::new(),
                _ => format!(
                    " (brightness {} is dark, {} light)",
                    percent(darkest),
                    percent(lightest)
                ),
            };
            let least = if threshold == HALF {
                "half".to_owned()
            } else {
                percent(threshold)
            };
            notes.push(format!(
                "{} × {} pixels read by coverage: electrode where at least {least} of a cell is dark{levels}; area of \
                 the picture {}, of the cells {}",
                image.sides[0],
                image.sides[1],
                percent(dark),
                percent(pattern.area_fraction(None))
            ));
            pattern
        }
        exact => exact
            .unwrap_or_else(|| image.exact(form))
            .map_err(|refusal| refusal.help(allowed(form)))?,
    };
    let mut read = FilePatterns::new(vec![pattern]);
    read.notes.extend(notes);
    Ok(read)
}

/// Reads the share of each cell that an image of one electrode group covers: black covers, white does not, and a grey
/// in between covers in part.
pub(super) fn read_shares(
    path: &Path,
    format: PictureFormat,
    form: PatternForm,
) -> Result<FilePatterns, PatternFileError> {
    if form.groups != 1 {
        return Err(
            PatternFileError::new("a grey level is the number of an electrode group where there are several")
                .help("allowed with edges by coverage: pictures for scenes of one group; draw groups in .dxf or .svg"),
        );
    }
    let image = Image::decode(&bytes(path, MAX_BYTES)?, format, form)?;
    if !image.has_ratio_of(form) {
        let [width, height] = image.sides;
        return Err(PatternFileError::new(format!("the image has {width} × {height} pixels")).help(allowed(form)));
    }
    let shares = image.shares(form.raster, [0.0, 1.0]);
    // Sums of parts of pixels are rounded.
    let shares: Vec<f64> = shares.into_iter().map(|share| share.clamp(0.0, 1.0)).collect();
    let groups: Vec<u8> = shares.iter().map(|share| u8::from(*share > 0.0)).collect();
    let coverage =
        Coverage::new(form.raster, &groups, &shares).map_err(|error| PatternFileError::new(error.to_string()))?;
    let mut read = FilePatterns::new(vec![Pattern::of_coverage(coverage)]);
    read.notes.extend(image.notes());
    Ok(read)
}

/// The note that the shape is in the transparency alone.
const OF_TRANSPARENCY: &str = "shape taken from the transparency: opaque = electrode";

/// A decoded image.
struct Image {
    /// Pixels along x and y.
    sides: [usize; 2],
    /// The pixels, row by row from the top.
    pixels: Vec<Pixel>,
    /// Whether the shape is in the transparency alone.
    is_transparency: bool,
    /// Whether it was turned or mirrored as its camera or scanner noted.
    is_turned: bool,
}

impl Image {
    /// Decodes an image. Its size is checked before pixels are.
    fn decode(bytes: &[u8], format: PictureFormat, form: PatternForm) -> Result<Self, PatternFileError> {
        format.check(bytes)?;
        let check = |[width, height]: [usize; 2]| match width.saturating_mul(height) > MOST_PIXELS {
            true => Err(PatternFileError::new(format!("the image has {width} × {height} pixels")).help(allowed(form))),
            false => Ok(()),
        };
        let with_indices = form.groups > 1;
        match format {
            PictureFormat::Png => png::decode(bytes, with_indices, &check),
            other => others::decode(bytes, other, with_indices, &check),
        }
    }

    /// Creates an image of samples of 8 bits, row by row from the top, for each pixel: a grey, a grey and an opacity,
    /// red, green and blue, or these and an opacity.
    fn of_samples(sides: [usize; 2], samples: &[u8], channels: usize) -> Self {
        let levels = samples
            .chunks_exact(channels)
            .map(|pixel| (luma(pixel), opacity(pixel)));
        let mut visible = levels.clone().filter(|(_, opacity)| *opacity > 0.0);
        let first = visible.next().map_or(0.0, |(level, _)| level);
        let has_one_colour = visible.all(|(level, _)| level == first);
        let is_opaque = levels.clone().all(|(_, opacity)| opacity == 1.0);
        // Black shapes look the same on white.
        let is_transparency = has_one_colour && !is_opaque && first > 0.0;
        let grey = |(level, opacity): (f64, f64)| match is_transparency {
            true => Pixel::Grey(1.0 - opacity),
            false => Pixel::Grey(opacity * level + 1.0 - opacity),
        };
        Self {
            sides,
            pixels: levels.map(grey).collect(),
            is_transparency,
            is_turned: false,
        }
    }

    /// Returns what a user should know of how it was read.
    fn notes(&self) -> Vec<String> {
        let told = [
            (self.is_transparency, OF_TRANSPARENCY),
            (self.is_turned, "turned as the orientation in the file says"),
        ];
        let told = told.into_iter().filter(|(is_so, _)| *is_so);
        told.map(|(_, note)| note.to_owned()).collect()
    }

    /// Returns the pattern of an image with a pixel, or a block of equal pixels, per cell.
    fn exact(&self, form: PatternForm) -> Result<Pattern, PatternFileError> {
        let ([_, rows], [width, height]) = (form.raster.sides(), self.sides);
        let most = if form.groups == 1 { usize::MAX } else { LARGEST_BLOCK };
        let block = self.block(form).filter(|block| block.iter().all(|side| *side <= most));
        let [across, up] =
            block.ok_or_else(|| PatternFileError::new(format!("the image has {width} × {height} pixels")))?;
        let groups = self
            .pixels
            .iter()
            .enumerate()
            .map(|(at, pixel)| {
                let undecided = || undecided([at % width, at / width], *pixel, form.groups);
                pixel.group(form.groups).ok_or_else(undecided)
            })
            .collect::<Result<Vec<u8>, _>>()?;
        // Image rows run downwards, patterns upwards.
        let cell = |x: usize, y: usize| groups[(rows - 1 - y) * up * width + x * across];
        let of_cell = |at: usize| cell(at % width / across, rows - 1 - at / width / up);
        if let Some(at) = (0..groups.len()).find(|&at| groups[at] != of_cell(at)) {
            return Err(PatternFileError::new(format!(
                "pixel (column {}, row {} from the top) differs from others of its {across} × {up} block",
                at % width,
                at / width
            )));
        }
        Ok(Pattern::from_groups(form.raster, cell))
    }

    /// Returns the pixels along the sides of a cell if they are whole: equal numbers, or those of square pixels, each
    /// rounded.
    fn block(&self, form: PatternForm) -> Option<[usize; 2]> {
        let ([columns, rows], [width, height]) = (form.raster.sides(), self.sides);
        let [across, up] = [width / columns, height / rows];
        // The pixels per width of a cell that are rounded to a number.
        let rounded = |pixels: usize, side: f64| {
            let least = if pixels == 1 { 0.0 } else { pixels as f64 - 0.5 };
            [least / side, (pixels as f64 + 0.5) / side]
        };
        let ([low, high], [least, most]) = (rounded(across, 1.0), rounded(up, form.cell_ratio()));
        let is_whole = [across * columns, up * rows] == self.sides && across > 0 && up > 0;
        let has_ratio = across == up || low.max(least) < high.min(most);
        (is_whole && has_ratio).then_some([across, up])
    }

    /// Whether the sides have the ratio of the numbers of cells or that of the membrane, to a pixel, or to one for each
    /// cell.
    fn has_ratio_of(&self, form: PatternForm) -> bool {
        let ([columns, rows], [width, height]) = (form.raster.sides(), self.sides);
        let has_ratio = |cell: f64| {
            let (columns, rows) = (columns as f64, rows as f64 * cell);
            (width as f64 * rows - height as f64 * columns).abs() <= columns.max(rows)
        };
        has_ratio(1.0) || has_ratio(form.cell_ratio()) || self.block(form).is_some()
    }

    /// Returns the brightness of what is dark and of what is light: the extremes, if they are on both sides of the
    /// middle; else black and white.
    fn extremes(&self) -> [f64; 2] {
        let [darkest, lightest] = self.pixels.iter().fold([1.0, 0.0], |[low, high], pixel| match pixel {
            Pixel::Grey(level) => [f64::min(low, *level), f64::max(high, *level)],
            Pixel::Index(_) => [low, high],
        });
        match darkest < HALF && HALF < lightest {
            true => [darkest, lightest],
            false => [0.0, 1.0],
        }
    }

    /// Returns the pattern of the cells that are dark from a share on, and the dark share of the image.
    fn covered(&self, raster: Raster, threshold: f64) -> (Pattern, f64) {
        let columns = raster.columns();
        let shares = self.shares(raster, self.extremes());
        let pattern = Pattern::from_fn(raster, |x, y| shares[y * columns + x] >= threshold);
        (pattern, shares.iter().sum::<f64>() / shares.len() as f64)
    }

    /// Returns the dark share of each cell, row by row from below, with the brightness of what is dark and of what is
    /// light.
    fn shares(&self, raster: Raster, [darkest, lightest]: [f64; 2]) -> Vec<f64> {
        let ([columns, rows], [width, height]) = (raster.sides(), self.sides);
        let dark = |x: usize, y: usize| match self.pixels[y * width + x] {
            Pixel::Grey(level) => (lightest - level) / (lightest - darkest),
            Pixel::Index(_) => 0.0,
        };
        let share = |x: usize, y: usize| {
            let (across, down) = (parts(x, columns, width), parts(rows - 1 - y, rows, height));
            let of_row = |row: usize| across.iter().map(|&(x, part)| part * dark(x, row)).sum::<f64>();
            down.iter().map(|&(row, part)| part * of_row(row)).sum::<f64>()
        };
        (0..raster.cells())
            .map(|at| share(at % columns, at / columns))
            .collect()
    }
}

/// Returns the pixels that cell `at` of `cells` covers, of `pixels` in all, each with its share of the cell.
pub(super) fn parts(at: usize, cells: usize, pixels: usize) -> Vec<(usize, f64)> {
    // In units of 1/cells of a pixel, so that sums are exact.
    let (start, end) = (at * pixels, (at + 1) * pixels);
    let part = |pixel: usize| {
        let within = end.min((pixel + 1) * cells) - start.max(pixel * cells);
        (pixel, within as f64 / pixels as f64)
    };
    (start / cells..end.div_ceil(cells)).map(part).collect()
}

/// The value of a pixel.
#[derive(Clone, Copy)]
enum Pixel {
    /// A grey level, 0 (black) to 1 (white).
    Grey(f64),
    /// An index into a palette.
    Index(u8),
}

impl Pixel {
    /// Returns the electrode group of a pixel, 0 for bare; `None` if the value is ambiguous.
    fn group(self, groups: usize) -> Option<u8> {
        match self {
            Self::Index(index) => (usize::from(index) <= groups).then_some(index),
            Self::Grey(level) => {
                let step = level * groups as f64;
                let is_plain = (step - step.round()).abs() < 0.25;
                let group = if step.round() as usize == groups {
                    0
                } else {
                    step.round() as u8 + 1
                };
                is_plain.then_some(group)
            }
        }
    }
}

fn undecided([column, row]: [usize; 2], pixel: Pixel, groups: usize) -> PatternFileError {
    let found = match pixel {
        Pixel::Grey(grey) if groups == 1 => {
            format!(
                "neither dark nor light: its brightness is {:.0} % (black 0 %, white 100 %)",
                100.0 * grey
            )
        }
        Pixel::Grey(grey) => format!(
            "not the colour of an electrode group: its brightness is {:.0} % (black 0 %, white 100 %)",
            100.0 * grey
        ),
        Pixel::Index(index) => format!("colour {index} of the palette, which is not an electrode group"),
    };
    PatternFileError::new(format!("pixel (column {column}, row {row} from the top) is {found}"))
}

/// Returns the luma after Rec. ITU-R BT.601, 0 to 1.
fn luma(pixel: &[u8]) -> f64 {
    let unit = |sample: u8| f64::from(sample) / 255.0;
    match *pixel {
        [red, green, blue] | [red, green, blue, _] => 0.299 * unit(red) + 0.587 * unit(green) + 0.114 * unit(blue),
        [grey, ..] => unit(grey),
        [] => 0.0,
    }
}

/// Returns the opacity, 0 to 1.
fn opacity(pixel: &[u8]) -> f64 {
    match *pixel {
        [_, alpha] | [_, _, _, alpha] => f64::from(alpha) / 255.0,
        _ => 1.0,
    }
}
