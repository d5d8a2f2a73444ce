//! The text of a largest area in files.

/// What stands before a largest area in files. The text is part of artifact digests.
pub const AT_MOST: &str = "at most ";

/// Returns the largest area of a target as it is written in files; `None` of an area to be met, or of none.
#[must_use]
pub fn largest_area(text: &str) -> Option<f64> {
    text.strip_prefix(AT_MOST)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_largest_area_is_read() {
        assert_eq!(largest_area("at most 0.3"), Some(0.3));
        for other in ["free", "0.3", "at most", "at most x"] {
            assert_eq!(largest_area(other), None, "{other}");
        }
    }
}
