//! Networks as ONNX files (<https://onnx.ai>), which many programs run.
//!
//! The file takes patterns as they stand in other files and gives displacements in mm at all corners: how the network wants
//! its input, its scale and the frame that does not move are part of the graph.

mod cells;
mod graph;
mod layers;
mod messages;

use candle_core::{Device, Result, Tensor};
use prost::Message;

use super::encode::seen;
use super::header::Header;
use super::networks::Network;
use super::weights::KEY;
use deaflow_pattern::Raster;

pub(crate) use graph::{Graph, Value};

/// What can be drawn as operations of ONNX, from one array to one array.
pub(crate) trait Export {
    /// Draws it.
    ///
    /// # Errors
    /// When its tensors cannot be read.
    fn export(&self, graph: &mut Graph, x: &Value) -> Result<Value>;
}

/// The version of the file format, of 2021: readers accept older ones.
const IR_VERSION: i64 = 8;

/// The set of operations that belongs to it.
const OPSET: i64 = 17;

/// Names of what goes in and comes out.
const INPUT: &str = "pattern";
const OUTPUT: &str = "displacement";

/// The bytes of an ONNX file: from patterns (n, rows, columns) of 0 and the numbers of groups in u8 to displacements (n, rows + 1, columns + 1, 2) in mm, f32. `says`
/// is the text of the header, the description that goes with it.
pub(crate) fn to_onnx(network: &dyn Network, raster: Raster, header: &Header, says: &str) -> Result<Vec<u8>> {
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
            let seen = Tensor::new(seen(loads), &Device::Cpu)?;
            let (seen, groups) = (graph.tensor(&seen)?, graph.cast(&pattern, graph::INT64));
            graph.node("Gather", &[&seen, &groups], &[])
        }
    };
    let cells = graph.reshape(&cells, &[0, rows as i64, columns as i64, 1]);
    let answer = network.export(&mut graph, &cells)?;
    let scale = graph.number(header.scale_mm as f32);
    let inner = graph.mul(&answer, &scale);
    let all = graph.pad(&inner, &[0, 1, 1, 0, 0, 1, 1, 0]);
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
            value: Some(says.to_owned()),
        }],
    };
    Ok(model.encode_to_vec())
}

/// An array of any number of rows.
fn array(name: &str, element: i32, row: &[usize]) -> messages::Array {
    let any = messages::Length::Named("n".to_owned());
    let lengths = row.iter().map(|&length| messages::Length::Fixed(length as i64));
    let dims = std::iter::once(any).chain(lengths);
    let dims = dims
        .map(|length| messages::Dimension { length: Some(length) })
        .collect();
    let tensor = messages::TensorKind {
        element: Some(element),
        shape: Some(messages::Shape { dims }),
    };
    messages::Array {
        name: Some(name.to_owned()),
        kind: Some(messages::ArrayKind { tensor: Some(tensor) }),
    }
}
