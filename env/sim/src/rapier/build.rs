//! Assembles the engine's world: a fixed hand root, one multibody a finger, the object, the moving table.

use graspbox_solver::dispatch::Dispatcher;
use super::{frames, shape};
use crate::SimError;
use crate::config::PhysicsConfig;
use crate::engine::Part;
use crate::object::ObjectModel;
use crate::scenery::{GROUND_SIDE, TABLE_HEIGHT, TABLE_SIDE, TABLE_THICKNESS};
use graspbox_hand::Hand;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rapier3d::math::Vector;
use rapier3d::prelude::*;

const OBJECT: Group = Group::GROUP_1;
const GROUND: Group = Group::GROUP_2;
const PALM: Group = Group::GROUP_3;
/// Groups of the fingers' proximal (and distal) links begin here; with two each, this leaves room for 13 fingers.
const FIRST_FINGER_GROUP: u32 = 4;

/// The number in a collider's user data that says which part it belongs to.
fn tag(part: Part) -> u128 {
    match part {
        Part::Object => 0,
        Part::Table => 1,
        Part::Ground => 2,
        Part::Link { link, shape } => 16 + ((link as u128) << 32 | shape as u128),
    }
}

/// The part that a collider belongs to.
pub(crate) fn part_of(collider: &Collider) -> Part {
    match collider.user_data {
        0 => Part::Object,
        1 => Part::Table,
        2 => Part::Ground,
        n => Part::Link { link: ((n - 16) >> 32) as usize, shape: ((n - 16) & 0xffff_ffff) as usize },
    }
}

/// Joints and bodies of one finger.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FingerHandles {
    pub swivel: Option<MultibodyJointHandle>,
    pub proximal: MultibodyJointHandle,
    pub distal: MultibodyJointHandle,
    pub bodies: [RigidBodyHandle; 2],
}

/// Everything in the world that is looked up by name.
#[derive(Clone, Debug)]
pub(crate) struct Handles {
    pub object: RigidBodyHandle,
    pub object_collider: ColliderHandle,
    pub scenery: RigidBodyHandle,
    pub fingers: Vec<FingerHandles>,
    /// The engine's joint for each joint of the hand; none for a fixed one.
    pub joints: Vec<Option<MultibodyJointHandle>>,
    /// Pose of the engine's shape of every collider of every link, in the link.
    pub link_from_shape: Vec<Vec<Isometry3<f64>>>,
}

impl Handles {
    /// The bodies that the frame's motion acts on: the fingers' links and the object.
    pub(crate) fn moving_bodies(&self) -> impl Iterator<Item = RigidBodyHandle> {
        self.fingers.iter().flat_map(|finger| finger.bodies).chain([self.object])
    }
}

/// Links that move as one rigid body, with the pose of each in the frame of the first.
struct Carrier {
    links: Vec<(usize, Isometry3<f64>)>,
}

/// What the engine takes for the size of things, in its own lengths. It only scales settings, which are scaled back below, and the margin
/// within which boxes are kept as candidates for contact: 4 % of it on both sides. A power of two, so that scaling is exact.
const LENGTH_UNIT: f32 = 8.0;

fn integration_parameters(config: &PhysicsConfig) -> IntegrationParameters {
    let own = &config.rapier;
    let standard = IntegrationParameters::default();
    let scaled = |length: f32| length * frames::UNIT as f32 / LENGTH_UNIT;
    IntegrationParameters {
        dt: config.dt as f32,
        length_unit: LENGTH_UNIT,
        normalized_max_corrective_velocity: scaled(standard.normalized_max_corrective_velocity),
        normalized_max_linear_velocity: scaled(standard.normalized_max_linear_velocity),
        num_solver_iterations: own.solver_iterations,
        contact_softness: SpringCoefficients::new(own.contact_frequency as f32, own.contact_damping_ratio as f32),
        static_contact_softness: SpringCoefficients::new(
            own.static_contact_frequency as f32,
            own.contact_damping_ratio as f32,
        ),
        normalized_prediction_distance: scaled(config.rapier.prediction as f32),
        normalized_allowed_linear_error: scaled(own.allowed_penetration as f32),
        // The engine's own threshold (5 cm) is a large part of a grasp: contacts would go stale.
        contact_recycling: config.rapier.contact_drift > 0.0,
        normalized_contact_recycle_distance: scaled(config.rapier.contact_drift as f32),
        // Household objects and fingers move slower than their own thickness per step.
        max_ccd_substeps: 0,
        // Solved contact by contact: boxes on the table lose up to 12 % of mu, but the engine's friction of whole patches lets
        // firmly held objects creep.
        friction_model: FrictionModel::Coulomb,
        ..standard
    }
}

