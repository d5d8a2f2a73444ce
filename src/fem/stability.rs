//! The stability of an equilibrium.
//!
//! Two conditions are checked: strong ellipticity at every quadrature point, without which the solution depends on the
//! mesh, and a positive definite tangent, without which the equilibrium is a saddle. The second is first tried
//! pointwise with an added null Lagrangian, which is sufficient and takes one pass over the points. If that does not
//! decide, conjugate gradients probe the tangent; if these take too long, the matrix is factorised and its negative
//! pivots are counted (Sylvester's law of inertia).

use super::krylov::KrylovEnd;
use super::material::Material;
use super::newton::{Workspace, probe};
use super::operator::Operator;
use super::precondition::Laplacian;

/// The stability of an equilibrium.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stability {
    /// A minimum of the energy, with ellipticity everywhere.
    Stable {
        /// Whether the pointwise condition proves it. That condition fails well before stability is lost.
        pointwise: bool,
    },
    /// Not stable.
    Lost(Loss),
}

/// The condition that an equilibrium violates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// The tangent is not positive definite.
    Stability,
    /// Rank-one convexity is lost at a point.
    Ellipticity,
    /// A membrane that can wrinkle has lost all tension at a point.
    Tension,
}

/// A margin larger than rounding in single precision.
const CLEAR: f64 = 1e-3;
/// Compression below this is rounding in a membrane without tension.
pub(super) const LOOSE: f64 = 1e-9;

/// Determines the stability of the equilibrium `u`.
pub fn judge<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    u: &[f64],
    workspace: &mut Workspace,
) -> Stability {
    // A null Lagrangian is one only where the sides are held.
    let is_held = operator.activity.grid().boundary().is_none();
    // Single precision usually suffices to prove stability.
    let quick = operator.margins(workspace.single(u));
    if is_held && quick.ellipticity > CLEAR && quick.convexity > CLEAR && quick.tension > CLEAR {
        return Stability::Stable { pointwise: true };
    }
    let margins = operator.margins(u);
    if margins.ellipticity <= 0.0 {
        return Stability::Lost(Loss::Ellipticity);
    }
    if margins.tension < -LOOSE {
        return Stability::Lost(Loss::Tension);
    }
    if is_held && margins.convexity > 0.0 {
        return Stability::Stable { pointwise: true };
    }
    match probe(operator, laplacian, 0.0, u, workspace) {
        KrylovEnd::Converged => Stability::Stable { pointwise: false },
        KrylovEnd::NegativeCurvature => Stability::Lost(Loss::Stability),
        KrylovEnd::Limit => match workspace.factorise(operator, u) {
            Some(factors) if factors.negative_pivots() == 0 => Stability::Stable { pointwise: false },
            _ => Stability::Lost(Loss::Stability),
        },
    }
}

/// Where a state of a material with several branches must lie.
#[derive(Clone, Copy, Debug)]
pub enum Basin<'a> {
    /// In one basin with the undisplaced membrane.
    Rest,
    /// In one basin with this state.
    Of(&'a [f64]),
    /// Anywhere.
    Any,
}

/// Returns whether the energy is convex along the segment from a state to an equilibrium. Then both are in one basin, and
/// the membrane moves between them without snapping. It is checked at three points.
pub fn is_in_basin<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    basin: Basin<'_>,
    u: &[f64],
    workspace: &mut Workspace,
) -> bool {
    [0.25, 0.5, 0.75].into_iter().all(|t| {
        let mut between: Vec<f64> = match basin {
            Basin::Of(before) => before.iter().zip(u).map(|(a, b)| a + t * (b - a)).collect(),
            Basin::Rest => u.iter().map(|u| t * u).collect(),
            Basin::Any => return true,
        };
        operator.activity.grid().settle(&mut between);
        matches!(
            judge(operator, laplacian, &between, workspace),
            Stability::Stable { .. }
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direct::Factorisation;
    use crate::energy::NeoHookean;
    use crate::grid::Grid;
    use crate::material::AnyMaterial;
    use crate::operator::Activity;
    use deaflow_field::{Mesh, Order};

    #[test]
    fn the_probe_agrees_with_the_inertia() {
        // A half-active membrane held at rest is no equilibrium, but its tangent has an inertia. With the null
        // Lagrangian the membrane stays stable beyond the loss of pointwise convexity, up to some load.
        let grid = Grid::paper(Mesh::new(1, Order::Bilinear));
        let laplacian = Laplacian::new(&grid).unwrap();
        let mut workspace = Workspace::new(grid.layout().vector_len(), &laplacian);
        let u = vec![0.0; grid.layout().vector_len()];
        let activity = Activity::from_shares(&grid, |x, y| if (x / 10 + y / 10) % 2 == 0 { 1.0 } else { 0.2 });
        let mut seen = [false, false];
        for step in 0..16 {
            let material = AnyMaterial::from(NeoHookean::of(1.0 / 729.0, 0.6 + 0.05 * f64::from(step)));
            let operator = Operator::new(&material, &activity);
            let positive = Factorisation::new(&operator, &u).unwrap().negative_pivots() == 0;
            let expected = if positive {
                KrylovEnd::Converged
            } else {
                KrylovEnd::NegativeCurvature
            };
            assert_eq!(
                probe(&operator, &laplacian, 0.0, &u, &mut workspace),
                expected,
                "{step}"
            );
            seen[usize::from(positive)] = true;
        }
        assert_eq!(seen, [true, true]);
    }
}
