//! The report of the measurements, for people and for programs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::{millimetres, networks};
use crate::table;
use crate::text::Text;
use crate::write;
use deaflow_accuracy::{Benchmark, FamilyError, Measured};
use deaflow_base::Quantity;
use deaflow_report::figures::pareto_front;

/// Returns the methods that no other beats in both time and root mean square error, over all families.
fn front(measured: &[Measured]) -> Vec<usize> {
    let points: Vec<(f64, f64)> = measured.iter().map(|m| (m.seconds_per_pattern(), m.rms())).collect();
    pareto_front(&points)
}

/// The number of patterns of a family from which the bound holds for other patterns.
const MIN_PATTERNS: usize = 5;

/// An equilibrium is preferred to an estimate if it takes at most this times as long: its stability is known.
const EQUILIBRIUM_FACTOR: f64 = 1.1;

/// Returns the fastest setting of `solve` whose bound is at most the target, and that agrees with the reference on
/// stability.
/// An equilibrium that takes a little longer is preferred to an estimate.
fn cheapest(measured: &[Measured], target_mm: f64) -> Option<&Measured> {
    let fit = || {
        let solved = measured.iter().filter(|m| m.network().is_none());
        solved.filter(|m| is_sound(m) && bound(m) <= target_mm)
    };
    let faster = |a: &&Measured, b: &&Measured| a.seconds_per_pattern().total_cmp(&b.seconds_per_pattern());
    let fastest = fit().min_by(faster)?;
    let limit = EQUILIBRIUM_FACTOR * fastest.seconds_per_pattern();
    let equilibria = fit().filter(|m| m.equilibria && m.seconds_per_pattern() <= limit);
    Some(equilibria.min_by(faster).unwrap_or(fastest))
}

/// Whether the errors of a method are known, and it agrees with the reference on stability.
fn is_sound(method: &Measured) -> bool {
    method.known() > 0 && method.mismatches() == 0
}

fn bound(method: &Measured) -> f64 {
    method.largest(|family| family.bound)
}

/// Describes the fastest setting within the target that was not chosen because it disagrees on stability, if any.
fn rejected(measured: &[Measured], target_mm: f64, chosen: &Measured) -> Option<String> {
    let faster = measured.iter().filter(|m| {
        let is_within = m.network().is_none() && m.known() > 0 && bound(m) <= target_mm;
        is_within && m.mismatches() > 0 && m.seconds_per_pattern() < chosen.seconds_per_pattern()
    });
    let fastest = faster.min_by(|a, b| a.seconds_per_pattern().total_cmp(&b.seconds_per_pattern()))?;
    Some(format!(
        "{{ {} }} is faster, with a bound of {} mm, but disagrees with the reference on the stability of {}",
        fastest.settings,
        millimetres(bound(fastest)),
        table::counted(fastest.mismatches(), "patterns"),
    ))
}

/// Returns the flags of `deaflow solve` for settings.
fn flags(settings: &str) -> String {
    let pairs = settings.split(", ").filter_map(|pair| pair.split_once(": "));
    let flag = |(key, value): (&str, &str)| {
        let quote = if value.contains(' ') { "\"" } else { "" };
        format!("--{} {quote}{value}{quote}", key.replace('_', "-"))
    };
    pairs.map(flag).collect::<Vec<_>>().join(" ")
}

/// The measurements and their evaluation.
pub struct Findings<'a> {
    benchmark: &'a Benchmark,
    measured: &'a [Measured],
    target: Option<Quantity>,
    front: Vec<usize>,
    /// With a target, the method that reaches it, if any.
    chosen: Option<Option<&'a Measured>>,
}

impl<'a> Findings<'a> {
    /// Evaluates the measurements for a target, if any.
    pub fn new(benchmark: &'a Benchmark, measured: &'a [Measured], target: Option<Quantity>) -> Self {
        Self {
            benchmark,
            measured,
            target,
            front: front(measured),
            chosen: target.map(|target| cheapest(measured, target.value())),
        }
    }

    /// Whether a target was given that no method reaches.
    pub fn is_missed(&self) -> bool {
        matches!(self.chosen, Some(None))
    }

    /// Formats the report for people, about a scene in a file, with the written files.
    pub fn text(&self, scene: &Path, files: &[PathBuf]) -> Text {
        let mut text = Text::of(self.table());
        let mut parts = vec![self.notes()];
        parts.extend(networks::describe(self.measured));
        parts.extend(self.verdict());
        text.line(parts.join("\n"));
        if let Some(Some(method)) = self.chosen {
            let scene = scene.to_string_lossy().into_owned();
            let scene = shlex::try_quote(&scene).map_or_else(|_| scene.clone(), |quoted| quoted.into_owned());
            text.command(format!(
                "  deaflow solve {scene} PATTERN… -o OUT.h5 {}",
                flags(&method.settings)
            ));
            text.whole(format!("  {{ kind: solve, needs: […], {} }}\n", method.settings));
        }
        for path in files {
            let is_table = path.extension().is_some_and(|end| end == "csv");
            text.whole(match is_table {
                true => write::with_metadata(path),
                false => path.display().to_string(),
            });
        }
        text
    }

