//! Formats of pictures.

use std::path::Path;

use crate::PatternFileError;

/// Formats of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    /// Portable Network Graphics.
    Png,
    /// JPEG, baseline or progressive.
    Jpeg,
    /// Tagged Image File Format.
    Tiff,
    /// Bitmap of Windows.
    Bmp,
}

impl PictureFormat {
    const ALL: [Self; 4] = [Self::Png, Self::Jpeg, Self::Tiff, Self::Bmp];

    /// The extensions of files, for messages.
    pub const EXTENSIONS: &'static str = ".png, .jpg, .tif and .bmp";

    /// Returns the format of a file by its extension.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        Self::named(path.extension()?.to_str()?)
    }

    /// Returns the format with an extension.
    #[must_use]
    pub fn named(extension: &str) -> Option<Self> {
        match extension.to_ascii_lowercase().as_str() {
            "png" => Some(Self::Png),
            "jpg" | "jpeg" => Some(Self::Jpeg),
            "tif" | "tiff" => Some(Self::Tiff),
            "bmp" => Some(Self::Bmp),
            _ => None,
        }
    }

    /// The name in messages.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Tiff => "TIFF",
            Self::Bmp => "BMP",
        }
    }

    /// Whether the first bytes of a file are those of the format.
    fn begins(self, bytes: &[u8]) -> bool {
        let starts: &[&[u8]] = match self {
            Self::Png => &[b"\x89PNG\r\n\x1a\n"],
            Self::Jpeg => &[b"\xff\xd8\xff"],
            Self::Tiff => &[b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"],
            Self::Bmp => &[b"BM"],
        };
        starts.iter().any(|start| bytes.starts_with(start))
    }

    /// Refuses a file whose content is that of another format.
    pub(super) fn check(self, bytes: &[u8]) -> Result<(), PatternFileError> {
        let found = Self::ALL.into_iter().find(|format| format.begins(bytes));
        match found {
            Some(other) if other != self => {
                let (found, expected) = (other.name(), self.name());
                Err(
                    PatternFileError::new(format!("the file is in {found}, not in {expected}"))
                        .help(format!("name it with the extension of {found}")),
                )
            }
            _ => Ok(()),
        }
    }
}
