//! Patterns of drawn regions: the cells whose centre lies in the region of an electrode group, and the exact edges if
//! elements follow them.

use std::path::Path;
use std::sync::Arc;

use super::bits::Bits;
use super::contour::{Contour, Contours};
use super::coverage::Coverage;
use super::drawing::{DrawingFormat, DrawingOptions, read_drawing};
use super::electrodes::Electrodes;
use super::file::{FilePatterns, PatternFileError};
use super::membrane::Membrane;
use super::polygons::Polygons;
use super::raster::{Pattern, PatternForm};
use super::region::Region;
use deaflow_base::four_digits;

/// The share of a cell by which groups may overlap: their areas are known to 1e-6 mm along the contours.
const ROUNDING: f64 = 1e-3;

/// The largest number of contours of which is told whether they contain a cell.
const MOST_CONTOURS: usize = 2000;

deaflow_base::words! {
    /// How the edges of drawn electrodes are followed.
    pub enum Edges {
        /// Elements follow the edges.
        Fitted = "fitted",
        /// A cell has the share of it that shapes cover.
        Coverage = "coverage",
        /// A cell has an electrode if its centre is in a shape.
        Cells = "cells",
    }
}

/// The region of an electrode group.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupRegion {
    /// The number of the group, from 1.
    pub group: usize,
    /// Where its electrodes are, in mm.
    pub region: Region,
}

/// Reads the pattern of a drawing.
pub(super) fn read(
    path: &Path,
    format: DrawingFormat,
    form: PatternForm,
    options: &DrawingOptions,
) -> Result<FilePatterns, PatternFileError> {
    let mut notes = Vec::new();
    let mut regions = Vec::new();
    for (group, drawing) in read_drawing(path, format, options)? {
        notes.extend(drawing.notes.iter().cloned());
        let filled = drawing.filled.into_iter().map(Region::Contours).collect();
        let region = Region::Union(filled);
        regions.push(GroupRegion { group, region });
    }
    let (pattern, of_areas) = pattern_of(&regions, form, options.edges)?;
    let mut read = FilePatterns::new(vec![pattern]);
    read.notes.extend(notes.into_iter().chain(of_areas));
    if let (Edges::Cells, Some(membrane)) = (options.edges, form.membrane()) {
        read.shapes = shapes_within_cells(&regions, &read.patterns[0], membrane).map(Arc::new);
    }
    Ok(read)
}

/// Returns the exact shapes of groups, unless they are those of the cells of a pattern.
fn shapes_within_cells(regions: &[GroupRegion], pattern: &Pattern, membrane: Membrane) -> Option<Electrodes> {
    let shapes = electrodes(regions, membrane);
    let [width, height] = membrane.cell_mm();
    let is_of_cells = |(group, region): &(u8, Polygons)| {
        let cells = Polygons::of_cells(&Bits::of(&pattern.of_group(*group)), membrane);
        cells.is_within(ROUNDING * width * height, region)
    };
    (!shapes.groups().iter().all(is_of_cells)).then_some(shapes)
}

/// The error for a drawing where the cells must follow from the file.
pub(super) fn no_cells() -> PatternFileError {
    PatternFileError::new("a drawing has no cells").help("name the scene, which gives size and cells of the membrane")
}

/// The error for a file of cells where elements shall follow shapes.
pub(super) fn no_shapes() -> PatternFileError {
    PatternFileError::new("elements can follow the edges of drawings alone")
        .help("allowed with fitted edges: .dxf, .svg, and artifacts of a store; of other files the cells are read")
}

/// The error for a file of whole cells where parts of cells shall be covered.
pub(super) fn no_shares() -> PatternFileError {
    PatternFileError::new("drawings and pictures alone cover parts of cells").help(
        "allowed with edges by coverage: .dxf, .svg, pictures, and artifacts of a store; of other files the cells are \
         read",
    )
}

