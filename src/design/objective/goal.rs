//! The goal of a design, and the fitness of a pattern and its displacement field.
//!
//! The source paper minimises F = 1 − |D·d|/‖D‖ + λ|α − α_target| (Qin et al., doi 10.1089/soro.2024.0063, equation
//! 6), where D is the displacement of the point. This ignores the magnitude and the sign of D: a motion of a
//! micrometre straight backwards is as good as any. The default here is F = 1 − (D·d)/2.5 mm + λ|α − α_target| with
//! the signed unit direction d; the literal form can be selected. For target displacements, at one point or at many
//! points of a field, F depends on the distance from the targets instead.

use super::aim::{Aim, PlacedAim, Subject, mean_along, rms_error};
use super::error::GoalError;
use super::measure::{Measure, SCALE_MM};
use super::robust::Criterion;
use deaflow_field::{Field, REACTION_UNIT, Reactions, StateFields};
use deaflow_pattern::{Membrane, Raster};

/// The default weight λ of the area: an area error of 1 % costs as much as 0.125 mm of displacement. This is just
/// above the largest gain from area in the linear response of the default scene (0.12 mm per 1 %, for area fractions
/// from 5 % to 95 %), so that the optimum has the target area. A larger weight only makes the search stiffer.
pub const AREA_PENALTY: f64 = 5.0;

/// Rounding of areas.
const ROUNDING: f64 = 1e-9;

/// The penalty in F for an area above the largest one: as much as 2.5 mm.
const LARGER: f64 = 1.0;

/// The unit of the values of objectives, which are forces of sides or displacements.
#[must_use]
pub fn value_unit(is_reaction: bool) -> &'static str {
    if is_reaction { REACTION_UNIT } else { "mm" }
}

/// A valid goal of a design.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    measure: &'static dyn Measure,
    raster: Raster,
    aims: Vec<PlacedAim>,
    area: Option<f64>,
    /// Whether smaller areas are as good.
    is_largest: bool,
    area_penalty: f64,
    /// Whether the penalty grows with scores above 1.
    has_strokes: bool,
    /// What a nC of charge takes off the score.
    charge_weight: f64,
    /// How the scores with several masks make one; `None` for the pattern as drawn alone.
    masks: Option<(usize, Criterion)>,
}

impl Goal {
    /// A goal for one or several points of a membrane, at a target area fraction or at any area. `area_penalty` is λ,
    /// by default [`AREA_PENALTY`]. Several points count by their weighted mean.
    ///
    /// # Errors
    /// If there is no point, a point is not inside the membrane, a number is out of range, or the measure is a
    /// distance and a point has no target displacement.
    pub fn new(
        measure: &'static dyn Measure,
        aims: &[Aim],
        membrane: Membrane,
        area: Option<f64>,
        area_penalty: f64,
    ) -> Result<Self, GoalError> {
        let mut sides = membrane.size_mm.into_iter();
        if let Some(side) = sides.find(|side| !(side.is_finite() && *side > 0.0)) {
            return Err(GoalError::Side(side));
        }
        if let Some(area) = area.filter(|area| !(0.0..=1.0).contains(area)) {
            return Err(GoalError::Area(area));
        }
        if !(area_penalty.is_finite() && area_penalty >= 0.0) {
            return Err(GoalError::Penalty(area_penalty));
        }
        if aims.is_empty() {
            return Err(GoalError::NoAim);
        }
        let forces = aims.iter().filter(|aim| aim.reaction.is_some()).count();
        if forces > 0 && forces < aims.len() {
            return Err(GoalError::Units);
        }
        if measure.needs_displacement() && aims.iter().any(|aim| !aim.motion.has_target()) {
            return Err(GoalError::NoDistance);
        }
        let mut placed: Vec<PlacedAim> = aims.iter().map(|aim| aim.placed(&membrane)).collect::<Result<_, _>>()?;
        let total: f64 = placed.iter().map(|aim| aim.weight).sum();
        placed.iter_mut().for_each(|aim| aim.weight /= total);
        Ok(Self {
            measure,
            raster: membrane.raster,
            aims: placed,
            area,
            is_largest: false,
            area_penalty,
            has_strokes: false,
            charge_weight: 0.0,
            masks: None,
        })
    }

    /// The goal on a membrane with sides that are not held: strokes have no bound like the displacements of a clamped
    /// membrane, for which λ is chosen, so the penalty is multiplied by the score where that is above 1. An area error
    /// of 1 % then costs 5 % of the displacement, more than a larger electrode gains far from pull-in.
    #[must_use]
    pub fn with_strokes(self, has_strokes: bool) -> Self {
        Self { has_strokes, ..self }
    }

    /// The goal with a largest area, in place of a target.
    #[must_use]
    pub fn with_largest_area(self, is_largest: bool) -> Self {
        Self { is_largest, ..self }
    }

