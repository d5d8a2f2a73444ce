//! A front: its first objective against each other one, with designs beside the points, and the hypervolume over the
//! search.

use maud::{Markup, html};

use crate::drawing::{Axis, Background, Chart, Colour, FigureError, LARGE, Mark, Series, Sheet, THOUSAND};
use crate::format::{capitalised, mm, three};
use deaflow_pattern::Pattern;

/// A front of designs.
#[derive(Clone, Debug)]
pub struct FrontFigure {
    /// The designs.
    pub designs: Vec<FrontDesign>,
    /// The membrane that they are drawn on.
    pub background: Background,
    /// The objectives.
    pub axes: Vec<FrontAxis>,
    /// The unit of hypervolumes.
    pub volume_unit: String,
    /// The number of simulated patterns and the hypervolume, whenever it grew.
    pub history: Vec<(u64, f64)>,
}

/// An objective of a front.
#[derive(Clone, Debug)]
pub struct FrontAxis {
    /// Its name on an axis.
    pub name: String,
    /// The unit of its values.
    pub unit: String,
    /// What it is, for the note of a chart.
    pub objective: String,
}

/// A design of a front.
#[derive(Clone, Debug)]
pub struct FrontDesign {
    /// Its name.
    pub name: String,
    /// The values of the objectives.
    pub values: Vec<f64>,
    /// Its electrode.
    pub pattern: Pattern,
}

/// Space of a design beside its point, and its distance from the point, in pixels.
const SIDE: f64 = 54.0;
const GAP: f64 = 7.0;

/// Space below the frame for ticks and labels, and beside it, in a chart: what is not the frame.
const AROUND: [f64; 2] = [70.0, 72.0];

/// Draws the first objective against each other one, and below it the hypervolume over the simulated patterns.
///
/// # Errors
/// If there is no design, or a number is not finite.
pub fn front_charts(data: &FrontFigure) -> Result<Vec<Chart>, FigureError> {
    let numbers = data.designs.iter().flat_map(|design| design.values.iter().copied());
    let grown = data.history.iter().map(|(_, reached)| *reached);
    let are_complete = data.designs.iter().all(|design| design.values.len() == data.axes.len());
    let is_empty = data.designs.is_empty() || data.axes.len() < 2 || !are_complete;
    if is_empty || numbers.chain(grown).any(|number| !number.is_finite()) {
        return Err(FigureError::Data("a front needs designs and finite numbers".into()));
    }
    let mut charts: Vec<Chart> = (1..data.axes.len()).map(|other| front(data, other)).collect();
    charts.extend((data.history.len() > 1).then(|| growth(data)));
    Ok(charts)
}

/// The first objective against another one.
fn front(data: &FrontFigure, other: usize) -> Chart {
    let points = data
        .designs
        .iter()
        .map(|design| (design.values[other], design.values[0]));
    let points: Vec<(f64, f64)> = points.collect();
    let (first, second) = (&data.axes[0], &data.axes[other]);
    let axis = |of: &FrontAxis, values: Vec<f64>| {
        let label = capitalised(&format!("{} [{}]", of.name, of.unit));
        match values.iter().all(|value| *value >= 0.0) {
            true => Axis::above(&label, &values),
            false => Axis::between(&label, &values),
        }
    };
    let x = axis(second, points.iter().map(|(x, _)| *x).collect());
    let y = axis(first, points.iter().map(|(_, y)| *y).collect());
    let frame = [0, 1].map(|axis| LARGE[axis] - AROUND[axis]);
    let at = |&(cost, value): &(f64, f64)| [frame[0] * x.fraction(cost), frame[1] * (1.0 - y.fraction(value))];
    let places = beside(&points.iter().map(at).collect::<Vec<_>>(), frame);
    let pixels = frame.map(|side| THOUSAND / side);
    let drawn = places.iter().zip(&data.designs).filter_map(|(place, design)| {
        let [left, top] = (*place)?;
        let scale = [0, 1].map(|axis| pixels[axis] * SIDE / THOUSAND);
        let moved = format!(
            "translate({:.1} {:.1}) scale({:.5} {:.5})",
            pixels[0] * left,
            pixels[1] * top,
            scale[0],
            scale[1]
        );
        Some(html! { g transform=(moved) { (thumbnail(data, design)) } })
    });
    let inside = html! { @for design in drawn { (design) } };
    let texts = data.designs.iter().map(|design| {
        let others = data.axes.iter().zip(&design.values).skip(1);
        let others = others.map(|(axis, value)| format!("{} {} {}", axis.name, three(*value), axis.unit));
        let others = others.collect::<Vec<_>>().join(", ");
        format!("{}: {} {} at {others}", design.name, mm(design.values[0]), first.unit)
    });
    // With three objectives, the points are on a surface.
    let mark = if data.axes.len() == 2 {
        Mark::LineAndDots
    } else {
        Mark::Dots
    };
    let series = Series::new("", Colour::Blue, mark, points).with_texts(texts.collect());
    let title = format!("Front: {} against {}", first.name, second.name);
    let mut chart = Chart::new(title, [x, y], vec![series]).with_size(LARGE);
    let described = [first, second].into_iter().filter(|axis| axis.objective != axis.name);
    let notes: Vec<String> = described
        .map(|axis| format!("{}: {}", axis.name, axis.objective))
        .collect();
    if !notes.is_empty() {
        chart = chart.with_note(notes.join("; "));
    }
    chart.inside = Some(inside);
    chart
}

fn thumbnail(data: &FrontFigure, design: &FrontDesign) -> Markup {
    html! { g.membrane { (data.background.draw_frame()) (data.background.electrode_at_rest(&design.pattern)) } }
}

