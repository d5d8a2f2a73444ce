//! The shapes of a pattern: drawn in the pipeline, or read from drawings.

use std::path::Path;

use super::super::files::NamedFile;
use deaflow_base::{Canonical, Decimal, Declared, Fields, InputError, Map, Node, Parameter, Schema, parameters};
use deaflow_pattern::{
    Bits, Contours, DrawingFormat, DrawingOptions, Edges, GroupRegion, Pattern, PatternFileError, PatternForm,
    PictureFormat, Region, pattern_of, read_drawing, read_patterns_of,
};
use deaflow_scene::{Placement, Shape, Shapes, Text};

/// The key of a drawing.
const FILE: &str = "file";

/// The dark shares that can make a cell an electrode.
const THRESHOLDS: std::ops::RangeInclusive<f64> = 1e-3..=1.0;

/// The largest number of a group.
const MOST_GROUPS: u64 = Pattern::MOST_GROUPS as u64;

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
    rules(without_files)
}

/// The keys of drawings, which have a mapping of their own.
fn of_files() -> Vec<&'static str> {
    [Placement::keys(), vec![FILE]].concat()
}

fn without_files(fields: Fields) -> Fields {
    of_files().into_iter().fold(fields, Fields::without)
}

impl DrawnShape {
    fn read_own(node: &Node) -> Result<Self, InputError> {
        let others = of_files();
        let keys: Vec<&str> = Self::keys().into_iter().filter(|key| !others.contains(key)).collect();
        Self::read_map(&node.fields(Self::WHAT, &keys)?)
    }
}

parameters! {
    /// A drawing in DXF or SVG, or a picture of the membrane.
    struct DrawnFile as "a drawing of a patterns stage" {
        /// FILE.dxf, FILE.svg or a picture (.png, .jpg, .tif, .bmp), relative to the pipeline's file.
        file: Text,
        /// Its electrode group; without it 1, or the groups of layers that are named ELECTRODE_1 and so on.
        group: Option<u64> [1..=MOST_GROUPS],
        /// The dark share from which on a cell of a picture is an electrode; 0.5 if it is not given.
        threshold: Option<Decimal> [THRESHOLDS],
        /// What is left out of it: shapes.
        without: Option<Shapes>,
    }
    include {
        /// What is read of a drawing, and where it lies.
        placement: Placement,
    }
    check(check_file)
}

/// Checks that drawings have no keys of pictures, and pictures none of drawings.
fn check_file(_: &DrawnFile, map: &Map<'_>) -> Result<(), InputError> {
    let name = map.required("a drawing of a patterns stage", FILE)?.text(FILE)?;
    let (keys, what) = match is_picture(Path::new(name)) {
        true => (Placement::keys(), "a picture covers the membrane"),
        false => (vec!["threshold"], "a drawing has no greys"),
    };
    match keys.iter().find_map(|key| Some((key, map.optional(key)?))) {
        Some((key, node)) => Err(node
            .error(format!("`{key}` cannot be used with {name}: {what}"))
            .help("remove it")),
        None => Ok(()),
    }
}

fn is_picture(path: &Path) -> bool {
    PictureFormat::of(path).is_some()
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
            None => DrawnShape::read_own(node).map(|own| Self(Source::Shape(Box::new(own)))),
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
        let placed = self.placement.options();
        DrawingOptions {
            threshold: self.threshold.map_or(placed.threshold, Decimal::to_f64),
            ..placed
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
            None => {
                let allowed = format!("allowed: .dxf, .svg, {}", PictureFormat::EXTENSIONS);
                Err(file.refused(&"not a drawing or a picture", &allowed))
            }
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
            Source::Shape(own) => {
                regions.push(GroupRegion {
                    group: own.group as usize,
                    region: own.shape.region(),
                });
                notes.extend(own.shape.notes());
            }
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
