//! Prints frames per second on one thread (from the median frame) for a hand of boxes and cylinders over an object on a table.
//!
//! `cargo run --release -p graspbox-camera --example render_speed -- MESH.stl`

use graspbox_mesh::{LoadOptions, default_pose, load};
use graspbox_render::{Camera, Channels, Detail, Frame, Instance, Intrinsics, Light, Model, Renderer, shapes};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::error::Error;
use std::path::Path;
use std::time::Instant;

const OBJECT: u8 = 2;

/// A solid of the hand and its `world_from_model`.
type Part = (Model, Isometry3<f64>);

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("give the path of a mesh")?;
    let mesh = load(Path::new(&path), &LoadOptions::default())?;
    let start = Instant::now();
    let object = Model::new(&mesh)?;
    println!("levels of detail in {:.0} ms (faces, error in mm):", start.elapsed().as_secs_f64() * 1e3);
    for (faces, error) in object.levels() {
        println!("{faces:>8} {:8.2}", error * 1e3);
    }
    let table = Model::new(&shapes::cuboid(Vector3::new(0.6, 0.6, 0.02), 0.0)?)?;
    let world_from_object = default_pose(&mesh);
    let top = mesh.transformed(&world_from_object).aabb().max.z;
    let hand = hand(top + 0.06)?;
    let mut instances = vec![
        Instance {
            casts_shadow: false,
            ..place(&table, Isometry3::translation(0.0, 0.0, -0.02), [0.80, 0.74, 0.66], 1)
        },
        place(&object, world_from_object, [0.85, 0.33, 0.22], OBJECT),
    ];
    instances
        .extend(hand.iter().enumerate().map(|(i, (model, pose))| place(model, *pose, [0.45, 0.47, 0.52], 3 + i as u8)));
    let faces: usize = hand.iter().filter_map(|(m, _)| m.levels().next()).map(|l| l.0).sum();
    println!("hand: {} solids, {faces} faces", hand.len());
    for size in [64, 128, 224] {
        measure(&instances, size, top)?;
    }
    Ok(())
}

fn measure(instances: &[Instance], size: u32, top: f64) -> Result<(), Box<dyn Error>> {
    let target = Point3::new(0.0, 0.0, 0.6 * top);
    let eye = target + Vector3::new(-0.2, -0.2, 0.12);
    let camera = Camera::look_at(Intrinsics::from_fov(size, size, 0.9)?, eye, target, Vector3::z())?;
    let mut renderer = Renderer::new(Detail::Auto);
    let labels = Channels { rgb: false, segmentation: true };
    let frame = renderer.render(instances, &camera, &Light::default(), labels)?;
    let share = |keep: &dyn Fn(u8) -> bool| {
        frame.segmentation.iter().filter(|l| keep(**l)).count() as f64 / frame.segmentation.len() as f64 * 100.0
    };
    print!("{size:>4}: object {:.0} %, hand {:.0} % of the pixels;", share(&|l| l == OBJECT), share(&|l| l > OBJECT));
    for (name, rgb, segmentation) in [("depth", false, false), ("+ segmentation", false, true), ("rgb", true, false)] {
        let mut frame = Frame::default();
        let channels = Channels { rgb, segmentation };
        let mut seconds = Vec::new();
        for _ in 0..2000 {
            let start = Instant::now();
            renderer.render_into(instances, &camera, &Light::default(), channels, &mut frame)?;
            seconds.push(start.elapsed().as_secs_f64());
        }
        seconds.sort_by(f64::total_cmp);
        let median = seconds[seconds.len() / 2];
        print!(" {name} {:.0} frames/s ({:.0} us)", 1.0 / median, median * 1e6);
    }
    println!();
    Ok(())
}

fn place(model: &Model, world_from_model: Isometry3<f64>, color: [f32; 3], label: u8) -> Instance<'_> {
    Instance { model, world_from_model, color, label, casts_shadow: true }
}

/// A palm at height `z` with three bent fingers around the vertical.
fn hand(z: f64) -> Result<Vec<Part>, Box<dyn Error>> {
    let link = |half: [f64; 3]| -> Result<Model, Box<dyn Error>> {
        Ok(Model::new(&shapes::cuboid(half.into(), 0.2 * half[1].min(half[2]))?)?)
    };
    let round =
        |radius, half| -> Result<Model, Box<dyn Error>> { Ok(Model::new(&shapes::cylinder(radius, half, 32)?)?) };
    let mut parts = vec![
        (round(0.05, 0.02)?, Isometry3::translation(0.0, 0.0, z + 0.03)),
        (round(0.035, 0.05)?, Isometry3::translation(0.0, 0.0, z + 0.09)),
        (link([0.05, 0.04, 0.008])?, Isometry3::translation(0.0, 0.0, z + 0.008)),
    ];
    for turn in [0.0, 2.1, 4.2] {
        let root =
            Isometry3::from_parts(Translation3::new(0.0, 0.0, z), UnitQuaternion::from_euler_angles(0.0, 0.0, turn));
        let bend = |x: f64, z: f64, angle: f64| {
            root * Isometry3::from_parts(
                Translation3::new(x, 0.0, z),
                UnitQuaternion::from_euler_angles(0.0, angle, 0.0),
            )
        };
        let across = UnitQuaternion::from_euler_angles(std::f64::consts::FRAC_PI_2, 0.0, 0.0);
        let axle = Isometry3::from_parts(Translation3::identity(), across);
        parts.push((link([0.032, 0.010, 0.009])?, bend(0.075, -0.005, 0.5)));
        parts.push((link([0.028, 0.008, 0.004])?, bend(0.070, -0.014, 0.5)));
        parts.push((link([0.026, 0.009, 0.007])?, bend(0.105, -0.045, 1.35)));
        parts.push((link([0.024, 0.008, 0.004])?, bend(0.096, -0.047, 1.35)));
        parts.push((round(0.011, 0.012)?, bend(0.045, 0.008, 0.0) * axle));
        parts.push((round(0.009, 0.011)?, bend(0.101, -0.021, 0.0) * axle));
    }
    Ok(parts)
}
