//! Numbers for people.

/// The most decimals of a number with an error.
const MOST_DECIMALS: i32 = 6;

/// Formats a number and its estimated error, as in `0.787 ± 0.022`: the error with two significant digits, the number
/// to the same decimal, both with at most six decimals.
#[must_use]
pub fn measured(value: f64, error: f64) -> String {
    format!("{} ± {}", rounded_by(value, error), error_digits(error))
}

/// Formats a number to the decimal of the second digit of its estimated error, with at most six decimals.
#[must_use]
pub fn rounded_by(value: f64, error: f64) -> String {
    let text = match last_place(error) {
        place if place > 0 => {
            let unit = 10_f64.powi(place);
            format!("{:.0}", (value / unit).round() * unit)
        }
        place => format!("{value:.*}", place.unsigned_abs() as usize),
    };
    without_negative_zero(&text)
}

/// Writes a minus sign, but none before zeros.
fn without_negative_zero(text: &str) -> String {
    let is_zero = !text.contains(|c: char| ('1'..='9').contains(&c));
    match text.strip_prefix('-') {
        Some(size) if is_zero => size.to_owned(),
        _ => with_minus(text),
    }
}

/// Formats the ends of a range within which a value lies, each rounded by the width of the range.
#[must_use]
pub fn range_ends(ends: [f64; 2]) -> [String; 2] {
    ends.map(|end| rounded_by(end, ends[1] - ends[0]))
}

/// Formats a number without a known error: four significant digits, and at most four decimals.
#[must_use]
pub fn four_digits(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let scientific = format!("{:.3e}", value.abs());
    let power = scientific.split_once('e').and_then(|(_, power)| power.parse().ok());
    let decimals = (3 - power.unwrap_or(0_i32)).clamp(0, 4) as usize;
    without_negative_zero(&format!("{value:.decimals$}"))
}

/// Formats a measured or fitted number without a known error: four significant digits, also of small, large and
/// infinite ones.
#[must_use]
pub fn four_significant(value: f64) -> String {
    if value == f64::NEG_INFINITY {
        return "−∞".to_owned();
    }
    if value == 0.0 || !value.is_finite() {
        return without_negative_zero(&value.to_string()).replace("inf", "∞");
    }
    let scientific = format!("{value:.3e}");
    let power = scientific.split_once('e').and_then(|(_, power)| power.parse().ok());
    match 3 - power.unwrap_or(0_i32) {
        decimals @ -2..=9 => with_minus(&format!("{value:.*}", decimals.max(0) as usize)),
        _ => with_minus(&scientific),
    }
}

/// Replaces hyphens by minus signs, as in all numbers that people read.
#[must_use]
pub fn with_minus(number: &str) -> String {
    number.replace('-', "−")
}

/// Formats the size of an estimated error with two significant digits and at most six decimals; smaller errors as a
/// bound.
#[must_use]
pub fn error_digits(error: f64) -> String {
    match error.abs() {
        size if size < 1e-6 => "< 0.000001".to_owned(),
        size => rounded_by(size, size),
    }
}

/// Returns the power of ten of the second digit of a rounded number: 0.0996 has it where 0.10 has it.
fn last_place(error: f64) -> i32 {
    let scientific = format!("{:.1e}", error.abs());
    let power = scientific
        .split_once('e')
        .and_then(|(_, power)| power.parse::<i32>().ok());
    match power {
        Some(power) if error != 0.0 => (power - 1).max(-MOST_DECIMALS),
        _ => -MOST_DECIMALS,
    }
}

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
    fn a_number_is_rounded_by_its_error() {
        for (value, error, text) in [
            (0.786_792_74, 0.022, "0.787 ± 0.022"),
            (2.154_731, 0.000_31, "2.15473 ± 0.00031"),
            (2.154_731_2, 3.14e-5, "2.154731 ± 0.000031"),
            (2.154_731_2, 4e-6, "2.154731 ± 0.000004"),
            (2.154_731_2, 1e-9, "2.154731 ± < 0.000001"),
            (0.0, 0.0, "0.000000 ± < 0.000001"),
            (1.25, 0.099_6, "1.25 ± 0.10"),
            (-0.042_71, 0.001, "−0.0427 ± 0.0010"),
            (-0.000_4, 0.12, "0.00 ± 0.12"),
            (12.34, 7.6, "12.3 ± 7.6"),
            (7371.9, 34.7, "7372 ± 35"),
            (6433.2, 138.0, "6430 ± 140"),
            (6433.2, 99.6, "6430 ± 100"),
            (96.2, 1234.0, "100 ± 1200"),
        ] {
            assert_eq!(measured(value, error), text);
        }
        assert_eq!(rounded_by(2.154_731, 0.003_2), "2.1547");
        assert_eq!(
            [0.022, 0.003_25, 138.0, 2e-7].map(error_digits),
            ["0.022", "0.0032", "140", "< 0.000001"]
        );
    }

    #[test]
    fn numbers_without_an_error_have_four_digits_and_no_more_than_four_decimals() {
        let texts = [
            2.154_731, 0.999_96, 0.012_345, 12.345_6, 6_433.2, -0.042_71, -0.000_02, 0.0,
        ]
        .map(four_digits);
        let expected = ["2.155", "1.000", "0.0123", "12.35", "6433", "−0.0427", "0.0000", "0"];
        assert_eq!(texts, expected);
        assert_eq!(with_minus("-1.2e-5"), "−1.2e−5");
    }

    #[test]
    fn measured_numbers_have_four_digits_whatever_their_size() {
        let texts = [
            2.154_731, 0.999_96, 0.012_345, 6_433.2, -0.042_71, -0.000_02, 123_456.0, 1.5e9, 0.0, -0.0,
        ];
        let expected = [
            "2.155",
            "1.000",
            "0.01235",
            "6433",
            "−0.04271",
            "−0.00002000",
            "123456",
            "1.500e9",
            "0",
            "0",
        ];
        assert_eq!(texts.map(four_significant), expected);
        assert_eq!([f64::INFINITY, -f64::INFINITY].map(four_significant), ["∞", "−∞"]);
    }

    #[test]
    fn the_ends_of_a_range_are_rounded_by_its_width() {
        for (ends, texts) in [
            ([6_433.25, 6_434.12], ["6433.25", "6434.12"]),
            ([6_433.25, 6_480.9], ["6433", "6481"]),
            ([6_101.2, 7_433.1], ["6100", "7400"]),
            ([-0.051_23, 0.043_11], ["−0.051", "0.043"]),
        ] {
            assert_eq!(range_ends(ends), texts);
        }
    }

    #[test]
    fn numbers_have_two_digits_and_no_more_than_five_decimals() {
        let texts = [0.0, 0.0031, 0.00052, 0.0567, 1.26, 23.4, 2e-7].map(two_digits);
        assert_eq!(texts, ["0.0", "0.0031", "0.00052", "0.057", "1.3", "23", "0.00000"]);
    }
}
