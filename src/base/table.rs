//! Reads tables of numbers as other programs write them.
//!
//! Spreadsheets, NumPy, MATLAB, COMSOL and measuring instruments differ in the separator, the decimal comma, comments,
//! line ends and encodings. The first lines of a file show which it uses; every reader of tables takes them all.

use std::borrow::Cow;
use std::cell::Cell;
use std::io::{BufRead, BufReader, Cursor, Error, ErrorKind, Read, Result as IoResult};
use std::ops::Range;
use std::path::Path;

use crate::file::open_regular;
use crate::listed::listed;

/// Bytes at the start of a file that show its dialect.
const HEAD: u64 = 1 << 16;

/// The longest line in bytes.
const LONGEST: u64 = 1 << 20;

/// The largest file in UTF-16, in bytes; it is converted as a whole.
const LARGEST_UTF16: u64 = 64 << 20;

/// A table that is read line by line.
pub struct Table {
    input: Box<dyn BufRead>,
    /// The last byte of each line.
    end: u8,
    separator: Separator,
    /// The number of the current line, from 1.
    line: u64,
    text: String,
    fields: Vec<Range<usize>>,
    /// The last comment so far.
    comment: String,
    /// The number of fields of the header.
    columns: Option<usize>,
    /// Whether the current line is to be returned again.
    is_pending: bool,
    /// How the numbers that were read so far are written.
    notation: Cell<Notation>,
}

/// How numbers are written: `1,234` is 1.234 with a decimal comma, and 1234 with a decimal point.
#[derive(Clone, Copy, Debug, Default)]
struct Notation {
    has_points: bool,
    has_commas: bool,
    /// Whether a comma can only be decimal, as in `0,5`.
    is_comma_decimal: bool,
}

impl Notation {
    fn add(&mut self, number: &str) {
        self.has_points |= number.contains('.');
        if let Some((whole, fraction)) = number.split_once(',') {
            let digits = whole.trim_start_matches(['+', '-']);
            let may_separate = (1..=3).contains(&digits.len()) && !digits.starts_with('0') && fraction.len() == 3;
            self.has_commas = true;
            self.is_comma_decimal |= !may_separate;
        }
    }

    /// Says why the commas may separate thousands.
    fn doubt(self, is_at_end: bool) -> Option<&'static str> {
        match (self.has_commas, self.has_points) {
            (true, true) => Some("the numbers have points and commas, so one of them separates thousands"),
            (true, false) if is_at_end && !self.is_comma_decimal => {
                Some("each comma is followed by three digits, so it may separate thousands")
            }
            _ => None,
        }
    }
}

/// What to do about commas in doubt.
const ONE_SIGN: &str = "write numbers without separators of thousands";

/// What stands between the fields of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Separator {
    /// One character, after which a blank may follow.
    One(u8),
    /// Any number of blanks.
    Blanks,
}

/// Why a table cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The system reported an error, or the file is too large.
    #[error("{0}")]
    Unreadable(#[from] Error),
    /// A line is wrong.
    #[error("line {line}: {why}")]
    Line {
        /// Its number, from 1.
        line: u64,
        /// What is wrong.
        why: String,
    },
    /// Its commas may separate thousands.
    #[error("{0}; {ONE_SIGN}")]
    Notation(&'static str),
    /// A column has the name of another.
    #[error("the file has two columns {0}")]
    Twice(String),
    /// A column is missing.
    #[error("the column {missing} is missing; the columns are {}", listed(.found))]
    Columns {
        /// Its name.
        missing: String,
        /// The fields of the first line.
        found: Vec<String>,
    },
}

/// A line with its fields.
pub struct Row<'a> {
    /// Its number in the file, from 1.
    pub line: u64,
    text: &'a str,
    fields: &'a [Range<usize>],
    /// Whether a separator is at the end of the line.
    is_open: bool,
    notation: &'a Cell<Notation>,
}

impl<'a> Row<'a> {
    /// Returns the number of fields.
    #[must_use]
    pub fn len(&self) -> usize {
        self.fields.len()
    }