    fn table(&self) -> table::Table {
        let header = [
            "method",
            "RMS mm",
            "max mm",
            "bound mm",
            "ms per pattern",
            "disagree",
            "front",
        ];
        let mut table = table::table(&header, &header[1..6])
            .flowing(&["method"])
            .dispensable(&["disagree"]);
        for (i, method) in self.measured.iter().enumerate() {
            table.add_row([
                method.settings.trim_start_matches("method: ").to_owned(),
                millimetres(method.rms()),
                millimetres(method.largest(|family| family.max)),
                millimetres(bound(method)),
                format!("{:.2}", 1e3 * method.seconds_per_pattern()),
                method.mismatches().to_string(),
                if self.front.contains(&i) { "*" } else { "" }.to_owned(),
            ]);
        }
        table
    }

    fn notes(&self) -> String {
        let families: Vec<String> = (0..self.benchmark.families.len())
            .map(|k| match self.benchmark.counts(k) {
                [n, 0] => format!("{} {n}", self.benchmark.families[k]),
                [n, unstable] => format!("{} {n} ({unstable} unstable)", self.benchmark.families[k]),
            })
            .collect();
        let few = (0..self.benchmark.families.len()).any(|k| {
            let [members, unstable] = self.benchmark.counts(k);
            members - unstable < MIN_PATTERNS
        });
        let meaning = if few {
            "the bound holds for these patterns only: a family has fewer than five stable patterns"
        } else {
            "99 % of the patterns of these families are below the bound (95 % confidence)"
        };
        let geometry = match self.geometry_error() {
            None => String::new(),
            Some(f64::INFINITY) => {
                "geometry: the error of cells that stand for curves is unknown, since elements cannot follow these, or \
                 there is no stable solution on them\n"
                    .to_owned()
            }
            Some(mm) => format!(
                "geometry: cells that stand for curves add at most {} mm to the error of every method, which is in the \
                 bound; `curves: fitted` follows the curves\n",
                millimetres(mm)
            ),
        };
        format!(
            "patterns: {}\nreference: {}, error at most {} mm\n{geometry}max and bound: displacement errors at the \
             corners, in the worst family; {meaning}\ndisagree: number of patterns on whose stability method and \
             reference disagree; such a method is not recommended\nfront: * if no other method is both faster and \
             more accurate (RMS)\n",
            families.join(", "),
            self.benchmark.reference.settings(),
            millimetres(self.reference_error()),
        )
    }

    fn reference_error(&self) -> f64 {
        let errors = (0..self.benchmark.families.len()).map(|k| self.benchmark.reference_error(k));
        errors.fold(0.0, f64::max)
    }

    fn geometry_error(&self) -> Option<f64> {
        let errors = (0..self.benchmark.families.len()).filter_map(|k| self.benchmark.geometry_error(k));
        errors.reduce(f64::max)
    }

    fn verdict(&self) -> Option<String> {
        let target = self.target?;
        Some(match self.chosen? {
            Some(method) => format!(
                "fastest within {target}: {{ {} }}, bound {} mm, {:.2} ms per pattern, measured on {}{}",
                method.settings,
                millimetres(bound(method)),
                1e3 * method.seconds_per_pattern(),
                self.benchmark.families.join(", "),
                rejected(self.measured, target.value(), method).map_or_else(String::new, |why| format!("\n{why}")),
            ),
            None => match self.best() {
                Some(best) => format!(
                    "no measured method reaches {target} on {}; the best is {{ {} }} with a bound of {} mm\n",
                    self.benchmark.families.join(", "),
                    best.settings,
                    millimetres(bound(best))
                ),
                None => {
                    format!("no measured method reaches {target}: each disagrees with the reference on stability\n")
                }
            },
        })
    }

    /// Returns the method with the smallest bound among those that agree with the reference on stability.
    fn best(&self) -> Option<&Measured> {
        let sound = self.measured.iter().filter(|m| m.network().is_none() && is_sound(m));
        sound.min_by(|a, b| bound(a).total_cmp(&bound(b)))
    }

