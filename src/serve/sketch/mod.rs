//! The sketchpad: simulations of a pattern while it is drawn.

mod bisection;
mod files;
mod improve;
mod price;
mod reproduce;
mod request;
mod rising;
mod scenes;
mod screen;
mod solve;
mod sweep;

pub use files::{export, import};
pub use improve::improve;
pub use price::is_quick;
pub use reproduce::reproduce;
pub use scenes::scenes;
pub use screen::screen;
pub use solve::solve;
pub use sweep::sweep;
