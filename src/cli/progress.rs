//! Progress on stderr: on a terminal one line per running stage with rate and remaining time; elsewhere a plain line
//! when a
//! stage begins, every ten seconds, and when it ends; for programs one line of JSON per event.

use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, IsTerminal};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressState, ProgressStyle};
use textwrap::core::display_width;

use super::columns::cut;
use super::output::{print_lines, print_outcome, print_plain};
use super::pace::Pace;
use super::table;
use super::tone::{Screen, Tone, width_of_stderr};
use deaflow_base::{Background, Pauses, Progress, printable, printable_json};
use deaflow_orchestrator::{Event, Outcome, StageReport, Staleness};

/// The smallest difference between the time of a stage and its share of the run that is shown: this fraction, and s.
const MIN_DIFFERENCE: f64 = 0.05;

/// The most reasons that are listed when a stage begins.
const MAX_REASONS: usize = 3;

/// The unit of steps of several kinds; steps of one kind have its name.
const SEVERAL_KINDS: &str = "steps";

/// The time between two plain lines.
const INTERVAL: Duration = Duration::from_secs(10);

/// How to show progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProgressMode {
    /// Bars on a terminal, lines elsewhere.
    Bars,
    /// Lines.
    Lines,
    /// One JSON document per line.
    Json,
    /// Warnings only.
    Warnings,
}

/// A progress bar that appears only if the work takes long.
pub struct DelayedBar {
    name: &'static str,
    unit: &'static str,
    begun: Instant,
    bar: OnceLock<Bar>,
}

impl DelayedBar {
    /// Starts the clock.
    pub fn new(name: &'static str, unit: &'static str) -> Self {
        Self {
            name,
            unit,
            begun: Instant::now(),
            bar: OnceLock::new(),
        }
    }

    /// Sets the number of finished steps, and of all.
    pub fn set(&self, done: u64, length: u64) {
        if self.begun.elapsed() > DELAY {
            let bar = self.bar.get_or_init(|| Bar::new(self.name, self.unit, length));
            bar.set(done, length);
        }
    }

    /// Removes the bar.
    pub fn clear(&self) {
        if let Some(bar) = self.bar.get() {
            bar.clear();
        }
    }
}

