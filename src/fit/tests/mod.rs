//! Tests against known answers, and of hard cases.

mod coverage;
mod derivatives;
mod fields;
mod hard_cases;
mod known_answers;
mod known_histories;
mod known_joint;
mod noise;
mod warnings;
