//! The shapes of a pattern: drawn in the pipeline, or read from drawings.

use std::path::Path;

use super::super::files::NamedFile;
use deaflow_base::{
    Angle, Canonical, Decimal, Declared, Fields, InputError, Length, Map, Node, Parameter, Schema, parameters,
};
use deaflow_pattern::{
    Bits, Contours, DrawingFormat, DrawingOptions, DrawingUnit, Edges, GroupRegion, Pattern, PatternFileError,
    PatternForm, Region, pattern_of, read_drawing, read_patterns_of,
};
use deaflow_scene::{Position, Shape, Shapes};

/// The key of a drawing.
const FILE: &str = "file";

/// The largest coordinate in mm at which the origin of a drawing may be placed.
const FARTHEST: f64 = 1e9;

/// The factors by which a drawing may be enlarged.
const SCALES: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

/// The largest distance in mm between ends that are joined.
const JOINS: std::ops::RangeInclusive<f64> = 1e-9..=10.0;

/// The dark shares that can make a cell an electrode.
const THRESHOLDS: std::ops::RangeInclusive<f64> = 1e-3..=1.0;

/// The largest number of a group.
const MOST_GROUPS: u64 = Pattern::MOST_GROUPS as u64;

/// A text, such as the name of a layer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Text(String);

impl Parameter for Text {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        node.text(key).map(|text| Self(text.to_owned()))
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(Canonical::from(self.0.as_str()))
    }

    fn schema((): &()) -> Schema {
        Schema::text()
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

parameters! {
    /// A shape with electrodes.
    struct DrawnShape as "a shape of a patterns stage" {
        /// The number of its electrode group.
        group: u64 [1..=MOST_GROUPS] = 1,
    }
    include {
        /// The shape.
        shape: Shape,
    }
}

parameters! {
    /// A drawing in DXF or SVG, or a picture of the membrane.
    struct DrawnFile as "a drawing of a patterns stage" {
        /// FILE.dxf, FILE.svg or FILE.png, relative to the pipeline's file.
        file: Text,
        /// Its electrode group; without it 1, or the groups of layers that are named ELECTRODE_1 and so on.
        group: Option<u64> [1..=MOST_GROUPS],
        /// The layer with the electrodes; without it layers named ELECTRODE, else the only one with curves in DXF, and
        /// all in SVG.
        layer: Option<Text>,
        /// The unit of its lengths; without it the unit that the file states.
        unit: Option<DrawingUnit>,
        /// Where the origin of the drawing lies on the membrane. That of SVG is the lower left corner of the page.
        origin: Option<Position> [-FARTHEST..=FARTHEST],
        /// The factor by which it is enlarged about its origin.
        scale: Option<Decimal> [SCALES],
        /// The angle by which it is turned about its origin, anticlockwise.
        angle: Option<Angle> [-360.0..=360.0],
        /// The largest distance between ends of curves that are joined; 1 um if it is not given.
        join: Option<Length> [JOINS],
        /// The dark share from which on a cell of a picture is an electrode; 0.5 if it is not given.
        threshold: Option<Decimal> [THRESHOLDS],
        /// What is left out of it: shapes.
        without: Option<Shapes>,
    }
    check(check_file)
}

/// Checks that drawings have no keys of pictures, and pictures none of drawings.
fn check_file(_: &DrawnFile, map: &Map<'_>) -> Result<(), InputError> {
    let name = map.required("a drawing of a patterns stage", FILE)?.text(FILE)?;
    let (keys, what): (&[&str], _) = match is_picture(Path::new(name)) {
        true => (
            &["layer", "unit", "origin", "scale", "angle", "join"],
            "a picture covers the membrane",
        ),
        false => (&["threshold"], "a drawing has no greys"),
    };
    match keys.iter().find_map(|key| Some((key, map.optional(key)?))) {
        Some((key, node)) => Err(node
            .error(format!("`{key}` cannot be used with {name}: {what}"))
            .help("remove it")),
        None => Ok(()),
    }
}

fn is_picture(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("png"))
}

/// A shape with electrodes, or a drawing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drawn(Source);

#[derive(Clone, Debug, PartialEq, Eq)]
enum Source {
    Shape(Box<DrawnShape>),
    File(Box<DrawnFile>),
}