/// Shows a number that the work counts, if it takes long, until the returned guard is dropped. `length` is the number
/// at the end; 0 if it is not known.
pub fn show_count(
    mode: ProgressMode,
    [name, unit]: [&'static str; 2],
    done: Arc<AtomicU64>,
    length: u64,
) -> Option<Background> {
    /// The time between two updates.
    const TICK: Duration = Duration::from_millis(500);
    let show = move |pauses: &Pauses| {
        if !pauses.wait(DELAY) {
            return;
        }
        let Some(bar) = Bar::with_mode(mode, name, unit) else {
            return;
        };
        bar.set(done.load(Ordering::Relaxed), length);
        while pauses.wait(TICK) {
            bar.set(done.load(Ordering::Relaxed), length);
        }
        bar.clear();
    };
    // Without the thread nothing is shown.
    Background::start(name, show).ok()
}

/// The time after which the bar appears.
const DELAY: Duration = Duration::from_secs(2);

/// A progress bar, or lines of progress without a terminal.
pub struct Bar {
    begun: Instant,
    state: Arc<Mutex<BarState>>,
    form: BarForm,
}

/// What a bar shows.
struct BarState {
    name: String,
    unit: &'static str,
    pace: Pace,
    note: String,
}

enum BarForm {
    Terminal(ProgressBar),
    /// Lines, with the time of the last one.
    Plain(Mutex<Instant>),
}

impl Bar {
    /// Shows `length` steps of work.
    pub fn new(name: &str, unit: &'static str, length: u64) -> Self {
        let bars = io::stderr().is_terminal().then(MultiProgress::new);
        Self::among(bars.as_ref(), name, unit, length, None)
    }

    /// Shows work in a mode; none if the mode does not show steps.
    pub fn with_mode(mode: ProgressMode, name: &str, unit: &'static str) -> Option<Self> {
        match mode {
            ProgressMode::Bars => Some(Self::new(name, unit, 0)),
            ProgressMode::Lines => Some(Self::among(None, name, unit, 0, None)),
            ProgressMode::Json | ProgressMode::Warnings => None,
        }
    }

    /// Prints a line above the bar.
    pub fn print(&self, text: &str) {
        match &self.form {
            BarForm::Terminal(bar) => bar.suspend(|| print_plain(text)),
            BarForm::Plain(_) => print_plain(text),
        }
    }

    /// Shows work below other bars of a terminal, or as lines without a terminal; `estimate` is its estimated time, s.
    fn among(bars: Option<&MultiProgress>, name: &str, unit: &'static str, length: u64, estimate: Option<f64>) -> Self {
        let begun = Instant::now();
        let state = Arc::new(Mutex::new(BarState {
            name: printable(name).into_owned(),
            unit,
            pace: match unit {
                SEVERAL_KINDS => Pace::new(length, estimate).of_several_kinds(),
                _ => Pace::new(length, estimate),
            },
            note: String::new(),
        }));
        let form = match bars {
            Some(bars) => {
                let bar = bars.add(ProgressBar::new_spinner().with_style(style(begun, state.clone())));
                bar.enable_steady_tick(Duration::from_millis(200));
                BarForm::Terminal(bar)
            }
            None => BarForm::Plain(Mutex::new(begun)),
        };
        Self { begun, state, form }
    }

    /// Sets the number of finished steps, and of all.
    pub fn set(&self, done: u64, length: u64) {
        self.update(|pace, at| pace.set(at, done, length));
    }

    fn update(&self, change: impl FnOnce(&mut Pace, f64)) {
        let mut state = locked(&self.state);
        change(&mut state.pace, self.begun.elapsed().as_secs_f64());
        if let BarForm::Plain(last) = &self.form {
            let mut last = locked(last);
            if last.elapsed() >= INTERVAL {
                *last = Instant::now();
                print_plain(&state.plain(self.begun.elapsed().as_secs_f64()));
            }
        }
    }

    /// Removes the bar.
    pub fn clear(&self) {
        if let BarForm::Terminal(bar) = &self.form {
            bar.finish_and_clear();
        }
    }
}

impl Progress for Bar {
    fn advance(&self, steps: u64) {
        self.update(|pace, at| pace.advance(at, steps));
    }

    fn part(&self, done: f64) {
        self.update(|pace, at| pace.set_part(at, done));
    }

    fn resume(&self, steps: u64) {
        self.update(|pace, at| pace.resume(at, steps));
    }

    fn note(&self, text: &str) {
        locked(&self.state).note = printable(text).into_owned();
    }
}

impl BarState {
    fn steps(&self) -> String {
        match self.pace.length {
            0 => format!("{} {}", self.pace.done, self.unit),
            length => format!("{}/{length} {}", self.pace.done, self.unit),
        }
    }

    /// Formats all of it in a line.
    fn plain(&self, at: f64) -> String {
        let mut text = format!("{}: {}", self.name, self.steps());
        let pace = self.pace.describe(at);
        for more in [pace.as_str(), self.note.as_str()]
            .iter()
            .filter(|more| !more.is_empty())
        {
            text += &format!(", {more}");
        }
        text
    }

    /// Formats a line of a terminal. Parts without space are omitted as a whole: a truncated number would be wrong.
    fn on_terminal(&self, at: f64, width: usize) -> String {
        let (name_width, bar) = if width < WIDE { (12, 8) } else { (30, 20) };
        let name = cut(&self.name, name_width);
        let name = name.clone() + &" ".repeat(12_usize.saturating_sub(display_width(&name)));
        let pace = self.pace.describe(at);
        let pace = match pace.is_empty() {
            true => format!("{} so far", table::seconds(at)),
            false => pace,
        };
        let mut line = match self.pace.length {
            0 => format!("{name} {}", self.steps()),
            _ => format!("{name} {} {}", draw_bar(&self.pace, bar), self.steps()),
        };
        if display_width(&line) > width {
            line = format!("{} {}", name.trim_end(), self.steps());
        }
        let parts = std::iter::once(pace.as_str()).chain(self.note.split(", ").filter(|part| !part.is_empty()));
        for (index, part) in parts.enumerate() {
            let between = if index < 2 { "  " } else { ", " };
            if display_width(&line) + display_width(between) + display_width(part) > width {
                break;
            }
            line += between;
            line += part;
        }
        cut(&line, width)
    }
}

/// Draws a bar of `columns` columns between brackets.
fn draw_bar(pace: &Pace, columns: usize) -> String {
    let fraction = (pace.position() / pace.length.max(1) as f64).clamp(0.0, 1.0);
    let full = (fraction * columns as f64) as usize;
    let head = if full < columns && fraction > 0.0 { ">" } else { "" };
    format!("[{:<columns$}]", "=".repeat(full) + head)
}

/// The progress of a run: a bar for each running stage.
pub struct RunProgress {
    mode: ProgressMode,
    screen: Screen,
    /// None without a terminal.
    bars: Option<MultiProgress>,
    current: Mutex<BTreeMap<String, Bar>>,
}

impl RunProgress {
    /// Shows progress in a mode.
    pub fn new(mode: ProgressMode, screen: Screen) -> Self {
        let terminal = mode == ProgressMode::Bars && io::stderr().is_terminal();
        Self {
            mode,
            screen,
            bars: terminal.then(MultiProgress::new),
            current: Mutex::default(),
        }
    }

    /// Prints a line for people, unless only warnings are shown.
    pub fn note(&self, text: &str) {
        if matches!(self.mode, ProgressMode::Bars | ProgressMode::Lines) {
            self.print(text);
        }
    }

    /// Prints a line above the bars.
    fn print(&self, text: &str) {
        self.above_bars(|| match self.mode {
            ProgressMode::Json => print_plain(text),
            _ => print_lines(self.screen, text),
        });
    }

    fn above_bars(&self, print: impl FnOnce()) {
        match &self.bars {
            Some(bars) => bars.suspend(print),
            None => print(),
        }
    }

    /// Shows an event.
    pub fn show(&self, event: &Event) {
        match (self.mode, event) {
            (ProgressMode::Json, _) => print_plain(&printable_json(
                &serde_json::to_string(event).unwrap_or_else(|error| error.to_string()),
            )),
            (_, Event::Warning { text }) => self.print(&format!("warning: {text}")),
            // A damaged store is worth a look, also where no progress is shown.
            (
                ProgressMode::Warnings,
                Event::StageStarted {
                    name,
                    why: Staleness::ArtifactDamaged,
                    ..
                },
            ) => self.print(&format!("warning: {name}: its artifact was damaged and is built anew")),
            (ProgressMode::Warnings, _) => {}
            (ProgressMode::Bars | ProgressMode::Lines, _) => self.show_to_people(event),
        }
    }

    fn show_to_people(&self, event: &Event) {
        let mut current = locked(&self.current);
        match event {
            Event::RunStarted { .. } => line(event).iter().for_each(|text| self.print(text)),
            Event::StageStarted {
                name,
                steps,
                unit,
                price,
                ..
            } => {
                if self.bars.is_none() {
                    line(event).iter().for_each(|text| print_plain(text));
                }
                let estimate = price.map(|price| price.seconds.likely);
                let bar = Bar::among(self.bars.as_ref(), name, unit, *steps, estimate);
                current.insert(name.clone(), bar);
            }
            Event::Progress { name, steps } => current.get(name).iter().for_each(|bar| bar.advance(*steps)),
            Event::Part { name, done } => current.get(name).iter().for_each(|bar| bar.part(*done)),
            Event::Resumed { name, steps, .. } => {
                current.get(name).iter().for_each(|bar| bar.resume(*steps));
                line(event).iter().for_each(|text| self.print(text));
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
                let ending = ending(report);
                let rest = ending.strip_prefix(word).unwrap_or_default();
                let tone = Tone::of(report.outcome);
                self.above_bars(|| print_outcome(self.screen, &report.name, (word, tone), rest));
            }
        }
    }
}

/// Describes an event in a line; none for an event that only moves a bar.
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
                format!(", estimated time {}", table::time(&price.seconds))
            });
            let why = match reasons.len() {
                0..=MAX_REASONS => reasons.join("; "),
                n => format!("{}; and {} more", reasons[..MAX_REASONS].join("; "), n - MAX_REASONS),
            };
            match steps {
                0 => format!("{name}: all chunks are reused"),
                steps => format!("{name}: {} to do ({why}){price}", table::counted(*steps, unit)),
            }
        }
        Event::StageReused(report)
        | Event::StageFinished(report)
        | Event::StageFailed(report)
        | Event::StageSkipped(report) => format!("{}: {}", report.name, ending(report)),
        Event::Warning { text } => format!("warning: {text}"),
        Event::Resumed { name, steps, unit } => {
            let done = table::counted(*steps, unit);
            format!("{name}: continues after {done} of an earlier run")
        }
        Event::Progress { .. } | Event::Part { .. } | Event::Note { .. } | Event::ChunkBuilt { .. } => return None,
    })
}

