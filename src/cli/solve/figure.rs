//! `--figure` of `deaflow solve`: patterns with their displacements.

use std::path::{Path, PathBuf};

use super::simulation::Simulation;
use crate::point::Probe;
use crate::{Output, write};
use deaflow_field::Field;
use deaflow_report::figures::{Background, DeformedMembrane, FigureError, membranes_sheet};

/// The largest number of membranes in a figure.
const MOST: usize = 6;

/// A pattern in one state, with what was found.
pub struct Membrane<'a> {
    /// Its number among the patterns.
    pub index: usize,
    /// The name of the state, if there are several.
    pub state: Option<String>,
    /// The displacement; `None` without a stable solution.
    pub displacement: Option<&'a Field>,
    /// The heights of the corners of cells in mm, if it is in space.
    pub heights: Option<&'a [f64]>,
}

/// Draws membranes into the file that the command line names, if it does; returns the file. Those without a stable
/// solution are left out.
pub fn draw(
    simulation: &Simulation<'_>,
    membranes: &[Membrane<'_>],
    probe: Option<&Probe>,
    output: &Output,
) -> Option<PathBuf> {
    let file = simulation.arguments.figure.clone()?;
    let background = Background::of(&simulation.scene);
    let drawn = |membrane: &Membrane<'_>| {
        let field = membrane.displacement?;
        let cells = simulation.patterns[membrane.index].cells();
        let points = probe.iter().map(|probe| probe.point_mm).collect();
        let drawn = DeformedMembrane::new(cells, field.values(), background.clone(), points);
        let name = &simulation.names[membrane.index];
        Some(drawn.map(|drawn| {
            let drawn = drawn.in_state(membrane.state.clone()).with_heights(membrane.heights);
            (name.clone(), drawn)
        }))
    };
    let stable = membranes
        .iter()
        .filter(|membrane| membrane.displacement.is_some())
        .count();
    if stable > MOST {
        output.warn(format_args!("the figure has the first {MOST} of {stable} membranes"));
    }
    let draw = |file: &Path| {
        let found = membranes.iter().filter_map(drawn).take(MOST);
        let found = found.collect::<Result<Vec<_>, FigureError>>()?;
        if found.is_empty() {
            return Err(FigureError::Data("no pattern has a stable solution".to_owned()));
        }
        membranes_sheet(&found).write_png(file)
    };
    write::drawn(file, draw, output)
}
