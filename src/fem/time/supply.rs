//! A source that charges the electrodes through a resistance: R Q̇ = Vₛ − Q/C(u), limited by its largest current.

use super::coefficients::Coefficients;
use deaflow_scene::Scene;

/// The source of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Supply {
    /// In Ω.
    resistance: f64,
    /// The largest current in A.
    limit: f64,
}

/// The electrodes at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Electrodes {
    /// Capacitance in F.
    capacitance: f64,
    /// Voltage of the source in V.
    source: f64,
}

impl Supply {
    /// Returns the source of a scene; `None` if its voltage is that of the electrodes.
    #[must_use]
    pub fn of(scene: &Scene) -> Option<Self> {
        let source = scene.drive.source.as_ref()?;
        let supply = Self {
            resistance: source.resistance.as_ref().map_or(0.0, |resistance| resistance.value()),
            limit: source
                .current_limit
                .as_ref()
                .map_or(f64::INFINITY, |limit| limit.value()),
        };
        (supply.resistance > 0.0 || supply.limit.is_finite()).then_some(supply)
    }

    /// Returns the time in s in which it charges this capacitance in F.
    #[must_use]
    pub fn time(&self, capacitance: f64, volts: f64) -> f64 {
        f64::max(self.resistance * capacitance, capacitance * volts / self.limit)
    }

    /// Returns the charge in C after a step from one capacitance in F to another, with the voltage of the source linear
    /// between times in s.
    #[must_use]
    pub fn charge_along(&self, charge: f64, [before, after]: [f64; 2], points: &[[f64; 2]]) -> f64 {
        let (start, whole) = (points[0][0], points[points.len() - 1][0] - points[0][0]);
        let at = |[time, source]: [f64; 2]| {
            let share = (time - start) / whole;
            Electrodes {
                capacitance: (1.0 - share) * before + share * after,
                source,
            }
        };
        points.windows(2).fold(charge, |charge, pair| {
            self.charge_after(pair[1][0] - pair[0][0], charge, at(pair[0]), at(pair[1]))
        })
    }

    /// Returns the charge in C after a step of some seconds, from the state of the electrodes before and after it. The
    /// result is exact for a constant capacitance and a voltage that is linear in time; otherwise it is of second order
    /// for any step.
    #[must_use]
    fn charge_after(&self, seconds: f64, charge: f64, before: Electrodes, after: Electrodes) -> f64 {
        let wanted = [before, after].map(|at| at.capacitance * at.source);
        let time = 0.5 * self.resistance * (before.capacitance + after.capacitance);
        let free = if time > 0.0 {
            let step = Coefficients::new(seconds / time);
            step.kept * charge + step.before * wanted[0] + step.now * wanted[1]
        } else {
            wanted[1]
        };
        let most = self.limit * seconds;
        charge + (free - charge).clamp(-most, most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A free sheet at κ = 0.4 behind a resistor, with time in units of R C₀ and voltage in that of the source: λ at
    /// some times, each after a number of steps.
    fn sheet(times: [f64; 2], steps: u32) -> [f64; 2] {
        let supply = Supply {
            resistance: 1.0,
            limit: f64::INFINITY,
        };
        // λ² − λ⁻⁴ = κ v² λ⁴, and C = λ⁴.
        let stretch = |volts: f64| {
            let mut l: f64 = 1.0;
            for _ in 0..60 {
                let load = 0.4 * volts * volts;
                let f = l.powi(2) - l.powi(-4) - load * l.powi(4);
                l -= f / (2.0 * l + 4.0 * l.powi(-5) - 4.0 * load * l.powi(3));
            }
            l
        };
        let (mut volts, mut charge, mut now) = (0.0, 0.0, 0.0);
        times.map(|end| {
            let length = (end - now) / f64::from(steps);
            for _ in 0..steps {
                let at = |volts: f64| Electrodes {
                    capacitance: stretch(volts).powi(4),
                    source: 1.0,
                };
                let before = at(volts);
                let mut next = volts;
                for _ in 0..200 {
                    let after = at(next);
                    // Near pull-in a full step would diverge.
                    next += 0.4 * (supply.charge_after(length, charge, before, after) / after.capacitance - next);
                }
                volts = next;
                charge = volts * at(volts).capacitance;
            }
            now = end;
            stretch(volts)
        })
    }

    #[test]
    fn a_free_sheet_charges_through_a_resistor_as_it_should() {
        let known = [1.026_304_172_889, 1.093_273_130_795];
        let errors = [100, 200, 400].map(|steps| {
            let found = sheet([1.0, 5.0], steps);
            [0, 1].map(|k| found[k] - known[k])
        });
        let [coarse, fine, finest] = errors;
        for ((coarse, fine), finest) in coarse.into_iter().zip(fine).zip(finest) {
            let ratio = coarse / fine;
            assert!((ratio - 4.0).abs() < 0.1, "{ratio}");
            let extrapolated = (4.0 * finest - fine) / 3.0;
            assert!(extrapolated.abs() < 1e-9, "{extrapolated:e}");
        }
    }

    #[test]
    fn a_current_limit_charges_in_proportion_to_time_and_no_resistance_at_once() {
        let at = Electrodes {
            capacitance: 2.0,
            source: 3.0,
        };
        let limited = Supply {
            resistance: 0.0,
            limit: 0.5,
        };
        assert_eq!(limited.charge_after(4.0, 1.0, at, at), 3.0);
        assert_eq!(limited.charge_after(400.0, 1.0, at, at), 6.0);
        let never = Supply {
            resistance: 1e18,
            limit: f64::INFINITY,
        };
        assert!(never.charge_after(1e3, 0.0, at, at) < 1e-14);
    }
}
