//! How long what a store asks of its file system takes there: what a look ahead at many workers is computed from.

use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::time::Instant;

use super::error::StoreError;
use super::open::Store;

/// Number of repetitions.
const TIMES: usize = 100;

/// Number of names in the listed folder.
const NAMES: usize = 1000;

/// Length of an artifact and of a record, bytes.
const LENGTHS: (usize, usize) = (200_000, 2000);

/// Duration of an operation on the file system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OperationTime {
    /// The operation.
    pub name: &'static str,
    /// Number of requests for metadata in it.
    pub requests: u32,
    /// Median duration, s.
    pub seconds: f64,
}

impl Store {
    /// Measures the services, in a folder of its own there.
    ///
    /// # Errors
    /// If the store is not writable.
    pub fn measure_file_system(&self) -> Result<Vec<OperationTime>, StoreError> {
        let folder = self.temporary()?;
        let all = services(folder.path());
        all.map_err(StoreError::io("write in", folder.path()))
    }
}

fn services(folder: &Path) -> io::Result<Vec<OperationTime>> {
    let (claim, taken) = (folder.join("claim"), folder.join("taken"));
    let (objects, records) = (folder.join("objects"), folder.join("records"));
    let many = folder.join("many");
    for folder in [&taken, &objects, &records, &many] {
        fs::create_dir(folder)?;
    }
    for name in 0..NAMES {
        fs::write(many.join(name.to_string()), "")?;
    }
    let content = vec![7; LENGTHS.0];
    let sign = File::create(folder.join("sign"))?;
    let written = |path: &Path, bytes: &[u8]| {
        let mut file = File::create(path)?;
        file.write_all(bytes)?;
        file.sync_data()
    };
    let service = |name, requests, what: &mut dyn FnMut(usize) -> io::Result<()>| {
        let mut times = Vec::with_capacity(TIMES);
        for time in 0..TIMES {
            let start = Instant::now();
            what(time)?;
            times.push(start.elapsed().as_secs_f64());
        }
        times.sort_by(f64::total_cmp);
        Ok::<OperationTime, io::Error>(OperationTime {
            name,
            requests,
            seconds: times[TIMES / 2],
        })
    };
    Ok(vec![
        service("claim", 5, &mut |_| {
            fs::create_dir(&claim)?;
            fs::write(claim.join("owner"), "abcdef")?;
            fs::remove_file(claim.join("owner"))?;
            fs::remove_dir(&claim)
        })?,
        service("claim held by another worker", 2, &mut |_| {
            let _ = fs::create_dir(&taken);
            let _ = fs::read(taken.join("owner"));
            Ok(())
        })?,
        service("publish an artifact", 5, &mut |time| {
            let aside = folder.join("aside");
            written(&aside, &content)?;
            fs::hard_link(&aside, objects.join(time.to_string()))?;
            fs::remove_file(&aside)?;
            File::open(&objects)?.sync_all()
        })?,
        service("write a record", 3, &mut |time| {
            let aside = folder.join("aside");
            written(&aside, &content[..LENGTHS.1])?;
            fs::rename(&aside, records.join(time.to_string()))
        })?,
        service("read a record", 2, &mut |time| {
            let bytes = fs::read(records.join(time.to_string()))?;
            debug_assert_eq!(bytes.len(), LENGTHS.1);
            Ok(())
        })?,
        service("heartbeat", 1, &mut |_| sign.write_all_at(&content[..1024], 0))?,
        service("list 1000 names", 8, &mut |_| {
            fs::read_dir(&many)?.try_for_each(|entry| entry.map(drop))
        })?,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_service_takes_some_time_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let found = store.measure_file_system().unwrap();
        assert_eq!(found.len(), 7);
        assert!(
            found
                .iter()
                .all(|service| service.seconds > 0.0 && service.requests > 0),
            "{found:?}"
        );
        drop(store);
        assert_eq!(fs::read_dir(folder.path().join("tmp")).unwrap().count(), 0);
    }
}
