//! A cache of run results in the store: a run that builds nothing reports them without opening an artifact.

use std::path::Path;

use super::artifacts::RunArtifacts;
use super::error::ReportError;
use super::results::{RunResults, is_missing};
use deaflow_base::{Digest, build};
use deaflow_store::Store;

impl RunResults {
    /// As [`RunResults::of`], but from the cache if the artifacts and the request are the same and all figures exist.
    ///
    /// # Errors
    /// As [`RunResults::of`].
    pub fn cached(
        run: &RunArtifacts<'_>,
        pipeline: &str,
        model_warnings: Vec<String>,
        observing: &[String],
    ) -> Result<Self, ReportError> {
        let folder = Self::folder(run, pipeline);
        let key = cache_key(run, pipeline, &folder, (&model_warnings, observing));
        let known = load(run.store, &key);
        if let Some(known) = known.filter(|known| !known.figure_paths().any(is_missing)) {
            return Ok(known);
        }
        let found = Self::of(run, pipeline, model_warnings, observing)?;
        if found.has_all_figures() {
            store(run.store, &key, &found);
        }
        Ok(found)
    }
}

/// Returns the digest of all that the results depend on.
fn cache_key(
    run: &RunArtifacts<'_>,
    pipeline: &str,
    folder: &Path,
    (model_warnings, observing): (&[String], &[String]),
) -> Digest {
    let RunArtifacts {
        file, stages, rounds, ..
    } = run;
    let build = build();
    let text = format!(
        "results of {build}\n{pipeline:?} {file:?} {folder:?} {stages:?} {rounds:?} {model_warnings:?} \
         {observing:?}"
    );
    Digest::of(text.as_bytes())
}

/// Reads results. The digest beside them detects damage.
fn load(store: &Store, key: &Digest) -> Option<RunResults> {
    let lines = store.memo(key)?;
    let [digest, text] = &lines[..] else { return None };
    let is_intact = *digest == Digest::of(text.as_bytes()).to_string();
    serde_json::from_str(text).ok().filter(|_| is_intact)
}

/// Writes results. In a store that is not writable, the next run computes them again.
fn store(store: &Store, key: &Digest, found: &RunResults) {
    if let Ok(text) = serde_json::to_string(found) {
        store
            .put_memo(key, &[Digest::of(text.as_bytes()).to_string(), text])
            .ok();
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::RunArtifacts;

    #[test]
    fn results_are_cached_as_long_as_they_are_intact_and_their_figures_exist() {
        let folder = tempfile::tempdir().unwrap();
        let opened = Store::open(folder.path()).unwrap();
        let run = RunArtifacts {
            store: &opened,
            file: Path::new("p.yaml"),
            stages: &[],
            rounds: &[],
        };
        let results = |warning: &str| RunResults::cached(&run, "p", vec![warning.to_owned()], &[]).unwrap();
        let key = |warning: &str| cache_key(&run, "p", &RunResults::folder(&run, "p"), (&[warning.to_owned()], &[]));
        assert!(load(&opened, &key("one")).is_none());
        let found = results("one");
        let warnings = |results: &RunResults| results.warning_lines().collect::<Vec<_>>();
        assert_eq!(warnings(&found), ["warning: one"]);
        let known = load(&opened, &key("one")).unwrap();
        assert_eq!(
            (warnings(&known), known.document()),
            (warnings(&found), found.document())
        );
        assert!(load(&opened, &key("two")).is_none());
        // The results come from the cache: those of another request are stored under this key.
        store(&opened, &key("one"), &results("two"));
        assert_eq!(warnings(&results("one")), ["warning: two"]);
        // A letter is changed.
        for memo in fs::read_dir(folder.path().join("memos")).unwrap() {
            let path = memo.unwrap().path();
            let text = fs::read_to_string(&path).unwrap();
            fs::write(&path, text.replace("two", "tao").replace("one", "ane")).unwrap();
        }
        assert_eq!(warnings(&results("one")), ["warning: one"]);
        // A figure is missing.
        let figure = folder.path().join("figure.png");
        let mut with_figure = results("two");
        with_figure.add_figure(&figure);
        store(&opened, &key("one"), &with_figure);
        assert_eq!(warnings(&results("one")), ["warning: one"]);
        fs::write(&figure, "").unwrap();
        store(&opened, &key("one"), &with_figure);
        assert_eq!(warnings(&results("one")), ["warning: two"]);
    }
}
