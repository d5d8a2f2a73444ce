//! Progress on stderr: on a terminal one line per stage at work with rate and time left; elsewhere a plain line when a stage begins,
//! every ten seconds, and when it ends; for programs every event as a line of JSON. Both are known before the first step is over where
//! the work tells which part of it is done, and the time as it was foretold before that.

use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, IsTerminal};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressState, ProgressStyle};

use super::columns::cut;
use super::output::{tell, tell_of, tell_on};
use super::table;
use super::tone::{Screen, Tone, width_of_stderr};
use crate::base::{Progress, printable, printable_json};
use crate::orchestrator::{Event, Outcome, StageReport};

/// Time between two plain lines.
const INTERVAL: Duration = Duration::from_secs(10);

/// How the progress of a run is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// Bars on a terminal, or else lines.
    Bars,
    /// Lines.
    Lines,
    /// A JSON document per line.
    Json,
    /// Warnings only.
    Warnings,
}

/// A bar that is shown once the work has taken longer than people wait without a word.
pub struct Lazy {
    name: &'static str,
    unit: &'static str,
    begun: Instant,
    bar: OnceLock<Bar>,
}

impl Lazy {
    /// Work that begins now.
    pub fn new(name: &'static str, unit: &'static str) -> Self {
        Self {
            name,
            unit,
            begun: Instant::now(),
            bar: OnceLock::new(),
        }
    }

    /// Sets how much of how much is done.
    pub fn set(&self, done: u64, length: u64) {
        if self.begun.elapsed() > PATIENCE {
            let bar = self.bar.get_or_init(|| Bar::new(self.name, self.unit, length));
            bar.set(done, length);
        }
    }

    /// Ends it; whether what it showed is done.
    pub fn finish(&self, is_done: bool) {
        if let Some(bar) = self.bar.get() {
            bar.finish(if is_done { "done" } else { "failed" });
        }
    }
}

/// Work that takes longer shows its progress.
const PATIENCE: Duration = Duration::from_secs(2);

/// What a step counts in a bar, which has none but whole ones.
const STEP: u64 = 1000;

/// One piece of work under way.
pub struct Bar {
    form: Form,
    name: String,
    unit: &'static str,
}

enum Form {
    /// The steps that are done stand beside the bar, which shows parts of a step too.
    Terminal(ProgressBar, AtomicU64),
    Plain(Mutex<Plain>),
}

struct Plain {
    begun: Instant,
    said: Instant,
    done: u64,
    /// Of the step under way.
    part: f64,
    /// Of these, what was done before it began.
    before: u64,
    length: u64,
    /// What all of it was foretold to take, s.
    foretold: Option<f64>,
    note: String,
}

impl Plain {
    /// How fast, in steps per second; none before anything is known.
    fn rate(&self) -> Option<f64> {
        let done = (self.done - self.before) as f64 + self.part;
        (done > 0.0).then(|| done / self.begun.elapsed().as_secs_f64())
    }
}

impl Bar {
    /// Begins to show `length` steps of work.
    pub fn new(name: &str, unit: &'static str, length: u64) -> Self {
        let bars = io::stderr().is_terminal().then(MultiProgress::new);
        Self::among(bars.as_ref(), name, unit, length, None)
    }

    /// As progress is shown; none where no steps are.
    pub fn of(shown: Shown, name: &str, unit: &'static str) -> Option<Self> {
        match shown {
            Shown::Bars => Some(Self::new(name, unit, 0)),
            Shown::Lines => Some(Self::among(None, name, unit, 0, None)),
            Shown::Json | Shown::Warnings => None,
        }
    }

    /// Says a line beside it.
    pub fn say(&self, text: &str) {
        match &self.form {
            Form::Terminal(bar, _) => bar.suspend(|| tell(text)),
            Form::Plain(_) => tell(text),
        }
    }

    /// As [`Bar::new`], below other bars of a terminal; without a terminal by lines. `foretold` is what all of it is to take, s.
    fn among(bars: Option<&MultiProgress>, name: &str, unit: &'static str, length: u64, foretold: Option<f64>) -> Self {
        let form = if let Some(bars) = bars {
            let narrow = width_of_stderr().is_some_and(|width| width < WIDE);
            let prefix = cut(&printable(name), if narrow { 12 } else { 30 });
            let bar = ProgressBar::new(STEP * length)
                .with_style(style(unit, foretold, narrow))
                .with_prefix(prefix);
            let bar = bars.add(bar);
            bar.enable_steady_tick(Duration::from_millis(200));
            Form::Terminal(bar, AtomicU64::new(0))
        } else {
            let now = Instant::now();
            Form::Plain(Mutex::new(Plain {
                begun: now,
                said: now,
                done: 0,
                part: 0.0,
                before: 0,
                length,
                foretold,
                note: String::new(),
            }))
        };
        Self {
            form,
            name: name.to_owned(),
            unit,
        }
    }

