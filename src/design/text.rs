//! Declared values in their own YAML syntax on one line, as artifacts keep them.

use deaflow_base::Canonical;

/// A mapping of keys and values that are texts already; `{}` where there are none.
pub(super) fn flow_mapping<K: AsRef<str>>(entries: impl IntoIterator<Item = (K, String)>) -> String {
    let entries: Vec<String> = entries
        .into_iter()
        .map(|(key, value)| format!("{}: {value}", key.as_ref()))
        .collect();
    match entries.is_empty() {
        true => "{}".to_owned(),
        false => format!("{{ {} }}", entries.join(", ")),
    }
}

/// A canonical value.
pub(super) fn flow_value(value: &Canonical) -> String {
    match value {
        Canonical::List(items) => {
            let items: Vec<String> = items.iter().map(flow_value).collect();
            format!("[{}]", items.join(", "))
        }
        Canonical::Map(entries) => flow_mapping(entries.iter().map(|(key, value)| (key, flow_value(value)))),
        plain => plain.to_string(),
    }
}
