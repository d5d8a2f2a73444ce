//! Progress on stderr: on a terminal one line per stage at work with rate and time left; elsewhere a plain line when a stage begins,
//! every ten seconds, and when it ends; for programs every event as a line of JSON.

use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, IsTerminal};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressState, ProgressStyle};

use super::output::tell;
use super::table;
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

/// One piece of work under way.
pub struct Bar {
    form: Form,
    name: String,
    unit: &'static str,
}

enum Form {
    Terminal(ProgressBar),
    Plain(Mutex<Plain>),
}

struct Plain {
    begun: Instant,
    said: Instant,
    done: u64,
    /// Of these, what was done before it began.
    before: u64,
    length: u64,
    note: String,
}

impl Bar {
    /// Begins to show `length` steps of work.
    pub fn new(name: &str, unit: &'static str, length: u64) -> Self {
        let bars = io::stderr().is_terminal().then(MultiProgress::new);
        Self::among(bars.as_ref(), name, unit, length)
    }

    /// As progress is shown; none where no steps are.
    pub fn of(shown: Shown, name: &str, unit: &'static str) -> Option<Self> {
        match shown {
            Shown::Bars => Some(Self::new(name, unit, 0)),
            Shown::Lines => Some(Self::among(None, name, unit, 0)),
            Shown::Json | Shown::Warnings => None,
        }
    }

    /// Says a line beside it.
    pub fn say(&self, text: &str) {
        match &self.form {
            Form::Terminal(bar) => bar.suspend(|| tell(text)),
            Form::Plain(_) => tell(text),
        }
    }

    /// As [`Bar::new`], below other bars of a terminal; without a terminal by lines.
    fn among(bars: Option<&MultiProgress>, name: &str, unit: &'static str, length: u64) -> Self {
        let form = if let Some(bars) = bars {
            let bar = bars.add(
                ProgressBar::new(length)
                    .with_style(style())
                    .with_prefix(printable(name).into_owned()),
            );
            bar.enable_steady_tick(Duration::from_millis(200));
            Form::Terminal(bar)
        } else {
            let now = Instant::now();
            Form::Plain(Mutex::new(Plain {
                begun: now,
                said: now,
                done: 0,
                before: 0,
                length,
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
            Form::Terminal(bar) => {
                bar.set_length(length);
                bar.set_position(done);
            }
            Form::Plain(plain) => {
                let mut plain = locked(plain);
                (plain.done, plain.length) = (done, length);
                self.say_now_and_then(&mut plain);
            }
        }
    }

    /// Is shown no more.
    pub fn clear(&self) {
        if let Form::Terminal(bar) = &self.form {
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
        let seconds = plain.begun.elapsed().as_secs_f64();
        let mut text = format!("{}: {}/{} {}", self.name, plain.done, plain.length, self.unit);
        if plain.done > plain.before {
            let per_second = (plain.done - plain.before) as f64 / seconds;
            let left = plain.length.saturating_sub(plain.done) as f64 / per_second;
            text += &format!(", {}, {} left", rate(per_second), table::seconds(left));
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
            Form::Terminal(bar) => bar.inc(steps),
            Form::Plain(plain) => {
                let mut plain = locked(plain);
                plain.done += steps;
                self.say_now_and_then(&mut plain);
            }
        }
    }

    fn resume(&self, steps: u64) {
        match &self.form {
            Form::Terminal(bar) => {
                bar.inc(steps);
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
            Form::Terminal(bar) => bar.set_message(printable(text).into_owned()),
            Form::Plain(plain) => text.clone_into(&mut locked(plain).note),
        }
    }
}

/// The progress of a run: a bar for every stage at work.
pub struct RunProgress {
    shown: Shown,
    /// None without a terminal.
    bars: Option<MultiProgress>,
    current: Mutex<BTreeMap<String, Bar>>,
}

impl RunProgress {
    /// Nothing under way yet.
    pub fn new(shown: Shown) -> Self {
        let terminal = shown == Shown::Bars && io::stderr().is_terminal();
        Self {
            shown,
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
        match &self.bars {
            Some(bars) => bars.suspend(|| tell(text)),
            None => tell(text),
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
            Event::StageStarted { name, kind, steps, .. } => {
                if self.bars.is_none() {
                    line(event).iter().for_each(|text| tell(text));
                }
                let bar = Bar::among(self.bars.as_ref(), name, unit(kind), *steps);
                current.insert(name.clone(), bar);
            }
            Event::Progress { name, steps } => current.get(name).iter().for_each(|bar| bar.advance(*steps)),
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
                self.say(&format!("{}: {}", report.name, ended(report)));
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
            kind,
            steps,
            why,
            price,
        } => {
            let price = price.map_or_else(String::new, |price| format!(", about {}", table::time(&price.seconds)));
            format!("{name}: {} to do ({why}){price}", counted(*steps, unit(kind)))
        }
        Event::StageReused(report)
        | Event::StageFinished(report)
        | Event::StageFailed(report)
        | Event::StageSkipped(report) => format!("{}: {}", report.name, ended(report)),
        Event::Warning { text } => format!("warning: {text}"),
        Event::Progress { .. } | Event::Resumed { .. } | Event::Note { .. } | Event::ChunkBuilt { .. } => return None,
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

/// What the steps of a kind are.
fn unit(kind: &str) -> &'static str {
    match kind {
        "sample" | "patterns" | "solve" | "import" => "samples",
        "train" => "epochs",
        "design" => "generations",
        _ => "steps",
    }
}

fn counted(n: u64, units: &str) -> String {
    format!("{n} {}", if n == 1 { units.trim_end_matches('s') } else { units })
}

fn style() -> ProgressStyle {
    let template = "{prefix:<12} [{bar:20}] {pos}/{len}  {rate}, {left} left  {wide_msg}";
    let pace = |state: &ProgressState, out: &mut dyn fmt::Write| {
        // A bar has nowhere to report that it cannot be written.
        let _ = out.write_str(&rate(state.per_sec()));
    };
    // Before the first step nothing is known of the time that is left, and indicatif says zero.
    let left = |state: &ProgressState, out: &mut dyn fmt::Write| {
        let _ = match state.pos() {
            0 => out.write_str("?"),
            _ => out.write_str(&table::seconds(state.eta().as_secs_f64())),
        };
    };
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    style
        .with_key("rate", pace)
        .with_key("left", left)
        .progress_chars("=> ")
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
            (counted(1, unit("balance")), counted(2, unit("train"))),
            ("1 step".into(), "2 epochs".into())
        );
    }
}