    /// Sets how much of how much is done.
    pub fn set(&self, done: u64, length: u64) {
        match &self.form {
            Form::Terminal(bar, steps) => {
                steps.store(done, Ordering::Relaxed);
                bar.set_length(STEP * length);
                bar.set_position(STEP * done);
            }
            Form::Plain(plain) => {
                let mut plain = locked(plain);
                (plain.done, plain.part, plain.length) = (done, 0.0, length);
                self.say_now_and_then(&mut plain);
            }
        }
    }

    /// Is shown no more.
    pub fn clear(&self) {
        if let Form::Terminal(bar, _) = &self.form {
            bar.finish_and_clear();
        }
    }

    /// Ends with a line that says how.
    pub fn finish(&self, outcome: &str) {
        self.clear();
        tell(&format!("{}: {outcome}", self.name));
    }

    fn say_now_and_then(&self, plain: &mut Plain) {
        if plain.said.elapsed() < INTERVAL {
            return;
        }
        plain.said = Instant::now();
        let mut text = format!("{}: {}/{} {}", self.name, plain.done, plain.length, self.unit);
        let left = plain.length.saturating_sub(plain.done) as f64 - plain.part;
        let took = plain.begun.elapsed().as_secs_f64();
        let pace = pace(plain.rate(), left, plain.foretold.map(|all| all - took));
        if !pace.is_empty() {
            text += &format!(", {pace}");
        }
        if !plain.note.is_empty() {
            text += &format!(", {}", plain.note);
        }
        tell(&text);
    }
}

impl Progress for Bar {
    fn advance(&self, steps: u64) {
        match &self.form {
            Form::Terminal(bar, done) => {
                let done = done.fetch_add(steps, Ordering::Relaxed) + steps;
                bar.set_position(STEP * done);
            }
            Form::Plain(plain) => {
                let mut plain = locked(plain);
                plain.done += steps;
                plain.part = 0.0;
                self.say_now_and_then(&mut plain);
            }
        }
    }

    fn part(&self, done: f64) {
        let part = done.clamp(0.0, 1.0);
        match &self.form {
            Form::Terminal(bar, steps) => {
                let within = (STEP as f64 * part) as u64;
                bar.set_position(STEP * steps.load(Ordering::Relaxed) + within.min(STEP - 1));
            }
            Form::Plain(plain) => {
                let mut plain = locked(plain);
                plain.part = part;
                self.say_now_and_then(&mut plain);
            }
        }
    }

    fn resume(&self, steps: u64) {
        match &self.form {
            Form::Terminal(bar, done) => {
                let done = done.fetch_add(steps, Ordering::Relaxed) + steps;
                bar.set_position(STEP * done);
                bar.reset_eta();
            }
            Form::Plain(plain) => {
                let mut plain = locked(plain);
                plain.done += steps;
                plain.before += steps;
            }
        }
    }

    fn note(&self, text: &str) {
        match &self.form {
            Form::Terminal(bar, _) => bar.set_message(printable(text).into_owned()),
            Form::Plain(plain) => text.clone_into(&mut locked(plain).note),
        }
    }
}

/// The progress of a run: a bar for every stage at work.
pub struct RunProgress {
    shown: Shown,
    screen: Screen,
    /// None without a terminal.
    bars: Option<MultiProgress>,
    current: Mutex<BTreeMap<String, Bar>>,
}

impl RunProgress {
    /// Nothing under way yet.
    pub fn new(shown: Shown, screen: Screen) -> Self {
        let terminal = shown == Shown::Bars && io::stderr().is_terminal();
        Self {
            shown,
            screen,
            bars: terminal.then(MultiProgress::new),
            current: Mutex::default(),
        }
    }

    /// A line for people, where they are told more than warnings.
    pub fn note(&self, text: &str) {
        if matches!(self.shown, Shown::Bars | Shown::Lines) {
            self.say(text);
        }
    }

