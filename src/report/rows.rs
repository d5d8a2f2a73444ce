//! The rows of an artifact as a table: a row for each sample, design or epoch, and a column for each array with one
//! value or a few values for each of them.

use std::collections::BTreeMap;

use deaflow_store::{Artifact, Content, Data, ElementType, StoreError};

/// Arrays with more values for each row than this are left out.
const MOST_COLUMNS: usize = 16;

/// There is no table.
#[derive(Debug, thiserror::Error)]
pub enum RowsError {
    /// The source cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// There are no such rows.
    #[error("{message}")]
    None {
        /// What is missing.
        message: String,
        /// What is allowed.
        help: String,
    },
}

/// A source of rows.
pub trait RowSource {
    /// Returns its name in messages.
    fn title(&self) -> String;

    /// Lists its arrays, without their elements.
    ///
    /// # Errors
    /// If they cannot be read.
    fn contents(&self) -> Result<Vec<Content>, RowsError>;

    /// Reads the elements of an array.
    ///
    /// # Errors
    /// If they cannot be read.
    fn elements(&self, path: &str) -> Result<Data, RowsError>;

    /// Reads texts of any length.
    ///
    /// # Errors
    /// If they cannot be read.
    fn long_texts(&self, path: &str) -> Result<Vec<String>, RowsError>;
}

impl RowSource for Artifact {
    fn title(&self) -> String {
        format!("artifact {}", self.digest().short())
    }

    fn contents(&self) -> Result<Vec<Content>, RowsError> {
        Ok(self.contents()?.to_vec())
    }

    fn elements(&self, path: &str) -> Result<Data, RowsError> {
        Ok(self.read(path)?.data)
    }

    fn long_texts(&self, path: &str) -> Result<Vec<String>, RowsError> {
        Ok(self.long_texts(path)?)
    }
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct RowColumn {
    /// Its name, with the unit: `max_displacement_mm`.
    pub name: String,
    /// Its description.
    pub description: String,
    /// Its values, one for each row.
    pub values: Data,
}

/// A table.
pub struct Rows {
    /// The axis of the rows.
    pub axis: String,
    /// One column for each single value that a row has.
    pub columns: Vec<RowColumn>,
    /// Arrays that are left out, with their shapes.
    pub left_out: Vec<String>,
}

impl Rows {
    /// Reads the rows along an axis; by default along the axis of most one-dimensional arrays.
    ///
    /// # Errors
    /// If no array has the axis, or one cannot be read.
    pub fn of(source: &dyn RowSource, along: Option<&str>) -> Result<Self, RowsError> {
        let contents = &source.contents()?;
        let axis = match along {
            Some(axis) => axis.to_owned(),
            None => main_axis(contents).unwrap_or_default(),
        };
        let length = contents.iter().find(|array| first_axis(array) == Some(&axis));
        let length = length
            .map(|array| array.shape[0])
            .ok_or_else(|| no_axis(source, contents, along))?;
        let mut rows = Self {
            axis,
            columns: Vec::new(),
            left_out: Vec::new(),
        };
        for array in contents {
            match text_of(contents, array) {
                Some(_) if array.path.ends_with("/text") => {}
                Some(path) if rows.has(array, length) => {
                    rows.push(path.to_owned(), array, Data::Text(source.long_texts(path)?));
                }
                _ => rows.add(source, array, length)?,
            }
        }
        rows.add_coordinates(source, contents, length)?;
        Ok(rows)
    }

    /// Adds the coordinates of the other axes of the columns, such as the times of a history: the same in each row.
    fn add_coordinates(
        &mut self,
        source: &dyn RowSource,
        contents: &[Content],
        length: usize,
    ) -> Result<(), RowsError> {
        let is_column = |array: &&Content| {
            let width: usize = array.shape.iter().skip(1).product();
            self.has(array, length) && width <= MOST_COLUMNS
        };
        let axes = contents
            .iter()
            .filter(is_column)
            .flat_map(|array| array.axes.iter().skip(1));
        let axes: Vec<&String> = axes.collect();
        let is_along = |array: &&Content| {
            let is_row = first_axis(array) == Some(&self.axis);
            array.shape.len() == 1 && !is_row && first_axis(array).is_some_and(|axis| axes.contains(&axis))
        };
        let along: Vec<&Content> = contents.iter().filter(is_along).collect();
        for array in along {
            let elements = source.elements(&array.path)?;
            // As if each row had all of them.
            let shape = vec![length, array.shape[0]];
            let axes = [&[self.axis.clone()][..], &array.axes].concat();
            let each = Content {
                shape,
                axes,
                ..array.clone()
            };
            for (at, name) in names(&each).into_iter().enumerate() {
                let one = pick(&elements, std::iter::repeat_n(at, length));
                self.push(name, array, one);
            }
            let title = format!("{} (", array.path);
            self.left_out.retain(|left_out| !left_out.starts_with(&title));
        }
        Ok(())
    }

