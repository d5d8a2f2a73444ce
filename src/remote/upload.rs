//! Multipart uploads of large files. An interrupted upload resumes with the missing parts.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use rusty_s3::actions::{CreateMultipartUpload, ListParts};

use super::bucket::UploadNote;
use super::error::RemoteError;
use super::s3::{RequestBody, S3};
use deaflow_base::{read_own, write_output};

/// Maximum size in bytes of files that are sent in one request.
pub const MAX_SINGLE: u64 = 64 << 20;

/// Size of a part in bytes, unless there would be too many.
const PART: u64 = 32 << 20;

/// Maximum number of parts.
const MAX_PARTS: u64 = 9000;

/// Maximum length of a note on an upload in bytes.
const MAX_NOTE: u64 = 1 << 16;

/// Sends a file in parts.
///
/// # Errors
/// Returns an error if the storage cannot be reached or refuses, or the file cannot be read.
pub fn in_parts(s3: &S3, name: &str, file: &Path, size: u64, note: &UploadNote<'_>) -> Result<(), RemoteError> {
    let key = s3.key(name);
    let length = PART.max(size.div_ceil(MAX_PARTS));
    let count = u16::try_from(size.div_ceil(length)).unwrap_or(u16::MAX);
    let (id, mut parts) = match interrupted(s3, &key, note) {
        Some(upload) => upload,
        None => (start(s3, name, &key, note)?, Parts::new()),
    };
    for number in 1..=count {
        let from = u64::from(number - 1) * length;
        let length = length.min(size - from);
        if parts.get(&number).is_some_and(|(_, size)| *size == length) {
            continue;
        }
        let credentials = s3.credentials();
        let action = s3.bucket().upload_part(credentials.as_ref(), &key, number, &id);
        let body = RequestBody::File {
            path: file,
            from,
            length,
        };
        let response = s3.send(&action, body)?;
        let (headers, _) = s3.read_success(response, UPLOAD_PART, name)?;
        let tag = headers.get("etag").and_then(|tag| tag.to_str().ok());
        let tag = tag.ok_or_else(|| s3.unexpected(UPLOAD_PART, name, "no ETag"))?;
        parts.insert(number, (tag.to_owned(), length));
    }
    let credentials = s3.credentials();
    let tags = (1..=count).filter_map(|number| parts.get(&number).map(|(tag, _)| tag.as_str()));
    let complete = || {
        s3.bucket()
            .complete_multipart_upload(credentials.as_ref(), &key, &id, tags.clone())
    };
    let response = s3.send(&complete(), RequestBody::Bytes(complete().body().as_bytes()))?;
    let (_, text) = s3.read_success(response, COMPLETE, name)?;
    // Failures may follow after a successful status.
    if text.contains("<Error>") {
        return Err(s3.unexpected(COMPLETE, name, &text.chars().take(300).collect::<String>()));
    }
    // If the note stays, the next upload finds no upload of that number and starts anew.
    let _ = fs::remove_file(note.path);
    Ok(())
}

const START: &str = "start the upload of";
const UPLOAD_PART: &str = "upload a part of";
const LIST_PARTS: &str = "list the parts of";
const COMPLETE: &str = "complete the upload of";

fn start(s3: &S3, name: &str, key: &str, note: &UploadNote<'_>) -> Result<String, RemoteError> {
    let credentials = s3.credentials();
    let action = s3.bucket().create_multipart_upload(credentials.as_ref(), key);
    let response = s3.send(&action, RequestBody::Empty)?;
    let (_, text) = s3.read_success(response, START, name)?;
    let upload =
        CreateMultipartUpload::parse_response(&text).map_err(|error| s3.unexpected(START, name, &error.to_string()))?;
    let id = upload.upload_id().to_owned();
    // Without a note the upload cannot be resumed, which is no failure.
    let _ = write_output(note.path, format!("{}\n{id}\n", note.content).as_bytes());
    Ok(id)
}

/// Tag and length of uploaded parts by number.
type Parts = BTreeMap<u16, (String, u64)>;

/// Returns an interrupted upload of the same bytes and its parts.
fn interrupted(s3: &S3, key: &str, note: &UploadNote<'_>) -> Option<(String, Parts)> {
    let text = String::from_utf8(read_own(note.path, MAX_NOTE).ok()?).ok()?;
    let mut lines = text.lines();
    let id = lines
        .next()
        .filter(|content| *content == note.content)
        .and(lines.next())?;
    let mut parts = Parts::new();
    let mut after = None;
    loop {
        let credentials = s3.credentials();
        let mut action = s3.bucket().list_parts(credentials.as_ref(), key, id);
        if let Some(after) = after {
            action.set_part_number_marker(after);
        }
        let response = s3.send(&action, RequestBody::Empty).ok()?;
        let (_, text) = s3.read_success(response, LIST_PARTS, key).ok()?;
        let page = ListParts::parse_response(&text).ok()?;
        parts.extend(page.parts.into_iter().map(|part| (part.number, (part.etag, part.size))));
        match page.next_part_number_marker {
            Some(next) if Some(next) > after && next > 0 => after = Some(next),
            _ => return Some((id.to_owned(), parts)),
        }
    }
}
