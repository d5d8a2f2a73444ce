//! The targets and constraints of a design stage in a scene.

use super::constraint::ConstraintParameters;
use super::front::Front;
use super::objective::{ResponseKind, Subject};
use super::options::{Method, SearchOptions};
use super::planned::PlannedDesign;
use super::target::{Area, CaseLabel, Target, Targets};
use deaflow_base::{InputError, Map, Node};
use deaflow_pattern::Part;
use deaflow_scene::Scene;

/// The targets and constraints of a design stage in a scene.
#[derive(Clone, Debug)]
pub struct DesignTask {
    /// The targets.
    pub targets: Vec<Target>,
    /// The constraints.
    pub constraints: ConstraintParameters,
    /// The front of the target, if the stage has several objectives.
    pub front: Option<Front>,
}

impl DesignTask {
    /// Reads the constraints of a stage, and evaluates its targets in the scene. `map` is the mapping of the stage.
    ///
    /// # Errors
    /// If the constraints contradict each other, a breakdown margin has no breakdown strength, or an objective is
    /// invalid in the scene.
    pub fn read(
        (targets, options): (Targets, &SearchOptions),
        (map, stage): (&Map<'_>, &Node),
        scene: &Scene,
    ) -> Result<Self, InputError> {
        let constraints = match map.optional("constraints") {
            Some(node) => read_constraints(node, scene)?,
            None => ConstraintParameters::none_in(scene).map_err(|e| stage.error(e.to_string()))?,
        };
        let penalty = options.area_penalty.to_f64();
        let front = targets.front(map, scene, penalty)?;
        let targets = targets.in_scene(map, scene, penalty)?;
        let forces = targets.iter().filter(|target| target.objective.is_reaction()).count();
        if forces > 0 && forces < targets.len() {
            let message = "some targets are reactions, in mN, and others motions, in mm";
            let node = map.optional("targets").unwrap_or(stage);
            return Err(node.error(message).help("design them in two stages"));
        }
        Ok(Self {
            targets,
            constraints,
            front,
        })
    }

    /// Returns the designs that a stage will search.
    #[must_use]
    pub fn planned(&self, stage: &str, case: Option<&CaseLabel>, options: &SearchOptions) -> Vec<PlannedDesign> {
        let planned = |target: &Target, name: String| PlannedDesign {
            stage: stage.to_owned(),
            case: case.map_or_else(String::new, |case| case.0.clone()),
            target: name,
            objective: target.objective.to_text(),
            response: target.objective.response(),
            is_reaction: target.objective.is_reaction(),
            area: target.area.to_string(),
            constraints: self.constraints.to_text(),
            method: options.method,
            units: options.units,
        };
        let names = |target: &Target| match &self.front {
            Some(front) => (0..front.pareto.points).map(Front::point_name).collect(),
            None => vec![target.name.clone()],
        };
        let all = self.targets.iter();
        all.flat_map(|target| names(target).into_iter().map(|name| planned(target, name)))
            .collect()
    }

    /// Refuses points on a frame, areas that the constraints exclude, and distances that designs of the area cannot
    /// have.
    ///
    /// # Errors
    /// If a target cannot be reached for one of these reasons.
    pub fn check(
        &self,
        options: &SearchOptions,
        (map, stage): (&Map<'_>, &Node),
        scene: &Scene,
    ) -> Result<(), InputError> {
        let node = map.optional("objective").unwrap_or(stage);
        for target in &self.targets {
            refuse_points_on_frame(target, scene, node)?;
        }
        let common = map.optional("area").or(map.optional("constraints")).unwrap_or(stage);
        let items = map
            .optional("targets")
            .map_or(Ok(&[][..]), |list| list.list("targets"))?;
        let tolerance = options.area_tolerance.to_f64();
        for (at, target) in self.targets.iter().enumerate() {
            let node = items.get(at).and_then(|item| item.peek("area")).unwrap_or(common);
            match target.area {
                Area::Free => {}
                Area::Near(area) => {
                    self.constraints.check_area(node, area.to_f64(), tolerance)?;
                    // The genetic algorithm alone comes as near as it can.
                    if options.method == Method::Adjoint || options.refine {
                        self.constraints.check_area_of_cells(node, area.to_f64(), tolerance)?;
                    }
                }
                Area::AtMost(largest) => {
                    let possible = self.constraints.constraints().largest_area();
                    self.constraints.check_area(node, largest.to_f64().min(possible), 0.0)?;
                }
            }
        }
        self.check_distance(
            options,
            map.optional("distance").or(map.optional("designs")).unwrap_or(stage),
        )
    }

    /// Refuses several designs of gradient search that differ in more cells than two patterns of the area can.
    fn check_distance(&self, options: &SearchOptions, node: &Node) -> Result<(), InputError> {
        if options.method != Method::Adjoint || options.designs < 2 {
            return Ok(());
        }
        let (distance, tolerance) = (options.distance.to_f64(), options.area_tolerance.to_f64());
        let constraints = self.constraints.constraints();
        let share = constraints.free_count() as f64 / constraints.membrane().raster.cells() as f64;
        for target in &self.targets {
            let Some(area) = target.area.fraction() else { continue };
            // Cells without electrodes in both patterns do not differ, and with one group neither do those with
            // electrodes in both.
            let active = 2.0 * (area + tolerance);
            let largest = match (constraints.groups(), target.area) {
                (1, Area::Near(_)) => active.min(2.0 * (1.0 - area + tolerance)),
                _ => active,
            };
            let largest = share * largest.min(1.0);
            if distance > largest + 1e-9 {
                return Err(node
                    .error(format!(
                        "`distance: {}` is not possible: two patterns of area {} within {} differ in at most \
                         {largest:.4} of the cells",
                        options.distance, target.area, options.area_tolerance
                    ))
                    .help("reduce `distance`, or use `designs: 1`"));
            }
        }
        Ok(())
    }

    /// The parts of the scene on which the designs depend. In addition to those that are simulated, a breakdown margin
    /// depends on the breakdown strength, and an amplitude on the bias voltage.
    #[must_use]
    pub fn relevant_scene(&self, scene: &Scene) -> Scene {
        let is_amplitude = |target: &Target| matches!(target.objective.response(), ResponseKind::Amplitude(_));
        let mut relevant = match self.targets.iter().any(is_amplitude) {
            true => scene.simulated_about_bias(),
            false => scene.simulated(),
        };
        if self.constraints.constraints().limits().breakdown_margin.is_some() {
            let strength = &scene.properties.dielectric_breakdown;
            relevant.properties.dielectric_breakdown.clone_from(strength);
        }
        relevant
    }
}

/// Reads constraints; a breakdown margin needs the breakdown strength of the elastomer.
fn read_constraints(node: &Node, scene: &Scene) -> Result<ConstraintParameters, InputError> {
    let constraints = ConstraintParameters::read(node, scene)?;
    let has_margin = constraints.constraints().limits().breakdown_margin.is_some();
    if has_margin && scene.breakdown_strength().is_none() {
        return Err(node
            .peek("breakdown_margin")
            .unwrap_or(node)
            .error("`breakdown_margin` needs the breakdown strength of the elastomer")
            .help("add `dielectric_breakdown` to the scene's `properties`"));
    }
    Ok(constraints)
}

/// Refuses a target with a point on a frame, which does not move.
fn refuse_points_on_frame(target: &Target, scene: &Scene, node: &Node) -> Result<(), InputError> {
    let Some(parts) = scene.parts() else { return Ok(()) };
    let sides = parts.raster().sides();
    let points = target
        .goal
        .aims()
        .iter()
        .filter(|aim| matches!(aim.subject, Subject::Point | Subject::Height));
    let mut cells = points.map(|aim| [0, 1].map(|axis| (aim.point[axis] as usize).min(sides[axis] - 1)));
    match cells.find(|[x, y]| parts.at(*x, *y) == Part::Frame) {
        None => Ok(()),
        Some([x, y]) => Err(node.error(format!(
            "a point of `{}` is on the frame, in cell [{x}, {y}], which does not move",
            target.name
        ))),
    }
}
