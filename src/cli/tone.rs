//! Colours of words by their meaning. A colour is never the only carrier of a meaning.

use std::io::{self, IsTerminal};
use std::os::fd::AsFd;

use anstream::AutoStream;
use clap::ColorChoice;
use clap::builder::styling::{AnsiColor, Style};

use deaflow_field::OutcomeKind;
use deaflow_orchestrator::Outcome;

/// The width of a terminal that does not report it.
const DEFAULT_WIDTH: usize = 80;

/// The meaning of a word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    /// Neutral.
    #[default]
    Plain,
    /// Converged, or built.
    Good,
    /// Unchanged.
    Dim,
    /// Attention: stale, stopped, a warning.
    Caution,
    /// Failed: no stable solution, an error.
    Bad,
}

impl Tone {
    /// Returns the tone of the outcome of a stage.
    pub fn of(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Built => Self::Good,
            Outcome::Reused => Self::Dim,
            Outcome::Failed => Self::Bad,
            Outcome::Stale | Outcome::Stopped | Outcome::Left | Outcome::Skipped => Self::Caution,
        }
    }

    /// Returns the tone of the outcome of a solution.
    pub fn of_solve(outcome: OutcomeKind) -> Self {
        match outcome {
            OutcomeKind::Converged => Self::Good,
            OutcomeKind::Estimated | OutcomeKind::Predicted => Self::Plain,
            _ => Self::Bad,
        }
    }

    /// Colours a text, if colours are shown.
    pub fn paint(self, text: &str, is_coloured: bool) -> String {
        let style = match self {
            Self::Good => AnsiColor::Green.on_default(),
            Self::Dim => Style::new().dimmed(),
            Self::Caution => AnsiColor::Yellow.on_default(),
            Self::Bad => AnsiColor::Red.on_default(),
            Self::Plain => return text.to_owned(),
        };
        match is_coloured && !text.is_empty() {
            true => format!("{style}{text}{style:#}"),
            false => text.to_owned(),
        }
    }
}

/// A terminal or another output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Screen {
    /// The width of the terminal; none for another output, where lines are not wrapped.
    pub width: Option<usize>,
    /// Whether colours are shown.
    pub is_coloured: bool,
}

impl Screen {
    /// Describes a stream, with the requested colours.
    pub fn of(stream: &(impl AsFd + IsTerminal + anstream::stream::RawStream), colour: ColorChoice) -> Self {
        Self {
            width: width(stream),
            is_coloured: match colour {
                ColorChoice::Always => true,
                ColorChoice::Never => false,
                ColorChoice::Auto => AutoStream::choice(stream) != anstream::ColorChoice::Never,
            },
        }
    }
}

/// Returns the width of the terminal of a stream; none for another output.
fn width(stream: &(impl AsFd + IsTerminal)) -> Option<usize> {
    stream
        .is_terminal()
        .then(|| match rustix::termios::tcgetwinsize(stream) {
            Ok(size) if size.ws_col > 0 => usize::from(size.ws_col),
            _ => DEFAULT_WIDTH,
        })
}

/// Returns the width of the terminal of stdout, if it is one.
pub fn width_of_stdout() -> Option<usize> {
    width(&io::stdout())
}

/// Returns the width of the terminal of stderr, if it is one.
pub fn width_of_stderr() -> Option<usize> {
    width(&io::stderr())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_only_where_they_are_shown_and_say_what_the_word_says() {
        assert_eq!(Tone::Good.paint("built", true), "\u{1b}[32mbuilt\u{1b}[0m");
        assert_eq!(Tone::Bad.paint("failed", false), "failed");
        assert_eq!(Tone::Plain.paint("x", true), "x");
        assert_eq!(Tone::Caution.paint("", true), "");
        assert_eq!(Tone::of(Outcome::Reused), Tone::Dim);
        assert_eq!(Tone::of_solve(OutcomeKind::PullIn), Tone::Bad);
    }
}
