//! Invalid input gives an error; degenerate geometry is rendered without one.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::{Dice, instance, random_camera};
use graspbox_mesh::{OutOfRange, TriMesh};
use graspbox_render::{
    Camera, Channels, Detail, Frame, Instance, Intrinsics, Light, Model, RenderError, Renderer, shapes,
};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};

const ALL: Channels = Channels { rgb: true, segmentation: true };

fn camera() -> Camera {
    let intrinsics = Intrinsics::from_fov(32, 24, 0.8).unwrap();
    Camera::look_at(intrinsics, Point3::new(0.0, -0.5, 0.3), Point3::origin(), Vector3::z()).unwrap()
}

fn render(scene: &[Instance]) -> Result<Frame, RenderError> {
    Renderer::new(Detail::Auto).render(scene, &camera(), &Light::default(), ALL)
}

#[test]
fn an_empty_scene_is_background() {
    let frame = render(&[]).unwrap();
    assert!(frame.depth.iter().all(|z| *z == 0.0) && frame.segmentation.iter().all(|l| *l == 0));
    assert_eq!((frame.depth.len(), frame.segmentation.len(), frame.rgb.len()), (768, 768, 2304));
    // Brighter above than below.
    assert!(frame.rgb[0] > frame.rgb[2301]);
}

#[test]
fn bad_poses_and_numbers_are_refused() {
    let model = Model::new(&shapes::sphere(0.1, 12).unwrap()).unwrap();
    let at = |pose| render(&[instance(&model, pose, 1)]);
    assert!(at(Isometry3::identity()).is_ok());
    let long = UnitQuaternion::new_unchecked(Quaternion::new(1.1, 0.0, 0.0, 0.0));
    let bad = [
        Isometry3::translation(f64::NAN, 0.0, 0.0),
        Isometry3::translation(0.0, f64::INFINITY, 0.0),
        Isometry3::translation(0.0, 0.0, 2e4),
        Isometry3::from_parts(Translation3::identity(), long),
        Isometry3::from_parts(
            Translation3::identity(),
            UnitQuaternion::new_unchecked(Quaternion::new(f64::NAN, 0.0, 0.0, 0.0)),
        ),
    ];
    for pose in bad {
        let message = at(pose).map(|_| ()).unwrap_err().to_string();
        assert!(message.contains("pose of instance 0"), "{message}");
        assert!(matches!(camera().with_pose(pose), Err(RenderError::BadPose { .. })));
    }
    let painted = Instance { color: [0.5, f32::NAN, 0.5], ..instance(&model, Isometry3::identity(), 1) };
    assert!(matches!(render(&[painted]), Err(RenderError::OutOfRange(OutOfRange { field: "color", .. }))));
    let dark = Light { direction: Vector3::zeros(), ..Light::default() };
    assert!(Renderer::new(Detail::Auto).render(&[], &camera(), &dark, ALL).is_err());
    assert!(Renderer::new(Detail::Auto).picture(&[], &camera(), &Light::default(), 9).is_err());
    let far =
        TriMesh::new(vec![Point3::new(2e4, 0.0, 0.0), Point3::origin(), Point3::new(0.0, 1.0, 0.0)], vec![[0, 1, 2]]);
    assert!(Model::new(&far.unwrap()).is_err());
}

#[test]
fn bad_cameras_are_refused() {
    let good = *camera().intrinsics();
    let spoil: [fn(&mut Intrinsics); 6] = [
        |k| k.width = 0,
        |k| k.height = 4097,
        |k| k.fx = f64::NAN,
        |k| k.fy = -1.0,
        |k| k.cx = f64::INFINITY,
        |k| k.cy = 1e7,
    ];
    for spoil in spoil {
        let mut bad = good;
        spoil(&mut bad);
        assert!(matches!(Camera::new(bad, Isometry3::identity()), Err(RenderError::OutOfRange(_))));
    }
    assert!(Intrinsics::from_fov(10, 10, 3.2).is_err());
    for (near, far) in [(0.0, 1.0), (1.0, 1.0), (2.0, 1.0), (0.1, f64::NAN), (0.1, 1e5)] {
        assert!(camera().with_range(near, far).is_err(), "{near} {far}");
    }
    let (eye, up) = (Point3::new(0.0, 0.0, 1.0), Vector3::z());
    for (target, up) in [(eye, up), (Point3::origin(), up), (Point3::new(1.0, 0.0, 0.0), Vector3::zeros())] {
        assert!(matches!(Camera::look_at(good, eye, target, up), Err(RenderError::BadLookAt { .. })));
    }
}

