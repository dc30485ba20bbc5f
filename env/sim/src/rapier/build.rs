//! Assembly of rapier's world: the hand's fixed root, one multibody per chain, the objects, the moving table.

use super::{frames, shape};
use crate::SimError;
use crate::config::PhysicsConfig;
use crate::engine::{Part, WorldSpec};
use crate::object::ObjectModel;
use crate::scenery::{GROUND_SIDE, TABLE_HEIGHT, TABLE_SIDE, TABLE_THICKNESS, Wall};
use graspbox_hand::{Hand, JointKind};
use graspbox_solver::dispatch::Dispatcher;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rapier3d::math::Vector;
use rapier3d::prelude::*;

const OBJECT: Group = Group::GROUP_1;
const GROUND: Group = Group::GROUP_2;
const PALM: Group = Group::GROUP_3;
/// First collision group of the chains. Each chain has two: one for links next to the palm, which do not collide with it, and one for the others.
const FIRST_CHAIN_GROUP: u32 = 4;
/// Most chains of a hand: rapier has 32 collision groups.
const MAX_CHAINS: usize = 13;

/// Tags of parts: table, ground, walls, from here on objects, and from [`FIRST_LINK`] on links.
const FIRST_OBJECT: u128 = 3;
const FIRST_LINK: u128 = 1 << 16;

/// A part as the number in a collider's user data.
fn tag(part: Part) -> u128 {
    match part {
        Part::Table => 0,
        Part::Ground => 1,
        // There is no arm: `Rapier::new` refuses it.
        Part::Wall | Part::Arm(_) => 2,
        Part::Object(object) => FIRST_OBJECT + object as u128,
        Part::Link { link, shape } => FIRST_LINK + ((link as u128) << 32 | shape as u128),
    }
}

/// The part that a collider belongs to.
pub(crate) fn part_of(collider: &Collider) -> Part {
    match collider.user_data {
        0 => Part::Table,
        1 => Part::Ground,
        2 => Part::Wall,
        n if n < FIRST_LINK => Part::Object((n - FIRST_OBJECT) as usize),
        n => {
            let n = n - FIRST_LINK;
            Part::Link { link: (n >> 32) as usize, shape: (n & 0xffff_ffff) as usize }
        }
    }
}

/// Rapier's joint and body for a joint of the hand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JointHandle {
    pub handle: MultibodyJointHandle,
    pub kind: JointKind,
    body: RigidBodyHandle,
}

/// Rapier's body and collider of an object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ObjectHandle {
    pub body: RigidBodyHandle,
    pub collider: ColliderHandle,
}

/// Handles of the bodies, colliders and joints in rapier's world.
#[derive(Clone, Debug)]
pub(crate) struct Handles {
    pub objects: Vec<ObjectHandle>,
    pub scenery: RigidBodyHandle,
    /// Rapier's joint for each joint of the hand; `None` for a fixed one.
    pub joints: Vec<Option<JointHandle>>,
    /// Joints that move under forces.
    pub free: Vec<usize>,
    /// Joints that actuators drive rigidly, and those that follow them.
    pub rigid: Vec<usize>,
    /// By link and collider, the pose of rapier's shape in the link.
    pub link_from_shape: Vec<Vec<Isometry3<f64>>>,
}

impl Handles {
    /// The bodies on which fictitious forces act: the links of free joints, and the objects.
    pub(crate) fn moving_bodies(&self) -> impl Iterator<Item = RigidBodyHandle> {
        self.free_joints().map(|joint| joint.body).chain(self.objects.iter().map(|object| object.body))
    }

    pub(crate) fn free_joints(&self) -> impl Iterator<Item = &JointHandle> {
        self.free.iter().filter_map(|joint| self.joints[*joint].as_ref())
    }
}

/// Links that move as one rigid body, with the pose of each in the frame of the first.
struct Carrier {
    links: Vec<(usize, Isometry3<f64>)>,
}

/// Rapier's typical size of objects, centimetres. It scales settings, which are scaled back below, and the margin within which bounding boxes
/// are contact candidates: 4 % of it on both sides. A power of two, for exact scaling.
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
        // Rapier's default (5 cm) is as large as a grasp: contacts would be stale.
        contact_recycling: config.rapier.contact_drift > 0.0,
        normalized_contact_recycle_distance: scaled(config.rapier.contact_drift as f32),
        // Household objects and fingers move by less than their own thickness per step.
        max_ccd_substeps: 0,
        // Friction per contact point: boxes on the table lose up to 12 % of mu, but with friction per patch firmly held objects creep.
        friction_model: FrictionModel::Coulomb,
        ..standard
    }
}

