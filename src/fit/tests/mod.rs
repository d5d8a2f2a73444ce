//! Tests against known answers, and of hard cases.

mod hard_cases;
mod known_answers;