/// Builds the world with the hand's base, object and scenery all at the origin and all joints at 0.
pub(crate) fn build(
    hand: &Hand,
    object: &ObjectModel,
    config: &PhysicsConfig,
) -> Result<(PhysicsWorld, Handles), SimError> {
    let mut world = PhysicsWorld {
        integration_parameters: integration_parameters(config),
        narrow_phase: NarrowPhase::with_query_dispatcher(Dispatcher),
        ..PhysicsWorld::default()
    };
    let scenery = insert_scenery(&mut world, config);
    let mass_properties = MassProperties::with_inertia_matrix(
        frames::point(&object.center_of_mass()),
        object.mass() as f32,
        frames::inertia(&object.inertia()),
    );
    let body = RigidBodyBuilder::dynamic()
        .additional_mass_properties(mass_properties)
        .gyroscopic_forces_enabled(true)
        .can_sleep(false);
    let object_body = world.bodies.insert(body);
    let shape = object.shapes(shape::object)?;
    let collider = surface(SharedShape::clone(&shape), config.friction.object, Part::Object, OBJECT, Group::ALL);
    let object_collider = world.colliders.insert_with_parent(collider, object_body, &mut world.bodies);
    insert_base(&mut world, hand);
    let fingers =
        (0..hand.fingers.len()).map(|finger| insert_finger(&mut world, hand, finger)).collect::<Result<Vec<_>, _>>()?;
    let link_from_shape =
        hand.links.iter().map(|link| link.colliders.iter().map(shape::link_from_engine).collect()).collect();
    let joints = joint_handles(hand, &fingers);
    Ok((world, Handles { object: object_body, object_collider, scenery, fingers, joints, link_from_shape }))
}

fn joint_handles(hand: &Hand, fingers: &[FingerHandles]) -> Vec<Option<MultibodyJointHandle>> {
    let mut joints = vec![None; hand.joints.len()];
    for (finger, handles) in hand.fingers.iter().zip(fingers) {
        joints[finger.proximal] = Some(handles.proximal);
        joints[finger.distal] = Some(handles.distal);
        if let Some((swivel, _)) = finger.swivel {
            joints[swivel] = handles.swivel;
        }
    }
    joints
}

/// Table and ground on one kinematic body, since both move alike in the hand's frame.
fn insert_scenery(world: &mut PhysicsWorld, config: &PhysicsConfig) -> RigidBodyHandle {
    let body = RigidBodyBuilder::kinematic_position_based().can_sleep(false);
    let body = world.bodies.insert(body);
    let half = frames::length(TABLE_SIDE / 2.0);
    let thick = frames::length(TABLE_THICKNESS / 2.0);
    let table = surface(SharedShape::cuboid(half, half, thick), config.friction.table, Part::Table, GROUND, Group::ALL)
        .translation(Vector::new(0.0, 0.0, -thick));
    // A thick slab, not a half-space: an unbounded shape would be a contact candidate of everything at every step.
    let ground_side = frames::length(GROUND_SIDE / 2.0);
    let ground_half = SharedShape::cuboid(ground_side, ground_side, thick);
    let ground = surface(ground_half, config.friction.table, Part::Ground, GROUND, Group::ALL)
        .translation(Vector::new(0.0, 0.0, frames::length(-TABLE_HEIGHT) - thick));
    for collider in [table, ground] {
        world.colliders.insert_with_parent(collider, body, &mut world.bodies);
    }
    body
}

/// A massless collider (bodies carry their mass themselves) with a friction factor.
fn surface(shape: SharedShape, factor: f64, part: Part, member: Group, filter: Group) -> ColliderBuilder {
    ColliderBuilder::new(shape)
        .density(0.0)
        .friction(factor as f32)
        .friction_combine_rule(CoefficientCombineRule::Multiply)
        .collision_groups(InteractionGroups::new(member, filter, InteractionTestMode::And))
        .user_data(tag(part))
}

/// The links that hang on `root` by fixed joints, `root` first.
fn carrier(hand: &Hand, root: usize) -> Carrier {
    let mut links = vec![(root, Isometry3::identity())];
    let mut next = 0;
    while next < links.len() {
        let (link, pose) = links[next];
        for joint in hand.joints.iter().filter(|j| j.fixed && j.parent == link) {
            links.push((joint.child, pose * joint.parent_from_joint));
        }
        next += 1;
    }
    Carrier { links }
}

fn insert_base(world: &mut PhysicsWorld, hand: &Hand) {
    let body = world.bodies.insert(RigidBodyBuilder::fixed());
    insert_colliders(world, hand, &carrier(hand, 0), body, PALM, Group::ALL);
}

fn insert_colliders(
    world: &mut PhysicsWorld,
    hand: &Hand,
    carrier: &Carrier,
    body: RigidBodyHandle,
    member: Group,
    filter: Group,
) {
    for (link, carrier_from_link) in &carrier.links {
        for (index, collider) in hand.links[*link].colliders.iter().enumerate() {
            let engine_shape = shape::of_link(&collider.shape);
            let factor = hand.friction.of(collider.material);
            let pose = carrier_from_link * shape::link_from_engine(collider);
            let part = Part::Link { link: *link, shape: index };
            let built = surface(engine_shape, factor, part, member, filter).position(frames::pose(&pose));
            world.colliders.insert_with_parent(built, body, &mut world.bodies);
        }
    }
}

