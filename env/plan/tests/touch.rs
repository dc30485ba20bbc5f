//! Touches of neighbours: how deep they are, what gives way, and how they lower the score.

#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_hand::assets::asset;
use graspbox_hand::{Hand, Shape};
use graspbox_mesh::{TriMesh, convex_hull};
use graspbox_plan::{
    CollisionScene, Feasibility, Neighbour, Obstacle, OpenHand, Plan, PlanObject, PlanParams, Touch, plan,
};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

fn cuboid(half: [f64; 3]) -> TriMesh {
    let sign = |i: usize, axis: usize| if i >> axis & 1 == 1 { 1.0 } else { -1.0 };
    let corner = |i| Point3::from(Vector3::from_fn(|axis, _| sign(i, axis) * half[axis]));
    convex_hull(&(0..8).map(corner).collect::<Vec<_>>()).unwrap()
}

fn hand() -> Hand {
    asset("panda_gripper").unwrap().read().unwrap()
}

/// A free block.
fn block(half: [f64; 3], at: [f64; 3], mass: f64) -> Neighbour {
    let mesh = cuboid(half);
    Neighbour {
        obstacle: Arc::new(Obstacle::new(&mesh, std::slice::from_ref(&mesh)).unwrap()),
        world_from_obstacle: Isometry3::translation(at[0], at[1], at[2]),
        mass: Some(mass),
    }
}

/// Touch of the hand at `world_from_hand`, 0.1 m of approach, of neighbours of an object far away.
fn touch(neighbours: Vec<Neighbour>, world_from_hand: &Isometry3<f64>) -> Option<Touch> {
    let away = Isometry3::translation(2.0, 0.0, 0.1);
    let object = Arc::new(Obstacle::new(&cuboid([0.02; 3]), &[]).unwrap());
    let scene = CollisionScene::among(object, &away, neighbours.into());
    let (hand, hand_pose) = (hand(), away.inverse() * world_from_hand);
    scene.touch(&OpenHand::new(&hand, hand.preshape_limits()[0], 0.0, 0.1).unwrap(), &hand_pose)
}

/// Reach of the open hand along its z, metres.
fn reach() -> f64 {
    let hand = hand();
    let placed = hand.shapes_at(&hand.open_configuration(hand.preshape_limits()[0])).unwrap();
    let ends = placed.iter().map(|placed| {
        let along = placed.hand_from_shape.rotation.inverse() * Vector3::z();
        let half = match placed.collider.shape {
            Shape::Cuboid(half) => along.abs().dot(&half),
            Shape::Sphere { radius } => radius,
            Shape::Cylinder { radius, half_length } => along.xy().norm() * radius + along.z.abs() * half_length,
        };
        placed.hand_from_shape.translation.z + half
    });
    ends.fold(f64::NEG_INFINITY, f64::max)
}

fn turned(angle: f64, at: [f64; 3]) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
    Isometry3::from_parts(at.into(), turn)
}

/// A bug here: a depth of the wrong shapes, or in the wrong frame.
#[test]
fn a_hand_from_above_presses_what_it_lands_on() {
    let down = turned(PI, [0.0, 0.0, 0.1 + reach() - 0.003]);
    let plate = |mass| vec![block([0.2, 0.2, 0.05], [0.0, 0.0, 0.05], mass)];
    let found = touch(plate(0.3), &down).unwrap();
    assert!((found.depth - 0.003).abs() < 1e-6 && (found.press - found.depth).abs() < 1e-6, "{found:?}");
    assert_eq!(touch(vec![], &down), Some(Touch::default()));
    assert_eq!(touch(plate(0.3), &turned(PI, [0.0, 0.0, 0.11 + reach()])), Some(Touch::default()), "a free pose");
    assert_eq!(touch(plate(7.0), &down), None, "too heavy");
    let fixed = vec![Neighbour { mass: None, ..plate(0.3).remove(0) }];
    assert_eq!(touch(fixed, &down), None, "a wall");
    let bare = Arc::new(Obstacle::new(&cuboid([0.2, 0.2, 0.05]), &[]).unwrap());
    let bare = vec![Neighbour { obstacle: bare, ..plate(0.3).remove(0) }];
    assert_eq!(touch(bare, &down), None, "no part to measure by");
    let above = vec![block([0.2, 0.2, 0.01], [0.0, 0.0, 0.2 + reach()], 0.3)];
    assert_eq!(touch(above, &down), None, "it is where the approach begins");
}

