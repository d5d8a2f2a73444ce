//! Yield stages: devices of designs as they are made.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::designs::Design;
use crate::drawing::Sheet;
use crate::error::ReportError;
use crate::figures::{DesignYields, reached_chart, yields_sheet};
use crate::format::{mm, number, percents, three};
use crate::html::{Column, Page};
use crate::presenter::{Figures, Headline, Presenter, Results};
use crate::summary::design_title;
use deaflow_content::{DesignDevices, Yields};
use deaflow_pattern::Role;
use deaflow_tolerance::{Device, Estimate, Quantile, Source, Wanted, Yield, share_within};

/// Presents yield stages.
pub struct YieldPresenter;

/// Designs in a figure.
const MOST_DRAWN: usize = 6;
/// The quantile for a person who makes the devices.
const LOW: f64 = 0.05;
/// Shares of the variance below this are not listed.
const LISTED: f64 = 0.005;
/// Errors of these shares below this are not told.
const LEAST_WITHIN: f64 = 5e-4;

/// What a yield stage found.
#[derive(Debug, Serialize)]
struct Found {
    /// The stage.
    stage: String,
    /// The displacement that devices have to reach in mm.
    wanted_mm: Option<f64>,
    /// The same as a share of the displacement of each pattern as drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    wanted_share: Option<f64>,
    /// Each design.
    designs: Vec<OfDesign>,
}

