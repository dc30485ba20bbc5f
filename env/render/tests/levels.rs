//! Levels of detail are within their stated error of the true surface.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::instance;
use graspbox_mesh::TriMesh;
use graspbox_objects::{Family, generate};
use graspbox_render::{Camera, Channels, Detail, Frame, Intrinsics, Light, Model, Renderer, shapes};
use nalgebra::{Isometry3, Point3, Vector3};

/// Distance from a point to a triangle.
fn to_triangle(p: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> f64 {
    let segment = |a: &Point3<f64>, b: &Point3<f64>| {
        let (along, to) = (b - a, p - a);
        let share = (to.dot(&along) / along.norm_squared().max(1e-300)).clamp(0.0, 1.0);
        (to - along * share).norm()
    };
    let normal = (b - a).cross(&(c - a));
    let over = [(a, b), (b, c), (c, a)].iter().all(|(a, b)| normal.cross(&(*b - *a)).dot(&(p - *a)) >= 0.0);
    if over && normal.norm() > 0.0 {
        return (normal.dot(&(p - a)) / normal.norm()).abs();
    }
    segment(a, b).min(segment(b, c)).min(segment(c, a))
}

fn to_mesh(p: &Point3<f64>, mesh: &TriMesh) -> f64 {
    let distances = (0..mesh.faces().len()).map(|f| to_triangle(p, &mesh.triangle(f)));
    distances.fold(f64::INFINITY, f64::min)
}

fn render(model: &Model, camera: &Camera, detail: Detail) -> Frame {
    let instances = [instance(model, Isometry3::identity(), 1)];
    let mut renderer = Renderer::new(detail);
    renderer.render(&instances, camera, &Light::default(), Channels::default()).unwrap()
}

fn look(mesh: &TriMesh, size: u32, distance: f64) -> Camera {
    let aabb = mesh.aabb();
    let middle = nalgebra::center(&aabb.min, &aabb.max);
    let eye = middle + Vector3::new(1.0, -2.0, 1.5).normalize() * distance;
    Camera::look_at(Intrinsics::from_fov(size, size, 0.6).unwrap(), eye, middle, Vector3::z()).unwrap()
}

/// True if the object covers one of the 3 x 3 pixels around pixel `i`.
fn near(frame: &Frame, i: usize) -> bool {
    let [width, height] = frame.size();
    let (x, y) = (i % width, i / width);
    let rows = y.saturating_sub(1)..(y + 2).min(height);
    rows.into_iter().any(|y| (x.saturating_sub(1)..(x + 2).min(width)).any(|x| frame.depth[y * width + x] > 0.0))
}

#[test]
fn what_is_seen_lies_within_half_a_pixel_of_the_surface() {
    let meshes = [
        generate(Family::Mug, 3).unwrap().mesh,
        generate(Family::Banana, 1).unwrap().mesh,
        shapes::sphere(0.05, 128).unwrap(),
        shapes::cuboid(Vector3::new(0.03, 0.02, 0.05), 0.004).unwrap(),
    ];
    for mesh in meshes {
        let model = Model::new(&mesh).unwrap();
        let (mut coarser, mut pixels) = (0, 0);
        for size in [16, 32, 64] {
            let camera = look(&mesh, size, 0.35);
            let (level, full) = (render(&model, &camera, Detail::Auto), render(&model, &camera, Detail::Full));
            coarser += usize::from(level != full);
            // Half a pixel at the nearest point of the bounding ball is less than half a pixel in the middle.
            let allowed = 0.5 * 0.35 / camera.intrinsics().fy;
            for (i, z) in level.depth.iter().enumerate() {
                let (u, v) = ((i % size as usize) as f64 + 0.5, (i / size as usize) as f64 + 0.5);
                if *z > 0.0 {
                    let error = to_mesh(&camera.unproject(u, v, f64::from(*z)), &mesh);
                    assert!(error <= allowed, "{error} m off, {allowed} m allowed at {size} pixels");
                    pixels += 1;
                }
                // Outlines move by less than a pixel.
                assert!(*z == 0.0 || near(&full, i));
                assert!(full.depth[i] == 0.0 || near(&level, i));
            }
        }
        assert!(coarser > 0 && pixels > 400, "{coarser} {pixels}");
    }
}

#[test]
fn small_images_need_few_faces() {
    let mesh = shapes::sphere(0.05, 128).unwrap();
    assert!(mesh.faces().len() > 16_000);
    let model = Model::new(&mesh).unwrap();
    let levels: Vec<_> = model.levels().collect();
    assert_eq!(levels[0], (mesh.faces().len(), 0.0));
    assert!(levels.windows(2).all(|w| w[1].0 < w[0].0));
    let camera = look(&mesh, 64, 0.5);
    let allowed = 0.5 * (0.5 - 0.05) / camera.intrinsics().fy;
    assert!(levels.iter().any(|(faces, error)| *faces <= 256 && *error <= allowed), "{levels:?} {allowed}");
    // A ball's faces miss it by their sagitta: a level with n faces cannot do better than this, nor should it do much worse.
    for (faces, error) in &levels[1..6] {
        let cap = 4.0 * std::f64::consts::PI * 0.05 * 0.05 / *faces as f64;
        let sagitta = cap / (2.0 * std::f64::consts::PI * 0.05);
        assert!((0.3 * sagitta..8.0 * sagitta).contains(error), "{faces} {error} {sagitta}");
    }
}
