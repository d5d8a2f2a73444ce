//! Figures and summaries of finished runs.