    /// Returns whether there are no fields.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.fields.is_empty()
    }

    /// Returns a field without quotes and blanks around it; an empty text if the line is shorter.
    #[must_use]
    pub fn field(&self, at: usize) -> &'a str {
        self.fields.get(at).map_or("", |range| &self.text[range.clone()])
    }

    /// Returns the fields in order.
    pub fn fields(&self) -> impl Iterator<Item = &'a str> + use<'_, 'a> {
        (0..self.len()).map(|at| self.field(at))
    }

    /// Returns the number of the first empty field, from 1, if the line has `columns` fields. A separator at the end of
    /// a line that lacks one field stands before an empty one.
    #[must_use]
    pub fn empty(&self, columns: usize) -> Option<usize> {
        let is_whole = self.len() == columns || self.is_open && self.len() + 1 == columns;
        is_whole
            .then(|| (0..columns).find(|at| self.field(*at).is_empty()))?
            .map(|at| at + 1)
    }

    /// Creates an error at this line.
    #[must_use]
    pub fn error(&self, why: impl Into<String>) -> TableError {
        TableError::Line {
            line: self.line,
            why: why.into(),
        }
    }

    /// Returns a field with a decimal point for a decimal comma.
    ///
    /// # Errors
    /// When the table also has numbers with a point: then its commas may separate thousands.
    pub fn with_point(&self, at: usize) -> Result<Cow<'a, str>, TableError> {
        let text = self.field(at);
        let mut notation = self.notation.get();
        if text.starts_with(|c: char| c.is_ascii_digit() || "+-.,".contains(c)) {
            notation.add(text);
            self.notation.set(notation);
        }
        match notation.doubt(false) {
            Some(doubt) => Err(self.error(format!("{doubt}: {:?}; {ONE_SIGN}", clipped(text)))),
            None => Ok(with_point(text)),
        }
    }

    /// Returns a field as a double. `TRUE` and `FALSE`, as spreadsheets write them, are 1 and 0.
    ///
    /// # Errors
    /// When it is not a number.
    pub fn number(&self, at: usize) -> Result<f64, TableError> {
        let text = self.with_point(at)?;
        match text.parse() {
            Ok(number) => Ok(number),
            Err(_) if text.eq_ignore_ascii_case("true") => Ok(1.0),
            Err(_) if text.eq_ignore_ascii_case("false") => Ok(0.0),
            Err(_) if text.is_empty() => Err(self.error(format!("value {} is empty", at + 1))),
            Err(_) => Err(self.error(format!("value {}: {:?} is not a number", at + 1, clipped(&text)))),
        }
    }
}

/// Replaces a decimal comma by a point. A text with a comma and a point is not a number in either notation.
fn with_point(text: &str) -> Cow<'_, str> {
    match text.contains(',') && !text.contains('.') {
        true => Cow::Owned(text.replacen(',', ".", 1)),
        false => Cow::Borrowed(text),
    }
}

/// Returns the beginning of a text.
fn clipped(text: &str) -> String {
    text.chars().take(20).collect()
}

impl Table {
    /// Opens a file of at most `most` bytes.
    ///
    /// # Errors
    /// When it cannot be read, is not a regular file, or is larger.
    pub fn open(path: &Path, most: u64) -> Result<Self, TableError> {
        let file = open_regular(path)?;
        let bytes = file.metadata()?.len();
        if bytes > most {
            let why = format!("the file has {bytes} bytes; at most {most} are allowed");
            return Err(Error::new(ErrorKind::FileTooLarge, why).into());
        }
        Ok(Self::new(file.take(most))?)
    }

    /// Reads a text in memory.
    ///
    /// # Errors
    /// When it is UTF-16 and longer than 64 MiB.
    pub fn of_bytes(bytes: Vec<u8>) -> Result<Self, TableError> {
        Ok(Self::new(Cursor::new(bytes))?)
    }

    fn new(mut input: impl Read + 'static) -> IoResult<Self> {
        let mut head = Vec::new();
        input.by_ref().take(HEAD).read_to_end(&mut head)?;
        if let [0xff, 0xfe, ..] | [0xfe, 0xff, ..] = head[..] {
            // As Excel writes "Unicode text".
            let text = of_utf16(&head, input)?;
            return Self::new(Cursor::new(text.into_bytes()));
        }
        let skipped = if head.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        head.drain(..skipped);
        let end = if head.contains(&b'\n') || !head.contains(&b'\r') {
            b'\n'
        } else {
            b'\r'
        };
        let separator = match of_excel(&head) {
            Some((separator, length)) => {
                // The line stays, so that lines have their numbers.
                head[..length].fill(b' ');
                separator
            }
            None => Separator::of(&String::from_utf8_lossy(&head), end),
        };
        Ok(Self {
            input: Box::new(BufReader::new(Cursor::new(head).chain(input))),
            end,
            separator,
            line: 0,
            text: String::new(),
            fields: Vec::new(),
            comment: String::new(),
            columns: None,
            is_pending: false,
            notation: Cell::default(),
        })
    }

