//! Rasterises SVG. The font is compiled in, so that figures need no system font and have the same bytes everywhere.

use std::sync::{Arc, OnceLock};

use maud::{Markup, PreEscaped, html};
use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{self, Tree, fontdb};

use super::error::FigureError;
use deaflow_base::printable;

/// The style sheet of pages, which defines the colours.
pub const PAGE_STYLE: &str = include_str!("../html/page.css");
/// The style sheet of drawings, on pages and in figures.
pub const DRAWING_STYLE: &str = include_str!("../html/drawing.css");

/// Pixels of a figure for each pixel of a page, since figures are shown smaller than they are, or printed.
const SCALE: f64 = 5.0 / 3.0;

/// The signature of PNG, and the length of signature and first chunk.
const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
const HEADER: usize = 8 + 25;

/// Rasterises a drawing of a width and height on white as PNG.
pub fn png(size: [f64; 2], drawing: &Markup) -> Result<Vec<u8>, FigureError> {
    let failed = |e: &dyn std::fmt::Display| FigureError::Draw(e.to_string());
    let [width, height] = size.map(|length| (SCALE * length).round() as u32);
    let mut pixels = Pixmap::new(width, height).ok_or_else(|| failed(&"it is too large"))?;
    pixels.fill(Color::WHITE);
    let tree = Tree::from_str(&document(size, drawing), &options()).map_err(|e| failed(&e))?;
    resvg::render(
        &tree,
        Transform::from_scale(SCALE as f32, SCALE as f32),
        &mut pixels.as_mut(),
    );
    let mut colours = Vec::with_capacity(pixels.data().len() / 4 * 3);
    for pixel in pixels.data().chunks_exact(4) {
        colours.extend_from_slice(&pixel[..3]);
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    // Drawings have large areas of one colour, which are smallest without a filter.
    encoder.set_filter(png::FilterType::NoFilter);
    encoder.set_adaptive_filter(png::AdaptiveFilterType::NonAdaptive);
    encoder.set_compression(png::Compression::Best);
    let written = encoder
        .write_header()
        .and_then(|mut writer| writer.write_image_data(&colours));
    written.map_err(|e| failed(&e))?;
    Ok(bytes)
}

/// Adds texts with keywords to a PNG, as [PNG names them](https://www.w3.org/TR/png-3/#11keywords): `Title`, `Source`,
/// `Software`.
///
/// # Errors
/// If it is not a PNG, or a text is too long.
pub fn with_texts(image: &[u8], texts: &[(&str, String)]) -> Result<Vec<u8>, FigureError> {
    let wrong = || FigureError::Draw("the file is not a PNG".to_owned());
    // The header is the first chunk, and has a fixed length.
    let (header, rest) = image.split_at_checked(HEADER).ok_or_else(wrong)?;
    if !header.starts_with(SIGNATURE) || header[12..16] != *b"IHDR" {
        return Err(wrong());
    }
    let mut bytes = header.to_vec();
    for (keyword, text) in texts {
        // Uncompressed, without language and translation.
        let content = [&b"iTXt"[..], keyword.as_bytes(), &[0; 5], text.as_bytes()].concat();
        let length = u32::try_from(content.len() - 4).map_err(|e| FigureError::Draw(e.to_string()))?;
        let mut sum = flate2::Crc::new();
        sum.update(&content);
        bytes.extend(length.to_be_bytes());
        bytes.extend(&content);
        bytes.extend(sum.sum().to_be_bytes());
    }
    bytes.extend(rest);
    Ok(bytes)
}

/// Writes a drawing of a width and height as an SVG document with its colours, light and dark, for a page that shows it
/// as an image.
pub fn image(size: [f64; 2], drawing: &Markup) -> String {
    // The colours come first in the style of pages.
    let colours = PAGE_STYLE.split("* {").next().unwrap_or_default();
    let styled = html! { style { (PreEscaped(colours)) (PreEscaped(DRAWING_STYLE)) } (drawing) };
    document(size, &styled)
}

/// Writes the drawing as an SVG document.
fn document([width, height]: [f64; 2], drawing: &Markup) -> String {
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" width=(width) height=(height) viewBox={ "0 0 " (width) " " (height) } {
            (drawing)
        }
    };
    // XML does not allow control characters.
    printable(&svg.into_string()).into_owned()
}

fn options() -> usvg::Options<'static> {
    static FONTS: OnceLock<Arc<fontdb::Database>> = OnceLock::new();
    let fonts = FONTS.get_or_init(|| {
        let mut fonts = fontdb::Database::new();
        fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
        Arc::new(fonts)
    });
    let family = fonts.faces().next().and_then(|face| face.families.first());
    usvg::Options {
        font_family: family.map_or_else(String::new, |(name, _)| name.clone()),
        style_sheet: Some(plain_style(DRAWING_STYLE, PAGE_STYLE)),
        fontdb: Arc::clone(fonts),
        ..usvg::Options::default()
    }
}

/// Replaces the variables in the style of drawings by the colours of pages on white, which come first.
fn plain_style(drawings: &str, pages: &str) -> String {
    let mut style = drawings.to_owned();
    let first = pages.split('}').next().unwrap_or_default();
    for declaration in first.split(['{', ';']) {
        if let Some((name, value)) = declaration
            .split_once(':')
            .filter(|(name, _)| name.trim().starts_with("--"))
        {
            style = style.replace(&format!("var({})", name.trim()), value.trim());
        }
    }
    style
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_drawn() {
        let drawing = html! { text x="1" y="9" { "a\u{1b}[2J\u{7}\u{9b}\u{ffff}b" } };
        assert!(!document([20.0, 10.0], &drawing).contains('\u{1b}'));
        assert!(png([20.0, 10.0], &drawing).is_ok());
    }

    #[test]
    fn texts_are_added_and_no_pixel_changes() {
        let drawing = html! { rect x="2" y="3" width="5" height="4" fill="#0072b2" {} };
        let plain = png([20.0, 10.0], &drawing).unwrap();
        let texts = [("Title", "λ: a figure".to_owned()), ("Source", "ab12".to_owned())];
        let stamped = with_texts(&plain, &texts).unwrap();
        let read = |bytes: &[u8]| {
            let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
            let mut pixels = vec![0; reader.output_buffer_size()];
            reader.next_frame(&mut pixels).unwrap();
            let texts = reader.info().utf8_text.iter();
            let texts: Vec<_> = texts
                .map(|text| (text.keyword.clone(), text.get_text().unwrap()))
                .collect();
            (pixels, texts)
        };
        let (before, none) = read(&plain);
        let (after, found) = read(&stamped);
        assert!(before == after && none.is_empty());
        assert!(with_texts(b"no figure", &texts).is_err());
        assert_eq!(found, texts.map(|(keyword, text)| (keyword.to_owned(), text)));
    }

    #[test]
    fn every_colour_of_drawings_is_one_of_pages() {
        let style = plain_style(DRAWING_STYLE, PAGE_STYLE);
        assert!(style.contains("#0072b2") && !style.contains("var("), "{style}");
    }
}
