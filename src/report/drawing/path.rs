//! Short numbers and paths of SVG: a page has hundreds of them.

use std::fmt::Write;

/// Writes a number with at most `decimals` decimals and no trailing zeros.
pub fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let text = match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.'),
        false => &text,
    };
    match text {
        "-0" => "0".to_owned(),
        text => text.to_owned(),
    }
}

/// Writes a path through points, in integer steps.
pub fn path(points: &[(f64, f64)], closed: bool) -> String {
    let mut out = String::new();
    let mut last = (0_i64, 0_i64);
    for (k, (x, y)) in points.iter().enumerate() {
        let at = (x.round() as i64, y.round() as i64);
        if k == 0 {
            let _ = write!(out, "M{} {}", at.0, at.1);
        } else if at != last {
            let (dx, dy) = (at.0 - last.0, at.1 - last.1);
            let _ = match (dx, dy) {
                (dx, 0) => write!(out, "h{dx}"),
                (0, dy) => write!(out, "v{dy}"),
                _ => write!(out, "l{dx}{}{dy}", if dy < 0 { "" } else { " " }),
            };
        }
        last = at;
    }
    if closed {
        out.push('z');
    }
    out
}

/// Writes a path through points in integer steps, with the same commands wherever the points are.
pub fn steady_path(points: &[(f64, f64)], closed: bool) -> String {
    let mut out = String::new();
    let mut last = (0_i64, 0_i64);
    for (k, (x, y)) in points.iter().enumerate() {
        let at = (x.round() as i64, y.round() as i64);
        let start = if k == 0 { "M" } else { "l" };
        let _ = write!(out, "{start}{} {}", at.0 - last.0, at.1 - last.1);
        last = at;
    }
    if closed {
        out.push('z');
    }
    out
}

/// Returns where the head of an arrow begins, and its path.
pub fn head((x, y): (f64, f64), tip: (f64, f64)) -> ((f64, f64), String) {
    let (dx, dy) = (tip.0 - x, tip.1 - y);
    let length = dx.hypot(dy);
    let (ux, uy) = (dx / length, dy / length);
    let head = (0.5 * length).min(42.0);
    let wing = |side: f64| {
        (
            tip.0 - head * (ux - 0.5 * side * uy),
            tip.1 - head * (uy + 0.5 * side * ux),
        )
    };
    let base = (tip.0 - 0.8 * head * ux, tip.1 - 0.8 * head * uy);
    (base, path(&[tip, wing(1.0), wing(-1.0)], true))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let texts = [(1.0, 3), (0.125, 2), (-0.001, 2), (1200.0, 0), (0.5, 6)].map(|(v, d)| number(v, d));
        assert_eq!(texts, ["1", "0.12", "0", "1200", "0.5"]);
    }

    #[test]
    fn a_path_ends_at_its_last_point_despite_rounding() {
        assert_eq!(
            path(&[(0.4, 0.0), (0.8, 0.0), (1.2, 4.6), (1.2, 2.0)], true),
            "M0 0h1v5v-3z"
        );
        assert_eq!(path(&[(1.0, 1.0), (3.0, 0.0), (2.0, 2.0)], false), "M1 1l2-1l-1 2");
        assert_eq!(
            steady_path(&[(0.4, 0.0), (0.8, 0.0), (1.2, 4.6), (1.2, 2.0)], true),
            "M0 0l1 0l0 5l0 -3z"
        );
    }
}
