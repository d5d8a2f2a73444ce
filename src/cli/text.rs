//! Text for people: lines and tables, which are laid out for a terminal when they are printed.

use textwrap::core::display_width;

use super::columns::{Table, broken, cut, words as words_of};
use super::tone::{Screen, Tone};
use deaflow_base::printable;

/// Lines and tables.
#[derive(Debug, Default)]
pub struct Text {
    blocks: Vec<Block>,
}

#[derive(Debug)]
enum Block {
    Lines(Tone, String),
    /// A line that is not wrapped.
    Whole(String),
    /// A command to copy.
    Command(String),
    Table(Table),
}

impl Text {
    /// Makes an empty text.
    pub fn new() -> Self {
        Self::default()
    }

    /// Makes a text of a table.
    pub fn of(table: Table) -> Self {
        Self {
            blocks: vec![Block::Table(table)],
        }
    }

    /// Adds a line, or several.
    pub fn line(&mut self, text: impl Into<String>) -> &mut Self {
        self.toned(Tone::Plain, text)
    }

    /// Adds lines of a tone.
    pub fn toned(&mut self, tone: Tone, text: impl Into<String>) -> &mut Self {
        self.blocks.push(Block::Lines(tone, text.into()));
        self
    }

    /// Adds a command, which is wrapped with `\\` so that it can be copied.
    pub fn command(&mut self, text: impl Into<String>) -> &mut Self {
        self.blocks.push(Block::Command(text.into()));
        self
    }

    /// Adds a line that is never wrapped.
    pub fn whole(&mut self, text: impl Into<String>) -> &mut Self {
        self.blocks.push(Block::Whole(text.into()));
        self
    }

    /// Adds a table.
    pub fn table(&mut self, table: Table) -> &mut Self {
        self.blocks.push(Block::Table(table));
        self
    }

    /// Adds another text.
    pub fn append(&mut self, other: Self) -> &mut Self {
        self.blocks.extend(other.blocks);
        self
    }

    /// Whether the text is empty.
    pub fn is_empty(&self) -> bool {
        let is_empty = |block: &Block| matches!(block, Block::Lines(_, text) if text.is_empty());
        self.blocks.iter().all(is_empty)
    }

    /// Formats the text for a terminal. Control characters are removed; long lines are wrapped between words, with an
    /// indent. A single long word, such as a path, stays whole, so that it can be copied.
    pub fn show(&self, screen: Screen) -> String {
        let block = |block: &Block| match block {
            Block::Lines(tone, text) => lines(&printable(text), *tone, screen),
            Block::Whole(text) => printable(text).into_owned(),
            Block::Command(text) => command(&printable(text), screen),
            Block::Table(table) => table.show(screen),
        };
        self.blocks.iter().map(block).collect::<Vec<_>>().join("\n")
    }
}

impl<T: AsRef<str>> From<T> for Text {
    fn from(text: T) -> Self {
        let mut lines = Self::new();
        lines.line(text.as_ref());
        lines
    }
}

/// Coloured words at the beginning of a line.
const FIRST_WORDS: [(&str, Tone); 4] = [
    ("warning:", Tone::Caution),
    ("model warning:", Tone::Caution),
    ("model warnings:", Tone::Caution),
    ("error:", Tone::Bad),
];

/// Formats lines without control characters for a terminal. In lines without a tone, "warning" and "error" are
/// coloured.
pub fn lines(text: &str, tone: Tone, screen: Screen) -> String {
    let mut in_table = false;
    let mut shown: Vec<String> = Vec::new();
    for line in text.split('\n') {
        let is_rule = !line.is_empty() && line.chars().all(|c| matches!(c, '─' | '═'));
        // Lines of a table are indented; text after its last rule is not.
        in_table = is_rule || (in_table && line.starts_with(' '));
        match screen.width {
            Some(width) if in_table => shown.push(painted(&cut(line, width), tone, screen)),
            Some(width) => shown.extend(wrapped(line, width).iter().map(|line| painted(line, tone, screen))),
            None => shown.push(painted(line, tone, screen)),
        }
    }
    shown.join("\n")
}

fn painted(line: &str, tone: Tone, screen: Screen) -> String {
    let first = FIRST_WORDS.iter().find(|(word, _)| line.starts_with(word));
    match first.filter(|_| tone == Tone::Plain) {
        Some((word, tone)) => tone.paint(word, screen.is_coloured) + &line[word.len()..],
        None => tone.paint(line, screen.is_coloured),
    }
}

