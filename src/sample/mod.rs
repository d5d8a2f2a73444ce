//! Draws electrode patterns: small grid, large grid, Bézier.