    /// Finds columns by their names, in any order and in upper or lower case; other columns are skipped. Their names
    /// are on the first line, or in the comment before it, as `numpy.savetxt(…, header=…)` writes them.
    ///
    /// # Errors
    /// When a column is missing, or the file cannot be read.
    pub fn columns<const N: usize>(&mut self, names: [&str; N]) -> Result<[usize; N], TableError> {
        let found = self.header()?;
        let mut places = [0; N];
        for (place, name) in places.iter_mut().zip(names) {
            let mut places = (0..found.len()).filter(|at| found[*at].eq_ignore_ascii_case(name));
            *place = places.next().ok_or_else(|| TableError::Columns {
                missing: name.to_owned(),
                found: found.clone(),
            })?;
            if places.next().is_some() {
                return Err(TableError::Twice(name.to_owned()));
            }
        }
        Ok(places)
    }

    /// Reads the names of the columns: on the first line, or in the comment before it, as
    /// `numpy.savetxt(…, header=…)` writes them.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn header(&mut self) -> Result<Vec<String>, TableError> {
        let comment = |text: &str, separator: Separator| {
            let mut fields = Vec::new();
            separator.split(text, &mut fields);
            fields
                .into_iter()
                .map(|range| text[range].to_owned())
                .collect::<Vec<_>>()
        };
        let separator = self.separator;
        let first: Vec<String> = match self.next_row()? {
            Some(row) => row.fields().map(str::to_owned).collect(),
            None => Vec::new(),
        };
        let is_data = first.iter().any(|field| with_point(field).parse::<f64>().is_ok());
        let found = match is_data && !self.comment.is_empty() {
            true => comment(&self.comment, separator),
            false => first,
        };
        self.is_pending = is_data;
        self.columns = Some(found.len());
        Ok(found)
    }

    /// Returns the next line that is neither empty nor a comment.
    ///
    /// # Errors
    /// When the file cannot be read, or a line is longer than 1 MiB or has more fields than the header.
    pub fn next_row(&mut self) -> Result<Option<Row<'_>>, TableError> {
        if !std::mem::take(&mut self.is_pending) && !self.advance()? {
            return match self.notation.get().doubt(true) {
                Some(doubt) => Err(TableError::Notation(doubt)),
                None => Ok(None),
            };
        }
        let row = Row {
            line: self.line,
            text: &self.text,
            fields: &self.fields,
            is_open: matches!(self.separator, Separator::One(byte) if self.text.ends_with(byte as char)),
            notation: &self.notation,
        };
        match self.columns {
            Some(columns) if row.len() > columns => {
                Err(row.error(format!("the line has {} values, the header {columns}", row.len())))
            }
            _ => Ok(Some(row)),
        }
    }

    /// Reads up to the next line with values.
    fn advance(&mut self) -> Result<bool, TableError> {
        let mut bytes = Vec::new();
        loop {
            bytes.clear();
            self.line += 1;
            let read = self.input.by_ref().take(LONGEST).read_until(self.end, &mut bytes)?;
            if read as u64 == LONGEST {
                return Err(TableError::Line {
                    line: self.line,
                    why: "the line is longer than 1 MiB".to_owned(),
                });
            }
            if read == 0 {
                return Ok(false);
            }
            let text = String::from_utf8_lossy(&bytes);
            // A tab before a value separates it from an empty one.
            let text = match self.separator {
                Separator::One(b'\t') => text.trim_matches(|c: char| c.is_whitespace() && c != '\t'),
                _ => text.trim(),
            };
            if let Some(comment) = comment_of(text) {
                self.comment.clear();
                self.comment.push_str(comment);
                continue;
            }
            if !text.trim().is_empty() {
                self.text.clear();
                self.text.push_str(text);
                self.fields.clear();
                self.separator.split(&self.text, &mut self.fields);
                return Ok(true);
            }
        }
    }
}

