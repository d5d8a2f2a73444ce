//! Numbers for people.

/// Formats a number with two significant digits and at most five decimals.
#[must_use]
pub fn two_digits(value: f64) -> String {
    let digits = if value > 0.0 {
        (1.0 - value.log10().floor()).clamp(0.0, 5.0)
    } else {
        1.0
    };
    format!("{value:.*}", digits as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_two_digits_and_no_more_than_five_decimals() {
        let texts = [0.0, 0.0031, 0.00052, 0.0567, 1.26, 23.4, 2e-7].map(two_digits);
        assert_eq!(texts, ["0.0", "0.0031", "0.00052", "0.057", "1.3", "23", "0.00000"]);
    }
}
