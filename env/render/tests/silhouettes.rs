//! Outlines and depths of a ball and a box agree with closed forms.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::{Dice, instance};
use graspbox_render::{Camera, Channels, Detail, Frame, Instance, Intrinsics, Light, Model, Renderer, shapes};
use nalgebra::{Isometry3, Point3, Vector3};

const LABELS: Channels = Channels { rgb: false, segmentation: true };

fn camera(dice: &mut Dice) -> Camera {
    let eye = Point3::from(dice.vector(1.0).normalize() * dice.range(0.5, 1.0));
    let intrinsics = Intrinsics::from_fov(160, 120, 0.6).unwrap();
    Camera::look_at(intrinsics, eye, Point3::from(dice.vector(0.05)), dice.vector(1.0)).unwrap()
}

fn render(instance: &Instance, camera: &Camera) -> Frame {
    let mut renderer = Renderer::new(Detail::Full);
    renderer.render(&[*instance], camera, &Light::default(), LABELS).unwrap()
}

/// Each pixel's centre, depth and label.
fn pixels(frame: &Frame) -> impl Iterator<Item = (f64, f64, f64, u8)> + '_ {
    let width = frame.size()[0];
    frame
        .depth
        .iter()
        .zip(&frame.segmentation)
        .enumerate()
        .map(move |(i, (z, label))| ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5, f64::from(*z), *label))
}

#[test]
fn a_ball_is_a_ball() {
    let (radius, columns) = (0.1, 512);
    let mesh = shapes::sphere(radius, columns).unwrap();
    let model = Model::without_levels(&mesh).unwrap();
    // How far the faces lie inside the sphere.
    let sag = radius * (1.0 - (std::f64::consts::PI / columns as f64).cos()) * 2.1;
    for seed in 0..5 {
        let mut dice = Dice::new(seed);
        let camera = camera(&mut dice);
        let world_from_ball = dice.pose(0.05);
        let frame = render(&instance(&model, world_from_ball, 9), &camera);
        let center = camera.camera_from_object(&world_from_ball).translation.vector;
        let mut on_ball = 0;
        for (u, v, z, label) in pixels(&frame) {
            let ray = camera.intrinsics().unproject(u, v, 1.0).coords;
            let way = ray.normalize();
            let passes = (center - way * center.dot(&way)).norm();
            if passes > radius {
                assert_eq!((z, label), (0.0, 0));
            } else if passes < radius - sag {
                assert_eq!(label, 9);
                on_ball += 1;
                let half_chord = (radius * radius - passes * passes).sqrt();
                let exact = (center.dot(&way) - half_chord) / ray.norm();
                // The faces lie inside by `sag` along the normal; the ray meets them at a slant.
                let slant = half_chord / radius;
                assert!((z - exact).abs() < 2.0 * sag / slant + 1e-6, "{z} {exact}");
            }
        }
        assert!(on_ball > 1000);
    }
}

#[test]
fn a_box_fills_the_hull_of_its_corners() {
    let half = Vector3::new(0.05, 0.1, 0.08);
    let model = Model::new(&shapes::cuboid(half, 0.0).unwrap()).unwrap();
    for seed in 0..20 {
        let mut dice = Dice::new(seed);
        let camera = camera(&mut dice);
        let world_from_box = dice.pose(0.05);
        let frame = render(&instance(&model, world_from_box, 9), &camera);
        let sign = |i: usize, bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
        let corner = |i| Point3::from(half.component_mul(&Vector3::new(sign(i, 1), sign(i, 2), sign(i, 4))));
        let corners: Vec<_> = (0..8).map(|i| camera.project(&(world_from_box * corner(i))).unwrap().at).collect();
        let mut on_box = 0;
        for (u, v, z, label) in pixels(&frame) {
            let p = nalgebra::Point2::new(u, v);
            // Outside a convex hull there is a line through two of its corners with all corners on one side and the point on the other.
            let outside = (0..64).any(|k| {
                let (a, b) = (corners[k / 8], corners[k % 8]);
                let side = |q: &nalgebra::Point2<f64>| (b - a).perp(&(q - a));
                a != b && corners.iter().all(|c| side(c) > -1e-9) && side(&p) < 0.0
            });
            assert_eq!(label, if outside { 0 } else { 9 }, "pixel ({u}, {v})");
            assert_eq!(z > 0.0, !outside);
            on_box += usize::from(!outside);
        }
        assert!(on_box > 500);
    }
}

#[test]
fn nearer_hides_farther_whatever_the_order() {
    let model = Model::new(&shapes::cuboid(Vector3::new(0.1, 0.1, 0.01), 0.0).unwrap()).unwrap();
    let intrinsics = Intrinsics::from_fov(21, 21, 0.3).unwrap();
    let camera = Camera::look_at(intrinsics, Point3::new(0.0, 0.0, 1.0), Point3::origin(), Vector3::y()).unwrap();
    let at = |z, label| instance(&model, Isometry3::translation(0.0, 0.0, z), label);
    let mut renderer = Renderer::new(Detail::Auto);
    for instances in [[at(0.0, 1), at(0.1, 2)], [at(0.1, 2), at(0.0, 1)]] {
        let frame = renderer.render(&instances, &camera, &Light::default(), LABELS).unwrap();
        assert_eq!(frame.segmentation[10 * 21 + 10], 2);
        assert!((frame.depth[10 * 21 + 10] - 0.89).abs() < 1e-6);
    }
}
