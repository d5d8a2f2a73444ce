//! Changes patterns to satisfy area, constraints and minimum distance, at the smallest loss of score.

use super::exchange::Exchange;
use super::gains::{Change, Gains};
use super::problem::SearchProblem;
use super::squares::Squares;
use deaflow_base::Stream;
use deaflow_field::PredictError;
use deaflow_pattern::{Layers, Pattern};

/// Maximum number of repairs until the area is in range, and of changes until the distance is large enough.
const TRIALS: usize = 24;

/// Maximum number of squares that are tried to bring the area closer to its range.
const MAX_SQUARES: usize = 256;

/// Cells by which a perturbed pattern exceeds the minimum distance.
const SPARE_CELLS: usize = 8;

impl SearchProblem<'_> {
    /// A pattern slightly farther from `from` than the minimum distance: among half of the units, drawn at random,
    /// those with the smallest loss are changed. So perturbed patterns share about half of the changed units, and
    /// differ from each other as much as from `from` at half the loss of changing different units. `None` if there are
    /// too few units.
    ///
    /// # Errors
    /// If the model cannot be evaluated.
    pub fn perturb(&self, from: &Pattern, stream: &mut Stream) -> Result<Option<Pattern>, PredictError> {
        let on = self.units.of(from);
        let Some(gradient) = self.gradient(from)? else {
            return Ok(None);
        };
        let gains = self.first_order_gains(&on, &gradient).masked(|_| stream.chance(0.5));
        let mut exchange = Exchange::new(&self.units, &on, &gains, self.range);
        let layers = self.merged_layers(from);
        while layers.differing(&self.layers(&exchange.on)) < self.min_difference() + SPARE_CELLS {
            if !exchange.step_anyway() {
                return Ok(None);
            }
        }
        Ok(Some(self.units.pattern(&exchange.on)))
    }

    /// Changes units to satisfy the area range, the constraints and the distance from others, at the smallest loss.
    pub(super) fn make_feasible(&self, on: &[u8], gains: &Gains) -> Option<Vec<u8>> {
        let fitted = |range: (usize, usize)| {
            let mut fitted = Exchange::new(&self.units, on, gains, range);
            fitted.fit().then_some(fitted.on)
        };
        if self.constraints.allow_any_pattern() {
            return self.enforce_distance(fitted(self.range)?, gains);
        }
        // A repair changes the area: bisect on the area before the repair until the area after it is in range.
        let (mut low, mut high) = (0, self.units.size());
        let mut target = self.range;
        let mut nearest: Option<(usize, Vec<u8>)> = None;
        for _ in 0..TRIALS {
            let repaired = fitted(target).and_then(|on| self.repaired(&on));
            let area = repaired.as_ref().map_or(0, |on| self.units.area(on));
            if area < self.range.0 {
                low = target.0;
            } else {
                high = target.1;
            }
            if let Some(on) = repaired {
                let error = self.area_error(area);
                if nearest.as_ref().is_none_or(|(least, _)| error < *least) {
                    nearest = Some((error, on));
                }
                if error == 0 {
                    break;
                }
            }
            let middle = usize::midpoint(low, high);
            if (middle, middle) == target {
                break;
            }
            target = (middle, middle);
        }
        let resized = self.resized(nearest?.1, on, gains)?;
        self.enforce_distance(resized, gains)
    }

    /// The number of cells by which an area is out of range.
    fn area_error(&self, area: usize) -> usize {
        self.range.0.saturating_sub(area) + area.saturating_sub(self.range.1)
    }

    /// Adds or removes squares of the minimum width, the best first, until the area is in range; `None` if no square
    /// brings it closer. The gains are those of changing the units of `before`.
    fn resized(&self, mut on: Vec<u8>, before: &[u8], gains: &Gains) -> Option<Vec<u8>> {
        let squares = Squares::new(&self.units, self.feature());
        loop {
            let area = self.units.area(&on);
            let error = self.area_error(area);
            if error == 0 {
                return Some(on);
            }
            let gains = gains.after(before, &on);
            let groups = match area < self.range.0 {
                true => 1..=self.groups() as u8,
                false => 0..=0,
            };
            let mut choices: Vec<(f64, Vec<Change>)> = groups
                .flat_map(|to| squares.best(&on, &gains, to, usize::MAX))
                .collect();
            let density = |choice: &(f64, Vec<Change>)| choice.0 / choice.1.len() as f64;
            choices.sort_by(|a, b| density(b).total_cmp(&density(a)));
            let changed = |(_, changes): &(f64, Vec<Change>)| {
                let on = self.repaired(&Change::apply(&on, changes))?;
                (self.area_error(self.units.area(&on)) < error).then_some(on)
            };
            on = choices.iter().take(MAX_SQUARES).find_map(changed)?;
        }
    }

    /// Changes the units with the smallest loss until the pattern has the minimum distance from the others.
    fn enforce_distance(&self, mut on: Vec<u8>, gains: &Gains) -> Option<Vec<u8>> {
        for _ in 0..TRIALS {
            let layers = self.layers(&on);
            if self.is_distant(&layers) {
                return Some(on);
            }
            // Only units that agree with the nearest image of each other pattern: no step then decreases any distance.
            let others = self.others.iter();
            let images: Vec<&Layers> = others
                .filter_map(|other| other.iter().min_by_key(|image| layers.differing(image)))
                .collect();
            let columns = self.units.raster().columns();
            let agrees = |unit: usize, image: &Layers| {
                let group = |cell: usize| image.group(cell % columns, cell / columns);
                self.units.group_of(unit, group) == self.constraints.equivalence().first(on[unit])
            };
            let masked = gains.masked(|unit| images.iter().all(|image| agrees(unit, image)));
            let mut exchange = Exchange::new(&self.units, &on, &masked, self.range);
            let is_close = |on: &[u8]| {
                let layers = self.layers(on);
                let mut images = images.iter();
                images.any(|image| layers.differing(image) < self.min_difference())
            };
            while is_close(&exchange.on) {
                if !exchange.step_anyway() {
                    return None;
                }
            }
            on = match self.constraints.allow_any_pattern() {
                true => exchange.on,
                false => self.repaired(&exchange.on)?,
            };
        }
        None
    }

    fn layers(&self, on: &[u8]) -> Layers {
        self.merged_layers(&self.units.pattern(on))
    }
}
