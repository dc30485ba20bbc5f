//! The axes of an arm in numbers: frames, Jacobian and singular values without allocation, and how far the flange can be.

use graspbox_hand::{Arm, JointKind};
use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};
use std::f64::consts::{PI, TAU};

/// Most axes of an arm; the reader of arms accepts no more.
pub const MAX_AXES: usize = 12;

/// Positions of the axes; those beyond the arm's number are 0.
pub type Positions = [f64; MAX_AXES];

/// A rigid motion as a matrix and a vector: products of them are what a search spends its time on.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    pub turn: Matrix3<f64>,
    pub shift: Vector3<f64>,
}

impl Motion {
    /// The same motion.
    #[must_use]
    pub fn new(pose: &Isometry3<f64>) -> Self {
        Self { turn: *pose.rotation.to_rotation_matrix().matrix(), shift: pose.translation.vector }
    }

    pub(crate) fn then(&self, next: &Self) -> Self {
        Self { turn: self.turn * next.turn, shift: self.turn * next.shift + self.shift }
    }

    /// The same motion as an isometry.
    #[must_use]
    pub fn isometry(&self) -> Isometry3<f64> {
        let turn = nalgebra::Rotation3::from_matrix_unchecked(self.turn);
        Isometry3::from_parts(Translation3::from(self.shift), UnitQuaternion::from_rotation_matrix(&turn))
    }
}

/// One axis: the z axis of its frame.
#[derive(Clone, Debug)]
struct Axis {
    /// Frame of the axis at position 0 in the frame of the axis before it.
    before: Motion,
    revolute: bool,
    limits: [f64; 2],
    home: f64,
    speed: f64,
}

/// The axes of an arm from its base to its flange.
#[derive(Clone, Debug)]
pub struct Chain {
    axes: Vec<Axis>,
    /// The flange in the frame of the last axis.
    last: Motion,
    /// For each rigid body that an axis moves, its first link's frame in the frame of the axis.
    links: Vec<Isometry3<f64>>,
    /// A point of the first axis and one of the flange, and the greatest distance between them.
    span: Span,
}

/// The farthest that a point fixed to the flange can be from a point fixed to the base.
#[derive(Clone, Debug)]
struct Span {
    in_base: Vector3<f64>,
    in_flange: Vector3<f64>,
    most: f64,
}

/// Frames of all axes and of the flange in the base's frame.
#[derive(Clone, Copy, Debug)]
pub struct Frames {
    /// Frame of each axis, turned with it.
    pub axes: [Motion; MAX_AXES],
    pub flange: Motion,
}

impl Chain {
    /// The axes of an arm.
    #[must_use]
    pub fn new(arm: &Arm) -> Self {
        let (mut axes, mut links) = (Vec::new(), Vec::new());
        // Frame of the last axis so far, and the link that it moves.
        let (mut link_from_axis, mut from) = (Isometry3::identity(), 0);
        for axis in &arm.axes {
            let joint = &arm.joints[axis.joint];
            let turn = UnitQuaternion::rotation_between(&Vector3::z(), &joint.axis)
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
            let fixed = fixed_pose(arm, from, joint.parent) * joint.parent_from_joint * turn;
            axes.push(Axis {
                before: Motion::new(&(link_from_axis.inverse() * fixed)),
                revolute: joint.kind == JointKind::Revolute,
                limits: joint.limits,
                home: axis.home,
                speed: axis.speed,
            });
            from = joint.child;
            link_from_axis = Isometry3::from_parts(Translation3::identity(), turn);
            links.push(link_from_axis.inverse());
        }
        let last = link_from_axis.inverse() * fixed_pose(arm, from, arm.flange);
        let mut chain = Self {
            axes,
            last: Motion::new(&last),
            links,
            span: Span { in_base: Vector3::zeros(), in_flange: Vector3::zeros(), most: f64::INFINITY },
        };
        chain.span = chain.span();
        chain
    }

