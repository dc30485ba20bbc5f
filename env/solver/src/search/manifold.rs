//! Reduction of parry's contact manifolds to at most four points that span them.

use parry3d::math::Vector;
use parry3d::query::ContactManifold;

/// Most points kept of a manifold: a flat contact needs no more for support, and each costs time.
const MOST: usize = 4;

/// Points nearer to each other than this count as one, parry's lengths squared: 0.1 mm. Parry lists the closest points again next to the
/// clipped corners.
const TWIN: f32 = 1e-4;

/// Indices of the kept points, and their number.
pub(super) fn chosen(manifold: &ContactManifold<(), ()>, reach: f32) -> ([usize; MOST], usize) {
    let points = &manifold.points;
    let twin = |i: usize| (0..i).any(|j| (points[j].local_p1 - points[i].local_p1).length_squared() < TWIN);
    let mut near = [0_usize; 32];
    let mut count = 0;
    for (i, point) in points.iter().enumerate() {
        if count < near.len() && point.dist <= reach && !twin(i) {
            near[count] = i;
            count += 1;
        }
    }
    let near = &near[..count];
    let mut kept = [0; MOST];
    if count <= MOST {
        kept[..count].copy_from_slice(near);
        return (kept, count);
    }
    // The deepest point, the farthest from it, and the farthest on each side of the line between these two.
    let at = |i: usize| points[i].local_p1;
    let best =
        |value: &dyn Fn(usize) -> f32| near.iter().copied().max_by(|i, j| value(*i).total_cmp(&value(*j))).unwrap_or(0);
    let first = best(&|i| -points[i].dist);
    let second = best(&|i| (at(i) - at(first)).length_squared());
    let across: Vector = manifold.local_n1.cross(at(second) - at(first));
    let third = best(&|i| across.dot(at(i) - at(first)));
    let fourth = best(&|i| -across.dot(at(i) - at(first)));
    let mut used = 0;
    for i in [first, second, third, fourth] {
        if !kept[..used].contains(&i) {
            kept[used] = i;
            used += 1;
        }
    }
    (kept, used)
}