/// Group of a finger's links; `distal` links may also meet the palm.
fn finger_group(finger: usize, distal: bool) -> Group {
    Group::from_bits_truncate(1 << (FIRST_FINGER_GROUP + 2 * finger as u32 + u32::from(distal)))
}

fn insert_finger(world: &mut PhysicsWorld, hand: &Hand, finger: usize) -> Result<FingerHandles, SimError> {
    let f = &hand.fingers[finger];
    let bad = |why| SimError::BadFinger { finger: f.name.clone(), why };
    if finger > 12 {
        return Err(bad("a hand may have 13 fingers at most"));
    }
    let others = (0..hand.fingers.len())
        .filter(|i| *i != finger)
        .fold(Group::NONE, |g, i| g | finger_group(i, false) | finger_group(i, true));
    let mut parent = world.bodies.insert(RigidBodyBuilder::fixed());
    let mut swivel = None;
    if let Some((joint, _)) = f.swivel {
        if hand.joints[joint].parent != 0 {
            return Err(bad("its swivel does not hang on the base"));
        }
        let body = insert_link(world, hand, joint, (PALM, OBJECT | GROUND));
        let handle = world.multibody_joints.insert_kinematic(parent, body, revolute(hand, joint), true);
        swivel = Some(handle.ok_or_else(|| bad("its swivel closes a loop"))?);
        parent = body;
    }
    let mut handles = Vec::with_capacity(2);
    let mut bodies = Vec::with_capacity(2);
    for (joint, distal) in [(f.proximal, false), (f.distal, true)] {
        let palm = if distal { PALM } else { Group::NONE };
        let groups = (finger_group(finger, distal), OBJECT | GROUND | others | palm);
        let body = insert_link(world, hand, joint, groups);
        let handle = world.multibody_joints.insert(parent, body, revolute(hand, joint), true);
        handles.push(handle.ok_or_else(|| bad("its joints close a loop"))?);
        bodies.push(body);
        parent = body;
    }
    let found = FingerHandles { swivel, proximal: handles[0], distal: handles[1], bodies: [bodies[0], bodies[1]] };
    set_losses(world, hand, finger, &found);
    Ok(found)
}

fn insert_link(
    world: &mut PhysicsWorld,
    hand: &Hand,
    joint: usize,
    (member, filter): (Group, Group),
) -> RigidBodyHandle {
    let carrier = carrier(hand, hand.joints[joint].child);
    let mass = carrier.links.iter().map(|(link, pose)| link_mass(hand, *link, pose)).reduce(|a, b| a + b);
    let body = RigidBodyBuilder::dynamic().additional_mass_properties(mass.unwrap_or_default()).can_sleep(false);
    let body = world.bodies.insert(body);
    insert_colliders(world, hand, &carrier, body, member, filter);
    body
}

fn link_mass(hand: &Hand, link: usize, carrier_from_link: &Isometry3<f64>) -> MassProperties {
    let link = &hand.links[link];
    let turn = carrier_from_link.rotation.to_rotation_matrix();
    let inertia = turn.matrix() * link.inertia * turn.matrix().transpose();
    let center: Point3<f64> = carrier_from_link * link.center_of_mass;
    MassProperties::with_inertia_matrix(frames::point(&center), link.mass as f32, frames::inertia(&inertia))
}

/// A revolute joint about the hand's axis: the engine turns about its local x.
fn revolute(hand: &Hand, joint: usize) -> GenericJoint {
    let joint = &hand.joints[joint];
    let turn = UnitQuaternion::rotation_between(&Vector3::x(), &joint.axis)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
    let axis_frame = Isometry3::from_parts(nalgebra::Translation3::identity(), turn);
    GenericJointBuilder::new(JointAxesMask::LOCKED_REVOLUTE_AXES)
        .local_frame1(frames::pose(&(joint.parent_from_joint * axis_frame)))
        .local_frame2(frames::pose(&axis_frame))
        .contacts_enabled(false)
        .build()
}

/// Damping and armature of both joints, which the engine integrates implicitly.
fn set_losses(world: &mut PhysicsWorld, hand: &Hand, finger: usize, handles: &FingerHandles) {
    let flexure = &hand.fingers[finger].flexure;
    for (handle, damping) in [(handles.proximal, flexure.proximal_damping), (handles.distal, flexure.distal_damping)] {
        if let Some((multibody, link)) = world.multibody_joints.get_mut(handle) {
            let Some(id) = multibody.link(link).map(|l| l.assembly_id()) else {
                continue;
            };
            multibody.damping_mut()[id] = (damping * frames::TORQUE_UNIT) as f32;
            multibody.armature_mut()[id] = (flexure.armature * frames::TORQUE_UNIT) as f32;
        }
    }
}

/// Places every link where its joint angles say; to be called once after [`build`] and whenever angles were displaced.
pub(crate) fn place_links(world: &mut PhysicsWorld, handles: &Handles) {
    for finger in &handles.fingers {
        if let Some((multibody, _)) = world.multibody_joints.get_mut(finger.proximal) {
            multibody.forward_kinematics(&world.bodies, true);
            multibody.update_rigid_bodies(&mut world.bodies, true);
        }
    }
}