/// Describes how a stage ended.
fn ending(report: &StageReport) -> String {
    let word = table::outcome(report.outcome);
    let digest = report
        .digest
        .map_or_else(String::new, |digest| format!(" {}", digest.short()));
    match report.outcome {
        Outcome::Built => {
            let took = table::seconds(report.seconds);
            let is_less = |part: &f64| report.seconds - part > MIN_DIFFERENCE.max(MIN_DIFFERENCE * report.seconds);
            match report.part.filter(is_less).map(table::seconds) {
                Some(part) => format!("{word}{digest} in {took} ({part} of the time of the run)"),
                None => format!("{word}{digest} in {took}"),
            }
        }
        Outcome::Failed | Outcome::Stopped => format!("{word} after {}", table::seconds(report.seconds)),
        Outcome::Skipped => format!("{word}: {}", report.why.as_deref().unwrap_or_default()),
        Outcome::Reused | Outcome::Stale | Outcome::Left => format!("{word}{digest}"),
    }
}

/// The width of a terminal from which names and bars are long.
const WIDE: usize = 100;

fn style(begun: Instant, state: Arc<Mutex<BarState>>) -> ProgressStyle {
    let line = move |_: &ProgressState, out: &mut dyn fmt::Write| {
        let at = begun.elapsed().as_secs_f64();
        // The last column stays free: some terminals wrap a line that fills it.
        let width = width_of_stderr().unwrap_or(WIDE).saturating_sub(1);
        // There is nowhere to report an error of the bar.
        let _ = out.write_str(&locked(&state).on_terminal(at, width));
    };
    let style = ProgressStyle::with_template("{line}").unwrap_or_else(|_| ProgressStyle::default_spinner());
    style.with_key("line", line)
}

