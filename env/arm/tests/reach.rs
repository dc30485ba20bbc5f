//! What an arm reaches: postures that touch nothing, and the reasons where there is none.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_arm::reach::Reacher;
use graspbox_arm::{ArmBodies, ArmError, Inverse, Reach, ReachParams, Reason, Scene, Touched, reach};
use graspbox_hand::arm::assets::arm_asset;
use graspbox_hand::assets::asset;
use graspbox_hand::{Arm, Hand};
use graspbox_plan::Obstacle;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

struct Robot {
    arm: Arm,
    inverse: Inverse,
    bodies: ArmBodies,
    hand: Hand,
}

fn robot(arm: &str, hand: &str) -> Robot {
    let arm = arm_asset(arm).unwrap().read().unwrap();
    let inverse = Inverse::new(&arm);
    let bodies = ArmBodies::new(&arm, inverse.chain());
    Robot { arm, inverse, bodies, hand: asset(hand).unwrap().read().unwrap() }
}

impl Robot {
    fn reach(&self, poses: &[Isometry3<f64>], scene: &Scene, params: ReachParams) -> Result<Vec<Reach>, ArmError> {
        let reacher = Reacher { arm: &self.arm, inverse: &self.inverse, bodies: &self.bodies, scene, params };
        let asked: Vec<_> = poses.iter().map(|pose| (*pose, 0.0)).collect();
        reach(&reacher, &self.hand, &self.arm.flange_from_base_of(&self.hand), &asked)
    }
}

/// Poses of the grasp frame that look down, beside and before the base.
fn poses() -> Vec<Isometry3<f64>> {
    let turned = |x: f64, y: f64, z: f64, yaw: f64| {
        let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        Isometry3::from_parts(Translation3::new(x, y, z), turn * down)
    };
    let grid = (0..60).map(|i| (f64::from(i % 4), f64::from(i / 4 % 5), f64::from(i / 20)));
    grid.map(|(i, j, k)| turned(0.25 + 0.12 * i, 0.15 * j - 0.3, 0.06 + 0.12 * k, i + j)).collect()
}

fn scene(points: &[Point3<f64>], obstacles: Vec<(Arc<Obstacle>, Isometry3<f64>)>) -> Scene {
    Scene::new(Isometry3::identity(), points, obstacles, 0.005, 0.01).unwrap()
}

/// A box about a place.
fn block(x: f64, y: f64, z: f64, half: f64) -> (Arc<Obstacle>, Isometry3<f64>) {
    let obstacle = Arc::new(Obstacle::cuboid(&Vector3::repeat(half)).unwrap());
    (obstacle, Isometry3::translation(x, y, z))
}

#[test]
fn the_flange_carries_the_hand_to_the_pose() {
    for name in ["fr3", "ur5e", "xarm7"] {
        let robot = robot(name, "panda_gripper");
        let answers = robot.reach(&poses(), &scene(&[], Vec::new()), ReachParams::default()).unwrap();
        let reached = answers.iter().filter(|answer| answer.reason == Reason::Reached).count();
        assert!(reached > 40, "{name}: {reached} of 60");
        for (answer, pose) in answers.iter().zip(poses()) {
            assert_eq!(answer.reason == Reason::Reached, !answer.solutions.is_empty());
            for solution in &answer.solutions {
                let q = solution.values(robot.arm.axes.len());
                let flange = robot.arm.forward_kinematics(q).unwrap()[robot.arm.flange];
                let at = flange * robot.arm.flange_from_base_of(&robot.hand) * robot.hand.base_from_hand;
                assert!((at.translation.vector - pose.translation.vector).norm() < 2e-6);
                assert!(at.rotation.angle_to(&pose.rotation) < 2e-6);
            }
        }
    }
}

/// Points and a box of the same size block the same poses, and nothing that is far away blocks any.
#[test]
fn things_block_what_goes_through_them() {
    let robot = robot("fr3", "panda_gripper");
    let free = robot.reach(&poses(), &scene(&[], Vec::new()), ReachParams::default()).unwrap();
    let far = robot.reach(
        &poses(),
        &scene(&[Point3::new(3.0, 0.0, 0.3)], vec![block(-3.0, 0.0, 0.3, 0.2)]),
        ReachParams::default(),
    );
    let reasons = |answers: &[Reach]| answers.iter().map(|answer| answer.reason).collect::<Vec<_>>();
    assert_eq!(reasons(&far.unwrap()), reasons(&free));
    // Around the base: every posture goes through it.
    let walls = [[0.25, 0.0], [-0.25, 0.0], [0.0, 0.25], [0.0, -0.25]];
    let boxes: Vec<_> = walls.iter().map(|[x, y]| block(*x, *y, 0.6, 0.2)).collect();
    let cell = |number: i32| 0.02 * f64::from(number - 10);
    let filled = |wall: &[f64; 2]| {
        let [x, y] = *wall;
        (0..21 * 21 * 21).map(move |i| Point3::new(x + cell(i % 21), y + cell(i / 21 % 21), 0.6 + cell(i / 441)))
    };
    let points: Vec<Point3<f64>> = walls.iter().flat_map(filled).collect();
    for (by, scene) in [(Touched::Obstacle(0), scene(&[], boxes)), (Touched::Points, scene(&points, Vec::new()))] {
        let answers = robot.reach(&poses(), &scene, ReachParams::default()).unwrap();
        let blocked = answers.iter().zip(&free).filter(|(_, free)| free.reason == Reason::Reached);
        for (answer, _) in blocked {
            match answer.reason {
                Reason::ArmTouches(_, Touched::Obstacle(_)) => assert!(matches!(by, Touched::Obstacle(_))),
                Reason::ArmTouches(_, touched) => assert!(touched == by || touched == Touched::Table),
                Reason::Reached => panic!("through {by:?}"),
                _ => {}
            }
        }
    }
}

#[test]
fn a_low_flange_touches_the_table() {
    let robot = robot("fr3", "panda_gripper");
    let mut low = poses();
    low.iter_mut().for_each(|pose| pose.translation.z = -0.25);
    let answers = robot.reach(&low, &scene(&[], Vec::new()), ReachParams::default()).unwrap();
    assert!(answers.iter().any(|answer| matches!(answer.reason, Reason::ArmTouches(_, Touched::Table))));
    assert!(answers.iter().all(|answer| answer.reason != Reason::Reached));
}

#[test]
fn bases_hands_and_settings_are_checked() {
    let under = Scene::new(Isometry3::translation(0.0, 0.0, -0.2), &[], Vec::new(), 0.005, 0.01);
    assert!(under.unwrap_err().to_string().contains("at z = -0.200 m, under the table"));
    let scene = scene(&[], Vec::new());
    let heavy = robot("so101", "leap").reach(&poses(), &scene, ReachParams::default()).unwrap_err();
    assert!(heavy.to_string().contains("hand \"leap\" weighs 0.75 kg, but arm \"so101\" carries 0.20 kg"), "{heavy}");
    let params = ReachParams { solutions: 0, ..ReachParams::default() };
    let wrong = robot("fr3", "leap").reach(&poses(), &scene, params).unwrap_err();
    assert_eq!(wrong.to_string(), "solutions is 0; it must be 1 to 64");
}