/// Builds the world with the hand's base, objects and scenery all at the origin and all joints at 0.
pub(crate) fn build(
    WorldSpec { hand, objects, walls, config }: WorldSpec,
) -> Result<(PhysicsWorld, Handles), SimError> {
    let mut world = PhysicsWorld {
        integration_parameters: integration_parameters(config),
        narrow_phase: NarrowPhase::with_query_dispatcher(Dispatcher::default()),
        ..PhysicsWorld::default()
    };
    let scenery = insert_scenery(&mut world, walls, config);
    let mut inserted = Vec::with_capacity(objects.len());
    for (index, object) in objects.iter().enumerate() {
        inserted.push(insert_object(&mut world, object, index, config.friction.object)?);
    }
    insert_base(&mut world, hand);
    let link_from_shape =
        hand.links.iter().map(|link| link.colliders.iter().map(shape::link_from_engine).collect()).collect();
    let mut handles = Handles {
        objects: inserted,
        scenery,
        joints: vec![None; hand.joints.len()],
        free: Vec::new(),
        rigid: Vec::new(),
        link_from_shape,
    };
    insert_chains(&mut world, hand, &mut handles)?;
    Ok((world, handles))
}

fn insert_object(
    world: &mut PhysicsWorld,
    object: &ObjectModel,
    index: usize,
    friction: f64,
) -> Result<ObjectHandle, SimError> {
    let mass_properties = MassProperties::with_inertia_matrix(
        frames::point(&object.center_of_mass()),
        object.mass() as f32,
        frames::inertia(&object.inertia()),
    );
    let body = RigidBodyBuilder::dynamic()
        .additional_mass_properties(mass_properties)
        .gyroscopic_forces_enabled(true)
        .can_sleep(false);
    let body = world.bodies.insert(body);
    let shape = object.shapes(shape::object).map_err(|error| match error {
        SimError::FlatPart { part, .. } => SimError::FlatPart { object: index, part },
        other => other,
    })?;
    let collider = surface(SharedShape::clone(&shape), friction, Part::Object(index), OBJECT, Group::ALL);
    let collider = world.colliders.insert_with_parent(collider, body, &mut world.bodies);
    Ok(ObjectHandle { body, collider })
}

/// Table, ground and walls on one kinematic body, since all have the same motion in the hand's frame.
fn insert_scenery(world: &mut PhysicsWorld, walls: &[Wall], config: &PhysicsConfig) -> RigidBodyHandle {
    let body = RigidBodyBuilder::kinematic_position_based().can_sleep(false);
    let body = world.bodies.insert(body);
    let half = frames::length(TABLE_SIDE / 2.0);
    let thick = frames::length(TABLE_THICKNESS / 2.0);
    let table = surface(SharedShape::cuboid(half, half, thick), config.friction.table, Part::Table, GROUND, Group::ALL)
        .translation(Vector::new(0.0, 0.0, -thick));
    // A slab instead of a half-space: an unbounded shape would be a contact candidate of every body at every step.
    let ground_side = frames::length(GROUND_SIDE / 2.0);
    let ground_half = SharedShape::cuboid(ground_side, ground_side, thick);
    let ground = surface(ground_half, config.friction.table, Part::Ground, GROUND, Group::ALL)
        .translation(Vector::new(0.0, 0.0, frames::length(-TABLE_HEIGHT) - thick));
    let walls = walls.iter().map(|wall| {
        let half = frames::lengths(&wall.half);
        let shape = SharedShape::cuboid(half.x, half.y, half.z);
        let built = surface(shape, config.friction.table, Part::Wall, GROUND, Group::ALL);
        built.position(frames::pose(&wall.world_from_wall))
    });
    for collider in [table, ground].into_iter().chain(walls) {
        world.colliders.insert_with_parent(collider, body, &mut world.bodies);
    }
    body
}

/// A collider with a friction factor and without mass, which is set on the bodies.
fn surface(shape: SharedShape, factor: f64, part: Part, member: Group, filter: Group) -> ColliderBuilder {
    ColliderBuilder::new(shape)
        .density(0.0)
        .friction(factor as f32)
        .friction_combine_rule(CoefficientCombineRule::Multiply)
        .collision_groups(InteractionGroups::new(member, filter, InteractionTestMode::And))
        .user_data(tag(part))
}

/// The links that fixed joints connect to `root`, `root` first.
fn carrier(hand: &Hand, root: usize) -> Carrier {
    let mut links = vec![(root, Isometry3::identity())];
    let mut next = 0;
    while next < links.len() {
        let (link, pose) = links[next];
        for joint in hand.joints.iter().filter(|j| j.is_fixed() && j.parent == link) {
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
            let own = (*link, index);
            let passes = hand.no_contact.shapes.iter().flatten().any(|shape| *shape == own);
            let hooks = if passes { ActiveHooks::FILTER_CONTACT_PAIRS } else { ActiveHooks::empty() };
            let built = built.active_hooks(hooks);
            world.colliders.insert_with_parent(built, body, &mut world.bodies);
        }
    }
}

/// Collision group of a chain's links.
fn chain_group(chain: usize, next_to_palm: bool) -> Group {
    Group::from_bits_truncate(1 << (FIRST_CHAIN_GROUP + 2 * chain as u32 + u32::from(!next_to_palm)))
}

