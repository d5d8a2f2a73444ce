//! From solved samples to a training set: the deformation histogram, balancing, augmentation and the split.

mod split;

pub use split::Split;
