//! A family of patterns and a material law from outside: what a program adds to the tables through the public interface.

use std::path::Path;

use deaflow::base::{Document, Stream};
use deaflow::fem::{MembraneSolver, SolveOptions};
use deaflow::field::{Mesh, Simulator};
use deaflow::parameters;
use deaflow::pattern::Pattern;
use deaflow::sample::{
    Entry, FAMILIES, Family, FamilyEntry, FamilyParameters, Group, Refusal, SampleError, read_family,
};
use deaflow::scene::Scene;
use deaflow::scene::laws::{AtRest, Form, Response, Significance, StiffeningLaw};

parameters! {
    /// Bars of one width.
    struct Bars as "a bars sample" {
        /// Patterns to draw.
        count: u64 [1..=10],
        /// Width of a bar in cells.
        width: u64 [1..=25] = 5,
    }
}

impl FamilyParameters for Bars {
    const NAME: &'static str = "bars";

    fn groups(&self) -> Result<Vec<Group>, Refusal> {
        Ok(self.one_group(self.count, Box::new(BarsOf(self.width as usize))))
    }
}

#[derive(Debug)]
struct BarsOf(usize);

impl Family for BarsOf {
    fn name(&self) -> &'static str {
        Bars::NAME
    }

    fn sample(&self, seed: u64, index: u64) -> Result<Pattern, SampleError> {
        let shift = Stream::new(seed, "bars", index).index(2 * self.0);
        Ok(Pattern::from_fn(|x, _| ((x + shift) / self.0).is_multiple_of(2)))
    }
}

#[test]
fn a_family_is_added_to_the_table_by_value() {
    let table: Vec<&dyn FamilyEntry> = FAMILIES.iter().copied().chain([&Entry::<Bars>::NEW as _]).collect();
    let read = |text: &str| {
        let document = Document::from_text(Path::new("bars"), text).unwrap();
        let read = read_family(&table, &document.root, "a sample", &["seed"]);
        read.map(|(_, groups)| groups).map_err(|e| e.to_string())
    };
    let groups = read("{ family: bars, count: 3, width: 10, seed: 1 }").unwrap();
    let pattern = groups[0].family.sample(1, 2).unwrap();
    assert_eq!((groups[0].count, groups[0].family.name()), (3, "bars"));
    assert!((0..50).all(|x| pattern.is_active(x, 0) == pattern.is_active(x, 49)));
    assert_eq!(
        read("{ family: blobs, count: 3, seed: 1 }").unwrap()[0].family.name(),
        "blobs"
    );
    assert!(
        read("{ family: bras, count: 3, seed: 1 }")
            .unwrap_err()
            .contains("bras")
    );
}

/// A law that stiffens with the square of I₁ − 3: 2ψ′/μ = 1 + c(I₁ − 3)².
struct Cubic(f64);

impl StiffeningLaw for Cubic {
    fn form(&self, _shear_modulus_pa: f64) -> Form {
        Form::FirstInvariant(Response::polynomial([1.0, 0.0, self.0]))
    }

    fn significance(&self, at: &AtRest) -> Significance {
        let rise = self.0 * at.invariant().powi(2);
        Significance {
            quantity: "c(I1 − 3)²",
            number: rise,
            stress_change: rise,
        }
    }
}

#[test]
fn a_law_is_handed_to_the_solver_by_value() {
    let scene = Scene::vhb4910();
    let options = SolveOptions::on(Mesh::bilinear(1));
    let half = [Pattern::from_fn(|x, _| x < 25)];
    let moved = |c: f64| {
        let solver = MembraneSolver::with_law(&scene, &Cubic(c), options).unwrap();
        solver.simulate(&half).remove(0).field.unwrap().max_magnitude()
    };
    let base = MembraneSolver::new(&scene, options).unwrap();
    let base = base.simulate(&half).remove(0).field.unwrap().max_magnitude();
    assert!((moved(0.0) / base - 1.0).abs() < 1e-6, "{} {base}", moved(0.0));
    assert!(moved(1e-3) < 0.9 * base && moved(1e-2) < moved(1e-3));
}
