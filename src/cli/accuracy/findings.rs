//! What the measurements say, for people and for programs.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::{Value, json};

use super::networks;
use crate::accuracy::AccuracyArguments;
use crate::table;
use crate::text::Text;
use crate::write;
use deaflow_accuracy::{Benchmark, FamilyError, Measured};
use deaflow_report::figures::pareto_front;

/// Methods that no other beats in both time and root mean square error, over all families.
fn front(measured: &[Measured]) -> Vec<usize> {
    let points: Vec<(f64, f64)> = measured.iter().map(|m| (m.seconds_per_pattern(), m.rms())).collect();
    pareto_front(&points)
}

/// Patterns of a family below which errors bound nothing but themselves.
const FEW: usize = 5;

/// An equilibrium may take this much longer than an estimate, of whose stability nothing is known.
const WORTH_IT: f64 = 1.1;

/// The fastest setting of `solve` whose bound is at most the target, and that agrees with the reference on what is stable.
/// Where an estimate is the fastest, an equilibrium that takes hardly longer is preferred.
fn cheapest(measured: &[Measured], target_mm: f64) -> Option<&Measured> {
    let fit = || {
        let solved = measured.iter().filter(|m| m.network().is_none());
        solved.filter(|m| is_sound(m) && bound(m) <= target_mm)
    };
    let faster = |a: &&Measured, b: &&Measured| a.seconds_per_pattern().total_cmp(&b.seconds_per_pattern());
    let fastest = fit().min_by(faster)?;
    let limit = WORTH_IT * fastest.seconds_per_pattern();
    let equilibria = fit().filter(|m| m.equilibria && m.seconds_per_pattern() <= limit);
    Some(equilibria.min_by(faster).unwrap_or(fastest))
}

/// Whether anything is known of its errors, and it agrees with the reference on what is stable.
fn is_sound(method: &Measured) -> bool {
    method.known() > 0 && method.mismatches() == 0
}

fn bound(method: &Measured) -> f64 {
    method.largest(|family| family.bound)
}

/// Why a faster setting whose bound is at most the target is not the one: none where there is no such.
fn passed_over(measured: &[Measured], target_mm: f64, chosen: &Measured) -> Option<String> {
    let faster = measured.iter().filter(|m| {
        let is_within = m.network().is_none() && m.known() > 0 && bound(m) <= target_mm;
        is_within && m.mismatches() > 0 && m.seconds_per_pattern() < chosen.seconds_per_pattern()
    });
    let fastest = faster.min_by(|a, b| a.seconds_per_pattern().total_cmp(&b.seconds_per_pattern()))?;
    Some(format!(
        "{{ {} }} is faster, with a bound of {} mm, but disagrees with the reference on what is stable for {}",
        fastest.settings,
        millimetres(bound(fastest)),
        table::counted(fastest.mismatches(), "patterns"),
    ))
}

/// The flags of `deaflow solve` for some settings.
fn flags(settings: &str) -> String {
    let pairs = settings.split(", ").filter_map(|pair| pair.split_once(": "));
    let flag = |(key, value): (&str, &str)| {
        let quote = if value.contains(' ') { "\"" } else { "" };
        format!("--{} {quote}{value}{quote}", key.replace('_', "-"))
    };
    pairs.map(flag).collect::<Vec<_>>().join(" ")
}

/// What is told.
pub struct Findings<'a> {
    arguments: &'a AccuracyArguments,
    benchmark: &'a Benchmark,
    measured: &'a [Measured],
    front: Vec<usize>,
    /// For a target that was given, the method that reaches it, if one does.
    chosen: Option<Option<&'a Measured>>,
}

impl<'a> Findings<'a> {
    /// What the methods measured mean for the target that was given, if one was.
    pub fn new(arguments: &'a AccuracyArguments, benchmark: &'a Benchmark, measured: &'a [Measured]) -> Self {
        Self {
            arguments,
            benchmark,
            measured,
            front: front(measured),
            chosen: arguments.target.map(|target| cheapest(measured, target.value())),
        }
    }

