//! Hand, object and scenery in the solver's words.

use crate::object::{Geometry, ObjectModel};
use crate::scenery::{TABLE_HEIGHT, TABLE_SIDE, TABLE_THICKNESS};
use graspbox_hand::{Finger, Hand, Link, MotorKind, MotorState, Shape};
use graspbox_solver as solver;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

/// Where links and joints of the hand are in the solver's tree.
pub(crate) struct Translation {
    /// Body of each link.
    body: Vec<usize>,
    /// Each link in its body: links that hang on others by fixed joints are one body with them.
    pub body_from_link: Vec<Isometry3<f64>>,
    /// For each body the link and the index in it of every shape.
    shapes: Vec<Vec<(usize, usize)>>,
    /// Coordinate, ratio and offset of each joint; none for a fixed one.
    pub joints: Vec<Option<(usize, f64, f64)>>,
}

impl Translation {
    /// Link, and shape within it, of a body's shape.
    pub fn owner(&self, body: usize, shape: usize) -> (usize, usize) {
        self.shapes[body][shape]
    }

    /// Where the motors put the driven coordinates and the tendons.
    pub fn drive(&self, hand: &Hand, motors: &[MotorState], driven: &mut [f64], given: &mut [solver::Given]) {
        for (motor, state) in hand.motors.iter().zip(motors) {
            match motor.kind {
                MotorKind::Preshape => driven.fill(hand.preshape_angle(state.position)),
                MotorKind::Finger(finger) => {
                    let radius = hand.fingers[finger].tendon.spool_radius;
                    given[finger] = solver::Given { length: radius * state.position, rate: radius * state.velocity };
                }
            }
        }
    }
}

/// The hand as a tree, with the coordinates of each finger one after the other.
pub(crate) fn hand(hand: &Hand) -> (solver::Tree, Translation) {
    let mut tree = solver::Tree::default();
    let mut coordinate_of = vec![None; hand.joints.len()];
    for finger in &hand.fingers {
        for (joint, coordinate) in [(finger.proximal, proximal(hand, finger)), (finger.distal, distal(hand, finger))] {
            coordinate_of[joint] = Some((tree.coordinates.len(), 1.0, 0.0));
            tree.coordinates.push(coordinate);
        }
        let tendon = &finger.tendon;
        let first = tree.coordinates.len() - 2;
        tree.cables.push(solver::Cable {
            arms: vec![(first, tendon.proximal_arm), (first + 1, tendon.distal_arm)],
            stiffness: tendon.stiffness,
            damping: tendon.damping,
            max_force: tendon.max_tension,
            unilateral: true,
        });
    }
    let preshape = tree.coordinates.len();
    for (joint, sign) in hand.fingers.iter().filter_map(|f| f.swivel) {
        coordinate_of[joint] = Some((preshape, sign, 0.0));
        tree.driven = 1;
    }
    let translation = bodies(hand, &mut tree, coordinate_of);
    tree.pairs = pairs(hand, &translation);
    (tree, translation)
}

fn proximal(hand: &Hand, finger: &Finger) -> solver::Coordinate {
    let flexure = &finger.flexure;
    solver::Coordinate {
        armature: flexure.armature,
        damping: flexure.proximal_damping,
        stiffness: flexure.proximal_stiffness,
        spring_reference: flexure.proximal_rest,
        limits: hand.joints[finger.proximal].limits,
        stop_stiffness: flexure.stop_stiffness,
    }
}

fn distal(hand: &Hand, finger: &Finger) -> solver::Coordinate {
    let flexure = &finger.flexure;
    solver::Coordinate {
        armature: flexure.armature,
        damping: flexure.distal_damping,
        stiffness: flexure.stiffness,
        spring_reference: flexure.rest,
        limits: hand.joints[finger.distal].limits,
        stop_stiffness: flexure.stop_stiffness,
    }
}

/// One body per link that moves by itself.
fn bodies(hand: &Hand, tree: &mut solver::Tree, joints: Vec<Option<(usize, f64, f64)>>) -> Translation {
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
            let kind = solver::JointKind::Revolute;
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
    Translation { body, body_from_link, shapes, joints }
}

fn bare_body(parent: usize, joint: Option<solver::Joint>) -> solver::Body {
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

/// Adds a link's mass; the inertia is moved to the new common centre of mass.
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

fn primitive(shape: &Shape) -> solver::Primitive {
    match *shape {
        Shape::Cuboid(half) => solver::Primitive::Cuboid(half),
        Shape::Sphere { radius } => solver::Primitive::Sphere { radius },
        Shape::Cylinder { radius, half_length } => solver::Primitive::Cylinder { radius, half_length },
    }
}

/// Links of different fingers may touch, and the last one of each may touch the palm.
fn pairs(hand: &Hand, translation: &Translation) -> Vec<(usize, usize)> {
    let links =
        |finger: &Finger| [finger.proximal, finger.distal].map(|joint| translation.body[hand.joints[joint].child]);
    let mut pairs = Vec::new();
    for (index, finger) in hand.fingers.iter().enumerate() {
        pairs.push((links(finger)[1], 0));
        for other in &hand.fingers[index + 1..] {
            for a in links(finger) {
                pairs.extend(links(other).map(|b| (a, b)));
            }
        }
    }
    pairs
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

pub(crate) fn scenery(friction: f64) -> solver::Scenery {
    solver::Scenery { table_side: TABLE_SIDE, table_thickness: TABLE_THICKNESS, table_height: TABLE_HEIGHT, friction }
}
