//! DXF of AutoCAD 2000 (AC1015), the oldest version that has a unit: closed LWPOLYLINEs in mm.
//!
//! Tables, blocks and objects are the minimum of the format (Autodesk, DXF Reference).

use std::fmt::Display;

use super::{Drawing, Point, ascii, number, rings};

const FRAME: &str = "FRAME";
const BODIES: &str = "BODIES";

/// Handles of the symbol tables, and of the objects that they refer to.
const BLOCK_RECORDS: &str = "9";
const MODEL_SPACE: &str = "1F";
const PAPER_SPACE: &str = "1B";
const ROOT: &str = "C";
const GROUPS: &str = "D";
/// Handles of entities start here.
const FIRST_HANDLE: usize = 0x100;

/// Writes a drawing. Each ring of the electrode is on layer ELECTRODE, or ELECTRODE_1 and so on for its groups, outer
/// rings anticlockwise and holes clockwise; the membrane and its opening are on layer FRAME, and rigid bodies on
/// BODIES.
#[must_use]
pub fn dxf(drawing: &Drawing) -> Vec<u8> {
    let mut file = DxfWriter { text: String::new() };
    for line in drawing.lines() {
        file.pair(999, text(line));
    }
    let names: Vec<String> = drawing
        .layers
        .iter()
        .map(|layer| layer.name("_").to_uppercase())
        .collect();
    let [width, height] = drawing.size;
    let frame = vec![[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
    let electrodes = drawing.layers.iter().zip(&names);
    let lines: Vec<(&str, &Vec<Point>)> = electrodes
        .flat_map(|(layer, name)| layer.rings().map(|ring| (name.as_str(), ring)))
        .chain([(FRAME, &frame)])
        .chain(rings(&drawing.opening).map(|ring| (FRAME, ring)))
        .chain(rings(&drawing.bodies).map(|ring| (BODIES, ring)))
        .collect();
    header(&mut file, drawing.size, FIRST_HANDLE + lines.len());
    tables(&mut file, &names, !drawing.bodies.is_empty());
    blocks(&mut file);
    file.section("ENTITIES");
    for (at, (layer, ring)) in lines.into_iter().enumerate() {
        polyline(&mut file, FIRST_HANDLE + at, layer, ring);
    }
    file.pair(0, "ENDSEC");
    objects(&mut file);
    file.pair(0, "EOF");
    file.text.into_bytes()
}

/// An entry of a symbol table: name, handle, subclass, and its other pairs.
type TableEntry<'a> = (&'a str, &'a str, &'a str, &'a [(u16, &'a str)]);

/// Writes pairs of group codes and values, one on each line.
struct DxfWriter {
    text: String,
}

impl DxfWriter {
    fn pair(&mut self, code: u16, value: impl Display) {
        self.text.push_str(&format!("{code:>3}\n{value}\n"));
    }

    fn pairs<'a>(&mut self, pairs: impl IntoIterator<Item = (u16, &'a str)>) {
        for (code, value) in pairs {
            self.pair(code, value);
        }
    }

    fn section(&mut self, name: &str) {
        self.pairs([(0, "SECTION"), (2, name)]);
    }

    /// Writes a symbol table with its entries.
    fn table(&mut self, kind: &str, handle: &str, records: &[TableEntry<'_>]) {
        self.pairs([
            (0, "TABLE"),
            (2, kind),
            (5, handle),
            (330, "0"),
            (100, "AcDbSymbolTable"),
        ]);
        self.pair(70, records.len());
        if kind == "DIMSTYLE" {
            self.pair(100, "AcDbDimStyleTable");
        }
        for (name, own, subclass, rest) in records {
            let code = if kind == "DIMSTYLE" { 105 } else { 5 };
            self.pairs([(0, kind), (code, own), (330, handle), (100, "AcDbSymbolTableRecord")]);
            self.pairs([(100, *subclass), (2, name)]);
            self.pairs(rest.iter().copied());
        }
        self.pair(0, "ENDTAB");
    }
}

fn header(file: &mut DxfWriter, size: [f64; 2], next_handle: usize) {
    file.section("HEADER");
    file.pairs([(9, "$ACADVER"), (1, "AC1015"), (9, "$DWGCODEPAGE"), (3, "ANSI_1252")]);
    file.pair(9, "$HANDSEED");
    file.pair(5, format!("{next_handle:X}"));
    // Millimetres; the metric system.
    file.pairs([(9, "$INSUNITS"), (70, "4"), (9, "$MEASUREMENT"), (70, "1")]);
    for (name, corner) in [("$EXTMIN", [0.0; 2]), ("$EXTMAX", size)] {
        let [x, y] = corner.map(number);
        file.pairs([(9, name), (10, &x), (20, &y), (30, "0")]);
    }
    for (name, corner) in [("$LIMMIN", [0.0; 2]), ("$LIMMAX", size)] {
        let [x, y] = corner.map(number);
        file.pairs([(9, name), (10, &x), (20, &y)]);
    }
    file.pair(0, "ENDSEC");
}

