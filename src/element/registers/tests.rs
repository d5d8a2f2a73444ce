use std::cell::Cell;

use deaflow_field::{Mesh, Order};
use deaflow_pattern::{CELLS, Pattern, Raster};
use deaflow_scene::laws::{Gent, StiffeningLaw};

use crate::activity::Activity;
use crate::composition::Composition;
use crate::energy::{Margins, NeoHookean, Stiffened};
use crate::grid::Grid;
use crate::krylov::{Scratch, conjugate_gradients};
use crate::material::AnyMaterial;
use crate::operator::Operator;
use crate::precondition::Laplacian;
use crate::sheet::Sheet;

/// Registers that a thread may use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Allowed {
    /// None.
    Scalar,
    /// Up to 256 bits.
    Narrow,
    /// All.
    Widest,
}

thread_local! {
    pub(super) static ALLOWED: Cell<Allowed> = const { Cell::new(Allowed::Widest) };
}

/// Returns the displacement after six steps of Newton's method from rest, the margins there, and the number of
/// iterations of the steps.
fn equilibrium(material: &AnyMaterial, activity: &Activity, laplacian: &Laplacian) -> (Vec<f64>, Margins<f64>, u32) {
    let operator = Operator::new(material, activity);
    let mut u = vec![0.0; operator.layout().vector_len()];
    let (mut residual, mut moduli) = (u.clone(), Vec::new());
    let mut krylov = Scratch::new(u.len());
    for _ in 0..6 {
        operator.residual(&u, &mut residual);
        let size = residual.iter().map(|r| r * r).sum::<f64>().sqrt();
        let narrow: Vec<f32> = u.iter().map(|u| *u as f32).collect();
        operator.linearise(&narrow, &mut moduli);
        for (target, r) in krylov.residual.iter_mut().zip(&residual) {
            *target = (r / size) as f32;
        }
        krylov.solution.fill(0.0);
        let mut spare = laplacian.scratch();
        conjugate_gradients(
            1e-4,
            &mut krylov,
            |du, out| operator.tangent_at(&narrow, &moduli, du, out),
            |r, z| laplacian.solve(r, &[], z, &mut spare),
        );
        for (u, step) in u.iter_mut().zip(&krylov.solution) {
            *u -= size * f64::from(*step);
        }
    }
    let margins = operator.margins(&u);
    (u, margins, krylov.iterations)
}

#[test]
fn results_are_identical_for_all_registers_and_equal_to_rounding_without() {
    // A checkerboard whose rows end within a register.
    let active: Vec<u8> = (0..CELLS * CELLS)
        .map(|i| u8::from((i % CELLS / 3 + i / CELLS / 4).is_multiple_of(2)))
        .collect();
    let pattern = Pattern::from_cells(Raster::PAPER, &active).unwrap();
    let gent = Gent {
        jm: deaflow_base::Decimal::from_f64(100.0).unwrap(),
    };
    let stiffened = Stiffened::new(&gent.form(1.0), 3.0).unwrap();
    let base = AnyMaterial::from(NeoHookean::new(3.0, 0.0255));
    let wrinkling = Composition {
        prestretch: 3.0,
        stiffening: Some(stiffened),
        electrode: None,
        decay: None,
        wrinkles: true,
    };
    let wrinkling = wrinkling.material(0.0255, 0.0);
    let square = Sheet::paper();
    let uneven = Sheet {
        prestretch: [3.2, 9.0 / 3.2],
        ..Sheet::paper()
    };
    for mesh in [
        Mesh::new(1, Order::Bilinear),
        Mesh::new(3, Order::Bilinear),
        Mesh::biquadratic(1),
    ] {
        // Squares that rest at f = I, elements of several sizes, and equal rectangles that rest at other f.
        let cases = [
            (&base, Grid::uniform(mesh, &square)),
            (&wrinkling, Grid::uniform(mesh, &square)),
            (&base, Grid::along_strips(mesh, &square, [0.2; 2])),
            (&wrinkling, Grid::uniform(mesh, &uneven)),
        ];
        for (material, grid) in cases {
            let activity = Activity::new(&grid, &pattern);
            let laplacian = Laplacian::new(&grid).unwrap();
            let [wide, narrow, scalar] = [Allowed::Widest, Allowed::Narrow, Allowed::Scalar].map(|allowed| {
                ALLOWED.set(allowed);
                equilibrium(material, &activity, &laplacian)
            });
            ALLOWED.set(Allowed::Widest);
            assert_eq!(wide, narrow);
            let pairs = || wide.0.iter().zip(&scalar.0);
            let largest = pairs().fold(0.0, |largest: f64, (u, _)| largest.max(u.abs()));
            let worst = pairs().fold(0.0, |worst: f64, (a, b)| worst.max((a - b).abs()));
            assert!(worst > 0.0 && worst < 1e-8 * largest, "{worst:e} of {largest:e}");
        }
    }
}
