//! Reads the curves of a drawing in DXF, the exchange format of CAD programs, in its text form.
//!
//! Source: Autodesk, DXF Reference (AutoCAD 2012), "ENTITIES Section" and "BLOCKS Section". Blocks are inserted with
//! scale, rotation, arrays and nesting; entities on layer 0 of a block take the layer of what inserts it.

mod entity;
mod pairs;
mod spline;

use std::collections::{BTreeMap, HashMap};

use super::affine::Affine;
use super::curves::{Curve, Curves};
use crate::PatternFileError;
use crate::contour::Piece;
use entity::{Drawn, Entity};
use pairs::{Pair, pairs};

/// How deep blocks may be nested.
const DEEPEST: usize = 32;

/// The largest number of entities and pieces, in all copies of blocks.
const MOST: usize = 2_000_000;

/// Returns the curves of a drawing, with lengths in mm.
///
/// # Errors
/// When the text is not DXF, or `unit_mm` is none and it has no unit.
pub(super) fn read(text: &str, unit_mm: Option<f64>) -> Result<Curves, PatternFileError> {
    if text.starts_with("AutoCAD Binary DXF") {
        return Err(PatternFileError::new("the file is binary DXF").help("export the drawing as ASCII DXF"));
    }
    let pairs = pairs(text)?;
    let file = File::of(&pairs);
    let mut curves = Curves::default();
    let own = file.unit_mm()?;
    let unit = match (unit_mm, own) {
        (Some(unit), Some(own)) if unit != own => {
            curves.notes.push(format!(
                "lengths are read in units of {unit} mm; the file has units of {own} mm"
            ));
            unit
        }
        (Some(unit), _) | (None, Some(unit)) => unit,
        (None, None) => {
            return Err(PatternFileError::new("the drawing has no unit")
                .help("give the unit of its lengths: um, mm, cm, m or in"));
        }
    };
    let mut reading = Reading {
        file: &file,
        curves,
        ignored: BTreeMap::new(),
        count: 0,
    };
    reading.add_all(&file.entities, &Affine::scaled([unit; 2]), None, 0)?;
    let Reading {
        mut curves, ignored, ..
    } = reading;
    for (layer, kinds) in ignored {
        let kinds: Vec<String> = kinds.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        curves.ignored.push((layer, kinds.join(", ")));
    }
    Ok(curves)
}

/// The parts of a file that draw.
struct File<'a> {
    unit: Option<Pair<'a>>,
    blocks: HashMap<&'a str, Block<'a>>,
    entities: Vec<Entity<'a>>,
}

struct Block<'a> {
    entities: Vec<Entity<'a>>,
    base: [f64; 2],
}

impl<'a> File<'a> {
    fn of(pairs: &[Pair<'a>]) -> Self {
        let mut file = Self {
            unit: None,
            blocks: HashMap::new(),
            entities: Vec::new(),
        };
        // A file without sections is one of entities.
        let mut section = "ENTITIES";
        let mut block: Option<Entity<'a>> = None;
        let mut inside: Vec<Entity<'a>> = Vec::new();
        for item in items(pairs) {
            match (item.kind, section) {
                ("SECTION", _) => section = item.pairs.first().map_or("", |pair| pair.value),
                ("ENDSEC", _) => section = "",
                ("BLOCK", "BLOCKS") => (block, inside) = (Some(item), Vec::new()),
                ("ENDBLK", "BLOCKS") => {
                    let (Some(block), entities) = (block.take(), std::mem::take(&mut inside)) else {
                        continue;
                    };
                    let value = |code: i32| block.pairs.iter().find(|pair| pair.code == code);
                    let number = |code: i32| value(code).and_then(|pair| pair.number().ok()).unwrap_or(0.0);
                    if let Some(name) = value(2) {
                        let base = [number(10), number(20)];
                        file.blocks.insert(name.value, Block { entities, base });
                    }
                }
                (_, "BLOCKS") => add(&mut inside, item),
                (_, "ENTITIES") => add(&mut file.entities, item),
                _ => {}
            }
        }
        let header = pairs
            .windows(2)
            .find(|pair| pair[0].code == 9 && pair[0].value == "$INSUNITS");
        file.unit = header.map(|pair| pair[1]);
        file
    }

    /// Returns the length of a unit in mm; `None` if the file has none.
    fn unit_mm(&self) -> Result<Option<f64>, PatternFileError> {
        let number = self.unit.map(|unit| unit.integer()).transpose()?;
        Ok(match number {
            Some(1) => Some(25.4),
            Some(2) => Some(304.8),
            Some(4) => Some(1.0),
            Some(5) => Some(10.0),
            Some(6) => Some(1e3),
            Some(7) => Some(1e6),
            Some(8) => Some(25.4e-6),
            Some(9) => Some(25.4e-3),
            Some(10) => Some(914.4),
            Some(12) => Some(1e-6),
            Some(13) => Some(1e-3),
            Some(14) => Some(100.0),
            _ => None,
        })
    }
}

/// Splits pairs at those with code 0.
fn items<'a>(pairs: &[Pair<'a>]) -> impl Iterator<Item = Entity<'a>> {
    let starts = pairs
        .iter()
        .enumerate()
        .filter(|(_, pair)| pair.code == 0)
        .map(|(at, _)| at);
    let ends = starts.clone().skip(1).chain([pairs.len()]);
    starts.zip(ends).map(|(start, end)| Entity {
        kind: pairs[start].value,
        pairs: pairs[start + 1..end].to_vec(),
        line: pairs[start].line,
    })
}

