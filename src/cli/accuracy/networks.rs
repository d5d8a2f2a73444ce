//! Compares networks with estimates.

use super::millimetres;
use deaflow_accuracy::Measured;

/// Returns for each network the most accurate of the estimates that are both faster and more accurate, if any.
pub fn beaten(measured: &[Measured]) -> Vec<(&Measured, Option<&Measured>)> {
    let networks = measured.iter().filter(|m| m.network().is_some());
    let estimates = || measured.iter().filter(|m| m.network().is_none() && !m.equilibria);
    let better = |network: &Measured| {
        let faster = estimates().filter(|m| m.seconds_per_pattern() < network.seconds_per_pattern());
        let both = faster.filter(|m| m.rms() < network.rms());
        both.min_by(|a, b| a.rms().total_cmp(&b.rms()))
    };
    networks.map(|network| (network, better(network))).collect()
}

/// Describes these comparisons and the times of large batches; none without a network.
pub fn describe(measured: &[Measured]) -> Option<String> {
    let numbers = |m: &Measured| {
        let (time, error) = (1e3 * m.seconds_per_pattern(), millimetres(m.rms()));
        format!("{time:.2} ms per pattern and {error} mm RMS")
    };
    let sentence = |(network, better): (&Measured, Option<&Measured>)| {
        let name = network.network().unwrap_or_default();
        let verdict = match better {
            Some(better) => format!(
                "{name}: the estimate {{ {} }} is both faster and more accurate: {} instead of {}\n",
                better.settings,
                numbers(better),
                numbers(network)
            ),
            None => format!(
                "{name}: {}; no measured estimate is both faster and more accurate\n",
                numbers(network)
            ),
        };
        let batch = network.batch.map_or(String::new(), |(size, seconds)| {
            let each = 1e3 * seconds / size as f64;
            format!("  {size} patterns in one batch take {seconds:.2} s of one core, {each:.2} ms each\n")
        });
        verdict + &batch
    };
    let sentences: String = beaten(measured).into_iter().map(sentence).collect();
    (!sentences.is_empty()).then_some(sentences)
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_accuracy::FamilyError;

    fn measured(settings: &str, seconds: f64, rms: f64, equilibria: bool) -> Measured {
        Measured {
            settings: settings.into(),
            equilibria,
            patterns: Vec::new(),
            families: vec![FamilyError {
                rms,
                ..FamilyError::default()
            }],
            seconds: vec![seconds],
            batch: settings.starts_with("network").then_some((1000, 1000.0 * seconds)),
        }
    }

    #[test]
    fn estimates_that_beat_a_network_are_reported() {
        let all = [
            measured("estimate", 1.0, 0.01, false),
            measured("equilibria are no estimates", 0.1, 0.001, true),
            measured("network: slow", 2.0, 0.02, false),
            measured("network: fine", 2.0, 0.005, false),
            measured("network: fast", 0.5, 0.02, false),
        ];
        let pairs: Vec<_> = beaten(&all)
            .into_iter()
            .map(|(network, better)| (network.network().unwrap(), better.map(|m| m.settings.as_str())))
            .collect();
        assert_eq!(pairs, [("slow", Some("estimate")), ("fine", None), ("fast", None)]);
        let text = describe(&all).unwrap();
        let slow = text.lines().next().unwrap();
        for part in ["slow", "{ estimate }", "1000.00 ms per pattern and 0.010 mm"] {
            assert!(slow.contains(part), "{text}");
        }
        assert!(text.contains("fast: 500.00 ms per pattern") && text.contains("take 500.00 s of one core"));
        assert_eq!(describe(&all[..2]), None);
    }
}
