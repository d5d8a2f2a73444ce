//! Displacement over time.

use crate::drawing::{Axis, Chart, FigureError, LARGE, MAX_NAMED, Mark, Series, Sheet, extent};

/// The motion of one point of a membrane.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Its name.
    pub name: String,
    /// The point and its direction; none for the point that moves most.
    pub place: Option<String>,
    /// Time in s.
    pub time: Vec<f64>,
    /// Displacement of that point in mm.
    pub displacement: Vec<f64>,
    /// Why it ends early, if it does.
    pub end: Option<String>,
}

/// The time axis is logarithmic if the end time is larger than the first step by this factor.
const LOG_RATIO: f64 = 1e3;

/// Draws displacement over time, logarithmic in time if `is_wide` and the times span decades.
///
/// # Errors
/// If there are no curves, or values are missing or not finite.
fn history_chart(motions: &[Motion], is_wide: bool) -> Result<Chart, FigureError> {
    let incomplete = |m: &Motion| {
        let numbers = m.time.iter().chain(&m.displacement);
        m.time.len() != m.displacement.len() || numbers.into_iter().any(|v| !v.is_finite())
    };
    if motions.is_empty() || motions.iter().any(incomplete) {
        return Err(FigureError::Data("a history needs a finite value at each time".into()));
    }
    let times = motions.iter().flat_map(|m| &m.time);
    let positive = times.clone().filter(|t| **t > 0.0);
    let (first, last) = extent(positive, (f64::INFINITY, 0.0));
    let x = match is_wide && last > LOG_RATIO * first {
        true => Axis::logarithmic("Time [s]", times),
        false => Axis::linear("Time [s]", 0.0, last),
    };
    let place = motions.iter().find_map(|motion| motion.place.as_deref());
    let name = match place {
        Some(place) => format!("Displacement {place} [mm]"),
        None => "Displacement of the point that moves most [mm]".to_owned(),
    };
    let y = Axis::above(&name, motions.iter().flat_map(|m| &m.displacement));
    let shown: Vec<bool> = motions.iter().map(|m| m.time.iter().any(|t| x.shows(*t))).collect();
    let named = (2..=MAX_NAMED).contains(&motions.len());
    let mut series = Vec::new();
    for ((motion, shown), colour) in Series::coloured(motions.iter().zip(shown)) {
        if !shown {
            continue;
        }
        let pairs = motion.time.iter().zip(&motion.displacement);
        let points: Vec<(f64, f64)> = pairs.map(|(t, d)| (*t, *d)).filter(|(t, _)| x.shows(*t)).collect();
        let end = points.last().copied();
        series.push(Series::new(
            if named { &motion.name } else { "" },
            colour,
            Mark::Line,
            points,
        ));
        if let (Some(text), Some(end)) = (&motion.end, end) {
            series.push(Series::new("", colour, Mark::Dots, vec![end]));
            if motions.len() == 1 {
                series.push(Series::new("", colour, Mark::Labelled, vec![end]).with_texts(vec![text.clone()]));
            }
        }
    }
    Ok(Chart::new("Displacement over time", [x, y], series).with_size(LARGE))
}

/// Draws the motions on a sheet; `is_wide` allows a logarithmic time axis.
///
/// # Errors
/// If there are no curves, or values are missing or not finite.
pub fn histories_sheet(motions: &[Motion], is_wide: bool) -> Result<Sheet, FigureError> {
    Ok(Sheet::charts(1, &[history_chart(motions, is_wide)?]))
}
