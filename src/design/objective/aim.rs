//! Points, bodies and regions and their target motions, and forces of sides.

use super::error::GoalError;
use super::region::RegionCells;
use deaflow_field::Field;
use deaflow_pattern::Membrane;

/// A point or body with its target motion in one state of the device.
#[derive(Clone, Debug, PartialEq)]
pub struct Aim {
    /// Position in mm from the lower left corner of the membrane; of a body or region its centroid.
    pub point_mm: [f64; 2],
    /// The markers of a rigid body; `None` for a point.
    pub body: Option<BodyMarkers>,
    /// The side whose force counts, in the order of `Edge`, instead of a motion.
    pub reaction: Option<usize>,
    /// The region whose area counts.
    pub region: Option<RegionCells>,
    /// The target motion.
    pub motion: Motion,
    /// The weight relative to other aims; positive.
    pub weight: f64,
    /// The state of the device, from 0.
    pub state: usize,
}

/// The target motion of a point or body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// As far as possible in a direction, in degrees counterclockwise from +x.
    Along(f64),
    /// A distance in mm in a direction.
    By(f64, f64),
    /// A displacement in mm.
    To([f64; 2]),
    /// Rotation of a body as far as possible; true is counterclockwise.
    Turn(bool),
    /// Rotation of a body by an angle in degrees, counterclockwise.
    TurnBy(f64),
    /// An area of a region as large as possible; false is as small as possible.
    Grow(bool),
    /// An area strain of a region.
    GrowBy(f64),
    /// A height as far as possible; true is up.
    Rise(bool),
    /// A height in mm.
    RiseBy(f64),
    /// A volume as far as possible; true is larger.
    Fill(bool),
    /// A volume in ml.
    FillBy(f64),
}

/// Two marker points, whose displacements give the translation and rotation of a rigid body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyMarkers {
    /// Column and row of two corners of cells of the body.
    pub ends: [[usize; 2]; 2],
    /// From the centroid of the body to the first marker in mm.
    pub start_mm: [f64; 2],
    /// From the first to the second marker in mm.
    pub offset_mm: [f64; 2],
    /// Distance of the outermost corner from the centroid in mm. A rotation counts as the arc length of this corner.
    pub arm_mm: f64,
}

/// An aim in cells of the raster.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedAim {
    /// Position in cells.
    pub point: [f64; 2],
    /// Unit vector; (1, 0) for a counterclockwise rotation, a larger area or volume and a greater height, (−1, 0) for
    /// their opposites.
    pub direction: [f64; 2],
    /// Target displacement in mm; zero without a target.
    pub target: [f64; 2],
    /// Weight; the weights of all aims add up to 1.
    pub weight: f64,
    /// The state of the device, from 0.
    pub state: usize,
    /// What moves.
    pub subject: Subject,
}

/// What moves.
#[derive(Clone, Debug, PartialEq)]
pub enum Subject {
    /// A point.
    Point,
    /// The centroid of a rigid body.
    Translation(BodyMarkers),
    /// A rigid body about its centroid.
    Rotation(BodyMarkers),
    /// Nothing: the change of the force of a side on the membrane, in mN in place of mm.
    Reaction(usize),
    /// The edge of a region: the growth of the disc of the same area.
    Region(RegionCells),
    /// A point out of the plane.
    Height,
    /// A rigid body out of the plane, with the column and row of a corner of cells that moves with it.
    BodyHeight([usize; 2]),
    /// The volume between the membrane and its plane: its mean height in mm for each ml.
    Volume(f64),
}

/// Cubic millimetres of a millilitre.
const CUBIC_MM: f64 = 1e3;

impl Aim {
    /// The aim of a point with weight 1 in the first state.
    #[must_use]
    pub fn new(point_mm: [f64; 2], motion: Motion) -> Self {
        Self {
            point_mm,
            body: None,
            reaction: None,
            region: None,
            motion,
            weight: 1.0,
            state: 0,
        }
    }

