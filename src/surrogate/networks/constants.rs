//! Constants of the network `physics`, computed from the scene: the linear response to each cell, and the stiffness of
//! the frame and the bodies.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor};
use deaflow_linalg::{Mat, inverse, product};

use super::fold::{Fold, component_sign, parity_sign};
use super::names;
use deaflow_fem::LinearResponse;
use deaflow_field::Field;
use deaflow_pattern::{Membrane, Part, Parts, Symmetries, Symmetry};
use deaflow_scene::{Body, Scene};

/// Largest number of values of a response, 256 MiB: 107 × 107 cells of a rectangle, 76 × 76 of a device without mirror
/// symmetry.
const MAX_VALUES: usize = 1 << 26;

/// Largest number of corners at which the frame and the bodies touch the membrane.
const MAX_NODES: usize = 1600;

/// Named tensors that are computed from a scene, stored in the model and not trained.
#[derive(Clone, Debug)]
pub struct Constants {
    pub(crate) tensors: BTreeMap<String, Tensor>,
}

/// Why a scene has no constants.
#[derive(Debug, thiserror::Error)]
pub enum ConstantsError {
    /// The linear systems cannot be solved.
    #[error("the linear response of the scene cannot be solved")]
    Unsolved,
    /// Nothing moves.
    #[error("nothing moves in this scene: there is nothing to learn")]
    Still,
    /// The response has too many values.
    #[error(
        "the linear response of this scene has {0} values, but at most {MAX_VALUES} are allowed; use fewer cells or \
         network qin2024"
    )]
    Large(usize),
    /// The frame and the bodies touch the membrane at too many corners.
    #[error(
        "the frame and the bodies of this scene touch the membrane at {0} corners, but at most {MAX_NODES} are \
         allowed; use fewer cells"
    )]
    Long(usize),
    /// The numerical library reported an error.
    #[error(transparent)]
    Failed(#[from] candle_core::Error),
}

type Result<T> = std::result::Result<T, ConstantsError>;

impl Constants {
    /// Computes the linear response of a scene to each cell.
    ///
    /// The unit of displacement is ε² L. L is the side of a square of the membrane's area. ε, the typical strain of
    /// the scene, is the root mean square of the derivatives of the linear response to patterns of independent random
    /// cells. The error of the linear response is of the order of this unit, and strain divided by ε is of order one,
    /// for any voltage.
    ///
    /// # Errors
    /// When the linear systems cannot be solved, nothing moves, or there are too many values.
    pub fn new(response: &LinearResponse, scene: &Scene) -> Result<Self> {
        let (membrane, parts) = (scene.membrane(), scene.parts());
        let symmetries = scene.symmetries();
        let fold = checked_fold(scene)?;
        let cells = Cells::new(response, fold, symmetries, parts.as_deref())?;
        let side_mm = scene.side_mm();
        let strain = cells.typical_strain(&membrane);
        if !(strain.is_finite() && strain > 0.0) {
            return Err(ConstantsError::Still);
        }
        let unit_mm = strain * strain * side_mm;
        let mut tensors = cells.blocks(unit_mm)?;
        let strain = Tensor::new(&[strain as f32, side_mm as f32], &Device::Cpu)?;
        tensors.insert(names::STRAIN.to_owned(), strain);
        tensors.extend(anisotropy(scene)?);
        if scene.geometry.has_forces() {
            let field = response.to_loads().ok_or(ConstantsError::Unsolved)?;
            tensors.insert(names::LOADED.to_owned(), planes(&field, unit_mm)?);
        }
        if let Some(parts) = parts {
            tensors.extend(supports(scene, &parts)?);
        }
        Ok(Self { tensors })
    }

    /// Checks that a scene can have constants, as far as that is known without solving it.
    ///
    /// # Errors
    /// When nothing moves, or there are too many values.
    pub fn check(scene: &Scene) -> Result<()> {
        checked_fold(scene)?;
        scene.parts().map_or(Ok(()), |parts| touched(&parts).map(|_| ()))
    }
}

/// Returns the mirror symmetry of a scene whose response is not too large.
fn checked_fold(scene: &Scene) -> Result<Fold> {
    let fold = Fold::new(scene.membrane().raster, scene.symmetries());
    match fold.area() * fold.values() * fold.parities().count() {
        0 => Err(ConstantsError::Still),
        count if count > MAX_VALUES => Err(ConstantsError::Large(count)),
        _ => Ok(fold),
    }
}