#[derive(Debug, Serialize)]
struct OfDesign {
    /// Case, target, number and role.
    title: String,
    /// Displacement of the pattern as drawn in mm.
    as_drawn_mm: Option<f64>,
    /// What devices have to reach, in words.
    #[serde(skip)]
    wanted: Option<String>,
    /// The same in mm.
    #[serde(skip)]
    wanted_mm: Option<f64>,
    /// Number of devices.
    samples: usize,
    mean_mm: Option<Estimate>,
    standard_deviation_mm: Option<Estimate>,
    quantiles_mm: Vec<Quantile>,
    /// The share of the devices that reach the wanted displacement.
    #[serde(rename = "yield")]
    reached: Option<Estimate>,
    /// Number of devices that fail, by reason.
    failures: BTreeMap<&'static str, usize>,
    /// Shares of the variance by tolerance.
    shares: BTreeMap<&'static str, f64>,
    /// The same in words, the largest first.
    #[serde(skip)]
    ordered: Vec<(&'static str, f64)>,
    /// Case and target.
    #[serde(skip)]
    target: (String, String),
    /// [`Yield::rank`].
    #[serde(skip)]
    rank: [f64; 2],
    /// Why devices fail, in words.
    #[serde(skip)]
    described: Vec<String>,
    /// Whether a search found the design.
    #[serde(skip)]
    is_found: bool,
    /// Whether it is not drawn for comparison alone.
    #[serde(skip)]
    is_made: bool,
    /// Displacements of devices that do not fail.
    #[serde(skip)]
    displacements: Vec<f64>,
}

fn read(source: &ArtifactReader<'_>) -> Result<Found, ReportError> {
    read_where(source, |_| true)
}

/// Reads the designs that `is_read` selects.
fn read_where(source: &ArtifactReader<'_>, is_read: impl Fn(&DesignDevices) -> bool) -> Result<Found, ReportError> {
    let view = source.of(Yields::open(source.artifact))?;
    let varying = Source::varying(&source.of(view.tolerances().read())?);
    let [mm, share] = [view.wanted().read(), view.wanted_share().read()];
    let wanted = Wanted::of_stored(source.of(mm)?, source.of(share)?);
    let of_one = |design: DesignDevices| {
        let devices = Device::of_rows(&design.outcome, &design.displacement, &design.deviations);
        let devices = devices.ok_or_else(|| source.wrong("its devices have unknown outcomes"))?;
        Ok(OfDesign::new(&design, &devices, &varying, wanted))
    };
    let designs = source.of(view.designs())?.into_iter().filter(is_read).map(of_one);
    Ok(Found {
        stage: source.stage.stage.clone(),
        wanted_mm: wanted.and_then(Wanted::length_mm),
        wanted_share: wanted.and_then(Wanted::share),
        designs: designs.collect::<Result<_, ReportError>>()?,
    })
}

/// Describes the devices of a design that the yield stages of a run simulated, a line for each stage.
///
/// # Errors
/// If an artifact cannot be read or does not have the content of its kind.
pub(crate) fn devices_of(run: &RunArtifacts<'_>, design: &Design) -> Result<Vec<String>, ReportError> {
    let is_it = |one: &DesignDevices| {
        // An own pattern has the name of each target in a verification, and its number here.
        if one.role == Role::Own && design.role == Role::Own {
            return one.pattern == design.pattern;
        }
        let words = (&one.case, &one.name) == (&design.case, &design.target);
        let numbers = (one.role, one.member, one.units) == (design.role, design.member, design.units);
        words && numbers && one.pattern == design.pattern
    };
    let found = run.each("yield", |source| read_where(source, is_it))?;
    let line = |found: &Found, one: &OfDesign| {
        let mut parts = vec![one.spread()];
        parts.extend(one.error_of_mesh(design));
        let design = one;
        parts.extend(design.quantile(LOW));
        parts.extend(design.wanted.as_ref().map(|_| design.main()));
        parts.extend(design.described.iter().cloned());
        format!("{}, {} devices: {}", found.stage, design.samples, parts.join("; "))
    };
    let lines = found
        .iter()
        .flat_map(|found| found.designs.iter().map(move |one| line(found, one)));
    Ok(lines.collect())
}

impl OfDesign {
    fn new(design: &DesignDevices, devices: &[Device], varying: &[Source], wanted: Option<Wanted>) -> Self {
        let wanted_mm = wanted.and_then(|wanted| wanted.in_mm(design.drawn));
        let result = Yield::of(devices, varying, wanted_mm);
        let mut ordered: Vec<(&'static str, f64)> = result
            .shares
            .iter()
            .map(|(source, share)| (source.label(), *share))
            .collect();
        ordered.sort_by(|one, other| other.1.total_cmp(&one.1));
        Self {
            title: design_title(&design.case, &design.name, design.member, design.role),
            as_drawn_mm: design.drawn,
            wanted: wanted.map(|wanted| wanted.described(design.drawn)),
            wanted_mm,
            samples: result.samples,
            mean_mm: result.mean,
            standard_deviation_mm: result.deviation,
            quantiles_mm: result.quantiles.clone(),
            reached: result.reached,
            failures: result
                .failures
                .iter()
                .map(|(failure, count)| (failure.name(), *count))
                .collect(),
            target: (design.case.clone(), design.name.clone()),
            rank: result.rank(),
            described: describe(&result),
            shares: result
                .shares
                .iter()
                .map(|(source, share)| (source.name(), *share))
                .collect(),
            ordered,
            is_found: design.role.is_found(),
            is_made: design.role.is_found() || design.role == Role::Own,
            displacements: devices.iter().filter_map(|device| device.value.ok()).collect(),
        }
    }

    /// Describes which share reaches the displacement, or what the devices do without one.
    fn main(&self) -> String {
        match (&self.reached, &self.wanted) {
            (Some(reached), Some(wanted)) => {
                let [low, high] = reached.interval.map(percents);
                let share = percents(reached.value);
                format!("{share} ({low} to {high}) of the devices reach {wanted}")
            }
            (None, Some(wanted)) => format!(
                "{} of the devices; as drawn it does not move along the direction, so none reaches {wanted}",
                self.spread()
            ),
            _ => format!("{} of the devices", self.spread()),
        }
    }

    fn spread(&self) -> String {
        let known = |known: &Option<Estimate>| known.map_or_else(|| "none".to_owned(), |known| known.with_interval());
        format!(
            "mean {}, deviation {} mm",
            known(&self.mean_mm),
            known(&self.standard_deviation_mm)
        )
    }

    /// Says how large the error of the mesh is, if that is more than the interval of the mean: by the error of the
    /// verification, or how far the displacement as drawn on the mesh of the devices is from it.
    fn error_of_mesh(&self, design: &Design) -> Option<String> {
        let [low, high] = self.mean_mm?.interval;
        let off = self.as_drawn_mm.zip(design.simulated_mm);
        let off = off.map_or(0.0, |(drawn, simulated)| (drawn - simulated).abs());
        let error = off.max(design.error_mm.unwrap_or(0.0));
        (error > 0.5 * (high - low))
            .then(|| format!("the ± leave out the error of the mesh, about {} mm", three(error)))
    }

    /// Describes the displacement that a share of the devices does not reach; `None` if it is not computed.
    fn quantile(&self, probability: f64) -> Option<String> {
        let found = self.quantiles_mm.iter().find(|one| one.probability == probability)?;
        let known = |value: f64| {
            if value.is_finite() {
                mm(value)
            } else {
                "fails".to_owned()
            }
        };
        let [low, high] = found.value.interval.map(known);
        let value = known(found.value.value);
        Some(format!(
            "{} % quantile {value} ({low} to {high}) mm",
            number(100.0 * probability)
        ))
    }

    /// The tolerances that make most of the variance.
    fn decisive(&self) -> Option<String> {
        let listed = self.ordered.iter().filter(|(_, share)| *share >= LISTED);
        let words: Vec<String> = listed
            .map(|(name, share)| format!("{name} {}", percents(*share)))
            .collect();
        (!words.is_empty()).then(|| words.join(", "))
    }

    fn line(&self) -> String {
        let mut parts = vec![self.main()];
        if self.reached.is_some() {
            parts.push(self.spread());
        }
        parts.extend(self.as_drawn_mm.map(|drawn| format!("as drawn {} mm", mm(drawn))));
        let listed = self.ordered.iter().filter(|(_, share)| *share >= LISTED);
        let within = listed.map(|(_, share)| share_within(*share, self.displacements.len()));
        let within = within.fold(0.0, f64::max);
        // A share of 100 % has no error.
        let within = (within >= LEAST_WITHIN).then(|| format!(", each ± {}", percents(within)));
        let within = within.unwrap_or_default();
        parts.extend(
            self.decisive()
                .map(|shares| format!("shares of the variance: {shares}{within}")),
        );
        parts.extend(self.described.iter().cloned());
        format!("{}: {}", self.title, parts.join("; "))
    }
}

/// Describes why devices fail.
fn describe(result: &Yield) -> Vec<String> {
    let some = result.failures.iter().filter(|(_, count)| *count > 0);
    some.map(|(failure, count)| format!("{count} of {} devices {}", result.samples, failure.description()))
        .collect()
}

impl Found {
    fn lines(&self) -> Vec<String> {
        self.designs.iter().map(OfDesign::line).collect()
    }

