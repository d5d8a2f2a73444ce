//! Finds the pattern that moves a point where it should go.
