//! Progress on stderr: on a terminal one line per stage at work with rate and time left; elsewhere a plain line when a stage begins,
//! every ten seconds, and when it ends; for programs every event as a line of JSON.

use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, IsTerminal};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressState, ProgressStyle};
use textwrap::core::display_width;

use super::columns::cut;
use super::output::{tell, tell_of, tell_on};
use super::pace::Pace;
use super::table;
use super::tone::{Screen, Tone, width_of_stderr};
use deaflow_base::{Progress, printable, printable_json};
use deaflow_orchestrator::{Event, Outcome, StageReport};

/// A part of the time of a stage, and of a second, by which its two clocks must differ to be told apart.
const TELLING: f64 = 0.05;

/// Reasons for which a stage is built that are told as it begins.
const REASONS: usize = 3;

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

    /// Is shown no more.
    pub fn clear(&self) {
        if let Some(bar) = self.bar.get() {
            bar.clear();
        }
    }
}

/// Work that takes longer shows its progress.
const PATIENCE: Duration = Duration::from_secs(2);

/// One piece of work under way.
pub struct Bar {
    begun: Instant,
    state: Arc<Mutex<State>>,
    form: Form,
}

/// What is shown of it.
struct State {
    name: String,
    unit: &'static str,
    pace: Pace,
    note: String,
}

enum Form {
    Terminal(ProgressBar),
    /// By lines, the last of them then.
    Plain(Mutex<Instant>),
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
            Form::Terminal(bar) => bar.suspend(|| tell(text)),
            Form::Plain(_) => tell(text),
        }
    }

    /// As [`Bar::new`], below other bars of a terminal; without a terminal by lines. `foretold` is what all of it is to take, s.
    fn among(bars: Option<&MultiProgress>, name: &str, unit: &'static str, length: u64, foretold: Option<f64>) -> Self {
        let begun = Instant::now();
        let state = Arc::new(Mutex::new(State {
            name: printable(name).into_owned(),
            unit,
            pace: Pace::new(length, foretold),
            note: String::new(),
        }));
        let form = match bars {
            Some(bars) => {
                let bar = bars.add(ProgressBar::new_spinner().with_style(style(begun, state.clone())));
                bar.enable_steady_tick(Duration::from_millis(200));
                Form::Terminal(bar)
            }
            None => Form::Plain(Mutex::new(begun)),
        };
        Self { begun, state, form }
    }

    /// Sets how much of how much is done.
    pub fn set(&self, done: u64, length: u64) {
        self.moved(|pace, at| pace.set(at, done, length));
    }

    fn moved(&self, how: impl FnOnce(&mut Pace, f64)) {
        let mut state = locked(&self.state);
        how(&mut state.pace, self.begun.elapsed().as_secs_f64());
        if let Form::Plain(said) = &self.form {
            let mut said = locked(said);
            if said.elapsed() >= INTERVAL {
                *said = Instant::now();
                tell(&state.plain(self.begun.elapsed().as_secs_f64()));
            }
        }
    }

    /// Is shown no more. How the work ended is said on stdout, or by an error.
    pub fn clear(&self) {
        if let Form::Terminal(bar) = &self.form {
            bar.finish_and_clear();
        }
    }
}

impl Progress for Bar {
    fn advance(&self, steps: u64) {
        self.moved(|pace, at| pace.advance(at, steps));
    }

    fn part(&self, done: f64) {
        self.moved(|pace, at| pace.set_part(at, done));
    }

    fn resume(&self, steps: u64) {
        self.moved(|pace, at| pace.resume(at, steps));
    }

    fn note(&self, text: &str) {
        locked(&self.state).note = printable(text).into_owned();
    }
}

impl State {
    fn steps(&self) -> String {
        format!("{}/{} {}", self.pace.done, self.pace.length, self.unit)
    }

    /// In a line that says all.
    fn plain(&self, at: f64) -> String {
        let mut text = format!("{}: {}", self.name, self.steps());
        let pace = self.pace.words(at);
        for more in [pace.as_str(), self.note.as_str()]
            .iter()
            .filter(|more| !more.is_empty())
        {
            text += &format!(", {more}");
        }
        text
    }

    /// In a line of a terminal. What there is no room for is left out whole: a number that is cut says another one.
    fn on_terminal(&self, at: f64, width: usize) -> String {
        let (room, bar) = if width < WIDE { (12, 8) } else { (30, 20) };
        let name = cut(&self.name, room);
        let name = name.clone() + &" ".repeat(12_usize.saturating_sub(display_width(&name)));
        let pace = self.pace.words(at);
        let pace = match pace.is_empty() {
            true => format!("{} so far", table::seconds(at)),
            false => pace,
        };
        let mut line = format!("{name} {} {}", drawn(&self.pace, bar), self.steps());
        if display_width(&line) > width {
            line = format!("{} {}", name.trim_end(), self.steps());
        }
        let parts = std::iter::once(pace.as_str()).chain(self.note.split(", ").filter(|part| !part.is_empty()));
        for (place, part) in parts.enumerate() {
            let between = if place < 2 { "  " } else { ", " };
            if display_width(&line) + display_width(between) + display_width(part) > width {
                break;
            }
            line += between;
            line += part;
        }
        cut(&line, width)
    }
}

