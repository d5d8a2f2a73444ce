//! The sketchpad: what a pattern does while it is drawn.

mod approach;
mod drawn;
mod files;
mod improve;
mod reproduced;
mod scenes;
mod screened;
mod solved;

pub use files::{export, import};
pub use improve::improve;
pub use reproduced::reproduce;
pub use scenes::scenes;
pub use screened::screen;
pub use solved::solve;
