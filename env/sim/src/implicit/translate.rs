//! Translation of hand, object and scenery into the solver's model.

use super::arm::ArmBodies;
use crate::object::{Geometry, ObjectModel};
use crate::scenery::{TABLE_HEIGHT, TABLE_SIDE, TABLE_THICKNESS, Wall};
use crate::world::carrier::parked;
use graspbox_hand::{ActuatorState, Drive, Hand, JointKind, Link, Shape, Transmission};
use graspbox_solver as solver;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

/// Indices of the hand's links, joints and actuators in the solver's tree.
pub(crate) struct Translation {
    /// Body of each link.
    body: Vec<usize>,
    /// Pose of each link in its body: links that are connected by fixed joints form one body.
    pub body_from_link: Vec<Isometry3<f64>>,
    /// For every shape of each body, its link and the index of the collider within it.
    shapes: Vec<Vec<(usize, usize)>>,
    /// Coordinate, ratio and offset of each joint; `None` for a fixed one.
    pub joints: Vec<Option<(usize, f64, f64)>>,
    /// The joint of each driven coordinate of the hand.
    rigid: Vec<usize>,
    /// The bodies of the arm that carries it, whose driven coordinates are the last.
    pub arm: ArmBodies,
}

impl Translation {
    /// Link of a body's shape, and the index of the collider within it.
    pub fn owner(&self, body: usize, shape: usize) -> (usize, usize) {
        self.shapes[body][shape]
    }

    /// Writes the driven coordinates and the cable commands of the actuators' states: tendons first, then one cable per servo-driven joint.
    pub fn drive(
        &self,
        hand: &Hand,
        actuators: &[ActuatorState],
        driven: &mut [f64],
        cables: &mut [solver::CableCommand],
    ) {
        for (driven, joint) in driven.iter_mut().zip(&self.rigid) {
            *driven = hand.rigid_position(*joint, |actuator| actuators[actuator].position).unwrap_or(0.0);
        }
        let mut servo = hand.tendons.len();
        for (actuator, state) in hand.actuators.iter().zip(actuators) {
            match &actuator.transmission {
                Transmission::Spool { tendon, radius } => {
                    cables[*tendon] =
                        solver::CableCommand { length: radius * state.position, rate: radius * state.velocity };
                }
                Transmission::Joints { joints, drive: Drive::Servo { .. } } => {
                    for driven in joints {
                        let (length, rate) = (hand.led(driven, state.position), driven.ratio * state.velocity);
                        cables[servo] = solver::CableCommand { length, rate };
                        servo += 1;
                    }
                }
                Transmission::Joints { drive: Drive::Rigid, .. } => {}
            }
        }
    }

    /// Positions of all coordinates, the driven ones last, for the joint positions `joints` (one per joint, rad or m).
    pub fn positions(&self, hand: &Hand, joints: &[f64]) -> Vec<f64> {
        let rigid = |joint: &usize| self.rigid.contains(joint);
        let free = hand.coordinates().filter(|joint| !rigid(joint)).map(|joint| joints[joint]);
        let arm = hand.carrier.as_ref().map(|carrier| parked(carrier.axes.len())).unwrap_or_default();
        free.chain(self.rigid.iter().map(|joint| joints[*joint])).chain(arm).collect()
    }
}

/// The hand as a tree; its free coordinates are in the order of the hand's, chain by chain.
pub(crate) fn hand(hand: &Hand) -> (solver::Tree, Translation) {
    let mut tree = solver::Tree::default();
    let (rigid, free): (Vec<usize>, Vec<usize>) =
        hand.coordinates().partition(|joint| hand.rigid_position(*joint, |_| 0.0).is_some());
    tree.coordinates = free.iter().map(|joint| coordinate(hand, *joint)).collect();
    tree.driven = rigid.len();
    let mut coordinate_of = vec![None; hand.joints.len()];
    for (coordinate, joint) in free.iter().chain(&rigid).enumerate() {
        coordinate_of[*joint] = Some((coordinate, 1.0, 0.0));
    }
    for (index, joint) in hand.joints.iter().enumerate() {
        if let Some(mimic) = joint.mimic {
            coordinate_of[index] = coordinate_of[mimic.joint].map(|(c, _, _)| (c, mimic.ratio, mimic.offset));
        }
    }
    tree.cables = cables(hand, &coordinate_of);
    let mut translation = bodies(hand, &mut tree, coordinate_of, rigid);
    if let Some(carrier) = &hand.carrier {
        translation.arm = ArmBodies::add(carrier, &mut tree);
    }
    tree.pairs = pairs(hand, &translation);
    tree.apart = apart(hand, &translation);
    (tree, translation)
}