    /// Returns the number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.columns.first().map_or(0, |column| column.values.len())
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the names of the columns.
    #[must_use]
    pub fn header(&self) -> Vec<String> {
        self.columns.iter().map(|column| column.name.clone()).collect()
    }

    /// Returns the rows as texts; numbers have all significant digits.
    pub fn texts(&self) -> impl Iterator<Item = Vec<String>> {
        let columns: Vec<Vec<String>> = self.columns.iter().map(|column| cells(&column.values)).collect();
        (0..self.len()).map(move |at| columns.iter().map(|column| column[at].clone()).collect())
    }

    /// Whether an array has a value for each row: its axis is that of the rows, or a part of it with the same length.
    fn has(&self, array: &Content, length: usize) -> bool {
        let is_same = |axis: &String| *axis == self.axis || axis.ends_with(&format!("_{}", self.axis));
        array.shape.first() == Some(&length) && first_axis(array).is_some_and(is_same)
    }

    fn add(&mut self, source: &dyn RowSource, array: &Content, length: usize) -> Result<(), RowsError> {
        let width: usize = array.shape.iter().skip(1).product();
        if !self.has(array, length) || width > MOST_COLUMNS {
            let shape: Vec<String> = array.shape.iter().map(ToString::to_string).collect();
            self.left_out.push(format!("{} ({})", array.path, shape.join(" × ")));
            return Ok(());
        }
        let elements = source.elements(&array.path)?;
        for (at, name) in names(array).into_iter().enumerate() {
            let column = (at..elements.len()).step_by(width.max(1));
            self.push(name, array, pick(&elements, column));
        }
        Ok(())
    }

    fn push(&mut self, name: String, array: &Content, values: Data) {
        self.columns.push(RowColumn {
            name,
            description: array.description.clone(),
            values,
        });
    }
}

fn first_axis(array: &Content) -> Option<&String> {
    array.axes.first()
}

/// Returns the axis of most one-dimensional arrays; of several, the first. If there is only one such array, as with a
/// device in several states, two-dimensional arrays that fit into columns count as well.
fn main_axis(contents: &[Content]) -> Option<String> {
    let most = |counted: &dyn Fn(&Content) -> bool| {
        let mut counts: BTreeMap<&String, (usize, usize)> = BTreeMap::new();
        for (at, array) in contents.iter().enumerate().filter(|(_, array)| counted(array)) {
            let Some(axis) = first_axis(array) else { continue };
            counts.entry(axis).or_insert((0, usize::MAX - at)).0 += 1;
        }
        counts.into_iter().max_by_key(|(_, count)| *count)
    };
    let of_lists = most(&|array| array.shape.len() == 1);
    let found = match of_lists {
        Some((_, (1, _))) => {
            most(&|array| array.shape.len() <= 2 && array.shape.iter().skip(1).all(|n| *n <= MOST_COLUMNS))
        }
        other => other,
    };
    found.map(|(axis, _)| axis.clone())
}

fn no_axis(source: &dyn RowSource, contents: &[Content], along: Option<&str>) -> RowsError {
    let title = source.title();
    let mut known: Vec<&str> = contents.iter().filter_map(first_axis).map(String::as_str).collect();
    known.sort_unstable();
    known.dedup();
    match along {
        Some(axis) => RowsError::None {
            message: format!("no array of {title} has the axis {axis:?}"),
            help: format!("allowed axes: {}", known.join(", ")),
        },
        None => RowsError::None {
            message: format!("{title} has no rows: its axes have no names"),
            help: "an older version built it; `deaflow run` with a new store builds it again".to_owned(),
        },
    }
}

/// Returns the path of texts of any length, if an array is one of their two parts, bytes and lengths.
fn text_of<'a>(contents: &[Content], array: &'a Content) -> Option<&'a str> {
    let (path, name) = array.path.rsplit_once('/')?;
    let has = |name: &str, kind: ElementType| {
        let path = format!("{path}/{name}");
        contents.iter().any(|other| other.path == path && other.kind == kind)
    };
    let is_half = ["text", "length"].contains(&name);
    (is_half && has("text", ElementType::U8) && has("length", ElementType::U64)).then_some(path)
}