impl Parameter for Drawn {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, _key: &str, (): &()) -> Result<Self, InputError> {
        match node.peek(FILE) {
            Some(_) => DrawnFile::read_with(node, &[]).map(|own| Self(Source::File(Box::new(own)))),
            None => DrawnShape::read_with(node, &[]).map(|own| Self(Source::Shape(Box::new(own)))),
        }
    }

    /// The pattern is in the key, not how it was drawn.
    fn canonical(&self) -> Option<Canonical> {
        None
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([DrawnFile::schema(&()), DrawnShape::schema(&())])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl DrawnFile {
    fn options(&self) -> DrawingOptions {
        let usual = DrawingOptions::default();
        DrawingOptions {
            layers: self.layer.iter().map(|layer| layer.0.clone()).collect(),
            unit_mm: self.unit.map(DrawingUnit::mm),
            origin_mm: self
                .origin
                .map_or(usual.origin_mm, |origin| origin.map(|at| at.value())),
            scale: self.scale.map_or(usual.scale, Decimal::to_f64),
            degrees: self.angle.map_or(usual.degrees, |angle| angle.value()),
            join_mm: self.join.map_or(usual.join_mm, |join| join.value()),
            threshold: self.threshold.map_or(usual.threshold, Decimal::to_f64),
            edges: usual.edges,
        }
    }

    /// Returns what is filled, with its group and notes.
    fn filled(&self, file: &NamedFile<'_>, form: PatternForm) -> Result<Vec<(usize, Region, Vec<String>)>, InputError> {
        let refused = |refusal: PatternFileError| file.refused(&refusal, &refusal.advice(form));
        match DrawingFormat::of(&file.path) {
            Some(format) => {
                let drawn = read_drawing(&file.path, format, &self.options()).map_err(refused)?;
                let region = |filled: Vec<Contours>| Region::Union(filled.into_iter().map(Region::Contours).collect());
                let each = drawn.into_iter();
                Ok(each
                    .map(|(group, own)| (group, region(own.filled), own.notes))
                    .collect())
            }
            None if is_picture(&file.path) => {
                let one_group = PatternForm { groups: 1, ..form };
                let read = read_patterns_of(&file.path, None, one_group, &self.options()).map_err(refused)?;
                let cells = read.patterns.iter().map(Bits::of).map(Region::Cells);
                Ok(cells.map(|cells| (1, cells, read.notes.clone())).collect())
            }
            None => Err(file.refused(&"not a drawing or a picture", "allowed: .dxf, .svg and .png")),
        }
    }

    /// Returns the regions of its groups, and notes.
    fn regions(&self, node: &Node, form: PatternForm) -> Result<(Vec<GroupRegion>, Vec<String>), InputError> {
        let folder = node.file().parent().unwrap_or(Path::new(""));
        let node = node.peek(FILE).unwrap_or(node);
        let file = NamedFile::find(node, folder)?;
        let (mut regions, mut notes) = (Vec::new(), Vec::new());
        for (group, filled, told) in self.filled(&file, form)? {
            let region = match &self.without {
                Some(others) => Region::Without(Box::new(filled), others.regions()),
                None => filled,
            };
            let group = self.group.map_or(group, |group| group as usize);
            regions.push(GroupRegion { group, region });
            notes.extend(told.iter().map(|note| format!("{}: {note}", file.name)));
        }
        Ok((regions, notes))
    }
}

/// Returns the pattern of shapes, and notes.
///
/// # Errors
/// When a drawing cannot be read, a shape does not reach the membrane, or groups overlap.
pub fn pattern(
    drawn: &[Drawn],
    node: &Node,
    form: PatternForm,
    edges: Edges,
) -> Result<(Pattern, Vec<String>), InputError> {
    let nodes = node.list("shapes")?;
    let (mut regions, mut notes) = (Vec::new(), Vec::new());
    for (Drawn(source), node) in drawn.iter().zip(nodes) {
        match source {
            Source::Shape(own) => regions.push(GroupRegion {
                group: own.group as usize,
                region: own.shape.region(),
            }),
            Source::File(file) => {
                let (of_file, told) = file.regions(node, form)?;
                regions.extend(of_file);
                notes.extend(told);
            }
        }
    }
    let found = pattern_of(&regions, form, edges);
    let (pattern, told) = found.map_err(|refusal| node.error(refusal.to_string()).help(refusal.advice(form)))?;
    notes.extend(told);
    Ok((pattern, notes))
}

/// Returns the drawings that shapes name.
pub fn files(shapes: &Node) -> Vec<String> {
    let nodes = shapes.list("shapes").unwrap_or_default();
    let named = nodes.iter().filter_map(|node| node.peek(FILE)?.text(FILE).ok());
    named.map(str::to_owned).collect()
}

/// Allows either files or shapes.
pub fn files_or_shapes(fields: Fields) -> Fields {
    fields.exactly_one(&["files", "shapes"])
}

/// Checks that there are either files or shapes.
pub fn check_source(map: &Map<'_>) -> Result<(), InputError> {
    match (map.optional("files"), map.optional("shapes")) {
        (Some(_), Some(_)) => Err(map
            .required("a patterns stage", "shapes")?
            .error("`files` and `shapes` cannot be given together")
            .help("use a stage for each")),
        (None, None) => Err(map
            .error("a patterns stage needs `files` or `shapes`")
            .help("for example files: [mine.csv], or shapes: [{ disc: { centre: [25 mm, 25 mm], radius: 10 mm } }]")),
        _ => Ok(()),
    }
}
