//! Large files are sent in pieces (multipart upload): an upload that was interrupted goes on with the pieces that are not there.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use rusty_s3::actions::{CreateMultipartUpload, ListParts};

use super::bucket::Unfinished;
use super::error::RemoteError;
use super::s3::{S3, Sent};
use deaflow_base::{read_own, write_output};

/// Files of no more bytes are sent whole.
pub const WHOLE: u64 = 64 << 20;

/// Bytes of a piece, unless there would be too many.
const PIECE: u64 = 32 << 20;

/// Pieces that an upload may have.
const MOST_PIECES: u64 = 9000;

/// A note on an upload is shorter, bytes.
const MAX_NOTE: u64 = 1 << 16;

/// Sends a file.
///
/// # Errors
/// When the storage cannot be reached or refuses, or the file cannot be read.
pub fn in_pieces(s3: &S3, name: &str, file: &Path, size: u64, unfinished: &Unfinished<'_>) -> Result<(), RemoteError> {
    let key = s3.key(name);
    let length = PIECE.max(size.div_ceil(MOST_PIECES));
    let count = u16::try_from(size.div_ceil(length)).unwrap_or(u16::MAX);
    let begun = match begun(s3, &key, unfinished) {
        Some(begun) => begun,
        None => (begin(s3, name, &key, unfinished)?, BTreeMap::new()),
    };
    let (id, mut there) = begun;
    for number in 1..=count {
        let from = u64::from(number - 1) * length;
        let length = length.min(size - from);
        if there.get(&number).is_some_and(|(_, size)| *size == length) {
            continue;
        }
        let credentials = s3.credentials();
        let action = s3.bucket().upload_part(credentials.as_ref(), &key, number, &id);
        let sent = Sent::File {
            path: file,
            from,
            length,
        };
        let answer = s3.send(&action, &[], sent)?;
        let (headers, _) = s3.well(answer, "write a piece of", name)?;
        let tag = headers.get("etag").and_then(|tag| tag.to_str().ok());
        let tag = tag.ok_or_else(|| s3.puzzled("write a piece of", name, "no ETag"))?;
        there.insert(number, (tag.to_owned(), length));
    }
    let credentials = s3.credentials();
    let tags = (1..=count).filter_map(|number| there.get(&number).map(|(tag, _)| tag.as_str()));
    let action = s3
        .bucket()
        .complete_multipart_upload(credentials.as_ref(), &key, &id, tags.clone());
    let body = s3
        .bucket()
        .complete_multipart_upload(credentials.as_ref(), &key, &id, tags)
        .body();
    let answer = s3.send(&action, &[], Sent::Bytes(body.as_bytes()))?;
    let (_, text) = s3.well(answer, "put together", name)?;
    // It may be told late that it is not well, after the status that says it is.
    if text.contains("<Error>") {
        return Err(s3.puzzled("put together", name, &text.chars().take(300).collect::<String>()));
    }
    // Only a note: where it stays, the next upload finds that there is none of that number.
    let _ = fs::remove_file(unfinished.note);
    Ok(())
}

fn begin(s3: &S3, name: &str, key: &str, unfinished: &Unfinished<'_>) -> Result<String, RemoteError> {
    let credentials = s3.credentials();
    let action = s3.bucket().create_multipart_upload(credentials.as_ref(), key);
    let answer = s3.send(&action, &[], Sent::Nothing)?;
    let (_, text) = s3.well(answer, "begin to write", name)?;
    let begun = CreateMultipartUpload::parse_response(&text)
        .map_err(|error| s3.puzzled("begin to write", name, &error.to_string()))?;
    let id = begun.upload_id().to_owned();
    let note = format!("{}\n{id}\n", unfinished.content);
    // Where it cannot be noted, it cannot be gone on with.
    let _ = write_output(unfinished.note, note.as_bytes());
    Ok(id)
}

/// Pieces by their numbers: tag and length.
type Pieces = BTreeMap<u16, (String, u64)>;

/// An upload of the same bytes that was interrupted, and the pieces that are there.
fn begun(s3: &S3, key: &str, unfinished: &Unfinished<'_>) -> Option<(String, Pieces)> {
    let note = String::from_utf8(read_own(unfinished.note, MAX_NOTE).ok()?).ok()?;
    let mut lines = note.lines();
    let id = lines
        .next()
        .filter(|content| *content == unfinished.content)
        .and(lines.next())?;
    let mut pieces = Pieces::new();
    let mut after = None;
    loop {
        let credentials = s3.credentials();
        let mut action = s3.bucket().list_parts(credentials.as_ref(), key, id);
        if let Some(after) = after {
            action.set_part_number_marker(after);
        }
        let answer = s3.send(&action, &[], Sent::Nothing).ok()?;
        let (_, text) = s3.well(answer, "list the pieces of", key).ok()?;
        let page = ListParts::parse_response(&text).ok()?;
        pieces.extend(page.parts.into_iter().map(|part| (part.number, (part.etag, part.size))));
        match page.next_part_number_marker {
            Some(next) if Some(next) > after && next > 0 => after = Some(next),
            _ => return Some((id.to_owned(), pieces)),
        }
    }
}