/// Wraps a line.
fn wrapped(line: &str, width: usize) -> Vec<String> {
    if display_width(line) <= width {
        return vec![line.to_owned()];
    }
    let words = line.trim_start();
    // A large indent would leave too little space.
    let indent = (line.len() - words.len()).min(width / 2);
    let indents = [indent, indent + 2].map(|indent| " ".repeat(indent));
    let options = words_of(width)
        .initial_indent(&indents[0])
        .subsequent_indent(&indents[1])
        .break_words(false);
    broken(words, &options)
}

/// Wraps a command with `\\` at the end of lines. Quoted text stays together.
fn command(line: &str, screen: Screen) -> String {
    let width = screen.width.unwrap_or(usize::MAX).saturating_sub(2);
    if display_width(line) <= width.saturating_add(2) {
        return line.to_owned();
    }
    let whole = line.trim_start();
    let mut words: Vec<String> = Vec::new();
    let mut is_quoted = false;
    for part in whole.split(' ') {
        match words.last_mut().filter(|_| is_quoted) {
            Some(word) => *word = format!("{word} {part}"),
            None => words.push(part.to_owned()),
        }
        is_quoted ^= part.matches('\'').count() % 2 == 1;
    }
    let mut lines = vec![line[..line.len() - whole.len()].to_owned()];
    for word in words {
        let at = lines.last_mut().expect("there is a line");
        if at.trim_start().is_empty() {
            at.push_str(&word);
        } else if display_width(at) + 1 + display_width(&word) <= width {
            *at = format!("{at} {word}");
        } else {
            *at += " \\";
            lines.push(format!("  {word}"));
        }
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    const NARROW: Screen = Screen {
        width: Some(20),
        is_coloured: false,
    };

    #[test]
    fn long_lines_are_broken_between_words_on_a_terminal_and_nowhere_else() {
        let text = Text::from("  solved: a line of many words\nshort");
        assert_eq!(text.show(NARROW), "  solved: a line of\n    many words\nshort");
        assert_eq!(text.show(Screen::default()), "  solved: a line of many words\nshort");
        let path = Text::from("figures: /a/path/that/is/longer/than/the/terminal");
        assert_eq!(
            path.show(NARROW),
            "figures:\n  /a/path/that/is/longer/than/the/terminal"
        );
    }

    #[test]
    fn a_command_is_broken_where_a_shell_goes_on() {
        let narrow = Screen {
            width: Some(30),
            is_coloured: false,
        };
        let shown = Text::from("")
            .command("next: deaflow report pipeline.yaml --set 'a=one two' -o report")
            .show(narrow);
        let lines: Vec<&str> = shown.lines().skip(1).collect();
        assert_eq!(
            lines,
            [
                r"next: deaflow report \",
                r"  pipeline.yaml --set \",
                r"  'a=one two' -o report"
            ]
        );
        let joined = lines.join("\n").replace("\\\n", "");
        let words = shlex::split(joined.trim_start_matches("next: ")).unwrap();
        assert_eq!(
            words,
            [
                "deaflow",
                "report",
                "pipeline.yaml",
                "--set",
                "a=one two",
                "-o",
                "report"
            ]
        );
        let piped = Text::from("")
            .command("next: deaflow report pipeline.yaml -o report")
            .show(Screen::default());
        assert_eq!(
            piped.lines().last(),
            Some("next: deaflow report pipeline.yaml -o report")
        );
    }

    #[test]
    fn what_would_change_a_terminal_is_taken_out_and_our_colours_are_not() {
        let mut text = Text::new();
        text.toned(Tone::Caution, "warning: \u{1b}[2J");
        let screen = Screen {
            width: None,
            is_coloured: true,
        };
        assert_eq!(text.show(screen), "\u{1b}[33mwarning: \u{fffd}[2J\u{1b}[0m");
    }

    #[test]
    fn tables_that_were_laid_out_elsewhere_are_cut() {
        let text = Text::from(format!("{}\n a wide header of a table\n{0}", "─".repeat(30)));
        let shown = text.show(NARROW);
        assert_eq!(shown.lines().nth(1), Some(" a wide header of a…"));
        assert!(shown.lines().all(|line| display_width(line) <= 20), "{shown}");
    }
}
