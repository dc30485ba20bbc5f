//! The same bits on any number of threads, and after any other images.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::{Dice, instance, random_camera, random_mesh, table};
use graspbox_render::{Channels, Detail, Instance, Job, Light, Model, Renderer, render_batch};
use nalgebra::Isometry3;

#[test]
fn batches_are_the_same_bits_on_any_number_of_threads() {
    let mut dice = Dice::new(5);
    let models: Vec<Model> = (0..6).map(|_| Model::new(&random_mesh(&mut dice)).unwrap()).collect();
    let ground = Model::new(&table()).unwrap();
    let scenes: Vec<Vec<Instance>> = (0..12)
        .map(|_| {
            let parts = (0..4).map(|k| instance(&models[dice.below(6)], dice.pose(0.2), 1 + k));
            let mut scene: Vec<_> = parts.collect();
            scene.push(instance(&ground, Isometry3::translation(0.0, 0.0, -0.2), 9));
            scene
        })
        .collect();
    let all = Channels { rgb: true, segmentation: true };
    let job = |i: usize| Job {
        instances: &scenes[i % 12],
        camera: random_camera(&mut Dice::new(i as u64), 60),
        light: Light::default(),
        channels: if i.is_multiple_of(3) { Channels::default() } else { all },
    };
    let jobs: Vec<_> = (0..48).map(job).collect();
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render_batch(&jobs, Detail::Auto).unwrap())
    };
    let frames = on(1);
    assert!(frames.iter().any(|f| f.rgb.iter().any(|x| *x != f.rgb[0])));
    for threads in [2, 3, 7] {
        assert!(on(threads) == frames, "{threads} threads");
    }
    for (job, frame) in jobs.iter().zip(&frames) {
        let alone = Renderer::new(Detail::Auto).render(job.instances, &job.camera, &job.light, job.channels);
        assert!(alone.unwrap() == *frame);
    }
    let mut used = Renderer::new(Detail::Auto);
    let pictures: Vec<_> =
        [7, 8, 7].map(|i| used.picture(jobs[i].instances, &jobs[i].camera, &jobs[i].light, 2).unwrap()).into();
    assert!(pictures[0] == pictures[2] && pictures[0] != pictures[1]);
}

#[test]
fn one_sample_a_pixel_is_the_plain_image() {
    let model = Model::new(&table()).unwrap();
    let scene = [instance(&model, Isometry3::identity(), 1)];
    let camera = random_camera(&mut Dice::new(11), 50);
    let mut renderer = Renderer::new(Detail::Full);
    let rgb = Channels { rgb: true, segmentation: false };
    let frame = renderer.render(&scene, &camera, &Light::default(), rgb).unwrap();
    assert_eq!(renderer.picture(&scene, &camera, &Light::default(), 1).unwrap(), frame.rgb);
}
