//! What a run found, kept by the store: a run that builds nothing tells it again without opening an artifact.

use std::path::Path;

use super::artifacts::RunArtifacts;
use super::error::ReportError;
use super::results::{RunResults, is_missing};
use deaflow_base::{Digest, build};
use deaflow_store::Store;

impl RunResults {
    /// As [`RunResults::of`], remembered from the last time that the same was asked of the same artifacts, where all figures are still there.
    ///
    /// # Errors
    /// As [`RunResults::of`].
    pub fn remembered(
        run: &RunArtifacts<'_>,
        pipeline: &str,
        neglected: Vec<String>,
        may_break_down: &[String],
    ) -> Result<Self, ReportError> {
        let folder = Self::folder(run, pipeline);
        let of = question(run, pipeline, &folder, (&neglected, may_break_down));
        let known = recalled(run.store, &of);
        if let Some(known) = known.filter(|known| !known.figure_paths().any(is_missing)) {
            return Ok(known);
        }
        let found = Self::of(run, pipeline, neglected, may_break_down)?;
        remember(run.store, &of, &found);
        Ok(found)
    }
}

/// All that the results follow from.
fn question(
    run: &RunArtifacts<'_>,
    pipeline: &str,
    folder: &Path,
    (neglected, may_break_down): (&[String], &[String]),
) -> Digest {
    let RunArtifacts { file, made, rounds, .. } = run;
    let build = build();
    let text = format!(
        "results of {build}\n{pipeline:?} {file:?} {folder:?} {made:?} {rounds:?} {neglected:?} {may_break_down:?}"
    );
    Digest::of(text.as_bytes())
}

/// Numbers are read again from text: a flipped bit among them would not be noticed but for the digest beside it.
fn recalled(store: &Store, of: &Digest) -> Option<RunResults> {
    let lines = store.memo(of)?;
    let [digest, text] = &lines[..] else { return None };
    let is_whole = *digest == Digest::of(text.as_bytes()).to_string();
    serde_json::from_str(text).ok().filter(|_| is_whole)
}

/// In a store that cannot be written it is found again the next time.
fn remember(store: &Store, of: &Digest, found: &RunResults) {
    if let Ok(text) = serde_json::to_string(found) {
        store
            .put_memo(of, &[Digest::of(text.as_bytes()).to_string(), text])
            .ok();
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::RunArtifacts;

    #[test]
    fn answers_are_remembered_as_long_as_they_are_whole_and_their_figures_there() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let run = RunArtifacts {
            store: &store,
            file: Path::new("p.yaml"),
            made: &[],
            rounds: &[],
        };
        let asked = |warning: &str| RunResults::remembered(&run, "p", vec![warning.to_owned()], &[]).unwrap();
        let of = |warning: &str| question(&run, "p", &RunResults::folder(&run, "p"), (&[warning.to_owned()], &[]));
        assert!(recalled(&store, &of("one")).is_none());
        let found = asked("one");
        let warnings = |results: &RunResults| results.warning_lines().collect::<Vec<_>>();
        assert_eq!(warnings(&found), ["warning: one"]);
        let known = recalled(&store, &of("one")).unwrap();
        assert_eq!(
            (warnings(&known), known.document()),
            (warnings(&found), found.document())
        );
        assert!(recalled(&store, &of("two")).is_none());
        // It is told from memory: under this question another answer stands.
        remember(&store, &of("one"), &asked("two"));
        assert_eq!(warnings(&asked("one")), ["warning: two"]);
        // A letter of it turned into another.
        for memo in fs::read_dir(folder.path().join("memos")).unwrap() {
            let path = memo.unwrap().path();
            let text = fs::read_to_string(&path).unwrap();
            fs::write(&path, text.replace("two", "tao").replace("one", "ane")).unwrap();
        }
        assert_eq!(warnings(&asked("one")), ["warning: one"]);
        // One of its figures is gone.
        let figure = folder.path().join("figure.png");
        let mut with_figure = asked("two");
        with_figure.add_figure(&figure);
        remember(&store, &of("one"), &with_figure);
        assert_eq!(warnings(&asked("one")), ["warning: one"]);
        fs::write(&figure, "").unwrap();
        remember(&store, &of("one"), &with_figure);
        assert_eq!(warnings(&asked("one")), ["warning: two"]);
    }
}