/// Returns the pattern of the regions of electrode groups, and notes on their areas.
///
/// # Errors
/// When the size of the membrane is not known, a region does not reach it or has a mask of other cells, a group is not
/// one of the device, or groups overlap; by coverage also when a cell has parts of two groups.
pub fn pattern_of(
    regions: &[GroupRegion],
    form: PatternForm,
    edges: Edges,
) -> Result<(Pattern, Vec<String>), PatternFileError> {
    let membrane = form.membrane().ok_or_else(no_cells)?;
    let areas = regions.iter().map(|own| areas(own, form, membrane));
    let areas = areas.collect::<Result<Vec<_>, _>>()?;
    let drawn: Vec<Bits> = regions.iter().map(|own| own.region.cells(membrane)).collect();
    check_overlaps(regions, &drawn, membrane)?;
    let group = |x: usize, y: usize| {
        let own = drawn.iter().position(|cells| cells.has(x, y));
        own.map_or(0, |at| regions[at].group as u8)
    };
    let [columns, rows] = form.raster.sides();
    let cells: Vec<u8> = (0..rows)
        .flat_map(|y| (0..columns).map(move |x| (x, y)))
        .map(|(x, y)| group(x, y))
        .collect();
    let pattern = Pattern::of_form(form, &cells).map_err(|error| PatternFileError::new(error.to_string()))?;
    let pattern = match edges {
        Edges::Cells => pattern,
        Edges::Fitted => pattern.with_electrodes(Some(Arc::new(electrodes(regions, membrane)))),
        Edges::Coverage => covered(&electrodes(regions, membrane), membrane)?,
    };
    let is_several = regions.iter().any(|own| own.group != regions[0].group);
    let notes = regions.iter().zip(areas).zip(&drawn).flat_map(|((own, areas), cells)| {
        let name = if is_several {
            format!("group {}: ", own.group)
        } else {
            String::new()
        };
        let notes = areas.map(|areas| match edges {
            Edges::Cells => notes(&own.region, areas, cells, membrane),
            Edges::Fitted | Edges::Coverage => outside(areas).into_iter().collect(),
        });
        notes
            .unwrap_or_default()
            .into_iter()
            .map(move |note| format!("{name}{note}"))
    });
    Ok((pattern, notes.collect()))
}

/// Returns the exact shapes of groups.
fn electrodes(regions: &[GroupRegion], membrane: Membrane) -> Electrodes {
    let groups: Vec<_> = regions
        .iter()
        .map(|own| (own.group as u8, own.region.polygons(membrane)))
        .collect();
    Electrodes::new(&groups, membrane.size_mm)
}

/// Returns the pattern of the share of each cell that electrodes cover.
fn covered(electrodes: &Electrodes, membrane: Membrane) -> Result<Pattern, PatternFileError> {
    let coverage = Coverage::of_regions(electrodes.groups(), membrane).map_err(|error| {
        PatternFileError::new(error.to_string())
            .help("a cell can be covered by one group: leave a gap of a cell, use more cells, or `edges: fitted`")
    })?;
    Ok(Pattern::of_coverage(coverage))
}

/// What is drawn, and what of it lies on the membrane, in mm².
#[derive(Clone, Copy)]
struct Areas {
    drawn: f64,
    within: f64,
}

/// Returns the areas of a region; `None` if it has a mask.
fn areas(own: &GroupRegion, form: PatternForm, membrane: Membrane) -> Result<Option<Areas>, PatternFileError> {
    let GroupRegion { group, region } = own;
    if !(1..=form.groups).contains(group) {
        let allowed = match form.groups {
            1 => "allowed: 1; the scene has one voltage".to_owned(),
            groups => format!("allowed: 1 to {groups}, as the scene has voltages"),
        };
        return Err(PatternFileError::new(format!("found electrode group {group}")).help(allowed));
    }
    if let Some(found) = region.other_raster(form.raster) {
        let raster = form.raster;
        return Err(
            PatternFileError::new(format!("a mask has {found} cells, but the membrane has {raster}"))
                .help("a mask needs one value for each cell of the membrane"),
        );
    }
    let (Some(drawn), Some([low, high])) = (region.area_mm2(), region.bounds()) else {
        return Ok(None);
    };
    let size = membrane.size_mm;
    let is_inside = (0..2).all(|axis| low[axis] >= 0.0 && high[axis] <= size[axis]);
    let within = if is_inside {
        drawn
    } else {
        region.area_within_mm2(size).unwrap_or_default()
    };
    if within > 0.0 {
        return Ok(Some(Areas { drawn, within }));
    }
    let place = |[x, y]: [f64; 2]| format!("({}, {})", four_digits(x), four_digits(y));
    Err(PatternFileError::new(format!(
        "nothing of it lies on the membrane of {}: it reaches from {} to {} mm",
        membrane.size_text(),
        place(low),
        place(high)
    ))
    .help(
        "check its unit, or move it by `origin` (`--origin` of commands): where the origin of the drawing lies on the \
         membrane",
    ))
}

/// Refuses groups that overlap by more than their borders.
fn check_overlaps(regions: &[GroupRegion], drawn: &[Bits], membrane: Membrane) -> Result<(), PatternFileError> {
    let [width, height] = membrane.cell_mm();
    for (at, one) in regions.iter().enumerate() {
        let others = regions.iter().enumerate().skip(at + 1);
        for (other, two) in others.filter(|(_, two)| two.group != one.group) {
            let common = Region::Intersection(vec![one.region.clone(), two.region.clone()]);
            let area = match common.area_mm2() {
                Some(area) => area,
                None => drawn[at].and(&drawn[other]).count() as f64 * width * height,
            };
            if area > ROUNDING * width * height {
                return Err(PatternFileError::new(format!(
                    "groups {} and {} overlap by {} mm²",
                    one.group,
                    two.group,
                    four_digits(area)
                ))
                .help("leave what they share out of one of them, by `without`, or in the drawing"));
            }
        }
    }
    Ok(())
}