    /// The goal with a weight of the charge: what a nC takes off the score. Fields need to have the charge.
    #[must_use]
    pub fn with_charge_weight(self, charge_weight: f64) -> Self {
        Self { charge_weight, ..self }
    }

    /// The goal for fields with each of several masks, as models [over several masks](crate::Masks::over) predict
    /// them: the first is the mask as drawn, whose motions are those of the goal.
    #[must_use]
    pub fn with_masks(self, count: usize, criterion: Criterion) -> Self {
        Self {
            masks: Some((count, criterion)),
            ..self
        }
    }

    /// Whether it counts for several masks.
    #[must_use]
    pub fn is_robust(&self) -> bool {
        self.masks.is_some()
    }

    /// The target area fraction, or the largest one; `None` if the area is free.
    #[must_use]
    pub fn area(&self) -> Option<f64> {
        self.area
    }

    /// Whether smaller areas than that are as good.
    #[must_use]
    pub fn has_largest_area(&self) -> bool {
        self.is_largest
    }

    /// The raster of the membrane.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.raster
    }

    /// The aims.
    #[must_use]
    pub fn aims(&self) -> &[PlacedAim] {
        &self.aims
    }

    /// Whether it counts heights or volumes.
    #[must_use]
    pub fn is_out_of_plane(&self) -> bool {
        self.aims.iter().any(PlacedAim::is_out_of_plane)
    }

    /// Whether its values are forces in mN, and not displacements in mm.
    #[must_use]
    pub fn is_reaction(&self) -> bool {
        self.aims.iter().any(PlacedAim::is_reaction)
    }

    /// The largest change of its value for each mm by which every corner is displaced: more than 1 for areas of
    /// regions.
    #[must_use]
    pub fn value_per_displacement(&self) -> f64 {
        let of = |aim: &PlacedAim| match &aim.subject {
            Subject::Region(region) => region.growth_per_displacement().max(1.0),
            _ => 1.0,
        };
        self.aims.iter().map(of).fold(1.0, f64::max)
    }

    /// The unit of its values.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        value_unit(self.is_reaction())
    }

    /// The value of fields (one per state of the device) in mm: the mean displacement of the points along their
    /// directions. That of forces is in mN. Rotations count as arc lengths, areas as the growth of a radius.
    #[must_use]
    pub fn value_mm(&self, fields: &[Field]) -> f64 {
        self.value_of(&self.motions(fields))
    }

    /// The [motion](PlacedAim::motion) of each aim in mm.
    #[must_use]
    pub fn motions(&self, fields: &[Field]) -> Vec<[f64; 2]> {
        self.aims.iter().map(|aim| aim.motion(fields)).collect()
    }

    /// The value in mm of the motions of the aims.
    #[must_use]
    pub fn value_of(&self, motions: &[[f64; 2]]) -> f64 {
        mean_along(&self.aims, motions)
    }

    /// The root mean square distance from the target displacements in mm; `None` if the goal is a direction.
    #[must_use]
    pub fn distance_mm(&self, fields: &[Field]) -> Option<f64> {
        let needs_displacement = self.measure.needs_displacement();
        needs_displacement.then(|| rms_error(&self.aims, &self.motions(fields)))
    }

    /// F of a pattern with an area fraction and its fields; smaller is better.
    #[must_use]
    pub fn fitness(&self, area: f64, fields: &[Field]) -> f64 {
        self.fitness_of(area, self.score(fields))
    }

    /// F of a pattern with an area fraction and a score; smaller is better.
    #[must_use]
    pub fn fitness_of(&self, area: f64, score: f64) -> f64 {
        let (area_error, violation) = match self.area {
            None => (0.0, 0.0),
            Some(wanted) if !self.is_largest => ((area - wanted).abs(), 0.0),
            Some(largest) if area <= largest + ROUNDING => (0.0, 0.0),
            Some(largest) => (area - largest, LARGER),
        };
        let scale = if self.has_strokes { score.abs().max(1.0) } else { 1.0 };
        1.0 - score + self.area_penalty * scale * area_error + violation * scale
    }

    /// The score of fields, independent of the area; larger is better.
    #[must_use]
    pub fn score(&self, fields: &[Field]) -> f64 {
        match self.masks {
            None => self.score_as_drawn(fields),
            Some((count, criterion)) => criterion.score(&self.scores(fields, count)),
        }
    }

    /// The score with each mask.
    fn scores(&self, fields: &[Field], count: usize) -> Vec<f64> {
        let of_masks = of_each_mask(fields, count);
        of_masks.map(|fields| self.score_as_drawn(fields)).collect()
    }

    /// The value that counts for several masks: the worst, or the mean less some standard deviations, of the
    /// displacement along the directions, or of the distance from targets, in mm; `None` for a mask as drawn.
    #[must_use]
    pub fn robust_value(&self, fields: &[Field]) -> Option<f64> {
        let (count, criterion) = self.masks?;
        let of_masks = of_each_mask(fields, count);
        Some(match self.measure.needs_displacement() {
            false => criterion.score(&of_masks.map(|fields| self.value_mm(fields)).collect::<Vec<_>>()),
            true => {
                let nearness = of_masks.map(|fields| -rms_error(&self.aims, &self.motions(fields)));
                -criterion.score(&nearness.collect::<Vec<_>>())
            }
        })
    }

    /// The fields of the membrane at rest in all states, with each mask.
    #[must_use]
    pub fn at_rest(&self, states: usize) -> StateFields {
        let masks = self.masks.map_or(1, |(count, _)| count);
        vec![Field::zero(self.raster); states * masks]
    }

    fn score_as_drawn(&self, fields: &[Field]) -> f64 {
        let charge: f64 = fields.iter().map(Field::charge).sum();
        self.score_of(&self.motions(fields)) - self.charge_weight * charge
    }

    /// What a score gains over the membrane at rest, in mm or mN: the displacement along the directions, or by how
    /// much the targets are nearer.
    #[must_use]
    pub fn gain(&self, score: f64, states: usize) -> f64 {
        SCALE_MM * (score - self.score(&self.at_rest(states)))
    }

    /// The score of the motions of the aims; larger is better.
    #[must_use]
    pub fn score_of(&self, motions: &[[f64; 2]]) -> f64 {
        self.measure.score(&self.aims, motions)
    }

    /// The derivative of [`Goal::score`] with respect to the displacement of each corner in each state, per mm, and
    /// with respect to the charge, per nC.
    #[must_use]
    pub fn slope(&self, fields: &[Field]) -> StateFields {
        let Some((count, criterion)) = self.masks else {
            return self.slope_as_drawn(fields);
        };
        let weights = criterion.weights(&self.scores(fields, count));
        let of_masks = of_each_mask(fields, count).zip(weights);
        let scaled = of_masks.flat_map(|(fields, weight)| {
            let slopes = self.slope_as_drawn(fields).into_iter();
            slopes.map(move |slope| slope.scaled(weight))
        });
        scaled.collect()
    }

    fn slope_as_drawn(&self, fields: &[Field]) -> StateFields {
        let gradients = self.measure.gradients(&self.aims, &self.motions(fields));
        let pairs = self.aims.iter().zip(gradients);
        let slopes = self.slopes(
            fields,
            pairs.map(|(aim, gradient)| (aim, gradient.map(|g| aim.weight * g))),
        );
        let charged = slopes.into_iter().map(|slope| slope.with_charge(-self.charge_weight));
        charged.collect()
    }

    /// The derivative of a quantity with respect to the displacements, given its `gradient` with respect to one
    /// motion.
    pub(super) fn slope_of(&self, aim: &PlacedAim, fields: &[Field], gradient: [f64; 2]) -> StateFields {
        self.slopes(fields, [(aim, gradient)].into_iter())
    }

    fn slopes<'a>(&self, fields: &[Field], each: impl Iterator<Item = (&'a PlacedAim, [f64; 2])>) -> StateFields {
        let mut slopes = vec![vec![0.0; 2 * self.raster.corners()]; fields.len()];
        let mut of_forces = vec![Reactions::default(); fields.len()];
        let mut out_of_plane = vec![(Vec::new(), 0.0); fields.len()];
        for (aim, gradient) in each {
            if aim.is_out_of_plane() {
                let (of_heights, of_volume) = aim.slope_out_of_plane(&fields[aim.state], gradient[0]);
                let (heights, volume) = &mut out_of_plane[aim.state];
                heights.resize(self.raster.corners(), 0.0);
                of_heights
                    .into_iter()
                    .for_each(|(corner, slope)| heights[corner] += slope);
                *volume += of_volume;
            }
            if let Subject::Reaction(side) = &aim.subject {
                let slopes = of_forces[aim.state][*side].iter_mut();
                slopes.zip(gradient).for_each(|(slope, g)| *slope += g);
            }
            for (corner, slope) in aim.slope(fields, gradient) {
                for (k, g) in slope.into_iter().enumerate() {
                    slopes[aim.state][2 * corner + k] += g;
                }
            }
        }
        let field = |slope| Field::from_values(self.raster, slope).unwrap_or_else(|_| Field::zero(self.raster));
        let all = slopes.into_iter().map(field).zip(of_forces).zip(out_of_plane);
        let slope = |((planar, of_forces), (heights, volume)): ((Field, Reactions), (Vec<f64>, f64))| {
            let slope = planar.with_reactions(of_forces);
            match heights.is_empty() {
                true => slope,
                false => slope
                    .in_space(heights, volume)
                    .unwrap_or_else(|_| Field::zero(self.raster)),
            }
        };
        all.map(slope).collect()
    }
}

/// The fields in all states with each of several masks.
fn of_each_mask(fields: &[Field], masks: usize) -> impl Iterator<Item = &[Field]> {
    fields.chunks((fields.len() / masks.max(1)).max(1))
}

#[cfg(test)]
mod tests;
