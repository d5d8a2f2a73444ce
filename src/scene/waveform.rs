//! The waveform of a voltage.

use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::path::Path;

use serde_json::json;

use deaflow_base::{
    Canonical, Decimal, Declared, Dimension, Fields, Frequency, InputError, Map, Node, NodeValue, Parameter, Quantity,
    QuantityError, Schema, Time, Voltage, confined, parameters,
};

/// The largest number of rows of a table.
const MOST_ROWS: usize = 1_000_000;
/// The largest file of a table in bytes.
const MOST_BYTES: u64 = 64 << 20;
/// The largest absolute voltage of a table in V.
const LARGEST: f64 = 1e6;
/// The largest time of a table in s.
const LATEST: f64 = 1e12;
/// Number of rows below which a table has no noise, and the sum of the distances of all rows from a smooth drive,
/// relative to the largest squared voltage, above which it has noise. Larger distances of a row are corners.
const FEWEST_NOISY: usize = 200;
const NOISY: f64 = 0.2;
const CORNER: f64 = 0.05;
/// The allowed forms of a table.
const ROWS: &str = "allowed: a file with the columns t_s,voltage_V in the folder of the scene, \
                    or rows as in [[0 s, 0 V], [1 s, 5 kV]]";
/// The columns of a table.
const HEADER: [&str; 2] = ["t_s", "voltage_V"];

parameters! {
    /// How the voltage changes in time: one of these. `voltage` is its amplitude.
    pub struct Waveform as "`waveform`" {
        /// Constant from 0 s on.
        pub step: Option<Step>,
        /// Proportional to time, then constant.
        pub ramp: Option<Ramp>,
        /// A sine around a bias.
        pub sine: Option<Sine>,
        /// A table, linear between its rows and constant beyond them.
        pub table: Option<Table>,
    }
    rules(one_of)
    check(check)
}

parameters! {
    /// No parameters.
    #[derive(Default)]
    pub struct Step as "`step`" {}
}

parameters! {
    /// Proportional to time, then constant.
    pub struct Ramp as "`ramp`" {
        /// The time at which the voltage is reached.
        pub time: Time [1e-12..=1e12],
    }
}

parameters! {
    /// V(t) = bias + voltage · sin(2πft).
    pub struct Sine as "`sine`" {
        /// The frequency f.
        pub frequency: Frequency [1e-9..=1e9],
        /// The mean voltage.
        pub bias: Voltage [0.0..=1e6] = "0 V",
    }
}

fn one_of(fields: Fields) -> Fields {
    fields.exactly_one(&Waveform::keys())
}

fn check(waveform: &Waveform, map: &Map<'_>) -> Result<(), InputError> {
    let Waveform {
        step,
        ramp,
        sine,
        table,
    } = waveform;
    let given = [step.is_some(), ramp.is_some(), sine.is_some(), table.is_some()];
    match given.into_iter().filter(|given| *given).count() {
        1 => Ok(()),
        found => Err(map
            .error(format!(
                "a waveform must have one of {}, found {found}",
                Waveform::keys().join(", ")
            ))
            .help(
                "for example { step: {} }, { ramp: { time: 1 s } }, { sine: { frequency: 1 Hz } } \
                 or { table: drive.csv }",
            )),
    }
}

/// Times in s and voltages in V. Two rows at the same time are a jump.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table(Vec<[Decimal; 2]>);

impl Table {
    /// Returns the times and voltages.
    fn rows(&self) -> impl Iterator<Item = [f64; 2]> {
        self.0.iter().map(in_units)
    }

    fn largest(&self) -> f64 {
        self.rows()
            .fold(0.0, |largest, [_, voltage]| f64::max(largest, voltage.abs()))
    }