/// Adds an entity, or a vertex to its polyline.
fn add<'a>(entities: &mut Vec<Entity<'a>>, item: Entity<'a>) {
    const CONTROL: i64 = 16;
    match (item.kind, entities.last_mut()) {
        ("SEQEND", _) => {}
        ("VERTEX", Some(polyline)) if polyline.kind == "POLYLINE" => {
            let of_control =
                |pair: &Pair<'_>| pair.code == 70 && pair.integer().is_ok_and(|flags| flags & CONTROL != 0);
            if !item.pairs.iter().any(of_control) {
                let geometry = item.pairs.into_iter().filter(|pair| [10, 20, 42].contains(&pair.code));
                polyline.pairs.extend(geometry);
            }
        }
        ("POLYLINE", _) => {
            // Its own point is that of the plane.
            let pairs = item
                .pairs
                .into_iter()
                .filter(|pair| ![10, 20, 40, 41, 42].contains(&pair.code));
            entities.push(Entity {
                pairs: pairs.collect(),
                ..item
            });
        }
        _ => entities.push(item),
    }
}

/// Entities that are no part of a drawing's areas although they say nothing.
const SILENT: [&str; 3] = ["SEQEND", "VIEWPORT", "ATTRIB"];

struct Reading<'a> {
    file: &'a File<'a>,
    curves: Curves,
    /// The numbers of ignored entities by layer and kind.
    ignored: BTreeMap<String, BTreeMap<String, usize>>,
    count: usize,
}

impl<'a> Reading<'a> {
    /// Adds entities. Those on layer 0 take the layer of what inserts them.
    fn add_all(
        &mut self,
        entities: &'a [Entity<'a>],
        map: &Affine,
        inserted: Option<&'a str>,
        depth: usize,
    ) -> Result<(), PatternFileError> {
        for entity in entities.iter().filter(|entity| !entity.is_hidden()) {
            let layer = match (entity.layer(), inserted) {
                ("0", Some(layer)) => layer,
                (layer, _) => layer,
            };
            self.add(entity, layer, map, depth)?;
        }
        Ok(())
    }

    fn add(
        &mut self,
        entity: &'a Entity<'a>,
        layer: &'a str,
        map: &Affine,
        depth: usize,
    ) -> Result<(), PatternFileError> {
        self.grow(entity, 1)?;
        match entity.drawn()? {
            Drawn::Nothing if SILENT.contains(&entity.kind) => {}
            Drawn::Nothing => {
                let kind: String = entity.kind.chars().take(40).collect();
                *self
                    .ignored
                    .entry(layer.to_owned())
                    .or_default()
                    .entry(kind)
                    .or_default() += 1;
            }
            Drawn::Curve { curve, is_closed } => {
                self.grow(entity, curve.pieces.len())?;
                let curve = map.contour(&curve);
                let is_empty = curve
                    .pieces
                    .iter()
                    .all(|piece| matches!(piece, Piece::Line(end) if *end == curve.start));
                if !is_empty {
                    self.curves.add(layer, Curve { curve, is_closed });
                }
            }
            Drawn::Insert(insert) => {
                if depth == DEEPEST {
                    return Err(entity
                        .error(&format!("is nested more than {DEEPEST} blocks deep"))
                        .help("insert blocks that do not contain themselves"));
                }
                let Some(block) = self.file.blocks.get(insert.block) else {
                    let shown: String = insert.block.chars().take(40).collect();
                    return Err(entity.error(&format!("inserts the block \"{shown}\", which the file does not have")));
                };
                let based = Affine::moved(block.base.map(|base| -base));
                for copy in insert.copies {
                    self.add_all(&block.entities, &map.after(&copy).after(&based), Some(layer), depth + 1)?;
                }
            }
        }
        Ok(())
    }

    fn grow(&mut self, entity: &Entity<'_>, by: usize) -> Result<(), PatternFileError> {
        self.count += by;
        match self.count > MOST {
            true => Err(entity
                .error(&format!("is beyond the {MOST} entities that a drawing can have"))
                .help("simplify the drawing")),
            false => Ok(()),
        }
    }
}