/// A bar of so many columns between brackets.
fn drawn(pace: &Pace, columns: usize) -> String {
    let share = (pace.position() / pace.length.max(1) as f64).clamp(0.0, 1.0);
    let full = (share * columns as f64) as usize;
    let head = if full < columns && share > 0.0 { ">" } else { "" };
    format!("[{:<columns$}]", "=".repeat(full) + head)
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
            Event::Resumed { name, steps, .. } => {
                current.get(name).iter().for_each(|bar| bar.resume(*steps));
                line(event).iter().for_each(|text| self.say(text));
            }
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
            let mut text = format!("{pipeline}: {}", table::counted(*stages as u64, "stages"));
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
            reasons,
            price,
            ..
        } => {
            let price = price.map_or_else(String::new, |price| {
                format!(", about {} of the run's time", table::time(&price.seconds))
            });
            let why = match reasons.len() {
                0..=REASONS => reasons.join("; "),
                n => format!("{}; and {} more", reasons[..REASONS].join("; "), n - REASONS),
            };
            format!("{name}: {} to do ({why}){price}", table::counted(*steps, unit))
        }
        Event::StageReused(report)
        | Event::StageFinished(report)
        | Event::StageFailed(report)
        | Event::StageSkipped(report) => format!("{}: {}", report.name, ended(report)),
        Event::Warning { text } => format!("warning: {text}"),
        Event::Resumed { name, steps, unit } => {
            let done = table::counted(*steps, unit);
            format!("{name}: goes on after {done} that an earlier run has done")
        }
        Event::Progress { .. } | Event::Part { .. } | Event::Note { .. } | Event::ChunkBuilt { .. } => return None,
    })
}

fn ended(report: &StageReport) -> String {
    let word = table::outcome(report.outcome);
    let digest = report
        .digest
        .map_or_else(String::new, |digest| format!(" {}", digest.short()));
    match report.outcome {
        Outcome::Built => {
            let took = table::seconds(report.seconds);
            let is_less = |part: &f64| report.seconds - part > TELLING.max(TELLING * report.seconds);
            match report.part.filter(is_less).map(table::seconds) {
                Some(part) => format!("{word}{digest} in {took} ({part} of the run's time)"),
                None => format!("{word}{digest} in {took}"),
            }
        }
        Outcome::Failed | Outcome::Stopped => format!("{word} after {}", table::seconds(report.seconds)),
        Outcome::Skipped => format!("{word}: {}", report.why.as_deref().unwrap_or_default()),
        Outcome::Reused | Outcome::Stale | Outcome::Left => format!("{word}{digest}"),
    }
}

/// Columns from which on a terminal has room for long names and bars.
const WIDE: usize = 100;

fn style(begun: Instant, of: Arc<Mutex<State>>) -> ProgressStyle {
    let line = move |_: &ProgressState, out: &mut dyn fmt::Write| {
        let at = begun.elapsed().as_secs_f64();
        // The last column stays free: some terminals break a line that fills it.
        let width = width_of_stderr().unwrap_or(WIDE).saturating_sub(1);
        // A bar has nowhere to report that it cannot be written.
        let _ = out.write_str(&locked(&of).on_terminal(at, width));
    };
    let style = ProgressStyle::with_template("{line}").unwrap_or_else(|_| ProgressStyle::default_spinner());
    style.with_key("line", line)
}

/// A panic in another thread must not silence the rest of the run.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(name: &str, note: &str) -> State {
        let mut pace = Pace::new(40, None);
        pace.set_part(0.0, 0.0);
        pace.advance(100.0, 20);
        State {
            name: name.to_owned(),
            unit: "generations",
            pace,
            note: note.to_owned(),
        }
    }

    #[test]
    fn a_bar_leaves_out_what_there_is_no_room_for_and_cuts_no_number() {
        let note = "generation 20: best 2.1234 mm at area 0.500, of 12345";
        let of = |width| state("design", note).on_terminal(100.0, width);
        let start = "design       [====>   ] 20/40 generations";
        assert_eq!(of(67), start);
        assert_eq!(of(68), format!("{start}  12.0/min, 1 min 40 s left"));
        assert_eq!(of(79), format!("{start}  12.0/min, 1 min 40 s left"));
        assert_eq!(
            of(150),
            format!("design       [==========>         ] 20/40 generations  12.0/min, 1 min 40 s left  {note}")
        );
        assert_eq!(of(30), "design 20/40 generations");
        let long = state("a stage of a very long name", note);
        for width in 20..200 {
            assert!(display_width(&long.on_terminal(100.0, width)) <= width, "{width}");
        }
        assert_eq!(
            state("design", "loss 1").plain(100.0),
            "design: 20/40 generations, 12.0/min, 1 min 40 s left, loss 1"
        );
    }

    #[test]
    fn the_end_of_a_stage_is_told_in_one_line() {
        let report = |outcome| StageReport {
            chunks_built: 1,
            digest: Some(deaflow_base::ArtifactId::of(b"")),
            seconds: 61.2,
            ..StageReport::new("solved", "solve", outcome)
        };
        assert_eq!(ended(&report(Outcome::Built)), "built af1349b9f5f9 in 1 min 01 s");
        let shared = StageReport {
            part: Some(30.6),
            ..report(Outcome::Built)
        };
        assert_eq!(
            ended(&shared),
            "built af1349b9f5f9 in 1 min 01 s (30.6 s of the run's time)"
        );
        assert_eq!(ended(&report(Outcome::Reused)), "reused af1349b9f5f9");
        assert_eq!(ended(&report(Outcome::Failed)), "failed after 1 min 01 s");
    }
}