    /// Creates a table from rows and their names, which error messages begin with.
    fn of_rows(rows: Vec<([Decimal; 2], String)>) -> Result<Self, String> {
        if rows.len() < 2 {
            return Err(format!("at least two rows are needed, found {}", rows.len()));
        }
        if rows.len() > MOST_ROWS {
            return Err(format!("at most {MOST_ROWS} rows are allowed, found {}", rows.len()));
        }
        let mut before = 0.0;
        for ([time, voltage], name) in &rows {
            let (time, voltage) = (time.to_f64(), voltage.to_f64());
            if !(0.0..=LATEST).contains(&time) {
                return Err(format!("{name}: the time {time} s is not between 0 and {LATEST:e} s"));
            }
            if time < before {
                return Err(format!(
                    "{name}: the time {time} s follows {before} s; times must not decrease"
                ));
            }
            if voltage.abs() > LARGEST {
                return Err(format!("{name}: {voltage} V is larger than {LARGEST:e} V"));
            }
            before = time;
        }
        Ok(Self(rows.into_iter().map(|(row, _)| row).collect()))
    }

    /// Reads the columns of a file.
    fn of_file(file: &mut deaflow_base::Table) -> Result<Self, String> {
        let [time, voltage] = file.columns(HEADER).map_err(|e| e.to_string())?;
        let mut rows = Vec::new();
        while let Some(row) = file.next_row().map_err(|e| e.to_string())? {
            let read = |at: usize, what: &str, allowed: &str| {
                row.with_point(at)?.parse::<Decimal>().map_err(|error| match error {
                    QuantityError::OutOfRange(number) => row.error(format!("the {what} {number} is not {allowed}")),
                    _ if row.field(at).is_empty() => row.error(format!("the {what} is empty")),
                    _ => row.error(format!("{:?} is not a number", row.field(at))),
                })
            };
            let time = read(time, "time", &format!("between 0 and {LATEST:e} s"));
            let voltage = read(voltage, "voltage", &format!("between -{LARGEST:e} and {LARGEST:e} V"));
            let values = [time.map_err(|e| e.to_string())?, voltage.map_err(|e| e.to_string())?];
            rows.push((values, format!("line {}", row.line)));
        }
        Self::of_rows(rows)
    }
}

impl Parameter for Table {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        if let NodeValue::List(items) = node.value() {
            let mut rows = Vec::new();
            for (at, item) in items.iter().enumerate() {
                let [time, voltage] = item.list(key)? else {
                    return Err(item
                        .error("a row of a table needs a time and a voltage")
                        .help("for example [0.5 s, 5 kV]"));
                };
                let time = time.quantity_in(key, Dimension::Time, 0.0, LATEST)?;
                let voltage = voltage.quantity_in(key, Dimension::Voltage, -LARGEST, LARGEST)?;
                rows.push(([time.base(), voltage.base()], format!("row {}", at + 1)));
            }
            return Self::of_rows(rows).map_err(|why| node.error(format!("the table: {why}")).help(ROWS));
        }
        if matches!(node.value(), NodeValue::Map(_)) {
            return Err(node.error(format!("`{key}` is {}", node.found())).help(ROWS));
        }
        let name = Path::new(node.text(key)?);
        let folder = node.file().parent().unwrap_or(Path::new(""));
        let refused = |why: &str| node.error(format!("the table {}: {why}", folder.join(name).display()));
        let found = confined(folder, name).map_err(|why| refused(&why.to_string()).help(why.help()))?;
        let file = deaflow_base::Table::open(&found, MOST_BYTES);
        let mut file = file.map_err(|e| refused(&e.to_string()))?;
        Self::of_file(&mut file).map_err(|why| {
            refused(&why).help("the file needs the columns t_s,voltage_V and at least two rows, sorted by time")
        })
    }

    fn canonical(&self) -> Option<Canonical> {
        let row = |[time, voltage]: &[Decimal; 2]| {
            let quantities = [(time, Dimension::Time), (voltage, Dimension::Voltage)];
            let entries = quantities.map(|(value, dimension)| Canonical::from(&Quantity::new(*value, dimension)));
            Canonical::List(entries.into())
        };
        Some(Canonical::List(self.0.iter().map(row).collect()))
    }

    fn schema((): &()) -> Schema {
        let row = json!({
            "type": "array",
            "prefixItems": [
                serde_json::Value::from(Schema::quantity(Dimension::Time, 0.0, LATEST)),
                serde_json::Value::from(Schema::quantity(Dimension::Voltage, -LARGEST, LARGEST)),
            ],
            "minItems": 2,
            "maxItems": 2,
        });
        Schema::any_of([
            Schema::text().description("A file in the folder of the scene with the columns t_s,voltage_V."),
            Schema::list(Schema::new(row), 2, MOST_ROWS),
        ])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

/// A jump or a kink of a waveform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knot {
    /// The time in s.
    pub time: f64,
    /// Whether the voltage jumps.
    pub jumps: bool,
    /// In V²: the distance of the squared voltage from the line between the rows before and after it in a table;
    /// infinite in other waveforms.
    pub offset: f64,
}

