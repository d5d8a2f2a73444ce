//! The elements of arrays: numbers, texts, patterns and fields, by row or packed into one list of numbers.

use super::error::ElementError;
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::{Pattern, PatternForm, Raster, Role};
use deaflow_store::{Artifact, Data, ElementType, StoreError};

/// A number or text in a file.
pub trait Value: Sized {
    /// Its type in the file.
    const TYPE: ElementType;

    /// Converts values for the store.
    fn into_data(values: Vec<Self>) -> Data;

    /// Reads all values of a dataset.
    ///
    /// # Errors
    /// If the artifact has no such dataset, or one of another type.
    fn read(artifact: &Artifact, path: &str) -> Result<Vec<Self>, StoreError>;
}

macro_rules! value {
    ($($type:ty, $variant:ident, $getter:ident;)*) => {$(
        impl Value for $type {
            const TYPE: ElementType = ElementType::$variant;

            fn into_data(values: Vec<Self>) -> Data {
                Data::$variant(values)
            }

            fn read(artifact: &Artifact, path: &str) -> Result<Vec<Self>, StoreError> {
                Ok(artifact.$getter(path)?.1)
            }
        }
    )*};
}

value! {
    u8, U8, u8s;
    u32, U32, u32s;
    u64, U64, u64s;
    f32, F32, f32s;
    f64, F64, f64s;
    String, Text, texts;
}

/// The axes whose lengths are the numbers of cells or of cell corners of a membrane.
pub const RASTER_AXES: [[&str; 2]; 2] = [["y", "x"], ["corner_y", "corner_x"]];

/// The grid of the values of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grid {
    /// None: the row is one value or a few.
    None,
    /// The cells of a membrane.
    Cells,
    /// The corners of cells.
    Corners,
}

impl Grid {
    /// Returns the raster of an array with these numbers of rows and columns.
    #[must_use]
    pub fn raster(self, [rows, columns]: [usize; 2]) -> Option<Raster> {
        match self {
            Self::None => None,
            Self::Cells => Raster::new(columns, rows),
            Self::Corners => Raster::new(columns.checked_sub(1)?, rows.checked_sub(1)?),
        }
    }
}

/// One row of an array: a single value, or several that belong together.
pub trait Row {
    /// The type of its values.
    type Value: Value;
    /// The grid of its first axes.
    const GRID: Grid = Grid::None;
    /// Lengths of its last axes, slowest first, the same in every artifact; none for a single value.
    const EXTENTS: &'static [usize];
}

/// A row that can be made from its values.
pub trait Element: Row + Sized {
    /// Concatenates the values of all rows.
    fn pack(rows: Vec<Self>) -> Vec<Self::Value>;

    /// Returns the raster of the rows, if they have one.
    #[must_use]
    fn raster(_rows: &[Self]) -> Option<Raster> {
        None
    }

    /// Makes rows from values, on a raster if they have one.
    ///
    /// # Errors
    /// If the values are invalid.
    fn unpack(values: Vec<Self::Value>, raster: Raster) -> Result<Vec<Self>, ElementError>;
}

macro_rules! single {
    ($($type:ty),*) => {$(
        impl Row for $type {
            type Value = Self;
            const EXTENTS: &'static [usize] = &[];
        }

        impl Element for $type {
            fn pack(rows: Vec<Self>) -> Vec<Self> {
                rows
            }

            fn unpack(values: Vec<Self>, _: Raster) -> Result<Vec<Self>, ElementError> {
                Ok(values)
            }
        }
    )*};
}

single!(u8, u32, u64, f64, String);

impl<V: Value + Copy, const N: usize> Row for [V; N] {
    type Value = V;
    const EXTENTS: &'static [usize] = &[N];
}

impl<V: Value + Copy, const N: usize> Element for [V; N] {
    fn pack(rows: Vec<Self>) -> Vec<V> {
        rows.into_flattened()
    }

    fn unpack(values: Vec<V>, _: Raster) -> Result<Vec<Self>, ElementError> {
        let (rows, _) = values.as_chunks::<N>();
        Ok(rows.to_vec())
    }
}

impl Row for Pattern {
    type Value = u8;
    const GRID: Grid = Grid::Cells;
    const EXTENTS: &'static [usize] = &[];
}

impl Element for Pattern {
    fn pack(rows: Vec<Self>) -> Vec<u8> {
        rows.iter().flat_map(|pattern| pattern.cells()).copied().collect()
    }

    fn raster(rows: &[Self]) -> Option<Raster> {
        rows.first().map(Self::raster)
    }

