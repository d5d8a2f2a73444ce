//! Entities of a DXF file: lines, arcs and other curves in the coordinates of their block.

use super::pairs::Pair;
use super::spline::Spline;
use crate::PatternFileError;
use crate::contour::{Arc, Contour, Piece, Point};
use crate::drawing::affine::Affine;

/// An entity with its pairs. A polyline has those of its vertices too.
#[derive(Clone, Debug)]
pub struct Entity<'a> {
    pub kind: &'a str,
    pub pairs: Vec<Pair<'a>>,
    pub line: usize,
}

/// What an entity draws.
pub enum Drawn<'a> {
    /// A curve, closed if it returns to its start.
    Curve { curve: Contour, is_closed: bool },
    /// Copies of a block.
    Insert(Insert<'a>),
    /// Nothing that has an area.
    Nothing,
}

/// Copies of a block in rows and columns.
pub struct Insert<'a> {
    pub block: &'a str,
    /// The maps of the copies, of the block without its base point.
    pub copies: Vec<Affine>,
}

/// The largest number of copies in one array.
const MOST_COPIES: i64 = 10_000;

impl<'a> Entity<'a> {
    fn pair(&self, code: i32) -> Option<&Pair<'a>> {
        self.pairs.iter().find(|pair| pair.code == code)
    }

    fn number(&self, code: i32) -> Result<Option<f64>, PatternFileError> {
        self.pair(code).map(Pair::number).transpose()
    }

    fn number_or(&self, code: i32, default: f64) -> Result<f64, PatternFileError> {
        Ok(self.number(code)?.unwrap_or(default))
    }

    fn required(&self, code: i32) -> Result<f64, PatternFileError> {
        self.number(code)?
            .ok_or_else(|| self.error(&format!("has no value with code {code}")))
    }

    fn integer_or(&self, code: i32, default: i64) -> Result<i64, PatternFileError> {
        Ok(self.pair(code).map(Pair::integer).transpose()?.unwrap_or(default))
    }

    fn point(&self, code: i32) -> Result<Point, PatternFileError> {
        Ok([self.required(code)?, self.required(code + 10)?])
    }

    /// Returns all points with a code.
    fn points(&self, code: i32) -> Result<Vec<Point>, PatternFileError> {
        let mut points: Vec<Point> = Vec::new();
        for pair in &self.pairs {
            if pair.code == code {
                points.push([pair.number()?, 0.0]);
            } else if let (true, Some(last)) = (pair.code == code + 10, points.last_mut()) {
                last[1] = pair.number()?;
            }
        }
        Ok(points)
    }

    fn numbers(&self, code: i32) -> Result<Vec<f64>, PatternFileError> {
        let found = self.pairs.iter().filter(|pair| pair.code == code);
        found.map(Pair::number).collect()
    }

    pub fn error(&self, what: &str) -> PatternFileError {
        let shown: String = self.kind.chars().take(40).collect();
        PatternFileError::new(format!("line {}: {shown} {what}", self.line))
    }

    pub fn layer(&self) -> &'a str {
        self.pair(8).map_or("0", |pair| pair.value)
    }

    /// Whether it is not shown: invisible, or in the layout of a page.
    pub fn is_hidden(&self) -> bool {
        [60, 67]
            .iter()
            .any(|code| self.pair(*code).is_some_and(|pair| pair.value == "1"))
    }

    /// Returns 1, or −1 if the entity is drawn as seen from below.
    fn side(&self) -> Result<f64, PatternFileError> {
        let [x, y, z] = [
            self.number_or(210, 0.0)?,
            self.number_or(220, 0.0)?,
            self.number_or(230, 1.0)?,
        ];
        match z != 0.0 && x.hypot(y) <= 1e-9 * z.abs() {
            true => Ok(z.signum()),
            false => Err(self
                .error("is tilted out of the plane")
                .help("draw in the plane of x and y, or flatten the drawing")),
        }
    }

    /// Returns what it draws, with lengths in units of the drawing.
    pub fn drawn(&self) -> Result<Drawn<'a>, PatternFileError> {
        // Of these the coordinates are those of the entity, mirrored if it is seen from below.
        let mirror = || Ok::<_, PatternFileError>(Affine::scaled([self.side()?, 1.0]));
        let curve = |curve: Contour, is_closed: bool| Drawn::Curve { curve, is_closed };
        Ok(match self.kind {
            "LINE" => {
                let (start, end) = (self.point(10)?, self.point(11)?);
                let pieces = vec![Piece::Line(end)];
                curve(Contour { start, pieces }, false)
            }
            "CIRCLE" => {
                let (centre, radius) = (self.point(10)?, self.required(40)?);
                curve(mirror()?.contour(&Contour::ellipse(centre, [radius; 2], 0.0)), true)
            }
            "ARC" => curve(mirror()?.contour(&self.arc()?), false),
            "ELLIPSE" => self.ellipse()?,
            "LWPOLYLINE" | "POLYLINE" => match self.polyline()? {
                Some((line, is_closed)) => curve(mirror()?.contour(&line), is_closed),
                None => Drawn::Nothing,
            },
            "SPLINE" => self.spline()?,
            "INSERT" => Drawn::Insert(self.insert(&mirror()?)?),
            _ => Drawn::Nothing,
        })
    }

    fn arc(&self) -> Result<Contour, PatternFileError> {
        let (centre, radius) = (self.point(10)?, self.required(40)?);
        let (from, to) = (self.required(50)?, self.required(51)?);
        let sweep = (to - from).rem_euclid(360.0);
        let sweep = if sweep == 0.0 { 360.0 } else { sweep };
        Ok(of_arc(Arc {
            centre,
            axes: [[radius, 0.0], [0.0, radius]],
            from: from.to_radians(),
            sweep: sweep.to_radians(),
        }))
    }

    fn ellipse(&self) -> Result<Drawn<'a>, PatternFileError> {
        let (centre, [x, y], ratio) = (self.point(10)?, self.point(11)?, self.required(40)?);
        let full = std::f64::consts::TAU;
        let (from, to) = (self.number_or(41, 0.0)?, self.number_or(42, full)?);
        let sweep = (to - from).rem_euclid(full);
        let is_closed = sweep < 1e-9 || full - sweep < 1e-9;
        // Centre and axis are not mirrored, the second axis is.
        let across = ratio * self.side()?;
        let arc = Arc {
            centre,
            axes: [[x, y], [-across * y, across * x]],
            from,
            sweep: if is_closed { full } else { sweep },
        };
        let curve = of_arc(arc);
        Ok(Drawn::Curve { curve, is_closed })
    }

    /// Returns the curve of a polyline and whether it is closed; `None` for meshes and for less than two vertices.
    fn polyline(&self) -> Result<Option<(Contour, bool)>, PatternFileError> {
        let flags = self.integer_or(70, 0)?;
        let is_closed = flags & 1 != 0;
        if self.kind == "POLYLINE" && flags & (16 | 64) != 0 {
            return Ok(None);
        }
        let mut vertices: Vec<(Point, f64)> = Vec::new();
        for pair in &self.pairs {
            match (pair.code, vertices.last_mut()) {
                (10, _) => vertices.push(([pair.number()?, 0.0], 0.0)),
                (20, Some((point, _))) => point[1] = pair.number()?,
                (42, Some((_, bulge))) => *bulge = pair.number()?,
                _ => {}
            }
        }
        let Some(((start, _), _)) = vertices.split_first() else {
            return Ok(None);
        };
        let start = *start;
        let mut pieces = Vec::new();
        for at in 0..vertices.len() {
            let (from, bulge) = vertices[at];
            match vertices.get(at + 1) {
                Some((to, _)) => pieces.push(bulged(from, *to, bulge)),
                None if is_closed => pieces.push(bulged(from, start, bulge)),
                None => {}
            }
        }
        Ok((vertices.len() > 1).then_some((Contour { start, pieces }, is_closed)))
    }

    fn spline(&self) -> Result<Drawn<'a>, PatternFileError> {
        let degree = usize::try_from(self.integer_or(71, 3)?).unwrap_or(usize::MAX);
        let points = self.points(10)?;
        if points.is_empty() {
            return Err(self
                .error("has no control points")
                .help("export splines with control points, or convert them to polylines"));
        }
        let spline = Spline {
            degree,
            knots: self.numbers(40)?,
            weights: self.numbers(41)?,
            points,
        };
        if let Some(fault) = spline.fault() {
            return Err(self
                .error(&format!("is damaged: {fault}"))
                .help("export the drawing again"));
        }
        Ok(match spline.pieces() {
            Some((start, pieces)) => Drawn::Curve {
                curve: Contour { start, pieces },
                is_closed: false,
            },
            None => Drawn::Nothing,
        })
    }

    fn insert(&self, mirror: &Affine) -> Result<Insert<'a>, PatternFileError> {
        let block = self.pair(2).ok_or_else(|| self.error("names no block"))?.value;
        let scale = [self.number_or(41, 1.0)?, self.number_or(42, 1.0)?];
        let (columns, rows) = (self.integer_or(70, 1)?.max(1), self.integer_or(71, 1)?.max(1));
        if columns.saturating_mul(rows) > MOST_COPIES {
            return Err(self
                .error(&format!("has {columns} × {rows} copies"))
                .help(format!("allowed: at most {MOST_COPIES}")));
        }
        let (apart, above) = (self.number_or(44, 0.0)?, self.number_or(45, 0.0)?);
        let turned = Affine::moved(self.point(10)?).after(&Affine::turned(self.number_or(50, 0.0)?));
        let copy = |column: i64, row: i64| {
            let place = Affine::moved([column as f64 * apart, row as f64 * above]);
            mirror.after(&turned).after(&place).after(&Affine::scaled(scale))
        };
        let copies = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        Ok(Insert {
            block,
            copies: copies.map(|(column, row)| copy(column, row)).collect(),
        })
    }
}

fn of_arc(arc: Arc) -> Contour {
    Contour {
        start: arc.at(0.0),
        pieces: vec![Piece::Arc(arc)],
    }
}

/// Returns the piece of a polyline between two vertices. The bulge is the tangent of a quarter of the angle of its arc,
/// positive anticlockwise.
fn bulged(from: Point, to: Point, bulge: f64) -> Piece {
    let [along, up] = [to[0] - from[0], to[1] - from[1]];
    let through = [
        f64::midpoint(from[0], to[0]) + bulge / 2.0 * up,
        f64::midpoint(from[1], to[1]) - bulge / 2.0 * along,
    ];
    match Arc::through(from, through, to) {
        Some(arc) if bulge != 0.0 => Piece::Arc(arc),
        _ => Piece::Line(to),
    }
}
