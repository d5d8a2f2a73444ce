//! Amplitude and phase over frequency.

use crate::drawing::{Axis, Chart, FigureError, MAX_NAMED, Mark, Series, Sheet, extent};

/// The response of one point of a membrane, with one value per frequency.
#[derive(Clone, Debug)]
pub struct Response {
    /// Its name.
    pub name: String,
    /// Frequency in Hz; frequencies without a response are left out.
    pub frequency: Vec<f64>,
    /// Amplitude in mm/V.
    pub amplitude: Vec<f64>,
    /// Phase in degrees.
    pub phase: Vec<f64>,
}

/// Width and height of each chart.
const SIZE: [f64; 2] = [708.0, 330.0];

/// A larger change of phase in degrees breaks the curve: the other way round is shorter.
const MAX_TURN: f64 = 180.0;

/// Draws amplitude and phase over the logarithm of the frequency.
///
/// # Errors
/// If there are no responses, or values are missing or not finite.
fn response_charts(responses: &[Response]) -> Result<[Chart; 2], FigureError> {
    let incomplete = |r: &Response| {
        let n = r.frequency.len();
        let numbers = r.frequency.iter().chain(&r.amplitude).chain(&r.phase);
        [r.amplitude.len(), r.phase.len()] != [n; 2] || numbers.into_iter().any(|v| !v.is_finite())
    };
    if responses.is_empty() || responses.iter().any(incomplete) {
        return Err(FigureError::Data(
            "a response needs a finite value at each frequency".into(),
        ));
    }
    let x = Axis::logarithmic("Frequency [Hz]", responses.iter().flat_map(|r| &r.frequency));
    let amplitude = Axis::logarithmic(
        "Amplitude of the point that moves most [mm/V]",
        responses.iter().flat_map(|r| &r.amplitude),
    );
    let (low, high) = extent(responses.iter().flat_map(|r| &r.phase), (0.0, 0.0));
    let margin = (0.08 * (high - low)).max(1.0);
    let phase = Axis::linear("Phase [deg]", low - margin, high + margin);
    let named = (2..=MAX_NAMED).contains(&responses.len());
    let curves = |values: fn(&Response) -> &[f64], y: &Axis, turn: f64| -> Vec<Series> {
        Series::coloured(responses)
            .flat_map(|(response, colour)| {
                let pairs = response.frequency.iter().copied().zip(values(response).iter().copied());
                let points: Vec<(f64, f64)> = pairs.filter(|(f, v)| x.shows(*f) && y.shows(*v)).collect();
                let runs = points.chunk_by(|(_, a), (_, b)| (a - b).abs() <= turn);
                let name = |at| if named && at == 0 { response.name.as_str() } else { "" };
                runs.enumerate()
                    .map(|(at, run)| {
                        let mark = if run.len() == 1 { Mark::Dots } else { Mark::Line };
                        Series::new(name(at), colour, mark, run.to_vec())
                    })
                    .collect::<Vec<_>>()
            })
            .collect()
    };
    let above = curves(|response| &response.amplitude, &amplitude, f64::INFINITY);
    let below = curves(|response| &response.phase, &phase, MAX_TURN);
    Ok([
        Chart::new("Frequency response", [x.clone(), amplitude], above).with_size(SIZE),
        Chart::new("", [x, phase], below).with_size(SIZE),
    ])
}

/// Draws the responses on a sheet.
///
/// # Errors
/// If there are no responses, or values are missing or not finite.
pub fn responses_sheet(responses: &[Response]) -> Result<Sheet, FigureError> {
    Ok(Sheet::charts(1, &response_charts(responses)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_are_broken_at_turns_and_incomplete_data_is_refused() {
        let response = Response {
            name: "a".to_owned(),
            frequency: vec![1.0, 2.0, 3.0, 4.0],
            amplitude: vec![1.0, 0.5, 0.0, 0.25],
            phase: vec![0.0, -170.0, 175.0, 100.0],
        };
        let [amplitude, phase] = response_charts(&[response.clone(), response.clone()]).unwrap();
        let lengths = |chart: &Chart| {
            chart
                .series
                .iter()
                .map(|series| series.points.len())
                .collect::<Vec<_>>()
        };
        // Zero has no logarithm.
        assert_eq!((lengths(&amplitude), lengths(&phase)), (vec![3, 3], vec![2, 2, 2, 2]));
        let short = Response {
            phase: vec![0.0],
            ..response
        };
        assert!(response_charts(&[short]).is_err() && response_charts(&[]).is_err());
    }
}