    /// Returns the best design of each target, of those that a search found if there are any: that of which most
    /// devices reach the displacement, then that with the largest mean.
    fn best(&self) -> Vec<&OfDesign> {
        let has_found = self.designs.iter().any(|design| design.is_found);
        let mut best: Vec<&OfDesign> = Vec::new();
        for design in self.designs.iter().filter(|design| design.is_found || !has_found) {
            match best.iter_mut().find(|one| one.target == design.target) {
                None => best.push(design),
                Some(one) if design.rank > one.rank => *one = design,
                Some(_) => {}
            }
        }
        best
    }

    /// Returns the designs for a figure: those that are to be made, and others while there is room.
    fn drawn(&self) -> Vec<DesignYields> {
        let is_made = |design: &&OfDesign| design.is_made;
        let others = self.designs.iter().filter(|design| !design.is_made);
        let all = self.designs.iter().filter(is_made).chain(others);
        let made = self.designs.iter().filter(is_made).count();
        let all = all.take(made.clamp(2, MOST_DRAWN));
        let all = all.filter(|design| !design.displacements.is_empty());
        let drawn = all.map(|design| DesignYields {
            name: design.title.clone(),
            devices: design.samples,
            displacements: design.displacements.clone(),
            wanted_mm: design.wanted_mm,
            shares: design.ordered.clone(),
        });
        drawn.collect()
    }
}

const COLUMNS: [(&str, Column); 10] = [
    ("design", Column::Text),
    ("as drawn, mm", Column::Number),
    ("mean, mm", Column::Number),
    ("deviation, mm", Column::Number),
    ("5 %, mm", Column::Number),
    ("median, mm", Column::Number),
    ("95 %, mm", Column::Number),
    ("reach it", Column::Number),
    ("fail", Column::Number),
    ("variance", Column::Text),
];

fn row(design: &OfDesign) -> Vec<String> {
    let none = || "–".to_owned();
    let known = |known: &Option<Estimate>| known.map_or_else(none, |known| known.with_interval());
    let first = [
        design.title.clone(),
        design.as_drawn_mm.map_or_else(none, mm),
        known(&design.mean_mm),
        known(&design.standard_deviation_mm),
    ];
    let quantiles = design.quantiles_mm.iter();
    let quantiles = quantiles.map(|quantile| match quantile.value.value.is_finite() {
        true => mm(quantile.value.value),
        false => "fails".to_owned(),
    });
    let reached = design.reached.map_or_else(none, |reached| {
        let [low, high] = reached.interval.map(percents);
        format!("{} ({low} to {high})", percents(reached.value))
    });
    let failed = percents(design.failures.values().sum::<usize>() as f64 / design.samples as f64);
    let variance = design.decisive().unwrap_or_else(none);
    first
        .into_iter()
        .chain(quantiles)
        .chain([reached, failed, variance])
        .collect()
}

impl Presenter for YieldPresenter {
    fn kind(&self) -> &'static str {
        "yield"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let found = run.each(self.kind(), read)?;
        let text = found
            .iter()
            .map(|found| format!("{}: {}", found.stage, found.lines().join("\n  ")));
        Ok(vec![Results::new("yields", &found, text)])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let found = run.each(self.kind(), read)?;
        let line = |found: &Found, best: &OfDesign| {
            let decisive = best.ordered.first().filter(|(_, share)| *share >= LISTED);
            let decisive = decisive.map(|(name, share)| format!("{name} makes {} of the variance", percents(*share)));
            let parts: Vec<String> = [best.main()]
                .into_iter()
                .chain(decisive)
                .chain(best.described.iter().cloned())
                .collect();
            let text = format!("{}: {}: {}", found.stage, best.title, parts.join("; "));
            match best.as_drawn_mm {
                Some(_) => Headline::good(text),
                None => Headline::bad(format!("{text}; it fails as drawn")),
            }
        };
        let of_stage = |found: &Found| {
            let lines = found.best().into_iter().map(|best| line(found, best));
            lines.collect::<Vec<_>>()
        };
        Ok(found.iter().flat_map(of_stage).collect())
    }