/// The responses to the cells of the fundamental part of a device.
struct Cells {
    fold: Fold,
    /// Responses to one cell of each orbit.
    solved: Vec<Field>,
    /// For each cell (column, row): the index of its response, and the symmetry that maps that cell to it.
    images: BTreeMap<(usize, usize), (usize, Symmetry)>,
    /// Number of membrane cells of the device.
    membrane: usize,
}

impl Cells {
    fn new(response: &LinearResponse, fold: Fold, symmetries: Symmetries, parts: Option<&Parts>) -> Result<Self> {
        let sides = fold.raster().sides();
        let is_membrane = |x: usize, y: usize| parts.is_none_or(|parts| parts.at(x, y) == Part::Membrane);
        let [columns, rows] = fold.cells();
        // Of each orbit of cells the lowest cell is solved, and of several lowest the leftmost.
        let mut numbers: BTreeMap<(usize, usize), usize> = BTreeMap::new();
        let mut images = BTreeMap::new();
        for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
            if !is_membrane(x, y) {
                continue;
            }
            let of = |g: Symmetry, (x, y): (usize, usize)| g.apply_index(x, y, sides);
            let first = symmetries.iter().map(|g| of(g, (x, y))).min_by_key(|&(x, y)| (y, x));
            let first = first.unwrap_or((x, y));
            let next = numbers.len();
            let number = *numbers.entry(first).or_insert(next);
            let g = symmetries.iter().find(|&g| of(g, first) == (x, y));
            images.insert((x, y), (number, g.unwrap_or(Symmetry::IDENTITY)));
        }
        let mut wanted = vec![(0, 0); numbers.len()];
        numbers.into_iter().for_each(|(cell, number)| wanted[number] = cell);
        let all = (0..sides[1]).flat_map(|y| (0..sides[0]).map(move |x| (x, y)));
        Ok(Self {
            fold,
            solved: response.to_cells(&wanted).ok_or(ConstantsError::Unsolved)?,
            images,
            membrane: all.filter(|&(x, y)| is_membrane(x, y)).count(),
        })
    }

    /// Returns the responses in the order of the columns, then the rows, of their cells.
    fn each(&self) -> impl Iterator<Item = ((usize, usize), Field)> {
        let field = |(number, g): (usize, Symmetry)| match g {
            Symmetry::IDENTITY => self.solved[number].clone(),
            g => self.solved[number].transformed(g),
        };
        self.images.iter().map(move |(&cell, &image)| (cell, field(image)))
    }

    /// Returns the response to folded patterns for each parity, in a unit of length.
    fn blocks(&self, unit_mm: f64) -> Result<BTreeMap<String, Tensor>> {
        let (area, count) = (self.fold.area(), self.fold.values());
        let [columns, _] = self.fold.cells();
        let zero = |block| (block, vec![0.0f32; area * count]);
        let mut blocks: Vec<(usize, Vec<f32>)> = self.fold.parities().map(zero).collect();
        for ((x, y), field) in self.each() {
            for (block, values) in &mut blocks {
                let row = &mut values[(y * columns + x) * count..][..count];
                write_row(self.fold, &field, *block, unit_mm, row);
            }
        }
        let tensor = |(block, values): (usize, Vec<f32>)| {
            let tensor = Tensor::from_vec(values, (area, count), &Device::Cpu)?;
            Ok((names::BLOCKS[block].to_owned(), tensor))
        };
        blocks.into_iter().map(tensor).collect()
    }

    /// Returns the root mean square, over cells and derivatives, of the strain of patterns of independent random cells.
    fn typical_strain(&self, membrane: &Membrane) -> f64 {
        let [width, height] = membrane.cell_mm();
        let cell_mm = (width * height).sqrt();
        let [columns, rows] = membrane.raster.sides();
        // The variance of a random cell is 1/4. Each cell of the part counts once per mirror image.
        let mut sum = 0.0;
        for ((x, y), field) in self.each() {
            let images = [x, y].into_iter().enumerate().map(|(axis, at)| {
                let is_middle = 2 * at + 1 == membrane.raster.sides()[axis];
                f64::from(1 + u8::from(self.fold.is_folded(axis) && !is_middle))
            });
            let weight = images.product::<f64>() / 4.0;
            for y in 0..rows {
                for x in 0..columns {
                    let [a, b, c, d] = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| field.at_corner(x + i, y + j));
                    for k in 0..2 {
                        let (across, up) = (b[k] + d[k] - a[k] - c[k], c[k] + d[k] - a[k] - b[k]);
                        let squares = across * across * (height / width) + up * up * (width / height);
                        sum += weight * squares / (4.0 * cell_mm * cell_mm);
                    }
                }
            }
        }
        (sum / (4 * self.membrane) as f64).sqrt()
    }
}

