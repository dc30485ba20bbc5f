//! Paths of an arm: from the start to a grasp and on to a place; what keeps them from being found.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_arm::path::{Cause, Failure, Phase, Piece};
use graspbox_arm::{ArmBodies, Inverse, Mover, PathParams, Robot, Scene, Task, Thing, Touched, With, path};
use graspbox_hand::arm::assets::arm_asset;
use graspbox_hand::assets::asset;
use graspbox_hand::{Arm, Hand};
use graspbox_mesh::convex_hull;
use graspbox_plan::Obstacle;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

struct Parts {
    arm: Arm,
    inverse: Inverse,
    bodies: ArmBodies,
    hand: Hand,
}

impl Parts {
    fn new(arm: &str) -> Self {
        let arm = arm_asset(arm).unwrap().read().unwrap();
        let inverse = Inverse::new(&arm);
        let bodies = ArmBodies::new(&arm, inverse.chain());
        Self { arm, inverse, bodies, hand: asset("panda_gripper").unwrap().read().unwrap() }
    }

    fn task(&self, thing: Option<Thing>) -> Task {
        let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let world_from_hand = Isometry3::from_parts(Translation3::new(0.5, 0.0, 0.13), down);
        let start = self.inverse.positions_of(&self.arm.home());
        Task { start, world_from_hand, preshape: self.hand.preshape_limits()[1], thing }
    }

    fn path(&self, walls: Vec<(Arc<Obstacle>, Isometry3<f64>)>, task: &Task) -> Result<Vec<Piece>, Failure> {
        let scene = Scene::new(Isometry3::identity(), &[], walls, 0.005, 0.01).unwrap();
        self.path_in(&scene, task, &PathParams::default())
    }

    fn path_in(&self, scene: &Scene, task: &Task, params: &PathParams) -> Result<Vec<Piece>, Failure> {
        let robot = Robot {
            arm: &self.arm,
            inverse: &self.inverse,
            bodies: &self.bodies,
            hand: &self.hand,
            flange_from_base: self.arm.flange_from_base_of(&self.hand),
            accelerations: [5.0; 12],
        };
        path(&robot, scene, task, params).unwrap().map(|found| found.pieces)
    }
}

fn wall(at: [f64; 3], half: [f64; 3]) -> (Arc<Obstacle>, Isometry3<f64>) {
    (Arc::new(Obstacle::cuboid(&Vector3::from(half)).unwrap()), Isometry3::from(Vector3::from(at)))
}

