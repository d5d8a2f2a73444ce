//! Stages as a pipeline declares them, and the stages that they need: what checks before any work see.

use std::borrow::Cow;

use deaflow_base::Node;

/// The stages of a pipeline as declared.
pub struct Declarations<'a> {
    stages: Vec<Declared<'a>>,
}

/// A stage, and the indices of the stages that it needs.
pub struct Declared<'a> {
    pub name: &'a str,
    pub kind: &'static str,
    pub node: Cow<'a, Node>,
    pub scene: Option<&'a Node>,
    pub scene_from: Option<&'a Node>,
    pub needs: Vec<usize>,
}

/// A stage as declared in the pipeline.
#[derive(Clone, Copy)]
pub struct StageDeclaration<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its kind.
    pub kind: &'static str,
    /// Its mapping.
    pub node: &'a Node,
    /// Its scene; that of the pipeline if another stage makes it.
    pub scene: Option<&'a Node>,
    /// The name of the stage that makes its scene, if another stage does.
    pub scene_from: Option<&'a Node>,
    /// All stages, and its index.
    stages: &'a [Declared<'a>],
    index: usize,
}

impl<'a> Declarations<'a> {
    /// Collects the stages, in the order of the file.
    pub fn new(stages: Vec<Declared<'a>>) -> Self {
        Self { stages }
    }

    /// Returns each stage, in the order of the file.
    pub fn iter(&self) -> impl Iterator<Item = StageDeclaration<'_>> {
        (0..self.stages.len()).map(|index| StageDeclaration::new(&self.stages, index))
    }
}

impl<'a> StageDeclaration<'a> {
    fn new(stages: &'a [Declared<'a>], index: usize) -> Self {
        let declared = &stages[index];
        Self {
            name: declared.name,
            kind: declared.kind,
            node: &declared.node,
            scene: declared.scene,
            scene_from: declared.scene_from,
            stages,
            index,
        }
    }

    /// Returns the stages that it needs, in the order of the file.
    pub fn needs(&self) -> impl Iterator<Item = Self> + use<'a> {
        let stages = self.stages;
        let needs = stages[self.index].needs.iter();
        needs.map(move |&need| Self::new(stages, need))
    }
}
