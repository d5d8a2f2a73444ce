//! Lists of names in messages.

/// The largest number of names that are listed.
const MOST: usize = 20;

/// The largest number of characters of a name.
const LONGEST: usize = 60;

/// Joins names by commas. Of many only the first are listed, with the number of the others.
#[must_use]
pub fn listed(names: &[String]) -> String {
    let shown: Vec<String> = names
        .iter()
        .take(MOST)
        .map(|name| name.chars().take(LONGEST).collect())
        .collect();
    match names.len() {
        0 => "nothing".to_owned(),
        n if n > MOST => format!("{} and {} more", shown.join(", "), n - MOST),
        _ => shown.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_says_how_many_names_it_leaves_out() {
        let names: Vec<String> = (0..33).map(|n| format!("n{n}")).collect();
        assert_eq!(listed(&names[..2]), "n0, n1");
        assert!(listed(&names).ends_with(", n19 and 13 more"));
        assert_eq!(listed(&[]), "nothing");
    }
}
