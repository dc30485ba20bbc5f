//! The samples of a surface in groups of neighbours: whole groups are off a finger, and are passed over.

use crate::chain::POINTS;
use graspbox_mesh::SurfaceSample;
use nalgebra::{Point3, Vector3};
use std::ops::Range;

/// Most samples of a group: a block of the chains.
const MOST: usize = POINTS;

/// A group of neighbouring samples, or several groups.
pub(crate) struct Group {
    /// A ball around them.
    pub center: Point3<f64>,
    pub radius: f64,
    /// Their places in the list of all points; empty for several groups, which follow this one.
    points: Range<u32>,
    /// Index of the first group that is not among them.
    next: u32,
}

/// Groups of the samples of an object: a tree in depth-first order.
pub(crate) struct Groups {
    groups: Vec<Group>,
    /// Points with the indices of their samples, group by group.
    points: Vec<(Point3<f64>, u32)>,
}

impl Groups {
    pub fn new(samples: &[SurfaceSample]) -> Self {
        let points = samples.iter().zip(0..).map(|(sample, index)| (sample.point, index)).collect();
        let mut all = Self { groups: Vec::with_capacity(4 * samples.len() / MOST + 1), points };
        all.divide(0..samples.len());
        all
    }

    /// Divides a range of the points across their longest side until groups are small.
    fn divide(&mut self, range: Range<usize>) {
        let points = &mut self.points[range.clone()];
        let Some((first, _)) = points.first() else { return };
        let around = |(low, high): (Vector3<f64>, Vector3<f64>), (p, _): &(Point3<f64>, u32)| {
            (low.inf(&p.coords), high.sup(&p.coords))
        };
        let (low, high) = points.iter().fold((first.coords, first.coords), around);
        let center = Point3::from(0.5 * (low + high));
        let radius = points.iter().map(|(p, _)| (p - center).norm_squared()).fold(0.0, f64::max).sqrt();
        let this = self.groups.len();
        self.groups.push(Group { center, radius, points: 0..0, next: 0 });
        if points.len() > MOST {
            let axis = (high - low).imax();
            let half = points.len() / 2;
            points.select_nth_unstable_by(half, |a, b| a.0[axis].total_cmp(&b.0[axis]));
            self.divide(range.start..range.start + half);
            self.divide(range.start + half..range.end);
        } else {
            self.groups[this].points = range.start as u32..range.end as u32;
        }
        self.groups[this].next = self.groups.len() as u32;
    }

    /// Every group without others in it that may have a sample within `slab` of the plane `normal . p = at` and within `reach` of `origin`;
    /// neighbours follow each other.
    pub fn near(
        &self,
        (normal, at, slab): (Vector3<f64>, f64, f64),
        (origin, reach): (Point3<f64>, f64),
    ) -> impl Iterator<Item = &Group> {
        let mut next = 0;
        std::iter::from_fn(move || {
            loop {
                let group = self.groups.get(next)?;
                let meets = (normal.dot(&group.center.coords) - at).abs() <= slab + group.radius
                    && (group.center - origin).norm_squared() <= (reach + group.radius).powi(2);
                next = if meets { next + 1 } else { group.next as usize };
                if meets && !group.points.is_empty() {
                    return Some(group);
                }
            }
        })
    }

    /// The samples of a group, with their indices.
    pub fn samples(&self, group: &Group) -> &[(Point3<f64>, u32)] {
        &self.points[group.points.start as usize..group.points.end as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bug here: a group whose ball misses one of its points, or a point of no group.
    #[test]
    fn no_sample_near_a_finger_is_passed_over() {
        let spiral = |i: usize| {
            let t = i as f64 * 0.37;
            Point3::new(0.1 * t.cos(), 0.07 * (1.3 * t).sin(), 0.002 * i as f64)
        };
        let normal = Vector3::z();
        let samples: Vec<_> = (0..203).map(|i| SurfaceSample { point: spiral(i), normal, face: 0 }).collect();
        let groups = Groups::new(&samples);
        assert!(groups.groups.iter().all(|group| group.points.len() <= MOST));
        let (normal, at, slab) = (Vector3::new(0.6, 0.0, 0.8), 0.15, 0.01);
        let (origin, reach) = (Point3::new(0.02, 0.0, 0.2), 0.11);
        let inside = |p: &Point3<f64>| (normal.dot(&p.coords) - at).abs() <= slab && (p - origin).norm() <= reach;
        let mut found: Vec<u32> = groups
            .near((normal, at, slab), (origin, reach))
            .flat_map(|group| groups.samples(group))
            .filter(|(p, _)| inside(p))
            .map(|(_, index)| *index)
            .collect();
        found.sort_unstable();
        let expected: Vec<u32> =
            samples.iter().zip(0..).filter(|(sample, _)| inside(&sample.point)).map(|(_, index)| index).collect();
        assert!(!expected.is_empty() && expected.len() < 100);
        assert_eq!(found, expected);
        assert_eq!(Groups::new(&[]).near((normal, at, slab), (origin, reach)).count(), 0);
    }
}