/// Writes the part of a field with the parity `block` at the corners of the fundamental part.
fn write_row(fold: Fold, field: &Field, block: usize, unit_mm: f64, row: &mut [f32]) {
    let ([width, height], [columns, rows]) = (fold.corners(), fold.raster().sides());
    let images = fold.parities().count() as f64;
    for (at, value) in row.iter_mut().enumerate() {
        let plane = width * height;
        let (component, y, x) = (at / plane, at % plane / width + 1, at % width + 1);
        let image = |mirrors: usize| {
            let [x, y] =
                [(x, columns, 1), (y, rows, 2)].map(|(i, last, bit)| if mirrors & bit == 0 { i } else { last - i });
            parity_sign(block, mirrors) * component_sign(component, mirrors) * field.at_corner(x, y)[component]
        };
        *value = (fold.parities().map(image).sum::<f64>() / (images * unit_mm)) as f32;
    }
}

/// Returns a field at the inner corners in a unit of length, (2, rows − 1, columns − 1).
fn planes(field: &Field, unit_mm: f64) -> candle_core::Result<Tensor> {
    let [columns, rows] = field.raster().sides();
    let corners = || (1..rows).flat_map(move |y| (1..columns).map(move |x| (x, y)));
    let value = |component: usize, (x, y): (usize, usize)| (field.at_corner(x, y)[component] / unit_mm) as f32;
    let values: Vec<f32> = (0..2).flat_map(|k| corners().map(move |at| value(k, at))).collect();
    Tensor::from_vec(values, (2, rows - 1, columns - 1), &Device::Cpu)
}

/// Returns the stiffness of a cell along x over the geometric mean of both directions.
fn stiffness_ratio(scene: &Scene) -> f64 {
    let ([along, across], [width, height]) = (scene.prestretch(), scene.membrane().cell_mm());
    (along / across) * (height / width)
}

/// Returns the stiffness ratio where the membrane is anisotropic: unequal prestretch or cells that are not square.
fn anisotropy(scene: &Scene) -> candle_core::Result<Option<(String, Tensor)>> {
    let ([along, across], [width, height]) = (scene.prestretch(), scene.membrane().cell_mm());
    if along == across && width == height {
        return Ok(None);
    }
    let tensor = Tensor::new(&[stiffness_ratio(scene) as f32], &Device::Cpu)?;
    Ok(Some((names::RATIO.to_owned(), tensor)))
}

/// Returns the corners that the frame or a body shares with the membrane, with the body.
fn touched(parts: &Parts) -> Result<Vec<([usize; 2], Option<usize>)>> {
    let [columns, rows] = parts.raster().sides();
    let mut nodes: Vec<([usize; 2], Option<usize>)> = Vec::new();
    for (y, x) in (1..rows).flat_map(|y| (1..columns).map(move |x| (y, x))) {
        let around = parts.around(x, y);
        if !around.contains(&Part::Membrane) {
            continue;
        }
        if around.contains(&Part::Frame) {
            nodes.push(([x, y], None));
        } else if let Some(body) = around.iter().find_map(|part| part.body()) {
            nodes.push(([x, y], Some(body)));
        }
    }
    match nodes.len() {
        count if count > MAX_NODES => Err(ConstantsError::Long(count)),
        _ => Ok(nodes),
    }
}

/// Returns the corners at which the frame and the bodies touch the membrane, their stiffness, and the mask of membrane
/// cells.
fn supports(scene: &Scene, parts: &Parts) -> Result<[(String, Tensor); 3]> {
    let raster = parts.raster();
    let [columns, rows] = raster.sides();
    let nodes = touched(parts)?;
    let stiffness = stiffness(scene, parts, &nodes);
    let index = |([x, y], _): &([usize; 2], Option<usize>)| ((y - 1) * (columns - 1) + x - 1) as f32;
    let indices: Vec<f32> = nodes.iter().map(index).collect();
    let cell = |at: usize| f32::from(u8::from(parts.at(at % columns, at / columns) == Part::Membrane));
    let cells: Vec<f32> = (0..raster.cells()).map(cell).collect();
    let (count, device) = (nodes.len(), Device::Cpu);
    let indices = Tensor::from_vec(indices, count, &device)?;
    let stiffness = Tensor::from_vec(stiffness, (2 * count, 2 * count), &device)?;
    let cells = Tensor::from_vec(cells, (rows, columns), &device)?;
    Ok([
        (names::NODES.to_owned(), indices),
        (names::STIFFNESS.to_owned(), stiffness),
        (names::CELLS.to_owned(), cells),
    ])
}

