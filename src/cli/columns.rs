//! Layout of tables. Without a terminal every column has its natural width. On a narrow terminal texts wrap within
//! their columns or below their row, dispensable columns are dropped, and what is still too wide is truncated.

use textwrap::core::{Word, display_width};
use textwrap::{WordSeparator, WordSplitter};

use super::tone::{Screen, Tone};
use deaflow_base::{NO_BREAK, no_break_units, printable};

/// The smallest width of a column with wrapped text; narrower text is placed below its row.
const MIN_WRAPPED: usize = 24;

/// The smallest width to which a column is truncated.
const MIN_TRUNCATED: usize = 6;

/// The indentation of text below a row.
const INDENT: usize = 4;

/// The gaps between columns: default, and in narrow tables.
const GAPS: [usize; 2] = [3, 2];

/// A table.
#[derive(Debug)]
pub struct Table {
    columns: Vec<Column>,
    rows: Vec<Vec<Cell>>,
    /// The width without a terminal, if rows may have several lines there.
    piped_width: Option<usize>,
}

#[derive(Clone, Debug)]
struct Column {
    title: String,
    is_number: bool,
    is_wrapped: bool,
    /// Its position among the columns that may be dropped, if it may.
    drop_order: Option<usize>,
}

/// A cell: lines of text.
#[derive(Debug)]
pub struct Cell {
    text: String,
    tone: Tone,
}

impl<T: ToString> From<T> for Cell {
    fn from(text: T) -> Self {
        Self::toned(&text.to_string(), Tone::Plain)
    }
}

impl Cell {
    /// Makes a cell with a tone; control characters are removed from the text.
    pub fn toned(text: &str, tone: Tone) -> Self {
        Self {
            text: printable(text).replace('\t', " "),
            tone,
        }
    }
}

/// Makes an empty table with a header; the columns in `numbers` are aligned to the right.
pub fn table(header: &[&str], numbers: &[&str]) -> Table {
    let column = |title: &&str| Column {
        title: printable(title).into_owned(),
        is_number: numbers.contains(title),
        is_wrapped: false,
        drop_order: None,
    };
    Table {
        columns: header.iter().map(column).collect(),
        rows: Vec::new(),
        piped_width: None,
    }
}

/// The columns within a row with their widths, and those below it.
struct Layout {
    inline: Vec<(usize, usize)>,
    below: Vec<usize>,
    gap: usize,
}

impl Table {
    /// Marks columns whose text may wrap.
    pub fn flowing(mut self, titles: &[&str]) -> Self {
        for column in &mut self.columns {
            column.is_wrapped |= titles.contains(&column.title.as_str());
        }
        self
    }

    /// Marks columns that may be dropped, in this order.
    pub fn dispensable(mut self, titles: &[&str]) -> Self {
        for column in &mut self.columns {
            column.drop_order = titles.iter().position(|title| *title == column.title);
        }
        self
    }

    /// Limits the width without a terminal, for tables whose values are too long for a line: texts that may wrap are
    /// below their row. Such tables have another form for scripts.
    pub fn at_most(self, width: usize) -> Self {
        Self {
            piped_width: Some(width),
            ..self
        }
    }

