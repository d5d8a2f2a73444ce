//! Operations and bytes of the networks, for a pattern or an example on the paper's membrane.

use crate::bound::Work;

/// Name, calls per example in a forward pass, and rows, inner extent and columns of the product.
pub const PRODUCTS: [(&str, usize, [usize; 3]); 11] = [
    ("encoder.1", 1, [625, 100, 16]),
    ("encoder.2", 1, [169, 784, 32]),
    ("encoder.3", 1, [169, 800, 64]),
    ("encoder.4, 5", 2, [169, 576, 64]),
    ("mixing", 8, [169, 169, 8]),
    ("channels", 1, [169, 64, 64]),
    ("decoder.1", 2, [169, 576, 32]),
    ("decoder.2", 2, [169, 32, 400]),
    ("decoder.3", 2, [625, 16, 25]),
    ("auxiliary.1", 1, [169, 576, 16]),
    ("auxiliary.2", 1, [169, 16, 25]),
];

/// Weights of `qin2024`.
const WEIGHTS: f64 = 4.5e5;

/// What passes forward and back take: each product reads and writes its matrices, and of its gradients likewise;
/// `passes` says how many there are of each. `weights` says how often the weights are read or written.
fn qin2024(passes: impl Fn(&str) -> f64, weights: f64) -> Work {
    let (mut flops, mut numbers) = (0.0, 0.0);
    for (name, calls, [m, k, n]) in PRODUCTS {
        let all = calls as f64 * passes(name);
        flops += all * 2.0 * (m * k * n) as f64;
        numbers += all * (m * k + m * n) as f64;
    }
    Work {
        single: flops,
        bytes: 4.0 * (numbers + weights * WEIGHTS),
        held: 4 << 20,
        ..Work::default()
    }
}

/// The auxiliary answer is not predicted.
pub fn predict_qin2024() -> Work {
    qin2024(|name| f64::from(u8::from(!name.starts_with("auxiliary"))), 1.0)
}

/// The patterns themselves need no gradient. Two examples are a part, which reads the weights twice and writes their
/// gradient, and a batch of eight has an update that reads four arrays of weights and writes three.
pub fn train_qin2024() -> Work {
    qin2024(
        |name| if name == "encoder.1" { 2.0 } else { 3.0 },
        3.0 / 2.0 + 7.0 / 8.0,
    )
}

const CELLS: f64 = 2500.0;
/// Features of a cell, products of a law in all orientations, and modes of a stress.
const LAW: [f64; 3] = [22.0, 8.0, 6.0];
/// Numbers of the matrix of the response.
const RESPONSE: f64 = 4.0 * 625.0 * 1250.0;

/// Of `physics`, the operations of a correction: factors of the features, stresses, and Green's function in four
/// products a component.
fn correction() -> [f64; 3] {
    let [features, products, modes] = LAW;
    [
        2.0 * CELLS * features * 2.0 * products,
        2.0 * CELLS * (products + features) * modes,
        2.0 * 4.0 * 2.0 * 49f64.powi(3),
    ]
}

/// The response, which is read once for 64 patterns, and two corrections of so many operations, in which each product
/// of the law reads and writes so many times what it sees of all cells.
fn physics(correction: f64, times: f64) -> Work {
    let [features, products, modes] = LAW;
    Work {
        single: 2.0 * RESPONSE + 2.0 * correction,
        bytes: 4.0 * (RESPONSE / 64.0 + 2.0 * times * CELLS * (features + 3.0 * products + modes)),
        held: 1 << 20,
        ..Work::default()
    }
}

pub fn predict_physics() -> Work {
    physics(correction().iter().sum(), 2.0)
}

/// The way back looks again, and has a product by the numbers of the law and one by what it sees for each of its own.
pub fn train_physics() -> Work {
    let [look, law, green] = correction();
    physics((look + law + green) + (look + green + 2.0 * law + 2.0 * look), 6.0)
}
