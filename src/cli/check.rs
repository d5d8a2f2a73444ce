//! `deaflow check`: shows what is read from files of patterns and labels, before anything is computed.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::arguments::DrawingArguments;
use super::pipeline::read_scene_with;
use super::text::Text;
use super::tone::{Tone, width_of_stdout};
use super::{CliError, Exit, Output, locate, table};
use deaflow_field::Field;
use deaflow_pattern::{Bits, DrawingFormat, Pattern, PictureFormat, form_of};
use deaflow_scene::Scene;
use deaflow_stage::direct::{self, NamedPatterns};

/// The width of a drawing where there is no terminal.
const WIDTH: usize = 100;

/// The largest number of islands that are listed.
const MOST_ISLANDS: usize = 5;

/// Draw patterns of files as they are read: orientation, area, islands
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow check mine.csv", "deaflow check p.mat:/p mask.png --scene scene.yaml"))]
pub struct CheckArguments {
    /// Files of patterns, as for `solve`, or with a scene files of labels, as for `import`
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<String>,
    /// The scene, which gives the cells, sides and electrode groups; without it the file gives the cells
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Override a value of the scene, such as geometry.cells=20
    #[arg(long = "set", value_name = "PATH=VALUE", requires = "scene")]
    pub sets: Vec<String>,
    #[command(flatten)]
    pub drawings: DrawingArguments,
}

/// What was read from a file.
struct CheckedFile {
    name: String,
    patterns: Vec<Pattern>,
    notes: Vec<String>,
    /// The fields of labels.
    fields: Vec<Field>,
}

pub fn execute(arguments: &CheckArguments, output: &Output) -> Result<Exit, CliError> {
    let scene = arguments
        .scene
        .as_deref()
        .map(|path| read_scene_with(path, &arguments.sets, output))
        .transpose()?;
    if let (None, Some(file)) = (
        &scene,
        arguments.files.iter().find(|file| locate::is_pipeline(Path::new(file))),
    ) {
        return Err(CliError::bad_input(format!("{file} is not a pattern")).help(format!(
            "a scene is given by --scene, as in: deaflow check PATTERN --scene {file}"
        )));
    }
    let files = arguments
        .files
        .iter()
        .map(|name| read(name, scene.as_ref(), &arguments.drawings));
    let files: Vec<CheckedFile> = files.collect::<Result<_, _>>()?;
    let document = || json!({ "files": files.iter().map(|file| file.document(scene.as_ref())).collect::<Vec<_>>() });
    output.result(document, || {
        let mut text = Text::new();
        files.iter().for_each(|file| file.add_to(&mut text, scene.as_ref()));
        text
    })?;
    Ok(Exit::Done)
}

fn read(name: &str, scene: Option<&Scene>, drawings: &DrawingArguments) -> Result<CheckedFile, CliError> {
    if let Some(labels) = scene
        .and_then(|scene| direct::labels(name, scene).transpose())
        .transpose()?
    {
        return Ok(CheckedFile {
            name: name.to_owned(),
            patterns: labels.rows.patterns,
            notes: labels.notes,
            fields: labels.rows.fields,
        });
    }
    let form = match scene {
        Some(scene) => scene.form(),
        None => form_of(name)?,
    };
    let named = direct::patterns(&[name.to_owned()], form, &drawings.options())?;
    let NamedPatterns { patterns, notes, .. } = drawings.with_hints(named);
    let own = format!("{name}: ");
    let notes = notes
        .iter()
        .map(|note| note.strip_prefix(&own).unwrap_or(note).to_owned());
    Ok(CheckedFile {
        name: name.to_owned(),
        notes: notes.collect(),
        patterns,
        fields: Vec::new(),
    })
}

impl CheckedFile {
    fn document(&self, scene: Option<&Scene>) -> Value {
        let free = scene.and_then(Scene::free_cells);
        let sides = self.patterns.first().map(|pattern| pattern.raster().sides());
        let islands = |pattern: &Pattern| {
            let islands = within(pattern, free.as_ref()).islands();
            islands.iter().map(Bits::count).collect::<Vec<_>>()
        };
        json!({
            "file": self.name,
            "columns": sides.map(|[columns, _]| columns),
            "rows": sides.map(|[_, rows]| rows),
            "notes": self.notes,
            "patterns": self.patterns.iter().map(|pattern| json!({
                "groups": pattern.groups(),
                "area": pattern.area_fraction(free.as_ref()),
                "area_mm2": scene.map(|scene| pattern.area_fraction(free.as_ref()) * scene.free_area_mm2()),
                "islands": islands(pattern),
                "rows_from_below": pattern.cells().chunks(pattern.raster().columns()).collect::<Vec<_>>(),
            })).collect::<Vec<_>>(),
            "max_displacement_mm": self.fields.iter().map(Field::max_magnitude).reduce(f64::max),
        })
    }