/// Returns the text of a comment: `#` as in NumPy, `%` as in MATLAB and COMSOL.
fn comment_of(line: &str) -> Option<&str> {
    line.starts_with(['#', '%'])
        .then(|| line.trim_start_matches(['#', '%']).trim())
}

/// Returns the separator that Excel names in the first line, `sep=;`, and the length of that text.
fn of_excel(head: &[u8]) -> Option<(Separator, usize)> {
    let (name, rest) = head.split_at_checked(4)?;
    let [separator, b'\r' | b'\n', ..] = *rest else {
        return None;
    };
    name.eq_ignore_ascii_case(b"sep=")
        .then_some((Separator::One(separator), 5))
}

fn of_utf16(head: &[u8], rest: impl Read) -> IoResult<String> {
    let mut bytes = head.to_vec();
    rest.take(LARGEST_UTF16).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > LARGEST_UTF16 {
        return Err(Error::new(
            ErrorKind::FileTooLarge,
            "a text in UTF-16 can have 64 MiB; save it as UTF-8",
        ));
    }
    let is_little = head[0] == 0xff;
    let (pairs, _) = bytes[2..].as_chunks::<2>();
    let units = pairs.iter().map(|pair| match is_little {
        true => u16::from_le_bytes(*pair),
        false => u16::from_be_bytes(*pair),
    });
    let text = char::decode_utf16(units).map(|unit| unit.unwrap_or(char::REPLACEMENT_CHARACTER));
    Ok(text.collect())
}

impl Separator {
    /// Returns the separator of the lines of values at the start of a file.
    fn of(head: &str, end: u8) -> Self {
        let lines = head.split(end as char).map(str::trim);
        let lines: Vec<&str> = lines
            .filter(|line| !line.is_empty() && comment_of(line).is_none())
            .collect();
        let has = |separator: char| lines.iter().any(|line| without_quoted(line).contains(separator));
        if has(';') {
            Self::One(b';')
        } else if has('\t') {
            Self::One(b'\t')
        } else if has(',') && !lines.iter().all(|line| has_decimal_commas_only(line)) {
            Self::One(b',')
        } else {
            Self::Blanks
        }
    }

    /// Appends the places of the fields of a line. A separator at the end of a line starts no field.
    fn split(self, line: &str, fields: &mut Vec<Range<usize>>) {
        let within = |part: &str| {
            let start = part.as_ptr() as usize - line.as_ptr() as usize;
            start..start + part.len()
        };
        let Self::One(separator) = self else {
            fields.extend(line.split_whitespace().map(within));
            return;
        };
        let mut rest = line;
        loop {
            let start = rest.trim_start();
            let quoted = start.strip_prefix('"').and_then(|text| text.split_once('"'));
            let (field, after) = match quoted {
                Some((field, after)) => (field, after),
                None => rest.split_at(rest.bytes().position(|b| b == separator).unwrap_or(rest.len())),
            };
            let next = after.bytes().position(|b| b == separator);
            let field = within(field.trim());
            match next {
                Some(at) => {
                    fields.push(field);
                    rest = &after[at + 1..];
                }
                None if field.is_empty() => break,
                None => {
                    fields.push(field);
                    break;
                }
            }
        }
    }
}

/// Removes quoted parts of a line.
fn without_quoted(line: &str) -> String {
    line.split('"').step_by(2).collect()
}

