//! The refusal of bad input: where it stands, what was found, what is allowed.

use miette::{Diagnostic, NamedSource, SourceSpan};

use super::node::Source;

/// The most characters that a message, a label or an advice has.
const LONGEST: usize = 2000;

/// Bad input: where it stands, what was found, what is allowed.
#[derive(Debug, Diagnostic, thiserror::Error)]
#[error("{message}")]
pub struct InputError {
    pub(super) message: String,
    #[source_code]
    pub(super) source_code: Option<NamedSource<String>>,
    #[label("{label}")]
    pub(super) span: Option<SourceSpan>,
    label: String,
    #[help]
    pub(super) help: Option<String>,
}

impl InputError {
    /// A refusal that has no place in a document (a missing file, an empty argument).
    #[must_use]
    pub fn new(message: impl Into<String>) -> Self {
        Self {
            message: clipped(message.into()),
            source_code: None,
            span: None,
            label: String::new(),
            help: None,
        }
    }

    /// Adds advice: what is allowed.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(clipped(help.into()));
        self
    }

    pub(super) fn at(source: &Source, span: (usize, usize), message: String, label: String) -> Self {
        Self {
            message: clipped(message),
            source_code: Some(NamedSource::new(&source.name, source.text.clone())),
            span: Some(SourceSpan::new(span.0.into(), span.1)),
            label: clipped(label),
            help: None,
        }
    }
}

/// What is longer than a person reads loses its middle: a message may quote what was found, whatever its length.
pub(super) fn clipped(text: String) -> String {
    let length = text.chars().count();
    if length <= LONGEST {
        return text;
    }
    let half = LONGEST / 2;
    let end: String = text.chars().skip(length - half).collect();
    let start: String = text.chars().take(half).collect();
    format!("{start} … {end}")
}

/// The nearest of some allowed words, if any is near.
#[must_use]
pub fn nearest<'w>(word: &str, allowed: &[&'w str]) -> Option<&'w str> {
    // The distance takes memory in proportion to the product of the lengths, and nobody misspells a novel.
    let short = |word: &str| word.len() <= 200;
    let candidates = allowed.iter().filter(|candidate| short(word) && short(candidate));
    candidates
        .map(|candidate| (strsim::damerau_levenshtein(word, candidate), *candidate))
        // How near a word is depends on its length: a short one may be as far as a long one, and not be meant.
        .filter(|(distance, candidate)| *distance <= 1 + candidate.chars().count().max(word.chars().count()) / 3)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// Advice on a word that is not allowed.
pub(super) fn suggestion(word: &str, allowed: &[&str]) -> String {
    let list = if allowed.is_empty() {
        "nothing".to_owned()
    } else {
        // Variants of a mapping share keys; each is told once.
        let mut told: Vec<&str> = Vec::with_capacity(allowed.len());
        for word in allowed {
            if !told.contains(word) {
                told.push(word);
            }
        }
        told.join(", ")
    };
    match nearest(word, allowed) {
        Some(near) => format!("did you mean `{near}`? allowed: {list}"),
        None => format!("allowed: {list}"),
    }
}
