//! Errors of the API: a status of HTTP, a message, help, and a position in a file.

use miette::{Diagnostic, SourceCode};
use serde_json::{Value, json};

use deaflow_base::InputError;
use deaflow_design::{ConstraintError, GoalError};
use deaflow_fem::SetupError;
use deaflow_field::{FieldError, PredictError, SimulatorError};
use deaflow_orchestrator::RunError;
use deaflow_pattern::PatternError;
use deaflow_report::{ReportError, RowsError};
use deaflow_stage::direct::DirectError;
use deaflow_store::StoreError;
use deaflow_surrogate::LoadError;

/// A position in a file; lines and columns count from 1.
#[derive(Debug)]
struct SourcePosition {
    file: Option<String>,
    line: usize,
    column: usize,
}

/// An error that the server answers with.
#[derive(Debug)]
pub struct ApiError {
    /// The status of HTTP.
    pub status: u16,
    message: String,
    help: Option<String>,
    position: Option<SourcePosition>,
    /// The path of the parameter whose value is refused, if there is one.
    parameter: Option<String>,
    /// The allowed methods, if the method is not allowed.
    pub allow: Option<&'static str>,
}

impl ApiError {
    /// Creates an error with a status.
    pub fn new(status: u16, message: impl Into<String>) -> Self {
        Self {
            status,
            message: message.into(),
            help: None,
            position: None,
            parameter: None,
            allow: None,
        }
    }

    /// The request is not valid.
    pub fn bad_request(message: impl Into<String>) -> Self {
        Self::new(400, message)
    }

    /// The path does not support the method.
    pub fn method_not_allowed(allow: &'static str) -> Self {
        Self {
            allow: Some(allow),
            ..Self::new(405, format!("this path supports only {allow}"))
        }
    }

    /// Something that the request names does not exist.
    pub fn not_found(message: impl Into<String>) -> Self {
        Self::new(404, message)
    }

    /// Adds help: what to do.
    #[must_use]
    pub fn help(self, help: impl Into<String>) -> Self {
        Self {
            help: Some(help.into()),
            ..self
        }
    }

    /// Removes the position: it is one in a text that the user did not write.
    #[must_use]
    pub fn without_position(self) -> Self {
        Self { position: None, ..self }
    }

    /// Names the parameter whose value is refused.
    #[must_use]
    pub fn for_parameter(self, path: impl Into<String>) -> Self {
        Self {
            parameter: Some(path.into()),
            ..self
        }
    }

    /// Returns message and help as one text.
    #[must_use]
    pub fn message_with_help(&self) -> String {
        match &self.help {
            Some(help) => format!("{}: {help}", self.message),
            None => self.message.clone(),
        }
    }

    /// Returns the error as a document.
    #[must_use]
    pub fn document(&self) -> Value {
        let position = self.position.as_ref();
        json!({
            "error": {
                "message": self.message,
                "help": self.help,
                "file": position.and_then(|position| position.file.as_deref()),
                "line": position.map(|position| position.line),
                "column": position.map(|position| position.column),
                "value": self.parameter,
            }
        })
    }
}

impl From<InputError> for ApiError {
    fn from(error: InputError) -> Self {
        let position = || {
            let label = error.labels()?.next()?;
            let source: &dyn SourceCode = error.source_code()?;
            let read = source.read_span(label.inner(), 0, 0).ok()?;
            Some(SourcePosition {
                file: read.name().map(str::to_owned),
                line: read.line() + 1,
                column: read.column() + 1,
            })
        };
        Self {
            position: position(),
            help: Diagnostic::help(&error).map(|help| help.to_string()),
            ..Self::bad_request(error.to_string())
        }
    }
}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> Self {
        let status = match &error {
            StoreError::Missing { .. } | StoreError::NoDataset { .. } | StoreError::NoStore { .. } => 404,
            StoreError::Content { .. } => 409,
            // A damaged store prevents an answer, but the server itself works.
            error if error.is_damage() => 409,
            _ => 500,
        };
        let answer = Self::new(status, error.to_string());
        match error.is_damage() {
            true => answer.help("run `deaflow fsck` to list all damaged files, and `deaflow run` to build them again"),
            false => answer,
        }
    }
}

impl From<ReportError> for ApiError {
    fn from(error: ReportError) -> Self {
        match error {
            ReportError::Store(error) => error.into(),
            ReportError::Content { .. } => Self::new(409, error.to_string()),
            other => Self::new(500, other.to_string()),
        }
    }
}

impl From<RowsError> for ApiError {
    fn from(error: RowsError) -> Self {
        match error {
            RowsError::Store(error) => error.into(),
            RowsError::None { message, help } => Self::not_found(message).help(help),
        }
    }
}

impl From<RunError> for ApiError {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Input(error) => error.into(),
            RunError::Store(error) => error.into(),
            other => Self::new(409, other.to_string()),
        }
    }
}

/// Errors that are answered with one status and their own message.
macro_rules! from_errors {
    ($($status:literal: $($error:ty),+;)+) => {
        $($(impl From<$error> for ApiError {
            fn from(error: $error) -> Self {
                Self::new($status, error.to_string())
            }
        })+)+
    };
}

from_errors! {
    400: SetupError, GoalError, ConstraintError;
    409: PredictError, SimulatorError, LoadError, PatternError, FieldError;
}

impl From<DirectError> for ApiError {
    fn from(error: DirectError) -> Self {
        match error {
            DirectError::Input(error) => error.into(),
            DirectError::Failed(message) => Self::bad_request(message),
        }
    }
}

impl From<serde_json::Error> for ApiError {
    fn from(error: serde_json::Error) -> Self {
        Self {
            position: (error.line() > 0).then(|| SourcePosition {
                file: None,
                line: error.line(),
                column: error.column(),
            }),
            ..Self::bad_request(format!("invalid body of the request: {error}"))
        }
    }
}
