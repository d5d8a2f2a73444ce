//! Load paths: displacement or force over voltage, load or a given displacement, past the loss of stability.

use deaflow_base::{four_digits, measured};

use crate::drawing::{Axis, Chart, Colour, FigureError, LARGE, MAX_NAMED, Mark, Series, Sheet};

/// The load path of one pattern. Curves have one value per point, from rest on.
#[derive(Clone, Debug)]
pub struct Branch {
    /// Its name.
    pub name: String,
    /// What changes, in the unit of its axis.
    pub along: Vec<f64>,
    /// The displacement or force, in the unit of its axis.
    pub across: Vec<f64>,
    /// Whether the state is stable.
    pub stable: Vec<bool>,
    /// The end of the stable part that starts at rest.
    pub limit: Option<Limit>,
    /// Where the electric field reaches the breakdown field on that part: what changes, and the displacement or force.
    pub breakdown: Option<[f64; 2]>,
    /// What fails before the limit.
    pub first: Option<FirstFailure>,
}

/// What fails first on a stable part, before its end.
#[derive(Clone, Debug)]
pub struct FirstFailure {
    /// What happens there.
    pub name: &'static str,
    /// What changes, in the unit of its axis.
    pub along: f64,
}

/// The end of a stable part.
#[derive(Clone, Debug)]
pub struct Limit {
    /// What happens there.
    pub name: String,
    /// What changes, in the unit of its axis.
    pub along: f64,
    /// Its error, if known.
    pub error: Option<f64>,
    /// The displacement or force, in the unit of its axis.
    pub across: f64,
}

/// The axes of load paths.
#[derive(Clone, Debug)]
pub struct PathAxes {
    /// What changes, with its unit.
    pub along: String,
    /// Its unit.
    pub unit: String,
    /// The displacement or force, with its unit.
    pub across: String,
}

impl Limit {
    /// Writes where it is, with its error and unit.
    fn place(&self, unit: &str) -> String {
        match self.error {
            Some(error) => format!("{} {unit}", measured(self.along, error)),
            None => format!("{} {unit}", four_digits(self.along)),
        }
    }
}

/// Draws curves, solid if stable and dashed if not, with the limits marked.
///
/// # Errors
/// If there are no branches, or values are missing or not finite.
fn paths_chart(branches: &[Branch], names: &PathAxes) -> Result<Chart, FigureError> {
    let incomplete = |b: &Branch| {
        let n = b.along.len();
        let numbers = b.along.iter().chain(&b.across);
        n == 0 || [b.across.len(), b.stable.len()] != [n; 2] || numbers.into_iter().any(|v| !v.is_finite())
    };
    if branches.is_empty() || branches.iter().any(incomplete) {
        return Err(FigureError::Data(
            "a load path needs a finite value at each point".into(),
        ));
    }
    // An unstable part may lead far away, where the stable one would be a flat line.
    let most = FARTHEST * branches.iter().map(Branch::stable_extent).fold(0.0, f64::max);
    let shown: Vec<Branch> = match most > 0.0 {
        true => branches.iter().map(|branch| branch.within(most)).collect(),
        false => branches.to_vec(),
    };
    let branches = &shown[..];
    let axes = [
        Axis::above(&names.along, branches.iter().flat_map(|b| &b.along)),
        Axis::above(&names.across, branches.iter().flat_map(|b| &b.across)),
    ];
    let named = (2..=MAX_NAMED).contains(&branches.len());
    let mut series = Vec::new();
    for (branch, colour) in Series::coloured(branches) {
        let name = if named { branch.name.as_str() } else { "" };
        series.extend(branch.curve(name, colour));
        series.extend(branch.mark(colour, branches.len() == 1));
    }
    series.extend(breakdown_marks(branches));
    Ok(Chart::new(title(branches, &names.unit), axes, series).with_size(LARGE))
}

/// Returns the title: what fails first, and the limit; of several paths how many fail before their limit.
fn title(branches: &[Branch], unit: &str) -> String {
    let [one] = branches else {
        let failing = branches.iter().filter(|branch| branch.first.is_some()).count();
        let before = match failing {
            0 => String::new(),
            _ => format!("; {failing} of {} fail before their limit", branches.len()),
        };
        return format!("Load paths: stable solid, unstable dashed{before}");
    };
    let first = one.first.as_ref();
    let first = first.map(|first| format!("{} at {} {unit}", first.name, four_digits(first.along)));
    let limit = one.limit.as_ref();
    let limit = limit.map(|limit| format!("{} at {}", limit.name, limit.place(unit)));
    match (first, limit) {
        (None, None) => "Load path without a limit".to_owned(),
        (Some(one), None) | (None, Some(one)) => format!("Load path: {one}"),
        (Some(first), Some(limit)) => format!("Load path: {first}, before {limit}"),
    }
}

