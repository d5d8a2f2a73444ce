//! What every room stands on: digests, canonical values, quantities, random streams, documents, files.

mod canonical;
mod clock;
mod digest;
mod document;
mod encoding;
mod file;
mod ids;
mod parameters;
mod progress;
mod quantity;
mod schema;
mod stream;

pub use crate::{parameters, variants, words};
pub use canonical::Canonical;
pub use clock::thread_seconds;
pub use digest::{Digest, DigestWriter, ParseDigestError};
pub use document::{Document, InputError, Map, Node, NodeValue, Override, Source, nearest};
pub use encoding::{EncodingError, decode, encode};
pub use file::{open_regular, read_bounded};
pub use ids::{ActionKey, ArtifactId, FileDigest, OrbitId};
pub use parameters::{
    Angle, Declared, Density, ElectricField, Frequency, Length, Parameter, Resistance, Seed, Stress, Time, Voltage,
};
pub use progress::Progress;
pub use quantity::{Decimal, Dimension, Quantity, QuantityError};
pub use schema::{Fields, Schema};
pub use stream::Stream;
