//! Designs that are verified round by round: the accuracy of their predictions, and the best displacement.

use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};

/// The results of one round.
#[derive(Clone, Debug)]
pub struct Round {
    /// Relative difference between prediction and simulation of each design.
    pub differences: Vec<f64>,
    /// The best simulated displacement of each target in mm, with the name of the target.
    pub best: Vec<(String, f64)>,
}

/// Draws the differences of all designs with their root mean square, and the best of each target, over the rounds.
///
/// # Errors
/// If there is no round, or a number is not finite.
pub fn rounds_charts(rounds: &[Round]) -> Result<Vec<Chart>, FigureError> {
    let numbers = |round: &Round| {
        let best = round.best.iter().map(|(_, mm)| *mm);
        round.differences.iter().copied().chain(best).collect::<Vec<f64>>()
    };
    if rounds.is_empty() || rounds.iter().flat_map(numbers).any(|value| !value.is_finite()) {
        return Err(FigureError::Data("rounds need finite numbers".into()));
    }
    Ok(vec![differences(rounds), best(rounds)])
}

fn over_rounds(rounds: &[Round]) -> Axis {
    Axis::counting("Round", 0.5, rounds.len() as f64 + 0.5)
}

fn differences(rounds: &[Round]) -> Chart {
    let (mut points, mut means) = (Vec::new(), Vec::new());
    for (round, found) in (1..).map(f64::from).zip(rounds) {
        let percent = || found.differences.iter().map(|fraction| 100.0 * fraction);
        points.extend(percent().map(|value| (round, value)));
        let squares: f64 = percent().map(|value| value * value).sum();
        means.push((round, (squares / found.differences.len().max(1) as f64).sqrt()));
    }
    let y = Axis::logarithmic(
        "|predicted − simulated| / simulated [%]",
        points.iter().map(|(_, value)| value),
    );
    let series = vec![
        Series::new("each design", Colour::Sky, Mark::Dots, points),
        Series::new("root mean square", Colour::Blue, Mark::LineAndDots, means),
    ];
    Chart::new("Predicted against simulated", [over_rounds(rounds), y], series)
}

/// The largest number of targets with names in the legend.
const NAMED: usize = 8;

fn best(rounds: &[Round]) -> Chart {
    let mut targets: Vec<&str> = Vec::new();
    for (name, _) in rounds.iter().flat_map(|round| &round.best) {
        if !targets.contains(&name.as_str()) {
            targets.push(name);
        }
    }
    let values: Vec<f64> = rounds.iter().flat_map(|round| &round.best).map(|(_, mm)| *mm).collect();
    let line = |(target, colour): (&&str, Colour)| {
        let of_round = |(round, found): (f64, &Round)| {
            let best = found.best.iter().find(|(name, _)| name == target)?;
            Some((round, best.1))
        };
        let points = (1..).map(f64::from).zip(rounds).filter_map(of_round).collect();
        let name = if targets.len() <= NAMED { *target } else { "" };
        Series::new(name, colour, Mark::LineAndDots, points)
    };
    let series = Series::coloured(&targets).map(line).collect();
    let axes = [over_rounds(rounds), Axis::above("Displacement [mm]", &values)];
    Chart::new("Best design of each target, simulated", axes, series)
}

/// Draws the charts on a sheet.
///
/// # Errors
/// If there is no round, or a number is not finite.
pub fn rounds_sheet(rounds: &[Round]) -> Result<Sheet, FigureError> {
    Ok(Sheet::charts(2, &rounds_charts(rounds)?))
}
