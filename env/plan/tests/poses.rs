//! Filtered poses do not collide, by an independent test; candidates follow the spec; plans repeat bit by bit.
#![allow(clippy::unwrap_used, clippy::panic)]

mod common;

use common::{cuboids, hammer, lathe, random_motion, rng, surface_points};
use graspbox_hand::assets::asset;
use graspbox_hand::{Hand, Shape};
use graspbox_mesh::{Mass, OutOfRange, TriMesh, default_pose, mass_properties};
use graspbox_plan::{
    CollisionScene, DecomposeParams, Feasibility, Neighbour, Obstacle, OpenHand, Plan, PlanError, PlanObject,
    PlanParams, PoseParams, Variation, plan,
};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

fn center_of_mass(mesh: &TriMesh) -> Point3<f64> {
    mass_properties(mesh, Mass::Kilograms(0.3)).unwrap().center_of_mass
}

fn make(mesh: &TriMesh, world_from_object: Isometry3<f64>, params: &PlanParams) -> Plan {
    let obstacle = Arc::new(Obstacle::new(mesh, &[]).unwrap());
    let object = PlanObject {
        mesh,
        obstacle: &obstacle,
        center_of_mass: center_of_mass(mesh),
        world_from_object,
        neighbours: Arc::default(),
    };
    plan(&object, Hand::reflex().unwrap(), params).unwrap()
}

/// A mesh with convex parts, at the pose of its file.
fn on_table(mesh: &TriMesh, parts: &[TriMesh]) -> CollisionScene {
    CollisionScene::new(Arc::new(Obstacle::new(mesh, parts).unwrap()), &Isometry3::identity())
}

fn bottle() -> TriMesh {
    lathe(&[(0.03, 0.0), (0.035, 0.1), (0.012, 0.14), (0.013, 0.19)], 32)
}

/// Depth of `p` inside a hand shape, metres; negative outside.
fn depth(shape: &Shape, shape_from_hand: &Isometry3<f64>, p: &Point3<f64>) -> f64 {
    let q = shape_from_hand * p;
    match shape {
        Shape::Cuboid(half) => (half - q.coords.abs()).min(),
        Shape::Sphere { radius } => radius - q.coords.norm(),
        Shape::Cylinder { radius, half_length } => (radius - q.coords.xy().norm()).min(half_length - q.z.abs()),
    }
}

/// The deepest point of the object's surface in the open hand, and the lowest corner of the hand over the table.
fn probe(surface: &[Point3<f64>], hand: &Hand, preshape: f64, world_from_hand: &Isometry3<f64>) -> (f64, f64) {
    let (mut deepest, mut lowest) = (f64::NEG_INFINITY, f64::INFINITY);
    for placed in hand.shapes_at(&hand.open_configuration(preshape)).unwrap() {
        let world_from_shape = world_from_hand * placed.hand_from_shape;
        let inverse = world_from_shape.inverse();
        let deep = surface.iter().map(|p| depth(&placed.collider.shape, &inverse, p)).fold(f64::NEG_INFINITY, f64::max);
        deepest = deepest.max(deep);
        if let Shape::Cuboid(half) = placed.collider.shape {
            let reach = (world_from_shape.rotation.inverse() * Vector3::z()).abs().dot(&half);
            lowest = lowest.min(world_from_shape.translation.z - reach);
        }
    }
    (deepest, lowest)
}

#[test]
fn feasible_poses_do_not_collide_at_the_pose_or_on_the_way() {
    let hand = Hand::reflex().unwrap();
    for (index, mesh) in [hammer(), bottle(), cuboids(&[([0.0; 3], [0.03, 0.03, 0.03])])].iter().enumerate() {
        let world_from_object = default_pose(mesh);
        let plan = make(mesh, world_from_object, &PlanParams::default());
        assert!(plan.feasible > 20, "shape {index}: {} of {}", plan.feasible, plan.candidates.len());
        let surface: Vec<_> = surface_points(mesh, 3000, 3).iter().map(|p| world_from_object * p).collect();
        for candidate in plan.ranked().iter().step_by(7) {
            for step in 0..=10 {
                let back = Translation3::new(0.0, 0.0, -0.01 * f64::from(step));
                let world_from_hand = world_from_object * candidate.grasp.object_from_hand * back;
                let (deepest, lowest) = probe(&surface, hand, candidate.grasp.preshape, &world_from_hand);
                assert!(deepest < 0.0 && lowest > 0.0, "shape {index}, {step} cm back: {deepest}, {lowest}");
            }
        }
    }
}

