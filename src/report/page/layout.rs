//! Layout of the stages of a pipeline: each stage is to the right of the stages that it needs.
//!
//! The method of Sugiyama, Tagawa and Toda (1981): layers, then an order within each by the mean position of the
//! neighbours, then heights. A line that skips layers has a bend in each of them, which keeps it clear of the boxes.

/// Height of a box, and of the gap between two, in units of the page.
pub const BOX: f64 = 66.0;
const GAP: f64 = 12.0;

/// Space for a line that passes between boxes.
const BEND: f64 = 16.0;

/// Rounds of ordering: more change nothing in pipelines of a hundred stages.
const ROUNDS: usize = 16;

/// The layout of a drawing.
pub struct Layout {
    /// Layer and centre height of each stage.
    pub stages: Vec<(usize, f64)>,
    /// The line of each need: layer and height of both ends and of its bends.
    pub lines: Vec<Vec<(usize, f64)>>,
    /// Height of the drawing.
    pub height: f64,
    /// Number of layers.
    pub layers: usize,
}

/// A stage or a bend.
struct LayoutNode {
    layer: usize,
    high: f64,
    before: Vec<usize>,
    after: Vec<usize>,
    y: f64,
}

/// Lays out stages, given the stages that each one needs, which come before it.
pub fn layout(needs: &[Vec<usize>]) -> Layout {
    let layers = layers(needs);
    let mut nodes: Vec<LayoutNode> = layers.iter().map(|layer| LayoutNode::new(*layer, BOX)).collect();
    let mut lines = Vec::new();
    for (stage, needed) in needs.iter().enumerate() {
        for &need in needed {
            lines.push(line(&mut nodes, need, stage));
        }
    }
    let count = layers.iter().max().map_or(0, |last| last + 1);
    let mut order: Vec<Vec<usize>> = vec![Vec::new(); count];
    for (k, node) in nodes.iter().enumerate() {
        order[node.layer].push(k);
    }
    pack(&mut nodes, &order);
    for round in 0..ROUNDS {
        let forward = round % 2 == 0;
        for k in 0..count {
            let layer = &mut order[if forward { k } else { count - 1 - k }];
            sort(&nodes, layer, forward);
        }
        pack(&mut nodes, &order);
    }
    (0..ROUNDS).for_each(|_| order.iter().for_each(|layer| settle(&mut nodes, layer)));
    let top = nodes.iter().map(|n| n.y - 0.5 * n.high).fold(f64::INFINITY, f64::min);
    let bottom = nodes
        .iter()
        .map(|n| n.y + 0.5 * n.high)
        .fold(f64::NEG_INFINITY, f64::max);
    let position = |k: &usize| (nodes[*k].layer, nodes[*k].y - top);
    Layout {
        stages: (0..needs.len()).map(|k| position(&k)).collect(),
        lines: lines.iter().map(|line| line.iter().map(position).collect()).collect(),
        height: (bottom - top).max(0.0),
        layers: count,
    }
}

impl LayoutNode {
    fn new(layer: usize, high: f64) -> Self {
        Self {
            layer,
            high,
            before: Vec::new(),
            after: Vec::new(),
            y: 0.0,
        }
    }
}

/// Returns the layer of each stage: after all that it needs, and as close as possible to what needs it.
fn layers(needs: &[Vec<usize>]) -> Vec<usize> {
    let mut layers = vec![0; needs.len()];
    for (stage, needed) in needs.iter().enumerate() {
        layers[stage] = needed.iter().map(|n| layers[*n] + 1).max().unwrap_or(0);
    }
    let mut latest = vec![usize::MAX; needs.len()];
    for (stage, needed) in needs.iter().enumerate().rev() {
        if latest[stage] != usize::MAX {
            layers[stage] = latest[stage];
        }
        for &need in needed {
            latest[need] = latest[need].min(layers[stage] - 1);
        }
    }
    layers
}

