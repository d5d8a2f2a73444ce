//! Displacement against time.

use std::path::Path;

use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};

/// How one point of a membrane moves.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Its name.
    pub name: String,
    /// Time in s.
    pub time: Vec<f64>,
    /// Displacement magnitude in mm.
    pub displacement: Vec<f64>,
    /// What ends it before the time is over, in words.
    pub end: Option<String>,
}

/// Width and height of the chart.
const SIZE: [f64; 2] = [708.0, 410.0];
/// Names of more curves would fill the chart.
const NAMED: usize = 7;
/// From so many times the first step to the end time is drawn logarithmically.
const DECADES: f64 = 1e3;

/// Displacement against time, logarithmic in time where `spread` says that it goes over decades.
///
/// # Errors
/// When there are no curves or their data are incomplete.
fn history_chart(motions: &[Motion], spread: bool) -> Result<Chart, FigureError> {
    let incomplete = |m: &Motion| {
        let numbers = m.time.iter().chain(&m.displacement);
        m.time.len() != m.displacement.len() || numbers.into_iter().any(|v| !v.is_finite())
    };
    if motions.is_empty() || motions.iter().any(incomplete) {
        return Err(FigureError::Data(
            "a history needs finite values at each of its times".into(),
        ));
    }
    let times = motions.iter().flat_map(|m| &m.time);
    let (first, last) = times
        .clone()
        .filter(|t| **t > 0.0)
        .fold((f64::INFINITY, 0.0), |(low, high), t| {
            (f64::min(low, *t), f64::max(high, *t))
        });
    let x = match spread && last > DECADES * first {
        true => Axis::logarithmic("Time [s]", times),
        false => Axis::linear("Time [s]", 0.0, last),
    };
    let y = Axis::above(
        "Displacement of the point that moves most [mm]",
        motions.iter().flat_map(|m| &m.displacement),
    );
    let shown: Vec<bool> = motions.iter().map(|m| m.time.iter().any(|t| x.shows(*t))).collect();
    let named = (2..=NAMED).contains(&motions.len());
    let mut series = Vec::new();
    for ((motion, shown), colour) in motions.iter().zip(shown).zip(Colour::ALL.into_iter().cycle()) {
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
        if let (Some(words), Some(end)) = (&motion.end, end) {
            series.push(Series::new("", colour, Mark::Dots, vec![end]));
            if motions.len() == 1 {
                series.push(Series::new("", colour, Mark::Labelled, vec![end]).with_words(vec![words.clone()]));
            }
        }
    }
    Ok(Chart::new("Motion in time".to_owned(), [x, y], series).with_size(SIZE))
}

/// Draws how points move; `spread` where it goes over decades of time.
///
/// # Errors
/// As the data are incomplete, or the file cannot be written.
pub fn draw_histories(path: &Path, motions: &[Motion], spread: bool) -> Result<(), FigureError> {
    Sheet::charts(1, &[history_chart(motions, spread)?]).write_png(path)
}
