//! The price of a mesh: the time and the memory of a sketch on it, before it is solved.
//!
//! Times are those of a disc of 15 % of the membrane of VHB 4910 with 50 × 50 cells, on one core; patterns near
//! pull-in, and some effects, take several times as long. On the ten meshes of the page, the estimate with the critical
//! voltage was 0.8 to 1.6 times the measured time.

use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::{Value, json};

use super::request::{DEFAULT_MESH, is_solved_here};
use deaflow_field::{Mesh, Order};

/// Time in s of a solution with one bilinear element for each of 2,500 cells, and how it grows with the number of
/// elements.
const SOLUTION: f64 = 6e-4;
const GROWTH: f64 = 1.3;
/// Cells of the membrane that was timed.
const TIMED_CELLS: f64 = 2500.0;
/// Solutions of the search for the critical voltage on the mesh, and on each of two biquadratic meshes.
const SEARCH: f64 = 55.0;
const REFINEMENT: f64 = 30.0;
/// Bytes for each unknown of the finest mesh.
const BYTES: usize = 200;
/// Solutions of the load steps of a pattern that is near pull-in.
const LOAD_STEPS: f64 = 5.0;
/// Most time in s of a sketch that counts as quick.
const QUICK: f64 = 2.0;

/// The price of a sketch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Price {
    /// Time of the solution, s.
    pub solution: f64,
    /// Time with the critical voltage and the error, s.
    pub seconds: f64,
    /// Memory with them, bytes.
    pub bytes: usize,
}

impl Price {
    /// Estimates the price of a mesh on a raster of `[columns, rows]`.
    #[must_use]
    pub fn of(sides: [usize; 2], mesh: Mesh) -> Self {
        let cells = (sides[0] * sides[1]) as f64 / TIMED_CELLS;
        let time = |mesh: Mesh| SOLUTION * (cells * mesh.cost() as f64).powf(GROWTH);
        // Those of `CriticalSearch::for_solutions_on`.
        let coarse = match mesh.order() {
            Order::Bilinear => 1,
            Order::Biquadratic => mesh.elements_per_cell().min(2),
        };
        let pair = [coarse, 2 * coarse].map(Mesh::biquadratic);
        let finer = mesh.finer();
        let solution = time(mesh);
        let search = SEARCH * solution + REFINEMENT * pair.map(time).iter().sum::<f64>();
        let unknowns = |mesh: &Mesh| {
            let nodes = sides.map(|side| side * mesh.elements_per_cell() * mesh.order().degree() + 1);
            2 * nodes[0] * nodes[1]
        };
        let all = pair.iter().chain(&finer).chain([&mesh]);
        Self {
            solution,
            seconds: solution + search + finer.map_or(0.0, time),
            bytes: BYTES * all.map(unknowns).max().unwrap_or_default(),
        }
    }

    /// Whether a sketch is quick, with the critical voltage or without.
    fn is_quick(self, with_critical: bool) -> bool {
        match with_critical {
            true => self.seconds <= QUICK,
            false => LOAD_STEPS * self.solution <= QUICK,
        }
    }
}

/// Returns the prices of all meshes of a raster.
#[must_use]
pub fn prices(sides: [usize; 2]) -> Vec<Value> {
    let all =
        (1..=Mesh::MOST_ELEMENTS).flat_map(|side| [Order::Bilinear, Order::Biquadratic].map(|o| Mesh::new(side, o)));
    let document = |mesh: Mesh| {
        let price = Price::of(sides, mesh);
        json!({
            "elements_per_cell": mesh.elements_per_cell(),
            "order": mesh.order().degree(),
            "solution": price.solution,
            "seconds": price.seconds,
            "bytes": price.bytes,
        })
    };
    all.filter(|mesh| is_solved_here(sides, *mesh)).map(document).collect()
}

/// What the price of a request depends on.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Priced {
    pattern: Vec<Vec<IgnoredAny>>,
    elements_per_cell: Option<u64>,
    order: Option<u64>,
    quick: bool,
}

/// Whether the body of a sketch asks for little work. Invalid bodies do: they are refused.
#[must_use]
pub fn is_quick(body: &[u8]) -> bool {
    let Ok(priced) = serde_json::from_slice::<Priced>(body) else {
        return true;
    };
    let (elements, order) = DEFAULT_MESH;
    let mesh = Mesh::from_numbers(
        priced.elements_per_cell.unwrap_or(elements),
        priced.order.unwrap_or(order),
    );
    let sides = [priced.pattern.first().map_or(0, Vec::len), priced.pattern.len()];
    mesh.is_none_or(|mesh| Price::of(sides, mesh).is_quick(!priced.quick))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prices_are_near_the_measured_times_and_memory() {
        let near = |found: f64, measured: f64| (0.5..2.0).contains(&(found / measured));
        // Elements, order, and the time with the critical voltage in s, all measured.
        for (elements, order, seconds) in [
            (1, 1, 0.94),
            (2, 1, 1.13),
            (4, 1, 1.94),
            (8, 1, 6.7),
            (1, 2, 1.34),
            (2, 2, 5.9),
            (3, 2, 12.1),
            (4, 2, 13.9),
            (8, 2, 65.0),
        ] {
            let price = Price::of([50, 50], Mesh::from_numbers(elements, order).unwrap());
            assert!(near(price.seconds, seconds), "{elements} of order {order}: {price:?}");
        }
        // The memory of the server rose by 190 MB.
        assert!(near(Price::of([50, 50], Mesh::biquadratic(8)).bytes as f64, 190e6));
    }

    #[test]
    fn coarse_meshes_are_quick_and_fine_ones_are_not() {
        let body = |more: &str| format!("{{\"pattern\": {:?}{more}}}", vec![vec![0_u8; 50]; 50]).into_bytes();
        for (more, expected) in [
            ("", true),
            (", \"elements_per_cell\": 1", true),
            (", \"elements_per_cell\": 4, \"order\": 2, \"quick\": true", true),
            (", \"elements_per_cell\": 4, \"order\": 2", false),
            (", \"elements_per_cell\": 8, \"order\": 2, \"quick\": true", false),
            (", \"elements_per_cell\": 99", true),
            (", \"elements_per_cell\": \"x\"", true),
        ] {
            assert_eq!(is_quick(&body(more)), expected, "{more}");
        }
        assert!(is_quick(b"[") && is_quick(b""));
    }

    #[test]
    fn only_meshes_that_the_page_solves_have_a_price() {
        assert_eq!(prices([50, 50]).len(), 16);
        assert_eq!(prices([400, 400]).len(), 3);
    }
}
