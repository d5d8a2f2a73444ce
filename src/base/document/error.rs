//! Errors in input: position, what was found, what is allowed.

use miette::{Diagnostic, NamedSource, SourceSpan};

use super::source::Source;

/// The largest number of characters of a message, label or help text.
const LONGEST: usize = 2000;

/// An error in input: position, what was found, what is allowed.
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
    /// Creates an error without a position, such as a missing file.
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

    /// Adds a help text, such as what is allowed.
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

/// Removes the middle of a long text, since a message may quote values of any length.
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

/// Returns the most similar of some allowed words, if any is similar enough.
#[must_use]
pub fn nearest<'w>(word: &str, allowed: &[&'w str]) -> Option<&'w str> {
    // The memory for the distance is proportional to the product of the lengths.
    let short = |word: &str| word.len() <= 200;
    let candidates = allowed.iter().filter(|candidate| short(word) && short(candidate));
    candidates
        .map(|candidate| (strsim::damerau_levenshtein(word, candidate), *candidate))
        // The allowed distance grows with the length of the words; they have a letter in common.
        .filter(|(distance, candidate)| {
            let longest = candidate.chars().count().max(word.chars().count());
            let is_similar = *distance < longest && *distance <= 1 + longest / 3;
            is_similar || word.eq_ignore_ascii_case(candidate)
        })
        // Of equally similar words a forgotten letter is likelier than a wrong one: `sids` is `sides`, not `side`.
        .min_by_key(|(distance, candidate)| (*distance, !has_letters(candidate, word)))
        .map(|(_, candidate)| candidate)
}

/// Whether a word has the letters of another one in their order.
fn has_letters(word: &str, of: &str) -> bool {
    let mut letters = word.chars();
    of.chars().all(|letter| letters.any(|own| own == letter))
}

/// Returns the help text for a word that is not allowed.
pub(super) fn suggestion(word: &str, allowed: &[&str]) -> String {
    suggested(word, ("allowed", allowed))
}

/// Returns the help text for a word that is none of some words, with a name for these.
pub(super) fn suggested(word: &str, (name, words): (&str, &[&str])) -> String {
    if words.is_empty() {
        return "this value has no parts".to_owned();
    }
    // Variants of a mapping share keys; each is listed once.
    let mut listed: Vec<&str> = Vec::with_capacity(words.len());
    for word in words {
        if !listed.contains(word) {
            listed.push(word);
        }
    }
    let list = listed.join(", ");
    match nearest(word, words) {
        Some(near) => format!("did you mean `{near}`? {name}: {list}"),
        None => format!("{name}: {list}"),
    }
}