fn coordinate(hand: &Hand, joint: usize) -> solver::Coordinate {
    let joint = &hand.joints[joint];
    solver::Coordinate {
        armature: joint.armature,
        damping: joint.damping,
        stiffness: joint.stiffness,
        spring_reference: joint.spring_reference,
        limits: joint.limits,
        stop_stiffness: joint.stop_stiffness,
    }
}

/// One cable per tendon, then one per servo-driven joint.
fn cables(hand: &Hand, coordinate_of: &[Option<(usize, f64, f64)>]) -> Vec<solver::Cable> {
    let coordinate = |joint: usize| coordinate_of[joint].map(|(c, _, _)| c);
    let arms =
        |arms: &[(usize, f64)]| arms.iter().filter_map(|(joint, arm)| Some((coordinate(*joint)?, *arm))).collect();
    let tendons = hand.tendons.iter().map(|tendon| solver::Cable {
        arms: arms(&tendon.arms),
        stiffness: tendon.stiffness,
        damping: tendon.damping,
        max_force: tendon.max_tension,
        unilateral: true,
    });
    let servos = hand.actuators.iter().flat_map(|actuator| match &actuator.transmission {
        Transmission::Joints { joints, drive: Drive::Servo { stiffness, damping } } => joints
            .iter()
            .map(|driven| solver::Cable {
                arms: arms(&[(driven.joint, 1.0)]),
                stiffness: *stiffness,
                damping: *damping,
                max_force: actuator.load_limit,
                unilateral: false,
            })
            .collect(),
        _ => Vec::new(),
    });
    tendons.chain(servos).collect()
}

/// One body per group of links that fixed joints connect.
fn bodies(
    hand: &Hand,
    tree: &mut solver::Tree,
    joints: Vec<Option<(usize, f64, f64)>>,
    rigid: Vec<usize>,
) -> Translation {
    let mut body = vec![0];
    let mut body_from_link = vec![Isometry3::identity()];
    let mut shapes = vec![Vec::new()];
    tree.bodies.push(bare_body(0, None));
    add_link(hand, &mut tree.bodies[0], &mut shapes[0], 0, &Isometry3::identity());
    for (index, joint) in hand.joints.iter().enumerate() {
        let (parent, place) = (body[joint.parent], body_from_link[joint.parent] * joint.parent_from_joint);
        if let Some((coordinate, ratio, offset)) = joints[index] {
            body.push(tree.bodies.len());
            body_from_link.push(Isometry3::identity());
            let kind = match joint.kind {
                JointKind::Prismatic => solver::JointKind::Prismatic,
                JointKind::Fixed | JointKind::Revolute => solver::JointKind::Revolute,
            };
            let own = solver::Joint { kind, parent_from_joint: place, axis: joint.axis, coordinate, ratio, offset };
            tree.bodies.push(bare_body(parent, Some(own)));
            shapes.push(Vec::new());
        } else {
            body.push(parent);
            body_from_link.push(place);
        }
        let (own, place) = (body[joint.child], body_from_link[joint.child]);
        add_link(hand, &mut tree.bodies[own], &mut shapes[own], joint.child, &place);
    }
    Translation { body, body_from_link, shapes, joints, rigid, arm: ArmBodies::default() }
}

pub(super) fn bare_body(parent: usize, joint: Option<solver::Joint>) -> solver::Body {
    solver::Body { parent, joint, mass: 0.0, center: Point3::origin(), inertia: Matrix3::zeros(), shapes: Vec::new() }
}

