//! Contact manifolds of convex parts: parry's, faster, and with all corners of flat faces.
//!
//! | module | purpose |
//! |---|---|
//! | `faces` | contact points of whole faces: those with more than four corners, which parry cuts short, or all |
//!
//! Where no face is clipped here, the points equal parry's bit for bit.
//!
//! Most of the time of a contact search goes into support points: the corner of a convex part that is farthest along a direction. Parry tests
//! one corner at a time through dynamic dispatch; here the types are static, and four corners are tested at once.

mod faces;

use parry3d::math::{Pose, Real, Vector};
use parry3d::query::details::{
    ContactManifoldsWorkspace, NormalConstraints, ShapeCastOptions, contact_manifold_pfm_pfm,
    contact_manifolds_composite_shape_shape,
};
use parry3d::query::{
    ClosestPoints, Contact, ContactManifold, DefaultQueryDispatcher, NonlinearRigidMotion, PersistentQueryDispatcher,
    QueryDispatcher, ShapeCastHit, ShapeDistance, ShapeIntersection, TrackedContact, Unsupported,
};
use parry3d::shape::{ConvexPolyhedron, PolygonalFeature, PolygonalFeatureMap, Shape, SupportMap};

/// Corners that are tested at once.
const LANES: usize = 4;

/// Distance between points of two searches that count as the same one, parry's lengths: 1 mm.
const SAME_POINT: Real = 0.1;

/// Parry's dispatcher, with a faster path for convex parts against each other, boxes and cylinders, and with whole faces.
#[derive(Clone, Copy, Debug, Default)]
pub struct Dispatcher {
    /// Clip the faces that touch in any case; by default only those that parry cuts short. Where a corner of one face lies exactly on the
    /// border of the other, as between boxes of equal width, parry often leaves it out.
    pub every_face: bool,
}

/// A convex part with a faster support point.
struct Corners<'a>(&'a ConvexPolyhedron);

impl SupportMap for Corners<'_> {
    #[inline]
    fn local_support_point(&self, dir: Vector) -> Vector {
        let points = self.0.points();
        points[farthest(points, dir)]
    }
}

impl PolygonalFeatureMap for Corners<'_> {
    fn local_support_feature(&self, dir: Vector, out: &mut PolygonalFeature) {
        self.0.local_support_feature(dir, out);
    }

    fn is_convex_polyhedron(&self) -> bool {
        true
    }
}

/// Index of the point farthest along `dir`: the first of equals, and 0 if none compares greater (NaN).
#[inline]
fn farthest(points: &[Vector], dir: Vector) -> usize {
    let (blocks, rest) = points.as_chunks::<LANES>();
    let mut most = [Real::NEG_INFINITY; LANES];
    let mut block_of = [0_u32; LANES];
    for (i, block) in blocks.iter().enumerate() {
        let reach: [Real; LANES] = std::array::from_fn(|lane| block[lane].dot(dir));
        for lane in 0..LANES {
            let more = reach[lane] > most[lane];
            most[lane] = if more { reach[lane] } else { most[lane] };
            block_of[lane] = if more { i as u32 } else { block_of[lane] };
        }
    }
    let (mut best, mut at) = (Real::NEG_INFINITY, 0);
    for lane in 0..LANES {
        let index = block_of[lane] as usize * LANES + lane;
        if most[lane] > best || (most[lane] == best && index < at) {
            (best, at) = (most[lane], index);
        }
    }
    for (i, point) in rest.iter().enumerate() {
        let reach = point.dot(dir);
        if reach > best {
            (best, at) = (reach, blocks.len() * LANES + i);
        }
    }
    at
}

impl<M, C> PersistentQueryDispatcher<M, C> for Dispatcher
where
    M: Default + Clone + Send + Sync,
    C: Default + Copy + Send + Sync,
{
    fn contact_manifolds(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
        prediction: Real,
        manifolds: &mut Vec<ContactManifold<M, C>>,
        workspace: &mut Option<ContactManifoldsWorkspace>,
    ) -> Result<(), Unsupported> {
        match (g1.as_compound(), g2.as_compound()) {
            (Some(parts), None) => {
                contact_manifolds_composite_shape_shape(self, pos12, parts, g2, prediction, manifolds, workspace, false)
            }
            (None, Some(parts)) => {
                let pos21 = pos12.inverse();
                contact_manifolds_composite_shape_shape(
                    self, &pos21, parts, g1, prediction, manifolds, workspace, true,
                );
            }
            (None, None) => {
                if manifolds.is_empty() {
                    manifolds.push(ContactManifold::new());
                }
                return self.contact_manifold_convex_convex(pos12, g1, g2, None, None, prediction, &mut manifolds[0]);
            }
            _ => return DefaultQueryDispatcher.contact_manifolds(pos12, g1, g2, prediction, manifolds, workspace),
        }
        Ok(())
    }

    fn contact_manifold_convex_convex(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
        normals1: Option<&dyn NormalConstraints>,
        normals2: Option<&dyn NormalConstraints>,
        prediction: Real,
        manifold: &mut ContactManifold<M, C>,
    ) -> Result<(), Unsupported> {
        let before = manifold.points.clone();
        contacts_of_parry(pos12, (g1, normals1), (g2, normals2), prediction, manifold)?;
        let moved = |(old, new): (&TrackedContact<C>, &TrackedContact<C>)| old.local_p1 != new.local_p1;
        let is_new = before.len() != manifold.points.len() || before.iter().zip(&manifold.points).any(moved);
        if is_new && faces::complete(pos12, g1, g2, manifold, self.every_face) {
            manifold.match_contacts_using_positions(&before, SAME_POINT);
        }
        Ok(())
    }
}

