//! Files of the page, compiled in.

/// The main page.
pub const INDEX: &str = include_str!("../page/index.html");

/// The page for a browser without the token.
pub const LOCKED: &str = include_str!("../page/locked.html");

macro_rules! assets {
    ($($media:literal: $($name:literal)*;)*) => {
        const ASSETS: &[(&str, &str, &str)] = &[$($(($name, $media, include_str!(concat!("../page/", $name)))),*),*];
    };
}

assets! {
    "text/css; charset=utf-8": "page.css";
    "text/javascript; charset=utf-8":
        "main.js" "server.js" "elements.js" "pattern.js" "chart.js" "colours.js" "membrane.js" "files.js" "filter.js"
        "live.js" "dag.js" "pictures.js" "origin.js" "models.js" "designs.js" "accuracy.js" "quantity.js" "sketch.js"
        "sketch-kept.js" "sketch-pen.js" "sketch-numbers.js" "sketch-improve.js" "sketch-files.js" "sketch-panels.js"
        "sketch-gallery.js" "sketch-link.js" "sketch-point.js" "sketch-sweep.js" "sketch-voltage.js"
        "sketch-picture.js"
        "overview.js" "pipelines.js" "runs.js" "run-list.js" "parallel.js" "artifacts.js" "rows.js" "audit.js";
}

/// Returns the media type and the text of a file of the page.
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
