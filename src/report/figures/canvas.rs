//! The sheet that figures are drawn on, and how it becomes a file.
//!
//! Glyphs are compiled in, so a figure needs no font of the system and has the same bytes everywhere. Plotters does not
//! smooth the edges of polygons: sheets are drawn three times as large and averaged down.

use std::error::Error;
use std::io::Write;
use std::path::Path;
use std::sync::OnceLock;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

/// Subpixels along one side of a pixel.
const FINE: u32 = 3;

const FONT: &str = "figure";

/// Colours that are told apart with any kind of colour vision: Okabe and Ito, "Color Universal Design" (2008).
pub(super) mod palette {
    use plotters::style::RGBColor;

    pub(in super::super) const BLUE: RGBColor = RGBColor(0, 114, 178);
    pub(in super::super) const ORANGE: RGBColor = RGBColor(230, 159, 0);
    pub(in super::super) const VERMILLION: RGBColor = RGBColor(213, 94, 0);
    pub(in super::super) const GREEN: RGBColor = RGBColor(0, 158, 115);
    pub(in super::super) const SKY: RGBColor = RGBColor(86, 180, 233);
    pub(in super::super) const PURPLE: RGBColor = RGBColor(204, 121, 167);
    pub(in super::super) const INK: RGBColor = RGBColor(30, 30, 30);
    pub(in super::super) const GREY: RGBColor = RGBColor(150, 150, 150);
    pub(in super::super) const PALE: RGBColor = RGBColor(225, 225, 225);
}

/// A part of a sheet.
pub(super) type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

/// A figure that could not be made.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The numbers do not make a figure.
    #[error("no figure can be drawn: {0}")]
    Data(String),
    /// The drawing library refused.
    #[error("the figure could not be drawn: {0}")]
    Draw(String),
    /// The file could not be written.
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
}

impl<E: Error + Send + Sync> From<DrawingAreaErrorKind<E>> for FigureError {
    fn from(error: DrawingAreaErrorKind<E>) -> Self {
        Self::Draw(error.to_string())
    }
}

/// A length of the finished figure, in subpixels.
pub(super) fn px(pixels: u32) -> u32 {
    pixels * FINE
}

/// Text of a height in pixels of the finished figure.
pub(super) fn text(pixels: u32, colour: RGBColor) -> TextStyle<'static> {
    (FONT, px(pixels)).into_font().color(&colour)
}

/// Draws a figure of the given size in pixels and puts it at `path`, where it appears complete or not at all.
pub(super) fn draw(
    path: &Path,
    (width, height): (u32, u32),
    content: impl FnOnce(&Area<'_>) -> Result<(), FigureError>,
) -> Result<(), FigureError> {
    static FONTS: OnceLock<bool> = OnceLock::new();
    let loaded =
        FONTS.get_or_init(|| register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT).is_ok());
    if !loaded {
        return Err(FigureError::Draw("the built-in font is not readable".into()));
    }
    let mut fine = vec![0; 3 * (px(width) * px(height)) as usize];
    {
        let root = BitMapBackend::with_buffer(&mut fine, (px(width), px(height))).into_drawing_area();
        root.fill(&WHITE)?;
        content(&root)?;
        root.present()?;
    }
    write(path, width, height, &averaged(&fine, width, height))
}

fn averaged(fine: &[u8], width: u32, height: u32) -> Vec<u8> {
    let (width, height, n) = (width as usize, height as usize, FINE as usize);
    let mut out = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for x in 0..width {
            for channel in 0..3 {
                let block = (0..n * n).map(|k| {
                    let (row, column) = (y * n + k / n, x * n + k % n);
                    u32::from(fine[3 * (row * width * n + column) + channel])
                });
                out.push((block.sum::<u32>() / (FINE * FINE)) as u8);
            }
        }
    }
    out
}

fn write(path: &Path, width: u32, height: u32, pixels: &[u8]) -> Result<(), FigureError> {
    let failed = |source: std::io::Error| FigureError::Write {
        path: path.display().to_string(),
        source,
    };
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(pixels))
        .map_err(|e| FigureError::Draw(e.to_string()))?;
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder).map_err(failed)?;
    file.write_all(&bytes).map_err(failed)?;
    // Temporary files are private to their owner; figures are for everybody who may read the folder.
    let readable = std::os::unix::fs::PermissionsExt::from_mode(0o644);
    file.as_file().set_permissions(readable).map_err(failed)?;
    file.persist(path).map_err(|e| failed(e.error))?;
    Ok(())
}
