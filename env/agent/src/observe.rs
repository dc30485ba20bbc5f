//! Fills observations from an episode.

use crate::agent_episode::AgentEpisode;
use crate::env_spec::EnvSpec;
use crate::observation_spec::{Observation, Sheet};
use nalgebra::{Isometry3, Point3, UnitQuaternion};

/// Appends every observation of `spec`, in order.
pub fn observe(play: &AgentEpisode, spec: &EnvSpec, out: &mut Vec<f32>) {
    for (observation, fields) in &spec.tables {
        let mut sheet = Sheet::new(fields, out);
        match observation {
            Observation::Proprio => proprio(play, &mut sheet),
            Observation::Tactile => sheet.put(play.episode().world().tactile().force),
            Observation::State if spec.config.control.decides() => resting(play, &mut sheet),
            Observation::State => {
                proprio(play, &mut sheet);
                privileged(play, spec, &mut sheet);
                sheet.put(play.last_action().iter().map(|a| f64::from(*a)));
            }
        }
    }
}

/// The first two columns of the rotation matrix.
fn six(rotation: &UnitQuaternion<f64>) -> [f64; 6] {
    let m = rotation.to_rotation_matrix();
    std::array::from_fn(|i| m[(i % 3, i / 3)])
}

fn place(pose: &Isometry3<f64>) -> [f64; 3] {
    pose.translation.vector.into()
}

fn proprio(play: &AgentEpisode, sheet: &mut Sheet<'_>) {
    let (arm, world) = (play.arm(), play.episode().world());
    let fingers: Vec<_> = (0..world.hand().fingers.len()).map(|i| world.finger(i)).collect();
    let (linear, angular) = arm.velocity();
    sheet.put(place(arm.believed()));
    sheet.put(six(&arm.believed().rotation));
    sheet.put(linear.iter().copied());
    sheet.put(angular.iter().copied());
    sheet.put(fingers.iter().map(|f| f.proximal));
    sheet.put(fingers.iter().map(|f| f.spool));
    sheet.put(world.hand().fingers.iter().map(|f| world.motors()[f.motor].velocity));
    sheet.put(fingers.iter().map(|f| f.tension));
    sheet.one(world.preshape());
}

fn resting(play: &AgentEpisode, sheet: &mut Sheet<'_>) {
    let world = play.episode().world();
    let table = world.world_from_object();
    let point = |p: &Point3<f64>| <[f64; 3]>::from((table * p).coords);
    sheet.put(place(&table));
    sheet.put(six(&table.rotation));
    sheet.put(point(&play.episode().scene().center_of_mass()));
    sheet.put(point(&play.bounds_center()));
    sheet.put(play.half_extents().iter().copied());
    sheet.one(world.object_mass() * play.mass_factor());
}

fn privileged(play: &AgentEpisode, spec: &EnvSpec, sheet: &mut Sheet<'_>) {
    let episode = play.episode();
    let world = episode.world();
    let fingers = world.hand().fingers.len();
    let (hand, table) = (world.hand_from_object(), world.world_from_object());
    let (linear, angular) = world.object_velocity_in_hand();
    let point = |p: &Point3<f64>| <[f64; 3]>::from((hand * p).coords);
    sheet.put((0..fingers).map(|i| world.finger(i).distal));
    sheet.put(place(&table));
    sheet.put(six(&table.rotation));
    sheet.put(place(&hand));
    sheet.put(six(&hand.rotation));
    sheet.put(linear.iter().copied());
    sheet.put(angular.iter().copied());
    sheet.put(point(&episode.scene().center_of_mass()));
    sheet.put(point(&play.bounds_center()));
    sheet.put(play.half_extents().iter().copied());
    sheet.one(world.object_mass() * play.mass_factor());
    let mut flags = vec![0.0; 2 * fingers + 1];
    for link in world.contacts().links {
        flags[spec.flags[link]] = 1.0;
    }
    sheet.put(flags);
    let verdict = episode.verdict();
    sheet.one(if episode.judge().on_scenery() { 1.0 } else { 0.0 });
    sheet.one(verdict.lift);
    sheet.one(episode.judge().held_share(world));
    sheet.one(verdict.shift);
    sheet.one(verdict.turn);
    sheet.one(play.potentials().closure);
}
