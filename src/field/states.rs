//! Predictors for a device with several states, which has a field for each.

use std::cell::RefCell;
use std::ops::Deref;

use super::displacement::Field;
use super::simulate::{Differentiable, Evaluator, PredictError, Predictor, WithGradient};
use deaflow_pattern::Pattern;

/// The fields of a pattern in the states of a device, in their order; a single one without states.
pub type StateFields = Vec<Field>;

/// The predictors of the states of a device, in their order.
pub struct InStates<P>(Vec<P>);

impl<P> InStates<P> {
    /// Combines the predictors of all states.
    #[must_use]
    pub fn new(each: Vec<P>) -> Self {
        Self(each)
    }

    /// Wraps the predictor of a device without states.
    #[must_use]
    pub fn one(only: P) -> Self {
        Self(vec![only])
    }

    /// Applies `of_state` to each state; a pattern needs a field in all of them.
    fn in_all(
        &self,
        patterns: &[Pattern],
        of_state: impl Fn(&P) -> Result<Vec<Option<Field>>, PredictError>,
    ) -> Result<Vec<Option<StateFields>>, PredictError> {
        let mut found = vec![Some(StateFields::with_capacity(self.0.len())); patterns.len()];
        for state in &self.0 {
            let fields = of_state(state)?;
            if fields.len() != patterns.len() {
                let message = format!("{} fields for {} patterns", fields.len(), patterns.len());
                return Err(PredictError::failed(message));
            }
            for (all, field) in found.iter_mut().zip(fields) {
                match (all.as_mut(), field) {
                    (Some(all), Some(field)) => all.push(field),
                    _ => *all = None,
                }
            }
        }
        Ok(found)
    }
}

impl<P: Deref<Target: Predictor> + Sync> Predictor<StateFields> for InStates<P> {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.in_all(patterns, |state| state.predict_some(patterns))
    }
}

/// The results of the nested solution of all states.
#[derive(Default)]
struct Solved {
    fields: StateFields,
    slopes: StateFields,
    gradient: Vec<f64>,
}

impl<P: Deref<Target: Differentiable> + Sync> InStates<P> {
    /// Solves a state, and the following states within its slope function, so that all fields are known before the
    /// first slope, and each state is solved once. Returns whether all states have a field.
    fn solve_from(
        &self,
        state: usize,
        pattern: &Pattern,
        slope: &dyn Fn(&StateFields) -> StateFields,
        solved: &RefCell<Solved>,
    ) -> Result<bool, PredictError> {
        let Some(own) = self.0.get(state) else {
            let slopes = slope(&solved.borrow().fields);
            solved.borrow_mut().slopes = slopes;
            return Ok(true);
        };
        let later = RefCell::new(Ok(false));
        let found = own.gradient(pattern, &|field| {
            solved.borrow_mut().fields.push(field.clone());
            let all = self.solve_from(state + 1, pattern, slope, solved);
            let own = match all {
                Ok(true) => solved.borrow().slopes[state].clone(),
                _ => Field::zero(field.raster()),
            };
            *later.borrow_mut() = all;
            own
        })?;
        let (true, Some((_, gradient))) = (later.into_inner()?, found) else {
            return Ok(false);
        };
        let mut solved = solved.borrow_mut();
        match solved.gradient.is_empty() {
            true => solved.gradient = gradient,
            false => solved
                .gradient
                .iter_mut()
                .zip(gradient)
                .for_each(|(sum, own)| *sum += own),
        }
        Ok(true)
    }
}

impl<P: Deref<Target: Differentiable> + Sync> Differentiable<StateFields> for InStates<P> {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&StateFields) -> StateFields,
    ) -> Result<Option<WithGradient<StateFields>>, PredictError> {
        let solved = RefCell::default();
        let all = self.solve_from(0, pattern, slope, &solved)?;
        let Solved { fields, gradient, .. } = solved.into_inner();
        Ok(all.then_some((fields, gradient)))
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.in_all(patterns, |state| state.predict_near(base, patterns))
    }

    fn linear_response(&self, weights: &[StateFields]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
        let mut sums: Vec<WithGradient<f64>> = vec![(0.0, Vec::new()); weights.len()];
        for (at, state) in self.0.iter().enumerate() {
            let own: Vec<Field> = weights.iter().map(|weights| weights[at].clone()).collect();
            let Some(own) = state.linear_response(&own)? else {
                return Ok(None);
            };
            for (sum, own) in sums.iter_mut().zip(own) {
                sum.0 += own.0;
                sum.1.resize(own.1.len(), 0.0);
                sum.1.iter_mut().zip(own.1).for_each(|(sum, own)| *sum += own);
            }
        }
        Ok(Some(sums))
    }
}

/// A weighted sum of several predictors.
pub struct Weighted<P> {
    parts: InStates<P>,
    weights: Vec<f64>,
    settings: String,
}

impl<P> Weighted<P> {
    /// Combines one or more predictors with their weights; `settings` describes them.
    #[must_use]
    pub fn new(parts: Vec<P>, weights: Vec<f64>, settings: String) -> Self {
        Self {
            parts: InStates(parts),
            weights,
            settings,
        }
    }

    /// Returns the slope of each part from that of the sum.
    fn of_parts(&self, slope: &Field) -> StateFields {
        self.weights.iter().map(|weight| slope.scaled(*weight)).collect()
    }

    fn sum(&self, fields: &[Field]) -> Field {
        let mut values = vec![0.0; fields[0].values().len()];
        for (field, weight) in fields.iter().zip(&self.weights) {
            let pairs = values.iter_mut().zip(field.values());
            pairs.for_each(|(sum, value)| *sum += weight * value);
        }
        let raster = fields[0].raster();
        Field::from_values(raster, values).unwrap_or_else(|_| Field::zero(raster))
    }
}

impl<P: Deref<Target: Predictor> + Sync> Predictor for Weighted<P> {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        let each = self.parts.predict_some(patterns)?.into_iter();
        Ok(each.map(|fields| fields.map(|fields| self.sum(&fields))).collect())
    }
}

impl<P: Deref<Target: Predictor> + Sync + Send> Evaluator for Weighted<P> {
    fn settings(&self) -> String {
        self.settings.clone()
    }
}

impl<P: Deref<Target: Differentiable> + Sync> Differentiable for Weighted<P> {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&Field) -> Field,
    ) -> Result<Option<WithGradient>, PredictError> {
        let of_parts = |fields: &StateFields| self.of_parts(&slope(&self.sum(fields)));
        let found = self.parts.gradient(pattern, &of_parts)?;
        Ok(found.map(|(fields, gradient)| (self.sum(&fields), gradient)))
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        let each = self.parts.predict_near(base, patterns)?.into_iter();
        Ok(each.map(|fields| fields.map(|fields| self.sum(&fields))).collect())
    }

    fn linear_response(&self, weights: &[Field]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
        let of_parts: Vec<StateFields> = weights.iter().map(|weights| self.of_parts(weights)).collect();
        self.parts.linear_response(&of_parts)
    }
}