    /// Adds a row.
    pub fn add_row<C: Into<Cell>>(&mut self, cells: impl IntoIterator<Item = C>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// Formats the table, without a final line break. Without a terminal each row is one line, for scripts.
    pub fn show(&self, screen: Screen) -> String {
        match (screen.width, self.piped_width) {
            (None, None) => self.unbroken().shown(screen),
            (None, Some(most)) => {
                let width = Some(most);
                self.shown_as(&self.piped_layout(most), Screen { width, ..screen })
            }
            (Some(_), _) => self.shown(screen),
        }
    }

    /// Joins the lines of each cell.
    fn unbroken(&self) -> Self {
        let cell = |cell: &Cell| Cell {
            text: cell.text.lines().collect::<Vec<_>>().join("; "),
            tone: cell.tone,
        };
        Self {
            columns: self.columns.clone(),
            rows: self.rows.iter().map(|row| row.iter().map(cell).collect()).collect(),
            piped_width: self.piped_width,
        }
    }

    fn shown(&self, screen: Screen) -> String {
        self.shown_as(&self.layout(screen.width), screen)
    }

    fn shown_as(&self, layout: &Layout, screen: Screen) -> String {
        let most = screen.width.unwrap_or(usize::MAX);
        let long: usize = layout.inline.iter().map(|(_, width)| width).sum();
        let long = long + layout.gap * layout.inline.len().saturating_sub(1) + layout.gap - 1;
        let rule = |line: char| line.to_string().repeat(long.min(most));
        let titles: Vec<Cell> = self.columns.iter().map(|column| Cell::from(&column.title)).collect();
        let mut lines = vec![rule('─')];
        lines.extend(above(&titles, layout, most, screen));
        lines.extend(self.lines(&titles, layout, screen));
        lines.push(rule('═'));
        for row in &self.rows {
            lines.extend(above(row, layout, most, screen));
            lines.extend(self.lines(row, layout, screen));
            lines.extend(self.below(row, layout, most, screen));
        }
        lines.push(rule('─'));
        lines.join("\n")
    }

    /// Returns the layout without a terminal. The widths of columns do not depend on wrapped texts, nor these on them.
    fn piped_layout(&self, most: usize) -> Layout {
        let (below, inline): (Vec<usize>, Vec<usize>) =
            (0..self.columns.len()).partition(|at| self.columns[*at].is_wrapped);
        match below.first() {
            Some(0) | None => self.layout(Some(most)),
            Some(_) => Layout {
                inline: inline.into_iter().map(|at| (at, self.natural(at))).collect(),
                below,
                gap: GAPS[0],
            },
        }
    }

    fn natural(&self, column: usize) -> usize {
        let cells = self.rows.iter().filter_map(|row| row.get(column));
        let lines = cells.flat_map(|cell| cell.text.lines());
        let widths = lines.map(display_width);
        widths
            .chain([display_width(&self.columns[column].title)])
            .max()
            .unwrap_or(0)
    }

    fn layout(&self, width: Option<usize>) -> Layout {
        let natural: Vec<(usize, usize)> = (0..self.columns.len()).map(|at| (at, self.natural(at))).collect();
        let all = |gap| Layout {
            inline: natural.clone(),
            below: Vec::new(),
            gap,
        };
        let Some(most) = width else { return all(GAPS[0]) };
        let is_wrapped = |at: usize| self.columns[at].is_wrapped;
        let droppable = self.columns.iter().filter(|column| column.drop_order.is_some()).count();
        let without = |dropped: usize, with_wrapped: bool| -> Vec<(usize, usize)> {
            let stays = |at: usize| self.columns[at].drop_order.is_none_or(|order| order >= dropped);
            let columns = natural
                .iter()
                .filter(|(at, _)| stays(*at) && (with_wrapped || !is_wrapped(*at)));
            columns.copied().collect()
        };
        let below = || (0..self.columns.len()).filter(|at| is_wrapped(*at)).collect::<Vec<_>>();
        let gap = GAPS[1];
        for dropped in 0..=droppable {
            let inline = without(dropped, true);
            for gap in GAPS {
                if length(&inline, gap) <= most {
                    let (inline, below) = (inline, Vec::new());
                    return Layout { inline, below, gap };
                }
            }
            if let Some(inline) = self.wrapped_widths(&inline, most) {
                let (below, gap) = (Vec::new(), GAPS[1]);
                return Layout { inline, below, gap };
            }
            // Text below its row is better than a dropped column.
            let inline = without(dropped, false);
            if length(&inline, gap) <= most {
                let below = below();
                return Layout { inline, below, gap };
            }
        }
        let below = below();
        let mut inline = without(droppable, false);
        while length(&inline, gap) > most {
            let widest = inline.iter_mut().filter(|(at, _)| !self.columns[*at].is_number);
            match widest.max_by_key(|(_, width)| *width) {
                Some((_, width)) if *width > MIN_TRUNCATED => *width -= 1,
                _ => break,
            }
        }
        Layout { inline, below, gap }
    }

    /// Returns the widths with which columns fit when their text wraps; none if they would be too narrow.
    fn wrapped_widths(&self, columns: &[(usize, usize)], most: usize) -> Option<Vec<(usize, usize)>> {
        let mut columns = columns.to_vec();
        loop {
            if length(&columns, GAPS[1]) <= most {
                return Some(columns);
            }
            let wrapped = columns.iter_mut().filter(|(at, _)| self.columns[*at].is_wrapped);
            let (_, width) = wrapped.max_by_key(|(_, width)| *width)?;
            if *width <= MIN_WRAPPED {
                return None;
            }
            *width -= 1;
        }
    }

    /// Formats the lines of a row.
    fn lines(&self, row: &[Cell], layout: &Layout, screen: Screen) -> Vec<String> {
        let cells: Vec<(usize, Vec<String>)> = layout
            .inline
            .iter()
            .map(|&(at, width)| (width, self.cell(row, at, width)))
            .collect();
        let height = cells.iter().map(|(_, lines)| lines.len()).max().unwrap_or(0).max(1);
        let line = |of_row: usize| {
            let mut text = String::from(" ");
            let mut used = 1;
            for (place, (&(at, _), (width, lines))) in layout.inline.iter().zip(&cells).enumerate() {
                let words = lines.get(of_row).map_or("", String::as_str);
                let space = width.saturating_sub(display_width(words));
                let gap = if place == 0 { 0 } else { layout.gap };
                let before = gap + if self.columns[at].is_number { space } else { 0 };
                let tone = row.get(at).map_or(Tone::Plain, |cell| cell.tone);
                // Numbers that are still too wide end at the edge of the terminal.
                let left = screen
                    .width
                    .map_or(usize::MAX, |most| most.saturating_sub(used + before));
                let words = cut(words, left);
                text += &" ".repeat(before);
                text += &tone.paint(&words, screen.is_coloured);
                text += &" ".repeat(if self.columns[at].is_number { 0 } else { space });
                used += gap + width;
            }
            text.trim_end().to_owned()
        };
        (0..height).map(line).collect()
    }

    /// Formats the lines of a cell in a column of this width.
    fn cell(&self, row: &[Cell], at: usize, width: usize) -> Vec<String> {
        let text = row.get(at).map_or("", |cell| cell.text.as_str());
        if !self.columns[at].is_wrapped {
            return text.lines().map(|line| cut(line, width)).collect();
        }
        let options = words(width).subsequent_indent("  ");
        let in_parts = options.clone().word_separator(WordSeparator::Custom(parts));
        let is_too_long = |word: &str| display_width(word) + 2 > width;
        let lines = text.lines().flat_map(|line| match display_width(line) <= width {
            true => vec![line.to_owned()],
            false if line.split(' ').any(is_too_long) => broken(line, &in_parts),
            false => broken(line, &options),
        });
        lines.collect()
    }

    /// Formats the text below a row.
    fn below(&self, row: &[Cell], layout: &Layout, most: usize, screen: Screen) -> Vec<String> {
        let indents = [INDENT, INDENT + 2].map(|indent| " ".repeat(indent));
        let options = words(most).initial_indent(&indents[0]).subsequent_indent(&indents[1]);
        // The first line has the title; the others are indented further.
        let others = options.clone().initial_indent(&indents[1]);
        let mut lines = Vec::new();
        for &at in layout.below.iter().filter(|at| **at > 0) {
            let Some(cell) = row.get(at).filter(|cell| !cell.text.is_empty()) else {
                continue;
            };
            let text = format!("{}: {}", self.columns[at].title, cell.text);
            for (at, line) in text.lines().enumerate() {
                let options = if at == 0 { &options } else { &others };
                let wrapped = broken(line, options);
                lines.extend(wrapped.iter().map(|line| cell.tone.paint(line, screen.is_coloured)));
            }
        }
        lines
    }
}

/// Formats the first column above its row, if it does not fit within.
fn above(row: &[Cell], layout: &Layout, most: usize, screen: Screen) -> Vec<String> {
    let Some(cell) = row.first().filter(|_| layout.below.first() == Some(&0)) else {
        return Vec::new();
    };
    let options = words(most).initial_indent(" ").subsequent_indent("   ");
    let wrapped = cell.text.lines().flat_map(|line| broken(line, &options));
    wrapped.map(|line| cell.tone.paint(&line, screen.is_coloured)).collect()
}

/// Returns the width of a row.
fn length(columns: &[(usize, usize)], gap: usize) -> usize {
    let widths: usize = columns.iter().map(|(_, width)| width).sum();
    widths + gap * columns.len().saturating_sub(1) + gap - 1
}

/// Returns the wrapping options: only at spaces, so that paths stay whole.
pub fn words(width: usize) -> textwrap::Options<'static> {
    textwrap::Options::new(width)
        .word_separator(WordSeparator::AsciiSpace)
        .word_splitter(WordSplitter::NoHyphenation)
}