/// A shape, and the normals that its contacts may have.
type Constrained<'a> = (&'a dyn Shape, Option<&'a dyn NormalConstraints>);

fn contacts_of_parry<M, C>(
    pos12: &Pose,
    (g1, normals1): Constrained,
    (g2, normals2): Constrained,
    prediction: Real,
    manifold: &mut ContactManifold<M, C>,
) -> Result<(), Unsupported>
where
    M: Default + Clone + Send + Sync,
    C: Default + Copy + Send + Sync,
{
    match (g1.as_convex_polyhedron(), g2.as_convex_polyhedron()) {
        (Some(one), Some(two)) => {
            let (one, two) = (Corners(one), Corners(two));
            contact_manifold_pfm_pfm(pos12, &one, 0.0, normals1, &two, 0.0, normals2, prediction, manifold);
            return Ok(());
        }
        (Some(part), None) => {
            let part = Corners(part);
            if let Some(other) = g2.as_cuboid() {
                contact_manifold_pfm_pfm(pos12, &part, 0.0, normals1, other, 0.0, normals2, prediction, manifold);
                return Ok(());
            }
            if let Some(other) = g2.as_cylinder() {
                contact_manifold_pfm_pfm(pos12, &part, 0.0, normals1, other, 0.0, normals2, prediction, manifold);
                return Ok(());
            }
        }
        (None, Some(part)) => {
            let part = Corners(part);
            if let Some(other) = g1.as_cuboid() {
                contact_manifold_pfm_pfm(pos12, other, 0.0, normals1, &part, 0.0, normals2, prediction, manifold);
                return Ok(());
            }
            if let Some(other) = g1.as_cylinder() {
                contact_manifold_pfm_pfm(pos12, other, 0.0, normals1, &part, 0.0, normals2, prediction, manifold);
                return Ok(());
            }
        }
        _ => {}
    }
    DefaultQueryDispatcher.contact_manifold_convex_convex(pos12, g1, g2, normals1, normals2, prediction, manifold)
}

/// Queries other than contacts go to parry's dispatcher.
impl QueryDispatcher for Dispatcher {
    fn intersection_test(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
    ) -> Result<ShapeIntersection, Unsupported> {
        DefaultQueryDispatcher.intersection_test(pos12, g1, g2)
    }

    fn distance(&self, pos12: &Pose, g1: &dyn Shape, g2: &dyn Shape) -> Result<ShapeDistance, Unsupported> {
        DefaultQueryDispatcher.distance(pos12, g1, g2)
    }

    fn contact(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
        prediction: Real,
    ) -> Result<Option<Contact>, Unsupported> {
        DefaultQueryDispatcher.contact(pos12, g1, g2, prediction)
    }

    fn closest_points(
        &self,
        pos12: &Pose,
        g1: &dyn Shape,
        g2: &dyn Shape,
        max_dist: Real,
    ) -> Result<ClosestPoints, Unsupported> {
        DefaultQueryDispatcher.closest_points(pos12, g1, g2, max_dist)
    }

    fn cast_shapes(
        &self,
        pos12: &Pose,
        local_vel12: Vector,
        g1: &dyn Shape,
        g2: &dyn Shape,
        options: ShapeCastOptions,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        DefaultQueryDispatcher.cast_shapes(pos12, local_vel12, g1, g2, options)
    }

