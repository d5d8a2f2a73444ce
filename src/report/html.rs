//! A page in one file: drawings are within it, and nothing is fetched.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::drawing::{Chart, DRAWING_STYLE, PAGE_STYLE};
use deaflow_base::{no_break_units, printable};

/// A page.
pub struct Page {
    title: String,
    head: Vec<Markup>,
    contents: Vec<ContentsEntry>,
    body: Vec<Markup>,
}

/// A section in the table of contents, with its parts.
struct ContentsEntry {
    id: String,
    title: String,
    parts: Vec<(String, String)>,
}

/// The format of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// Text.
    Text,
    /// Text on one line.
    Key,
    /// Wide text.
    Wide,
    /// Numbers, aligned to the right.
    Number,
    /// Digests, abbreviated; a tooltip has all digits.
    Digest,
}

/// Digits of an abbreviated digest.
const SHORT: usize = 12;

impl Column {
    fn class(self) -> Option<&'static str> {
        match self {
            Self::Text => None,
            Self::Key | Self::Digest => Some("key"),
            Self::Wide => Some("wide"),
            Self::Number => Some("number"),
        }
    }
}

impl Page {
    /// Creates an empty page.
    #[must_use]
    pub fn new(title: &str) -> Self {
        Self {
            title: title.to_owned(),
            head: Vec::new(),
            contents: Vec::new(),
            body: Vec::new(),
        }
    }