/// Says how much of what is drawn lies outside the membrane.
fn outside(Areas { drawn, within }: Areas) -> Option<String> {
    let outside = drawn - within;
    (outside > 1e-6 * drawn).then(|| {
        format!(
            "{} of {} mm² lie outside the membrane",
            four_digits(outside),
            four_digits(drawn)
        )
    })
}

/// Says how the area of cells differs from what is drawn.
fn notes(region: &Region, areas: Areas, cells: &Bits, membrane: Membrane) -> Vec<String> {
    let [width, height] = membrane.cell_mm();
    let (of_cells, within) = (cells.count() as f64 * width * height, areas.within);
    let mut notes: Vec<String> = outside(areas).into_iter().collect();
    let percent = 100.0 * (of_cells / within - 1.0);
    notes.push(format!(
        "read by the centres of cells: {} mm² are drawn on the membrane, the cells have {} mm² ({percent:+.2} %)",
        four_digits(within),
        four_digits(of_cells)
    ));
    let contours = region.all_contours();
    if contours.len() <= MOST_CONTOURS {
        let has_none = |contour: &&Contour| {
            let alone = Region::Contours(Contours::one((*contour).clone()));
            alone.cells(membrane).is_empty()
        };
        match contours.iter().filter(has_none).count() {
            0 => {}
            lost => notes.push(format!(
                "{lost} of {} contours contain no centre of a cell, which are {} × {} mm",
                contours.len(),
                four_digits(width),
                four_digits(height)
            )),
        }
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Raster;
    use std::f64::consts::PI;

    fn form(groups: usize) -> PatternForm {
        let membrane = Membrane {
            raster: Raster::new(10, 10).unwrap(),
            size_mm: [10.0, 10.0],
        };
        PatternForm::on(&membrane, groups)
    }

    fn disc(x: f64, y: f64, radius: f64) -> Region {
        Region::Contours(Contours::one(Contour::ellipse([x, y], [radius; 2], 0.0)))
    }

    fn of(regions: &[(usize, Region)], groups: usize) -> Result<(Vec<String>, Vec<String>), String> {
        let regions: Vec<GroupRegion> = regions
            .iter()
            .map(|(group, region)| GroupRegion {
                group: *group,
                region: region.clone(),
            })
            .collect();
        let told = |error: PatternFileError| format!("{error} [{}]", error.own_advice().unwrap_or_default());
        let (pattern, notes) = pattern_of(&regions, form(groups), Edges::Cells).map_err(told)?;
        let text = |row: &[u8]| {
            row.iter()
                .map(|cell| ['.', '1', '2'][usize::from(*cell)])
                .collect::<String>()
        };
        Ok((pattern.cells().chunks(10).rev().map(text).collect(), notes))
    }

    #[test]
    fn hard_shapes_have_the_cells_of_their_centres() {
        // Smaller than a cell, without and with its centre; thinner than a cell.
        let (cells, notes) = of(&[(1, disc(4.0, 4.0, 0.3))], 1).unwrap();
        assert_eq!(cells, [".........."; 10]);
        assert_eq!(
            notes[1],
            "1 of 1 contours contain no centre of a cell, which are 1.000 × 1.000 mm"
        );
        assert_eq!(of(&[(1, disc(4.5, 4.5, 0.3))], 1).unwrap().0[5], "....1.....");
        let thin = Region::Rectangle([[1.0, 4.4], [9.0, 4.6]]);
        let (cells, notes) = of(&[(1, thin)], 1).unwrap();
        assert_eq!((cells[5].as_str(), cells[4].as_str()), (".11111111.", ".........."));
        assert_eq!(
            notes,
            ["read by the centres of cells: 1.600 mm² are drawn on the membrane, the cells have 8.000 mm² (+400.00 %)"]
        );
        // Tangent to grid lines, and through the corners of cells: the cells are symmetric.
        let (cells, _) = of(&[(1, disc(5.0, 5.0, 3.0))], 1).unwrap();
        assert_eq!(
            cells[1..6],
            ["..........", "...1111...", "..111111..", "..111111..", "..111111.."].map(|row| row)
        );
        let corners = Region::Polygon(vec![[5.0, 1.0], [9.0, 5.0], [5.0, 9.0], [1.0, 5.0]]);
        let (cells, _) = of(&[(1, corners)], 1).unwrap();
        let mirrored: Vec<String> = cells.iter().map(|row| row.chars().rev().collect()).collect();
        assert_eq!(cells, mirrored);
        assert_eq!(cells.iter().map(|row| row.matches('1').count()).sum::<usize>(), 32 + 8);
        // A hole in a hole, and two parts that touch in a point.
        let nested = [9.0, 6.0, 3.0].map(|side| Contour::rectangle([5.0, 5.0], [side / 2.0; 2], 0.0, 0.0));
        let nested = Region::Contours(Contours {
            contours: nested.to_vec(),
            rule: crate::FillRule::EvenOdd,
        });
        assert_eq!(nested.area_mm2(), Some(81.0 - 36.0 + 9.0));
        let touching = Region::Polygon(vec![
            [1.0, 1.0],
            [5.0, 5.0],
            [9.0, 1.0],
            [9.0, 9.0],
            [5.0, 5.0],
            [1.0, 9.0],
        ]);
        assert!((touching.area_mm2().unwrap() - 32.0).abs() < 1e-6);
    }

    #[test]
    fn shapes_cover_parts_of_cells() {
        let of = |regions: &[(usize, Region)], groups: usize| {
            let region = |(group, region): &(usize, Region)| GroupRegion {
                group: *group,
                region: region.clone(),
            };
            let regions: Vec<GroupRegion> = regions.iter().map(region).collect();
            pattern_of(&regions, form(groups), Edges::Coverage)
        };
        let bar = |left: f64, right: f64| Region::Rectangle([[left, 2.0], [right, 7.25]]);
        let (pattern, notes) = of(&[(1, bar(0.5, 3.75)), (2, bar(4.0, 4.25))], 2).unwrap();
        let coverage = pattern.coverage().unwrap();
        assert_eq!((notes.len(), pattern.groups()), (0, 2));
        for ([x, y], group, share) in [
            ([0, 2], 1, 0.5),
            ([1, 2], 1, 1.0),
            ([3, 7], 1, 0.75 * 0.25),
            ([4, 3], 2, 0.25),
            ([5, 3], 0, 0.0),
            ([1, 1], 0, 0.0),
        ] {
            assert_eq!((coverage.group(x, y), coverage.share(x, y)), (group, share), "{x} {y}");
            assert_eq!(pattern.group(x, y), if share < 0.5 { 0 } else { group });
        }
        assert!((pattern.area_fraction(None) - (3.25 + 0.25) * 5.25 / 100.0).abs() < 1e-12);
        // Parts of two groups in a cell, and what lies outside.
        let error = of(&[(1, bar(0.5, 3.75)), (2, bar(3.8, 5.0))], 2).unwrap_err();
        assert_eq!(
            error.to_string(),
            "cell [y=2][x=3] is covered by 0.7500 of electrode group 1 and by 0.2000 of group 2"
        );
        let (_, notes) = of(&[(1, bar(-1.0, 3.0))], 1).unwrap();
        assert_eq!(notes, ["5.250 of 21.00 mm² lie outside the membrane"]);
        // Whole cells are a pattern of cells.
        let (pattern, _) = of(&[(1, Region::Rectangle([[1.0, 2.0], [4.0, 5.0]]))], 1).unwrap();
        assert!(pattern.coverage().is_none() && pattern.active_cells() == 9);
    }

    #[test]
    fn what_lies_outside_is_told() {
        let (_, notes) = of(&[(1, disc(0.0, 5.0, 2.0))], 1).unwrap();
        assert_eq!(notes[0], "6.283 of 12.57 mm² lie outside the membrane");
        let error = of(&[(1, disc(-5.0, 5.0, 2.0))], 1).unwrap_err();
        assert!(
            error.contains("of 10 mm: it reaches from (−7.000, 3.000) to (−3.000, 7.000) mm"),
            "{error}"
        );
    }

    #[test]
    fn groups_may_touch_but_not_overlap() {
        let half = |from: f64| Region::Rectangle([[from, 0.0], [from + 4.0, 10.0]]);
        // The border runs through centres, which belong to the first.
        let (cells, notes) = of(&[(1, half(0.5)), (2, half(4.5))], 2).unwrap();
        assert_eq!(cells[0], "111112222.");
        assert!(notes[0].starts_with("group 1: read by the centres"), "{notes:?}");
        let error = of(&[(1, half(0.0)), (2, half(3.5))], 2).unwrap_err();
        assert!(
            error.contains("groups 1 and 2 overlap by 5.000 mm² [leave what they share"),
            "{error}"
        );
        let error = of(&[(1, half(0.0)), (2, half(4.0))], 1).unwrap_err();
        assert!(
            error.contains("found electrode group 2 [allowed: 1; the scene has one voltage]"),
            "{error}"
        );
        assert!(of(&[(1, half(0.0)), (1, half(3.5))], 1).is_ok());
        let area = disc(5.0, 5.0, 2.0).area_mm2().unwrap();
        assert!((area - 4.0 * PI).abs() < 1e-12);
    }
}
