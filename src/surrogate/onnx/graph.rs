//! A graph of ONNX operations, built node by node.

use candle_core::{DType, Result, Tensor, bail};

use super::messages;

/// ONNX numbers of element types.
pub(super) const FLOAT: i32 = 1;
pub(super) const UINT8: i32 = 2;
pub(super) const INT64: i32 = 7;

/// An input, a constant or the output of a node.
#[derive(Clone, Debug)]
pub(crate) struct Value(pub(super) String);

/// A graph of operations.
#[derive(Debug, Default)]
pub(crate) struct Graph {
    nodes: Vec<messages::Node>,
    initializers: Vec<messages::Tensor>,
}

/// An attribute of a node.
pub(crate) enum Attribute<'a> {
    /// An integer.
    Integer(i64),
    /// A float.
    Float(f32),
    /// Integers.
    Integers(&'a [i64]),
}

impl Attribute<'_> {
    fn message(&self, name: &str) -> messages::Attribute {
        let mut message = messages::Attribute {
            name: Some(name.to_owned()),
            ..messages::Attribute::default()
        };
        match self {
            Self::Float(value) => (message.float, message.kind) = (Some(*value), Some(1)),
            Self::Integer(value) => (message.integer, message.kind) = (Some(*value), Some(2)),
            Self::Integers(values) => (message.integers, message.kind) = (values.to_vec(), Some(7)),
        }
        message
    }
}

impl Graph {
    /// Adds an operation and returns its output.
    pub(crate) fn node(&mut self, operation: &str, inputs: &[&Value], attributes: &[(&str, Attribute<'_>)]) -> Value {
        let name = format!("{}.{operation}", self.nodes.len());
        self.push(operation, inputs, &name, attributes);
        Value(name)
    }

    fn push(&mut self, operation: &str, inputs: &[&Value], name: &str, attributes: &[(&str, Attribute<'_>)]) {
        let attributes = attributes.iter().map(|(name, attribute)| attribute.message(name));
        self.nodes.push(messages::Node {
            input: inputs.iter().map(|input| input.0.clone()).collect(),
            output: vec![name.to_owned()],
            name: Some(name.to_owned()),
            op_type: Some(operation.to_owned()),
            attribute: attributes.collect(),
        });
    }

    fn initializer(&mut self, element: i32, dims: &[usize], bytes: Vec<u8>) -> Value {
        let name = format!("constant.{}", self.initializers.len());
        self.initializers.push(messages::Tensor {
            dims: dims.iter().map(|&dim| dim as i64).collect(),
            data_type: Some(element),
            name: Some(name.clone()),
            raw_data: Some(bytes),
        });
        Value(name)
    }

    /// Adds a tensor as a constant.
    ///
    /// # Errors
    /// When they cannot be read, or are not in single precision.
    pub(crate) fn tensor(&mut self, tensor: &Tensor) -> Result<Value> {
        if tensor.dtype() != DType::F32 {
            bail!("a tensor of {:?} cannot be exported", tensor.dtype());
        }
        let values = tensor.flatten_all()?.to_vec1::<f32>()?;
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        Ok(self.initializer(FLOAT, tensor.dims(), bytes))
    }

    /// Adds a scalar constant.
    pub(crate) fn number(&mut self, value: f32) -> Value {
        self.initializer(FLOAT, &[], value.to_le_bytes().to_vec())
    }

    /// Adds integers as a constant, such as a shape or range.
    pub(crate) fn integers(&mut self, values: &[i64]) -> Value {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.initializer(INT64, &[values.len()], bytes)
    }

    /// Converts values to another element type.
    pub(crate) fn cast(&mut self, x: &Value, element: i32) -> Value {
        self.node("Cast", &[x], &[("to", Attribute::Integer(element.into()))])
    }

    /// Adds elementwise with broadcasting.
    pub(crate) fn add(&mut self, a: &Value, b: &Value) -> Value {
        self.node("Add", &[a, b], &[])
    }

    /// Subtracts elementwise with broadcasting.
    pub(crate) fn sub(&mut self, a: &Value, b: &Value) -> Value {
        self.node("Sub", &[a, b], &[])
    }

    /// Multiplies elementwise with broadcasting.
    pub(crate) fn mul(&mut self, a: &Value, b: &Value) -> Value {
        self.node("Mul", &[a, b], &[])
    }

    /// Multiplies matrices with broadcasting.
    pub(crate) fn matmul(&mut self, a: &Value, b: &Value) -> Value {
        self.node("MatMul", &[a, b], &[])
    }

    /// Permutes axes.
    pub(crate) fn transpose(&mut self, x: &Value, order: &[i64]) -> Value {
        self.node("Transpose", &[x], &[("perm", Attribute::Integers(order))])
    }

    /// Changes the shape: 0 keeps an axis, −1 is inferred.
    pub(crate) fn reshape(&mut self, x: &Value, shape: &[i64]) -> Value {
        let shape = self.integers(shape);
        self.node("Reshape", &[x, &shape], &[])
    }

    /// Concatenates arrays along an axis.
    pub(crate) fn concatenate(&mut self, parts: &[&Value], axis: i64) -> Value {
        self.node("Concat", parts, &[("axis", Attribute::Integer(axis))])
    }

    /// Pads with zeros. `zeros` holds the counts before the first element of each axis, then those after the last.
    pub(crate) fn pad(&mut self, x: &Value, zeros: &[i64]) -> Value {
        let zeros = self.integers(zeros);
        self.node("Pad", &[x, &zeros], &[])
    }

    /// Returns the first rows and columns of images with channels last.
    pub(crate) fn first(&mut self, x: &Value, [rows, columns]: [usize; 2]) -> Value {
        let [starts, ends, axes] = [[0, 0], [rows as i64, columns as i64], [1, 2]].map(|ends| self.integers(&ends));
        self.node("Slice", &[x, &starts, &ends, &axes], &[])
    }

    /// Gives a value an additional name.
    pub(super) fn name(&mut self, value: &Value, name: &str) {
        self.push("Identity", &[value], name, &[]);
    }

    /// Converts the graph with one input and one output to a message.
    pub(super) fn into_message(self, name: &str, input: messages::Array, output: messages::Array) -> messages::Graph {
        messages::Graph {
            node: self.nodes,
            name: Some(name.to_owned()),
            initializer: self.initializers,
            input: vec![input],
            output: vec![output],
        }
    }
}
