//! The error type of all commands: message, position in a file, help, and exit code.
//!
//! Errors of other crates are mapped to exit codes and formatted only here.

use std::io::{self, ErrorKind};

use miette::{Diagnostic, GraphicalReportHandler, GraphicalTheme, ThemeCharacters, ThemeStyles};
use serde_json::{Value, json};

use super::Exit;
use super::text::lines;
use super::tone::{Screen, Tone};
use deaflow_base::{InputError, OutputError, is_interrupted, is_unprintable, printable};
use deaflow_executor::SubmitError;
use deaflow_fem::SetupError;
use deaflow_field::PredictError;
use deaflow_orchestrator::{RunError, StageError};
use deaflow_remote::RemoteError;
use deaflow_report::figures::FigureError;
use deaflow_report::{ReportError, RowsError};
use deaflow_serve::ServeError;
use deaflow_stage::direct::DirectError;
use deaflow_store::StoreError;
use deaflow_tolerance::ToleranceError;

/// The error of a command.
#[derive(Debug)]
pub struct CliError {
    exit: Exit,
    message: String,
    help: Option<String>,
    input: Option<Box<InputError>>,
    closed_pipe: bool,
    /// Whether another machine, or a later attempt, may succeed.
    may_pass: bool,
}

/// The width of a message with a position, without a terminal.
const DEFAULT_WIDTH: usize = 120;

/// The longest line of a file that a message quotes, in bytes.
const MAX_LINE: usize = 1000;

/// The position of an error in a file.
struct SourcePosition {
    file: String,
    line: usize,
    column: usize,
    label: String,
}

impl CliError {
    fn new(exit: Exit, message: impl Into<String>) -> Self {
        Self {
            exit,
            message: message.into(),
            help: None,
            input: None,
            closed_pipe: false,
            may_pass: false,
        }
    }

    /// An error with the exit code of a failure.
    pub fn failure(message: impl Into<String>) -> Self {
        Self::new(Exit::Failure, message)
    }

    /// An error of invalid input.
    pub fn bad_input(message: impl Into<String>) -> Self {
        Self::new(Exit::BadInput, message)
    }

    /// Ends work after an interrupt.
    ///
    /// # Errors
    /// After an interrupt.
    pub fn if_interrupted() -> Result<(), Self> {
        match is_interrupted() {
            true => Err(Self::stopped("interrupted")),
            false => Ok(()),
        }
    }

    /// The error of work that was stopped.
    pub fn stopped(message: impl Into<String>) -> Self {
        Self::new(Exit::TryAgain, message)
    }

    fn locked(message: String) -> Self {
        Self::new(Exit::Locked, message).help("update the lock file with `deaflow run --lock`")
    }

    /// Adds a help text.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Adds the stage that failed, or that stops the pipeline, to the message.
    pub fn of_stage(mut self, stage: &str) -> Self {
        let what = match self.exit {
            Exit::Findings => "stops the pipeline",
            Exit::TryAgain if self.is_stop() => "did not finish",
            _ => "failed",
        };
        self.message = format!("stage `{stage}` {what}: {}", self.message);
        self
    }

    /// Sets the exit code for trying again, if that may help.
    pub fn for_worker(mut self) -> Self {
        if self.may_pass {
            self.exit = Exit::TryAgain;
        }
        self
    }

    /// Marks that another machine may succeed.
    pub fn transient(self) -> Self {
        Self {
            exit: Exit::TryAgain,
            may_pass: true,
            ..self
        }
    }

    /// Whether another machine, or a later attempt, may succeed.
    pub fn is_transient(&self) -> bool {
        self.may_pass
    }

    /// Whether the work was only asked to stop.
    pub fn is_stop(&self) -> bool {
        self.exit == Exit::TryAgain && !self.may_pass
    }

    /// Returns the message, one line.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// Returns the exit code.
    pub fn exit(&self) -> Exit {
        self.exit
    }

