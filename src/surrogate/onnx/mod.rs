//! Export of networks as ONNX files (<https://onnx.ai>).
//!
//! The graph takes patterns as they are in other files and returns displacements in mm at all corners. It includes the
//! input encoding, the unit of length and the fixed edges.

mod cells;
mod graph;
mod layers;
mod messages;

use candle_core::{Device, Result, Tensor};
use prost::Message;

use super::encode::cell_inputs;
use super::header::Header;
use super::weights::KEY;
use deaflow_pattern::Raster;

pub(crate) use graph::{Graph, Value};

/// A map from one array to one array that can be exported to ONNX.
pub(crate) trait Export {
    /// Adds its operations to a graph and returns the output.
    ///
    /// # Errors
    /// When its tensors cannot be read.
    fn export(&self, graph: &mut Graph, x: &Value) -> Result<Value>;
}

/// Version of the file format (2021). Readers accept older versions.
const IR_VERSION: i64 = 8;

/// Version of the operations in this format.
const OPSET: i64 = 17;

/// Names of the input and the output.
const INPUT: &str = "pattern";
const OUTPUT: &str = "displacement";

/// Encodes an ONNX file that maps patterns (n, rows, columns) of 0 and group numbers in u8 to displacements
/// (n, rows + 1, columns + 1, 2) in mm, f32. `metadata` is the text of the header.
pub(crate) fn to_onnx(network: &dyn Export, raster: Raster, header: &Header, metadata: &str) -> Result<Vec<u8>> {
    let ([columns, rows], [across, up]) = (raster.sides(), raster.corner_sides());
    let mut graph = Graph::default();
    let pattern = Value(INPUT.to_owned());
    let cells = match header.loads() {
        [_] => {
            let cells = graph.cast(&pattern, graph::FLOAT);
            let half = graph.number(0.5);
            graph.sub(&cells, &half)
        }
        loads => {
            let inputs = Tensor::new(cell_inputs(loads), &Device::Cpu)?;
            let (inputs, groups) = (graph.tensor(&inputs)?, graph.cast(&pattern, graph::INT64));
            graph.node("Gather", &[&inputs, &groups], &[])
        }
    };
    let cells = graph.reshape(&cells, &[0, rows as i64, columns as i64, 1]);
    let output = network.export(&mut graph, &cells)?;
    let scale = graph.number(header.scale_mm as f32);
    let inner = graph.mul(&output, &scale);
    let all = match header.corners(raster).held() {
        None => graph.pad(&inner, &[0, 1, 1, 0, 0, 1, 1, 0]),
        Some(_) => inner,
    };
    graph.name(&all, OUTPUT);
    let input = array(INPUT, graph::UINT8, &[rows, columns]);
    let output = array(OUTPUT, graph::FLOAT, &[up, across, 2]);
    let what = "electrode pattern to displacement in mm of a dielectric elastomer actuator; the metadata says more";
    let model = messages::Model {
        ir_version: Some(IR_VERSION),
        producer_name: Some("deaflow".to_owned()),
        producer_version: Some(env!("CARGO_PKG_VERSION").to_owned()),
        doc_string: Some(what.to_owned()),
        graph: Some(graph.into_message("surrogate", input, output)),
        opset_import: vec![messages::OperatorSet {
            domain: Some(String::new()),
            version: Some(OPSET),
        }],
        metadata: vec![messages::Entry {
            key: Some(KEY.to_owned()),
            value: Some(metadata.to_owned()),
        }],
    };
    Ok(model.encode_to_vec())
}

/// Returns an array with any number of rows.
fn array(name: &str, element: i32, row: &[usize]) -> messages::Array {
    let any = messages::Length::Named("n".to_owned());
    let lengths = row.iter().map(|&length| messages::Length::Fixed(length as i64));
    let dimensions = std::iter::once(any).chain(lengths).map(Some);
    let dims = dimensions.map(|length| messages::Dimension { length }).collect();
    let tensor = messages::TensorKind {
        element: Some(element),
        shape: Some(messages::Shape { dims }),
    };
    messages::Array {
        name: Some(name.to_owned()),
        kind: Some(messages::ArrayKind { tensor: Some(tensor) }),
    }
}