/// Computes the forces that undo a displacement of these corners, `[component][node]` by `[component][node]`.
///
/// S is Green's function of the rectangle between the corners, g the forces, q the motions of the bodies and B q the
/// displacement of the corners by them. S g − B q = −w undoes a displacement w except for rigid motions of the bodies,
/// and −Bᵀg − k q = 0 balances each body against its spring k.
fn stiffness(scene: &Scene, parts: &Parts, nodes: &[([usize; 2], Option<usize>)]) -> Vec<f32> {
    let (count, bodies) = (nodes.len(), parts.bodies());
    let green = green_between(scene, nodes);
    let membrane = scene.membrane();
    let [width, height] = membrane.cell_mm();
    let centroids = centroids(&membrane, parts);
    let elastic = scene.shear_modulus_pa() * scene.thickness_mm() * 1e-3;
    let bodies_of_scene = scene.geometry.bodies.iter().flatten();
    let rates = |body: &Body| body.spring_n_per_m().map(|rate| rate / elastic);
    let springs: Vec<[f64; 2]> = bodies_of_scene.map(rates).collect();
    // Entry of B: displacement of a component of a corner per motion of its body.
    let follows = |row: usize, motion: usize| -> f64 {
        let (component, ([x, y], body)) = (row / count, nodes[row % count]);
        if body != Some(motion / 3) {
            return 0.0;
        }
        let [cx, cy] = centroids[motion / 3];
        match (motion % 3, component) {
            (0, 0) | (1, 1) => 1.0,
            (2, 0) => cy - y as f64 * height,
            (2, _) => x as f64 * width - cx,
            _ => 0.0,
        }
    };
    let forces = 2 * count;
    let system = Mat::from_fn(forces + 3 * bodies, forces + 3 * bodies, |i, k| {
        match (i < forces, k < forces) {
            (true, true) if i / count == k / count => green[(i % count, k % count)],
            (true, false) => -follows(i, k - forces),
            (false, true) => -follows(k, i - forces),
            (false, false) if i == k && (i - forces) % 3 < 2 => -springs[(i - forces) / 3][(i - forces) % 3],
            _ => 0.0,
        }
    });
    let inverse = inverse(&system);
    (0..forces * forces)
        .map(|at| 0.5 * (inverse[(at / forces, at % forces)] + inverse[(at % forces, at / forces)]))
        .map(|value| value as f32)
        .collect()
}

/// Computes Green's function of the rectangle between corners.
fn green_between(scene: &Scene, nodes: &[([usize; 2], Option<usize>)]) -> Mat<f64> {
    let ratio = stiffness_ratio(scene);
    let [columns, rows] = scene.membrane().raster.sides();
    let angle = |k: usize, cells: usize| std::f64::consts::PI * k as f64 / cells as f64;
    let wave = |k: usize, at: usize, cells: usize| (2.0 / cells as f64).sqrt() * (angle(k, cells) * at as f64).sin();
    let eigenvalue = |k: usize, cells: usize| 2.0 - 2.0 * angle(k, cells).cos();
    let modes = (rows - 1) * (columns - 1);
    let scaled = Mat::from_fn(modes, nodes.len(), |mode, node| {
        let (l, k) = (mode / (columns - 1) + 1, mode % (columns - 1) + 1);
        let [x, y] = nodes[node].0;
        let value = eigenvalue(l, rows) / ratio + ratio * eigenvalue(k, columns);
        wave(k, x, columns) * wave(l, y, rows) / value.sqrt()
    });
    product(scaled.transpose(), scaled.as_ref())
}

/// Returns the centroids of the bodies in mm.
fn centroids(membrane: &Membrane, parts: &Parts) -> Vec<[f64; 2]> {
    let mut sums = vec![([0.0; 2], 0.0); parts.bodies()];
    let [columns, rows] = membrane.raster.sides();
    for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
        if let Some(body) = parts.at(x, y).body() {
            let ([cx, cy], count) = &mut sums[body];
            let [x, y] = membrane.centre_mm(x, y);
            (*cx, *cy, *count) = (*cx + x, *cy + y, *count + 1.0);
        }
    }
    sums.into_iter().map(|([x, y], count)| [x / count, y / count]).collect()
}
