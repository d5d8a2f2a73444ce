//! Values along the axes of the plane, and out of it.

use serde_json::json;

use deaflow_base::{Canonical, InputError, Node, NodeValue, Parameter, Schema, SpringRate};

/// Values along x and y, or along x, y and out of the plane.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Components<T> {
    /// Along x and y.
    Plane([T; 2]),
    /// Along x, y and out of the plane.
    Space([T; 3]),
}

impl<T: Clone> Components<T> {
    /// Returns those along x and y.
    #[must_use]
    pub fn in_plane(&self) -> [T; 2] {
        match self {
            Self::Plane(plane) => plane.clone(),
            Self::Space([x, y, _]) => [x.clone(), y.clone()],
        }
    }

    /// Returns that out of the plane, if it is given.
    #[must_use]
    pub fn height(&self) -> Option<&T> {
        match self {
            Self::Plane(_) => None,
            Self::Space([.., height]) => Some(height),
        }
    }

    /// Returns the values along x and y alone.
    #[must_use]
    pub fn without_height(&self) -> Self {
        Self::Plane(self.in_plane())
    }
}

impl<T: Parameter> Parameter for Components<T> {
    type Limits = T::Limits;
    type Literal = [T::Literal; 2];

    fn read(node: &Node, key: &str, limits: &T::Limits) -> Result<Self, InputError> {
        let read = |node| T::read(node, key, limits);
        match node.list(key).map_err(|error| error.help(Self::help()))? {
            [x, y] => Ok(Self::Plane([read(x)?, read(y)?])),
            [x, y, height] => Ok(Self::Space([read(x)?, read(y)?, read(height)?])),
            items => Err(node
                .error(format!("`{key}` must have two or three values, found {}", items.len()))
                .help(Self::help())),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match self {
            Self::Plane(values) => values.canonical(),
            Self::Space(values) => Some(Canonical::List(values.iter().filter_map(T::canonical).collect())),
        }
    }

    fn schema(limits: &T::Limits) -> Schema {
        Schema::list(T::schema(limits), 2, 3)
    }

    fn literal(literal: [T::Literal; 2]) -> Self {
        Self::Plane(literal.map(T::literal))
    }

    fn example() -> String {
        <[T; 2]>::example()
    }
}

impl<T: Parameter> Components<T> {
    fn help() -> String {
        format!("for example {}; a third value is out of the plane", Self::example())
    }
}

/// Rates of springs: one in all directions, or one for each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Springs {
    /// In all directions.
    All(SpringRate),
    /// Along the axes.
    Along(Components<SpringRate>),
}

impl Springs {
    /// Returns the rates along x, y and out of the plane in N/m.
    #[must_use]
    pub fn n_per_m(&self) -> [f64; 3] {
        match self {
            Self::All(rate) => [rate.value(); 3],
            Self::Along(rates) => {
                let [x, y] = rates.in_plane().map(|rate| rate.value());
                [x, y, rates.height().map_or(0.0, |rate| rate.value())]
            }
        }
    }

    /// Returns whether one out of the plane is given.
    #[must_use]
    pub fn is_in_space(&self) -> bool {
        matches!(self, Self::Along(rates) if rates.height().is_some())
    }

    /// Returns the rates in the plane alone.
    #[must_use]
    pub fn without_height(&self) -> Self {
        match self {
            Self::All(_) => self.clone(),
            Self::Along(rates) => Self::Along(rates.without_height()),
        }
    }
}

impl Parameter for Springs {
    type Limits = <SpringRate as Parameter>::Limits;
    type Literal = <SpringRate as Parameter>::Literal;

    fn read(node: &Node, key: &str, limits: &Self::Limits) -> Result<Self, InputError> {
        match node.value() {
            NodeValue::List(_) => Components::read(node, key, limits).map(Self::Along),
            _ => SpringRate::read(node, key, limits).map(Self::All),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match self {
            Self::All(rate) => rate.canonical(),
            Self::Along(rates) => rates.canonical(),
        }
    }

    fn schema(limits: &Self::Limits) -> Schema {
        Schema::any_of([SpringRate::schema(limits), Components::<SpringRate>::schema(limits)])
    }

    fn literal(literal: Self::Literal) -> Self {
        Self::All(SpringRate::literal(literal))
    }
}

/// Whether a body tilts out of the plane: only bodies that do not are simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Untilted;

impl Parameter for Untilted {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        match node.bool(key)? {
            false => Ok(Self),
            true => Err(node
                .error("bodies that tilt are not simulated")
                .help("a body keeps its direction out of the plane: remove `tilt`, or write `tilt: false`")),
        }
    }

    /// It is the same as no value.
    fn canonical(&self) -> Option<Canonical> {
        None
    }

    fn schema((): &()) -> Schema {
        Schema::new(json!({ "const": false }))
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}