/// Returns the names of the columns of an array, with its unit: `name_mm`, `name.x_mm`, `name.0`.
fn names(array: &Content) -> Vec<String> {
    let unit = match array.units.as_str() {
        "" | "1" => String::new(),
        unit => format!("_{unit}"),
    };
    let mut names = vec![array.path.clone()];
    for (axis, &extent) in array.shape.iter().enumerate().skip(1) {
        let letters = array.axes.get(axis).filter(|name| **name == "xy" && extent == 2);
        let step = |at: usize| letters.map_or_else(|| at.to_string(), |_| ["x", "y"][at].to_owned());
        let each = |name: &String| (0..extent).map(|at| format!("{name}.{}", step(at))).collect::<Vec<_>>();
        names = names.iter().flat_map(each).collect();
    }
    names.into_iter().map(|name| name + &unit).collect()
}

/// Returns some elements of an array, by their positions.
#[must_use]
pub fn pick(data: &Data, elements: impl Iterator<Item = usize>) -> Data {
    fn each<T: Clone>(values: &[T], elements: impl Iterator<Item = usize>) -> Vec<T> {
        elements.map(|at| values[at].clone()).collect()
    }
    match data {
        Data::U8(v) => Data::U8(each(v, elements)),
        Data::U32(v) => Data::U32(each(v, elements)),
        Data::U64(v) => Data::U64(each(v, elements)),
        Data::F32(v) => Data::F32(each(v, elements)),
        Data::F64(v) => Data::F64(each(v, elements)),
        Data::Text(v) => Data::Text(each(v, elements)),
    }
}

/// Returns elements as texts; numbers have all significant digits.
fn cells(data: &Data) -> Vec<String> {
    fn each<T: std::fmt::Debug>(values: &[T]) -> Vec<String> {
        values.iter().map(|value| format!("{value:?}")).collect()
    }
    match data {
        Data::U8(v) => each(v),
        Data::U32(v) => each(v),
        Data::U64(v) => each(v),
        Data::F32(v) => each(v),
        Data::F64(v) => each(v),
        Data::Text(v) => v.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn array(path: &str, units: &str, shape: &[usize], axes: &[&str]) -> Content {
        Content {
            path: path.to_owned(),
            kind: ElementType::F64,
            shape: shape.to_vec(),
            units: units.to_owned(),
            description: String::new(),
            axes: axes.iter().map(|&axis| axis.to_owned()).collect(),
        }
    }

    #[test]
    fn columns_are_named_with_their_units() {
        assert_eq!(names(&array("a", "1", &[3], &["row"])), ["a"]);
        assert_eq!(names(&array("u", "mm", &[3, 2], &["row", "xy"])), ["u.x_mm", "u.y_mm"]);
        let bounds = array("v", "V", &[3, 2, 2], &["row", "bound", "xy"]);
        assert_eq!(names(&bounds), ["v.0.x_V", "v.0.y_V", "v.1.x_V", "v.1.y_V"]);
        assert_eq!(names(&array("none", "", &[3, 0], &["row", "x"])), [""; 0]);
    }

    #[test]
    fn numbers_have_their_significant_digits() {
        assert_eq!(cells(&Data::F64(vec![0.1, 2.0, 1.5e-9])), ["0.1", "2.0", "1.5e-9"]);
        assert_eq!(cells(&Data::U64(vec![3])), ["3"]);
    }

    #[test]
    fn the_main_axis_is_that_of_most_arrays() {
        let contents = [
            array("a", "", &[2], &["epoch"]),
            array("b", "", &[3], &["row"]),
            array("c", "", &[3], &["row"]),
            array("d", "", &[2, 9], &["epoch", "x"]),
            array("e", "", &[2, 9], &["epoch", "x"]),
        ];
        assert_eq!(main_axis(&contents).unwrap(), "row");
        assert_eq!(main_axis(&contents[..2]).unwrap(), "epoch");
        assert_eq!(main_axis(&contents[3..]), None);
    }
}
