//! Gerber X2 (Ucamco, The Gerber Layer Format Specification): regions in mm, holes cleared.

use std::fmt::Write;

use super::{Drawing, Point, ascii};

/// Writes the electrode as regions: each shape dark, then its holes clear, so that shapes within holes are drawn after
/// them. Frame and bodies are left out, since everything in a Gerber file is manufactured.
#[must_use]
pub fn gerber(drawing: &Drawing) -> Vec<u8> {
    let mut text = String::new();
    for line in drawing.lines() {
        let _ = writeln!(text, "G04 {}*", comment(line));
    }
    let _ = write!(
        text,
        "%TF.GenerationSoftware,deaflow,deaflow,{}*%\n%TF.Part,Other,Electrode mask*%\n\
         %TF.FileFunction,Other,Electrode*%\n%TF.FilePolarity,Positive*%\n%FSLAX46Y46*%\n%MOMM*%\nG01*\n",
        env!("CARGO_PKG_VERSION")
    );
    for shape in drawing.layers.iter().flat_map(|layer| &layer.shapes) {
        let _ = writeln!(text, "%LPD*%");
        region(&mut text, &shape.outer);
        if !shape.holes.is_empty() {
            let _ = writeln!(text, "%LPC*%");
        }
        shape.holes.iter().for_each(|hole| region(&mut text, hole));
    }
    text.push_str("M02*\n");
    text.into_bytes()
}

/// Writes one contour, which must be closed.
fn region(text: &mut String, ring: &[Point]) {
    let _ = writeln!(text, "G36*");
    let words = std::iter::once("D02").chain(std::iter::repeat("D01"));
    for ([x, y], word) in ring.iter().chain(ring.first()).zip(words) {
        let _ = writeln!(text, "X{}Y{}{word}*", nanometres(*x), nanometres(*y));
    }
    let _ = writeln!(text, "G37*");
}

/// Converts mm to integers with six decimals.
fn nanometres(mm: f64) -> i64 {
    (mm * 1e6).round() as i64
}

/// Escapes the characters that end a command, and those outside of ASCII.
fn comment(text: &str) -> String {
    let escaped = |c: char| match u32::from(c) {
        code @ ..=0xffff => format!("\\u{code:04X}"),
        code => format!("\\U{code:08X}"),
    };
    ascii(text, escaped)
        .replace('*', &escaped('*'))
        .replace('%', &escaped('%'))
}