    fn cast_shapes_nonlinear(
        &self,
        motion1: &NonlinearRigidMotion,
        g1: &dyn Shape,
        motion2: &NonlinearRigidMotion,
        g2: &dyn Shape,
        start_time: Real,
        end_time: Real,
        stop_at_penetration: bool,
    ) -> Result<Option<ShapeCastHit>, Unsupported> {
        DefaultQueryDispatcher.cast_shapes_nonlinear(
            motion1,
            g1,
            motion2,
            g2,
            start_time,
            end_time,
            stop_at_penetration,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use parry3d::math::Rotation;
    use parry3d::shape::{Cuboid, Cylinder, SharedShape};

    /// Numbers in [-1, 1) from a small generator.
    fn numbers(seed: u64) -> impl FnMut() -> Real {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as Real / (1_u64 << 23) as Real - 1.0
        }
    }

    fn vector(next: &mut impl FnMut() -> Real) -> Vector {
        Vector::new(next(), next(), next())
    }

    #[test]
    fn the_farthest_corner_is_the_first_of_the_farthest() {
        let mut next = numbers(1);
        for count in 1..70 {
            // Rounded, for many equal distances.
            let points: Vec<Vector> = (0..count).map(|_| (vector(&mut next) * 2.0).round()).collect();
            for dir in [vector(&mut next), vector(&mut next).round(), Vector::ZERO, Vector::NAN] {
                let mut expected = 0;
                for (i, point) in points.iter().enumerate() {
                    if point.dot(dir) > points[expected].dot(dir) {
                        expected = i;
                    }
                }
                assert_eq!(farthest(&points, dir), expected, "{count} points along {dir}");
            }
        }
    }

    /// Contacts of one part, and of a compound, with parts, boxes and cylinders that move into and out of them. Ends of cylinders are not parry's.
    #[test]
    fn contacts_equal_parrys_bit_for_bit() {
        let mut next = numbers(2);
        let part = || {
            let mut next = numbers(3);
            let points: Vec<Vector> = (0..60).map(|_| vector(&mut next).normalize() * 3.0).collect();
            SharedShape::convex_hull(&points).unwrap()
        };
        let shifted = |x| (Pose::from_translation(Vector::new(x, 0.0, 0.0)), part());
        let objects = [part(), SharedShape::compound(vec![shifted(-2.0), shifted(2.0)])];
        let cuboid = SharedShape::new(Cuboid::new(Vector::new(0.6, 1.0, 2.0)));
        let cylinder = SharedShape::new(Cylinder::new(1.5, 0.8));
        let pairs = [
            (&objects[0], &cuboid),
            (&objects[0], &cylinder),
            (&objects[0], &objects[0]),
            (&objects[1], &cuboid),
            (&objects[1], &objects[0]),
        ];
        for (object, other) in pairs {
            let mut touched = 0;
            for _ in 0..40 {
                let (from, drift) = (vector(&mut next) * 5.0, vector(&mut next) * 0.2);
                let turn = vector(&mut next);
                let pose = |i: u8| {
                    let turn = Rotation::from_scaled_axis(turn * (1.0 + 0.05 * Real::from(i)));
                    Pose::from_parts(from + drift * Real::from(i), turn)
                };
                for flip in [false, true] {
                    let (g1, g2) = if flip { (other, object) } else { (object, other) };
                    let ours = follow(pose, |at, manifolds, workspace| {
                        if other.as_cylinder().is_none() {
                            return Dispatcher::default()
                                .contact_manifolds(at, &**g1, &**g2, 0.2, manifolds, workspace);
                        }
                        manifolds.resize_with(1, ContactManifold::new);
                        contacts_of_parry(at, (&**g1, None), (&**g2, None), 0.2, &mut manifolds[0])
                    });
                    let parrys = follow(pose, |at, manifolds, workspace| {
                        DefaultQueryDispatcher.contact_manifolds(at, &**g1, &**g2, 0.2, manifolds, workspace)
                    });
                    assert_eq!(ours, parrys);
                    touched += ours.len();
                }
            }
            assert!(touched > 1000, "only {touched} contacts");
        }
    }

    type Manifolds = Vec<ContactManifold<(), ()>>;

    /// Every contact of two moving shapes, as bits.
    fn follow(
        pose: impl Fn(u8) -> Pose,
        find: impl Fn(&Pose, &mut Manifolds, &mut Option<ContactManifoldsWorkspace>) -> Result<(), Unsupported>,
    ) -> Vec<[u32; 7]> {
        let (mut manifolds, mut workspace, mut found) = (Vec::new(), None, Vec::new());
        for i in 0..20 {
            find(&pose(i), &mut manifolds, &mut workspace).unwrap();
            for manifold in &manifolds {
                for point in &manifold.points {
                    let (p, n) = (point.local_p1, manifold.local_n1);
                    found.push([p.x, p.y, p.z, point.dist, n.x, n.y, n.z].map(Real::to_bits));
                }
            }
        }
        found
    }
}