/// Splits a line into words and the parts of dotted paths and long names, for columns that are narrower than a word.
fn parts(line: &str) -> Box<dyn Iterator<Item = Word<'_>> + '_> {
    let mut ends = Vec::new();
    let mut before = ' ';
    for (at, c) in line.char_indices() {
        let is_joint = matches!(before, '.' | '_' | '/') && c.is_alphanumeric();
        if (is_joint || before == ' ') && c != ' ' && at > 0 {
            ends.push(at);
        }
        before = c;
    }
    ends.push(line.len());
    let mut from = 0;
    Box::new(ends.into_iter().map(move |end| {
        let word = Word::from(&line[from..end]);
        from = end;
        word
    }))
}

/// Wraps a line. A number stays with its unit and its error.
pub fn broken(line: &str, options: &textwrap::Options<'_>) -> Vec<String> {
    let unbroken = no_break_units(line);
    let lines = textwrap::wrap(&unbroken, options).into_iter();
    lines.map(|line| line.replace(NO_BREAK, " ")).collect()
}

/// Truncates a text to at most this many columns.
pub fn cut(text: &str, most: usize) -> String {
    if display_width(text) <= most {
        return text.to_owned();
    }
    let mut kept = String::new();
    for c in text.chars() {
        if display_width(&kept) + display_width(c.encode_utf8(&mut [0; 4])) + 1 > most {
            break;
        }
        kept.push(c);
    }
    match most {
        0 => kept,
        _ => kept + "…",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan() -> Table {
        let header = ["stage", "kind", "outcome", "time", "why"];
        let mut table = table(&header, &["time"]).flowing(&["why"]).dispensable(&["kind"]);
        table.add_row(["small", "sample", "reused", "", ""]);
        table.add_row([
            "a surrogate of a long name",
            "train",
            "stale",
            "0.43 s (0.32 s to 0.57 s)",
            "parameter changed: elements_per_cell from 1 to 2\ninput changed: balanced",
        ]);
        table
    }

    fn on(width: usize) -> Screen {
        Screen {
            width: Some(width),
            is_coloured: false,
        }
    }

    #[test]
    fn without_a_terminal_columns_are_as_wide_as_they_need() {
        let mut table = table(&["stage", "time"], &["time"]);
        table.add_row(["surrogate", "0.43 s"]);
        table.add_row(["x", "12.0 s"]);
        let shown = "────────────────────\n stage         time\n════════════════════\n surrogate   0.43 s\n \
                     x           12.0 s\n────────────────────";
        assert_eq!(table.show(Screen::default()), shown);
    }

    #[test]
    fn no_line_exceeds_the_terminal_and_wrapped_text_is_complete() {
        let table = plan();
        for width in 20..200 {
            let shown = table.show(on(width));
            for line in shown.lines() {
                assert!(display_width(line) <= width, "{width}: {line}");
            }
            let words: String = shown.split_whitespace().collect::<Vec<_>>().join(" ");
            for word in ["elements_per_cell", "balanced", "reused"] {
                assert!(width < 50 || words.contains(word), "{width}: {shown}");
            }
        }
        let piped = table.show(Screen::default());
        assert_eq!(piped.lines().count(), 6, "a line for each row: {piped}");
        assert!(piped.contains("from 1 to 2; input changed: balanced"), "{piped}");
    }

    #[test]
    fn text_is_placed_below_its_row_if_its_column_is_too_narrow() {
        let shown = plan().show(on(80));
        let lines: Vec<&str> = shown.lines().collect();
        assert!(lines[1].contains("kind") && !lines[1].contains("why"), "{shown}");
        assert_eq!(lines[5], "    why: parameter changed: elements_per_cell from 1 to 2");
        assert_eq!(lines[6], "      input changed: balanced");
        let narrow = plan().show(on(70));
        assert!(!narrow.contains("kind") && narrow.contains("0.57 s"), "{narrow}");
    }

    #[test]
    fn the_name_of_a_row_precedes_its_numbers() {
        let mut table = table(&["effect", "value", "cost"], &["value"]).flowing(&["effect", "cost"]);
        table.add_row([
            "strain stiffening of the law",
            "0.346",
            "none to speak of, or hardly any",
        ]);
        let shown = table.show(on(30));
        let lines: Vec<&str> = shown.lines().map(str::trim).collect();
        assert_eq!(lines[1..3], ["effect", "value"], "{shown}");
        assert_eq!(lines[4..6], ["strain stiffening of the law", "0.346"], "{shown}");
        assert!(lines[6].starts_with("cost: none to speak"), "{shown}");
    }

    #[test]
    fn tones_colour_words_but_not_spaces() {
        let mut table = table(&["stage", "outcome", "time"], &["time"]);
        table.add_row([Cell::from("a"), Cell::toned("built", Tone::Good), Cell::from("1 s")]);
        let screen = Screen {
            width: Some(80),
            is_coloured: true,
        };
        assert!(table.show(screen).contains("a       \u{1b}[32mbuilt\u{1b}[0m      1 s"));
        let harm = Cell::toned("\u{1b}[2J", Tone::Plain);
        assert_eq!(harm.text, "\u{fffd}[2J");
    }

    #[test]
    fn a_long_path_is_wrapped_between_its_parts() {
        let mut table = table(&["parameter", "from"], &[]).flowing(&["parameter", "from"]);
        table.add_row([
            "stages.design.constraints.min_feature",
            "one value that is as long as that and more",
        ]);
        let shown = table.show(on(60));
        let first = |line: &str| line.get(1..30).map(|cell| cell.trim().to_owned()).unwrap_or_default();
        let cells: Vec<String> = shown.lines().skip(3).map(first).collect();
        for word in ["stages", "design", "constraints", "min", "feature"] {
            assert!(cells.iter().any(|cell| cell.contains(word)), "{word}: {shown}");
        }
        assert!(shown.lines().all(|line| display_width(line) <= 60), "{shown}");
    }

    #[test]
    fn a_number_stays_with_its_unit() {
        let of = |text: &str, width| broken(text, &words(width));
        assert_eq!(
            of("simulated 2.155 mm ± < 0.0001, more", 19),
            ["simulated 2.155 mm", "± < 0.0001, more"]
        );
        assert_eq!(of("simulated 2.155 mm", 16), ["simulated", "2.155 mm"]);
        assert_eq!(of("of 5 designs", 7), ["of 5", "designs"]);
        assert_eq!(of("simulated 2.155 mm, more", 18), ["simulated", "2.155 mm, more"]);
    }

    #[test]
    fn truncated_text_is_marked() {
        assert_eq!(cut("abcdef", 4), "abc…");
        assert_eq!(cut("abcd", 4), "abcd");
        assert_eq!(cut("漢字漢字", 5), "漢字…");
        assert_eq!(cut("ab", 0), "");
    }
}