/// Whether the commas of a line can only be decimal: `0,5  1,25`.
fn has_decimal_commas_only(line: &str) -> bool {
    let is_number = |word: &str| {
        let (whole, fraction) = word.split_once(',').unwrap_or((word, "0"));
        whole.ends_with(|c: char| c.is_ascii_digit())
            && fraction.starts_with(|c: char| c.is_ascii_digit())
            && with_point(word).parse::<f64>().is_ok()
    };
    !line.contains(',') || line.split_whitespace().count() > 1 && line.split_whitespace().all(is_number)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: impl AsRef<[u8]>) -> Vec<Vec<String>> {
        let mut table = Table::of_bytes(text.as_ref().to_vec()).unwrap();
        let mut rows = Vec::new();
        while let Some(row) = table.next_row().unwrap() {
            rows.push(row.fields().map(str::to_owned).collect());
        }
        rows
    }

    fn numbers(text: impl AsRef<[u8]>) -> Vec<Vec<f64>> {
        let mut table = Table::of_bytes(text.as_ref().to_vec()).unwrap();
        let mut rows = Vec::new();
        while let Some(row) = table.next_row().unwrap() {
            rows.push((0..row.len()).map(|at| row.number(at).unwrap()).collect());
        }
        rows
    }

    #[test]
    fn every_dialect_gives_the_same_numbers() {
        let utf16 = |text: &str, first: [u8; 2], bytes: fn(u16) -> [u8; 2]| {
            first
                .into_iter()
                .chain(text.encode_utf16().flat_map(bytes))
                .collect::<Vec<u8>>()
        };
        for text in [
            "0.5,1\n-2,3e2\n",
            "0.5, 1\n-2, 3e2",
            "0.5;1\r\n-2;3e2\r\n",
            "0,5;1\n-2;3e2\n",
            "\"0,5\",1\n-2,\"3e2\"\n",
            "0.5\t1\n-2\t3e2\n",
            "0,5\t1\n-2\t3e2\n",
            "0.5 1\n-2 3e2\n",
            "   0.5    1\n  -2    300  \n",
            "0,5   1\n-2,0  300\n",
            "0.5,1,\n-2,3e2,\n",
            "0.5;1;\n-2;300;\n",
            "# a comment, with commas; and semicolons\n0.5 1\n\n% another\n-2 300\n",
            "\u{feff}0.5,1\n-2,3e2\n",
            "0.5,1\r-2,300\r",
            "5.000000000000000000e-01 1.000000000000000000e+00\n-2.000000000000000000e+00 3.000000000000000000e+02\n",
        ] {
            assert_eq!(numbers(text), [[0.5, 1.0], [-2.0, 300.0]], "{text:?}");
        }
        let text = "0,5\t1\r\n-2\t300\r\n";
        for text in [
            utf16(text, [0xff, 0xfe], u16::to_le_bytes),
            utf16(text, [0xfe, 0xff], u16::to_be_bytes),
        ] {
            assert_eq!(numbers(text), [[0.5, 1.0], [-2.0, 300.0]]);
        }
        // Latin-1 in a text does not matter for the numbers beside it.
        assert_eq!(numbers(b"# \xb5m\n1,2\n"), [[1.0, 2.0]]);
    }

    #[test]
    fn fields_are_trimmed_and_empty_ones_stay_in_their_place() {
        assert_eq!(rows("a,,b\n,c\n"), [vec!["a", "", "b"], vec!["", "c"]]);
        assert_eq!(rows("\"a, b\" , c\n"), [["a, b", "c"]]);
        assert_eq!(rows("\"open, c\n"), [["\"open,", "c"]]);
        assert!(rows("").is_empty() && rows("\n\n# only\n").is_empty());
    }

    #[test]
    fn commas_that_may_separate_thousands_are_refused() {
        let read = |text: &str| -> Result<Vec<f64>, String> {
            let mut table = Table::of_bytes(text.into()).unwrap();
            let mut numbers = Vec::new();
            loop {
                match table.next_row() {
                    Ok(Some(row)) => {
                        for at in 0..row.len() {
                            numbers.push(row.number(at).map_err(|error| error.to_string())?);
                        }
                    }
                    Ok(None) => return Ok(numbers),
                    Err(error) => return Err(error.to_string()),
                }
            }
        };
        for text in [
            "0.2;1,001\n1.0;5,005\n",
            "0.5,\"2,500\"\n",
            "0,5;2.500\n1,0;5.005\n",
            "0;0\n1;1,001\n",
            "0;-12,345\n",
        ] {
            let refused = read(text).unwrap_err();
            assert!(
                refused.contains("without separators of thousands"),
                "{text:?}: {refused}"
            );
        }
        assert_eq!(
            read("0.5;1\n0;1,001\n").unwrap_err(),
            "line 2: the numbers have points and commas, so one of them separates thousands: \"1,001\"; write numbers \
             without separators of thousands"
        );
        for (text, numbers) in [
            ("0,5;1,001\n", [0.5, 1.001]),
            ("0,001;2\n", [0.001, 2.0]),
            ("1234,567;1,5\n", [1234.567, 1.5]),
            ("1;1,0010\n", [1.0, 1.001]),
            ("1.500;2.250\n", [1.5, 2.25]),
        ] {
            assert_eq!(read(text).unwrap(), numbers, "{text:?}");
        }
    }

    #[test]
    fn spreadsheets_may_name_the_separator_and_write_truth_values() {
        for text in ["sep=;\r\n1;0,5\r\nTRUE;false\r\n", "SEP=,\n1,0.5\ntrue,FALSE\n"] {
            assert_eq!(numbers(text), [[1.0, 0.5], [1.0, 0.0]], "{text:?}");
        }
        let mut table = Table::of_bytes("sep=;\na;b\n1;x\n".into()).unwrap();
        table.next_row().unwrap();
        let row = table.next_row().unwrap().unwrap();
        assert_eq!(
            row.number(1).unwrap_err().to_string(),
            "line 3: value 2: \"x\" is not a number"
        );
    }

    #[test]
    fn empty_fields_are_named() {
        for separator in [",", ";", "\t"] {
            for (line, empty) in [
                ("1,2,3", None),
                (",2,3", Some(1)),
                ("1,,3", Some(2)),
                ("1,2,", Some(3)),
                ("1,,", Some(2)),
                (",,3", Some(1)),
            ] {
                let text = format!("4,5,6\n{line}\n").replace(',', separator);
                let mut table = Table::of_bytes(text.clone().into()).unwrap();
                table.next_row().unwrap();
                let row = table.next_row().unwrap().unwrap();
                assert_eq!(row.empty(3), empty, "{text:?}");
                let Some(at) = empty else { continue };
                let error = row.number(at - 1).unwrap_err().to_string();
                assert_eq!(error, format!("line 2: value {at} is empty"), "{text:?}");
            }
        }
        // A separator at the end of each line stands before nothing.
        let mut table = Table::of_bytes("1,2,\n".into()).unwrap();
        assert_eq!(table.next_row().unwrap().unwrap().empty(2), None);
    }

    #[test]
    fn columns_are_found_by_name() {
        for text in [
            "t_s,voltage_V\n1,2\n",
            "Voltage_V;note;T_S\n2;x;1\n",
            "# t_s voltage_V\n1 2\n",
            "% measured\n% t_s  voltage_V\n1  2\n",
        ] {
            let mut table = Table::of_bytes(text.into()).unwrap();
            let [time, voltage] = table.columns(["t_s", "voltage_V"]).unwrap();
            let row = table.next_row().unwrap().unwrap();
            let read = (row.number(time).unwrap(), row.number(voltage).unwrap());
            assert_eq!(read, (1.0, 2.0), "{text:?}");
            assert!(table.next_row().unwrap().is_none(), "{text:?}");
        }
    }

    #[test]
    fn errors_name_line_and_column() {
        let columns = |text: &str| {
            let mut table = Table::of_bytes(text.into()).unwrap();
            table.columns(["t_s", "voltage_V"]).unwrap_err().to_string()
        };
        assert_eq!(
            columns("t_s,U\n1,2\n"),
            "the column voltage_V is missing; the columns are t_s, U"
        );
        assert_eq!(columns("1,2\n"), "the column t_s is missing; the columns are 1, 2");
        assert_eq!(columns(""), "the column t_s is missing; the columns are nothing");
        assert_eq!(
            columns("t_s,voltage_V,Voltage_v\n1,2,3\n"),
            "the file has two columns voltage_V"
        );
        let mut table = Table::of_bytes("# t\na,b\n1,2,3\n".into()).unwrap();
        table.columns(["a", "b"]).unwrap();
        let Err(error) = table.next_row() else {
            panic!("three values")
        };
        assert_eq!(error.to_string(), "line 3: the line has 3 values, the header 2");
        let mut table = Table::of_bytes("1,2\n1;2.000,5\n".into()).unwrap();
        table.next_row().unwrap();
        let row = table.next_row().unwrap().unwrap();
        assert_eq!(
            row.number(1).unwrap_err().to_string(),
            "line 2: the numbers have points and commas, so one of them separates thousands: \"2.000,5\"; write numbers \
             without separators of thousands"
        );
        let mut table = Table::of_bytes(vec![b'1'; 1 << 21]).unwrap();
        let Err(error) = table.next_row() else {
            panic!("a long line")
        };
        assert_eq!(error.to_string(), "line 1: the line is longer than 1 MiB");
    }
}