    /// Whether the page has no content yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.head.is_empty() && self.body.is_empty()
    }

    /// Adds an introduction below the title.
    pub fn lead(&mut self, text: &str) {
        self.head.push(html! { p.lead { (prose(text)) } });
    }

    /// Adds a part at the top.
    pub fn top(&mut self, part: Markup) {
        self.head.push(part);
    }

    /// Adds numbers with their descriptions at the top.
    pub fn tiles(&mut self, tiles: &[(String, String)]) {
        if tiles.is_empty() {
            return;
        }
        self.head.push(html! {
            ul.tiles { @for (number, what) in tiles { li { b { (number) } span { (what) } } } }
        });
    }

    /// Adds a notice at the top.
    pub fn notice(&mut self, lines: &[String]) {
        self.head
            .push(html! { div.box role="note" { @for line in lines { p { (prose(line)) } } } });
    }

    /// Adds warnings at the top, a line for each.
    pub fn warnings(&mut self, title: &str, warnings: &[String]) {
        if !warnings.is_empty() {
            self.head.push(html! {
                div.box role="note" { p { b { (title) } } ul { @for warning in warnings { li { (prose(warning)) } } } }
            });
        }
    }

    /// Starts a section, which is in the table of contents.
    pub fn section(&mut self, title: &str) {
        let id = format!("s{}", self.contents.len() + 1);
        self.add(html! { h2 id=(id) { (title) } });
        self.contents.push(ContentsEntry {
            id,
            title: title.to_owned(),
            parts: Vec::new(),
        });
    }

    /// Starts a section with an introduction, unless it is the last one already.
    pub fn open(&mut self, title: &str, about: &str) {
        if self.contents.last().is_some_and(|section| section.title == title) {
            return;
        }
        self.section(title);
        if !about.is_empty() {
            self.line(about);
        }
    }

    /// Starts a part of a section, which is in the table of contents.
    pub fn part(&mut self, title: &str) {
        let section = self.contents.last_mut();
        let id = section.map(|section| {
            let id = format!("{}-{}", section.id, section.parts.len() + 1);
            section.parts.push((id.clone(), title.to_owned()));
            id
        });
        self.add(html! { h3 id=[id] { (title) } });
    }

    /// Adds a smaller title, which is not in the table of contents.
    pub fn title(&mut self, title: &str) {
        self.add(html! { h4 { (title) } });
    }

    /// Adds a paragraph.
    pub fn line(&mut self, text: &str) {
        self.add(html! { p { (prose(text)) } });
    }

    /// Adds a paragraph for each line.
    pub fn lines(&mut self, lines: &[String]) {
        lines.iter().for_each(|line| self.line(line));
    }

    /// Adds preformatted text.
    pub fn add_text(&mut self, text: &str) {
        self.scrolled("Results", &html! { pre { (text) } });
    }

    /// Adds a note.
    pub fn note(&mut self, text: &str) {
        self.add(html! { p.note { (prose(text)) } });
    }

    /// Adds a table. A first cell `error` or `warning` is highlighted.
    pub fn table(&mut self, header: &[&str], rows: &[Vec<String>]) {
        let columns: Vec<(&str, Column)> = header.iter().map(|title| (*title, Column::Text)).collect();
        self.columns("Table", &columns, rows);
    }

    /// Adds a table, which scrolls in its own box if it is wider than the page.
    pub fn columns(&mut self, what: &str, columns: &[(&str, Column)], rows: &[Vec<String>]) {
        let class = |k: usize| columns.get(k).and_then(|(_, column)| column.class());
        let is_digest = |k: usize| columns.get(k).is_some_and(|(_, column)| *column == Column::Digest);
        let cell = |(k, text): (usize, &String)| match (k, mark(text)) {
            (0, Some(mark)) => html! { td { span class=(mark) { (text) } } },
            (k, _) if is_digest(k) && text.len() > SHORT => {
                html! { td.key { span.mono title=(text) { (text.chars().take(SHORT).collect::<String>()) } } }
            }
            _ => html! { td class=[class(k)] { (prose(text)) } },
        };
        let table = html! {
            table {
                thead {
                    tr {
                        @for (k, (title, _)) in columns.iter().enumerate() {
                            th scope="col" class=[class(k)] { (title) }
                        }
                    }
                }
                tbody { @for row in rows { tr { @for entry in row.iter().enumerate() { (cell(entry)) } } "\n" } }
            }
        };
        self.scrolled(what, &table);
    }

    /// Adds markup in a box of its own, which scrolls if it is wider than the page.
    pub fn scrolled(&mut self, what: &str, markup: &Markup) {
        // With a tab index, it can be scrolled by the keyboard.
        self.add(html! { div.scroll tabindex="0" role="region" aria-label=(what) { (markup) } });
    }

    /// Adds charts side by side.
    pub fn charts<'c>(&mut self, charts: impl IntoIterator<Item = &'c Chart>) {
        self.add(html! { div.charts { @for chart in charts { (chart.figure()) } } });
    }

    /// Adds a drawing with a caption.
    pub fn figure(&mut self, caption: &str, drawing: &Markup) {
        self.add(html! { figure { (drawing) figcaption { (prose(caption)) } } });
    }

    /// Adds markup.
    pub fn add(&mut self, markup: Markup) {
        self.body.push(markup);
    }

    /// Writes the page.
    #[must_use]
    pub fn finish(self) -> String {
        let class = if self.contents.is_empty() {
            "sheet"
        } else {
            "sheet listed"
        };
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    link rel="icon" href="data:,";
                    title { (self.title) }
                    style { (PreEscaped(PAGE_STYLE)) (PreEscaped(DRAWING_STYLE)) }
                }
                body {
                    div class=(class) {
                        header { h1 { (self.title) } @for part in &self.head { (part) } }
                        (self.list())
                        main { @for part in &self.body { (part) "\n" } }
                    }
                }
            }
        };
        printable(&page.into_string()).into_owned()
    }

    /// Returns the table of contents; empty without sections.
    fn list(&self) -> Markup {
        let link = |id: &str, title: &str| html! { a href={ "#" (id) } { (title) } };
        html! {
            @if !self.contents.is_empty() {
                nav aria-label="Contents" {
                    ol {
                        @for section in &self.contents {
                            li {
                                (link(&section.id, &section.title))
                                @if !section.parts.is_empty() {
                                    ol { @for (id, title) in &section.parts { li { (link(id, title)) } } }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Formats a text: words between backticks are code, and numbers stay with their units.
pub(crate) fn prose(text: &str) -> Markup {
    let parts: Vec<&str> = text.split('`').collect();
    // A single backtick was written by a user.
    if parts.len().is_multiple_of(2) {
        return html! { (no_break_units(text)) };
    }
    html! {
        @for (k, part) in parts.iter().enumerate() {
            @if k % 2 == 1 { code { (part) } } @else { (no_break_units(part)) }
        }
    }
}

/// Returns the class of a highlighted word.
fn mark(word: &str) -> Option<&'static str> {
    ["error", "warning"].into_iter().find(|class| *class == word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_users_cannot_break_the_page() {
        let mut page = Page::new("<b>");
        page.table(&["x"], &[vec!["a\"&".into()]]);
        let text = page.finish();
        assert!(text.contains("&lt;b&gt;") && text.contains("a&quot;&amp;"));
        assert!(!text.contains("http"), "nothing is fetched");
    }

    #[test]
    fn text_between_backticks_is_code_and_units_stay_with_their_numbers() {
        let mut page = Page::new("t");
        page.line("the `one <cell>` moves 2.1 mm");
        page.line("a ` alone");
        let text = page.finish();
        assert!(
            text.contains("<p>the <code>one &lt;cell&gt;</code> moves 2.1\u{a0}mm</p>"),
            "{text}"
        );
        assert!(text.contains("<p>a ` alone</p>"), "{text}");
    }

    #[test]
    fn the_table_of_contents_has_sections_with_their_parts() {
        let mut page = Page::new("t");
        page.section("One");
        page.part("first");
        page.section("Two");
        let text = page.finish();
        assert!(text.contains("<a href=\"#s1\">One</a><ol><li><a href=\"#s1-1\">first</a></li></ol></li>"));
        assert!(text.contains("<h2 id=\"s2\">Two</h2>"));
    }
}
