//! The largest voltages of a design.

use crate::format::{percents, three};

/// The voltages up to which a design can be driven, on a coarse mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoltageLimits {
    /// The voltage of the scene in V.
    pub voltage: f64,
    /// Where stability is lost, in V.
    pub lost: Option<f64>,
    /// Where the electric field reaches the breakdown field, in V, if that is before stability is lost.
    pub breakdown: Option<f64>,
    /// The electric field at the voltage of the scene relative to the breakdown field; `None` without a stable state.
    pub breakdown_share: Option<f64>,
    /// Whether the breakdown field is that of the usual acrylic elastomer, as the scene has none.
    pub is_breakdown_assumed: bool,
    /// The largest voltage with a stable state that was simulated, in V.
    pub reached: f64,
}

impl VoltageLimits {
    /// Lists the largest voltage and what ends it there, and the electric field at the voltage of the scene.
    pub(super) fn lines(&self) -> Vec<String> {
        let kilovolts = |volts: f64| format!("{} kV", three(volts / 1000.0));
        let ends = [
            (self.breakdown, "where the electric field reaches the breakdown field"),
            (self.lost, "where it loses stability"),
        ];
        let ends = ends.into_iter().filter_map(|(volts, why)| Some((volts?, why)));
        let largest = match ends.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((volts, why)) => {
                let share = percents(self.voltage / volts);
                format!(
                    "largest voltage: about {}, {why}; its own is {share} of it",
                    kilovolts(volts)
                )
            }
            None => format!("largest voltage: above {}", kilovolts(self.reached)),
        };
        let assumed = match self.is_breakdown_assumed {
            true => " (that of VHB 4910, as the scene has none)",
            false => "",
        };
        let field = self.breakdown_share.map(|share| {
            let own = self.voltage / 1000.0;
            format!(
                "electric field at {own} kV: {} of the breakdown field{assumed}",
                percents(share)
            )
        });
        std::iter::once(largest).chain(field).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_both_ends_counts() {
        let limits = VoltageLimits {
            voltage: 4000.0,
            lost: Some(6200.0),
            breakdown: None,
            breakdown_share: Some(0.61),
            is_breakdown_assumed: true,
            reached: 6190.0,
        };
        assert_eq!(
            limits.lines(),
            [
                "largest voltage: about 6.20 kV, where it loses stability; its own is 64.5 % of it",
                "electric field at 4 kV: 61.0 % of the breakdown field (that of VHB 4910, as the scene has none)",
            ]
        );
        let broken = VoltageLimits {
            breakdown: Some(5000.0),
            is_breakdown_assumed: false,
            ..limits
        };
        let [first, second] = &broken.lines()[..] else { panic!() };
        let broken = "largest voltage: about 5.00 kV, where the electric field reaches the breakdown field; ";
        assert_eq!(first, &format!("{broken}its own is 80.0 % of it"));
        assert_eq!(second, "electric field at 4 kV: 61.0 % of the breakdown field");
        let open = VoltageLimits {
            lost: None,
            breakdown_share: None,
            ..limits
        };
        assert_eq!(open.lines(), ["largest voltage: above 6.19 kV"]);
    }
}