fn add_link(
    hand: &Hand,
    body: &mut solver::Body,
    owners: &mut Vec<(usize, usize)>,
    link: usize,
    body_from_link: &Isometry3<f64>,
) {
    let own = &hand.links[link];
    add_mass(body, own, body_from_link);
    for (index, collider) in own.colliders.iter().enumerate() {
        owners.push((link, index));
        body.shapes.push(solver::BodyShape {
            primitive: primitive(&collider.shape),
            body_from_shape: body_from_link * collider.link_from_shape,
            friction: hand.friction.of(collider.material),
        });
    }
}

/// Adds a link's mass to a body; the inertia is about the new centre of mass.
fn add_mass(body: &mut solver::Body, link: &Link, body_from_link: &Isometry3<f64>) {
    let total = body.mass + link.mass;
    if total <= 0.0 {
        return;
    }
    let turn = body_from_link.rotation.to_rotation_matrix();
    let center = body_from_link * link.center_of_mass;
    let common = Point3::from((body.center.coords * body.mass + center.coords * link.mass) / total);
    let moved = |mass: f64, from: &Point3<f64>| {
        let d: Vector3<f64> = from - common;
        mass * (Matrix3::identity() * d.norm_squared() - d * d.transpose())
    };
    body.inertia += moved(body.mass, &body.center)
        + turn.matrix() * link.inertia * turn.matrix().transpose()
        + moved(link.mass, &center);
    (body.mass, body.center) = (total, common);
}

/// The solver depends on no other crate of the project and has its own enum; only this function uses both.
pub(super) fn primitive(shape: &Shape) -> solver::Primitive {
    match *shape {
        Shape::Cuboid(half) => solver::Primitive::Cuboid(half),
        Shape::Sphere { radius } => solver::Primitive::Sphere { radius },
        Shape::Cylinder { radius, half_length } => solver::Primitive::Cylinder { radius, half_length },
    }
}

/// Pairs of bodies that may touch, without those all of whose shapes pass through each other.
fn pairs(hand: &Hand, translation: &Translation) -> Vec<(usize, usize)> {
    let touch = |[a, b]: &[usize; 2]| {
        let bodies = [translation.body[*a], translation.body[*b]];
        let [some, others] = bodies.map(|body| &translation.shapes[body]);
        some.iter().any(|one| others.iter().any(|two| hand.shapes_touch(*one, *two)))
    };
    let meeting = hand.meeting_bodies().into_iter().filter(touch);
    meeting.map(|[a, b]| (translation.body[a], translation.body[b])).collect()
}

/// Shapes that pass through each other, each by its body and its index within it.
fn apart(hand: &Hand, translation: &Translation) -> Vec<[(usize, usize); 2]> {
    let place = |shape: &(usize, usize)| {
        let body = translation.body[shape.0];
        translation.shapes[body].iter().position(|own| own == shape).map(|within| (body, within))
    };
    hand.no_contact.shapes.iter().filter_map(|[a, b]| Some([place(a)?, place(b)?])).collect()
}

pub(crate) fn object(object: &ObjectModel, friction: f64) -> solver::Object {
    let parts = match object.geometry() {
        Geometry::Cuboid(half) => vec![solver::ObjectPart::Primitive(solver::Primitive::Cuboid(*half))],
        Geometry::Ball { radius } => {
            vec![solver::ObjectPart::Primitive(solver::Primitive::Sphere { radius: *radius })]
        }
        Geometry::Cylinder { radius, half_length } => {
            let primitive = solver::Primitive::Cylinder { radius: *radius, half_length: *half_length };
            vec![solver::ObjectPart::Primitive(primitive)]
        }
        Geometry::Parts(parts) => parts
            .iter()
            .map(|hull| solver::ObjectPart::Hull { vertices: hull.vertices().to_vec(), faces: hull.faces().to_vec() })
            .collect(),
    };
    solver::Object { parts, mass: object.mass(), center: object.center_of_mass(), inertia: object.inertia(), friction }
}

pub(crate) fn scenery(walls: &[Wall], friction: f64) -> solver::Scenery {
    solver::Scenery {
        table_side: TABLE_SIDE,
        table_thickness: TABLE_THICKNESS,
        table_height: TABLE_HEIGHT,
        walls: walls.to_vec(),
        friction,
    }
}