/// The largest displacement or force that is drawn, in units of the largest one of a stable state.
const FARTHEST: f64 = 2.0;

impl Branch {
    /// Returns the largest size of a displacement or force at a stable point, and at the limit.
    fn stable_extent(&self) -> f64 {
        let stable = self.across.iter().zip(&self.stable).filter(|(_, stable)| **stable);
        let sizes = stable.map(|(across, _)| across.abs());
        sizes
            .chain(self.limit.iter().map(|limit| limit.across.abs()))
            .fold(0.0, f64::max)
    }

    /// Returns the branch up to where it first leaves a range of displacements or forces, with a point there.
    fn within(&self, most: f64) -> Self {
        let mut cut = self.clone();
        let Some(outside) = self.across.iter().position(|across| across.abs() > most) else {
            return cut;
        };
        let keep = outside.max(1);
        cut.along.truncate(keep);
        cut.across.truncate(keep);
        cut.stable.truncate(keep);
        if outside > 0 {
            let end = self.across[outside];
            let (from, to) = (self.across[outside - 1], most.copysign(end));
            let share = (to - from) / (end - from);
            cut.along
                .push(self.along[outside - 1] + share * (self.along[outside] - self.along[outside - 1]));
            cut.across.push(to);
            cut.stable.push(self.stable[outside]);
        }
        cut
    }

    /// Draws the stable and unstable parts; the first one has the name.
    fn curve(&self, name: &str, colour: Colour) -> Vec<Series> {
        let point = |k: usize| (self.along[k], self.across[k]);
        let n = self.stable.len();
        let mut runs = Vec::new();
        let mut first = 0;
        while first < n {
            let stable = self.stable[first];
            let same = self.stable[first..].iter().take_while(|s| **s == stable).count();
            // A part starts at the end of the last one, so that there is no gap.
            let points = (first.saturating_sub(1)..first + same).map(point).collect();
            let mark = if stable { Mark::Line } else { Mark::Dashed };
            runs.push(Series::new(if first == 0 { name } else { "" }, colour, mark, points));
            first += same;
        }
        runs
    }

    /// Draws the limit with its error, and its name if there is space.
    fn mark(&self, colour: Colour, named: bool) -> Vec<Series> {
        let Some(limit) = &self.limit else {
            return Vec::new();
        };
        let at = vec![(limit.along, limit.across)];
        let mut marks = vec![Series::new("", colour, Mark::Dots, at.clone())];
        if let Some(error) = limit.error {
            let ends = [limit.along - error, limit.along + error];
            let bar = ends.map(|along| (along, limit.across)).to_vec();
            marks.push(Series::new("", colour, Mark::Line, bar));
        }
        if named {
            // The curve ends at the limit of this mesh, the mark is at that of two finer meshes.
            let name = match limit.error {
                Some(_) => format!("{} (two meshes)", limit.name),
                None => limit.name.clone(),
            };
            marks.push(Series::new("", colour, Mark::Labelled, at).with_texts(vec![name]));
        }
        marks
    }
}

/// Draws where the electric field reaches the breakdown field: with words beside the mark of a single path, else with
/// an entry in the legend.
fn breakdown_marks(branches: &[Branch]) -> Vec<Series> {
    const NAME: &str = "breakdown field";
    let reached = branches.iter().filter_map(|branch| branch.breakdown);
    let at: Vec<(f64, f64)> = reached.map(|[along, across]| (along, across)).collect();
    let marks = |name: &str| Series::new(name, Colour::Vermillion, Mark::Dots, at.clone());
    match (at.is_empty(), branches) {
        (true, _) => Vec::new(),
        (false, [_]) => {
            let words = Series::new("", Colour::Vermillion, Mark::Labelled, at.clone());
            vec![marks(""), words.with_texts(vec![NAME.to_owned()])]
        }
        (false, _) => vec![marks(NAME)],
    }
}

/// Draws the paths on a sheet.
///
/// # Errors
/// If there are no branches, or values are missing or not finite.
pub fn paths_sheet(branches: &[Branch], axes: &PathAxes) -> Result<Sheet, FigureError> {
    Ok(Sheet::charts(1, &[paths_chart(branches, axes)?]))
}
