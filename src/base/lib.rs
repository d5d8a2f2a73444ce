//! The common base of all crates: digests, canonical values, quantities, random streams, documents, files.

mod background;
mod canonical;
mod clock;
mod concurrently;
mod confined;
mod cpu;
mod csvw;
mod digest;
mod digits;
mod document;
mod encoding;
mod file;
mod host;
mod ids;
mod interrupt;
mod listed;
mod no_break;
mod npy;
mod output_file;
mod parameters;
mod plain_name;
mod printable;
mod program;
mod progress;
mod quantity;
mod schema;
mod stream;
mod table;
mod temporary;

pub use background::{Background, Pauses};
pub use canonical::Canonical;
pub use clock::{readable_time, thread_seconds};
pub use concurrently::concurrently;
pub use confined::{ConfinedError, confined};
pub use cpu::CpuLevel;
pub use csvw::{CsvColumn, CsvTable, csv_metadata, csv_metadata_file, uri};
pub use digest::{Digest, DigestWriter, ParseDigestError};
pub use digits::{
    error_digits, four_digits, four_significant, measured, range_ends, rounded_by, two_digits, with_minus,
};
pub use document::{Document, InputError, Map, Node, NodeValue, Override, Source, nearest};
pub use encoding::{EncodingError, decode, encode};
pub use file::{open_own, open_regular, own_metadata, read_bounded, read_own};
pub use host::host_name;
pub use ids::{ActionKey, ArtifactId, FileDigest, OrbitId};
pub use interrupt::{Interrupt, is_interrupted};
pub use listed::listed;
pub use no_break::{NO_BREAK, no_break_units};
pub use npy::{NpyElement, NpyError, NpyHeader};
pub use output_file::{
    OutputError, OutputFile, folder_of, is_dangling_link, kind_of, output_folder, temporary_file, write_output,
};
pub use parameters::{
    Angle, Charge, Current, Declared, Density, ElectricField, Force, Frequency, Length, Mass, Parameter, Resistance,
    Seed, SpringRate, Stress, Time, Voltage, Volume,
};
pub use plain_name::is_plain_name;
pub use printable::{is_unprintable, printable, printable_json};
pub use program::{VERSION, build, own_command, own_process, set_build, set_own_command, software, version};
pub use progress::{Progress, Stopped};
pub use quantity::{Decimal, Dimension, Quantity, QuantityError};
pub use schema::{Fields, Schema};
pub use stream::Stream;
pub use table::{Row, Table, TableError};
pub use temporary::TemporaryOutput;