    pub(super) fn placed(&self, membrane: &Membrane) -> Result<PlacedAim, GoalError> {
        let mut inside = self.point_mm.iter().zip(membrane.size_mm);
        // Bars are on sides of the membrane.
        let can_be_on_edge = self.body.is_some() || self.reaction.is_some() || self.region.is_some();
        let is_inside = |c: f64, side: f64| (c > 0.0 && c < side) || (can_be_on_edge && (0.0..=side).contains(&c));
        if !inside.all(|(&c, side)| is_inside(c, side)) {
            return Err(GoalError::Point {
                point: self.point_mm,
                size: membrane.size_text(),
                size_mm: membrane.size_mm,
            });
        }
        if !(self.weight.is_finite() && self.weight > 0.0) {
            return Err(GoalError::Weight(self.weight));
        }
        let (subject, arm_mm) = match (self.motion.turns(), self.body, self.reaction, &self.region) {
            _ if self.motion.fills() => {
                let mean_height = CUBIC_MM / membrane.size_mm.iter().product::<f64>();
                (Subject::Volume(mean_height), mean_height)
            }
            (_, Some(markers), ..) if self.motion.rises() => (Subject::BodyHeight(markers.ends[0]), 0.0),
            _ if self.motion.rises() => (Subject::Height, 0.0),
            (false, _, _, Some(region)) => (Subject::Region(region.clone()), region.radius_mm()),
            (false, None, Some(side), None) => (Subject::Reaction(side), 0.0),
            (false, None, None, None) => (Subject::Point, 0.0),
            (false, Some(markers), _, None) => (Subject::Translation(markers), 0.0),
            (true, Some(markers), ..) => (Subject::Rotation(markers), markers.arm_mm),
            (true, None, ..) => return Err(GoalError::PointTurns),
        };
        let (direction, target) = self.motion.vectors(arm_mm)?;
        Ok(PlacedAim {
            point: membrane.in_cells(self.point_mm),
            direction,
            target,
            weight: self.weight,
            state: self.state,
            subject,
        })
    }
}

impl Motion {
    /// Whether there is a target displacement or angle, not only a direction.
    #[must_use]
    pub fn has_target(&self) -> bool {
        !matches!(
            self,
            Self::Along(_) | Self::Turn(_) | Self::Grow(_) | Self::Rise(_) | Self::Fill(_)
        )
    }

    fn rises(self) -> bool {
        matches!(self, Self::Rise(_) | Self::RiseBy(_))
    }

    fn fills(self) -> bool {
        matches!(self, Self::Fill(_) | Self::FillBy(_))
    }

    fn turns(self) -> bool {
        matches!(self, Self::Turn(_) | Self::TurnBy(_))
    }

    /// The direction, and the target displacement in mm; of a rotation the arc length at the end of an arm, of an area
    /// strain the growth of a radius, of a volume the mean height, with that of a ml as the arm.
    fn vectors(self, arm_mm: f64) -> Result<([f64; 2], [f64; 2]), GoalError> {
        let direction = |degrees: f64| match degrees.is_finite() {
            true => Ok(unit_vector(degrees)),
            false => Err(GoalError::Direction(degrees)),
        };
        let (direction, target) = match self {
            Self::Along(degrees) => (direction(degrees)?, [0.0; 2]),
            Self::By(degrees, length) => (direction(degrees)?, direction(degrees)?.map(|c| c * length)),
            Self::To(target) => {
                let length = target[0].hypot(target[1]);
                let along = if length > 0.0 {
                    target.map(|c| c / length)
                } else {
                    [1.0, 0.0]
                };
                (along, target)
            }
            Self::Turn(counterclockwise) => ([if counterclockwise { 1.0 } else { -1.0 }, 0.0], [0.0; 2]),
            Self::TurnBy(degrees) => (
                [if degrees < 0.0 { -1.0 } else { 1.0 }, 0.0],
                [degrees.to_radians() * arm_mm, 0.0],
            ),
            Self::Grow(positive) | Self::Rise(positive) | Self::Fill(positive) => {
                ([if positive { 1.0 } else { -1.0 }, 0.0], [0.0; 2])
            }
            Self::RiseBy(height) => ([if height < 0.0 { -1.0 } else { 1.0 }, 0.0], [height, 0.0]),
            Self::FillBy(volume) => ([if volume < 0.0 { -1.0 } else { 1.0 }, 0.0], [arm_mm * volume, 0.0]),
            Self::GrowBy(strain) => (
                [if strain < 0.0 { -1.0 } else { 1.0 }, 0.0],
                [arm_mm * ((1.0 + strain).sqrt() - 1.0), 0.0],
            ),
        };
        match target.iter().all(|c| c.is_finite()) {
            true => Ok((direction, target)),
            false => Err(GoalError::Displacement(target)),
        }
    }
}