/// The side of a time, since at a jump the voltages just before and just after differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Just before.
    Before,
    /// Just after.
    After,
}

impl Waveform {
    /// Returns a step.
    #[must_use]
    pub fn of_step() -> Self {
        Self {
            step: Some(Step {}),
            ramp: None,
            sine: None,
            table: None,
        }
    }

    /// Returns a table of times in s and voltages in V.
    ///
    /// # Errors
    /// When there are fewer than two rows, times decrease or are negative, or a number is out of range, with the reason.
    pub fn of_table(rows: &[[f64; 2]]) -> Result<Self, String> {
        let row = |(at, row): (usize, &[f64; 2])| {
            let name = format!("row {}", at + 1);
            let [Some(time), Some(voltage)] = row.map(Decimal::from_f64) else {
                return Err(format!("{name}: a number is not finite"));
            };
            Ok(([time, voltage], name))
        };
        let rows = rows.iter().enumerate().map(row).collect::<Result<_, String>>()?;
        Ok(Self {
            table: Some(Table::of_rows(rows)?),
            step: None,
            ramp: None,
            sine: None,
        })
    }

    /// Returns the largest voltage of a table in V.
    #[must_use]
    pub fn table_voltage_v(&self) -> Option<f64> {
        self.table.as_ref().map(Table::largest)
    }

    /// Returns the voltage in V at a time in s, for an amplitude in V; it is zero before 0 s.
    #[must_use]
    pub fn voltage(&self, amplitude: f64, time: f64, side: Side) -> f64 {
        if time < 0.0 || (time == 0.0 && side == Side::Before) {
            return 0.0;
        }
        if let Some(ramp) = &self.ramp {
            return amplitude * (time / ramp.time.value()).min(1.0);
        }
        if let Some(sine) = &self.sine {
            return sine.bias.value() + amplitude * (TAU * sine.frequency.value() * time).sin();
        }
        match &self.table {
            Some(table) => table.voltage(time, side),
            None => amplitude,
        }
    }

    /// Returns times in s and voltages in V between which the voltage is linear, from one time to a later one, without
    /// a jump in between: the rows of a table and both ends. Of other waveforms it returns the ends only.
    #[must_use]
    pub fn points(&self, amplitude: f64, from: f64, to: f64) -> Vec<[f64; 2]> {
        let between = self.table.as_ref().map_or(&[][..], |table| table.between(from, to));
        let mut points = vec![[from, self.voltage(amplitude, from, Side::After)]];
        points.extend(between.iter().map(in_units));
        points.push([to, self.voltage(amplitude, to, Side::Before)]);
        points
    }

    /// Returns the jumps and kinks before a time in s, in order. The first is at 0 s.
    #[must_use]
    pub fn knots(&self, until: f64) -> Vec<Knot> {
        let knot = |time: f64, jumps: bool| Knot {
            time,
            jumps,
            offset: f64::INFINITY,
        };
        let mut knots = vec![knot(0.0, self.voltage(1.0, 0.0, Side::After) != 0.0)];
        if let Some(ramp) = &self.ramp {
            knots.push(knot(ramp.time.value(), false));
        }
        knots.extend(self.table.iter().flat_map(Table::knots));
        knots.dedup_by(|a, b| a.time == b.time);
        knots.retain(|knot| knot.time < until);
        knots
    }

    /// Returns the noise of a table: the typical distance in V² of the squared voltage of a row from a smooth curve
    /// through the neighbouring rows; `None` for a drive without noise.
    #[must_use]
    pub fn noise(&self) -> Option<f64> {
        self.table.as_ref()?.noise()
    }

    /// Returns the angular frequency of a sine in 1/s.
    #[must_use]
    pub fn angular_frequency(&self) -> Option<f64> {
        self.sine.as_ref().map(|sine| TAU * sine.frequency.value())
    }