    /// Whether stdout was closed by its reader.
    pub fn is_closed_pipe(&self) -> bool {
        self.closed_pipe
    }

    /// Formats the error as a command prints it to a file.
    #[must_use]
    pub fn to_text(&self) -> String {
        self.render(Screen::default()).trim_end().to_owned()
    }

    /// Formats the error for a terminal; quotes the file if there is a position.
    pub fn render(&self, screen: Screen) -> String {
        let width = screen.width.unwrap_or(DEFAULT_WIDTH);
        let quoted = self.quoted(ThemeStyles::none(), width);
        if let Some(text) = quoted.filter(|text| !text.contains(is_unprintable)) {
            let colours = screen
                .is_coloured
                .then(|| self.quoted(ThemeStyles::ansi(), width))
                .flatten();
            return colours.unwrap_or(text);
        }
        let place = self.place().map_or(String::new(), |place| {
            format!("\n  at {}:{}:{}", place.file, place.line, place.column)
        });
        let help = self
            .help
            .as_ref()
            .map_or(String::new(), |help| format!("\n  help: {help}"));
        let text = format!("error: {}{place}{help}", self.message);
        lines(&printable(&text), Tone::Plain, screen)
    }

    /// Formats the error with the lines around its position; none without a position, or if they contain control
    /// characters.
    fn quoted(&self, styles: ThemeStyles, width: usize) -> Option<String> {
        let input = self.input.as_ref().filter(|_| self.can_be_quoted())?;
        let characters = ThemeCharacters {
            error: "error:".into(),
            underbar: '^',
            ..ThemeCharacters::ascii()
        };
        let theme = GraphicalTheme { characters, styles };
        let handler = GraphicalReportHandler::new_themed(theme).with_width(width);
        let mut text = String::new();
        handler.render_report(&mut text, input.as_ref()).ok()?;
        // Files may have CR LF line ends.
        Some(text.trim_start().replace('\r', ""))
    }

    /// Whether message and lines can be printed: no control characters, and no lines of megabytes (miette counts
    /// columns in 16 bits).
    fn can_be_quoted(&self) -> bool {
        let shown = self.input.as_ref().and_then(|input| {
            let label = input.labels()?.next()?;
            let contents = input.source_code()?.read_span(label.inner(), 1, 1).ok()?;
            let lines = String::from_utf8_lossy(contents.data()).into_owned();
            let words = [label.label().unwrap_or_default(), contents.name().unwrap_or_default()];
            Some((lines, words.concat()))
        });
        let (lines, words) = shown.unwrap_or_default();
        let help = self.help.as_deref().unwrap_or_default();
        // CR LF line ends are not printed.
        let shown: [&str; 4] = [&lines.replace("\r\n", "\n"), &words, help, &self.message];
        lines.lines().all(|line| line.len() <= MAX_LINE) && !shown.iter().any(|text| text.contains(is_unprintable))
    }

    /// Formats the error for programs.
    pub fn to_json(&self) -> Value {
        let place = self.place();
        json!({
            "exit_code": self.exit.code(),
            "message": self.message,
            "help": self.help,
            "file": place.as_ref().map(|p| &p.file),
            "line": place.as_ref().map(|p| p.line),
            "column": place.as_ref().map(|p| p.column),
            "label": place.as_ref().map(|p| &p.label),
        })
    }

    fn place(&self) -> Option<SourcePosition> {
        let input = self.input.as_ref()?;
        let label = input.labels()?.next()?;
        let contents = input.source_code()?.read_span(label.inner(), 0, 0).ok()?;
        Some(SourcePosition {
            file: contents.name()?.to_owned(),
            line: contents.line() + 1,
            column: contents.column() + 1,
            label: label.label().unwrap_or_default().to_owned(),
        })
    }
}

impl From<InputError> for CliError {
    fn from(error: InputError) -> Self {
        Self {
            help: Diagnostic::help(&error).map(|help| help.to_string()),
            input: Some(Box::new(error)),
            ..Self::bad_input(String::new())
        }
        .with_message_of_input()
    }
}