/// Locks a mutex, even after a panic in another thread.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_orchestrator::Staleness;

    #[test]
    fn a_stage_whose_chunks_are_all_reused_has_nothing_to_do() {
        let started = |steps: u64| {
            line(&Event::StageStarted {
                name: "solved@r=6mm".to_owned(),
                kind: "solve".to_owned(),
                steps,
                unit: "patterns",
                why: Staleness::NoRecord,
                reasons: vec!["not built yet".to_owned()],
                price: None,
            })
        };
        assert_eq!(started(0).unwrap(), "solved@r=6mm: all chunks are reused");
        assert_eq!(started(2).unwrap(), "solved@r=6mm: 2 patterns to do (not built yet)");
    }

    fn state(name: &str, note: &str) -> BarState {
        let mut pace = Pace::new(40, None);
        pace.set_part(0.0, 0.0);
        pace.advance(100.0, 20);
        BarState {
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
    fn the_end_of_a_stage_is_one_line() {
        let report = |outcome| StageReport {
            chunks_built: 1,
            digest: Some(deaflow_base::ArtifactId::of(b"")),
            seconds: 61.2,
            ..StageReport::new("solved", "solve", outcome)
        };
        assert_eq!(ending(&report(Outcome::Built)), "built af1349b9f5f9 in 1 min 01 s");
        let shared = StageReport {
            part: Some(30.6),
            ..report(Outcome::Built)
        };
        assert!(ending(&shared).starts_with("built af1349b9f5f9 in 1 min 01 s (30.6 s of"));
        assert_eq!(ending(&report(Outcome::Reused)), "reused af1349b9f5f9");
        assert_eq!(ending(&report(Outcome::Failed)), "failed after 1 min 01 s");
    }
}
