//! Shadows are where the lamp's rays are blocked, and fade over the requested width.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::{instance, table};
use graspbox_mesh::TriMesh;
use graspbox_render::{Camera, Channels, Detail, Frame, Instance, Intrinsics, Light, Model, Renderer, shapes};
use nalgebra::{Isometry3, Point3, Vector3};

const ALL: Channels = Channels { rgb: true, segmentation: true };

fn camera() -> Camera {
    let intrinsics = Intrinsics::from_fov(120, 100, 0.8).unwrap();
    let (eye, target) = (Point3::new(-0.35, -0.3, 0.5), Point3::new(0.0, 0.0, 0.05));
    Camera::look_at(intrinsics, eye, target, Vector3::z()).unwrap()
}

/// With and without shadows.
fn both(scene: &[Instance], light: &Light) -> [Frame; 2] {
    [true, false].map(|shadows| {
        let light = Light { shadows, ..*light };
        Renderer::new(Detail::Auto).render(scene, &camera(), &light, ALL).unwrap()
    })
}

#[test]
fn a_ball_throws_its_shadow_along_the_light() {
    let (ground, ball) = (Model::new(&table()).unwrap(), Model::new(&shapes::sphere(0.04, 64).unwrap()).unwrap());
    let center = Point3::new(0.02, -0.03, 0.09);
    let floor = Instance { casts_shadow: false, ..instance(&ground, Isometry3::translation(0.0, 0.0, -0.02), 1) };
    let scene = [floor, instance(&ball, Isometry3::from(center.coords), 2)];
    for direction in [Vector3::new(-0.3, 0.4, -1.0), Vector3::new(0.8, 0.1, -0.7), -Vector3::z()] {
        let light = Light { direction, softness: 0.01, ..Light::default() };
        let [with, without] = both(&scene, &light);
        let way = direction.normalize();
        let (mut dark, mut half) = (0, 0);
        for (i, label) in with.segmentation.iter().enumerate() {
            if *label != 1 {
                continue;
            }
            let (u, v) = ((i % 120) as f64 + 0.5, (i / 120) as f64 + 0.5);
            let to_ball = center - camera().unproject(u, v, f64::from(with.depth[i]));
            let passes = (to_ball - way * to_ball.dot(&way)).norm();
            let (lit, full) = (with.rgb[3 * i], without.rgb[3 * i]);
            // The filter is a square of `softness`, and the ball is rasterized within a texel, a quarter of that.
            if passes > 0.04 + 0.010 {
                assert_eq!(lit, full);
            } else if passes < 0.04 - 0.010 {
                assert!(lit < full - 40, "{lit} {full}");
                dark += 1;
            } else {
                assert!(lit <= full);
                half += usize::from(lit + 5 < full);
            }
        }
        assert!(dark > 20 && half > 20, "{dark} {half}");
    }
}

#[test]
fn a_sheet_shades_the_table_but_not_itself() {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let vertices = corners.map(|(x, y)| Point3::new(0.05 * x, 0.05 * y, 0.0)).to_vec();
    let sheet = Model::new(&TriMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]]).unwrap()).unwrap();
    assert!(!sheet.is_closed());
    let ground = Model::new(&table()).unwrap();
    // Both sides are rendered: turned over, it looks the same.
    let over = Isometry3::new(Vector3::new(0.0, 0.0, 0.1), Vector3::x() * std::f64::consts::PI);
    for pose in [Isometry3::translation(0.0, 0.0, 0.1), over] {
        let floor = Instance { casts_shadow: false, ..instance(&ground, Isometry3::translation(0.0, 0.0, -0.02), 1) };
        let [with, without] = both(&[floor, instance(&sheet, pose, 2)], &Light::default());
        let mut darker = [0; 3];
        for (i, label) in with.segmentation.iter().enumerate() {
            darker[*label as usize] += usize::from(with.rgb[3 * i] < without.rgb[3 * i]);
        }
        assert!(with.segmentation.contains(&2));
        assert!(darker[1] > 50 && darker[2] == 0, "{darker:?}");
    }
}

#[test]
fn closed_solids_do_not_shade_their_lit_sides() {
    let light = Light { direction: Vector3::new(0.3, 0.5, -1.0), ..Light::default() };
    let solids = [
        shapes::cuboid(Vector3::repeat(0.05), 0.0).unwrap(),
        shapes::sphere(0.06, 64).unwrap(),
        shapes::cylinder(0.05, 0.05, 64).unwrap(),
    ];
    for mesh in solids {
        let model = Model::new(&mesh).unwrap();
        let [with, without] = both(&[instance(&model, Isometry3::translation(0.0, 0.0, 0.06), 1)], &light);
        let losses = with.rgb.iter().zip(&without.rgb).map(|(a, b)| b - a);
        let most = losses.max().unwrap();
        // Along the line where the back begins, the map's texels locate it to a part of their width.
        assert!(most <= 8, "{} faces: {most}", mesh.faces().len());
    }
}
