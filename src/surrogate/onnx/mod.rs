//! Networks as ONNX files (<https://onnx.ai>), which many programs run.
//!
//! The file takes patterns as they stand in other files and gives displacements in mm at all corners: how the network wants
//! its input, its scale and the frame that does not move are part of the graph. The numbers of fields are those of
//! `onnx.proto` (<https://github.com/onnx/onnx/blob/main/onnx/onnx.proto>).

mod cells;
mod graph;
mod layers;
mod protobuf;

use candle_core::Result;

use super::networks::Network;
use super::weights::KEY;
use crate::field::CORNERS;
use crate::pattern::CELLS;
use protobuf::Message;

pub(crate) use graph::{Graph, Value};

/// The version of the file format, of 2021: readers accept older ones.
const IR_VERSION: i64 = 8;

/// The set of operations that belongs to it.
const OPSET: i64 = 17;

/// Names of what goes in and comes out.
const INPUT: &str = "pattern";
const OUTPUT: &str = "displacement";

/// The bytes of an ONNX file: from patterns (n, 50, 50) of 0 and 1 in u8 to displacements (n, 51, 51, 2) in mm, f32. `header`
/// is the description that goes with it.
pub(crate) fn to_onnx(network: &dyn Network, scale_mm: f64, header: &str) -> Result<Vec<u8>> {
    let mut graph = Graph::default();
    let pattern = Value(INPUT.to_owned());
    let cells = graph.node("Cast", &[&pattern], &[("to", graph::Attribute::Whole(graph::FLOAT))]);
    let half = graph.number(0.5);
    let cells = graph.sub(&cells, &half);
    let cells = graph.reshape(&cells, &[0, CELLS as i64, CELLS as i64, 1]);
    let answer = network.export(&mut graph, &cells)?;
    let scale = graph.number(scale_mm as f32);
    let inner = graph.mul(&answer, &scale);
    let all = graph.pad(&inner, &[0, 1, 1, 0, 0, 1, 1, 0]);
    graph.name(&all, OUTPUT);
    let input = array(INPUT, graph::UINT8, &[CELLS, CELLS]);
    let output = array(OUTPUT, graph::FLOAT, &[CORNERS, CORNERS, 2]);
    let graph = graph.encoded("surrogate", &input, &output);
    Ok(Message::default()
        .whole(1, IR_VERSION)
        .text(2, "deaflow")
        .text(3, env!("CARGO_PKG_VERSION"))
        .text(
            6,
            "electrode pattern to displacement in mm of a dielectric elastomer actuator; the metadata says more",
        )
        .message(7, &graph)
        .message(8, &Message::default().text(1, "").whole(2, OPSET))
        .message(14, &Message::default().text(1, KEY).text(2, header))
        .into_bytes())
}

/// An array of any number of rows.
fn array(name: &str, kind: i64, row: &[usize]) -> Message {
    let any = Message::default().text(2, "n");
    let dims = row.iter().map(|&dim| Message::default().whole(1, dim as i64));
    let dims: Vec<Message> = std::iter::once(any).chain(dims).collect();
    let shape = Message::default().messages(1, &dims);
    let tensor = Message::default().whole(1, kind).message(2, &shape);
    Message::default()
        .text(1, name)
        .message(2, &Message::default().message(1, &tensor))
}
