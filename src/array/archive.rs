//! NumPy archives: zip files with one array per member, stored (numpy.savez) or deflated (numpy.savez_compressed).

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use zip::{CompressionMethod, ZipArchive};

use super::error::ArrayError;
use super::numpy::{Member, Position};
use deaflow_base::open_regular;

/// The largest compression ratio of DEFLATE (RFC 1951: 258 bytes from 2 bits).
const MAX_RATIO: u64 = 1032;

/// The extension of members that are arrays.
const MEMBER: &str = ".npy";

type Archive = ZipArchive<BufReader<File>>;

fn open(path: &Path) -> Result<(Archive, u64), ArrayError> {
    let file = open_regular(path)?;
    let bytes = file.metadata()?.len();
    let archive = ZipArchive::new(BufReader::new(file));
    let archive = archive.map_err(|e| ArrayError::damaged(format!("not a NumPy archive: {e}")))?;
    Ok((archive, bytes))
}

/// Returns the names of the members, those of arrays as NumPy knows them, without extension.
pub(super) fn names(path: &Path) -> Result<Vec<String>, ArrayError> {
    let (archive, _) = open(path)?;
    let names = archive.file_names();
    Ok(names
        .map(|name| name.strip_suffix(MEMBER).unwrap_or(name).to_owned())
        .collect())
}

/// Finds an array.
pub(super) fn find(path: &Path, name: &str) -> Result<Option<Member>, ArrayError> {
    let (mut archive, bytes) = open(path)?;
    let Some(index) = archive.index_for_name(&format!("{name}{MEMBER}")) else {
        return Ok(None);
    };
    let damaged = |why: String| ArrayError::damaged(why).of(name);
    let member = archive.by_index_raw(index).map_err(|e| damaged(e.to_string()))?;
    let method = member.compression();
    let is_deflated = method == CompressionMethod::DEFLATE;
    if member.encrypted() || !(is_deflated || method == CompressionMethod::STORE) {
        let why = "compression method is not supported; allowed: stored, deflated, not encrypted";
        return Err(ArrayError::new(why, "write it with numpy.savez or numpy.savez_compressed").of(name));
    }
    let start = member.data_start();
    let position = Position {
        start: start.ok_or_else(|| damaged("its position in the file is missing".to_owned()))?,
        packed: member.compressed_size(),
        size: member.size(),
        checksum: Some(member.crc32()),
        is_deflated,
    };
    let most = position.packed.saturating_mul(if is_deflated { MAX_RATIO } else { 1 });
    let end = position.start.checked_add(position.packed);
    if end.is_none_or(|end| end > bytes) || position.size > most {
        let claimed = position.size.max(position.packed);
        return Err(damaged(format!(
            "it claims {claimed} bytes, but a file of {bytes} bytes cannot hold them"
        )));
    }
    Member::read(path, name, position).map(Some)
}