    fn add_to(&self, text: &mut Text, scene: Option<&Scene>) {
        let Some(first) = self.patterns.first() else { return };
        let count = table::counted(self.patterns.len() as u64, "patterns");
        text.line(format!("{}: {count} of {} cells", self.name, first.raster()));
        for note in &self.notes {
            text.toned(Tone::Caution, note.as_str());
        }
        for line in drawing(first, scene) {
            text.whole(line);
        }
        let file = Path::new(&self.name);
        if PictureFormat::of(file).is_some() || DrawingFormat::of(file) == Some(DrawingFormat::Svg) {
            text.line("the top of the picture is the upper edge of the membrane, where y is largest");
        }
        let several = if self.patterns.len() > 1 { "first pattern: " } else { "" };
        text.line(format!("{several}{}", facts(first, scene)));
        if self.patterns.len() > 1 {
            let free = scene.and_then(Scene::free_cells);
            let areas = self.patterns.iter().map(|pattern| pattern.area_fraction(free.as_ref()));
            let (least, most) = areas.fold((1.0, 0.0), |(least, most), area| {
                (f64::min(least, area), f64::max(most, area))
            });
            text.line(format!("area of all: {:.1} % to {:.1} %", 100.0 * least, 100.0 * most));
        }
        if let Some(largest) = self.fields.iter().map(Field::max_magnitude).reduce(f64::max) {
            text.line(format!("displacement fields: up to {largest:.3} mm"));
        }
    }
}

/// The pattern without what lies on frame and bodies, where electrodes have no effect.
fn within(pattern: &Pattern, free: Option<&Bits>) -> Pattern {
    free.map_or_else(|| pattern.clone(), |free| pattern.within(free))
}

/// Area, groups and islands of a pattern.
fn facts(pattern: &Pattern, scene: Option<&Scene>) -> String {
    let free = scene.and_then(Scene::free_cells);
    let all = free.as_ref().map_or(pattern.raster().cells(), Bits::count);
    let fraction = pattern.area_fraction(free.as_ref());
    let cells = (fraction * all as f64).round();
    let mut facts = format!("area {:.2} % ({cells} of {all} cells)", 100.0 * fraction);
    if let Some(scene) = scene {
        facts += &format!(", {:.1} mm²", fraction * scene.free_area_mm2());
    }
    let off = pattern.active_cells() - cells as usize;
    if off > 0 {
        facts += &format!(", {off} cells on frame and bodies without effect");
    }
    let pattern = &within(pattern, free.as_ref());
    for group in 1..=pattern.groups().min(Pattern::MOST_GROUPS) {
        if pattern.groups() > 1 {
            let cells = pattern
                .cells()
                .iter()
                .filter(|cell| usize::from(**cell) == group)
                .count();
            facts += &format!(", group {group}: {cells} cells");
        }
    }
    let islands = pattern.islands();
    let place = |island: &Bits| {
        let [columns, rows] = island.sides();
        let span = |length: usize, is_at: &dyn Fn(usize) -> bool| {
            let mut at = (0..length).filter(|at| is_at(*at));
            let first = at.next().unwrap_or(0);
            (first, at.last().unwrap_or(first))
        };
        let (left, right) = span(columns, &|x| (0..rows).any(|y| island.has(x, y)));
        let (low, high) = span(rows, &|y| (0..columns).any(|x| island.has(x, y)));
        format!(
            "{} cells at columns {left} to {right}, rows {low} to {high}",
            island.count()
        )
    };
    let mut shown: Vec<String> = islands.iter().take(MOST_ISLANDS).map(place).collect();
    if islands.len() > MOST_ISLANDS {
        shown.push(format!("and {} more", islands.len() - MOST_ISLANDS));
    }
    let shown = shown.join("; ");
    match islands.len() {
        0 => facts + "; no islands",
        1 => format!("{facts}; 1 island: {shown}"),
        n => format!("{facts}; {n} islands: {shown}"),
    }
}

