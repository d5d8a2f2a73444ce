//! What the browser runs, compiled in.

/// The page.
pub const INDEX: &str = include_str!("../page/index.html");

/// What is shown to who has not named the token.
pub const LOCKED: &str = include_str!("../page/locked.html");

macro_rules! assets {
    ($($name:literal: $media:literal,)*) => {
        const ASSETS: &[(&str, &str, &str)] = &[$(($name, $media, include_str!(concat!("../page/", $name)))),*];
    };
}

assets! {
    "page.css": "text/css; charset=utf-8",
    "main.js": "text/javascript; charset=utf-8",
    "server.js": "text/javascript; charset=utf-8",
    "elements.js": "text/javascript; charset=utf-8",
    "pattern.js": "text/javascript; charset=utf-8",
    "chart.js": "text/javascript; charset=utf-8",
    "colours.js": "text/javascript; charset=utf-8",
    "membrane.js": "text/javascript; charset=utf-8",
    "files.js": "text/javascript; charset=utf-8",
    "filter.js": "text/javascript; charset=utf-8",
    "live.js": "text/javascript; charset=utf-8",
    "dag.js": "text/javascript; charset=utf-8",
    "pictures.js": "text/javascript; charset=utf-8",
    "origin.js": "text/javascript; charset=utf-8",
    "models.js": "text/javascript; charset=utf-8",
    "designs.js": "text/javascript; charset=utf-8",
    "accuracy.js": "text/javascript; charset=utf-8",
    "quantity.js": "text/javascript; charset=utf-8",
    "sketch.js": "text/javascript; charset=utf-8",
    "sketch-kept.js": "text/javascript; charset=utf-8",
    "sketch-pen.js": "text/javascript; charset=utf-8",
    "sketch-numbers.js": "text/javascript; charset=utf-8",
    "sketch-improve.js": "text/javascript; charset=utf-8",
    "sketch-files.js": "text/javascript; charset=utf-8",
    "sketch-panels.js": "text/javascript; charset=utf-8",
    "pipelines.js": "text/javascript; charset=utf-8",
    "runs.js": "text/javascript; charset=utf-8",
    "artifacts.js": "text/javascript; charset=utf-8",
    "rows.js": "text/javascript; charset=utf-8",
    "audit.js": "text/javascript; charset=utf-8",
}

/// A file of the page, with its media type.
#[must_use]
pub fn asset(name: &str) -> Option<(&'static str, &'static str)> {
    let found = ASSETS.iter().find(|(known, _, _)| *known == name);
    found.map(|(_, media, text)| (*media, *text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_loads_nothing_from_elsewhere_and_has_no_script_within() {
        let texts = ASSETS.iter().map(|(_, _, text)| *text).chain([INDEX, LOCKED]);
        for text in texts {
            let named = text.replace("http://www.w3.org/", "");
            assert!(!named.contains("http://") && !named.contains("https://"), "{text}");
            assert!(!text.contains("innerHTML") && !text.contains("eval("));
        }
        assert!(INDEX.matches("<script").count() == INDEX.matches("<script type=\"module\" src=").count());
        assert!(!INDEX.contains(" style=") && !INDEX.contains(" onclick="));
    }
}
