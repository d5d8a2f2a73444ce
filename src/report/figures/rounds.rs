//! Designs that are verified round by round: how well they were predicted, and how good they are.

use std::path::Path;

use plotters::prelude::*;

use super::axes::{Axis, Entry, line, panel};
use super::canvas::{Area, FigureError, draw, palette, px};

/// What one round came to.
#[derive(Clone, Debug)]
pub struct Round {
    /// |predicted − simulated| / |simulated| of each design.
    pub differences: Vec<f64>,
    /// The best simulated displacement of each target in mm, by its name.
    pub best: Vec<(String, f64)>,
}

const COLOURS: [RGBColor; 6] = [
    palette::BLUE,
    palette::VERMILLION,
    palette::GREEN,
    palette::ORANGE,
    palette::SKY,
    palette::PURPLE,
];

/// Draws the differences of all designs and their root mean square, and the best of each target, over the rounds.
///
/// # Errors
/// When there is no round, a number is not finite, or the file cannot be written.
pub fn draw_rounds(path: &Path, rounds: &[Round]) -> Result<(), FigureError> {
    let numbers = |round: &Round| {
        let best = round.best.iter().map(|(_, mm)| *mm);
        round.differences.iter().copied().chain(best).collect::<Vec<f64>>()
    };
    if rounds.is_empty() || rounds.iter().flat_map(numbers).any(|value| !value.is_finite()) {
        return Err(FigureError::Data("rounds need finite numbers".into()));
    }
    draw(path, (1500, 620), |sheet| {
        let halves = sheet.split_evenly((1, 2));
        differences(&halves[0], rounds)?;
        best(&halves[1], rounds)
    })
}

fn over_rounds(rounds: &[Round]) -> Axis {
    Axis::counting("Round", 0.5, rounds.len() as f64 + 0.5)
}

fn differences(area: &Area<'_>, rounds: &[Round]) -> Result<(), FigureError> {
    let percent: Vec<Vec<f64>> = rounds
        .iter()
        .map(|round| round.differences.iter().map(|share| 100.0 * share).collect())
        .collect();
    let y = Axis::logarithmic("|predicted − simulated| / simulated [%]", percent.iter().flatten());
    let entries = [("each design", palette::SKY), ("root mean square", palette::BLUE)];
    let mut panel = panel(area, "Predicted against simulated", &entries, &over_rounds(rounds), &y)?;
    let mut means = Vec::new();
    for (round, values) in (1..).map(f64::from).zip(&percent) {
        let dots = values.iter().filter(|value| y.shows(**value));
        panel.draw_series(dots.map(|value| Circle::new((round, *value), px(4), palette::SKY.filled())))?;
        let squares: f64 = values.iter().map(|value| value * value).sum();
        let rms = (squares / values.len().max(1) as f64).sqrt();
        means.extend(y.shows(rms).then_some((round, rms)));
    }
    line(&mut panel, palette::BLUE, means)
}

fn best(area: &Area<'_>, rounds: &[Round]) -> Result<(), FigureError> {
    let mut targets: Vec<&str> = Vec::new();
    for (name, _) in rounds.iter().flat_map(|round| &round.best) {
        if !targets.contains(&name.as_str()) {
            targets.push(name);
        }
    }
    let values: Vec<f64> = rounds.iter().flat_map(|round| &round.best).map(|(_, mm)| *mm).collect();
    let y = Axis::above("Displacement [mm]", &values);
    // Names of more targets than there are colours would fill the panel.
    let entries: Vec<Entry<'_>> = match targets.len() {
        2..=4 => targets.iter().copied().zip(COLOURS).collect(),
        _ => Vec::new(),
    };
    let title = "Best design of each target, simulated";
    let mut panel = panel(area, title, &entries, &over_rounds(rounds), &y)?;
    for (target, colour) in targets.iter().zip(COLOURS.into_iter().cycle()) {
        let of_round = |(round, found): (f64, &Round)| {
            let best = found.best.iter().find(|(name, _)| name == target)?;
            Some((round, best.1))
        };
        let points = (1..).map(f64::from).zip(rounds).filter_map(of_round).collect();
        line(&mut panel, colour, points)?;
    }
    Ok(())
}
