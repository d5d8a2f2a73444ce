//! The formats of array files, by the extension of their names.

use std::path::Path;

/// A format of array files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// One NumPy array.
    Npy,
    /// A NumPy archive of named arrays.
    Npz,
    /// HDF5 with named datasets; netCDF-4 and MATLAB 7.3 are HDF5.
    Hdf5,
}

/// The formats by their extensions.
const EXTENSIONS: [(&str, Format); 8] = [
    ("npy", Format::Npy),
    ("npz", Format::Npz),
    ("h5", Format::Hdf5),
    ("hdf5", Format::Hdf5),
    ("hdf", Format::Hdf5),
    ("nc", Format::Hdf5),
    ("nc4", Format::Hdf5),
    ("mat", Format::Hdf5),
];

impl Format {
    /// Returns the format of a file by its extension, in upper or lower case; `None` if it is not an array file.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        let found = EXTENSIONS.iter().find(|(known, _)| *known == extension);
        found.map(|(_, format)| *format)
    }

    /// Whether arrays have names.
    #[must_use]
    pub fn has_names(self) -> bool {
        self != Self::Npy
    }
}

/// Splits `FILE.h5:/dataset`, also of other formats with names. Both parts may contain colons, so the split is after
/// the extension of the file.
#[must_use]
pub fn split(spec: &str) -> Option<(&str, &str)> {
    let lower = spec.to_ascii_lowercase();
    let after = |extension: &str| {
        let end = format!(".{extension}:/");
        lower.rfind(&end).map(|at| at + end.len() - ":/".len())
    };
    let named = EXTENSIONS.iter().filter(|(_, format)| format.has_names());
    let colon = named.filter_map(|(extension, _)| after(extension)).max()?;
    Some((&spec[..colon], &spec[colon + 1..]))
}

/// Returns the extension of a file in lower case, also of `FILE.xyz:/dataset`; an empty text if it has none.
#[must_use]
pub fn extension(path: &Path) -> String {
    let spec = path.to_string_lossy();
    let file = match spec.split_once(":/") {
        Some((file, _)) if !path.exists() => Path::new(file),
        _ => path,
    };
    let extension = file.extension().and_then(|extension| extension.to_str());
    extension.unwrap_or_default().to_ascii_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dataset_follows_the_extension() {
        for (spec, parts) in [
            ("a.h5:/p", Some(("a.h5", "/p"))),
            ("a:b.HDF5:/some/p:q", Some(("a:b.HDF5", "/some/p:q"))),
            ("dir/a.nc:/p", Some(("dir/a.nc", "/p"))),
            ("a.mat:/p", Some(("a.mat", "/p"))),
            ("a.npz:/arr_0", Some(("a.npz", "/arr_0"))),
            ("a.npy:/p", None),
            ("a.csv", None),
            ("a.h5", None),
            ("a.xyz:/p", None),
        ] {
            assert_eq!(split(spec), parts, "{spec}");
        }
        let of = |name: &str| extension(Path::new(name));
        assert_eq!([of("a.xyz:/p"), of("b/c.CSV"), of("none")], ["xyz", "csv", ""]);
    }
}