    /// Formats the report for programs.
    pub fn document(&self) -> Value {
        let method = |(i, method): (usize, &Measured)| {
            let families: BTreeMap<&str, Value> = self
                .benchmark
                .families
                .iter()
                .zip(method.families.iter().zip(&method.seconds))
                .map(|(name, (error, seconds))| (name.as_str(), of_family(error, *seconds)))
                .collect();
            json!({
                "settings": method.settings,
                "rms_mm": method.rms(),
                "max_mm": method.largest(|family| family.max),
                "bound_mm": bound(method),
                "seconds_per_pattern": method.seconds_per_pattern(),
                "mismatches": method.mismatches(),
                "front": self.front.contains(&i),
                "families": families,
                "batch": method.batch.map(|(size, seconds)| json!({ "patterns": size, "seconds": seconds })),
            })
        };
        let methods: Vec<Value> = self.measured.iter().enumerate().map(method).collect();
        let target = self.target.map(|target| {
            let chosen = self.chosen.flatten();
            json!({
                "mm": target.value(),
                "reached": chosen.is_some(),
                "settings": chosen.map(|m| &m.settings),
                "flags": chosen.map(|m| flags(&m.settings)),
                "best": self.best().map(|m| &m.settings),
            })
        });
        let beaten: BTreeMap<&str, Option<&String>> = networks::beaten(self.measured)
            .into_iter()
            .filter_map(|(network, better)| Some((network.network()?, better.map(|m| &m.settings))))
            .collect();
        json!({
            "beaten_by": beaten,
            "measured_on": self.benchmark.families,
            "reference": {
                "settings": self.benchmark.reference.settings().to_string(),
                "error_mm": self.reference_error(),
                "geometry_error_mm": self.geometry_error(),
            },
            "methods": methods,
            "target": target,
        })
    }
}

fn of_family(error: &FamilyError, seconds: f64) -> Value {
    json!({
        "rms_mm": error.rms,
        "max_mm": error.max,
        "bound_mm": error.bound,
        "seconds_per_pattern": seconds,
        "missed": error.missed,
        "false_alarms": error.false_alarms,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(settings: &str, seconds: f64, bound: f64, missed: u64) -> Measured {
        Measured {
            settings: settings.into(),
            equilibria: settings != "estimate" && !settings.starts_with("network"),
            batch: None,
            patterns: Vec::new(),
            families: vec![FamilyError {
                bound,
                known: u64::from(seconds < 10.0),
                missed,
                ..FamilyError::default()
            }],
            seconds: vec![seconds],
        }
    }

    #[test]
    fn the_cheapest_setting_that_reaches_a_target_is_picked() {
        let all = [
            measured("slow", 3.0, 0.001, 0),
            measured("fast", 1.0, 0.02, 0),
            measured("blind", 0.5, 0.001, 1),
            measured("middle", 2.0, 0.01, 0),
            measured("estimate", 1.8, 0.015, 0),
            measured("near", 1.9, 0.015, 0),
            measured("of unstable patterns only", 10.0, 0.0, 0),
        ];
        let pick = |target| cheapest(&all, target).map(|m| m.settings.as_str());
        assert_eq!(pick(0.05), Some("fast"));
        assert_eq!(pick(0.01), Some("middle"), "a target may just be reached");
        assert_eq!(
            pick(0.002),
            Some("slow"),
            "what is blind to instability is never picked"
        );
        assert_eq!(pick(1e-4), None);
    }

    #[test]
    fn a_faster_setting_that_is_blind_to_instability_is_named_with_the_reason() {
        let all = [measured("slow", 3.0, 0.001, 0), measured("blind", 0.5, 0.001, 1)];
        let why = rejected(&all, 0.01, &all[0]).unwrap();
        for part in ["{ blind }", "0.0010 mm", "1 pattern"] {
            assert!(why.contains(part), "{why}");
        }
        assert!(
            rejected(&all, 0.0001, &all[0]).is_none(),
            "its bound is beyond the target"
        );
        assert!(rejected(&all[..1], 0.01, &all[0]).is_none());
    }

    #[test]
    fn a_network_is_no_setting_of_solve() {
        let network = [measured("network: fine", 0.1, 0.0, 0)];
        assert!(cheapest(&network, 1.0).is_none());
    }

    #[test]
    fn settings_become_flags_and_errors_two_digits() {
        assert_eq!(
            flags("method: chord:2, elements_per_cell: 1, order: 2"),
            "--method chord:2 --elements-per-cell 1 --order 2"
        );
        assert_eq!(
            flags("method: newton, accuracy: 0.01 mm"),
            "--method newton --accuracy \"0.01 mm\""
        );
        for (mm, text) in [
            (0.0, "0"),
            (0.0314159, "0.031"),
            (2.34, "2.3"),
            (23.4, "23"),
            (2.34e-4, "2.3e−4"),
        ] {
            assert_eq!(millimetres(mm), text);
        }
    }
}
