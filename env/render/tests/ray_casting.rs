//! Depth and labels equal those of rays cast through each pixel's centre.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::{Dice, Seen, cast, instance, random_camera, random_mesh, seen, table};
use graspbox_mesh::TriMesh;
use graspbox_render::{Camera, Channels, Detail, Frame, Intrinsics, Light, Model, Renderer};
use nalgebra::{Isometry3, Point3, Vector3};
use proptest::prelude::*;

/// Single precision: a few roundings of the inverse depth.
const RELATIVE: f64 = 1e-6;
/// A ray this close to an edge (pixels; double precision leaves 1e-10) may be on either side of it.
const EDGE: f64 = 1e-7;

const LABELS: Channels = Channels { rgb: false, segmentation: true };

fn check(frame: &Frame, scene: &[Seen], camera: &Camera) -> Result<usize, TestCaseError> {
    let width = camera.intrinsics().width as usize;
    let mut on_edges = 0;
    for (i, (depth, label)) in frame.depth.iter().zip(&frame.segmentation).enumerate() {
        let (u, v) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let agrees = |du: f64, dv: f64| {
            let (z, expected) = cast(scene, camera, u + du, v + dv);
            (f64::from(*depth) - z).abs() <= RELATIVE * z && *label == expected
        };
        if agrees(0.0, 0.0) {
            continue;
        }
        on_edges += 1;
        let near_edge = [(EDGE, 0.0), (-EDGE, 0.0), (0.0, EDGE), (0.0, -EDGE)].map(|(du, dv)| agrees(du, dv));
        let expected = cast(scene, camera, u, v);
        prop_assert!(near_edge.contains(&true), "pixel ({u}, {v}): {depth} of {label}, a ray finds {expected:?}");
    }
    Ok(on_edges)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn depth_is_that_of_rays(seed in any::<u64>()) {
        let mut dice = Dice::new(seed);
        let camera = random_camera(&mut dice, 40);
        let mut meshes: Vec<(TriMesh, Isometry3<f64>)> =
            (0..dice.below(5)).map(|_| (random_mesh(&mut dice), dice.pose(0.5))).collect();
        meshes.push((table(), Isometry3::translation(0.0, 0.0, dice.range(-0.5, 0.0))));
        let models: Vec<Model> = meshes.iter().map(|(mesh, _)| Model::new(mesh).unwrap()).collect();
        let label = |i: usize| 10 + i as u8;
        let instances: Vec<_> = models.iter().enumerate().map(|(i, m)| instance(m, meshes[i].1, label(i))).collect();
        let scene: Vec<_> = meshes.iter().enumerate().map(|(i, (m, pose))| seen(m, pose, &camera, label(i))).collect();
        let mut renderer = Renderer::new(Detail::Full);
        let frame = renderer.render(&instances, &camera, &Light::default(), LABELS).unwrap();
        check(&frame, &scene, &camera)?;

        // Colours change neither depth nor labels, and depth alone is the same depth.
        let all = Channels { rgb: true, segmentation: true };
        let colored = renderer.render(&instances, &camera, &Light::default(), all).unwrap();
        prop_assert_eq!(&colored.depth, &frame.depth);
        prop_assert_eq!(&colored.segmentation, &frame.segmentation);
        let plain = renderer.render(&instances, &camera, &Light::default(), Channels::default()).unwrap();
        prop_assert_eq!(&plain.depth, &frame.depth);
    }
}

/// A camera 2 mm above a table that reaches from behind it to 0.9 m ahead: one triangle spans depths from near to far.
#[test]
fn a_table_under_the_lens_is_clipped_and_stays_exact() {
    let (mesh, pose) = (table(), Isometry3::translation(0.0, 0.0, -0.02));
    let model = Model::new(&mesh).unwrap();
    let intrinsics = Intrinsics::from_fov(5, 480, 1.2).unwrap();
    let (eye, target) = (Point3::new(-0.3, 0.01, 0.002), Point3::new(0.0, 0.0, 0.0));
    let camera = Camera::look_at(intrinsics, eye, target, Vector3::z()).unwrap();
    let camera = camera.with_range(1e-4, 10.0).unwrap();
    let mut renderer = Renderer::new(Detail::Full);
    let frame = renderer.render(&[instance(&model, pose, 7)], &camera, &Light::default(), LABELS).unwrap();
    check(&frame, &[seen(&mesh, &pose, &camera, 7)], &camera).unwrap();
    let seen = frame.depth.iter().filter(|z| **z > 0.0);
    assert!(seen.clone().any(|z| *z < 0.004) && seen.clone().any(|z| *z > 0.5));
}

/// Rays through a shared edge hit one of its two faces: a fan around the axis leaves no hole at a pixel's centre.
#[test]
fn edges_through_pixel_centers_leave_no_gap() {
    let mesh = graspbox_render::shapes::cylinder(0.5, 0.1, 64).unwrap();
    let pose = Isometry3::translation(0.0, 0.0, -0.1);
    let intrinsics = Intrinsics::from_fov(33, 33, 0.5).unwrap();
    let camera = Camera::look_at(intrinsics, Point3::new(0.0, 0.0, 1.0), Point3::origin(), Vector3::y()).unwrap();
    let model = Model::new(&mesh).unwrap();
    let mut renderer = Renderer::new(Detail::Full);
    let frame = renderer.render(&[instance(&model, pose, 1)], &camera, &Light::default(), LABELS).unwrap();
    assert!(frame.depth.iter().all(|z| (z - 1.0).abs() < 1e-6));
}

/// From inside a closed box every ray meets its inner side, and the near plane cuts surfaces that are too close.
#[test]
fn the_inside_of_a_box_is_seen_from_inside() {
    let mesh = graspbox_render::shapes::cuboid(Vector3::new(0.1, 0.2, 0.3), 0.0).unwrap();
    let model = Model::new(&mesh).unwrap();
    let camera = Camera::new(Intrinsics::from_fov(16, 16, 1.5).unwrap(), Isometry3::identity()).unwrap();
    let mut renderer = Renderer::new(Detail::Full);
    let whole = [instance(&model, Isometry3::identity(), 1)];
    let frame = renderer.render(&whole, &camera, &Light::default(), LABELS).unwrap();
    check(&frame, &[seen(&mesh, &Isometry3::identity(), &camera, 1)], &camera).unwrap();
    assert!(frame.depth.iter().all(|z| *z > 0.0));
    let beyond = camera.with_range(0.31, 1.0).unwrap();
    let frame = renderer.render(&whole, &beyond, &Light::default(), LABELS).unwrap();
    assert!(frame.depth.iter().all(|z| *z == 0.0));
}
