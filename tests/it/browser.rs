//! A page as Chromium shows it, without a screen and without a network.

use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use super::common::readers;

/// The browser of this machine.
pub struct Browser {
    program: &'static str,
}

/// What a page says of itself.
#[derive(Debug)]
pub struct Seen {
    /// Width of what it is shown in.
    pub width: u32,
    /// Width of its content.
    pub scrolled: u32,
    /// Images and drawings.
    pub drawings: u32,
    /// Those of no size.
    pub without_size: u32,
    /// Everything that it asked for.
    pub fetched: u32,
    /// Errors of scripts and of what could not be loaded, and all that was written on the console.
    pub complaints: Vec<String>,
}

/// Tells the frame around the page how it looks. Errors are counted from before the page is read.
const BEFORE: &str = "<script>window.complaints=[];addEventListener('error',e=>complaints.push(String(e.message||e.target.tagName)),true)</script>";
const AFTER: &str = "<script>addEventListener('load',()=>{
// What is only printed has no rectangles.
const drawn=[...document.querySelectorAll('svg:not([aria-hidden]),img')].filter(d=>d.getClientRects().length);
const small=drawn.filter(d=>{const r=d.getBoundingClientRect();return r.width<8||r.height<8});
parent.postMessage(JSON.stringify({width:innerWidth,scrolled:document.documentElement.scrollWidth,drawings:drawn.length,
without_size:small.length,fetched:performance.getEntriesByType('resource').length,complaints:complaints}),'*')})</script>";

/// Defines `measured`, a function that finds faults of the page that it runs in.
pub const MEASURE: &str = include_str!("browser/measure.js");

impl Browser {
    /// The first that is there.
    pub fn find() -> Option<Self> {
        readers::installed("Chromium, which opens reports", Self::installed)
    }

    fn installed() -> Option<Self> {
        let works = |program: &&'static str| {
            let version = Command::new(program).arg("--version").output();
            version.is_ok_and(|output| output.status.success())
        };
        let program = ["chromium", "chromium-browser", "google-chrome"]
            .into_iter()
            .find(works)?;
        Some(Self { program })
    }

    /// Opens a copy of the page that looks at itself.
    pub fn visit(&self, page: &Path, width: u32, height: u32) -> Seen {
        let text = std::fs::read_to_string(page).unwrap();
        let text = text.replacen("<head>", &format!("<head>{BEFORE}"), 1);
        let text = text.replacen("</body>", &format!("{AFTER}</body>"), 1);
        let folder = tempfile::tempdir().unwrap();
        let frame = framed(folder.path(), &text, width, height);
        let (dom, told) = self.open(&frame, width, height, &["--dump-dom", "--virtual-time-budget=3000"]);
        let found = found(&dom).unwrap_or_else(|| panic!("the page said nothing: {told}"));
        let number = |key: &str| {
            found[key]
                .as_f64()
                .unwrap_or_else(|| panic!("{key} in {found}"))
                .round() as u32
        };
        let own = found["complaints"].as_array().unwrap().iter().map(Value::to_string);
        let console = told.lines().filter(|line| line.contains(":CONSOLE")).map(str::to_owned);
        Seen {
            width: number("width"),
            scrolled: number("scrolled"),
            drawings: number("drawings"),
            without_size: number("without_size"),
            fetched: number("fetched"),
            complaints: own.chain(console).collect(),
        }
    }

    /// What is wrong with a page at the widths of a screen, a tablet and a telephone, light and dark, and on paper:
    /// text that leaves the page or its box, texts that cover each other, and text that hardly differs from what is
    /// behind it. One line for each fault.
    pub fn faults(&self, page: &Path) -> Vec<String> {
        let text = std::fs::read_to_string(page).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let mut frames = String::new();
        let views = [1440, 800, 390]
            .into_iter()
            .flat_map(|width| [(width, "light"), (width, "dark")]);
        let views: Vec<(u32, &str)> = views.chain([(PAPER, "print")]).collect();
        for (k, (width, look)) in views.iter().enumerate() {
            let name = format!("{width} px, {look}");
            let script = format!(
                "<script>{MEASURE}addEventListener('load',()=>parent.postMessage(JSON.stringify(measured({name:?})),'*'))</script>"
            );
            let own = in_look(&text, look).replacen("</body>", &format!("{script}</body>"), 1);
            std::fs::write(folder.path().join(format!("{k}.html")), own).unwrap();
            frames += &format!(
                "<iframe src=\"{k}.html\" style=\"border:0;display:block;width:{width}px;height:900px\"></iframe>"
            );
        }
        let frame = folder.path().join("frame.html");
        let listen = "<script>const all=[];addEventListener('message',e=>{all.push(JSON.parse(e.data));document.body.dataset.found=JSON.stringify(all)})</script>";
        std::fs::write(
            &frame,
            format!("<!DOCTYPE html><html><body style=\"margin:0\">{listen}{frames}</body></html>"),
        )
        .unwrap();
        let (dom, told) = self.open(&frame, 1440, 900, &["--dump-dom", "--virtual-time-budget=20000"]);
        let found = found(&dom).unwrap_or_else(|| panic!("the page said nothing: {told}"));
        let seen = found.as_array().unwrap();
        assert_eq!(seen.len(), views.len(), "every view is measured: {told}");
        let texts = |view: &Value| view["texts"].as_u64().unwrap();
        assert!(seen.iter().all(|view| texts(view) > 100), "{seen:?}");
        let faults = seen.iter().flat_map(|view| view["faults"].as_array().unwrap());
        faults.map(|fault| fault.as_str().unwrap().to_owned()).collect()
    }

    /// Writes an image of the page.
    pub fn photograph(&self, page: &Path, width: u32, height: u32, image: &Path) {
        let text = std::fs::read_to_string(page).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let frame = framed(folder.path(), &text, width, height);
        let (_, told) = self.open(&frame, width, height, &[&format!("--screenshot={}", image.display())]);
        assert!(image.exists(), "{told}");
    }

    /// How many pages it prints.
    pub fn pages(&self, page: &Path) -> usize {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("printed.pdf");
        let print = format!("--print-to-pdf={}", file.display());
        let (_, told) = self.open(page, 800, 1100, &[&print, "--no-pdf-header-footer"]);
        let printed = std::fs::read(&file).unwrap_or_else(|error| panic!("{error}: {told}"));
        let text = String::from_utf8_lossy(&printed);
        // Chromium writes the objects of pages uncompressed.
        let pages = text.split("/Type /Page").skip(1);
        pages.filter(|rest| !rest.starts_with('s')).count()
    }

    /// What it writes to stdout and stderr.
    fn open(&self, page: &Path, width: u32, height: u32, arguments: &[&str]) -> (String, String) {
        let profile = tempfile::tempdir().unwrap();
        let output = Command::new("timeout")
            .args(["60", self.program, "--headless=new", "--no-sandbox", "--disable-gpu"])
            .args([
                "--disable-dev-shm-usage",
                "--hide-scrollbars",
                "--no-first-run",
                "--enable-logging=stderr",
            ])
            .arg("--host-resolver-rules=MAP * ~NOTFOUND")
            .arg(format!("--user-data-dir={}", profile.path().display()))
            // It makes no window narrower than this.
            .arg(format!("--window-size={},{height}", width.max(500)))
            .args(arguments)
            .arg(format!("file://{}", page.display()))
            .env("HOME", profile.path())
            .output()
            .unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (text(&output.stdout), text(&output.stderr))
    }
}