    fn unpack(values: Vec<u8>, raster: Raster) -> Result<Vec<Self>, ElementError> {
        let rows = values.chunks_exact(raster.cells());
        let groups = Self::MOST_GROUPS;
        let pattern = |cells| Self::of_form(PatternForm::of_square_cells(raster, groups), cells);
        Ok(rows.map(pattern).collect::<Result<_, _>>()?)
    }
}

impl Row for Field {
    type Value = f64;
    const GRID: Grid = Grid::Corners;
    const EXTENTS: &'static [usize] = &[2];
}

impl Element for Field {
    fn pack(rows: Vec<Self>) -> Vec<f64> {
        rows.iter().flat_map(|field| field.values()).copied().collect()
    }

    fn raster(rows: &[Self]) -> Option<Raster> {
        rows.first().map(Self::raster)
    }

    fn unpack(values: Vec<f64>, raster: Raster) -> Result<Vec<Self>, ElementError> {
        let rows = values.chunks_exact(2 * raster.corners());
        Ok(rows
            .map(|row| Self::from_values(raster, row.to_vec()))
            .collect::<Result<_, _>>()?)
    }
}

/// Enums that are stored as words.
macro_rules! words {
    ($($type:ty),*) => {$(
        impl Row for $type {
            type Value = String;
            const EXTENTS: &'static [usize] = &[];
        }

        impl Element for $type {
            fn pack(rows: Vec<Self>) -> Vec<String> {
                rows.iter().map(|row| row.name().to_owned()).collect()
            }

            fn unpack(values: Vec<String>, _: Raster) -> Result<Vec<Self>, ElementError> {
                let row = |word: String| Self::from_name(&word).ok_or(ElementError::Word(word));
                values.into_iter().map(row).collect()
            }
        }
    )*};
}

words!(Role, OutcomeKind);

/// Rows whose values stay in one list: many fields are not copied, and may be NaN in files that allow it.
#[derive(Clone, Debug, PartialEq)]
pub struct Packed<R: Row>(pub Vec<R::Value>);

impl<R: Row> Default for Packed<R> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

/// A value for each cell of the membrane, `[y][x]`.
#[derive(Clone, Debug, PartialEq)]
pub struct PerCell<T>(std::marker::PhantomData<T>);

/// A value for each corner of cells, `[y][x]`.
#[derive(Clone, Debug, PartialEq)]
pub struct PerCorner<T>(std::marker::PhantomData<T>);

/// A value for each rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct PerBody<T>(std::marker::PhantomData<T>);

/// A value for each unit of a genome, `[y][x]`, `N` along a side.
#[derive(Clone, Debug, PartialEq)]
pub struct PerUnit<const N: usize>;

impl<const N: usize> Row for PerUnit<N> {
    type Value = u8;
    const EXTENTS: &'static [usize] = &[N, N];
}

/// A field in single precision.
#[derive(Clone, Debug, PartialEq)]
pub struct SingleField {
    /// The raster on whose corners it is defined.
    pub raster: Raster,
    /// Its values, two per corner.
    pub values: Vec<f32>,
}

impl Element for SingleField {
    fn pack(rows: Vec<Self>) -> Vec<f32> {
        rows.into_iter().flat_map(|field| field.values).collect()
    }

    fn raster(rows: &[Self]) -> Option<Raster> {
        rows.first().map(|field| field.raster)
    }

    fn unpack(values: Vec<f32>, raster: Raster) -> Result<Vec<Self>, ElementError> {
        let rows = values.chunks_exact(2 * raster.corners());
        let field = |values: &[f32]| Self {
            raster,
            values: values.to_vec(),
        };
        Ok(rows.map(field).collect())
    }
}

macro_rules! rows {
    ($($type:ty, $value:ty, $grid:ident, $extents:expr;)*) => {$(
        impl Row for $type {
            type Value = $value;
            const GRID: Grid = Grid::$grid;
            const EXTENTS: &'static [usize] = &$extents;
        }
    )*};
}

rows! {
    PerCell<u8>, u8, Cells, [];
    PerCell<f64>, f64, Cells, [];
    PerCell<[f64; 2]>, f64, Cells, [2];
    PerCell<[[f64; 2]; 2]>, f64, Cells, [2, 2];
    PerCorner<f64>, f64, Corners, [];
    PerCorner<[f64; 3]>, f64, Corners, [3];
    PerBody<f64>, f64, None, [];
    PerBody<[f64; 2]>, f64, None, [2];
    PerBody<[f64; 3]>, f64, None, [3];
    SingleField, f32, Corners, [2];
}
