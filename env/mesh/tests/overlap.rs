//! Mass properties of solids that overlap, of cavities, and of surfaces with holes.
#![allow(clippy::unwrap_used)]

mod shapes;

use graspbox_mesh::{
    CleanOptions, Mass, MassMethod, MassProperties, MeshError, TriMesh, VoxelFrame, clean, convex_hull,
    mass_properties, voxelize_in,
};
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use shapes::{cuboid, cup, sphere, torus};
use std::f64::consts::PI;

/// Several meshes as one; those in `flips` are turned inside out first.
fn joined(meshes: &[TriMesh], flips: &[bool]) -> TriMesh {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (i, mesh) in meshes.iter().enumerate() {
        let (base, flip) = (vertices.len() as u32, flips.get(i).copied().unwrap_or(false));
        vertices.extend_from_slice(mesh.vertices());
        let turned = mesh.faces().iter().map(|&[a, b, c]| if flip { [a, c, b] } else { [a, b, c] });
        faces.extend(turned.map(|f| f.map(|v| v + base)));
    }
    TriMesh::new(vertices, faces).unwrap()
}

fn moved(mesh: &TriMesh, x: f64, y: f64, z: f64) -> TriMesh {
    mesh.transformed(&Isometry3::translation(x, y, z))
}

/// Of the cleaned mesh, at 1 kg per litre.
fn weighed(mesh: &TriMesh) -> MassProperties {
    let (mesh, _) = clean(mesh, &CleanOptions::default()).unwrap();
    mass_properties(&mesh, Mass::Density(1000.0)).unwrap()
}

fn assert_near(found: f64, expected: f64, relative: f64) {
    assert!((found / expected - 1.0).abs() < relative, "{found} is not within {relative} of {expected}");
}

/// Two balls of 30 and 27 mm, 30 mm apart: one was taken for a cavity of the other, which left 30 cm3 of 169 and a centre outside both.
#[test]
fn two_balls_that_overlap_have_the_volume_of_their_union() {
    let (r, s, d) = (0.030, 0.027, 0.030);
    for turn in [false, true] {
        let balls = [sphere(r, 128), moved(&sphere(s, 128), d, 0.0, 0.0)];
        let (first, second) = if turn { (1, 0) } else { (0, 1) };
        let found = weighed(&joined(&[balls[first].clone(), balls[second].clone()], &[false, turn]));
        assert_eq!(found.method, MassMethod::Union);
        // The lens consists of two caps, cut at x from the first centre: volume, and integral of x.
        let x = (d * d + r * r - s * s) / (2.0 * d);
        let cap = |radius: f64, from: f64| {
            let integral =
                |t: f64| [radius * radius * t - t.powi(3) / 3.0, radius * radius * t * t / 2.0 - t.powi(4) / 4.0];
            let ([v, m], [w, n]) = (integral(radius), integral(from));
            [PI * (v - w), PI * (m - n)]
        };
        let ([near, near_moment], [far, far_moment]) = (cap(r, x), cap(s, d - x));
        let ball = |radius: f64| 4.0 / 3.0 * PI * radius.powi(3);
        let volume = ball(r) + ball(s) - near - far;
        let moment = ball(s) * d - near_moment - (far * d - far_moment);
        assert_near(found.volume, volume, 2e-3);
        assert!((found.center_of_mass - Point3::new(moment / volume, 0.0, 0.0)).norm() < 1e-4, "{found:?}");
    }
}

/// A shell wholly inside is a cavity; one that touches the wall, or reaches through it, is part of the solid. Neither depends on where
/// the first vertex lies, nor on whether any vertex lies outside.
#[test]
fn only_what_lies_wholly_inside_is_a_cavity() {
    let block = cuboid(Vector3::new(0.06, 0.06, 0.06));
    let small = cuboid(Vector3::new(0.02, 0.02, 0.02));
    let (whole, part) = (0.06_f64.powi(3), 0.02_f64.powi(3));
    for (mesh, expected) in [
        (joined(&[block.clone(), small.clone()], &[]), whole - part),
        // A solid in the cavity of a solid.
        (
            joined(&[moved(&small, 0.2, 0.0, 0.0).scaled(0.5), small.scaled(0.5), block.clone(), small.clone()], &[]),
            whole - part + part / 4.0,
        ),
        (joined(&[block.clone(), moved(&small, 0.0, 0.0, -0.02)], &[]), whole),
        (joined(&[block.clone(), moved(&small, 0.0, 0.0, -0.03)], &[]), whole + part / 2.0),
        (joined(&[block.clone(), moved(&small, 0.0, 0.0, -0.04)], &[]), whole + part),
    ] {
        assert_near(weighed(&mesh).volume, expected, 1e-3);
    }
    // A bar across a cup, whose eight corners lie in the wall.
    let (radius, height, wall) = (0.04, 0.08, 0.01);
    let cup = cup(radius, height, wall, 128);
    let bar = moved(&cuboid(Vector3::new(2.0 * (radius - 0.002), 0.004, 0.01)), 0.0, 0.0, 0.05);
    let alone = weighed(&cup).volume;
    let free = 0.004 * 0.01 * 2.0 * (radius - wall);
    assert_near(weighed(&joined(&[cup, bar], &[])).volume, alone + free, 2e-3);
}