fn tables(file: &mut DxfWriter, electrodes: &[String], has_bodies: bool) {
    const LINE: &[(u16, &str)] = &[(70, "0"), (3, ""), (72, "65"), (73, "0"), (40, "0")];
    const LAYER: &str = "AcDbLayerTableRecord";
    const LINETYPE: &str = "AcDbLinetypeTableRecord";
    file.section("TABLES");
    file.table("VPORT", "8", &[]);
    file.table(
        "LTYPE",
        "5",
        &[
            ("ByBlock", "14", LINETYPE, LINE),
            ("ByLayer", "15", LINETYPE, LINE),
            ("Continuous", "16", LINETYPE, LINE),
        ],
    );
    let layer = |colour| [(70, "0"), (62, colour), (6, "Continuous")];
    // The first electrode has handle 11 and the frame 12, further layers those from 40 on; colours start at index 1,
    // red.
    let (default, frame) = (layer("7"), layer("8"));
    let colours: Vec<String> = (0..electrodes.len())
        .map(|at| if at == 0 { 7 } else { at }.to_string())
        .collect();
    let own: Vec<_> = colours.iter().map(|colour| layer(colour)).collect();
    let handles: Vec<String> = (0..=electrodes.len()).map(|at| format!("{:X}", 0x40 + at)).collect();
    let handle = |at: usize| if at == 0 { "11" } else { handles[at].as_str() };
    let mut layers: Vec<TableEntry<'_>> = vec![("0", "10", LAYER, &default)];
    layers.extend(
        electrodes
            .iter()
            .enumerate()
            .map(|(at, name)| -> TableEntry<'_> { (name, handle(at), LAYER, &own[at]) }),
    );
    layers.push((FRAME, "12", LAYER, &frame));
    if has_bodies {
        layers.push((BODIES, &handles[electrodes.len()], LAYER, &frame));
    }
    file.table("LAYER", "2", &layers);
    let style = [
        (70, "0"),
        (40, "0"),
        (41, "1"),
        (50, "0"),
        (71, "0"),
        (42, "2.5"),
        (3, "txt"),
        (4, ""),
    ];
    file.table("STYLE", "3", &[("Standard", "17", "AcDbTextStyleTableRecord", &style)]);
    file.table("VIEW", "6", &[]);
    file.table("UCS", "7", &[]);
    file.table("APPID", "4", &[("ACAD", "18", "AcDbRegAppTableRecord", &[(70, "0")])]);
    file.table(
        "DIMSTYLE",
        "A",
        &[("Standard", "19", "AcDbDimStyleTableRecord", &[(70, "0")])],
    );
    let record = "AcDbBlockTableRecord";
    file.table(
        "BLOCK_RECORD",
        BLOCK_RECORDS,
        &[
            ("*Model_Space", MODEL_SPACE, record, &[]),
            ("*Paper_Space", PAPER_SPACE, record, &[]),
        ],
    );
    file.pair(0, "ENDSEC");
}

fn blocks(file: &mut DxfWriter) {
    file.section("BLOCKS");
    for (name, record, begin, end) in [
        ("*Model_Space", MODEL_SPACE, "20", "21"),
        ("*Paper_Space", PAPER_SPACE, "1C", "1D"),
    ] {
        file.pairs([(0, "BLOCK"), (5, begin), (330, record), (100, "AcDbEntity"), (8, "0")]);
        file.pairs([(100, "AcDbBlockBegin"), (2, name), (70, "0")]);
        file.pairs([(10, "0"), (20, "0"), (30, "0"), (3, name), (1, "")]);
        file.pairs([(0, "ENDBLK"), (5, end), (330, record), (100, "AcDbEntity"), (8, "0")]);
        file.pair(100, "AcDbBlockEnd");
    }
    file.pair(0, "ENDSEC");
}

fn polyline(file: &mut DxfWriter, handle: usize, layer: &str, ring: &[Point]) {
    file.pair(0, "LWPOLYLINE");
    file.pair(5, format!("{handle:X}"));
    file.pairs([
        (330, MODEL_SPACE),
        (100, "AcDbEntity"),
        (8, layer),
        (100, "AcDbPolyline"),
    ]);
    file.pair(90, ring.len());
    // Closed.
    file.pair(70, 1);
    for [x, y] in ring {
        file.pair(10, number(*x));
        file.pair(20, number(*y));
    }
}

fn objects(file: &mut DxfWriter) {
    file.section("OBJECTS");
    file.pairs([
        (0, "DICTIONARY"),
        (5, ROOT),
        (330, "0"),
        (100, "AcDbDictionary"),
        (281, "1"),
    ]);
    file.pairs([(3, "ACAD_GROUP"), (350, GROUPS)]);
    file.pairs([
        (0, "DICTIONARY"),
        (5, GROUPS),
        (330, ROOT),
        (100, "AcDbDictionary"),
        (281, "1"),
    ]);
    file.pair(0, "ENDSEC");
}

/// Escapes characters outside of ASCII as AutoCAD does.
fn text(line: &str) -> String {
    ascii(line, |c| format!("\\U+{:04X}", u32::from(c)))
}
