//! The sketchpad: what a pattern does while it is drawn.

mod drawn;
mod files;
mod improve;
mod scenes;
mod screened;
mod solved;

pub use files::{export, import};
pub use improve::improve;
pub use scenes::scenes;
pub use screened::screen;
pub use solved::solve;