/// Copies in nearly the same place count once, thin plates keep their thickness, and of a cavity that is two balls nothing is left.
#[test]
fn overlaps_of_many_and_of_thin_solids_count_once() {
    let ball = sphere(0.03, 48);
    let copies: Vec<_> = (0..12).map(|i| moved(&ball, f64::from(i) * 1e-5, 0.0, 0.0)).collect();
    let (one, many) = (weighed(&ball), weighed(&joined(&copies, &[])));
    assert_near(many.volume, one.volume + PI * 0.03 * 0.03 * 11e-5, 2e-3);
    assert_near(many.inertia.trace(), one.inertia.trace() * many.mass / one.mass, 1e-2);

    let plate = cuboid(Vector3::new(0.2, 0.02, 0.001));
    let crossed = plate.transformed(&Isometry3::rotation(Vector3::z() * PI / 2.0));
    let cross = weighed(&joined(&[plate, crossed], &[]));
    assert_near(cross.volume, (2.0 * 0.2 - 0.02) * 0.02 * 0.001, 5e-3);
    assert!(cross.center_of_mass.coords.norm() < 1e-4);

    let (block, hole) = (cuboid(Vector3::new(0.06, 0.04, 0.04)), sphere(0.01, 48));
    let holes = [block, moved(&hole, -0.006, 0.0, 0.0), moved(&hole, 0.006, 0.0, 0.0)];
    let lens = PI * (4.0 * 0.01 + 0.012) * (2.0 * 0.01 - 0.012_f64).powi(2) / 12.0;
    assert_near(weighed(&joined(&holes, &[])).volume, 0.06 * 0.04 * 0.04 - 2.0 * 4.0 / 3.0 * PI * 1e-6 + lens, 2e-3);
}

/// One of the solids of the property below: its mesh in its place.
fn solid() -> impl Strategy<Value = TriMesh> {
    let shape = (0..4, 0.01..0.03_f64, 0.01..0.03_f64).prop_map(|(kind, a, b)| match kind {
        0 => sphere(a, 24),
        1 => cuboid(Vector3::new(2.0 * a, 2.0 * b, a + b)),
        2 => torus(a + 0.6 * b, 0.5 * b, 24),
        _ => cup(a, 2.0 * b, 0.3 * a.min(b), 24),
    });
    let place = (prop::array::uniform3(-0.03..0.03_f64), prop::array::uniform3(-3.0..3.0_f64));
    (shape, place).prop_map(|(mesh, (shift, turn))| {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
        mesh.transformed(&Isometry3::from_parts(Translation3::from(shift), turn))
    })
}