impl BodyMarkers {
    /// From the first to the second marker in the deformed state, in mm.
    fn offset(&self, field: &Field) -> [f64; 2] {
        let [from, to] = self.ends.map(|[x, y]| field.at_corner(x, y));
        [0, 1].map(|k| self.offset_mm[k] + to[k] - from[k])
    }

    /// The rotation of the body in radians.
    fn angle(&self, field: &Field) -> f64 {
        let ([x, y], [a, b]) = (self.offset_mm, self.offset(field));
        (x * b - y * a).atan2(x * a + y * b)
    }

    /// The derivative of the angle with respect to the displacement of the second marker; that of the first is its
    /// negative.
    fn angle_gradient(&self, field: &Field) -> [f64; 2] {
        let [a, b] = self.offset(field);
        let squared = a * a + b * b;
        [-b / squared, a / squared]
    }

    /// The displacement of the centroid in mm: t = u − (R − I)(X − Xc) at the first marker.
    fn translation(&self, field: &Field) -> [f64; 2] {
        let ([x, y], [u, v]) = (self.start_mm, field.at_corner(self.ends[0][0], self.ends[0][1]));
        let (sine, cosine) = self.angle(field).sin_cos();
        [u - (cosine - 1.0) * x + sine * y, v - sine * x - (cosine - 1.0) * y]
    }

    /// The derivative of the translation with respect to the angle at a fixed first marker.
    fn translation_by_angle(&self, field: &Field) -> [f64; 2] {
        let ([x, y], (sine, cosine)) = (self.start_mm, self.angle(field).sin_cos());
        [sine * x + cosine * y, sine * y - cosine * x]
    }
}

impl PlacedAim {
    /// The motion in mm, given the fields in the states of the device: a displacement, or (arc length, 0) of a
    /// rotation, or (growth of the radius, 0) of a region, (height, 0) or (mean height, 0) of a volume; of a force its
    /// change in mN.
    #[must_use]
    pub fn motion(&self, fields: &[Field]) -> [f64; 2] {
        let field = &fields[self.state];
        match &self.subject {
            Subject::Point => field.at(self.point),
            Subject::Translation(markers) => markers.translation(field),
            Subject::Rotation(markers) => [markers.arm_mm * markers.angle(field), 0.0],
            Subject::Reaction(side) => field.reactions()[*side],
            Subject::Region(region) => [region.growth_mm(field), 0.0],
            Subject::Height => [field.height_at(self.point), 0.0],
            Subject::BodyHeight([x, y]) => [field.height(corner_index(field, [*x, *y])), 0.0],
            Subject::Volume(mean_height) => [mean_height * field.volume(), 0.0],
        }
    }

    /// Whether it is a height or a volume.
    #[must_use]
    pub fn is_out_of_plane(&self) -> bool {
        matches!(
            self.subject,
            Subject::Height | Subject::BodyHeight(_) | Subject::Volume(_)
        )
    }

    /// The derivatives of a quantity with respect to the heights of corners, and to the volume per ml, given its
    /// `gradient` with respect to the motion.
    pub(super) fn slope_out_of_plane(&self, field: &Field, gradient: f64) -> (Vec<(usize, f64)>, f64) {
        match self.subject {
            Subject::Height => {
                let shares = Field::interpolation_weights(field.raster(), self.point).into_iter();
                (shares.map(|(corner, share)| (corner, share * gradient)).collect(), 0.0)
            }
            Subject::BodyHeight(corner) => (vec![(corner_index(field, corner), gradient)], 0.0),
            Subject::Volume(mean_height) => (Vec::new(), mean_height * gradient),
            _ => (Vec::new(), 0.0),
        }
    }

    /// Whether it is a force.
    #[must_use]
    pub fn is_reaction(&self) -> bool {
        matches!(self.subject, Subject::Reaction(_))
    }

