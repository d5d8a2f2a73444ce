//! Why a request gets no answer, for people and for scripts.

use miette::{Diagnostic, SourceCode};
use serde_json::{Value, json};

use deaflow_base::InputError;
use deaflow_content::ContentError;
use deaflow_design::{ConstraintError, GoalError};
use deaflow_fem::SetupError;
use deaflow_field::PredictError;
use deaflow_orchestrator::RunError;
use deaflow_report::{ReportError, RowsError};
use deaflow_stage::direct::DirectError;
use deaflow_store::StoreError;

/// Where in a file something is wrong; lines and columns count from 1.
#[derive(Debug)]
struct Place {
    file: Option<String>,
    line: usize,
    column: usize,
}

/// A refusal: a status of HTTP, what is wrong, and what helps.
#[derive(Debug)]
pub struct Refusal {
    /// The status.
    pub status: u16,
    message: String,
    help: Option<String>,
    place: Option<Place>,
    /// The path of the value that is refused, where one is.
    value: Option<String>,
    /// What the path allows, where the method is not allowed.
    pub allow: Option<&'static str>,
}

impl Refusal {
    /// With a status.
    pub fn new(status: u16, message: impl Into<String>) -> Self {
        Self {
            status,
            message: message.into(),
            help: None,
            place: None,
            value: None,
            allow: None,
        }
    }

    /// What was asked cannot be done as it was asked.
    pub fn bad(message: impl Into<String>) -> Self {
        Self::new(400, message)
    }

    /// A method that the path does not take.
    pub fn not_allowed(allow: &'static str) -> Self {
        Self {
            allow: Some(allow),
            ..Self::new(405, format!("this path takes {allow} alone"))
        }
    }

    /// There is no such thing.
    pub fn absent(message: impl Into<String>) -> Self {
        Self::new(404, message)
    }

    /// Adds advice.
    #[must_use]
    pub fn help(self, help: impl Into<String>) -> Self {
        Self {
            help: Some(help.into()),
            ..self
        }
    }

    /// Takes its place away: it is one in a text that nobody has written.
    #[must_use]
    pub fn without_place(self) -> Self {
        Self { place: None, ..self }
    }

    /// Names the value that is refused, by its path.
    #[must_use]
    pub fn of_value(self, path: impl Into<String>) -> Self {
        Self {
            value: Some(path.into()),
            ..self
        }
    }

    /// What is wrong and what helps, as one text.
    #[must_use]
    pub fn words(&self) -> String {
        match &self.help {
            Some(help) => format!("{}: {help}", self.message),
            None => self.message.clone(),
        }
    }

    /// As a document. Lines and columns count from 1.
    #[must_use]
    pub fn document(&self) -> Value {
        json!({
            "error": {
                "message": self.message,
                "help": self.help,
                "file": self.place.as_ref().and_then(|place| place.file.as_deref()),
                "line": self.place.as_ref().map(|place| place.line),
                "column": self.place.as_ref().map(|place| place.column),
                "value": self.value,
            }
        })
    }
}

impl From<InputError> for Refusal {
    fn from(error: InputError) -> Self {
        let place = || {
            let label = error.labels()?.next()?;
            let source: &dyn SourceCode = error.source_code()?;
            let read = source.read_span(label.inner(), 0, 0).ok()?;
            Some(Place {
                file: read.name().map(str::to_owned),
                line: read.line() + 1,
                column: read.column() + 1,
            })
        };
        Self {
            place: place(),
            help: Diagnostic::help(&error).map(|help| help.to_string()),
            ..Self::bad(error.to_string())
        }
    }
}

impl From<StoreError> for Refusal {
    fn from(error: StoreError) -> Self {
        let status = match &error {
            StoreError::Missing { .. } | StoreError::NoDataset { .. } | StoreError::NoStore { .. } => 404,
            // What is damaged stands in the way of an answer; nothing is wrong with the server.
            error if error.is_damage() => 409,
            _ => 500,
        };
        let refusal = Self::new(status, error.to_string());
        match status {
            409 => refusal.help("`deaflow fsck` tells what else is damaged; `deaflow run` builds it again"),
            _ => refusal,
        }
    }
}

impl From<ContentError> for Refusal {
    fn from(error: ContentError) -> Self {
        match error {
            ContentError::Store(error) => error.into(),
            fault => Self::new(409, fault.to_string()),
        }
    }
}

impl From<ReportError> for Refusal {
    fn from(error: ReportError) -> Self {
        match error {
            ReportError::Store(error) => error.into(),
            ReportError::Content { .. } => Self::new(409, error.to_string()),
            other => Self::new(500, other.to_string()),
        }
    }
}

impl From<RowsError> for Refusal {
    fn from(error: RowsError) -> Self {
        match error {
            RowsError::Store(error) => error.into(),
            RowsError::None { message, help } => Self::absent(message).help(help),
        }
    }
}

impl From<RunError> for Refusal {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Input(error) => error.into(),
            RunError::Store(error) => error.into(),
            other => Self::new(409, other.to_string()),
        }
    }
}

impl From<SetupError> for Refusal {
    fn from(error: SetupError) -> Self {
        Self::bad(error.to_string())
    }
}

impl From<GoalError> for Refusal {
    fn from(error: GoalError) -> Self {
        Self::bad(error.to_string())
    }
}

impl From<ConstraintError> for Refusal {
    fn from(error: ConstraintError) -> Self {
        Self::bad(error.to_string())
    }
}

impl From<PredictError> for Refusal {
    fn from(error: PredictError) -> Self {
        Self::new(409, error.to_string())
    }
}

impl From<DirectError> for Refusal {
    fn from(error: DirectError) -> Self {
        match error {
            DirectError::Input(error) => error.into(),
            DirectError::Failed(message) => Self::bad(message),
        }
    }
}

impl From<serde_json::Error> for Refusal {
    fn from(error: serde_json::Error) -> Self {
        Self {
            place: (error.line() > 0).then(|| Place {
                file: None,
                line: error.line(),
                column: error.column(),
            }),
            ..Self::bad(format!("the body of the request: {error}"))
        }
    }
}
