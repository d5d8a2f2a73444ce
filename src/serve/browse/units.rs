//! The units of the results of a run.

use std::collections::BTreeMap;

use deaflow_stage::result_unit;
use deaflow_store::Run;

/// Returns the units of the results that have one, by name.
pub fn units(run: &Run) -> BTreeMap<&str, &'static str> {
    let stage = |name: &str| {
        let own = run.stages.iter().map(|stage| stage.name.as_str());
        own.filter_map(|stage| name.strip_prefix(stage)?.strip_prefix('.').map(str::len))
            .min()
    };
    let unit = |name: &str| result_unit(&name[name.len() - stage(name).unwrap_or(name.len())..]);
    let all = run.results.keys().map(|name| (name.as_str(), unit(name)));
    all.filter(|(_, unit)| *unit != "1").collect()
}
