//! Noise of tests: fixed deviates, and normal ones from a generator with a fixed seed.

/// Returns the deviate of the known answers: √2 sin(2.3 i²), i = 1, 2, …
pub fn deviate(index: usize) -> f64 {
    f64::sqrt(2.0) * f64::sin(2.3 * (index * index) as f64)
}

/// Independent normal deviates: the linear congruential generator of Knuth's MMIX, and the method of Box and Muller.
pub struct Normal {
    state: u64,
}

impl Normal {
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    fn uniform(&mut self) -> f64 {
        self.state = self
            .state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    pub fn next(&mut self) -> f64 {
        let (a, b) = (self.uniform(), self.uniform());
        (-2.0 * a.ln()).sqrt() * (2.0 * std::f64::consts::PI * b).cos()
    }
}