    /// Returns the time in s in which the voltage changes: the time of a ramp, 1/(2πf) of a sine, of a table twice the
    /// shortest time in which half of its range passes; `None` for a step.
    #[must_use]
    pub fn time_s(&self) -> Option<f64> {
        let ramp = self.ramp.as_ref().map(|ramp| ramp.time.value());
        ramp.or_else(|| self.angular_frequency().map(f64::recip))
            .or_else(|| self.table.as_ref()?.time_s())
    }
}

/// Returns the time in s and the voltage in V of a row.
fn in_units(row: &[Decimal; 2]) -> [f64; 2] {
    row.each_ref().map(|value| value.to_f64())
}

impl Table {
    /// Returns the rows between two times, without those at these times.
    fn between(&self, from: f64, to: f64) -> &[[Decimal; 2]] {
        let first = self.0.partition_point(|[time, _]| time.to_f64() <= from);
        let rows = &self.0[first..];
        &rows[..rows.partition_point(|[time, _]| time.to_f64() < to)]
    }

    /// Returns the noise of the squared voltage: the median difference of the offset of a row, from the line through
    /// its neighbours, from the mean offset of its neighbours. Offsets of a smooth drive change little from row to row.
    /// There is noise if the sum of these differences, without corners, exceeds a fraction of the largest squared
    /// voltage.
    fn noise(&self) -> Option<f64> {
        let rows: Vec<[f64; 2]> = self.rows().map(|[time, voltage]| [time, voltage * voltage]).collect();
        if rows.len() < FEWEST_NOISY {
            return None;
        }
        let offset = |rows: &[[f64; 2]]| {
            let [[start, low], [time, square], [end, high]] = [rows[0], rows[1], rows[2]];
            square - (low + (high - low) * (time - start) / (end - start))
        };
        let without_jumps = rows
            .windows(5)
            .filter(|rows| rows.windows(2).all(|pair| pair[0][0] < pair[1][0]));
        let mut distances: Vec<f64> = without_jumps
            .map(|rows| (offset(&rows[1..4]) - 0.5 * (offset(&rows[..3]) + offset(&rows[2..]))).abs())
            .collect();
        let largest = rows.iter().fold(0.0, |largest: f64, [_, square]| largest.max(*square));
        let small = distances.iter().filter(|distance| **distance <= CORNER * largest);
        if small.sum::<f64>() <= NOISY * largest {
            return None;
        }
        let middle = distances.len() / 2;
        let (_, level, _) = distances.select_nth_unstable_by(middle, f64::total_cmp);
        Some(*level)
    }

    /// Returns the jumps and kinks at the rows after 0 s.
    fn knots(&self) -> Vec<Knot> {
        let rows: Vec<[f64; 2]> = self.rows().collect();
        // Rows at one time.
        let mut groups: Vec<(f64, f64, f64)> = Vec::new();
        for [time, voltage] in rows {
            match groups.last_mut() {
                Some((last, _, after)) if *last == time => *after = voltage,
                _ => groups.push((time, voltage, voltage)),
            }
        }
        let square = |voltage: f64| voltage * voltage;
        let knot = |at: usize| {
            let (time, before, after) = groups[at];
            let left = at.checked_sub(1).map(|at| (groups[at].0, square(groups[at].2)));
            let right = groups.get(at + 1).map(|next| (next.0, square(next.1)));
            let line = match (left, right) {
                (Some((start, low)), Some((end, high))) => low + (high - low) * (time - start) / (end - start),
                // The voltage beyond the table would be that of the next row.
                (Some((_, only)), None) | (None, Some((_, only))) => only,
                (None, None) => square(before),
            };
            Knot {
                time,
                jumps: before != after,
                offset: (square(before) - line).abs().max((square(after) - line).abs()),
            }
        };
        let later = (0..groups.len()).filter(|at| groups[*at].0 > 0.0);
        later.map(knot).collect()
    }