    fn figures(&self) -> Figures {
        &[("yields", figure)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let found = run.each(self.kind(), |source| {
            let found = read(source)?;
            let drawn = found.drawn();
            let charts = match drawn.is_empty() {
                true => Vec::new(),
                // The table has the shares of the variance.
                false => vec![source.drawn(reached_chart(&drawn))?],
            };
            Ok((found, charts))
        })?;
        for (found, charts) in &found {
            page.open(
                "Devices as they are made",
                "Each device is one simulation with its own voltage, material, thickness, prestretch and electrodes. \
                 Devices that fail do not reach the displacement, and have no part in mean and deviation.",
            );
            page.part(&found.stage);
            let wanted = Wanted::of_stored(found.wanted_mm, found.wanted_share);
            let wanted = wanted.map(|wanted| format!("Wanted: {}. ", wanted.described(None)));
            let devices = found.designs.first().map_or(0, |design| design.samples);
            page.line(&format!(
                "{}{devices} devices of each design.",
                wanted.unwrap_or_default()
            ));
            let rows: Vec<Vec<String>> = found.designs.iter().map(row).collect();
            page.columns("Yields", &COLUMNS, &rows);
            page.charts(charts);
            for design in &found.designs {
                let failures = design.described.iter();
                let failures: Vec<String> = failures.map(|what| format!("{}: {what}", design.title)).collect();
                page.lines(&failures);
            }
        }
        Ok(())
    }
}

fn figure(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let found = read(source)?;
    let drawn = found.drawn();
    let sheet = (!drawn.is_empty()).then(|| yields_sheet(&drawn));
    sheet.map(|sheet| source.drawn(sheet)).transpose()
}
