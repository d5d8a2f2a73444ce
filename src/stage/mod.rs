//! One file per stage kind: binds a domain function to the orchestrator, no more.
