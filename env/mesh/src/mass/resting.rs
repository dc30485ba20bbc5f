//! Resting poses: stable poses of a rigid body on a horizontal table.
//!
//! A body rests on a facet of its convex hull when its centre of mass lies above that facet. Dropped at random it meets a facet
//! with a probability in proportion to the solid angle under which the centre of mass sees it, and rolls from an unstable facet
//! to the neighbour where the centre of mass lies lowest, until it is stable (no dynamics: Goldberg, Mirtich, Zhuang, Craig,
//! Carlisle, Canny, "Part pose statistics", 1999, their quasi-static estimate).
//!
//! Own code: no Rust crate for this is known.

use crate::error::{MeshError, require};
use crate::fast_hash::map_for;
use crate::mass::plan_view::convex_polygon;
use crate::trimesh::TriMesh;
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// A face of the hull that is thinner than this share of the hull's extent may be a sliver, whose normal is only rounding.
const THIN: f64 = 1e-3;
/// It is one where a corner of the hull lies beyond its plane by more than this share of the hull's extent.
const BEYOND: f64 = 1e-4;

/// Which poses count.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RestingOptions {
    /// The centre of mass must lie at least this far inside the edge of its support, metres.
    pub min_margin: f64,
    /// Hull faces whose normals differ by less than this form one facet, radians.
    pub merge_angle: f64,
    /// Poses less probable than this are left out.
    pub min_probability: f64,
}

impl Default for RestingOptions {
    /// Every stable pose; facets merge within 2 degrees, the waviness of a scanned flat base.
    fn default() -> Self {
        Self { min_margin: 0.0, merge_angle: 0.035, min_probability: 0.0 }
    }
}

/// A stable pose on the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RestingPose {
    /// Table top at z = 0: the lowest point touches it and the bounds are centred over the origin. The turn about the vertical
    /// is the one of the least rotation.
    pub world_from_object: Isometry3<f64>,
    /// Share of random drops that end here, by the quasi-static estimate.
    pub probability: f64,
    /// Outward unit normal of the facet that lies on the table, object frame.
    pub face_normal: Vector3<f64>,
    /// Least distance of the centre of mass from the edge of its support, in the table's plane, metres.
    pub margin: f64,
    /// Height of the centre of mass above the table, metres.
    pub height: f64,
}

/// The default pose of an object in the world: the file's +z up, the lowest vertex at z = 0, the bounds centred over the
/// origin of the table.
pub fn default_pose(mesh: &TriMesh) -> Isometry3<f64> {
    place(mesh, UnitQuaternion::identity())
}

/// Stable poses of the body with convex hull `hull` and centre of mass `center_of_mass` (same frame, metres), the most probable
/// first.
///
/// Without further options the probabilities add up to 1. The list is empty when no pose passes the options.
///
/// # Errors
/// [`MeshError::BadParameter`] when the centre of mass lies outside the hull, where no rigid body can have it, or when an option
/// is negative.
pub fn resting_poses(
    hull: &TriMesh,
    center_of_mass: &Point3<f64>,
    options: &RestingOptions,
) -> Result<Vec<RestingPose>, MeshError> {
    for (name, value) in [("min_margin", options.min_margin), ("merge_angle", options.merge_angle)] {
        require(value >= 0.0, name, value, "it must not be negative")?;
    }
    let facets = facets(hull, center_of_mass, options.merge_angle);
    let lowest = facets.iter().map(|f| f.height).fold(f64::INFINITY, f64::min);
    let rule = "the centre of mass must lie inside the hull; this is its distance inside";
    require(lowest >= -1e-9 * hull.extent(), "center_of_mass", lowest, rule)?;
    let total: f64 = facets.iter().map(|f| f.solid_angle).sum();
    let mut probability = vec![0.0; facets.len()];
    for start in 0..facets.len() {
        let mut at = start;
        // The height falls with every roll, so this ends.
        while let Some(next) = roll(&facets, at) {
            at = next;
        }
        probability[at] += facets[start].solid_angle / total;
    }
    let mut poses: Vec<RestingPose> = facets
        .iter()
        .zip(&probability)
        .filter(|(f, p)| **p > 0.0 && **p >= options.min_probability && f.margin >= options.min_margin)
        .map(|(facet, &probability)| pose(hull, center_of_mass, facet, probability))
        .collect();
    // Stable: poses of equal probability keep the order of their facets.
    poses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    Ok(poses)
}

fn pose(hull: &TriMesh, com: &Point3<f64>, facet: &Facet, probability: f64) -> RestingPose {
    let down = -Vector3::z();
    let rotation = UnitQuaternion::rotation_between(&facet.normal, &down)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let world_from_object = place(hull, rotation);
    let height = (world_from_object * com).z;
    RestingPose { world_from_object, probability, face_normal: facet.normal, margin: facet.margin, height }
}

/// Turned by `rotation`, then lowest point to z = 0 and bounds centred over the origin.
fn place(mesh: &TriMesh, rotation: UnitQuaternion<f64>) -> Isometry3<f64> {
    let turned = mesh.transformed(&Isometry3::from_parts(Translation3::identity(), rotation)).aabb();
    let center = nalgebra::center(&turned.min, &turned.max);
    Isometry3::from_parts(Translation3::new(-center.x, -center.y, -turned.min.z), rotation)
}

/// A facet of the hull: faces that are coplanar within the merge angle.
struct Facet {
    normal: Vector3<f64>,
    /// Distance of the centre of mass from the facet's plane.
    height: f64,
    solid_angle: f64,
    /// Of the projected centre of mass inside the support polygon; negative outside.
    margin: f64,
    neighbors: Vec<usize>,
}

