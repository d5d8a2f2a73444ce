//! The units that a local search changes: cells, or the coarser units of the genetic algorithm.

use deaflow_pattern::{Bits, Layers, Pattern, Raster};

/// The membrane in columns and rows of units. With n units along a side of m cells, cell i lies in unit floor(i n /
/// m).
#[derive(Clone, Debug)]
pub(super) struct Units {
    raster: Raster,
    /// The allowed cells of each unit; units without allowed cells are omitted.
    cells: Vec<Vec<usize>>,
    /// Cells that are in no unit and always active, with their groups.
    always: Vec<(usize, u8)>,
}

impl Units {
    /// Columns and rows of units with the allowed cells.
    pub(super) fn new(units: [usize; 2], allowed: &Bits) -> Self {
        let raster = allowed.raster();
        let [columns, rows] = raster.sides();
        let mut cells = vec![Vec::new(); units[0] * units[1]];
        for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
            if allowed.has(x, y) {
                cells[y * units[1] / rows * units[0] + x * units[0] / columns].push(y * columns + x);
            }
        }
        cells.retain(|unit| !unit.is_empty());
        Self {
            raster,
            cells,
            always: Vec::new(),
        }
    }

    /// The units without the cells of electrodes that are always there, which every pattern has.
    pub(super) fn with_always(mut self, electrodes: Option<&Layers>) -> Self {
        let Some(electrodes) = electrodes else { return self };
        let [columns, rows] = self.raster.sides();
        let all = (0..columns * rows).map(|cell| (cell, electrodes.group(cell % columns, cell / columns)));
        self.always = all.filter(|(_, group)| *group != 0).collect();
        let is_always = |cell: usize| electrodes.group(cell % columns, cell / columns) != 0;
        self.cells
            .iter_mut()
            .for_each(|unit| unit.retain(|cell| !is_always(*cell)));
        self.cells.retain(|unit| !unit.is_empty());
        self
    }

    /// The raster of cells.
    pub(super) fn raster(&self) -> Raster {
        self.raster
    }

    pub(super) fn count(&self) -> usize {
        self.cells.len()
    }

    pub(super) fn cells(&self, unit: usize) -> &[usize] {
        &self.cells[unit]
    }

    /// The sum of an array over the cells of each unit.
    pub(super) fn sums(&self, of_cells: &[f64]) -> Vec<f64> {
        self.cells
            .iter()
            .map(|unit| unit.iter().map(|&cell| of_cells[cell]).sum())
            .collect()
    }

    /// The group of each unit: that of more than half of its cells, or 0.
    pub(super) fn of(&self, pattern: &Pattern) -> Vec<u8> {
        let cells = pattern.cells();
        (0..self.count())
            .map(|unit| self.group_of(unit, |cell| cells[cell]))
            .collect()
    }

    /// The group of one unit, given the group of each cell.
    pub(super) fn group_of(&self, unit: usize, group: impl Fn(usize) -> u8) -> u8 {
        let cells = &self.cells[unit];
        let mut counts = [0; Pattern::MOST_GROUPS + 1];
        cells.iter().for_each(|&cell| counts[usize::from(group(cell))] += 1);
        let most = (1..counts.len()).find(|&group| 2 * counts[group] > cells.len());
        most.unwrap_or(0) as u8
    }

    pub(super) fn pattern(&self, on: &[u8]) -> Pattern {
        let mut groups = vec![0; self.raster.cells()];
        for (unit, &group) in self.cells.iter().zip(on) {
            unit.iter().for_each(|&cell| groups[cell] = group);
        }
        self.always.iter().for_each(|&(cell, group)| groups[cell] = group);
        Pattern::from_groups(self.raster, |x, y| groups[y * self.raster.columns() + x])
    }

    /// The number of allowed cells.
    pub(super) fn size(&self) -> usize {
        self.always.len() + self.cells.iter().map(Vec::len).sum::<usize>()
    }

    /// The number of active cells.
    pub(super) fn area(&self, on: &[u8]) -> usize {
        let units = self.cells.iter().zip(on).filter(|(_, on)| **on != 0);
        self.always.len() + units.map(|(unit, _)| unit.len()).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Genome;

    #[test]
    fn units_are_those_of_the_genetic_algorithm() {
        let units = Units::new([20; 2], &Bits::full(Raster::PAPER));
        let genome = Genome::from_fn(|x, y| (x * 7 + y * 3) % 5 < 2);
        assert_eq!(units.pattern(genome.genes()), genome.pattern(Raster::PAPER));
        assert_eq!(units.of(&genome.pattern(Raster::PAPER)), genome.genes());
        assert_eq!(units.area(genome.genes()), genome.pattern(Raster::PAPER).active_cells());
    }

    #[test]
    fn cells_that_are_not_allowed_are_never_active() {
        let allowed = Bits::from_fn(Raster::PAPER, |x, y| y > 0 || x > 2);
        let cells = Units::new([50; 2], &allowed);
        assert_eq!(cells.count(), 2497);
        assert_eq!(cells.pattern(&vec![1; 2497]).active_cells(), 2497);
        let units = Units::new([20; 2], &allowed);
        assert_eq!((units.count(), units.cells(0).len()), (400, 6));
    }
}