#[test]
fn points_go_through_the_camera_and_back() {
    let mut dice = Dice::new(1);
    for _ in 0..100 {
        let camera = random_camera(&mut dice, 100);
        let (u, v, z) = (dice.range(-5.0, 105.0), dice.range(-5.0, 105.0), dice.range(camera.near(), camera.far()));
        let seen = camera.project(&camera.unproject(u, v, z)).unwrap();
        assert!((seen.at.x - u).abs() < 1e-9 && (seen.at.y - v).abs() < 1e-9 && (seen.depth - z).abs() < 1e-12);
        let inside = u >= 0.0
            && v >= 0.0
            && u < f64::from(camera.intrinsics().width)
            && v < f64::from(camera.intrinsics().height);
        assert_eq!(seen.index(camera.intrinsics()), inside.then_some([u as usize, v as usize]));
        assert!(camera.project(&camera.unproject(u, v, -z)).is_none());
    }
    // Upright: above in the world is above in the image.
    let high = camera().project(&Point3::new(0.0, 0.0, 0.1)).unwrap();
    let right = camera().project(&Point3::new(0.1, 0.0, 0.0)).unwrap();
    assert!(high.at.y < 12.0 && (high.at.x - 16.0).abs() < 1e-9 && right.at.x > 16.0);
}

#[test]
fn frames_give_points() {
    let model = Model::new(&shapes::sphere(0.1, 32).unwrap()).unwrap();
    let scene = [instance(&model, Isometry3::identity(), 3)];
    let frame = Renderer::new(Detail::Full).render(&scene, &camera(), &Light::default(), ALL).unwrap();
    assert_eq!(frame.size(), [32, 24]);
    let seen: Vec<_> = frame.points().collect();
    assert_eq!(seen.len(), 768);
    for (i, point) in seen.iter().enumerate() {
        let (u, v) = ((i % 32) as f64 + 0.5, (i / 32) as f64 + 0.5);
        assert_eq!(point[2], frame.depth[i]);
        if frame.segmentation[i] == 3 {
            let world = camera().unproject(u, v, f64::from(frame.depth[i]));
            let local = camera().world_from_camera().inverse_transform_point(&world);
            assert!((local.coords - Vector3::from(*point).cast()).norm() < 1e-6);
            assert!(world.coords.norm() < 0.1001 && world.coords.norm() > 0.097);
        } else {
            assert_eq!(*point, [0.0; 3]);
        }
    }
    assert!(seen.iter().any(|p| p[2] > 0.0));
}

#[test]
fn degenerate_and_huge_faces_do_no_harm() {
    let p = |x, y, z| Point3::new(x, y, z);
    let vertices = vec![p(0.0, 0.0, 0.0), p(0.1, 0.0, 0.0), p(0.2, 0.0, 0.0), p(0.0, 0.0, 0.0), p(0.1, 1e-9, 1e-9)];
    let thin = TriMesh::new(vertices, vec![[0, 1, 2], [0, 3, 1], [0, 0, 0], [0, 2, 4]]).unwrap();
    let model = Model::new(&thin).unwrap();
    let frame = render(&[instance(&model, Isometry3::identity(), 1)]).unwrap();
    assert!(frame.depth.iter().all(|z| *z == 0.0 || (0.4..0.8).contains(z)));

    // A floor of 20 km, seen from 1 m above it and reaching behind the camera.
    let far = 9.9e3;
    let vertices = vec![p(-far, -far, -1.0), p(far, -far, -1.0), p(far, far, -1.0), p(-far, far, -1.0)];
    let floor = Model::new(&TriMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]]).unwrap()).unwrap();
    let mut renderer = Renderer::new(Detail::Auto);
    let scene = [instance(&floor, Isometry3::identity(), 1)];
    let camera = camera().with_range(1e-4, 1e4).unwrap();
    let frame = renderer.render(&scene, &camera, &Light::default(), ALL).unwrap();
    for (i, z) in frame.depth.iter().enumerate() {
        let (u, v) = ((i % 32) as f64 + 0.5, (i / 32) as f64 + 0.5);
        let world = camera.unproject(u, v, f64::from(*z));
        assert!(*z == 0.0 || (world.z + 1.0).abs() < 1e-5 * f64::from(*z), "{world}");
    }
    assert!(frame.segmentation[23 * 32] == 1);
}

#[test]
fn what_is_behind_or_beyond_is_not_seen() {
    let model = Model::new(&shapes::sphere(0.1, 12).unwrap()).unwrap();
    let axis = camera().world_from_camera().rotation * Vector3::z();
    let eye = camera().world_from_camera().translation.vector;
    for (distance, visible) in [(-0.3, false), (0.3, true), (9.9, true), (10.3, false)] {
        let frame = render(&[instance(&model, Isometry3::from(eye + axis * distance), 1)]).unwrap();
        // Far away it is smaller than a pixel; the pixels' corners meet in the middle of the image.
        let seen = frame.depth.iter().any(|z| *z > 0.0);
        assert!(seen == visible || distance == 9.9, "{distance}");
    }
}