#[test]
fn poses_that_collide_are_filtered() {
    let hand = Hand::reflex().unwrap();
    let mesh = cuboids(&[([0.0, 0.0, 0.1], [0.03, 0.03, 0.1])]);
    let scene = on_table(&mesh, &[]);
    let open = OpenHand::new(hand, 0.0, 0.001, 0.1).unwrap();
    let down = |z| {
        let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        Isometry3::from_parts(Translation3::new(0.0, 0.0, z), over)
    };
    assert_eq!(scene.check(&open, &down(0.205)), Feasibility::Feasible);
    assert_eq!(scene.check(&open, &down(0.195)), Feasibility::HitsObject);
    // From below: the hand starts under the table.
    assert_eq!(scene.check(&open, &Isometry3::translation(0.2, 0.0, 0.1)), Feasibility::HitsTable);
    // A shelf above the pose collides on the approach only.
    let shelf = cuboids(&[([0.0, 0.0, 0.1], [0.03, 0.03, 0.1]), ([0.0, 0.0, 0.36], [0.02, 0.02, 0.01])]);
    let scene = on_table(&shelf, &[]);
    assert_eq!(scene.check(&open, &down(0.205)), Feasibility::HitsObjectOnApproach);
    assert!(!scene.collides(&open, &down(0.205)));
}

#[test]
fn a_hand_inside_the_object_collides() {
    let hand = Hand::reflex().unwrap();
    // A box so large that no wall is near the hand.
    let mesh = cuboids(&[([0.0, 0.0, 1.0], [1.0, 1.0, 1.0])]);
    let scene = on_table(&mesh, &[]);
    let open = OpenHand::new(hand, 0.5, 0.001, 0.1).unwrap();
    assert_eq!(scene.check(&open, &Isometry3::translation(0.1, 0.2, 1.0)), Feasibility::HitsObject);
}

#[test]
fn neighbours_are_in_the_way_and_stay_where_they_are() {
    let hand = Hand::reflex().unwrap();
    let mesh = cuboids(&[([0.0, 0.0, 0.1], [0.03, 0.03, 0.1])]);
    let open = OpenHand::new(hand, 0.0, 0.001, 0.1).unwrap();
    let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let down = Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.205), over);
    let obstacle = Arc::new(Obstacle::new(&mesh, &[]).unwrap());
    let wall = |x: f64, z: f64| Neighbour {
        obstacle: Arc::new(Obstacle::cuboid(&Vector3::new(0.005, 0.2, 0.01)).unwrap()),
        world_from_obstacle: Isometry3::translation(x, 0.0, z),
        mass: None,
    };
    let among = |walls: Vec<Neighbour>| {
        let world_from_object = Isometry3::translation(0.0, 0.0, 0.0);
        CollisionScene::among(Arc::clone(&obstacle), &world_from_object, walls.into())
    };
    assert_eq!(among(vec![]).check(&open, &down), Feasibility::Feasible);
    let near = among(vec![wall(0.6, 0.25), wall(0.0, 0.25)]);
    assert_eq!(near.check(&open, &down), Feasibility::HitsNeighbour);
    assert!(near.collides(&open, &down));
    let above = among(vec![wall(0.0, 0.36)]);
    assert_eq!(above.check(&open, &down), Feasibility::HitsNeighbour);
    assert!(!above.collides(&open, &down), "it is in the way on the approach only");
    // The object and the hand move away; the wall stays.
    let moved = Isometry3::translation(0.0, 0.0, 0.0) * Translation3::new(0.5, 0.0, 0.0);
    assert_eq!(among(vec![wall(0.0, 0.25)]).at(&moved).check(&open, &down), Feasibility::Feasible);
    assert!(Obstacle::cuboid(&Vector3::new(0.1, 0.0, 0.1)).is_err());
}

#[test]
fn convex_parts_count_as_obstacles() {
    let hand = Hand::reflex().unwrap();
    let mesh = cuboids(&[([0.0, 0.0, 0.1], [0.03, 0.03, 0.1])]);
    let fat = cuboids(&[([0.0, 0.0, 0.11], [0.03, 0.03, 0.11])]);
    let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let pose = Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.21), over);
    let open = OpenHand::new(hand, 0.0, 0.001, 0.1).unwrap();
    let bare = on_table(&mesh, &[]);
    let with_parts = on_table(&mesh, &[fat]);
    assert_eq!(bare.check(&open, &pose), Feasibility::Feasible);
    assert_eq!(with_parts.check(&open, &pose), Feasibility::HitsObject);
}