/// The colours that a PDF fills shapes and letters with, each once.
pub fn printed_colours(pdf: &[u8]) -> BTreeSet<[u8; 3]> {
    let mut found = BTreeSet::new();
    for content in streams(pdf) {
        let words: Vec<&str> = content.split_ascii_whitespace().collect();
        for four in words.windows(4).filter(|four| four[3] == "rg") {
            let shares: Vec<f64> = four[..3].iter().filter_map(|word| word.parse().ok()).collect();
            if let [red, green, blue] = shares[..] {
                found.insert([red, green, blue].map(|share: f64| (255.0 * share).round() as u8));
            }
        }
    }
    found
}

/// The compressed contents of a PDF, as text; other streams are left out.
fn streams(pdf: &[u8]) -> Vec<String> {
    let find = |from: usize, word: &[u8]| {
        pdf[from..]
            .windows(word.len())
            .position(|own| own == word)
            .map(|at| from + at)
    };
    let mut found = Vec::new();
    let mut from = 0;
    while let Some(at) = find(from, b"stream\n") {
        let start = at + b"stream\n".len();
        let Some(end) = find(start, b"endstream") else { break };
        let mut text = String::new();
        if flate2::read::ZlibDecoder::new(&pdf[start..end])
            .read_to_string(&mut text)
            .is_ok()
        {
            found.push(text);
        }
        from = end + b"endstream".len();
    }
    found
}

/// Width between the margins of a page of A4, in pixels.
const PAPER: u32 = 688;

/// What the frame has heard from the page; none where that said nothing.
fn found(dom: &str) -> Option<Value> {
    let found = dom.split("data-found=\"").nth(1)?.split('"').next()?;
    let found = found
        .replace("&quot;", "\"")
        .replace("&lt;", "<")
        .replace("&gt;", ">")
        .replace("&amp;", "&");
    Some(serde_json::from_str(&found).unwrap())
}

/// The page in the look that a reader's settings, or a printer, would give it.
fn in_look(page: &str, look: &str) -> String {
    let dark = "@media (prefers-color-scheme: dark)";
    let print = "@media print";
    assert!(page.contains(dark) && page.contains(print), "the page has these looks");
    let only = |is: bool| if is { "@media all" } else { "@media not all" };
    page.replace(dark, only(look == "dark"))
        .replace(print, only(look == "print"))
}

/// The page in a frame as wide as the screen that is meant.
fn framed(folder: &Path, page: &str, width: u32, height: u32) -> PathBuf {
    std::fs::write(folder.join("page.html"), page).unwrap();
    let frame = folder.join("frame.html");
    let listen = "<script>addEventListener('message',e=>document.body.dataset.found=e.data)</script>";
    let text = format!(
        "<!DOCTYPE html><html><body style=\"margin:0\">{listen}\
         <iframe src=\"page.html\" style=\"border:0;display:block;width:{width}px;height:{height}px\"></iframe></body></html>"
    );
    std::fs::write(&frame, text).unwrap();
    frame
}

/// How many colours the first `width` columns of an image have, and which share is not of the most frequent one.
pub fn colours(image: &Path, width: usize) -> (usize, f64) {
    let mut reader = png::Decoder::new(std::fs::File::open(image).unwrap())
        .read_info()
        .unwrap();
    let mut bytes = vec![0; reader.output_buffer_size()];
    let frame = reader.next_frame(&mut bytes).unwrap();
    let channels = frame.color_type.samples();
    let mut counts = std::collections::BTreeMap::new();
    for line in bytes.chunks(frame.line_size) {
        for pixel in line.chunks_exact(channels).take(width) {
            *counts.entry(pixel[..3].to_vec()).or_insert(0_usize) += 1;
        }
    }
    let total: usize = counts.values().sum();
    let most = counts.values().max().copied().unwrap_or(0);
    (counts.len(), 1.0 - most as f64 / total as f64)
}
