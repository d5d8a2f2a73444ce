//! Prints results to stdout, errors and progress to stderr; with `--json`, stdout gets exactly one JSON document.

use std::error::Error as _;
use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use clap::ColorChoice;
use clap::error::{ContextKind, ContextValue};
use serde::Serialize;
use serde_json::{Value, json};

use super::CliError;
use super::commands::command_line;
use super::text::{Text, lines};
use super::tone::{Screen, Tone};
use deaflow_base::{nearest, printable, printable_json};

/// How a command ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Success.
    Done,
    /// Failure.
    Failure,
    /// The input is invalid.
    BadInput,
    /// Success, but some samples have no stable solution.
    Unstable,
    /// The store is damaged.
    Damaged,
    /// An audit found errors.
    Findings,
    /// The pipeline or its results differ from the lock file.
    Locked,
    /// Done, but the search of a fit did not converge.
    NotConverged,
    /// Stopped, or refused by the machine or the disk: trying again may help (`EX_TEMPFAIL` of `sysexits.h`).
    TryAgain,
}

impl Exit {
    /// Returns the exit code.
    pub fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::Failure => 1,
            Self::BadInput => 2,
            Self::Unstable => 3,
            Self::Damaged => 4,
            Self::Findings => 5,
            Self::Locked => 6,
            Self::NotConverged => 7,
            Self::TryAgain => 75,
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}

/// Adds warnings to the list of a document; a document that is no mapping stays.
fn with_warnings(mut document: Value, added: &[String]) -> Value {
    if let Some(document) = document.as_object_mut() {
        let known = document.entry("warnings").or_insert_with(|| json!([]));
        if let Some(known) = known.as_array_mut() {
            known.extend(added.iter().map(|text| json!(text)));
        }
    }
    document
}

/// Prints what a command has to report.
pub struct Output {
    json: bool,
    /// The terminal of stdout.
    screen: Screen,
    /// The terminal of stderr.
    errors: Screen,
    /// How numbers without a unit were read, for the warnings of the JSON document.
    units: Mutex<Vec<String>>,
}

impl Output {
    /// Prints text for people, or one JSON document, with or without colours.
    pub fn new(json: bool, colour: ColorChoice) -> Self {
        Self {
            json,
            screen: Screen::of(&io::stdout(), colour),
            errors: Screen::of(&io::stderr(), colour),
            units: Mutex::default(),
        }
    }

    /// The terminal of errors and progress.
    pub fn errors(&self) -> Screen {
        self.errors
    }

    /// Whether to print one JSON document.
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// Prints the result of a command: a document for programs or a text for people. Returns [`Exit::Done`].
    ///
    /// # Errors
    /// When stdout refuses.
    pub fn result<D: Serialize, T: Into<Text>>(
        &self,
        document: impl FnOnce() -> D,
        text: impl FnOnce() -> T,
    ) -> Result<Exit, CliError> {
        match self.json {
            true => self.document(&document())?,
            false => self.text(text())?,
        }
        Ok(Exit::Done)
    }

    /// Prints a text for people, as it fits the terminal; nothing if it is empty.
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

    /// Prints text for other programs (a table in CSV, a script, a drawing) unchanged.
    ///
    /// # Errors
    /// When stdout refuses.
    pub fn plain(&self, text: &str) -> Result<(), CliError> {
        if text.is_empty() {
            return Ok(());
        }
        Self::print(&printable(text))
    }

    /// Prints a JSON document.
    ///
    /// # Errors
    /// When stdout refuses.
    pub fn document(&self, document: &impl Serialize) -> Result<(), CliError> {
        let units = self.units.lock().unwrap_or_else(PoisonError::into_inner);
        let text = match units.is_empty() {
            true => serde_json::to_string_pretty(document),
            false => serde_json::to_value(document)
                .map(|document| with_warnings(document, &units))
                .and_then(|document| serde_json::to_string_pretty(&document)),
        };
        Self::print(&printable_json(&text.map_err(io::Error::from)?))
    }

    /// Writes to stdout; nothing else does.
    fn print(text: &str) -> Result<(), CliError> {
        let mut out = io::stdout().lock();
        Ok(writeln!(out, "{}", text.trim_end_matches('\n')).and_then(|()| out.flush())?)
    }

    /// Reports the error of a command, if any, and returns how it ends.
    pub fn end(&self, done: Result<Exit, CliError>) -> Exit {
        let error = match done {
            Ok(exit) => return exit,
            // The reader has stopped (`deaflow show … | head`).
            Err(error) if error.is_closed_pipe() => return Exit::Done,
            Err(error) => error,
        };
        if self.json && self.document(&json!({ "error": error.to_json() })).is_err() {
            self.report(&error);
            return Exit::Failure;
        }
        self.report(&error);
        error.exit()
    }

    /// Prints an error to stderr. `render` has removed control characters other than colours.
    pub fn report(&self, error: &CliError) {
        write_line(&error.render(self.errors));
    }

