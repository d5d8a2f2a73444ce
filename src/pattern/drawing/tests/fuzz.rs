//! Damaged drawings are read or rejected.

use bolero::check;

use super::{DrawingFormat, DrawingOptions, read_text};

use crate::read::fuzz::mutate::Seeds;

const DXF: &[&str] = &[
    "0\nINSERT\n2\nB\n10\n0\n20\n0\n70\n90\n71\n90\n",
    "0\nSPLINE\n71\n3\n40\n0\n10\n1\n20\n1\n",
    "0\nPOLYLINE\n70\n1\n0\nVERTEX\n10\n1\n20\n2\n42\n1\n",
    "0\nELLIPSE\n10\n1\n20\n1\n11\n0\n21\n0\n40\n1\n",
    "-1e9",
    "1e-300",
    "\n0\nENDSEC\n0\nSECTION\n2\nBLOCKS\n0\nBLOCK\n2\nB\n",
];

const SVG: &[&str] = &[
    "<g transform='scale(0)'>",
    "<use href='#layer1'/>",
    " viewBox='0 0 0 1'",
    "a1 1 0 1 1 0 0",
    "1e308",
    "<style>*{fill:none}</style>",
    "%",
];

#[test]
fn damaged_drawings_are_read_or_rejected() {
    let dxf = [
        &include_bytes!("files/d2_ring_text.dxf")[..],
        include_bytes!("files/d3_slot_arcs_gaps.dxf"),
        include_bytes!("files/d4_bulge_inches.dxf"),
        b"0\nSECTION\n2\nENTITIES\n0\nSPLINE\n8\nE\n71\n2\n40\n0\n40\n0\n40\n0\n40\n1\n40\n1\n40\n1\n10\n0\n20\n0\n\
          10\n1\n20\n1\n10\n0\n20\n0\n0\nENDSEC\n",
    ];
    let svg = [
        &include_bytes!("files/s1_circle_rect.svg")[..],
        include_bytes!("files/s2_path_evenodd.svg"),
        include_bytes!("files/s3_transform_px.svg"),
    ];
    for (format, corpus, inputs, tokens) in [
        (DrawingFormat::Dxf, "dxf", dxf.map(<[u8]>::to_vec).to_vec(), DXF),
        (DrawingFormat::Svg, "svg", svg.map(<[u8]>::to_vec).to_vec(), SVG),
    ] {
        let seeds = Seeds::new(corpus, inputs, tokens);
        let options = DrawingOptions {
            unit_mm: Some(1.0),
            ..DrawingOptions::default()
        };
        for input in &seeds.inputs[..seeds.valid] {
            read_text(&String::from_utf8_lossy(input), format, &options).unwrap();
        }
        check!().with_iterations(400).for_each(|entropy: &[u8]| {
            let text = String::from_utf8_lossy(&seeds.mutated(entropy)).into_owned();
            match read_text(&text, format, &options) {
                Ok(groups) => {
                    let areas = groups.iter().map(|(_, drawing)| super::area(drawing));
                    assert!(areas.sum::<f64>().is_finite());
                }
                Err(error) => assert!(error.to_string().len() < 2000, "{error}"),
            }
        });
    }
}