impl CliError {
    fn with_message_of_input(mut self) -> Self {
        self.message = self.input.as_ref().map_or(String::new(), ToString::to_string);
        self
    }
}

impl From<StoreError> for CliError {
    fn from(error: StoreError) -> Self {
        let (message, may_pass) = (error.to_string(), error.is_transient());
        let error = match error {
            StoreError::Output(error) => error.into(),
            e if e.is_damage() => Self::new(Exit::Damaged, message)
                .help("find other damage with `deaflow fsck`; build it again with `deaflow run`"),
            StoreError::Marker { .. } => Self::new(Exit::Damaged, message)
                .help("rewrite it with `deaflow fsck --repair`, which keeps everything else"),
            StoreError::Hdf(error) if error.is_of_the_file() => Self::bad_input(message),
            StoreError::Format { .. }
            | StoreError::Foreign { .. }
            | StoreError::NotAStore { .. }
            | StoreError::NoStore { .. }
            | StoreError::PathNotUtf8 { .. } => Self::bad_input(message),
            StoreError::IncompleteInputs { .. } => Self::bad_input(message)
                .help("build it again with `deaflow run`, or pin only the artifact: --result-only"),
            StoreError::Unreachable { .. } => Self::new(Exit::Damaged, message)
                .help("build it again with `deaflow run`, or remove the pin (`deaflow unpin`) or the lock file"),
            StoreError::Busy { .. } => Self::new(Exit::TryAgain, message),
            _ => Self::failure(message),
        };
        Self { may_pass, ..error }
    }
}

impl From<StageError> for CliError {
    fn from(error: StageError) -> Self {
        match error {
            StageError::Store(error) => error.into(),
            StageError::Stopped(stopped) => Self::new(Exit::TryAgain, stopped.to_string()),
            StageError::Locked(difference) => Self::locked(difference.to_string()),
            StageError::Blocked(why) => Self::new(Exit::Findings, why)
                .help("show the findings with `deaflow show STAGE`; with `fail_on: never`, the pipeline continues"),
            StageError::Advised { source, help } => Self::failure(source.to_string()).help(help),
            other => Self::failure(other.to_string()),
        }
    }
}

impl From<RunError> for CliError {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Input(error) => error.into(),
            RunError::Store(error) => error.into(),
            RunError::Locked(_) => Self::locked(error.to_string()),
        }
    }
}

impl From<RemoteError> for CliError {
    fn from(error: RemoteError) -> Self {
        let (message, help, may_pass) = (error.to_string(), error.help(), error.is_transient());
        let error = match error {
            RemoteError::Input(error) => return error.into(),
            RemoteError::Store(error) => return error.into(),
            RemoteError::Unreachable { .. } | RemoteError::Slow { .. } => Self::failure(message).transient(),
            RemoteError::Refused { .. } if may_pass => Self::failure(message).transient(),
            RemoteError::Format { .. } => Self::bad_input(message),
            _ => Self::failure(message),
        };
        match help {
            Some(help) => error.help(help),
            None => error,
        }
    }
}

impl From<SubmitError> for CliError {
    fn from(error: SubmitError) -> Self {
        match error {
            SubmitError::Run(error) => error.into(),
            SubmitError::Store(error) => error.into(),
        }
    }
}

impl From<ReportError> for CliError {
    fn from(error: ReportError) -> Self {
        match error {
            ReportError::Store(error) => error.into(),
            ReportError::Output(error) => error.into(),
            ReportError::Other { .. } => {
                Self::bad_input(error.to_string()).help("choose another folder with -o, or remove that report")
            }
            other => Self::failure(other.to_string()),
        }
    }
}

impl From<RowsError> for CliError {
    fn from(error: RowsError) -> Self {
        match error {
            RowsError::Store(error) => error.into(),
            RowsError::None { ref help, .. } => {
                let help = help.clone();
                Self::bad_input(error.to_string()).help(help)
            }
        }
    }
}

