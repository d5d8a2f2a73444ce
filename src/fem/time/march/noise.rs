//! Steps under a drive with noise: it is averaged over steps, and counts as it is at requested times.

use super::{March, StepState};
use crate::continuation::StepFailure;
use crate::material::Material;
use crate::time::pass::{PassEnd, Steps};
use deaflow_scene::Side;

/// Shortest step towards a stop over the charging time of the electrodes.
const OF_CHARGING: f64 = 0.25;
/// Largest relative change of the displacement over that of the squared voltage at once.
const RESPONSE: f64 = 2.0;

impl<L: Material, F: Fn(f64) -> L> March<'_, '_, F> {
    /// Averages a drive with noise from a stop to the next one; in a first pass at the first of them, for steps of
    /// about a length.
    pub(super) fn smooth(&mut self, [now, stop]: [f64; 2], steps: Steps<'_>, length: f64) {
        let transient = self.transient;
        if !transient.noisy {
            return;
        }
        let mut times = vec![now];
        match steps {
            Steps::Within(_) => times.extend([1.0, 2.0].map(|count| now + count * length.min(0.5 * (stop - now)))),
            Steps::At(ends) => {
                let later = &ends[ends.partition_point(|end| *end <= now)..];
                times.extend(later.iter().take_while(|end| **end < stop));
                times.push(stop);
            }
        }
        self.smoothed = transient.smoothed(&times);
        self.smoothed_until = stop;
        self.is_off_average = now > 0.0 && !transient.is_fed_slowly();
        if let Steps::Within(_) = steps {
            self.smoothed = self.smoothed.only_at(now);
        }
    }

    /// Returns the longest step from a time before a stop. The charge of electrodes behind a source or leads follows
    /// noise the less the longer ago it was, so steps become shorter towards a stop, down to a row or a part of the
    /// charging time.
    pub(super) fn graded(&self, [now, stop]: [f64; 2]) -> f64 {
        let transient = self.transient;
        if !transient.noisy || !transient.is_fed_slowly() {
            return f64::INFINITY;
        }
        let points = transient.points([now, stop]);
        let row = points[points.len() - 1][0] - points[points.len() - 2][0];
        (0.5 * (stop - now)).max(row).max(OF_CHARGING * self.charging())
    }

    /// Returns the time in s in which a source charges the electrodes, or leads an element.
    fn charging(&self) -> f64 {
        let transient = self.transient;
        let supply = transient
            .supply
            .map(|supply| supply.time(self.capacitance(), transient.scene.voltage_v()));
        let conductor = || transient.conductor.as_ref().map(|conductor| conductor.time());
        supply.or_else(conductor).unwrap_or(0.0)
    }

    /// Returns the difference of the state at the end of a step from the extrapolated one. Noise that the average over
    /// short steps has left is no reason for shorter ones, over which it would be larger: what a change of the voltage
    /// explains, to which displacements and potentials respond at once, does not count.
    pub(super) fn off_guess(&self, found: &StepState, guess: &[f64], to: f64) -> f64 {
        let mut off: Vec<f64> = found.u.iter().zip(guess).map(|(a, b)| a - b).collect();
        let mut noise = 0.0;
        if !self.smoothed.is_empty() {
            let drive = self.transient.voltage_along(&self.smoothed, to, Side::Before);
            let extrapolated: f64 = self.weights(to).map(|(weight, past)| weight * past.drive).sum();
            noise = (drive - extrapolated).abs();
            let explained = RESPONSE * 2.0 * noise / drive.abs().max(noise).max(f64::MIN_POSITIVE);
            let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let moved = self.transient.moved(&found.u);
            let along = product(&off, &moved) / product(&moved, &moved).max(f64::MIN_POSITIVE);
            let along = along.max(-explained).min(explained);
            off.iter_mut().zip(&moved).for_each(|(off, u)| *off -= along * u);
        }
        let charged = self.charged_off(found, to, noise);
        off.iter().fold(charged, |largest, off| largest.max(off.abs()))
    }

    /// Changes to the average of the steps that follow a stop, where the voltage of electrodes is that of the drive.
    pub(super) fn meet_average(&mut self, now: f64) -> Result<(), PassEnd> {
        if !std::mem::take(&mut self.is_off_average) {
            return Ok(());
        }
        let volts = self.transient.voltage_along(&self.smoothed, now, Side::After);
        self.change_to(volts, now)?;
        self.pass.instants.pop();
        Ok(())
    }

    /// Changes to the voltage that the drive has at a requested time, and estimates the effect of its noise at the last
    /// one.
    pub(super) fn face_noise(&mut self, now: f64) -> Result<(), PassEnd> {
        let transient = self.transient;
        if self.smoothed.is_empty() {
            return Ok(());
        }
        if transient.times.last() == Some(&now) && self.estimates_noise {
            self.pass.noise = self.effect_of_noise(now);
        }
        if transient.is_fed_slowly() {
            return Ok(());
        }
        let side = if now > 0.0 { Side::Before } else { Side::After };
        let jumped = transient.knots.iter().any(|knot| knot.time == now && knot.jumps);
        let volts = transient.voltage(now, if jumped { Side::After } else { side });
        self.change_to(volts, now)?;
        self.is_off_average = true;
        // The state at the averaged voltage is no result.
        let last = self.pass.instants.len() - 1;
        self.pass.instants.swap_remove(last - 1);
        Ok(())
    }

    /// Changes the voltage of the electrodes within no time.
    fn change_to(&mut self, volts: f64, now: f64) -> Result<(), PassEnd> {
        let full = self.transient.scene.voltage_v();
        let share = if full > 0.0 { (volts / full).powi(2) } else { 0.0 };
        let start = self.u.clone();
        let found = self.solve(self.transient.problem.activity, 0.0, share, start);
        self.u = found.map_err(|failure| super::ended(failure, now, now))?;
        self.volts = volts;
        let recent = std::mem::take(&mut self.recent);
        self.accept(now, 0.0, true);
        self.recent = recent;
        Ok(())
    }

    /// Estimates the effect in mm of noise on the mean displacement at a time: of its variance, to which the average
    /// over steps does not respond. It is half the second difference of displacements with and without as much noise,
    /// where the voltage of the electrodes is that of the drive. Otherwise the variance adds to the squared voltage as
    /// far as the electrodes follow.
    fn effect_of_noise(&mut self, now: f64) -> f64 {
        let transient = self.transient;
        let activity = transient.problem.activity;
        let (full, variance) = (transient.scene.voltage_v(), self.smoothed.variance());
        if full <= 0.0 || variance <= 0.0 {
            return 0.0;
        }
        let here = transient.displacement(&self.u);
        if transient.is_fed_slowly() {
            let points = transient.points([0.0, now]);
            let row = now / (points.len() - 1) as f64;
            let followed = row / (row + 2.0 * self.charging());
            return 2.0 * followed * variance / self.volts.powi(2).max(variance) * here.max_magnitude();
        }
        let share = transient.share_along(&self.smoothed, now, Side::Before);
        let noise = variance.sqrt() / full.powi(2);
        let mut at = |share: f64| -> Result<_, StepFailure> {
            let start = self.u.clone();
            let found = self.solve(activity, 0.0, share.max(0.0), start)?;
            Ok(transient.displacement(&found))
        };
        match (at(share + noise), at(share - noise)) {
            (Ok(more), Ok(less)) => 0.5 * here.extrapolated(&more, 1.0).max_difference(&less),
            // Beyond the limit of stability the effect is unknown.
            _ => here.max_magnitude(),
        }
    }
}
