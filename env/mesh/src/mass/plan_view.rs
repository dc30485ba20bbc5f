//! Plan view of a body: the convex outline of its points on a plane, and how narrow it is.

use nalgebra::{Isometry3, Point3, Vector2};

/// Least width of points in plan view: the least distance of two vertical planes between which they all lie, metres.
///
/// * `world_from_object`: pose of the points; the z axis of the world is vertical.
///
/// 0 for points on a vertical plane, and without points.
#[must_use]
pub fn least_width(points: &[Point3<f64>], world_from_object: &Isometry3<f64>) -> f64 {
    let mut flat: Vec<Vector2<f64>> = points.iter().map(|point| (world_from_object * point).coords.xy()).collect();
    let polygon = convex_polygon(&mut flat);
    let edges = polygon.iter().zip(polygon.iter().cycle().skip(1)).map(|(a, b)| (a, b - a));
    // One of the planes of least width goes through an edge.
    let width_at = |(start, edge): (&Vector2<f64>, Vector2<f64>)| {
        polygon.iter().map(|p| edge.perp(&(p - start)) / edge.norm()).fold(0.0, f64::max)
    };
    let least = edges.map(width_at).fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { 0.0 }
}

/// Counter-clockwise convex polygon of the points: Andrew's monotone chain.
pub(crate) fn convex_polygon(points: &mut Vec<Vector2<f64>>) -> Vec<Vector2<f64>> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let chain = |points: &mut dyn Iterator<Item = &Vector2<f64>>| {
        let mut half: Vec<Vector2<f64>> = Vec::new();
        for p in points {
            while let [.., a, b] = half[..] {
                if (b - a).perp(&(p - a)) > 0.0 {
                    break;
                }
                half.pop();
            }
            half.push(*p);
        }
        half.pop();
        half
    };
    let mut polygon = chain(&mut points.iter());
    polygon.extend(chain(&mut points.iter().rev()));
    polygon
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    fn corners(half: [f64; 3]) -> Vec<Point3<f64>> {
        let sign = |bit: usize, axis: usize| if bit >> axis & 1 == 1 { half[axis] } else { -half[axis] };
        (0..8).map(|bit| Point3::new(sign(bit, 0), sign(bit, 1), sign(bit, 2))).collect()
    }

    #[test]
    fn a_box_is_as_narrow_as_its_shorter_side_in_plan_view() {
        let points = corners([0.01, 0.02, 0.03]);
        for turn in [0.0, 0.3, 1.0, 2.5] {
            let pose = Isometry3::rotation(Vector3::z() * turn);
            assert!((least_width(&points, &pose) - 0.02).abs() < 1e-12);
        }
        let tipped = Isometry3::rotation(Vector3::y() * std::f64::consts::FRAC_PI_2);
        assert!((least_width(&points, &tipped) - 0.04).abs() < 1e-12);
    }

    #[test]
    fn an_equilateral_triangle_is_as_narrow_as_it_is_high() {
        let at = |k: usize| {
            UnitQuaternion::from_scaled_axis(Vector3::z() * (k as f64 * 2.0 * std::f64::consts::FRAC_PI_3))
                * Point3::new(1.0, 0.0, 0.0)
        };
        let points: Vec<Point3<f64>> = (0..3).map(at).collect();
        assert!((least_width(&points, &Isometry3::identity()) - 1.5).abs() < 1e-12);
    }

    #[test]
    fn points_without_an_area_have_no_width() {
        assert!(least_width(&[], &Isometry3::identity()).abs() < 1e-12);
        let line = [Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(1.0, 0.0, 2.0)];
        assert!(least_width(&line, &Isometry3::identity()).abs() < 1e-12);
    }
}