    /// Number of axes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.axes.len()
    }

    /// True without axes, which no arm is.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.axes.is_empty()
    }

    pub(crate) fn limits(&self, axis: usize) -> [f64; 2] {
        self.axes[axis].limits
    }

    pub(crate) fn home(&self, axis: usize) -> f64 {
        self.axes[axis].home
    }

    /// True where a turn of an axis comes back to the same posture of the arm.
    pub(crate) fn is_revolute(&self, axis: usize) -> bool {
        self.axes[axis].revolute
    }

    /// Frame of an axis at position 0 in the frame of the axis before it, or in the base's.
    pub(crate) fn before(&self, axis: usize) -> &Motion {
        &self.axes[axis].before
    }

    pub(crate) fn speed(&self, axis: usize) -> f64 {
        self.axes[axis].speed
    }

    /// Pose of the first link of the body that an axis moves, in the frame of the axis.
    pub(crate) fn axis_from_link(&self, axis: usize) -> &Isometry3<f64> {
        &self.links[axis]
    }

    /// The flange in the frame of the last axis.
    #[must_use]
    pub fn axis_from_flange(&self) -> Isometry3<f64> {
        self.last.isometry()
    }

    /// A length of the arm: how far the flange can be from the first axis, metres.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.span.most
    }

    /// Frames of all axes and of the flange.
    #[must_use]
    pub fn frames(&self, positions: &Positions) -> Frames {
        let identity = Motion { turn: Matrix3::identity(), shift: Vector3::zeros() };
        let mut frames = Frames { axes: [identity; MAX_AXES], flange: identity };
        let mut at = identity;
        for (index, axis) in self.axes.iter().enumerate() {
            at = at.then(&axis.before);
            if axis.revolute {
                let (sin, cos) = positions[index].sin_cos();
                let (x, y) = (
                    at.turn.column(0) * cos + at.turn.column(1) * sin,
                    at.turn.column(1) * cos - at.turn.column(0) * sin,
                );
                at.turn.set_column(0, &x);
                at.turn.set_column(1, &y);
            } else {
                at.shift += at.turn.column(2) * positions[index];
            }
            frames.axes[index] = at;
        }
        frames.flange = at.then(&self.last);
        frames
    }

    /// Column of the Jacobian of the flange for an axis: its velocity (m) and angular velocity (rad) per rad or m, base frame.
    #[must_use]
    pub fn column(&self, frames: &Frames, axis: usize) -> Vector6<f64> {
        self.column_at(frames, axis, &frames.flange.shift)
    }

    /// The same for a point that the axis moves, base frame.
    pub(crate) fn column_at(&self, frames: &Frames, axis: usize, point: &Vector3<f64>) -> Vector6<f64> {
        let at = &frames.axes[axis];
        let along: Vector3<f64> = at.turn.column(2).into();
        let (linear, angular) = if self.axes[axis].revolute {
            (along.cross(&(point - at.shift)), along)
        } else {
            (along, Vector3::zeros())
        };
        Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
    }

    /// The least singular value of the Jacobian (m and rad): 0 where the arm loses a direction.
    #[must_use]
    pub fn least_singular_value(&self, positions: &Positions) -> f64 {
        let frames = self.frames(positions);
        let mut squares = Matrix6::zeros();
        for axis in 0..self.len() {
            let column = self.column(&frames, axis);
            squares += column * column.transpose();
        }
        let mut values: Vec<f64> = squares.symmetric_eigenvalues().iter().copied().collect();
        values.sort_by(|a, b| b.total_cmp(a));
        values[self.len().min(6) - 1].max(0.0).sqrt()
    }

    /// Distance to the nearest limit, as a share of half the range of that axis: 0 at a limit, 1 with all axes in the middle.
    #[must_use]
    pub fn room(&self, positions: &Positions) -> f64 {
        let share = |(index, axis): (usize, &Axis)| {
            let [lower, upper] = axis.limits;
            2.0 * (positions[index] - lower).min(upper - positions[index]) / (upper - lower)
        };
        self.axes.iter().enumerate().map(share).fold(1.0, f64::min).max(0.0)
    }

    /// Time from home at the greatest speeds, seconds.
    #[must_use]
    pub fn time_from_home(&self, positions: &Positions) -> f64 {
        let times = self.axes.iter().enumerate().map(|(index, axis)| (positions[index] - axis.home).abs() / axis.speed);
        times.fold(0.0, f64::max)
    }

    /// Whole turns added so that each axis is as near to home as its limits allow.
    pub(crate) fn nearest_home(&self, positions: &mut Positions) {
        for (index, axis) in self.axes.iter().enumerate().filter(|(_, axis)| axis.revolute) {
            let [lower, upper] = axis.limits;
            let at = positions[index];
            let within = |turns: f64| (lower..=upper).contains(&(at + turns * TAU));
            let wanted = ((axis.home - at) / TAU).round();
            // The nearest turn that the limits allow; one more than wanted on either side is enough within 4 turns.
            let tried = [0.0, -1.0, 1.0, -2.0, 2.0].map(|more| wanted + more);
            if let Some(turns) = tried.into_iter().find(|turns| within(*turns)) {
                positions[index] = at + turns * TAU;
            }
        }
    }

    /// The distance by which a pose of the flange is beyond what the axes allow; 0 or less where this does not rule it out.
    ///
    /// A bound of the lengths between the axes, which holds for all positions: a pose for which it is positive has no solution.
    #[must_use]
    pub fn excess(&self, base_from_flange: &Motion) -> f64 {
        let point = base_from_flange.turn * self.span.in_flange + base_from_flange.shift;
        (point - self.span.in_base).norm() - self.span.most
    }

    /// The tightest sum of distances between a point of the first axis, points of all axes between, and one of the last axis.
    ///
    /// A point of a revolute axis stays where it is as the axis turns, so that the distance between two such points on successive axes is
    /// constant. Any choice of points gives a bound; sliding them along their axes, one after the other, makes it as small as possible.
    fn span(&self) -> Span {
        let count = self.axes.len();
        let mut slides = vec![0.0; count];
        // Points of axes i and i + 1 in the frame of axis i; a prismatic axis adds its travel.
        let travel: f64 =
            self.axes.iter().filter(|a| !a.revolute).map(|a| a.limits[0].abs().max(a.limits[1].abs())).sum();
        let point =
            |axis: usize, slide: f64| self.axes[axis].before.turn.column(2) * slide + self.axes[axis].before.shift;
        let between =
            |slides: &[f64], axis: usize| (point(axis + 1, slides[axis + 1]) - Vector3::z() * slides[axis]).norm();
        for _ in 0..SWEEPS {
            for axis in 0..count {
                let cost = |slide: f64| {
                    let mut moved = slides.clone();
                    moved[axis] = slide;
                    let own = [axis.checked_sub(1), (axis + 1 < count).then_some(axis)];
                    own.into_iter().flatten().map(|pair| between(&moved, pair)).sum::<f64>()
                };
                slides[axis] = least(cost, -REACH_OF_SEARCH, REACH_OF_SEARCH);
            }
        }
        let most = (0..count.saturating_sub(1)).map(|axis| between(&slides, axis)).sum::<f64>() + travel;
        let end = Vector3::z() * slides[count - 1];
        let in_flange = self.last.turn.tr_mul(&(end - self.last.shift));
        // The first and the last axis may be prismatic: their travel is part of the sum.
        Span { in_base: point(0, slides[0]), in_flange, most: most + ROUNDING }
    }
}

/// Rounds of the search for the tightest bound, and how far along an axis it looks, metres.
const SWEEPS: usize = 40;
const REACH_OF_SEARCH: f64 = 10.0;
/// Rounding of the bound, metres.
const ROUNDING: f64 = 1e-9;

/// Where a convex function is least.
fn least(cost: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    for _ in 0..80 {
        let [a, b] = [low + 0.382 * (high - low), low + 0.618 * (high - low)];
        if cost(a) <= cost(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

/// Pose of a link in the frame of another one that it is fixed to.
fn fixed_pose(arm: &Arm, from: usize, to: usize) -> Isometry3<f64> {
    let (mut pose, mut at) = (Isometry3::identity(), to);
    while at != from {
        let joint = &arm.joints[at - 1];
        pose = joint.parent_from_joint * pose;
        at = joint.parent;
    }
    pose
}
