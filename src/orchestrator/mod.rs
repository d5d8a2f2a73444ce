//! Knows stages, keys and chunks, and no physics: reads a pipeline, decides what is stale, builds that and no more.
