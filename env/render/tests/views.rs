//! Cameras are placed as planned.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::dome;
use graspbox_render::{Intrinsics, ViewPlan, views};
use nalgebra::{Isometry3, Point3, Vector3};

fn lens() -> Intrinsics {
    Intrinsics::from_fov(64, 64, 0.9).unwrap()
}

#[test]
fn the_studys_cameras_are_near_its_pose() {
    let target = Point3::new(0.1, -0.2, 0.05);
    let plan = ViewPlan::study();
    let cameras = views(&plan, lens(), target, 2000, 7).unwrap();
    let axis = plan.axis.normalize();
    let mut angles = Vec::new();
    for camera in &cameras {
        let pose = camera.world_from_camera();
        let way = pose.rotation * Vector3::z();
        angles.push(way.dot(&-axis).clamp(-1.0, 1.0).acos());
        let unshifted = target - way * 0.7;
        assert!((pose.translation.vector - unshifted.coords).amax() <= 0.05 + 1e-12);
        // Upright, and the object is in view.
        assert!((pose.rotation * Vector3::x()).z.abs() < 1e-9);
        let seen = camera.project(&target).unwrap();
        assert!(seen.index(camera.intrinsics()).is_some());
        let object = Isometry3::translation(target.x, target.y, target.z);
        let at = camera.camera_from_object(&object).translation.vector;
        assert!((at.z - seen.depth).abs() < 1e-12 && (0.6..0.8).contains(&at.z));
    }
    let greatest = angles.iter().fold(0.0_f64, |a, b| a.max(*b));
    assert!(greatest <= 15_f64.to_radians() + 1e-9 && greatest > 14.5_f64.to_radians());
    // Uniform by area: half of the cameras lie within about 15 / sqrt 2 degrees.
    let inner = angles.iter().filter(|a| **a < 15_f64.to_radians() / 2_f64.sqrt()).count();
    assert!((900..1100).contains(&inner), "{inner}");
}

#[test]
fn seeds_make_views_and_counts_do_not() {
    let target = Point3::origin();
    let plan = ViewPlan::study();
    let all = views(&plan, lens(), target, 50, 1).unwrap();
    assert_eq!(views(&plan, lens(), target, 20, 1).unwrap(), all[..20]);
    assert_ne!(views(&plan, lens(), target, 20, 2).unwrap(), all[..20]);
    assert!(views(&plan, lens(), target, 0, 1).unwrap().is_empty());
}

#[test]
fn a_grid_covers_the_dome_evenly() {
    let plan = dome(0.5);
    let cameras = views(&plan, lens(), Point3::origin(), 200, 0).unwrap();
    assert_eq!(cameras, views(&plan, lens(), Point3::origin(), 200, 9).unwrap());
    let eyes: Vec<_> = cameras.iter().map(|c| c.world_from_camera().translation.vector).collect();
    assert!(eyes.iter().all(|e| (e.norm() - 0.5).abs() < 1e-12 && e.z > 0.0));
    // Neighbours: 200 points share 2 pi steradians, so each has one within twice, and none within half, of an even spacing.
    let spacing = 0.5 * (2.0 * std::f64::consts::PI / 200.0_f64).sqrt();
    for (i, a) in eyes.iter().enumerate() {
        let others = eyes.iter().enumerate().filter(|(j, _)| *j != i);
        let nearest = others.map(|(_, b)| (a - b).norm()).fold(f64::INFINITY, f64::min);
        assert!((0.5 * spacing..2.0 * spacing).contains(&nearest), "{nearest} {spacing}");
    }
}

#[test]
fn straight_down_and_from_below_work() {
    for axis in [Vector3::z(), -Vector3::z(), Vector3::x()] {
        let plan = ViewPlan { axis, cap: 0.0, shift: 0.0, ..ViewPlan::study() };
        let cameras = views(&plan, lens(), Point3::origin(), 3, 0).unwrap();
        assert!(cameras.iter().all(|c| (c.world_from_camera().translation.vector - axis * 0.7).norm() < 1e-9));
    }
}

#[test]
fn bad_plans_are_refused() {
    let spoil: [fn(&mut ViewPlan); 6] = [
        |p| p.axis = Vector3::zeros(),
        |p| p.cap = 4.0,
        |p| p.distance = [0.7, 0.6],
        |p| p.distance = [0.0, 1.0],
        |p| p.shift = f64::NAN,
        |p| p.up = Vector3::zeros(),
    ];
    for spoil in spoil {
        let mut plan = ViewPlan::study();
        spoil(&mut plan);
        assert!(views(&plan, lens(), Point3::origin(), 1, 0).is_err());
    }
    assert!(views(&ViewPlan::study(), lens(), Point3::origin(), 1_000_001, 0).is_err());
    assert!(views(&ViewPlan::study(), lens(), Point3::new(f64::NAN, 0.0, 0.0), 1, 0).is_err());
}
