//! Amplitude and phase against frequency.

use std::path::Path;

use crate::report::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};

/// How one point of a membrane responds, with one value per frequency.
#[derive(Clone, Debug)]
pub struct Response {
    /// Its name.
    pub name: String,
    /// Frequency in Hz; those without a response are left out.
    pub frequency: Vec<f64>,
    /// Amplitude in mm/V.
    pub amplitude: Vec<f64>,
    /// Phase in degrees.
    pub phase: Vec<f64>,
}

/// Width and height of each chart.
const SIZE: [f64; 2] = [708.0, 330.0];
/// Names of more curves would fill the chart.
const NAMED: usize = 7;

impl Response {
    /// The phase without jumps by a whole turn.
    fn unwrapped(&self) -> Vec<f64> {
        let mut turns = 0.0;
        let mut last: Option<f64> = None;
        let each = self.phase.iter().map(|phase| {
            if let Some(last) = last {
                // Half a turn is what nothing damps takes at once: it is none.
                turns -= 360.0 * ((phase - last) / 360.0 - 1e-9_f64.copysign(phase - last)).round();
            }
            last = Some(*phase);
            phase + turns
        });
        each.collect()
    }
}

/// Amplitude above phase, both over the logarithm of the frequency.
///
/// # Errors
/// When the data are incomplete.
fn response_charts(responses: &[Response]) -> Result<[Chart; 2], FigureError> {
    let incomplete = |r: &Response| {
        let n = r.frequency.len();
        let numbers = r.frequency.iter().chain(&r.amplitude).chain(&r.phase);
        [r.amplitude.len(), r.phase.len()] != [n; 2] || numbers.into_iter().any(|v| !v.is_finite())
    };
    if responses.is_empty() || responses.iter().any(incomplete) {
        return Err(FigureError::Data(
            "a response needs finite values at each of its frequencies".into(),
        ));
    }
    let x = Axis::logarithmic("Frequency [Hz]", responses.iter().flat_map(|r| &r.frequency));
    let amplitude = Axis::logarithmic(
        "Amplitude of the point that moves most [mm/V]",
        responses.iter().flat_map(|r| &r.amplitude),
    );
    let phases: Vec<Vec<f64>> = responses.iter().map(Response::unwrapped).collect();
    let (low, high) = phases
        .iter()
        .flatten()
        .fold((0.0, 0.0), |(l, h), v| (f64::min(l, *v), f64::max(h, *v)));
    let margin = (0.08 * (high - low)).max(1.0);
    let phase = Axis::linear("Phase [deg]", low - margin, high + margin);
    let named = (2..=NAMED).contains(&responses.len());
    let curve = |value: &dyn Fn(usize) -> Vec<f64>, y: &Axis| -> Vec<Series> {
        let each = responses.iter().enumerate().zip(Colour::ALL.into_iter().cycle());
        each.map(|((at, response), colour)| {
            let pairs = response.frequency.iter().copied().zip(value(at));
            let points = pairs.filter(|(f, v)| x.shows(*f) && y.shows(*v)).collect();
            Series::new(if named { &response.name } else { "" }, colour, Mark::Line, points)
        })
        .filter(|series| !series.points.is_empty())
        .collect()
    };
    let above = curve(&|at| responses[at].amplitude.clone(), &amplitude);
    let below = curve(&|at| phases[at].clone(), &phase);
    Ok([
        Chart::new("Frequency response", [x.clone(), amplitude], above).with_size(SIZE),
        Chart::new("", [x, phase], below).with_size(SIZE),
    ])
}

/// Draws how points respond.
///
/// # Errors
/// As the data are incomplete, or the file cannot be written.
pub fn draw_responses(path: &Path, responses: &[Response]) -> Result<(), FigureError> {
    Sheet::charts(1, &response_charts(responses)?).write_png(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_are_drawn_without_jumps_by_a_turn() {
        let response = Response {
            name: String::new(),
            frequency: vec![1.0; 6],
            amplitude: vec![1.0; 6],
            phase: vec![0.0, -170.0, 175.0, 100.0, -180.0, 0.0],
        };
        assert_eq!(response.unwrapped(), [0.0, -170.0, -185.0, -260.0, -180.0, 0.0]);
    }
}