    /// Whether a target was given and nothing reaches it.
    pub fn is_missed(&self) -> bool {
        matches!(self.chosen, Some(None))
    }

    /// For people.
    pub fn text(&self, files: &[PathBuf]) -> Text {
        let mut text = Text::of(self.table());
        let mut parts = vec![self.notes()];
        parts.extend(networks::worth(self.measured));
        parts.extend(self.verdict());
        text.line(parts.join("\n"));
        if let Some(Some(method)) = self.chosen {
            let scene = self.arguments.scene.to_string_lossy().into_owned();
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
            members - unstable < FEW
        });
        let meaning = if few {
            "with fewer than five stable patterns in a family the bound speaks of these patterns alone"
        } else {
            "99 % of patterns of these families stay below the bound (95 % confidence); it says nothing of others"
        };
        format!(
            "patterns: {}\nreference: {}, itself within {} mm\nmax and bound: displacement errors at the corners, the worst \
             family; {meaning}\ndisagree: patterns of which it says otherwise than the reference whether they are stable; such a method is \
             recommended for no target\nfront: * where no other is both faster and more exact (RMS)\n",
            families.join(", "),
            self.benchmark.reference.settings(),
            millimetres(self.reference_error()),
        )
    }

    fn reference_error(&self) -> f64 {
        let errors = (0..self.benchmark.families.len()).map(|k| self.benchmark.reference_error(k));
        errors.fold(0.0, f64::max)
    }

    fn verdict(&self) -> Option<String> {
        let target = self.arguments.target?;
        Some(match self.chosen? {
            Some(method) => format!(
                "{target} is reached by {{ {} }}: bound {} mm, {:.2} ms per pattern, as measured on {}{}",
                method.settings,
                millimetres(bound(method)),
                1e3 * method.seconds_per_pattern(),
                self.benchmark.families.join(", "),
                passed_over(self.measured, target.value(), method).map_or_else(String::new, |why| format!("\n{why}")),
            ),
            None => match self.best() {
                Some(best) => format!(
                    "nothing that was measured reaches {target} on {}; the best is {{ {} }} with a bound of {} mm\n",
                    self.benchmark.families.join(", "),
                    best.settings,
                    millimetres(bound(best))
                ),
                None => format!(
                    "nothing that was measured reaches {target}: each disagrees with the reference on what is stable\n"
                ),
            },
        })
    }

    /// The smallest bound among methods that agree with the reference on what is stable.
    fn best(&self) -> Option<&Measured> {
        let sound = self.measured.iter().filter(|m| m.network().is_none() && is_sound(m));
        sound.min_by(|a, b| bound(a).total_cmp(&bound(b)))
    }

    /// For programs.
    pub fn document(&self, files: &[PathBuf]) -> Value {
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
        let target = self.arguments.target.map(|target| {
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
            "reference": { "settings": self.benchmark.reference.settings().to_string(), "error_mm": self.reference_error() },
            "methods": methods,
            "target": target,
            "files": files,
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

/// Two digits are enough of an error.
pub fn millimetres(mm: f64) -> String {
    if mm >= 1e-3 || mm == 0.0 {
        let decimals = if mm == 0.0 {
            0
        } else {
            (1 - mm.log10().floor() as i32).max(0) as usize
        };
        format!("{mm:.decimals$}")
    } else {
        format!("{mm:.1e}")
    }
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
        let why = passed_over(&all, 0.01, &all[0]).unwrap();
        assert_eq!(
            why,
            "{ blind } is faster, with a bound of 0.0010 mm, but disagrees with the reference on what is stable for 1 pattern"
        );
        assert!(
            passed_over(&all, 0.0001, &all[0]).is_none(),
            "its bound is beyond the target"
        );
        assert!(passed_over(&all[..1], 0.01, &all[0]).is_none());
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
            (2.34e-4, "2.3e-4"),
        ] {
            assert_eq!(millimetres(mm), text);
        }
    }
}