    /// The component of a motion along the direction in mm.
    #[must_use]
    pub fn along(&self, [x, y]: [f64; 2]) -> f64 {
        x * self.direction[0] + y * self.direction[1]
    }

    /// The difference between a motion and the target in mm.
    #[must_use]
    pub fn error(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [x - self.target[0], y - self.target[1]]
    }

    /// The derivative of a quantity with respect to the displacements of corners, given its `gradient` with respect to
    /// the motion: pairs of a corner index in `[y][x]` and the derivatives with respect to both components.
    pub(super) fn slope(&self, fields: &[Field], gradient: [f64; 2]) -> Vec<(usize, [f64; 2])> {
        let field = &fields[self.state];
        let (markers, by_angle, at_start) = match &self.subject {
            Subject::Point => {
                let shares = Field::interpolation_weights(field.raster(), self.point).into_iter();
                return shares
                    .map(|(corner, share)| (corner, gradient.map(|g| g * share)))
                    .collect();
            }
            // These have their own slopes.
            Subject::Reaction(_) | Subject::Height | Subject::BodyHeight(_) | Subject::Volume(_) => return Vec::new(),
            Subject::Region(region) => return region.slope(field, gradient[0]),
            Subject::Rotation(markers) => (markers, markers.arm_mm * gradient[0], [0.0; 2]),
            Subject::Translation(markers) => {
                let [x, y] = markers.translation_by_angle(field);
                (markers, x * gradient[0] + y * gradient[1], gradient)
            }
        };
        let turn = markers.angle_gradient(field).map(|slope| slope * by_angle);
        let columns = field.raster().columns() + 1;
        let [start, end] = markers.ends.map(|[x, y]| y * columns + x);
        vec![(start, [0, 1].map(|k| at_start[k] - turn[k])), (end, turn)]
    }
}

/// The index in `[y][x]` of a corner of cells, given by its column and row.
fn corner_index(field: &Field, [x, y]: [usize; 2]) -> usize {
    y * (field.raster().columns() + 1) + x
}

/// The mean component of the motions along the directions of the aims in mm.
pub(super) fn mean_along(aims: &[PlacedAim], motions: &[[f64; 2]]) -> f64 {
    weighted_mean(aims, motions, PlacedAim::along)
}

/// The root mean square difference between motions and targets in mm.
pub(super) fn rms_error(aims: &[PlacedAim], motions: &[[f64; 2]]) -> f64 {
    let squared = |aim: &PlacedAim, motion| {
        let [x, y] = aim.error(motion);
        x * x + y * y
    };
    weighted_mean(aims, motions, squared).sqrt()
}

/// The mean of a value of each aim and its motion, with the weights of the aims.
pub(super) fn weighted_mean(
    aims: &[PlacedAim],
    motions: &[[f64; 2]],
    value: impl Fn(&PlacedAim, [f64; 2]) -> f64,
) -> f64 {
    let pairs = aims.iter().zip(motions);
    pairs.map(|(aim, motion)| aim.weight * value(aim, *motion)).sum()
}

/// The unit vector at an angle, exact at multiples of 90° and with equal components at odd multiples of 45°, so that
/// symmetric goals have identical results to the last bit.
fn unit_vector(degrees: f64) -> [f64; 2] {
    let degrees = degrees.rem_euclid(360.0);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let eighths = degrees / 45.0;
    if eighths.fract() == 0.0 {
        return match eighths as u32 {
            1 => [half, half],
            2 => [0.0, 1.0],
            3 => [-half, half],
            4 => [-1.0, 0.0],
            5 => [-half, -half],
            6 => [0.0, -1.0],
            7 => [half, -half],
            _ => [1.0, 0.0],
        };
    }
    let (sine, cosine) = degrees.to_radians().sin_cos();
    [cosine, sine]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_directions_are_exactly_opposite() {
        for degrees in [0.0, 45.0, 90.0, 135.0, 405.0, -45.0] {
            let (there, back) = (unit_vector(degrees), unit_vector(degrees + 180.0));
            assert_eq!(there.map(|c| -c), back);
            assert!((there[0] - degrees.to_radians().cos()).abs() < 1e-15);
            assert!((there[1] - degrees.to_radians().sin()).abs() < 1e-15);
        }
    }
}
