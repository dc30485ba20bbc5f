//! Lower bounds of boxes from a few points.
//!
//! A box around some points of a core set is no larger than that around all. Points on the faces of recent boxes rule out most steps of a search, and
//! most of these few are inside the outline, which changes little from step to step.

use super::calipers::Calipers;
use super::minimum::{PAD, ROUNDING, plane_basis};
use nalgebra::{Matrix3, Vector3};

/// Cosine of the angle between axes that may share an outline.
const NEAR: f64 = 0.98;
/// Most outlines: one for each axis of a box, and for each of a better one.
const MOST_OUTLINES: usize = 6;

/// The corners of the contacts along an axis, counter-clockwise.
#[derive(Default)]
struct Outline {
    axis: Vector3<f64>,
    corners: Vec<Vector3<f64>>,
}

/// Points on the faces of recent boxes.
#[derive(Default)]
pub(super) struct Contacts {
    points: Vec<Vector3<f64>>,
    /// The latest one first.
    outlines: Vec<Outline>,
    flat: Vec<[f64; 2]>,
    sorted: Vec<[f64; 2]>,
}

impl Contacts {
    /// True if no box with a side along `axis`, a unit vector, is smaller than `limit`.
    pub fn rule_out(&mut self, axis: &Vector3<f64>, limit: f64, calipers: &mut Calipers) -> bool {
        if self.points.len() <= 3 {
            return false;
        }
        let (u, v) = plane_basis(axis);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for p in &self.points {
            let along = p.dot(axis);
            low = if along < low { along } else { low };
            high = if along > high { along } else { high };
        }
        let least = limit * (1.0 + ROUNDING) / (high - low + PAD);
        let known = self.outlines.iter().position(|outline| outline.axis.dot(axis) > NEAR);
        if let Some(known) = known {
            self.flat.clear();
            self.flat.extend(self.outlines[known].corners.iter().map(|p| [p.dot(&u), p.dot(&v)]));
            if calipers.take_outline(&self.flat) && calipers.none_below(least, PAD) {
                return true;
            }
        }
        self.flat.clear();
        self.flat.extend(self.points.iter().map(|p| [p.dot(&u), p.dot(&v)]));
        self.sorted.clone_from(&self.flat);
        let hull = calipers.hull_of(&mut self.sorted);
        let mut outline = match known {
            Some(known) => self.outlines.remove(known),
            None if self.outlines.len() < MOST_OUTLINES => Outline::default(),
            None => self.outlines.pop().unwrap_or_default(),
        };
        outline.axis = *axis;
        outline.corners.clear();
        let place = |corner: &[f64; 2]| self.flat.iter().position(|flat| flat == corner);
        outline.corners.extend(hull.iter().filter_map(place).map(|place| self.points[place]));
        self.outlines.insert(0, outline);
        calipers.none_below(least, PAD)
    }

    /// Adds the points of the core set on the faces of a box.
    pub fn add(&mut self, axes: &Matrix3<f64>, core: &[Vector3<f64>]) {
        /// Most points; more cost more than they save.
        const MOST: usize = 24;
        if self.points.len() > MOST {
            self.points.drain(..MOST / 2);
        }
        for axis in axes.column_iter() {
            let (mut low, mut high) = ((f64::INFINITY, core[0]), (f64::NEG_INFINITY, core[0]));
            for p in core {
                let along = p.dot(&axis);
                low = if along < low.0 { (along, *p) } else { low };
                high = if along > high.0 { (along, *p) } else { high };
            }
            for p in [low.1, high.1] {
                if !self.points.contains(&p) {
                    self.points.push(p);
                }
            }
        }
    }
}