/// A brick of 4 x 12 x 10 cm on the table, between the fingers, which close along x.
fn brick(place: Option<[f64; 2]>) -> Thing {
    let corner = |i: usize| Point3::new([-0.02, 0.02][i & 1], [-0.06, 0.06][i >> 1 & 1], [0.0, 0.1][i >> 2]);
    let mesh = convex_hull(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
    let obstacle = Arc::new(Obstacle::new(&mesh, std::slice::from_ref(&mesh)).unwrap());
    let at = |x: f64, y: f64| Isometry3::translation(x, y, 0.0);
    Thing { obstacle, world_from_thing: at(0.5, 0.0), place: place.map(|[x, y]| at(x, y)) }
}

#[test]
fn a_thing_is_grasped_lifted_and_placed() {
    for name in ["fr3", "ur5e", "xarm7"] {
        let parts = Parts::new(name);
        let pieces = parts.path(Vec::new(), &parts.task(Some(brick(Some([0.4, 0.3]))))).unwrap();
        let phases: Vec<Phase> = pieces.iter().map(|piece| piece.phase).collect();
        let all = [Phase::Reach, Phase::Approach, Phase::Lift, Phase::Carry, Phase::Lower, Phase::Retreat];
        assert_eq!(phases, all, "{name}");
        for pair in pieces.windows(2) {
            assert_eq!(pair[0].postures.last(), pair[1].postures.first(), "{name}: a piece begins where one ended");
        }
        assert_eq!(pieces[0].postures[0], parts.task(None).start);
        // The lift is straight up, by a height of which each posture has its share.
        let lift = &pieces[2];
        let chain = parts.inverse.chain();
        let flange = |index: usize| chain.frames(&lift.postures[index]).flange.shift;
        for (index, length) in lift.lengths.as_ref().unwrap().iter().enumerate() {
            assert!((flange(index) - flange(0) - Vector3::z() * *length).norm() < 1e-5, "{name}");
        }
    }
}

/// A bug here: an order that depends on an address, a hash or a thread.
#[test]
fn the_same_seed_gives_the_same_path() {
    let parts = Parts::new("fr3");
    let task = parts.task(Some(brick(Some([0.0, 0.5]))));
    // A wall between the thing and its place.
    let scene = Scene::new(Isometry3::identity(), &[], vec![wall([0.45, 0.25, 0.3], [0.25, 0.01, 0.3])], 0.005, 0.01);
    let (scene, params) = (scene.unwrap(), PathParams::default());
    let postures = |seed: u64| {
        let pieces = parts.path_in(&scene, &task, &PathParams { seed, ..params }).unwrap();
        pieces.into_iter().flat_map(|piece| piece.postures).collect::<Vec<_>>()
    };
    let first = postures(0);
    assert_eq!(first, postures(0));
    assert_ne!(first, postures(1), "the way around the wall is sampled");
}

#[test]
fn what_is_in_the_way_is_named() {
    let parts = Parts::new("fr3");
    let failure = |walls, task: &Task| parts.path(walls, task).unwrap_err();
    let free = parts.task(Some(brick(None)));
    // A wall through the elbow at home.
    let start = failure(vec![wall([0.0, 0.0, 0.6], [0.2, 0.2, 0.05])], &free);
    assert_eq!(start.phase, Phase::Reach);
    assert!(matches!(start.cause, Cause::Touches((Mover::Arm(_), With::World(Touched::Obstacle(0))))), "{start:?}");
    // A lid over the thing, under the hand where the approach begins.
    let lid = failure(vec![wall([0.5, 0.0, 0.18], [0.04, 0.04, 0.005])], &free);
    assert_eq!(lid.phase, Phase::Approach);
    assert_eq!(lid.cause, Cause::Touches((Mover::Hand, With::World(Touched::Obstacle(0)))));
    // A board over an end of the thing, beside the hand: only the lifted thing meets it.
    let board = failure(vec![wall([0.5, 0.055, 0.145], [0.02, 0.005, 0.005])], &free);
    assert_eq!(board.phase, Phase::Lift);
    assert_eq!(board.cause, Cause::Touches((Mover::Thing, With::World(Touched::Obstacle(0)))));
    // A place in a wall, and one under the table.
    let there = parts.task(Some(brick(Some([0.4, 0.3]))));
    let place = failure(vec![wall([0.4, 0.3, 0.05], [0.03, 0.03, 0.05])], &there);
    assert_eq!(place.cause, Cause::Touches((Mover::Thing, With::World(Touched::Obstacle(0)))));
    let mut sunk = there.clone();
    sunk.thing.as_mut().unwrap().place = Some(Isometry3::translation(0.4, 0.3, -0.02));
    assert_eq!(failure(Vec::new(), &sunk).cause, Cause::Touches((Mover::Thing, With::World(Touched::Table))));
    // A room without a door.
    let sides = [[0.7, 0.0], [0.3, 0.0], [0.5, 0.2], [0.5, -0.2]];
    let room = sides
        .map(|[x, y]| if y == 0.0 { wall([x, y, 0.5], [0.01, 0.2, 0.5]) } else { wall([x, y, 0.5], [0.2, 0.01, 0.5]) });
    let closed = failure(room.to_vec(), &free);
    assert!(matches!(closed.cause, Cause::Touches(_) | Cause::NoWay(_)), "{closed:?}");
    let mut beyond = free.clone();
    beyond.start[3] = 1.0;
    assert_eq!(failure(Vec::new(), &beyond).cause, Cause::Beyond(3));
}

/// Where the way around is narrow, motions of the path are looked at again, a thousand postures each.
#[test]
fn a_way_around_a_wall_is_free() {
    let parts = Parts::new("fr3");
    let walls = vec![wall([0.45, 0.25, 0.3], [0.25, 0.01, 0.3]), wall([0.35, -0.25, 0.4], [0.2, 0.02, 0.02])];
    let task = parts.task(Some(brick(Some([0.0, 0.5]))));
    let pieces = parts.path(walls.clone(), &task).unwrap();
    let carry = &pieces[3];
    assert!(carry.postures.len() > 2, "the straight motion is blocked");
    let chain = parts.inverse.chain();
    for pair in carry.postures.windows(2) {
        for step in 0..=1000 {
            let share = f64::from(step) / 1000.0;
            let at: [f64; 12] = std::array::from_fn(|axis| pair[0][axis] + share * (pair[1][axis] - pair[0][axis]));
            // The flange, which is inside the last link, is farther than half of its clearance from all walls.
            let flange = chain.frames(&at).flange.shift;
            for (wall, pose) in &walls {
                assert!(!wall.is_near(&(flange - pose.translation.vector), 0.002));
            }
        }
    }
}