    /// A line above the bars.
    fn say(&self, text: &str) {
        let say = || match self.shown {
            Shown::Json => tell(text),
            _ => tell_on(self.screen, text),
        };
        match &self.bars {
            Some(bars) => bars.suspend(say),
            None => say(),
        }
    }

    /// Shows an event.
    pub fn tell(&self, event: &Event) {
        match (self.shown, event) {
            (Shown::Json, _) => tell(&printable_json(
                &serde_json::to_string(event).unwrap_or_else(|error| error.to_string()),
            )),
            (_, Event::Warning { text }) => self.say(&format!("warning: {text}")),
            (Shown::Warnings, _) => {}
            (Shown::Bars | Shown::Lines, _) => self.show(event),
        }
    }

    fn show(&self, event: &Event) {
        let mut current = locked(&self.current);
        match event {
            Event::RunStarted { .. } => line(event).iter().for_each(|text| self.say(text)),
            Event::StageStarted {
                name,
                steps,
                unit,
                price,
                ..
            } => {
                if self.bars.is_none() {
                    line(event).iter().for_each(|text| tell(text));
                }
                let foretold = price.map(|price| price.seconds.likely);
                let bar = Bar::among(self.bars.as_ref(), name, unit, *steps, foretold);
                current.insert(name.clone(), bar);
            }
            Event::Progress { name, steps } => current.get(name).iter().for_each(|bar| bar.advance(*steps)),
            Event::Part { name, done } => current.get(name).iter().for_each(|bar| bar.part(*done)),
            Event::Resumed { name, steps } => current.get(name).iter().for_each(|bar| bar.resume(*steps)),
            Event::Note { name, text } => current.get(name).iter().for_each(|bar| bar.note(text)),
            Event::ChunkBuilt { .. } | Event::Warning { .. } => {}
            Event::StageReused(report)
            | Event::StageFinished(report)
            | Event::StageFailed(report)
            | Event::StageSkipped(report) => {
                if let Some(bar) = current.remove(&report.name) {
                    bar.clear();
                }
                let word = table::outcome(report.outcome);
                let how = ended(report);
                let rest = how.strip_prefix(word).unwrap_or_default();
                let say = || tell_of(self.screen, &report.name, (word, Tone::of(report.outcome)), rest);
                match &self.bars {
                    Some(bars) => bars.suspend(say),
                    None => say(),
                }
            }
        }
    }
}

/// An event in one line; none for those that only move a bar.
pub fn line(event: &Event) -> Option<String> {
    Some(match event {
        Event::RunStarted {
            pipeline,
            stages,
            stale,
            price,
            unpriced,
        } => {
            let mut text = format!("{pipeline}: {}", counted(*stages as u64, "stages"));
            if *stale > 0 {
                text += &format!(", {stale} to build");
            }
            if price.is_some() {
                text += &format!(": {}", table::price(price.as_ref(), *unpriced));
            }
            text
        }
        Event::StageStarted {
            name,
            steps,
            unit,
            why,
            price,
            ..
        } => {
            let price = price.map_or_else(String::new, |price| format!(", about {}", table::time(&price.seconds)));
            format!("{name}: {} to do ({why}){price}", counted(*steps, unit))
        }
        Event::StageReused(report)
        | Event::StageFinished(report)
        | Event::StageFailed(report)
        | Event::StageSkipped(report) => format!("{}: {}", report.name, ended(report)),
        Event::Warning { text } => format!("warning: {text}"),
        Event::Progress { .. }
        | Event::Part { .. }
        | Event::Resumed { .. }
        | Event::Note { .. }
        | Event::ChunkBuilt { .. } => return None,
    })
}

fn ended(report: &StageReport) -> String {
    let word = table::outcome(report.outcome);
    let digest = report
        .digest
        .map_or_else(String::new, |digest| format!(" {}", digest.short()));
    match report.outcome {
        Outcome::Built => format!("{word}{digest} in {}", table::seconds(report.seconds)),
        Outcome::Failed | Outcome::Stopped => format!("{word} after {}", table::seconds(report.seconds)),
        Outcome::Skipped => format!("{word}: {}", report.why.as_deref().unwrap_or_default()),
        Outcome::Reused | Outcome::Stale | Outcome::Left => format!("{word}{digest}"),
    }
}

fn counted(n: u64, units: &str) -> String {
    let one = match units {
        "searches" => "search",
        units => units.trim_end_matches('s'),
    };
    format!("{n} {}", if n == 1 { one } else { units })
}