    /// Returns the time in s in which the voltage changes: twice the shortest time in which it changes by half of its
    /// range without a jump, or the shortest time between two jumps of that height, whichever is shorter. So the time
    /// of a ramp does not depend on the number of its rows, nor on noise. `None` without such changes.
    fn time_s(&self) -> Option<f64> {
        let rows: Vec<[f64; 2]> = self.rows().collect();
        let extremes = |rows: &[[f64; 2]]| {
            rows.iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [_, voltage]| {
                    [low.min(*voltage), high.max(*voltage)]
                })
        };
        // Before 0 s the voltage is 0.
        let [low, high] = extremes(&rows);
        let half = 0.5 * (high.max(0.0) - low.min(0.0));
        if half <= 0.0 {
            return None;
        }
        let parts: Vec<&[[f64; 2]]> = rows.chunk_by(|one, other| one[0] < other[0]).collect();
        let changes = parts.iter().filter_map(|part| shortest_change(part, half));
        let ends = parts.iter().flat_map(|part| [part[0], part[part.len() - 1]]);
        let sides: Vec<[f64; 2]> = std::iter::once([0.0; 2]).chain(ends).collect();
        // The end of a part and the start of the next one are the sides of a jump.
        let jumps = sides
            .chunks_exact(2)
            .filter(|pair| (pair[1][1] - pair[0][1]).abs() >= half);
        let times: Vec<f64> = jumps.map(|pair| pair[0][0]).collect();
        let gaps = times.windows(2).map(|pair| pair[1] - pair[0]);
        changes.map(|time| 2.0 * time).chain(gaps).reduce(f64::min)
    }

    fn voltage(&self, time: f64, side: Side) -> f64 {
        let at = |row: usize| in_units(&self.0[row]);
        // The first later row; of rows at the same time, the last one counts just after it.
        let later = self.0.partition_point(|[row, _]| match side {
            Side::Before => row.to_f64() < time,
            Side::After => row.to_f64() <= time,
        });
        if later == 0 {
            return at(0)[1];
        }
        if later == self.0.len() {
            return at(later - 1)[1];
        }
        let ([start, low], [end, high]) = (at(later - 1), at(later));
        low + (high - low) * (time - start) / (end - start)
    }
}

