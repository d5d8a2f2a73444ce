//! Cases with known results.

mod material;