impl From<ServeError> for CliError {
    fn from(error: ServeError) -> Self {
        let message = error.to_string();
        match error {
            ServeError::Listen { .. } => Self::bad_input(message).help("choose a free port with --port 0"),
            _ => Self::failure(message),
        }
    }
}

impl From<OutputError> for CliError {
    fn from(error: OutputError) -> Self {
        match error {
            OutputError::Io { .. } => Self::failure(error.to_string()),
            OutputError::NoFolder { .. } => Self::bad_input(error.to_string()),
            OutputError::NotAFolder { .. } => Self::bad_input(error.to_string()).help("name another folder with -o"),
            _ => Self::bad_input(error.to_string()).help("name a new file, or a regular file to replace, with -o"),
        }
    }
}

impl From<FigureError> for CliError {
    fn from(error: FigureError) -> Self {
        match error {
            FigureError::Output(error) => error.into(),
            other => Self::failure(other.to_string()),
        }
    }
}

impl From<SetupError> for CliError {
    fn from(error: SetupError) -> Self {
        match error.is_of_the_scene() {
            true => Self::bad_input(error.to_string()),
            false => Self::failure(error.to_string()),
        }
    }
}

impl From<ToleranceError> for CliError {
    fn from(error: ToleranceError) -> Self {
        match error {
            ToleranceError::Setup(error) => error.into(),
            other => Self::bad_input(other.to_string()),
        }
    }
}

impl From<PredictError> for CliError {
    fn from(error: PredictError) -> Self {
        Self::failure(error.to_string())
    }
}

impl From<DirectError> for CliError {
    fn from(error: DirectError) -> Self {
        match error {
            DirectError::Input(error) => error.into(),
            DirectError::Failed(_) => Self::failure(error.to_string()),
        }
    }
}

impl From<io::Error> for CliError {
    fn from(error: io::Error) -> Self {
        Self {
            closed_pipe: error.kind() == ErrorKind::BrokenPipe,
            ..Self::failure(format!("cannot write to stdout: {error}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use deaflow_base::Document;

    #[test]
    fn bad_input_is_shown_with_a_caret_under_the_word() {
        let document = Document::from_text(Path::new("p.yaml"), "a: 1\nstages: { colour: red }\n").unwrap();
        let stages = document.root.peek("stages").unwrap();
        let error = CliError::from(stages.fields("`stages`", &["color"]).err().unwrap());
        assert_eq!(error.exit(), Exit::BadInput);
        let text = error.render(Screen::default());
        let lines: Vec<&str> = text.lines().collect();
        let at = lines.iter().position(|l| l.contains("colour: red")).unwrap();
        let column = lines[at].find("colour").unwrap();
        assert_eq!(lines[at + 1][column..column + 6].matches('^').count(), 6, "{text}");
        assert!(
            text.contains("p.yaml:2:11") && text.contains("did you mean `color`?"),
            "{text}"
        );
        let json = error.to_json();
        assert_eq!(
            (&json["file"], &json["line"], &json["column"]),
            (&json!("p.yaml"), &json!(2), &json!(11))
        );
        assert!(json["help"].as_str().unwrap().contains("color"));
    }

    #[test]
    fn damage_is_told_from_failure_and_failure_from_misuse() {
        let path = Path::new("x").to_owned();
        let damaged = StoreError::Damaged {
            path: path.clone(),
            reason: "r".into(),
        };
        assert_eq!(CliError::from(StageError::Store(damaged)).exit(), Exit::Damaged);
        let (busy, who) = (path.clone(), "process 7".to_owned());
        assert_eq!(
            CliError::from(StoreError::Busy { path: busy, who }).exit(),
            Exit::TryAgain
        );
        assert_eq!(CliError::from(StoreError::NotAStore { path }).exit(), Exit::BadInput);
        assert_eq!(CliError::from(StageError::failed("f")).exit(), Exit::Failure);
    }
}
