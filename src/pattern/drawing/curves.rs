//! The curves of a drawing by layer, and contours that are joined from them.

use std::collections::{BTreeMap, HashMap, HashSet};

use crate::PatternFileError;
use crate::contour::{Arc, Contour, Piece, Point};

/// A curve as it is drawn.
#[derive(Clone, Debug)]
pub struct Curve {
    pub curve: Contour,
    /// Whether it returns to its start; if not, others must continue it.
    pub is_closed: bool,
}

/// The curves of a drawing in mm.
#[derive(Default)]
pub struct Curves {
    layers: BTreeMap<String, Vec<Curve>>,
    /// What was ignored, by layer.
    pub ignored: Vec<(String, String)>,
    pub notes: Vec<String>,
}

/// The largest number of pairs of ends that may be close to each other.
const MOST_PAIRS: usize = 2_000_000;

impl Curves {
    pub fn add(&mut self, layer: &str, curve: Curve) {
        match self.layers.get_mut(layer) {
            Some(curves) => curves.push(curve),
            None => _ = self.layers.insert(layer.to_owned(), vec![curve]),
        }
    }

    /// Returns the names of the layers with curves.
    pub fn layers(&self) -> impl Iterator<Item = &str> {
        self.layers.keys().map(String::as_str)
    }

    /// Returns the closed contours of a layer, or of the only layer with curves, and notes.
    pub fn contours(&self, layer: Option<&str>, join_mm: f64) -> Result<(Vec<Contour>, Vec<String>), PatternFileError> {
        let names: Vec<String> = self.layers.keys().cloned().collect();
        let listed = || short_list(&names);
        let name = match (layer, names.as_slice()) {
            (_, []) => {
                return Err(PatternFileError::new("the drawing has no closed curves")
                    .help("draw areas as lines, arcs, circles, ellipses, splines or polylines"));
            }
            (Some(layer), names) => match names.iter().find(|name| *name == layer) {
                Some(name) => name.clone(),
                None => {
                    return Err(
                        PatternFileError::new(format!("the drawing has no curves on layer \"{layer}\""))
                            .help(format!("layers with curves: {}", listed())),
                    );
                }
            },
            (None, [only]) => only.clone(),
            (None, names) => {
                return Err(
                    PatternFileError::new(format!("the drawing has curves on {} layers", names.len()))
                        .help(format!("name the layer that is read, one of {}", listed())),
                );
            }
        };
        let curves = self.layers.get(&name).cloned().unwrap_or_default();
        let mut notes = self.notes.clone();
        let ignored = self.ignored.iter().filter(|(layer, _)| *layer == name || *layer == "0");
        notes.extend(ignored.map(|(_, what)| format!("ignored: {what}")));
        let others: Vec<String> = names.iter().filter(|other| **other != name).cloned().collect();
        if !others.is_empty() {
            notes.push(format!("layers that were not read: {}", short_list(&others)));
        }
        let (curves, repeated) = distinct(curves, join_mm);
        match repeated {
            0 => {}
            1 => notes.push("1 curve lies on an equal one and was left out".to_owned()),
            many => notes.push(format!("{many} curves lie on equal ones and were left out")),
        }
        let (closed, open): (Vec<Curve>, Vec<Curve>) = curves.into_iter().partition(|curve| curve.is_closed);
        let mut contours: Vec<Contour> = closed.into_iter().map(|curve| curve.curve).collect();
        contours.extend(joined(open.into_iter().map(|curve| curve.curve).collect(), join_mm)?);
        Ok((contours, notes))
    }
}

/// Lists some names.
fn short_list(names: &[String]) -> String {
    const SHOWN: usize = 12;
    let shown = names
        .iter()
        .take(SHOWN)
        .map(|name| name.chars().take(60).collect::<String>());
    let list = shown.collect::<Vec<_>>().join(", ");
    match names.len() > SHOWN {
        true => format!("{list} and {} more", names.len() - SHOWN),
        false => list,
    }
}

/// Returns curves without those that are drawn twice, and the number of the others.
fn distinct(curves: Vec<Curve>, join_mm: f64) -> (Vec<Curve>, usize) {
    let cell = |point: Point| point.map(|at| (at / join_mm).round() as i64);
    let before = curves.len();
    let mut seen = HashSet::new();
    let mut kept = curves;
    kept.retain(|Curve { curve, is_closed }| {
        let mut places: Vec<[i64; 2]> = vec![cell(curve.start)];
        let mut last = curve.start;
        for piece in &curve.pieces {
            places.extend(inner(piece, last).map(cell));
            last = piece.end();
            places.push(cell(last));
        }
        let reversed: Vec<[i64; 2]> = places.iter().rev().copied().collect();
        seen.insert((places.min(reversed), *is_closed))
    });
    let repeated = before - kept.len();
    (kept, repeated)
}

/// Returns two points that tell a piece from others with the same ends.
fn inner(piece: &Piece, start: Point) -> [Point; 2] {
    match piece {
        Piece::Line(end) => [start, *end],
        Piece::Arc(arc) => [arc.at(0.25), arc.at(0.75)],
        Piece::Cubic([one, other, _]) => [*one, *other],
    }
}