/// Where the body rolls from facet `at`: to the neighbour with the lowest centre of mass. `None` when it stays.
fn roll(facets: &[Facet], at: usize) -> Option<usize> {
    if facets[at].margin >= 0.0 {
        return None;
    }
    let lowest = facets[at].neighbors.iter().copied().min_by(|&a, &b| facets[a].height.total_cmp(&facets[b].height))?;
    (facets[lowest].height < facets[at].height).then_some(lowest)
}

fn facets(hull: &TriMesh, com: &Point3<f64>, merge_angle: f64) -> Vec<Facet> {
    let count = hull.faces().len();
    let extent = hull.extent();
    let area = |f: usize| if is_sliver(hull, f, extent) { Vector3::zeros() } else { hull.face_area_vector(f) };
    let areas: Vec<Vector3<f64>> = (0..count).map(area).collect();
    let around = neighbors(hull);
    let label = merge(&areas, &around, merge_angle.cos());
    let number = label.iter().max().map_or(0, |m| m + 1);
    let mut members = vec![Vec::new(); number];
    label.iter().enumerate().for_each(|(f, &l)| members[l].push(f));
    members
        .iter()
        .enumerate()
        .map(|(own, faces)| {
            let normal = faces.iter().map(|&f| areas[f]).sum::<Vector3<f64>>().try_normalize(0.0).unwrap_or_default();
            let mut others: Vec<usize> = faces.iter().flat_map(|&f| &around[f]).map(|&f| label[f]).collect();
            others.sort_unstable();
            others.dedup();
            others.retain(|&o| o != own);
            let corners: Vec<Point3<f64>> = faces.iter().flat_map(|&f| hull.triangle(f)).collect();
            Facet {
                normal,
                height: corners.iter().map(|p| (p - com).dot(&normal)).fold(f64::NEG_INFINITY, f64::max),
                solid_angle: faces.iter().map(|&f| solid_angle(hull.triangle(f), com)).sum(),
                margin: margin(&corners, com, &normal),
                neighbors: others,
            }
        })
        .collect()
}

/// Whether a face's normal is only rounding: one that points sideways would put the centre of mass outside the hull.
fn is_sliver(hull: &TriMesh, face: usize, extent: f64) -> bool {
    let (area, [a, b, c]) = (hull.face_area_vector(face), hull.triangle(face));
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    if area.norm() > THIN * extent * longest {
        return false;
    }
    let beyond = |normal: Vector3<f64>| {
        let most = hull.vertices().iter().map(|p| (p - a).dot(&normal)).fold(0.0, f64::max);
        most > BEYOND * extent
    };
    area.try_normalize(0.0).is_none_or(beyond)
}

/// Faces that share an edge.
fn neighbors(hull: &TriMesh) -> Vec<Vec<usize>> {
    let mut owner = map_for(hull.faces().len() * 3);
    for (f, &[a, b, c]) in hull.faces().iter().enumerate() {
        for edge in [(a, b), (b, c), (c, a)] {
            owner.insert(edge, f);
        }
    }
    let across =
        |&[a, b, c]: &[u32; 3]| [(b, a), (c, b), (a, c)].iter().filter_map(|edge| owner.get(edge).copied()).collect();
    hull.faces().iter().map(across).collect()
}

/// Grows facets from the largest faces outward; returns the facet of each face.
fn merge(areas: &[Vector3<f64>], around: &[Vec<usize>], min_cosine: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..areas.len()).collect();
    order.sort_by(|&a, &b| areas[b].norm_squared().total_cmp(&areas[a].norm_squared()));
    let mut label = vec![usize::MAX; areas.len()];
    let mut next = 0;
    for seed in order {
        if label[seed] != usize::MAX {
            continue;
        }
        let normal = areas[seed].try_normalize(0.0).unwrap_or_default();
        label[seed] = next;
        let mut stack = vec![seed];
        while let Some(face) = stack.pop() {
            for &other in &around[face] {
                // A sliver without area has no normal and joins the first neighbour.
                let aligned = areas[other].dot(&normal) >= min_cosine * areas[other].norm();
                if label[other] == usize::MAX && aligned {
                    label[other] = next;
                    stack.push(other);
                }
            }
        }
        next += 1;
    }
    label
}

/// Van Oosterom and Strackee, "The solid angle of a plane triangle", 1983.
fn solid_angle(corners: [Point3<f64>; 3], eye: &Point3<f64>) -> f64 {
    let [a, b, c] = corners.map(|p| p - eye);
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let numerator = a.dot(&b.cross(&c)).abs();
    let denominator = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
    2.0 * numerator.atan2(denominator)
}

/// Distance of the projected `com` inside the convex polygon of the projected corners; negative outside.
fn margin(corners: &[Point3<f64>], com: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
    let Some(normal) = Unit::try_new(*normal, 0.0) else {
        return f64::NEG_INFINITY;
    };
    let helper = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let u = normal.cross(&helper).normalize();
    let v = normal.cross(&u);
    let mut points: Vec<Vector2<f64>> =
        corners.iter().map(|p| p - com).map(|d| Vector2::new(d.dot(&u), d.dot(&v))).collect();
    let polygon = convex_polygon(&mut points);
    let edges = polygon.iter().zip(polygon.iter().cycle().skip(1));
    edges
        .map(|(a, b)| {
            let edge = b - a;
            // The origin is the centre of mass; left of a counter-clockwise edge is inside.
            edge.perp(&-a) / edge.norm()
        })
        .fold(f64::INFINITY, f64::min)
}
