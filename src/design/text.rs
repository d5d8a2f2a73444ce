//! Values as YAML on one line, as artifacts store them.

use deaflow_base::Canonical;

/// Formats a mapping whose values are already text; `{}` if it is empty.
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

/// Formats a canonical value.
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