    /// Prints a remark to stderr.
    pub fn note(&self, text: &str) {
        print_lines(self.errors, text);
    }

    /// Prints a warning to stderr.
    pub fn warn(&self, text: impl Display) {
        self.note(&format!("warning: {text}"));
    }

    /// Warns of how numbers without a unit were read; a JSON document then has it among its `warnings`, too.
    pub fn warn_of_units(&self, text: impl Into<String>) {
        let text = text.into();
        self.warn(&text);
        let mut units = self.units.lock().unwrap_or_else(PoisonError::into_inner);
        units.push(text);
    }

    /// Prints an error of usage, or the requested help, from clap.
    pub fn usage(&self, error: &clap::Error) -> Exit {
        let is_help = !error.use_stderr();
        if let Some(why) = missing_pipeline(error) {
            let help = match why.starts_with("no pipeline") {
                true => "`deaflow init FOLDER` creates a project with one",
                false => "name one of them",
            };
            return self.end(Err(CliError::bad_input(format!("no pipeline given: {why}")).help(help)));
        }
        // Without arguments, clap prints the help of the command.
        let is_usage = error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand;
        if !is_help && !is_usage {
            return self.end(Err(of_arguments(error)));
        }
        match error.print() {
            Err(e) if e.kind() != ErrorKind::BrokenPipe => Exit::Failure,
            _ if is_help => Exit::Done,
            _ => Exit::BadInput,
        }
    }
}

/// The error of arguments in the form of all errors: what is wrong, and what helps.
fn of_arguments(error: &clap::Error) -> CliError {
    let text = error.render().to_string();
    let mut paragraphs = text.trim().trim_start_matches("error: ").split("\n\n");
    let message = paragraphs.next().unwrap_or_default();
    let message: Vec<&str> = message.lines().map(str::trim).collect();
    let message = message.join(" ").replace('\'', "`");
    let found = CliError::bad_input(match error.kind() {
        clap::error::ErrorKind::MissingRequiredArgument => {
            message.replace("the following required arguments were not provided:", "missing:")
        }
        _ => message,
    });
    let suggested = [
        ContextKind::SuggestedSubcommand,
        ContextKind::SuggestedArg,
        ContextKind::SuggestedValue,
    ];
    let near = suggested.into_iter().find_map(|kind| match error.get(kind)? {
        ContextValue::String(one) => Some(one.clone()),
        // The nearest is the last.
        ContextValue::Strings(several) => several.last().cloned(),
        _ => None,
    });
    let near = near.or_else(|| near_command(error));
    let usage = paragraphs.find_map(|paragraph| paragraph.strip_prefix("Usage: "));
    match (near, usage) {
        (Some(near), _) => found.help(format!("did you mean `{near}`?")),
        (None, Some(usage)) => found.help(format!("usage: {}", usage.trim())),
        (None, None) => found,
    }
}

/// The command that is nearest to an unknown one; clap finds none for words as short as `rnu`.
fn near_command(error: &clap::Error) -> Option<String> {
    let Some(ContextValue::String(word)) = error.get(ContextKind::InvalidSubcommand) else {
        return None;
    };
    let command = command_line();
    let usage = error.get(ContextKind::Usage)?.to_string();
    // The last command that the usage names: `Usage: deaflow export <COMMAND>`.
    let parent = usage
        .split_whitespace()
        .filter_map(|word| command.find_subcommand(word))
        .next_back();
    let names = parent
        .unwrap_or(&command)
        .get_subcommands()
        .map(clap::Command::get_name);
    nearest(word, &names.collect::<Vec<_>>()).map(str::to_owned)
}

/// The reason why the current folder cannot be used as the pipeline that was not given, if that is the error.
fn missing_pipeline(error: &clap::Error) -> Option<String> {
    let is = |kind, text: &str| matches!(error.get(kind), Some(ContextValue::String(found)) if found == text);
    let is_missing = is(ContextKind::InvalidArg, "[PIPELINE]") && is(ContextKind::InvalidValue, ".");
    is_missing.then(|| error.source().map(ToString::to_string)).flatten()
}

/// Writes lines to stderr for programs.
pub fn print_plain(text: &str) {
    write_line(&printable(text));
}

/// Writes lines to stderr for people, as they fit the terminal.
pub fn print_lines(screen: Screen, text: &str) {
    write_line(&lines(printable(text).trim_end_matches('\n'), Tone::Plain, screen));
}

/// Writes the outcome of something to stderr: its name, the outcome in its colour, and details.
pub fn print_outcome(screen: Screen, name: &str, (word, tone): (&'static str, Tone), rest: &str) {
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

/// Writes to stderr; only progress bars do so too.
fn write_line(text: &str) {
    // If stderr is closed, there is nowhere to report it.
    let _ = writeln!(io::stderr().lock(), "{}", text.trim_end_matches('\n'));
}
