//! Writes meshes for VTK and ParaView as VTKHDF (Kitware, VTKHDF format specification, 2.0).

use std::collections::BTreeMap;
use std::path::Path;

use hdf5::types::FixedAscii;
use hdf5::{Group, H5Type};

use super::error::StoreError;
use super::object::Dataset;
use super::{create, plain, texts, write};

/// VTK's number for a quadrilateral with four corners.
const QUADRILATERAL: u8 = 9;

/// A surface of quadrilaterals with values at points and on cells.
#[derive(Clone, Debug, Default)]
pub struct Grid {
    /// Positions.
    pub points: Vec<[f64; 3]>,
    /// The points of each cell, in order around it.
    pub quadrilaterals: Vec<[i64; 4]>,
    /// Values at points, by name; the first dimension is that of the points.
    pub point_data: Vec<(&'static str, Dataset)>,
    /// Values on cells, by name; the first dimension is that of the cells.
    pub cell_data: Vec<(&'static str, Dataset)>,
    /// Attributes of the file.
    pub attributes: BTreeMap<String, String>,
}

/// Writes a grid to `path` atomically, replacing an existing file.
///
/// # Errors
/// If the folder does not exist or is not writable, or the library reports an error (disk full).
pub fn write_grid(path: &Path, grid: &Grid) -> Result<(), StoreError> {
    plain::place(path, |file| {
        write_to(file, grid).map_err(StoreError::hdf5("write", path))
    })
}

fn write_to(path: &Path, grid: &Grid) -> hdf5::Result<()> {
    let file = create::new_file().create(path)?;
    texts::attributes(
        &file,
        grid.attributes
            .iter()
            .map(|(name, value)| (name.as_str(), value.as_str())),
    )?;
    let root = file.create_group("VTKHDF")?;
    root.new_attr::<i64>()
        .shape(2)
        .create("Version")?
        .write_raw(&[2_i64, 0])?;
    // VTK accepts only a text of fixed length here.
    let kind = FixedAscii::<16>::from_ascii("UnstructuredGrid").map_err(|e| hdf5::Error::from(e.to_string()))?;
    root.new_attr::<FixedAscii<16>>().create("Type")?.write_scalar(&kind)?;
    let (points, cells) = (grid.points.len() as i64, grid.quadrilaterals.len() as i64);
    // As in `write`: all stay open until the file has been flushed, so that a full disk is reported.
    let mut open = vec![
        numbers(&root, "NumberOfPoints", &[1], &[points])?,
        numbers(&root, "NumberOfCells", &[1], &[cells])?,
        numbers(&root, "NumberOfConnectivityIds", &[1], &[4 * cells])?,
        numbers(&root, "Points", &[grid.points.len(), 3], grid.points.as_flattened())?,
        numbers(
            &root,
            "Connectivity",
            &[4 * grid.quadrilaterals.len()],
            grid.quadrilaterals.as_flattened(),
        )?,
        numbers(
            &root,
            "Offsets",
            &[grid.quadrilaterals.len() + 1],
            &(0..=cells).map(|cell| 4 * cell).collect::<Vec<_>>(),
        )?,
        numbers(
            &root,
            "Types",
            &[grid.quadrilaterals.len()],
            &vec![QUADRILATERAL; grid.quadrilaterals.len()],
        )?,
    ];
    for (name, datasets) in [("PointData", &grid.point_data), ("CellData", &grid.cell_data)] {
        let group = root.create_group(name)?;
        for (name, dataset) in datasets {
            open.push(write::write_dataset(&group, name, dataset)?);
        }
    }
    drop(root);
    file.flush()?;
    drop(open);
    file.close()
}

fn numbers<T: H5Type>(group: &Group, name: &str, shape: &[usize], values: &[T]) -> hdf5::Result<hdf5::Dataset> {
    let written = group.new_dataset::<T>().shape(shape).create(name)?;
    if !values.is_empty() {
        written.write_raw(values)?;
    }
    Ok(written)
}