/// Voxels of the union of solids, each filled by itself: volume, centre and moment of inertia about it per unit of density. None where all
/// voxels of one lie in another, which may make it a cavity.
fn by_voxels(solids: &[TriMesh]) -> Option<(f64, Point3<f64>, Matrix3<f64>)> {
    let bounds = joined(solids, &[]).aabb();
    let frame = VoxelFrame::new(160, bounds.min, (bounds.max - bounds.min).amax()).unwrap();
    let grids: Vec<_> = solids.iter().map(|s| voxelize_in(s, &Isometry3::identity(), &frame).unwrap()).collect();
    let nested = |a: usize, b: usize| a != b && grids[a].flags().iter().zip(grids[b].flags()).all(|(a, b)| !a || *b);
    if (0..solids.len()).any(|a| (0..solids.len()).any(|b| nested(a, b))) {
        return None;
    }
    let (n, size) = (frame.resolution(), frame.voxel_size());
    let center = |i: usize| frame.center([i / n / n, i / n % n, i % n]);
    let set: Vec<Point3<f64>> = (0..frame.len()).filter(|&i| grids.iter().any(|g| g.flags()[i])).map(center).collect();
    let mean = Point3::from(set.iter().map(|p| p.coords).sum::<Vector3<f64>>() / set.len() as f64);
    let inertia: Matrix3<f64> =
        set.iter().map(|p| p - mean).map(|d| Matrix3::identity() * d.norm_squared() - d * d.transpose()).sum();
    let voxel = size.powi(3);
    Some((set.len() as f64 * voxel, mean, inertia * voxel))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// Solids that overlap at random, each turned either way, have the mass of the voxels of their union.
    #[test]
    fn overlapping_solids_weigh_what_their_voxels_weigh(
        solids in prop::collection::vec(solid(), 2..5),
        flips in prop::array::uniform4(any::<bool>()),
    ) {
        let expected = by_voxels(&solids);
        prop_assume!(expected.is_some());
        let (volume, center, inertia) = expected.unwrap();
        let mesh = joined(&solids, &flips);
        let found = weighed(&mesh);
        prop_assert!((found.volume / volume - 1.0).abs() < 0.01, "{} instead of {volume}", found.volume);
        prop_assert!((found.center_of_mass - center).norm() < 0.003 * mesh.extent(), "{} instead of {center}", found.center_of_mass);
        prop_assert!((found.inertia / 1000.0 - inertia).norm() < 0.02 * inertia.norm(), "{} instead of {inertia}", found.inertia / 1000.0);
    }
}

/// A mesh without the faces that `drop` picks by their middle.
fn without(mesh: &TriMesh, drop: impl Fn(&Point3<f64>) -> bool) -> TriMesh {
    let middle = |f: usize| Point3::from(mesh.triangle(f).iter().map(|p| p.coords).sum::<Vector3<f64>>() / 3.0);
    let kept = (0..mesh.faces().len()).filter(|&f| !drop(&middle(f))).map(|f| mesh.faces()[f]).collect();
    TriMesh::new(mesh.vertices().to_vec(), kept).unwrap()
}

/// Surfaces with holes: the volumes that they wind around, not their hulls; open shells that overlap; a sheet has no volume at all.
#[test]
fn surfaces_with_holes_enclose_what_they_wind_around() {
    let whole = cup(0.04, 0.08, 0.006, 64);
    let holed = without(&whole, |p| p.x > 0.037 && p.z < 0.05);
    let found = weighed(&holed);
    assert_eq!(found.method, MassMethod::WindingNumber);
    assert_near(found.volume, weighed(&whole).volume, 0.05);
    assert!(found.volume < 0.5 * convex_hull(whole.vertices()).unwrap().signed_volume());

    let (r, d) = (0.03, 0.03);
    let open = |x: f64| moved(&without(&sphere(r, 48), |p| p.z > 0.9 * r), x, 0.0, 0.0);
    let pair = weighed(&joined(&[open(0.0), open(d)], &[false, true]));
    assert_eq!(pair.method, MassMethod::WindingNumber);
    let lens = PI * (4.0 * r + d) * (2.0 * r - d).powi(2) / 12.0;
    assert_near(pair.volume, 2.0 * 4.0 / 3.0 * PI * r.powi(3) - lens, 0.05);
    assert!((pair.center_of_mass - Point3::new(d / 2.0, 0.0, 0.0)).norm() < 0.002);
    assert!(pair.inertia.symmetric_eigenvalues().min() > 0.0);

    // A saddle encloses next to nothing, so that its hull is taken; a flat sheet has no hull either.
    let n = 20_u32;
    let at = |i: u32, j: u32| i * (n + 1) + j;
    let saddle = |k: u32| {
        let [x, y] = [k / (n + 1), k % (n + 1)].map(|i| f64::from(i) / f64::from(n) - 0.5);
        Point3::new(0.1 * x, 0.1 * y, 0.02 * x * y)
    };
    let cells = (0..n * n).map(|k| (k / n, k % n));
    let faces = cells
        .flat_map(|(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]);
    let sheet = TriMesh::new((0..(n + 1) * (n + 1)).map(saddle).collect(), faces.collect()).unwrap();
    assert_eq!(weighed(&sheet).method, MassMethod::ConvexHull);
    let vertices = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]].map(Point3::from).to_vec();
    let flat = TriMesh::new(vertices, vec![[0, 1, 2]]).unwrap();
    assert!(matches!(mass_properties(&flat, Mass::Density(1.0)), Err(MeshError::Flat { .. })));
}
