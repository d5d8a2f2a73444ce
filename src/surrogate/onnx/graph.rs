//! A graph of ONNX operations that is drawn node by node, as a network draws its forward pass on tensors.

use candle_core::{DType, Result, Tensor, bail};

use super::protobuf::Message;

/// Numbers of element types.
pub(super) const FLOAT: i64 = 1;
pub(super) const UINT8: i64 = 2;
const INT64: i64 = 7;

/// An array that a node gives, or that the graph holds.
#[derive(Clone, Debug)]
pub(crate) struct Value(pub(super) String);

/// The graph.
#[derive(Debug, Default)]
pub(crate) struct Graph {
    nodes: Vec<Message>,
    initializers: Vec<Message>,
}

/// An attribute of a node.
pub(crate) enum Attribute<'a> {
    /// A whole number.
    Whole(i64),
    /// A real number.
    Real(f32),
    /// Whole numbers.
    Wholes(&'a [i64]),
}

impl Attribute<'_> {
    fn encoded(&self, name: &str) -> Message {
        let message = Message::default().text(1, name);
        match self {
            Self::Real(value) => message.real(2, *value).whole(20, 1),
            Self::Whole(value) => message.whole(3, *value).whole(20, 2),
            Self::Wholes(values) => values.iter().fold(message, |m, value| m.whole(8, *value)).whole(20, 7),
        }
    }
}

impl Graph {
    /// The result of one operation.
    pub(crate) fn node(&mut self, operation: &str, inputs: &[&Value], attributes: &[(&str, Attribute<'_>)]) -> Value {
        let name = format!("{}.{operation}", self.nodes.len());
        let node = inputs
            .iter()
            .fold(Message::default(), |node, input| node.text(1, &input.0));
        let node = node.text(2, &name).text(3, &name).text(4, operation);
        let attributes = attributes.iter().map(|(name, attribute)| attribute.encoded(name));
        self.nodes.push(node.messages(5, &attributes.collect::<Vec<_>>()));
        Value(name)
    }

    fn initializer(&mut self, kind: i64, dims: &[usize], bytes: &[u8]) -> Value {
        let name = format!("constant.{}", self.initializers.len());
        let tensor = dims
            .iter()
            .fold(Message::default(), |tensor, &dim| tensor.whole(1, dim as i64));
        self.initializers
            .push(tensor.whole(2, kind).text(8, &name).bytes(9, bytes));
        Value(name)
    }

    /// The values of a tensor.
    ///
    /// # Errors
    /// When they cannot be read, or are not in single precision.
    pub(crate) fn tensor(&mut self, tensor: &Tensor) -> Result<Value> {
        if tensor.dtype() != DType::F32 {
            bail!("a tensor of {:?} cannot be exported", tensor.dtype());
        }
        let values = tensor.flatten_all()?.to_vec1::<f32>()?;
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        Ok(self.initializer(FLOAT, tensor.dims(), &bytes))
    }

    /// One number.
    pub(crate) fn number(&mut self, value: f32) -> Value {
        self.initializer(FLOAT, &[], &value.to_le_bytes())
    }

    /// Whole numbers, as shapes and ranges are given.
    pub(crate) fn wholes(&mut self, values: &[i64]) -> Value {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.initializer(INT64, &[values.len()], &bytes)
    }

    /// The sum, broadcast.
    pub(crate) fn add(&mut self, a: &Value, b: &Value) -> Value {
        self.node("Add", &[a, b], &[])
    }

    /// The difference, broadcast.
    pub(crate) fn sub(&mut self, a: &Value, b: &Value) -> Value {
        self.node("Sub", &[a, b], &[])
    }

    /// The product of the elements, broadcast.
    pub(crate) fn mul(&mut self, a: &Value, b: &Value) -> Value {
        self.node("Mul", &[a, b], &[])
    }

    /// The product of matrices, broadcast.
    pub(crate) fn matmul(&mut self, a: &Value, b: &Value) -> Value {
        self.node("MatMul", &[a, b], &[])
    }

    /// The same values with axes in another order.
    pub(crate) fn transpose(&mut self, x: &Value, order: &[i64]) -> Value {
        self.node("Transpose", &[x], &[("perm", Attribute::Wholes(order))])
    }

    /// The same values in another shape: 0 keeps an axis, −1 is what is left over.
    pub(crate) fn reshape(&mut self, x: &Value, shape: &[i64]) -> Value {
        let shape = self.wholes(shape);
        self.node("Reshape", &[x, &shape], &[])
    }

    /// Arrays one after the other along an axis.
    pub(crate) fn concatenate(&mut self, parts: &[&Value], axis: i64) -> Value {
        self.node("Concat", parts, &[("axis", Attribute::Whole(axis))])
    }

    /// Zeros before the first and after the last element of each axis: all the former, then all the latter.
    pub(crate) fn pad(&mut self, x: &Value, zeros: &[i64]) -> Value {
        let zeros = self.wholes(zeros);
        self.node("Pad", &[x, &zeros], &[])
    }

    /// Gives a value another name beside its own.
    pub(super) fn name(&mut self, value: &Value, name: &str) {
        let node = Message::default()
            .text(1, &value.0)
            .text(2, name)
            .text(3, name)
            .text(4, "Identity");
        self.nodes.push(node);
    }

    /// The graph as a message, from one named input to one named output.
    pub(super) fn encoded(&self, name: &str, input: &Message, output: &Message) -> Message {
        Message::default()
            .messages(1, &self.nodes)
            .text(2, name)
            .messages(5, &self.initializers)
            .message(11, input)
            .message(12, output)
    }
}
