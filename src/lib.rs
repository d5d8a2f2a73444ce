//! deaflow: reproducible design of dielectric-elastomer actuators.
//!
//! A pipeline in YAML is run stage by stage, sample → solve → balance → train → design → verify, into a
//! content-addressed store of HDF5 artifacts; a rerun builds only what changed.
//!
//! # Layers
//!
//! Each line is a crate, and the crates that it may import; a test reads their manifests and fails on any other
//! dependency. Every crate may import `base`.
//!
//! ```text
//! python       → deaflow
//! cli          → every domain crate, stage, content, executor, orchestrator, remote, store, report, serve, hdf
//! serve        → every domain crate, stage, content, executor, orchestrator, store, report
//! report       → content, orchestrator, store, tolerance, pattern, field, scene
//! stage        → every domain crate, content, orchestrator, store
//! executor     → orchestrator, store
//! orchestrator → store
//! remote       → store
//! content      → store, pattern, field, scene
//! store        → hdf
//!
//! tolerance    → scene, pattern, field, fem, linalg
//! design       → pattern, field, scene
//! accuracy     → scene, sample, pattern, field, fem, surrogate
//! surrogate    → dataset, scene, pattern, field, fem, linalg
//! dataset      → pattern, field, array, hdf
//! fem          → element, scene, pattern, field, linalg
//! element      → scene, pattern, field, linalg
//! fit          → linalg
//! sample       → pattern
//! field        → pattern
//! scene        → pattern
//! pattern      → array, hdf
//! array        → hdf
//! linalg       →
//! hdf          →
//! base         →
//! ```
//!
//! The domain never knows the orchestrator; the orchestrator knows no physics.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

/// The digest of the sources.
pub const BUILD: &str = env!("DEAFLOW_BUILD");

pub use deaflow_base::{parameters, variants, words};
pub use {
    deaflow_accuracy as accuracy, deaflow_array as array, deaflow_base as base, deaflow_cli as cli,
    deaflow_content as content, deaflow_dataset as dataset, deaflow_design as design, deaflow_element as element,
    deaflow_executor as executor, deaflow_fem as fem, deaflow_field as field, deaflow_fit as fit, deaflow_hdf as hdf,
    deaflow_linalg as linalg, deaflow_orchestrator as orchestrator, deaflow_pattern as pattern,
    deaflow_remote as remote, deaflow_report as report, deaflow_sample as sample, deaflow_scene as scene,
    deaflow_serve as serve, deaflow_stage as stage, deaflow_store as store, deaflow_surrogate as surrogate,
    deaflow_tolerance as tolerance,
};
