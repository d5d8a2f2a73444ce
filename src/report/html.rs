//! One page that needs nothing else: figures are within it, and nothing is fetched.

use std::fmt::Write;

/// A page.
pub struct Page {
    title: String,
    body: String,
}

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:1100px;margin:2em auto;padding:0 1em;color:#1e1e1e}\
table{border-collapse:collapse;width:100%}th,td{text-align:left;vertical-align:top;padding:.3em .8em .3em 0;\
border-bottom:1px solid #e1e1e1}img{max-width:100%}figure{margin:1.5em 0}.error{color:#b03000;font-weight:bold}\
.warning{color:#8a5a00;font-weight:bold}";

impl Page {
    /// An empty page.
    #[must_use]
    pub fn new(title: &str) -> Self {
        Self {
            title: escaped(title),
            body: String::new(),
        }
    }

    /// Adds a paragraph for each line.
    pub fn lines(&mut self, lines: &[String]) {
        for line in lines {
            self.put(&format!("<p>{}</p>\n", escaped(line)));
        }
    }

    /// Adds a table. Cells of the first column give their rows' class.
    pub fn table(&mut self, header: &[&str], rows: &[Vec<String>]) {
        let cells = |tag: &str, cells: &mut dyn Iterator<Item = String>| -> String {
            cells.map(|cell| format!("<{tag}>{cell}</{tag}>")).collect()
        };
        let head = cells("th", &mut header.iter().map(|title| escaped(title)));
        self.put(&format!("<table>\n<tr>{head}</tr>\n"));
        for row in rows {
            let class = row.first().map_or_else(String::new, |word| escaped(word));
            let marked = row.iter().enumerate().map(|(k, cell)| match k {
                0 => format!("<span class=\"{class}\">{}</span>", escaped(cell)),
                _ => escaped(cell),
            });
            self.put(&format!("<tr>{}</tr>\n", cells("td", &mut { marked })));
        }
        self.put("</table>\n");
    }

    /// Adds a PNG with a caption.
    pub fn figure(&mut self, caption: &str, png: &[u8]) {
        let caption = escaped(caption);
        let data = base64(png);
        self.put(&format!(
            "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>\n"
        ));
    }

    /// The text of the page.
    #[must_use]
    pub fn finish(self) -> String {
        let Self { title, body } = self;
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{title}</title>\n\
             <style>{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n{body}</body>\n</html>\n"
        )
    }

    fn put(&mut self, text: &str) {
        // Writing to a text cannot fail.
        let _ = self.body.write_str(text);
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = chunk
            .iter()
            .enumerate()
            .fold(0_u32, |word, (k, b)| word | u32::from(*b) << (16 - 8 * k));
        for k in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * k) & 63) as usize];
            out.push(if k <= chunk.len() { char::from(digit) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_written_as_the_standard_says() {
        // RFC 4648, section 10.
        for (text, coded) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(text.as_bytes()), coded);
        }
        assert_eq!(base64(&[0xfb, 0xff]), "+/8=");
    }

    #[test]
    fn what_people_named_cannot_break_the_page() {
        let mut page = Page::new("<b>");
        page.table(&["x"], &[vec!["a\"&".into()]]);
        let text = page.finish();
        assert!(text.contains("&lt;b&gt;") && text.contains("a&quot;&amp;"));
        assert!(!text.contains("http"), "nothing is fetched");
    }
}