/// A bug here: a push sideways, or a lifting one, that counts as pressing.
#[test]
fn a_push_sideways_presses_nothing() {
    let level = turned(FRAC_PI_2, [-reach() + 0.004, 0.0, 0.1]);
    let post = || block([0.02, 0.2, 0.1], [0.02, 0.0, 0.1], 0.3);
    let found = touch(vec![post()], &level).unwrap();
    assert!((found.depth - 0.004).abs() < 1e-6 && found.press < 1e-6, "{found:?}");
    // The deepest of two counts, and a wall beside them refuses all.
    let near = block([0.02, 0.2, 0.1], [0.018, 0.0, 0.2], 0.3);
    let both = touch(vec![post(), near.clone()], &level).unwrap();
    assert!((both.depth - 0.006).abs() < 1e-6, "{both:?}");
    assert_eq!(touch(vec![post(), Neighbour { mass: None, ..near }], &level), None);
    let up = turned(0.0, [0.0, 0.0, 0.3 - reach() + 0.003]);
    let lifted = touch(vec![block([0.2, 0.2, 0.05], [0.0, 0.0, 0.35], 0.3)], &up).unwrap();
    assert!((lifted.depth - 0.003).abs() < 1e-6 && lifted.press == 0.0, "{lifted:?}");
}

/// A plan for a low box between two rods that lie close beside it.
fn among_rods(params: &PlanParams) -> Plan {
    let mesh = cuboid([0.015, 0.02, 0.02]);
    let obstacle = Arc::new(Obstacle::new(&mesh, &[]).unwrap());
    let rods = [-1.0, 1.0].map(|side| block([0.01, 0.05, 0.01], [0.052 * side, 0.0, 0.01], 0.05));
    let object = PlanObject {
        mesh: &mesh,
        obstacle: &obstacle,
        center_of_mass: Point3::origin(),
        world_from_object: Isometry3::translation(0.0, 0.0, 0.02),
        neighbours: rods.into(),
    };
    plan(&object, &hand(), params).unwrap()
}

/// A bug here: a touch that is feasible where none is allowed, or that costs nothing.
#[test]
fn touches_are_refused_by_default_and_cost_score_where_allowed() {
    let touching = |plan: &Plan| plan.candidates.iter().filter(|c| c.touch != Touch::default()).count();
    let strict = among_rods(&PlanParams::default());
    assert_eq!(touching(&strict), 0);
    assert!(strict.candidates.iter().any(|c| c.feasibility == Feasibility::HitsNeighbour));
    let allowed = |press_penalty| among_rods(&PlanParams { max_press: 0.005, press_penalty, ..PlanParams::default() });
    let (free, costly) = (allowed(0.0), allowed(1e5));
    assert!(free.feasible > strict.feasible && free.feasible == costly.feasible);
    assert!(touching(&free) >= free.feasible - strict.feasible);
    for candidate in free.candidates.iter() {
        assert!(candidate.feasible() || candidate.touch == Touch::default());
        assert!((0.0..=0.005).contains(&candidate.touch.press) && candidate.touch.press <= candidate.touch.depth);
    }
    let pressing = free.ranked().iter().filter(|c| c.touch.press > 1e-3).collect::<Vec<_>>();
    assert!(!pressing.is_empty());
    for cheap in pressing {
        let same = costly.ranked().iter().find(|c| c.grasp == cheap.grasp).unwrap();
        // Scores also fall by 0.03 for every better pose of the same face.
        let off = cheap.score - same.score - 1e5 * cheap.touch.press;
        assert!(off.abs() <= 0.03 * free.feasible as f64, "{off}: {cheap:?} {same:?}");
    }
}

#[test]
fn wrong_limits_are_named() {
    let mesh = cuboid([0.02; 3]);
    let obstacle = Arc::new(Obstacle::new(&mesh, &[]).unwrap());
    let object = PlanObject {
        mesh: &mesh,
        obstacle: &obstacle,
        center_of_mass: Point3::origin(),
        world_from_object: Isometry3::translation(0.0, 0.0, 0.02),
        neighbours: Arc::default(),
    };
    let bad = |params: PlanParams| plan(&object, &hand(), &params).unwrap_err().to_string();
    let deep = bad(PlanParams { max_press: 0.06, ..PlanParams::default() });
    assert!(deep.contains("max_press") && deep.contains("0.06"), "{deep}");
    let reward = bad(PlanParams { press_penalty: -1.0, ..PlanParams::default() });
    assert!(reward.contains("press_penalty") && reward.contains("-1"), "{reward}");
}