fn insert_chains(world: &mut PhysicsWorld, hand: &Hand, handles: &mut Handles) -> Result<(), SimError> {
    let chains = hand.chains();
    let bad = |why: String| SimError::BadHand { hand: hand.name.clone(), engine: "rapier", why };
    if chains.len() > MAX_CHAINS {
        return Err(bad(format!("it has {} chains, more than {MAX_CHAINS}", chains.len())));
    }
    for (number, chain) in chains.iter().enumerate() {
        let others = (0..chains.len())
            .filter(|other| *other != number)
            .fold(Group::NONE, |groups, other| groups | chain_group(other, true) | chain_group(other, false));
        let root = world.bodies.insert(RigidBodyBuilder::fixed());
        for &joint in &chain.joints {
            let description = &hand.joints[joint];
            let (name, carrier) = (&description.name, hand.carrier(description.parent));
            let parent = match carrier.checked_sub(1).and_then(|above| handles.joints[above]) {
                Some(above) => above.body,
                None => root,
            };
            let rigid = hand.rigid_position(joint, |_| 0.0).is_some();
            if description.mimic.is_some() && !rigid {
                return Err(bad(format!("joint `{name}` mimics a joint that is not driven rigidly")));
            }
            if rigid && carrier != 0 {
                return Err(bad(format!("joint `{name}` is driven rigidly, but is not connected to the base")));
            }
            let palm = if hand.meets_palm(description.child) { PALM } else { Group::NONE };
            let member = chain_group(number, palm == Group::NONE);
            let groups = if rigid { (PALM, OBJECT | GROUND) } else { (member, OBJECT | GROUND | others | palm) };
            let body = insert_link(world, hand, joint, groups);
            let built = engine_joint(hand, joint);
            let handle = if rigid {
                world.multibody_joints.insert_kinematic(parent, body, built, true)
            } else {
                world.multibody_joints.insert(parent, body, built, true)
            };
            let handle = handle.ok_or_else(|| bad(format!("joint `{name}` closes a loop")))?;
            handles.joints[joint] = Some(JointHandle { handle, kind: description.kind, body });
            if rigid { &mut handles.rigid } else { &mut handles.free }.push(joint);
        }
        // Inserting a joint may renumber the coordinates of its multibody, so damping and armature come last.
        chain.joints.iter().filter(|joint| handles.free.contains(joint)).for_each(|&joint| {
            set_losses(world, hand, joint, handles);
        });
    }
    Ok(())
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

/// A joint about or along the hand's axis: rapier's joint axis is its local x.
fn engine_joint(hand: &Hand, joint: usize) -> GenericJoint {
    let joint = &hand.joints[joint];
    let turn = UnitQuaternion::rotation_between(&Vector3::x(), &joint.axis)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
    let axis_frame = Isometry3::from_parts(nalgebra::Translation3::identity(), turn);
    let locked = match joint.kind {
        JointKind::Prismatic => JointAxesMask::LOCKED_PRISMATIC_AXES,
        JointKind::Fixed | JointKind::Revolute => JointAxesMask::LOCKED_REVOLUTE_AXES,
    };
    GenericJointBuilder::new(locked)
        .local_frame1(frames::pose(&(carrier_from_link(hand, joint.parent) * joint.parent_from_joint * axis_frame)))
        .local_frame2(frames::pose(&axis_frame))
        .contacts_enabled(false)
        .build()
}

/// Pose of a link in the frame of its carrier.
fn carrier_from_link(hand: &Hand, link: usize) -> Isometry3<f64> {
    let first = hand.carrier(link);
    let (mut pose, mut at) = (Isometry3::identity(), link);
    while at != first {
        let joint = &hand.joints[at - 1];
        pose = joint.parent_from_joint * pose;
        at = joint.parent;
    }
    pose
}

/// Sets damping and armature of a joint, which rapier integrates implicitly.
fn set_losses(world: &mut PhysicsWorld, hand: &Hand, joint: usize, handles: &Handles) {
    let (description, Some(handle)) = (&hand.joints[joint], &handles.joints[joint]) else { return };
    let unit = match description.kind {
        JointKind::Prismatic => 1.0,
        JointKind::Fixed | JointKind::Revolute => frames::TORQUE_UNIT,
    };
    if let Some((multibody, link)) = world.multibody_joints.get_mut(handle.handle)
        && let Some(id) = multibody.link(link).map(|l| l.assembly_id())
    {
        multibody.damping_mut()[id] = (description.damping * unit) as f32;
        multibody.armature_mut()[id] = (description.armature * unit) as f32;
    }
}

/// Places every link according to the joint positions; call it after [`build`] and whenever joints were displaced.
pub(crate) fn place_links(world: &mut PhysicsWorld, hand: &Hand, handles: &Handles) {
    for (joint, handle) in hand.joints.iter().zip(&handles.joints) {
        let root = hand.carrier(joint.parent) == 0;
        if let Some(handle) = handle.as_ref().filter(|_| root)
            && let Some((multibody, _)) = world.multibody_joints.get_mut(handle.handle)
        {
            multibody.forward_kinematics(&world.bodies, true);
            multibody.update_rigid_bodies(&mut world.bodies, true);
        }
    }
}
