//! One page that needs nothing else: figures are within it, and nothing is fetched.

use std::fmt::Write;

use base64::prelude::{BASE64_STANDARD, Engine};

/// A page.
pub struct Page {
    title: String,
    lead: String,
    head: String,
    contents: Vec<Entry>,
    body: String,
}

/// A line of the list of contents.
struct Entry {
    id: String,
    title: String,
    within: bool,
}

/// How the cells of a column stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// Words.
    Text,
    /// Words that are not broken into lines.
    Key,
    /// Words that need room.
    Wide,
    /// Numbers, flush right.
    Number,
}

const STYLE: &str = include_str!("html/style.css");

impl Page {
    /// An empty page.
    #[must_use]
    pub fn new(title: &str) -> Self {
        Self {
            title: escaped(title),
            lead: String::new(),
            head: String::new(),
            contents: Vec::new(),
            body: String::new(),
        }
    }

    /// Says under the title what the page is about.
    pub fn lead(&mut self, text: &str) {
        self.lead = format!("<p class=\"lead\">{}</p>\n", escaped(text));
    }

    /// Puts numbers with what they are at the top.
    pub fn tiles(&mut self, tiles: &[(String, String)]) {
        let tile = |(number, what): &(String, String)| {
            format!("<li><b>{}</b><span>{}</span></li>\n", escaped(number), escaped(what))
        };
        self.head += &format!(
            "<ul class=\"tiles\">\n{}</ul>\n",
            tiles.iter().map(tile).collect::<String>()
        );
    }

    /// Puts something that nobody should overlook at the top.
    pub fn notice(&mut self, lines: &[String]) {
        let lines: String = lines.iter().map(|line| format!("<p>{}</p>", escaped(line))).collect();
        self.head += &format!("<div class=\"box\" role=\"note\">{lines}</div>\n");
    }

    /// Begins a section, which the list of contents names.
    pub fn section(&mut self, title: &str) {
        let id = self.entry(title, false);
        self.put(&format!("<h2 id=\"{id}\">{}</h2>\n", escaped(title)));
    }

    /// Begins a part of a section, which the list of contents names.
    pub fn part(&mut self, title: &str) {
        let id = self.entry(title, true);
        self.put(&format!("<h3 id=\"{id}\">{}</h3>\n", escaped(title)));
    }

    /// The title of something smaller, which the list of contents does not name.
    pub fn title(&mut self, title: &str) {
        self.put(&format!("<h4>{}</h4>\n", escaped(title)));
    }

    fn entry(&mut self, title: &str, within: bool) -> String {
        let id = format!("s{}", self.contents.len() + 1);
        self.contents.push(Entry {
            id: id.clone(),
            title: escaped(title),
            within,
        });
        id
    }

    /// Adds a paragraph for each line.
    pub fn lines(&mut self, lines: &[String]) {
        for line in lines {
            self.put(&format!("<p>{}</p>\n", escaped(line)));
        }
    }

    /// Adds a remark.
    pub fn note(&mut self, text: &str) {
        self.put(&format!("<p class=\"note\">{}</p>\n", escaped(text)));
    }

    /// Adds a table. Cells of the first column give their rows' class.
    pub fn table(&mut self, header: &[&str], rows: &[Vec<String>]) {
        let columns: Vec<(&str, Column)> = header.iter().map(|title| (*title, Column::Text)).collect();
        self.columns("Table", &columns, rows);
    }

    /// Adds a table, which scrolls within its own box where it is wider than the page.
    pub fn columns(&mut self, what: &str, columns: &[(&str, Column)], rows: &[Vec<String>]) {
        let class = |k: usize| match columns.get(k).map(|c| c.1) {
            Some(Column::Number) => " class=\"number\"",
            Some(Column::Key) => " class=\"key\"",
            Some(Column::Wide) => " class=\"wide\"",
            Some(Column::Text) | None => "",
        };
        let head = columns.iter().enumerate();
        let head: String = head
            .map(|(k, (title, _))| format!("<th scope=\"col\"{}>{}</th>", class(k), escaped(title)))
            .collect();
        let cell = |(k, text): (usize, &String)| match (k, mark(text)) {
            (0, Some(mark)) => format!("<td><span class=\"{mark}\">{}</span></td>", escaped(text)),
            _ => format!("<td{}>{}</td>", class(k), escaped(text)),
        };
        let rows: String = rows
            .iter()
            .map(|row| format!("<tr>{}</tr>\n", row.iter().enumerate().map(cell).collect::<String>()))
            .collect();
        self.scrolled(
            what,
            &format!("<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table>\n"),
        );
    }

    /// Adds markup in a box of its own, within which it scrolls where it is wider than the page.
    pub fn scrolled(&mut self, what: &str, markup: &str) {
        // Only what can be reached by the keyboard can be scrolled by it.
        self.put(&format!(
            "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{}\">{markup}</div>\n",
            escaped(what)
        ));
    }

    /// Adds markup as it is.
    pub fn markup(&mut self, markup: &str) {
        self.put(markup);
    }

    /// Adds a PNG with a caption.
    pub fn figure(&mut self, caption: &str, png: &[u8]) {
        let caption = escaped(caption);
        let data = BASE64_STANDARD.encode(png);
        self.put(&format!(
            "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>\n"
        ));
    }

    /// The text of the page.
    #[must_use]
    pub fn finish(self) -> String {
        let list = self.list();
        let class = if list.is_empty() { "sheet" } else { "sheet listed" };
        let Self {
            title,
            lead,
            head,
            body,
            ..
        } = self;
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<link rel=\"icon\" href=\"data:,\">\n<title>{title}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<div class=\"{class}\">\n<header>\n<h1>{title}</h1>\n{lead}{head}</header>\n\
             {list}<main>\n{body}</main>\n</div>\n</body>\n</html>\n"
        )
    }

    /// The list of contents; empty where there are no sections.
    fn list(&self) -> String {
        let Some(_) = self.contents.first() else {
            return String::new();
        };
        let mut out = String::from("<nav aria-label=\"Contents\">\n<ol>\n");
        let (mut open, mut inner) = (false, false);
        for entry in &self.contents {
            if inner && !entry.within {
                out += "</ol>";
            }
            if open && !entry.within {
                out += "</li>\n";
            }
            if entry.within && !inner {
                out += "<ol>";
            }
            let end = if entry.within { "</li>" } else { "" };
            out += &format!("<li><a href=\"#{}\">{}</a>{end}", entry.id, entry.title);
            (open, inner) = (true, entry.within);
        }
        out + if inner { "</ol>" } else { "" } + "</li>\n</ol>\n</nav>\n"
    }

    fn put(&mut self, text: &str) {
        // Writing to a text cannot fail.
        let _ = self.body.write_str(text);
    }
}

/// The class of a word that is to be seen.
fn mark(word: &str) -> Option<&'static str> {
    match word {
        "error" => Some("error"),
        "warning" => Some("warning"),
        _ => None,
    }
}

/// A text as it stands in a page.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_people_named_cannot_break_the_page() {
        let mut page = Page::new("<b>");
        page.table(&["x"], &[vec!["a\"&".into()]]);
        let text = page.finish();
        assert!(text.contains("&lt;b&gt;") && text.contains("a&quot;&amp;"));
        assert!(!text.contains("http"), "nothing is fetched");
    }
}