/// Columns from which on a terminal has room for long names and bars.
const WIDE: usize = 100;

fn style(unit: &'static str, foretold: Option<f64>, narrow: bool) -> ProgressStyle {
    let template = match narrow {
        true => "{prefix:<12} [{bar:8}] {steps}  {pace}  {wide_msg}",
        false => "{prefix:<12} [{bar:20}] {steps}  {pace}  {wide_msg}",
    };
    let steps = move |state: &ProgressState, out: &mut dyn fmt::Write| {
        let all = state.len().unwrap_or(0) / STEP;
        // A bar has nowhere to report that it cannot be written.
        let _ = write!(out, "{}/{all} {unit}", state.pos() / STEP);
    };
    let pace = move |state: &ProgressState, out: &mut dyn fmt::Write| {
        let per_second = state.per_sec() / STEP as f64;
        let rate = (state.pos() > 0 && per_second > 0.0).then_some(per_second);
        let left = state.len().unwrap_or(0).saturating_sub(state.pos()) as f64 / STEP as f64;
        let took = state.elapsed().as_secs_f64();
        let text = pace(rate, left, foretold.map(|all| all - took));
        let _ = match text.is_empty() {
            true => write!(out, "{} so far", table::seconds(took)),
            false => out.write_str(&text),
        };
    };
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    style
        .with_key("steps", steps)
        .with_key("pace", pace)
        .progress_chars("=> ")
}

/// How fast it goes, in steps per second, and how long so many steps more take; before a rate is known what was foretold and is left of
/// that, s.
fn pace(per_second: Option<f64>, left: f64, foretold: Option<f64>) -> String {
    match (per_second, foretold) {
        (Some(per_second), _) => format!("{}, {} left", rate(per_second), table::seconds(left / per_second)),
        (None, Some(left)) if left > 0.0 => format!("about {} left", table::seconds(left)),
        (None, _) => String::new(),
    }
}

/// Steps that take longer than a second are counted by the minute.
fn rate(per_second: f64) -> String {
    if per_second > 0.0 && per_second < 1.0 {
        format!("{:.1}/min", 60.0 * per_second)
    } else {
        format!("{per_second:.1}/s")
    }
}

/// A panic in another thread must not silence the rest of the run.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_steps_are_counted_by_the_minute() {
        assert_eq!(
            [0.0, 0.05, 0.999, 1.0, 12.34].map(rate),
            ["0.0/s", "3.0/min", "59.9/min", "1.0/s", "12.3/s"]
        );
    }

    #[test]
    fn a_pace_is_known_within_the_first_step() {
        assert_eq!(pace(Some(0.05), 1.5, Some(3.0)), "3.0/min, 30.0 s left");
        assert_eq!(pace(None, 2.0, Some(41.0)), "about 41.0 s left");
        assert_eq!(pace(None, 2.0, Some(-1.0)), "");
        let now = Instant::now();
        let mut plain = Plain {
            begun: now.checked_sub(Duration::from_secs(10)).unwrap_or(now),
            said: now,
            done: 3,
            part: 0.0,
            before: 3,
            length: 5,
            foretold: None,
            note: String::new(),
        };
        assert_eq!(plain.rate(), None);
        plain.part = 0.5;
        assert!(plain.rate().is_some_and(|rate| rate > 0.0 && rate < 0.06));
    }

    #[test]
    fn the_end_of_a_stage_is_told_in_one_line() {
        let report = |outcome| StageReport {
            name: "solved".into(),
            kind: "solve".into(),
            outcome,
            chunks_built: 1,
            chunks_reused: 0,
            digest: Some(crate::base::ArtifactId::of(b"")),
            seconds: 61.2,
            size: 0,
            size_built: 0,
            price: None,
            unmeasured: None,
            why: None,
            reasons: Vec::new(),
            staleness: None,
        };
        assert_eq!(ended(&report(Outcome::Built)), "built af1349b9f5f9 in 1 min 01 s");
        assert_eq!(ended(&report(Outcome::Reused)), "reused af1349b9f5f9");
        assert_eq!(ended(&report(Outcome::Failed)), "failed after 1 min 01 s");
        assert_eq!(
            [counted(1, "steps"), counted(1, "searches"), counted(2, "epochs")],
            ["1 step", "1 search", "2 epochs"]
        );
    }
}
