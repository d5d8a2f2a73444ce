use super::*;

/// A square with a hole, and a square in the hole.
fn drawing() -> Drawing {
    let ring = |low: f64, high: f64| vec![[low, low], [high, low], [high, high], [low, high]];
    let clockwise = |low, high| ring(low, high).into_iter().rev().collect();
    Drawing {
        title: "ü <*%>".to_owned(),
        notes: vec!["a & b\nc".to_owned()],
        source: "artifact 12 & 3".to_owned(),
        program: "deaflow 1".to_owned(),
        size: [10.0, 12.5],
        layers: vec![Layer {
            group: None,
            shapes: vec![
                Shape {
                    outer: ring(1.0, 9.0),
                    holes: vec![clockwise(2.0, 8.0)],
                },
                Shape {
                    outer: ring(4.0, 5.0 + 1.0 / 3.0),
                    holes: Vec::new(),
                },
            ],
        }],
        opening: Vec::new(),
        bodies: Vec::new(),
    }
}

fn text(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).unwrap()
}

#[test]
fn lengths_have_no_trailing_zeros() {
    let written = [0.0, -1e-9, 50.0, 16.0 + 2.0 / 3.0, 0.125].map(number);
    assert_eq!(written, ["0", "0", "50", "16.666667", "0.125"]);
}

#[test]
fn an_svg_points_upwards_and_names_survive() {
    let svg = text(svg(&drawing()));
    assert!(svg.contains("<title>ü &lt;*%&gt;</title>") && svg.contains("<desc>a &amp; b\nc</desc>"));
    assert!(svg.contains("<dc:source>artifact 12 &amp; 3</dc:source><dc:creator>deaflow 1</dc:creator>"));
    assert!(
        svg.contains("M1,11.5 L9,11.5 L9,3.5 L1,3.5 Z M2,4.5 L8,4.5 L8,10.5 L2,10.5 Z"),
        "{svg}"
    );
}

#[test]
fn a_gerber_file_clears_a_hole_before_it_draws_what_is_in_it() {
    let gerber = text(gerber(&drawing()));
    let polarities: Vec<&str> = gerber.lines().filter(|line| line.starts_with("%LP")).collect();
    assert_eq!(polarities, ["%LPD*%", "%LPC*%", "%LPD*%"]);
    assert!(
        gerber.starts_with("G04 \\u00FC <\\u002A\\u0025>*\nG04 a & b c*\n"),
        "{gerber}"
    );
    assert!(gerber.contains("G36*\nX4000000Y4000000D02*\nX5333333Y4000000D01*\n"));
    assert!(gerber.ends_with("X4000000Y4000000D01*\nG37*\nM02*\n"));
}

#[test]
fn a_dxf_file_says_mm_and_has_a_line_for_every_code() {
    let dxf = text(dxf(&drawing()));
    assert!(dxf.starts_with("999\n\\U+00FC <*%>\n999\na & b c\n"), "{dxf}");
    assert!(dxf.contains("  9\n$INSUNITS\n 70\n4\n"));
    let lines: Vec<&str> = dxf.lines().collect();
    assert_eq!(lines.len() % 2, 0);
    assert!(lines.iter().step_by(2).all(|code| code.trim().parse::<u16>().is_ok()));
    assert_eq!(lines.iter().filter(|line| **line == "LWPOLYLINE").count(), 4);
    assert!(dxf.contains("$EXTMAX\n 10\n10\n 20\n12.5\n"));
}

#[test]
fn a_png_is_black_where_the_electrode_is() {
    let bytes = png(&drawing(), [30, 50]).unwrap();
    let mut reader = ::png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
    let dimensions = reader.info().pixel_dims.unwrap();
    assert_eq!(
        (dimensions.xppu, dimensions.yppu, dimensions.unit),
        (3000, 4000, ::png::Unit::Meter)
    );
    let mut image = vec![0; reader.output_buffer_size()];
    reader.next_frame(&mut image).unwrap();
    let black = |x: usize, y: usize| image[(49 - y) * 4 + x / 8] >> (7 - x % 8) & 1 == 0;
    let count = (0..1500).filter(|at| black(at % 30, at / 30)).count();
    // 24 · 32 − 18 · 24 + 4 · 5 pixels: of the inner square, 16 to 21⅓ along y, five centres.
    assert_eq!(count, 768 - 432 + 20);
    assert!(black(3, 4) && black(26, 35) && !black(2, 4) && !black(27, 35) && black(12, 20) && !black(16, 20));
}

#[test]
fn a_csv_begins_at_the_lower_edge() {
    let csv = text(csv(["a\nb"], &[1, 0, 0, 0], 2));
    assert!(
        csv.starts_with("# a b\n#") && csv.ends_with("bare\n1,0\n0,0\n"),
        "{csv}"
    );
}

/// Two groups side by side, in an opening with a body.
fn groups() -> Drawing {
    let square = |x: f64, y: f64| Shape {
        outer: vec![[x, y], [x + 2.0, y], [x + 2.0, y + 2.0], [x, y + 2.0]],
        holes: Vec::new(),
    };
    let layer = |group: usize, shape: Shape| Layer {
        group: Some(group),
        shapes: vec![shape],
    };
    Drawing {
        size: [10.0, 10.0],
        layers: vec![layer(1, square(1.0, 1.0)), layer(2, square(4.0, 1.0))],
        opening: vec![square(0.5, 0.5)],
        bodies: vec![square(6.0, 6.0), square(7.0, 2.0)],
        ..drawing()
    }
}

#[test]
fn each_group_has_a_layer_and_frames_and_bodies_have_theirs() {
    let dxf = text(dxf(&groups()));
    for (layer, rings) in [
        ("ELECTRODE_1", 1),
        ("ELECTRODE_2", 1),
        ("FRAME", 2),
        ("BODIES", 2),
        ("ELECTRODE", 0),
    ] {
        assert_eq!(
            dxf.matches(&format!("AcDbEntity\n  8\n{layer}\n")).count(),
            rings,
            "{layer}"
        );
        let declared = usize::from(rings > 0);
        assert_eq!(
            dxf.matches(&format!("AcDbLayerTableRecord\n  2\n{layer}\n")).count(),
            declared,
            "{layer}"
        );
    }
    let svg = text(svg(&groups()));
    for id in ["electrode-1", "electrode-2", "frame", "opening", "bodies"] {
        assert_eq!(svg.matches(&format!("id=\"{id}\"")).count(), 1, "{id}");
    }
    let bytes = png(&groups(), [10, 10]).unwrap();
    let mut reader = ::png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
    let mut image = vec![0; reader.output_buffer_size()];
    reader.next_frame(&mut image).unwrap();
    let at = |x: usize, y: usize| image[(9 - y) * 10 + x];
    assert_eq!(
        [at(1, 1), at(2, 2), at(4, 1), at(5, 2), at(3, 1), at(7, 7)],
        [0, 0, 128, 128, 255, 255]
    );
}
