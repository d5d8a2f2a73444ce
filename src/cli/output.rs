//! Where results and errors go: results on stdout, errors and progress on stderr, and with `--json` exactly one document
//! on stdout whatever happens.

use std::error::Error as _;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;

use clap::ColorChoice;
use clap::error::{ContextKind, ContextValue};
use serde::Serialize;
use serde_json::json;

use super::error::CliError;
use super::text::{Text, lines};
use super::tone::{Screen, Tone};
use deaflow_base::{is_unprintable, printable, printable_json};

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Done.
    Done,
    /// It failed.
    Failure,
    /// The input cannot be used.
    BadInput,
    /// Done, but for some samples no stable solution was found.
    Unstable,
    /// The store is damaged.
    Damaged,
    /// An audit found errors.
    Findings,
    /// The pipeline, or what it made, is not what its lock file says.
    Locked,
    /// It was stopped, or the machine or the disk refused: to try again may help (`EX_TEMPFAIL` of `sysexits.h`).
    TryAgain,
}

impl Exit {
    /// The number that the shell sees.
    pub fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::Failure => 1,
            Self::BadInput => 2,
            Self::Unstable => 3,
            Self::Damaged => 4,
            Self::Findings => 5,
            Self::Locked => 6,
            Self::TryAgain => 75,
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}

/// The way out of a command.
pub struct Output {
    json: bool,
    /// Where results go.
    screen: Screen,
    /// Where errors and progress go.
    beside: Screen,
}

impl Output {
    /// For people, or with one JSON document; with colours or without.
    pub fn new(json: bool, colour: ColorChoice) -> Self {
        Self {
            json,
            screen: Screen::of(&io::stdout(), colour),
            beside: Screen::of(&io::stderr(), colour),
        }
    }

    /// Where errors and progress go.
    pub fn beside(&self) -> Screen {
        self.beside
    }

    /// Whether one JSON document is wanted.
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// Prints a text, ended by a line break, for people, as it fits the terminal; nothing where there is none.
    ///
    /// # Errors
    /// When stdout refuses.
    pub fn text(&self, text: impl Into<Text>) -> Result<(), CliError> {
        let text = text.into();
        if text.is_empty() {
            return Ok(());
        }
        Self::print(&text.show(self.screen))
    }

    /// Prints what other programs read (a table in CSV, a script, a drawing) as it is, ended by a line break.
    ///
    /// # Errors
    /// When stdout refuses.
    pub fn plain(&self, text: &str) -> Result<(), CliError> {
        if text.is_empty() {
            return Ok(());
        }
        Self::print(&printable(text))
    }

    /// Prints the document.
    ///
    /// # Errors
    /// When stdout refuses.
    pub fn document(&self, document: &impl Serialize) -> Result<(), CliError> {
        let text = serde_json::to_string_pretty(document).map_err(io::Error::from)?;
        Self::print(&printable_json(&text))
    }

    /// The only way to stdout.
    fn print(text: &str) -> Result<(), CliError> {
        let mut out = io::stdout().lock();
        Ok(writeln!(out, "{}", text.trim_end_matches('\n')).and_then(|()| out.flush())?)
    }

    /// Reports how a command ended.
    pub fn end(&self, done: Result<Exit, CliError>) -> Exit {
        let error = match done {
            Ok(exit) => return exit,
            // Whoever reads us has had enough (`deaflow show … | head`).
            Err(error) if error.is_closed_pipe() => return Exit::Done,
            Err(error) => error,
        };
        if self.json && self.document(&json!({ "error": error.to_json() })).is_err() {
            self.report(&error);
            return Exit::Failure;
        }
        // Its colours are for the terminal; that nothing else in it is, `render` sees to.
        self.report(&error);
        error.exit()
    }

    /// Reports what went wrong beside what is printed. Its colours are for the terminal; that nothing else in it is, `render` sees to.
    pub fn report(&self, error: &CliError) {
        write_line(&error.render(self.beside));
    }

    /// Reports an error or a warning beside what is printed.
    pub fn complain(&self, text: &str) {
        tell_on(self.beside, text);
    }

    /// Reports what clap has to say: an error of usage, or the help that was asked for.
    pub fn usage(&self, error: &clap::Error) -> Exit {
        let asked_for = !error.use_stderr();
        if let Some(why) = unnamed(error) {
            return self.end(Err(CliError::bad_input(format!("no pipeline is named: {why}"))));
        }
        let text = error.render().to_string();
        // What is quoted may be the name of a file that somebody else gave it.
        if !asked_for && (self.json || text.contains(is_unprintable)) {
            // Where people find more is no part of what is wrong.
            let text = text.split("\n\nFor more information").next().unwrap_or_default();
            return self.end(Err(CliError::bad_input(text.trim().trim_start_matches("error: "))));
        }
        match error.print() {
            Err(e) if e.kind() != ErrorKind::BrokenPipe => Exit::Failure,
            _ if asked_for => Exit::Done,
            _ => Exit::BadInput,
        }
    }
}

/// Why the folder in which a command is given does not stand for a pipeline, where that is what is wrong: nobody has named it.
fn unnamed(error: &clap::Error) -> Option<String> {
    let is = |kind, text: &str| matches!(error.get(kind), Some(ContextValue::String(found)) if found == text);
    let is_unnamed = is(ContextKind::InvalidArg, "[PIPELINE]") && is(ContextKind::InvalidValue, ".");
    is_unnamed.then(|| error.source().map(ToString::to_string)).flatten()
}

/// Writes lines to stderr for programs.
pub fn tell(text: &str) {
    write_line(&printable(text));
}

/// Writes lines to stderr for whoever watches, as they fit there.
pub fn tell_on(screen: Screen, text: &str) {
    write_line(&lines(printable(text).trim_end_matches('\n'), Tone::Plain, screen));
}

/// Writes what became of something to stderr: its name, the word for it in its colour, and the rest.
pub fn tell_of(screen: Screen, name: &str, (word, tone): (&'static str, Tone), rest: &str) {
    let (name, rest) = (printable(name), printable(rest));
    let plain = Screen {
        is_coloured: false,
        ..screen
    };
    let text = lines(&format!("{name}: {word}{rest}"), Tone::Plain, plain);
    let before = format!("{name}: ");
    match text.strip_prefix(&before).and_then(|text| text.strip_prefix(word)) {
        Some(rest) => write_line(&format!("{before}{}{rest}", tone.paint(word, screen.is_coloured))),
        None => write_line(&text),
    }
}

/// The only way to stderr, but for a bar of progress.
fn write_line(text: &str) {
    // There is nowhere left to say that stderr is closed.
    let _ = writeln!(io::stderr().lock(), "{}", text.trim_end_matches('\n'));
}