/// Draws a pattern with y upwards, in a frame with the lengths of its sides: cells, or mm with a scene.
fn drawing(pattern: &Pattern, scene: Option<&Scene>) -> Vec<String> {
    let raster = pattern.raster();
    let [columns, rows] = raster.sides();
    let room = width_of_stdout().unwrap_or(WIDTH).saturating_sub(12).max(20);
    let step = columns.div_ceil(room);
    let (across, down) = (columns.div_ceil(step), rows.div_ceil(step));
    // The group that has most of the cells behind a character.
    let group = |x: usize, y: usize| {
        let mut counts = [0; Pattern::MOST_GROUPS + 1];
        for y in y * step..((y + 1) * step).min(rows) {
            for x in x * step..((x + 1) * step).min(columns) {
                counts[usize::from(pattern.group(x, y)).min(Pattern::MOST_GROUPS)] += 1;
            }
        }
        (0..counts.len()).max_by_key(|group| counts[*group]).unwrap_or(0)
    };
    let lines: Vec<String> = if pattern.groups() > 1 {
        let letter = |group: usize| char::from_digit(group as u32, 36).filter(|_| group > 0).unwrap_or('·');
        (0..down)
            .rev()
            .map(|y| (0..across).map(|x| letter(group(x, y))).collect())
            .collect()
    } else {
        // Two rows to a character, which is about twice as high as wide.
        let half = |x: usize, y: usize| match (y + 1 < down && group(x, y + 1) > 0, group(x, y) > 0) {
            (true, true) => '█',
            (true, false) => '▀',
            (false, true) => '▄',
            (false, false) => ' ',
        };
        (0..down)
            .step_by(2)
            .rev()
            .map(|y| (0..across).map(|x| half(x, y)).collect())
            .collect()
    };
    let (unit, [right, top]) = match scene {
        Some(scene) => ("mm", scene.membrane().size_mm.map(|side| side.to_string())),
        None => ("cells", raster.sides().map(|side| side.to_string())),
    };
    let margin = top.len();
    let mut drawn = vec![format!("{:margin$} ┌{}┐ y in {unit}", top, "─".repeat(across))];
    drawn.extend(lines.iter().map(|line| format!("{:margin$} │{line}│", "")));
    drawn.push(format!("{:>margin$} └{}┘", 0, "─".repeat(across)));
    let end = format!("{right} x in {unit}");
    drawn.push(format!(
        "{:margin$}  0{end:>width$}",
        "",
        width = across.saturating_sub(1).max(end.len() + 1)
    ));
    if step > 1 {
        drawn.push(format!(
            "a character shows {step} × {} cells",
            if pattern.groups() > 1 { step } else { 2 * step }
        ));
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    #[test]
    fn a_pattern_is_drawn_with_the_first_row_at_the_bottom() {
        let raster = Raster::new(6, 5).unwrap();
        let pattern = Pattern::from_fn(raster, |x, y| x < 2 && y == 0 || x == 5 && y > 2);
        assert_eq!(
            drawing(&pattern, None),
            [
                "5 ┌──────┐ y in cells",
                "  │     ▄│",
                "  │     ▀│",
                "  │▄▄    │",
                "0 └──────┘",
                "   0 6 x in cells",
            ]
        );
        assert_eq!(
            facts(&pattern, None),
            "area 13.33 % (4 of 30 cells); 2 islands: 2 cells at columns 0 to 1, rows 0 to 0; \
             2 cells at columns 5 to 5, rows 3 to 4"
        );
        let groups = Pattern::from_groups(raster, |x, y| if y == 4 { (x % 3) as u8 } else { 0 });
        assert_eq!(drawing(&groups, None)[1], "  │·12·12│");
        assert!(facts(&groups, None).contains("group 1: 2 cells, group 2: 2 cells"));
    }

    #[test]
    fn electrodes_on_frame_and_bodies_do_not_count() {
        let text = "{ geometry: { side: 8 mm, thickness: 1 mm, prestretch: 3, cells: 8, frame: { opening: { rectangle: \
                    [[2 mm, 0 mm], [8 mm, 8 mm]] } } }, material: { model: neo-hookean, shear_modulus: 45 kPa, \
                    relative_permittivity: 4.7 }, drive: { voltages: [1 kV, 2 kV] } }";
        let scene = Scene::from_text(text).unwrap();
        let pattern = Pattern::from_groups(scene.membrane().raster, |x, y| {
            u8::from(y < 2) + u8::from(x < 3 && y < 1)
        });
        assert_eq!(
            facts(&pattern, Some(&scene)),
            "area 25.00 % (12 of 48 cells), 12.0 mm², 4 cells on frame and bodies without effect, group 1: 11 cells, \
             group 2: 1 cells; 1 island: 12 cells at columns 2 to 7, rows 0 to 1"
        );
    }

    #[test]
    fn a_wide_pattern_is_drawn_with_several_cells_to_a_character() {
        let raster = Raster::new(400, 4).unwrap();
        let pattern = Pattern::from_fn(raster, |x, _| x < 200);
        let drawn = drawing(&pattern, None);
        assert!(drawn.iter().all(|line| line.chars().count() <= WIDTH), "{drawn:?}");
        assert!(
            drawn.last().unwrap().starts_with("a character shows 5 × 10 cells"),
            "{drawn:?}"
        );
    }
}
