//! Elements of membranes on the prestretched configuration: energies, grids, and passes over all elements.
//!
//! All quantities are dimensionless: stress is divided by μλp², lengths by the side of an element. So two numbers
//! describe a scene, a = λp⁻⁶ and b = κλp² with κ = ε(V/H)²/μ; for unequal prestretch, λp is √(λ₁λ₂) as described in
//! [`grid`]. The modules follow the method, from the point to the operator: kinematics and energy; sheet, fitted, grid,
//! rigid, supports, gauge, boundary, element, layout, sampling and lanes; coverage, laminate and laminates; activity,
//! memory, kernels, material and composition; operator, mass and stored; gemm, modes and precondition; krylov.
//!
//! Kernels are generic over element, precision, registers and material, and take long to compile. Their instances for
//! scenes are named in [`composition`] alone, so they are compiled once, with this crate; the solvers in `fem` reach
//! them by trait objects.

pub mod activity;
pub mod boundary;
mod capacitance;
mod cell_transform;
mod columns;
pub mod composition;
pub mod coverage;
pub mod element;
pub mod energy;
pub mod error;
mod fitted;
pub mod gauge;
mod gemm;
pub mod grid;
mod kernels;
pub mod kinematics;
pub mod krylov;
pub mod laminate;
pub mod laminates;
pub mod lanes;
pub mod layout;
mod line_transform;
pub mod mass;
pub mod material;
pub mod memory;
mod modes;
pub mod operator;
mod powers;
mod precision;
pub mod precondition;
mod rectangle;
pub mod registers;
pub mod rigid;
pub mod sampling;
pub mod sheet;
mod side_transform;
pub mod stored;
pub mod supports;

#[cfg(test)]
mod tests;
