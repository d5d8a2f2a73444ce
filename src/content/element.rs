//! What an array may hold: numbers, texts, patterns and fields, row by row or packed into one list of numbers.

use super::error::ElementError;
use crate::field::{CORNERS, Field};
use crate::pattern::{CELLS, Pattern, Role};
use crate::store::{Artifact, Data, ElementType, StoreError};

/// A number or text as it stands in a file.
pub trait Value: Sized {
    /// Its type in the file.
    const TYPE: ElementType;

    /// Values as the store takes them.
    fn into_data(values: Vec<Self>) -> Data;

    /// All values of a dataset.
    ///
    /// # Errors
    /// When the artifact has no such dataset, or one of another type.
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

/// One row of an array: a single value, or several that belong together.
pub trait Row {
    /// The type of its values.
    type Value: Value;
    /// Extents of its own axes, slowest first; none for a single value.
    const EXTENTS: &'static [usize];
}

/// A row that can be told from its values.
pub trait Element: Row + Sized {
    /// The values of all rows, end to end.
    fn pack(rows: Vec<Self>) -> Vec<Self::Value>;

    /// The rows of whole values.
    ///
    /// # Errors
    /// When they do not stand for such a row.
    fn unpack(values: Vec<Self::Value>) -> Result<Vec<Self>, ElementError>;
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

            fn unpack(values: Vec<Self>) -> Result<Vec<Self>, ElementError> {
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

    fn unpack(values: Vec<V>) -> Result<Vec<Self>, ElementError> {
        let (rows, _) = values.as_chunks::<N>();
        Ok(rows.to_vec())
    }
}

impl Row for Pattern {
    type Value = u8;
    const EXTENTS: &'static [usize] = &[CELLS, CELLS];
}

impl Element for Pattern {
    fn pack(rows: Vec<Self>) -> Vec<u8> {
        rows.iter().flat_map(|pattern| pattern.cells()).copied().collect()
    }

    fn unpack(values: Vec<u8>) -> Result<Vec<Self>, ElementError> {
        let rows = values.chunks_exact(CELLS * CELLS);
        Ok(rows.map(Self::from_cells).collect::<Result<_, _>>()?)
    }
}

impl Row for Field {
    type Value = f64;
    const EXTENTS: &'static [usize] = &[CORNERS, CORNERS, 2];
}

impl Element for Field {
    fn pack(rows: Vec<Self>) -> Vec<f64> {
        rows.iter().flat_map(|field| field.values()).copied().collect()
    }

    fn unpack(values: Vec<f64>) -> Result<Vec<Self>, ElementError> {
        let rows = values.chunks_exact(CORNERS * CORNERS * 2);
        Ok(rows
            .map(|row| Self::from_values(row.to_vec()))
            .collect::<Result<_, _>>()?)
    }
}

impl Row for Role {
    type Value = String;
    const EXTENTS: &'static [usize] = &[];
}

impl Element for Role {
    fn pack(rows: Vec<Self>) -> Vec<String> {
        rows.iter().map(|role| role.name().to_owned()).collect()
    }

    fn unpack(values: Vec<String>) -> Result<Vec<Self>, ElementError> {
        let role = |word: String| Self::from_name(&word).ok_or(ElementError::Word(word));
        values.into_iter().map(role).collect()
    }
}

/// Rows whose values stay in one list: those of many fields are not copied, and may be NaN in files that allow it.
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

/// A value for each unit of a genome, `[y][x]`, `N` along a side.
#[derive(Clone, Debug, PartialEq)]
pub struct PerUnit<const N: usize>;

impl<const N: usize> Row for PerUnit<N> {
    type Value = u8;
    const EXTENTS: &'static [usize] = &[N, N];
}

/// A field in single precision.
#[derive(Clone, Debug, PartialEq)]
pub struct SingleField;

macro_rules! rows {
    ($($type:ty, $value:ty, $extents:expr;)*) => {$(
        impl Row for $type {
            type Value = $value;
            const EXTENTS: &'static [usize] = &$extents;
        }
    )*};
}

rows! {
    PerCell<u8>, u8, [CELLS, CELLS];
    PerCell<f64>, f64, [CELLS, CELLS];
    PerCell<[f64; 2]>, f64, [CELLS, CELLS, 2];
    PerCell<[[f64; 2]; 2]>, f64, [CELLS, CELLS, 2, 2];
    SingleField, f32, [CORNERS, CORNERS, 2];
}