/// Connects two stages, with a bend in each layer between.
fn line(nodes: &mut Vec<LayoutNode>, from: usize, to: usize) -> Vec<usize> {
    let mut line = vec![from];
    for layer in nodes[from].layer + 1..nodes[to].layer {
        nodes.push(LayoutNode::new(layer, BEND));
        line.push(nodes.len() - 1);
    }
    line.push(to);
    for pair in line.windows(2) {
        nodes[pair[0]].after.push(pair[1]);
        nodes[pair[1]].before.push(pair[0]);
    }
    line
}

/// Returns the mean height of nodes; `None` if there are none.
fn mean(nodes: &[LayoutNode], of: &[usize]) -> Option<f64> {
    (!of.is_empty()).then(|| of.iter().map(|k| nodes[*k].y).sum::<f64>() / of.len() as f64)
}

fn sort(nodes: &[LayoutNode], layer: &mut [usize], forward: bool) {
    let height = |k: &usize| {
        let node = &nodes[*k];
        let neighbours = if forward { &node.before } else { &node.after };
        mean(nodes, neighbours).unwrap_or(node.y)
    };
    // The sort is stable: equal nodes keep the order of the pipeline.
    layer.sort_by(|a, b| height(a).total_cmp(&height(b)));
}

/// Stacks each layer around the same centre.
fn pack(nodes: &mut [LayoutNode], order: &[Vec<usize>]) {
    for layer in order {
        let total: f64 = layer.iter().map(|k| nodes[*k].high + GAP).sum();
        let mut y = -0.5 * total;
        for &k in layer {
            nodes[k].y = y + 0.5 * nodes[k].high;
            y += nodes[k].high + GAP;
        }
    }
}

/// Moves the nodes of a layer towards their neighbours, in their order and without overlap.
fn settle(nodes: &mut [LayoutNode], layer: &[usize]) {
    let desired = |k: &usize| {
        let around = [&nodes[*k].before[..], &nodes[*k].after[..]].concat();
        mean(nodes, &around).unwrap_or(nodes[*k].y)
    };
    let desired: Vec<f64> = layer.iter().map(desired).collect();
    let distance = |a: usize, b: usize| 0.5 * (nodes[a].high + nodes[b].high) + GAP;
    // The mean of the stacks from above and from below has no overlap either, and favours neither.
    let mut down = desired.clone();
    for i in 1..layer.len() {
        down[i] = down[i].max(down[i - 1] + distance(layer[i - 1], layer[i]));
    }
    let mut up = desired;
    for i in (1..layer.len()).rev() {
        up[i - 1] = up[i - 1].min(up[i] - distance(layer[i - 1], layer[i]));
    }
    for (i, &k) in layer.iter().enumerate() {
        nodes[k].y = 0.5 * (down[i] + up[i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three samples, one of which is needed only at the end; a chain of three; and an end.
    fn needs() -> Vec<Vec<usize>> {
        vec![vec![], vec![], vec![], vec![0, 1], vec![3], vec![4, 2, 0]]
    }

    #[test]
    fn needs_are_to_the_left_and_boxes_do_not_overlap() {
        let needs = needs();
        let placed = layout(&needs);
        for (stage, needed) in needs.iter().enumerate() {
            for need in needed {
                assert!(placed.stages[*need].0 < placed.stages[stage].0);
            }
        }
        assert_eq!(placed.stages[2].0, 2, "next to what needs it");
        assert_eq!(placed.layers, 4);
        for a in 0..needs.len() {
            for b in 0..a {
                let ((x, y), (u, v)) = (placed.stages[a], placed.stages[b]);
                assert!(x != u || (y - v).abs() >= BOX + GAP - 1e-9, "{a} {b}");
            }
            let (_, y) = placed.stages[a];
            assert!(y >= 0.5 * BOX - 1e-9 && y <= placed.height - 0.5 * BOX + 1e-9);
        }
    }

    #[test]
    fn a_need_that_skips_layers_passes_between_the_boxes() {
        let placed = layout(&needs());
        let long = placed.lines.iter().find(|line| line.len() == 4).unwrap();
        for (layer, y) in &long[1..3] {
            for (other, middle) in &placed.stages {
                assert!(layer != other || (y - middle).abs() >= 0.5 * BOX);
            }
        }
        assert_eq!(layout(&[]).layers, 0);
    }
}