fn end_of(curve: &Contour) -> Point {
    curve.pieces.last().map_or(curve.start, Piece::end)
}

/// Returns a curve in the other direction.
fn reversed(curve: &Contour) -> Contour {
    let mut starts = vec![curve.start];
    starts.extend(curve.pieces.iter().map(Piece::end));
    let piece = |(piece, start): (&Piece, &Point)| match *piece {
        Piece::Line(_) => Piece::Line(*start),
        Piece::Arc(arc) => Piece::Arc(Arc {
            from: arc.from + arc.sweep,
            sweep: -arc.sweep,
            ..arc
        }),
        Piece::Cubic([one, other, _]) => Piece::Cubic([other, one, *start]),
    };
    Contour {
        start: end_of(curve),
        pieces: curve.pieces.iter().zip(&starts).rev().map(piece).collect(),
    }
}

fn apart(one: Point, other: Point) -> f64 {
    (one[0] - other[0]).hypot(one[1] - other[1])
}

/// Joins open curves whose ends are close, in any order and direction.
fn joined(curves: Vec<Contour>, join_mm: f64) -> Result<Vec<Contour>, PatternFileError> {
    // End 2 n is the start of curve n, end 2 n + 1 its end.
    let ends: Vec<Point> = curves.iter().flat_map(|curve| [curve.start, end_of(curve)]).collect();
    let partners = partners(&ends, join_mm)?;
    if let Some(open) = partners.iter().position(Option::is_none) {
        return Err(gap(&ends, &partners, open, join_mm));
    }
    let mut curves: Vec<Option<Contour>> = curves.into_iter().map(Some).collect();
    let mut contours = Vec::new();
    for first in 0..curves.len() {
        let Some(mut contour) = curves[first].take() else {
            continue;
        };
        let mut end = 2 * first + 1;
        while let Some(next) = partners[end] {
            let Some(curve) = curves[next / 2].take() else {
                break;
            };
            let curve = if next % 2 == 0 { curve } else { reversed(&curve) };
            contour.pieces.extend(curve.pieces);
            end = next ^ 1;
        }
        contours.push(contour);
    }
    Ok(contours)
}

/// Returns the end that each end is joined to: the closest pairs first.
fn partners(ends: &[Point], join_mm: f64) -> Result<Vec<Option<usize>>, PatternFileError> {
    let cell = |point: Point| point.map(|at| (at / join_mm).floor() as i64);
    let mut cells: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
    for (at, end) in ends.iter().enumerate() {
        cells.entry(cell(*end)).or_default().push(at);
    }
    let mut pairs = Vec::new();
    for (at, end) in ends.iter().enumerate() {
        let [x, y] = cell(*end);
        let around = (-1..=1).flat_map(|right| (-1..=1).map(move |up| [x.saturating_add(right), y.saturating_add(up)]));
        for other in around.filter_map(|cell| cells.get(&cell)).flatten().copied() {
            let distance = apart(*end, ends[other]);
            if at < other && distance <= join_mm {
                pairs.push((distance, at, other));
                if pairs.len() > MOST_PAIRS {
                    return Err(PatternFileError::new(format!(
                        "too many curves end near ({:.6}, {:.6}) mm",
                        end[0], end[1]
                    ))
                    .help("reduce `join`, or simplify the drawing"));
                }
            }
        }
    }
    // The ends of one curve come last: a curve shorter than the distance is no contour if others continue it.
    let order = |pair: &(f64, usize, usize)| (pair.1 / 2 == pair.2 / 2, pair.1, pair.2);
    let is_own = |pair: &(f64, usize, usize)| order(pair).0;
    pairs.sort_by(|one, other| {
        let by_kind = is_own(one).cmp(&is_own(other));
        by_kind
            .then(one.0.total_cmp(&other.0))
            .then(order(one).cmp(&order(other)))
    });
    let mut partners = vec![None; ends.len()];
    for (_, one, other) in pairs {
        if partners[one].is_none() && partners[other].is_none() {
            (partners[one], partners[other]) = (Some(other), Some(one));
        }
    }
    Ok(partners)
}

/// Says where a contour is open: between an end and the closest other loose end.
fn gap(ends: &[Point], partners: &[Option<usize>], open: usize, join_mm: f64) -> PatternFileError {
    let here = ends[open];
    let others = (0..ends.len()).filter(|at| *at != open && partners[*at].is_none());
    let nearest = others.min_by(|one, other| apart(here, ends[*one]).total_cmp(&apart(here, ends[*other])));
    let place = |[x, y]: Point| format!("({x:.6}, {y:.6}) mm");
    match nearest.map(|nearest| ends[nearest]) {
        Some(there) => PatternFileError::new(format!(
            "a contour is open: its ends at {} and {} are {:.3e} mm apart",
            place(here),
            place(there),
            apart(here, there)
        ))
        .help(format!(
            "close it, or join ends that are further apart than {join_mm} mm by a larger `join`"
        )),
        None => PatternFileError::new(format!("a curve ends at {}, where no other begins", place(here)))
            .help("close the contour, or delete the curve"),
    }
}
