//! The rate of work and the remaining time. The rate is measured from the first progress of this process, without the
//! steps of an earlier process, the time to start, and pauses in which other work had the processors: it is that of the
//! last half to whole minute, if that contains some steps. During the first step, the estimate of the plan is mixed in,
//! with decreasing weight.

use super::table;

/// A step is overdue after this multiple of the longest time without progress.
const OVERDUE_FACTOR: f64 = 1.5;

/// Times without progress up to this are normal, s.
const NORMAL_PAUSE: f64 = 1.0;

/// The part of a step from which the rest is estimated without a plan.
const MIN_PART: f64 = 0.05;

/// The rate is that since the last mark but one, if there were enough steps since. Marks are this far apart, s.
const WINDOW: f64 = 30.0;
const MIN_STEPS: f64 = 5.0;

/// A pause longer than this part of the total time was spent waiting for processors.
const WAITING_PART: f64 = 0.8;

/// The progress of a piece of work. Times are in seconds since its start.
#[derive(Clone, Debug, Default)]
pub struct Pace {
    /// Finished steps.
    pub done: u64,
    /// The finished part of the current step.
    pub part: f64,
    /// Number of steps.
    pub length: u64,
    /// The estimated time of the plan, without steps of an earlier process.
    estimate: Option<f64>,
    /// Whether steps are of several kinds: finished ones say nothing of the rest.
    is_mixed: bool,
    /// Steps of an earlier process.
    before: u64,
    /// The time of the first progress, and the steps of this process until then.
    first: Option<(f64, f64)>,
    /// The time of the last progress.
    last: f64,
    /// The longest time between two reports of progress.
    longest: f64,
    /// The same without the time before the first one, and without those in which half of all steps were done.
    pause: f64,
    /// The steps of this process at the last progress.
    had: f64,
    /// The times of the last two marks, and the steps of this process until then.
    marks: [(f64, f64); 2],
}

impl Pace {
    /// Starts work of `length` steps with an estimated time.
    pub fn new(length: u64, estimate: Option<f64>) -> Self {
        Self {
            length,
            estimate,
            ..Self::default()
        }
    }

    /// The same for steps of several kinds, such as generations and refinements, of which only the plan can tell how
    /// long the rest takes.
    pub fn of_several_kinds(self) -> Self {
        Self { is_mixed: true, ..self }
    }

    /// Sets the number of finished steps, and of all.
    pub fn set(&mut self, at: f64, done: u64, length: u64) {
        (self.done, self.part, self.length) = (done, 0.0, length);
        self.record(at);
    }

    /// Adds finished steps.
    pub fn advance(&mut self, at: f64, steps: u64) {
        self.done += steps;
        self.part = 0.0;
        self.record(at);
    }

    /// Sets the finished part of the current step.
    pub fn set_part(&mut self, at: f64, part: f64) {
        self.part = part.clamp(0.0, 1.0);
        self.record(at);
    }

    /// Adds steps of an earlier process.
    pub fn resume(&mut self, at: f64, steps: u64) {
        self.done += steps;
        self.before += steps;
        self.record(at);
    }

    /// Returns the finished steps, with the part of the current one.
    pub fn position(&self) -> f64 {
        self.done as f64 + self.part
    }

    /// Records progress. If the first progress is a whole step, its time includes the start of the process.
    fn record(&mut self, at: f64) {
        let own = self.own();
        let first = if own < 1.0 { (at, own) } else { (0.0, 0.0) };
        if self.first.is_some() || own >= 1.0 {
            self.longest = self.longest.max(at - self.last);
        }
        if self.first.is_some() && 2.0 * (own - self.had) <= own {
            self.pause = self.pause.max(at - self.last);
        }
        self.had = own;
        if at - self.marks[1].0 >= WINDOW {
            self.marks = [self.marks[1], (at, own)];
        }
        self.last = at;
        self.first.get_or_insert(first);
    }

    /// Returns the time since the last progress, s, if it is unusually long: the current step takes longer than earlier
    /// ones.
    fn overdue(&self, at: f64) -> Option<f64> {
        let silent = at - self.last;
        let is_last_of_all = self.position() >= self.length as f64;
        let is_measured = self.rate(at).is_some() && !is_last_of_all;
        (is_measured && silent > OVERDUE_FACTOR * self.longest.max(NORMAL_PAUSE)).then_some(silent)
    }

    /// Returns the steps of this process.
    fn own(&self) -> f64 {
        self.position() - self.before as f64
    }

    /// Returns the steps per second; none before the first measurement.
    fn rate(&self, at: f64) -> Option<f64> {
        let (from, had) = self.first?;
        let since = |(from, had): (f64, f64)| (at - from, self.own() - had);
        let (recently, did) = since(self.marks[0]);
        if self.marks[0].0 > from && did >= MIN_STEPS {
            return Some(did / recently);
        }
        let (took, did) = since((from, had));
        let is_waiting = did >= 2.0 && self.pause > WAITING_PART * took;
        (took > 0.0 && did > 0.0 && !is_waiting).then(|| did / took)
    }