/// Returns the shortest time in s in which the voltage of some rows changes by a number of V: of a longer change, the
/// share with its mean slope. Times increase.
fn shortest_change(rows: &[[f64; 2]], volts: f64) -> Option<f64> {
    let mut shortest: Option<f64> = None;
    // Rows that may be the lowest and the highest before a later row: none after them is lower or higher.
    let mut before: [VecDeque<[f64; 2]>; 2] = Default::default();
    for &[time, voltage] in rows {
        for (before, sign) in before.iter_mut().zip([1.0, -1.0]) {
            while let Some([earlier, extreme]) = before.front().copied() {
                let change = sign * (voltage - extreme);
                if change < volts {
                    break;
                }
                let took = (time - earlier) * volts / change;
                shortest = Some(shortest.map_or(took, |shortest| shortest.min(took)));
                before.pop_front();
            }
            while before
                .back()
                .is_some_and(|[_, extreme]| sign * extreme >= sign * voltage)
            {
                before.pop_back();
            }
            before.push_back([time, voltage]);
        }
    }
    shortest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Result<Table, String> {
        Table::of_file(&mut deaflow_base::Table::of_bytes(text.into()).unwrap())
    }

    fn of_table(text: &str) -> Waveform {
        Waveform {
            step: None,
            table: Some(table(text).unwrap()),
            ..Waveform::of_step()
        }
    }

    #[test]
    fn tables_are_linear_between_rows_and_jump_where_two_rows_share_a_time() {
        let waveform = of_table("t_s,voltage_V\n0,0\n1,1000\n1,3000\n2,3000\n");
        let volts = |time, side| waveform.voltage(5.0, time, side);
        assert_eq!(volts(0.5, Side::After), 500.0);
        assert_eq!((volts(1.0, Side::Before), volts(1.0, Side::After)), (1000.0, 3000.0));
        assert_eq!(
            (volts(7.0, Side::After), waveform.table_voltage_v()),
            (3000.0, Some(3000.0))
        );
        let knots = waveform.knots(10.0);
        assert_eq!(
            knots.iter().map(|knot| (knot.time, knot.jumps)).collect::<Vec<_>>(),
            [(0.0, false), (1.0, true), (2.0, false)]
        );
        assert_eq!(waveform.knots(1.5).len(), 2);
        // Without the last row the squared voltage would be the same, without the second row lower by a square.
        let offsets: Vec<f64> = waveform.knots(10.0).iter().map(|knot| knot.offset).collect();
        assert_eq!(offsets[2], 0.0);
        assert_eq!(offsets[1], 9e6 - 4.5e6);
        assert_eq!(
            waveform.points(5.0, 0.5, 1.0),
            [[0.5, 500.0], [1.0, 1000.0]],
            "up to the jump"
        );
        assert_eq!(
            waveform.points(5.0, 1.0, 3.0),
            [[1.0, 3000.0], [2.0, 3000.0], [3.0, 3000.0]]
        );
    }

    #[test]
    fn the_time_of_a_table_is_that_of_its_change_and_not_that_of_its_rows() {
        let rows = |rows: &mut dyn Iterator<Item = (f64, f64)>| {
            let lines: Vec<String> = rows.map(|(time, volts)| format!("{time},{volts}")).collect();
            of_table(&format!("t_s,voltage_V\n{}\n", lines.join("\n"))).time_s()
        };
        let ramp = |count: u32, noise: f64| {
            rows(&mut (0..=count).map(|k| {
                let share = f64::from(k) / f64::from(count);
                // Reproducible noise of both signs.
                (2.0 * share, 1e3 * share + noise * (2.3 * f64::from(k * k)).sin())
            }))
            .unwrap()
        };
        assert_eq!(ramp(1, 0.0), 2.0);
        for (count, noise, tolerance) in [(10, 0.0, 1e-9), (1000, 0.0, 1e-9), (1000, 5.0, 0.05)] {
            let found = ramp(count, noise);
            assert!((found / 2.0 - 1.0).abs() < tolerance, "{count} {noise}: {found}");
        }
        // A sine: about its time, 1/ω.
        let sine = rows(&mut (0..=1000).map(|k| (1e-3 * f64::from(k), (TAU * 1e-3 * f64::from(k)).sin()))).unwrap();
        assert!((0.9..=2.2).contains(&(sine * TAU)), "{sine}");
        // Pulses last from jump to jump; a step does not change.
        let pulses = [(0.0, 5.0), (1.0, 5.0), (1.0, 0.0), (3.0, 0.0), (3.0, 5.0), (9.0, 5.0)];
        assert_eq!(rows(&mut pulses.into_iter()), Some(1.0));
        assert_eq!(rows(&mut [(0.0, 5.0), (1.0, 5.0)].into_iter()), None);
    }

    #[test]
    fn rows_that_a_line_passes_have_a_small_offset() {
        // A quarter of a sine of a thousand rows that stays at its end: each row is on the line between its
        // neighbours within 1e-5 of the largest square.
        let quarter = |k: u32| (1e-3 * f64::from(k), 5e3 * (0.25e-3 * TAU * f64::from(k)).sin());
        let lines: Vec<String> = (0..=1000)
            .map(quarter)
            .map(|(time, volts)| format!("{time},{volts}"))
            .collect();
        let waveform = of_table(&format!("t_s,voltage_V\n{}\n", lines.join("\n")));
        let knots = waveform.knots(2.0);
        assert_eq!(knots.len(), 1001);
        assert!(knots[1..].iter().all(|knot| knot.offset < 1e-5 * 25e6), "{knots:?}");
    }

    #[test]
    fn noise_is_found_among_many_rows_and_corners_and_smooth_drives_have_none() {
        let noise = |rows: u32, volts: &dyn Fn(f64) -> f64| {
            let times = (0..=rows).map(|k| f64::from(k) / f64::from(rows));
            let lines: Vec<String> = times.map(|time| format!("{time},{}", volts(time))).collect();
            of_table(&format!("t_s,voltage_V\n{}\n", lines.join("\n"))).noise()
        };
        let quarter = |time: f64| 4e3 * (0.25 * TAU * time).sin();
        let pulse = |time: f64| {
            if (0.7..0.71).contains(&time) {
                quarter(100.0 * (time - 0.7))
            } else {
                0.0
            }
        };
        let square = |time: f64| if (10.0 * time).fract() < 0.5 { 4e3 } else { 0.0 };
        let triangle = |time: f64| 4e3 * (1.0 - (2.0 * time - 1.0).abs());
        let smooth: [&dyn Fn(f64) -> f64; 4] = [&quarter, &pulse, &square, &triangle];
        for (at, volts) in smooth.iter().enumerate() {
            for rows in [100, 2000, 10_000] {
                assert_eq!(noise(rows, volts), None, "{at} {rows}");
            }
        }
        // Noise of both signs with a mean square of 4 V, and 8 bits.
        let noisy = |time: f64| quarter(time) + 4.0 * 2.0_f64.sqrt() * (1e3 * (2.3e7 * time * time).sin()).sin();
        let bits = |time: f64| (quarter(time) / 16.0).round() * 16.0;
        assert_eq!(noise(100, &noisy), None);
        for rows in [2000, 10_000] {
            // The square of 4 kV changes by 8 kV times the noise.
            let found = noise(rows, &noisy).unwrap();
            assert!((0.5..2.0).contains(&(found / (8e3 * 4.0))), "{rows}: {found}");
            assert!(noise(rows, &bits).is_some(), "{rows}");
        }
    }

    #[test]
    fn errors_in_tables_name_the_line() {
        for (text, said) in [
            ("t_s,voltage_V\n0,0\n2,5\n1,5\n", "line 4: the time 1 s follows 2 s"),
            ("t_s,voltage_V\n0,5\n", "at least two rows are needed, found 1"),
            ("t_s,voltage_V\n", "at least two rows are needed, found 0"),
            ("t,v\n0,0\n1,1\n", "the column t_s is missing; the columns are t, v"),
            ("t_s,voltage_V\n0,0\n1,x\n", "line 3: \"x\" is not a number"),
            ("t_s,voltage_V\n0,0\n1,\n", "line 3: the voltage is empty"),
            ("t_s\tvoltage_V\n0\t0\n\t1\n", "line 3: the time is empty"),
            ("t_s,voltage_V\n-1,0\n1,1\n", "line 2: the time -1 s"),
            ("t_s,voltage_V\n0,0\n1,1e9\n", "line 3: 1000000000 V is larger"),
            (
                "t_s,voltage_V\n0,0\n1e400,1\n",
                "line 3: the time 1e400 is not between 0 and 1e12 s",
            ),
            (
                "t_s,voltage_V\n0,0\n1,-1e400\n",
                "line 3: the voltage -1e400 is not between -1e6 and 1e6 V",
            ),
        ] {
            let found = table(text).unwrap_err();
            assert!(found.contains(said), "{found}");
        }
    }

    /// As `numpy.savetxt` writes numbers, and as spreadsheets write columns.
    #[test]
    fn tables_of_other_programs_are_read() {
        let plain = table("t_s,voltage_V\n0,0\n0.000005,20.61664879999778677\n").unwrap();
        for text in [
            "# t_s voltage_V\n0.000000000000000000e+00 0.000000000000000000e+00\n\
             5.000000000000000409e-06 2.061664879999778677e+01\n",
            "voltage_v;T_s;note\r\n0;0;start\r\n20,61664879999778677;5e-6;end\r\n",
        ] {
            let read = table(text).unwrap();
            assert_eq!(
                read.rows().collect::<Vec<_>>(),
                plain.rows().collect::<Vec<_>>(),
                "{text}"
            );
        }
        assert_eq!(plain.rows().nth(1).unwrap()[0], 5e-6);
    }

    #[test]
    fn ramps_and_sines_have_their_amplitude() {
        let ramp = Waveform {
            step: None,
            ramp: Some(Ramp {
                time: Time::literal("2 s"),
            }),
            ..Waveform::of_step()
        };
        assert_eq!(
            [0.5, 2.0, 9.0].map(|t| ramp.voltage(100.0, t, Side::After)),
            [25.0, 100.0, 100.0]
        );
        let sine = Waveform {
            step: None,
            sine: Some(Sine {
                frequency: Frequency::literal("2 Hz"),
                bias: Voltage::literal("1 kV"),
            }),
            ..Waveform::of_step()
        };
        assert!((sine.voltage(100.0, 0.125, Side::After) - 1100.0).abs() < 1e-9);
        assert_eq!(sine.voltage(100.0, 0.0, Side::Before), 0.0);
        assert!(sine.knots(1.0)[0].jumps);
    }
}