/// Returns the upper left corners of drawings beside points, in a frame: to the lower right of each point, or to its
/// upper left where there is no space; `None` where a drawing would cover another one.
fn beside(points: &[[f64; 2]], frame: [f64; 2]) -> Vec<Option<[f64; 2]>> {
    let mut taken: Vec<[f64; 2]> = Vec::new();
    let place = |&[x, y]: &[f64; 2]| {
        let corners = [
            [x + GAP, y + GAP],
            [x - GAP - SIDE, y - GAP - SIDE],
            [x - 0.5 * SIDE, y + 2.0 * GAP],
        ];
        let fits = |corner: &[f64; 2]| {
            let inside = (0..2).all(|axis| corner[axis] >= 0.0 && corner[axis] + SIDE <= frame[axis]);
            let is_over = |point: &[f64; 2]| {
                (0..2).all(|axis| point[axis] > corner[axis] - 4.0 && point[axis] < corner[axis] + SIDE + 4.0)
            };
            let covers = |other: &[f64; 2]| (0..2).all(|axis| (corner[axis] - other[axis]).abs() < SIDE + 3.0);
            inside && !points.iter().any(is_over) && !taken.iter().any(covers)
        };
        let found = corners.into_iter().find(fits);
        taken.extend(found);
        found
    };
    points.iter().map(place).collect()
}

fn growth(data: &FrontFigure) -> Chart {
    let points: Vec<(f64, f64)> = data
        .history
        .iter()
        .map(|(count, reached)| (*count as f64, *reached))
        .collect();
    let last = points.last().map_or((0.0, 0.0), |last| *last);
    let axes = [
        Axis::counting("Simulated patterns", 0.0, last.0.max(1.0)),
        Axis::above(
            &format!("Hypervolume [{}]", data.volume_unit),
            points.iter().map(|(_, reached)| reached),
        ),
    ];
    let series = Series::new("", Colour::Blue, Mark::LineAndDots, points);
    Chart::new("Hypervolume over the search", axes, vec![series])
        .with_note(format!("ends at {} {}", mm(last.1), data.volume_unit))
        .with_size([LARGE[0], 190.0])
}

/// Draws the charts on a sheet.
///
/// # Errors
/// If there is no design, or a number is not finite.
pub fn front_sheet(data: &FrontFigure) -> Result<Sheet, FigureError> {
    Ok(Sheet::charts(1, &front_charts(data)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    fn axis(name: &str, unit: &str) -> FrontAxis {
        FrontAxis {
            name: name.to_owned(),
            unit: unit.to_owned(),
            objective: name.to_owned(),
        }
    }

    fn figure(designs: &[(f64, f64)]) -> FrontFigure {
        let design = |(at, &(cost, gain)): (usize, &(f64, f64))| FrontDesign {
            name: format!("front-{}", at + 1),
            values: vec![gain, cost],
            pattern: Pattern::from_fn(Raster::PAPER, |x, _| x < at + 1),
        };
        FrontFigure {
            designs: designs.iter().enumerate().map(design).collect(),
            background: Background::paper(),
            axes: vec![axis("displacement", "mm"), axis("area", "%")],
            volume_unit: "mm".to_owned(),
            history: vec![(3, 0.1), (8, 0.4)],
        }
    }

    #[test]
    fn designs_stand_beside_their_points() {
        let known = [1.0346, 1.3996, 1.6657, 1.8284, 1.9757, 2.1008, 2.1764, 2.2229, 2.2406];
        let front: Vec<(f64, f64)> = (1..).map(|k| 4.0 * f64::from(k)).zip(known).collect();
        let charts = front_charts(&figure(&front)).unwrap();
        assert_eq!(charts.len(), 2);
        let drawn = charts[0].figure().into_string();
        assert_eq!(drawn.matches("class=\"membrane\"").count(), 9, "{drawn}");
        assert!(drawn.contains("front-9: 2.241 mm at area 36.0 %"), "{drawn}");
    }

    #[test]
    fn three_objectives_have_two_charts() {
        let mut three = figure(&[(4.0, 1.0), (8.0, 1.4)]);
        three.axes.push(axis("third objective", "mm"));
        assert!(front_charts(&three).is_err(), "a value is missing");
        let more = three.designs.iter_mut().zip([-0.2, -0.4]);
        more.for_each(|(design, value)| design.values.push(value));
        let charts = front_charts(&three).unwrap();
        assert_eq!(charts.len(), 3);
        let drawn = charts[1].figure().into_string();
        assert!(
            drawn.contains("front-2: 1.400 mm at area 8.00 %, third objective −0.400 mm"),
            "{drawn}"
        );
        // An objective is named on the axis, and described beside the title.
        assert_eq!(charts[1].note, "");
        three.axes[2].objective = "displacement of (35, 25) mm by (0, 0) mm".to_owned();
        let described = &front_charts(&three).unwrap()[1];
        assert_eq!(described.title, "Front: displacement against third objective");
        assert_eq!(
            described.note,
            "third objective: displacement of (35, 25) mm by (0, 0) mm"
        );
    }

    #[test]
    fn drawings_cover_neither_each_other_nor_points() {
        let many: Vec<(f64, f64)> = (1..=60).map(|k| (0.01 * f64::from(k), (f64::from(k)).sqrt())).collect();
        let charts = front_charts(&figure(&many)).unwrap();
        let drawn = charts[0].figure().into_string().matches("class=\"membrane\"").count();
        assert!((5..30).contains(&drawn), "{drawn}");
        assert!(front_charts(&figure(&[])).is_err());
        assert!(front_charts(&figure(&[(0.1, f64::NAN)])).is_err());
    }
}