    /// Returns the rest of the estimated time, s; none once it is over.
    fn estimate_left(&self, at: f64) -> Option<f64> {
        self.estimate.map(|all| all - at).filter(|left| *left > 0.0)
    }

    /// Returns the remaining time, s, if it is known.
    fn left(&self, at: f64) -> Option<f64> {
        let steps = (self.length as f64 - self.position()).max(0.0);
        // A small part of the first step is not representative.
        let is_known = |_: &f64| self.estimate.is_some() || self.own() >= MIN_PART;
        // Without progress the rate is not measured anew: the time left must not rise while nothing moves.
        let rest = |rate: f64| (steps / rate - (at - self.last)).max(0.0);
        let measured = self.rate(self.last).map(rest).filter(is_known);
        match (measured, self.estimate) {
            _ if self.is_mixed && self.length > 1 => self.estimate_left(at),
            _ if self.overdue(at).is_some() => None,
            (Some(measured), Some(estimate)) => {
                let weight = self.own().min(1.0);
                Some(weight * measured + (1.0 - weight) * (estimate - at).max(0.0))
            }
            (Some(measured), None) => Some(measured),
            (None, _) => self.estimate_left(at),
        }
    }

    /// Describes the rate in steps per second or minute, and the remaining time; empty if nothing is known.
    pub fn describe(&self, at: f64) -> String {
        let left = self.left(at).filter(|left| *left > 0.0).map(table::seconds);
        match (self.rate(self.last), left) {
            (Some(per_second), Some(left)) => format!("{}, {left} left", rate(per_second)),
            (Some(per_second), None) if self.overdue(at).is_some() => {
                let silent = at - self.last;
                format!("{}, current step: {}", rate(per_second), table::seconds(silent))
            }
            // All steps are finished; their results are being combined.
            (Some(per_second), None) => rate(per_second),
            (None, Some(left)) => format!("about {left} left"),
            (None, None) => String::new(),
        }
    }
}