#[test]
fn base_poses_stand_5_mm_outside_their_box_with_y_along_the_long_side() {
    let mesh = cuboids(&[([0.0, 0.0, 0.05], [0.1, 0.03, 0.05])]);
    let poses = PoseParams { variation: Variation::Grid, ..PoseParams::default() };
    let params =
        PlanParams { poses, decompose: DecomposeParams { max_boxes: 1, ..Default::default() }, ..Default::default() };
    let plan = make(&mesh, Isometry3::identity(), &params);
    let from_top: Vec<_> = plan
        .candidates
        .iter()
        .filter(|c| {
            let z = c.grasp.object_from_hand * Vector3::z();
            let y = c.grasp.object_from_hand * Vector3::y();
            z.z < -0.9999 && y.x.abs() > 0.9999 && c.grasp.preshape == 0.0
        })
        .collect();
    // Five shifts, both turns about hand z; the tilt is the other half of the grid.
    assert_eq!(from_top.len(), 10);
    for candidate in &from_top {
        let at = candidate.grasp.object_from_hand.translation.vector;
        assert!((at.z - 0.105).abs() < 1e-6 && at.y.abs() < 1e-6, "{at}");
        assert!((at.x / 0.04 - (at.x / 0.04).round()).abs() < 1e-4, "shifts are fifths of the long side: {at}");
    }
    assert!(from_top.iter().any(|c| (c.grasp.object_from_hand * Vector3::y()).x < 0.0));
    let faces: std::collections::BTreeSet<_> = plan.candidates.iter().map(|c| c.face).collect();
    assert_eq!(faces.len(), 6, "every face has poses");
}

/// The palm is up to 65 mm above a plate, and 115 mm where the grasp centre is 110 mm instead of 60 mm in front of it.
#[test]
fn a_hand_with_longer_fingers_grasps_from_farther_away() {
    let mesh = cuboids(&[([0.0, 0.0, 0.005], [0.05, 0.02, 0.005])]);
    let obstacle = Arc::new(Obstacle::new(&mesh, &[]).unwrap());
    let object = PlanObject {
        mesh: &mesh,
        obstacle: &obstacle,
        center_of_mass: Point3::origin(),
        world_from_object: Isometry3::identity(),
        neighbours: Arc::default(),
    };
    let params = PlanParams { poses: PoseParams { pairs: 0, ..PoseParams::default() }, ..PlanParams::default() };
    for (name, highest) in [("reflex", 0.075), ("panda_gripper", 0.075), ("leap", 0.125)] {
        let plan = plan(&object, &asset(name).unwrap().read().unwrap(), &params).unwrap();
        let from_above = plan.candidates.iter().map(|candidate| candidate.grasp.object_from_hand);
        let heights = from_above.filter(|pose| (pose * Vector3::z()).z < -0.9999).map(|pose| pose.translation.z);
        let found = heights.fold(0.0, f64::max);
        assert!((found - highest).abs() < 1e-6, "{name}: {found}");
    }
}

#[test]
fn plans_turn_with_the_world_and_repeat_bit_by_bit() {
    let mesh = hammer();
    let first = make(&mesh, default_pose(&mesh), &PlanParams::default());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let again = pool.install(|| make(&mesh, default_pose(&mesh), &PlanParams::default()));
    assert_eq!(first, again);
    let other = make(&mesh, default_pose(&mesh), &PlanParams { seed: 1, ..PlanParams::default() });
    assert_ne!(first.candidates, other.candidates);
    // The same object, given in another frame.
    let motion = random_motion(&mut rng(5));
    let moved = make(&mesh.transformed(&motion), default_pose(&mesh) * motion.inverse(), &PlanParams::default());
    assert!((moved.feasible as f64 / first.feasible as f64 - 1.0).abs() < 0.05);
}

#[test]
fn bad_parameters_are_refused() {
    let mesh = hammer();
    let object = PlanObject {
        mesh: &mesh,
        obstacle: &Arc::new(Obstacle::new(&mesh, &[]).unwrap()),
        center_of_mass: Point3::origin(),
        world_from_object: Isometry3::identity(),
        neighbours: Arc::default(),
    };
    let mut params = PlanParams::default();
    params.poses.standoffs = vec![0.01, -1.0];
    let error = plan(&object, Hand::reflex().unwrap(), &params).unwrap_err();
    assert!(matches!(error, PlanError::OutOfRange(OutOfRange { field: "standoffs", .. })), "{error}");
    assert!(serde_json::from_str::<PlanParams>(r#"{"poses": {"offsett": 1}}"#).is_err());
}

#[test]
fn the_ranking_prefers_grasps_that_hold() {
    let mesh = cuboids(&[([0.0, 0.0, 0.06], [0.03, 0.035, 0.06])]);
    let plan = make(&mesh, Isometry3::identity(), &PlanParams::default());
    let ranked = plan.ranked();
    assert!(ranked.windows(2).all(|pair| pair[0].score >= pair[1].score));
    assert!(ranked.iter().all(|c| c.prediction.is_some()));
    assert!(plan.candidates[plan.feasible..].iter().all(|c| c.prediction.is_none() && !c.feasible()));
    let best = ranked[0].prediction.unwrap();
    assert!(best.fingers >= 2.0 && best.epsilon > 0.3 && best.lever < 0.03, "{best:?}");
    // The first twenty differ.
    let kinds: std::collections::BTreeSet<_> =
        ranked.iter().take(20).map(|c| (c.face, c.grasp.preshape.to_bits())).collect();
    assert!(kinds.len() >= 3, "{kinds:?}");
}
