//! deaflow: reproducible design of dielectric-elastomer actuators.
//!
//! A pipeline in YAML is run stage by stage, sample → solve → balance → train → design → verify, into a
//! content-addressed store of HDF5 artifacts; a rerun builds only what changed.
//!
//! # Layers
//!
//! Each room imports only from the rooms named to its right; `tests/layering.rs` parses the sources and fails on any
//! other arrow. `base` may be imported by every room.
//!
//! ```text
//! cli          → every domain room, stage, content, executor, orchestrator, remote, store, report, serve, hdf
//! serve        → every domain room, stage, content, executor, orchestrator, store, report
//! report       → content, orchestrator, store, pattern, field, scene
//! stage        → every domain room, content, orchestrator, store
//! executor     → orchestrator, store
//! orchestrator → store
//! remote       → store
//! content      → store, pattern, field, scene
//! store        → hdf
//!
//! design       → pattern, field, scene
//! accuracy     → scene, sample, pattern, field, fem, surrogate
//! surrogate    → dataset, scene, pattern, field, fem
//! dataset      → pattern, field, hdf
//! fem          → scene, pattern, field
//! sample       → pattern
//! field        → pattern
//! scene        → pattern
//! pattern      → hdf
//! hdf          →
//! base         →
//! ```
//!
//! The domain never knows the orchestrator; the orchestrator knows no physics.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod accuracy;
pub mod base;
pub mod cli;
pub mod content;
pub mod dataset;
pub mod design;
pub mod executor;
pub mod fem;
pub mod field;
pub mod hdf;
pub mod orchestrator;
pub mod pattern;
pub mod remote;
pub mod report;
pub mod sample;
pub mod scene;
pub mod serve;
pub mod stage;
pub mod store;
pub mod surrogate;