/// Formats a rate: steps longer than a second are counted per minute.
fn rate(per_second: f64) -> String {
    if per_second > 0.0 && per_second < 1.0 {
        format!("{:.1}/min", 60.0 * per_second)
    } else {
        format!("{per_second:.1}/s")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_steps_are_counted_by_the_minute() {
        assert_eq!(
            [0.0, 0.05, 0.999, 1.0, 12.34].map(rate),
            ["0.0/s", "3.0/min", "59.9/min", "1.0/s", "12.3/s"]
        );
    }

    #[test]
    fn steps_of_an_earlier_process_are_no_part_of_the_rate() {
        let mut pace = Pace::new(40, None);
        pace.resume(5.0, 30);
        assert_eq!((pace.position(), pace.describe(6.0)), (30.0, String::new()));
        // One step takes 4 s, 9 are left; that 31 of 40 are done after 9 s says otherwise.
        pace.advance(9.0, 1);
        assert_eq!(pace.describe(9.0), "15.0/min, 36.0 s left");
    }

    #[test]
    fn to_begin_is_no_step() {
        let mut pace = Pace::new(10, None);
        // After 20 s of reading, steps of 2 s.
        pace.set_part(20.0, 0.0);
        pace.set_part(21.0, 0.5);
        assert_eq!(pace.describe(21.0), "30.0/min, 19.0 s left");
        // Where the first that is heard of is a whole step, it began at the beginning.
        let mut pace = Pace::new(10, None);
        pace.advance(2.0, 1);
        assert_eq!(pace.describe(2.0), "30.0/min, 18.0 s left");
    }

    #[test]
    fn a_step_that_takes_longer_than_any_before_has_no_time_left() {
        let mut pace = Pace::new(41, Some(5.0));
        for step in 1..=40 {
            pace.advance(0.25 * f64::from(step), 1);
        }
        assert_eq!(pace.describe(10.0), "4.0/s, 0.25 s left");
        assert_eq!(pace.describe(10.1), "4.0/s, 0.15 s left");
        assert_eq!(pace.describe(10.5), "4.0/s", "half a second says nothing");
        assert_eq!(pace.describe(14.0), "4.0/s, current step: 4.00 s");
        pace.advance(15.0, 1);
        assert_eq!(pace.describe(20.5), "2.7/s", "all steps are done");
        // Where steps are long, nothing is heard for as long.
        let mut pace = Pace::new(4, None);
        pace.advance(20.0, 1);
        assert_eq!(pace.describe(45.0), "3.0/min, 35.0 s left");
        assert_eq!(pace.describe(55.0), "3.0/min, current step: 35.0 s");
    }

    #[test]
    fn finished_steps_of_another_kind_do_not_tell_the_time_left() {
        // Fast generations, and a refinement that takes minutes.
        let generations = |estimate| {
            let mut pace = Pace::new(14, estimate).of_several_kinds();
            for step in 1..=13 {
                pace.advance(0.2 * f64::from(step), 1);
            }
            pace
        };
        assert_eq!(generations(None).describe(2.6), "5.0/s");
        // The plan knows the time of an earlier build.
        assert_eq!(generations(Some(60.0)).describe(2.6), "5.0/s, 57.4 s left");
        assert_eq!(generations(Some(60.0)).describe(30.0), "5.0/s, 30.0 s left");
        assert_eq!(generations(Some(60.0)).describe(60.0), "5.0/s, current step: 57.4 s");
        // A single step has parts of one kind.
        let mut single = Pace::new(1, None).of_several_kinds();
        single.set_part(0.0, 0.0);
        single.set_part(10.0, 0.5);
        assert_eq!(single.describe(10.0), "3.0/min, 10.0 s left");
    }

    /// Checks that the time left falls without progress, from one time to another, until it is not known or over.
    fn falls(pace: &Pace, from: f64, to: f64) {
        let mut before = f64::INFINITY;
        for tenth in 0..=(10.0 * (to - from)) as u32 {
            let at = from + 0.1 * f64::from(tenth);
            let left = pace.left(at).unwrap_or(0.0);
            assert!(
                left < before || (left, before) == (0.0, 0.0),
                "{left} after {before} at {at} s"
            );
            before = left;
        }
    }

    #[test]
    fn the_time_left_never_rises_while_nothing_moves() {
        let mut pace = Pace::new(100, None);
        for second in [3.0, 6.0, 9.0] {
            pace.advance(second, 1);
        }
        assert_eq!(pace.left(9.0), Some(291.0));
        falls(&pace, 9.0, 60.0);
        // Within the first step, also when the time of the plan is over.
        for estimate in [None, Some(5.0), Some(30.0), Some(500.0)] {
            let mut pace = Pace::new(10, estimate);
            falls(&pace, 0.0, 10.0);
            pace.set_part(10.0, 0.0);
            pace.set_part(20.0, 0.5);
            falls(&pace, 20.0, 600.0);
            pace.resume(600.0, 3);
            falls(&pace, 600.0, 700.0);
        }
        // A last minute that was faster than those before.
        let mut pace = Pace::new(10_000, None);
        for second in 1..=300 {
            pace.advance(f64::from(second), 1 + u64::from(second > 200) * 9);
        }
        falls(&pace, 300.0, 1000.0);
    }

    #[test]
    fn what_waits_for_others_has_no_rate_and_then_that_of_its_own_work() {
        let mut pace = Pace::new(4000, None);
        pace.advance(1.0, 1);
        pace.advance(2.0, 1);
        assert!(pace.describe(2.0).starts_with("1.0/s, 1 h 0"), "{}", pace.describe(2.0));
        // For minutes others have the processors.
        pace.advance(240.0, 1);
        assert_eq!(pace.describe(240.0), "");
        for second in 241..=300 {
            pace.advance(f64::from(second), 10);
        }
        assert_eq!(pace.describe(300.0), "10.0/s, 5 min 40 s left");
    }

    #[test]
    fn of_a_small_part_of_the_first_step_nobody_can_tell() {
        let mut pace = Pace::new(7, None);
        pace.set_part(1.0, 0.0);
        pace.set_part(3.0, 0.01);
        assert_eq!(pace.describe(3.0), "0.3/min");
        pace.set_part(5.0, 0.5);
        assert_eq!(pace.describe(5.0), "7.5/min, 52.0 s left");
    }

    #[test]
    fn what_was_foretold_counts_within_the_first_step_alone() {
        let mut pace = Pace::new(10, Some(100.0));
        assert_eq!(pace.describe(10.0), "about 1 min 30 s left");
        pace.set_part(10.0, 0.0);
        pace.set_part(20.0, 0.5);
        // Measured 0.05 steps a second, so that 190 s are left; foretold 80 s: half of each.
        assert_eq!(pace.describe(20.0), "3.0/min, 2 min 15 s left");
        pace.advance(30.0, 1);
        assert_eq!(pace.describe(30.0), "3.0/min, 3 min 00 s left");
        // What has taken longer than foretold is not foretold any more.
        let late = Pace::new(10, Some(5.0));
        assert_eq!(late.describe(6.0), "");
        // What an earlier process has done is no part of what was foretold.
        let mut resumed = Pace::new(10, Some(10.0));
        resumed.resume(2.0, 9);
        assert_eq!(resumed.describe(2.0), "about 8.00 s left");
    }
}
