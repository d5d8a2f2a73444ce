//! Networks that predict the displacement of a pattern, their training and their metrics.
