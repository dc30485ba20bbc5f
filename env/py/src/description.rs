//! A hand as plain values: dicts, lists and numbers, which `graspbox.hands.description` makes arrays and frozen classes of.

use crate::errors::CoreError;
use graspbox_hand::{
    Actuator as CoreActuator, Collider, Drive, Hand, Joint as CoreJoint, JointKind, Link as CoreLink, Material,
    Shape as Primitive, ShapeIndex, Transmission, read_urdf, read_urdf_anyway, urdf_meshes as find_meshes,
};
use nalgebra::Isometry3;
use pyo3::prelude::*;

/// Rows of a homogeneous matrix.
type Pose = [[f64; 4]; 4];

/// A hand. Parts refer to each other by their indices, and to a joint by that of the link that it moves.
#[derive(IntoPyObject)]
pub struct Description {
    name: String,
    links: Vec<Link>,
    tendons: Vec<Tendon>,
    actuators: Vec<Actuator>,
    sensors: Vec<Sensor>,
    base_from_hand: Pose,
    preshape: Option<usize>,
    preshape_limits: (f64, f64),
    /// Actuators and their positions in each preshape that has a name.
    named: Vec<Vec<(usize, f64)>>,
    /// Of pads, and of all other shapes.
    friction: (f64, f64),
    /// Names of each two shapes that pass through each other.
    no_contact: Vec<(String, String)>,
    /// First links of each two rigid bodies that overlap in the open hand.
    overlapping: Vec<(usize, usize)>,
}

/// A link, with the joint that moves it; the base has the parent -1, a joint without a name, and identity as its pose.
#[derive(IntoPyObject)]
pub struct Link {
    index: usize,
    name: String,
    mass: f64,
    center: [f64; 3],
    inertia: [[f64; 3]; 3],
    shapes: Vec<Shape>,
    parent: i64,
    parent_from_link: Pose,
    joint: String,
    kind: &'static str,
    axis: [f64; 3],
    limits: (f64, f64),
    effort: f64,
    velocity: f64,
    mimic: Option<(usize, f64, f64)>,
    encoder: bool,
    spring: Spring,
}

#[derive(IntoPyObject)]
struct Spring {
    stiffness: f64,
    reference: f64,
    damping: f64,
    armature: f64,
    stop_stiffness: f64,
}

#[derive(IntoPyObject)]
struct Shape {
    name: String,
    kind: &'static str,
    size: Vec<f64>,
    link_from_shape: Pose,
    pad: bool,
    friction: f64,
}

#[derive(IntoPyObject)]
struct Tendon {
    name: String,
    arms: Vec<(usize, f64)>,
    stiffness: f64,
    damping: f64,
    max_tension: f64,
}

#[derive(IntoPyObject)]
struct Actuator {
    name: String,
    spool: Option<(usize, f64)>,
    joints: Vec<(usize, f64, f64)>,
    servo: Option<(f64, f64)>,
    speed: f64,
    travel: (f64, f64),
    load_limit: f64,
    force_gain: f64,
    closes: bool,
}

#[derive(IntoPyObject)]
struct Sensor {
    link: usize,
    position: [f64; 3],
    normal: [f64; 3],
}

/// Links and joints of the text of a URDF, without friction, springs and losses; errors call it `name`.
///
/// With `anyway`, also where numbers are wrong, such as those in millimetres; None where there is no tree of links.
#[pyfunction]
#[pyo3(signature = (urdf, name, *, anyway=false))]
pub fn describe_urdf(urdf: &str, name: &str, anyway: bool) -> PyResult<Option<Vec<Link>>> {
    let found = if anyway { read_urdf_anyway(urdf) } else { Some(read_urdf(urdf, name).map_err(CoreError::from)?) };
    Ok(found.map(|(links, joints)| described(&links, &joints, |_| 0.0)))
}

/// A collision mesh of a URDF; `start` and `end` are bytes of its element in the text.
#[derive(IntoPyObject)]
pub struct MeshShape {
    name: String,
    line: usize,
    file: String,
    scale: (f64, f64, f64),
    link_from_mesh: Pose,
    element: String,
    start: usize,
    end: usize,
}

/// Meshes, and bytes at which names are inserted.
type FoundMeshes = (Vec<MeshShape>, Vec<(usize, String)>);

/// Collision meshes of the text of a URDF, which errors call `name`, and where shapes beside them get names: byte and name.
#[pyfunction]
pub fn urdf_meshes(urdf: &str, name: &str) -> PyResult<FoundMeshes> {
    let found = find_meshes(urdf, name).map_err(CoreError::from)?;
    let mesh = |mesh: graspbox_hand::MeshShape| MeshShape {
        name: mesh.name,
        line: mesh.line,
        file: mesh.file,
        scale: mesh.scale.into(),
        link_from_mesh: pose(&mesh.link_from_mesh),
        element: mesh.element,
        start: mesh.span.start,
        end: mesh.span.end,
    };
    Ok((found.meshes.into_iter().map(mesh).collect(), found.unnamed))
}

/// All of a hand.
pub fn describe(hand: &Hand) -> Description {
    let tendon = |tendon: &graspbox_hand::Tendon| Tendon {
        name: tendon.name.clone(),
        arms: tendon.arms.iter().map(|(joint, arm)| (joint + 1, *arm)).collect(),
        stiffness: tendon.stiffness,
        damping: tendon.damping,
        max_tension: tendon.max_tension,
    };
    let sensor = |sensor: &graspbox_hand::TactileSensor| Sensor {
        link: sensor.link,
        position: sensor.position.into(),
        normal: sensor.normal.into_inner().into(),
    };
    let shape_name = |(link, shape): ShapeIndex| hand.links[link].colliders[shape].name.clone();
    let actuators = hand.actuators.iter().enumerate();
    let mut links = described(&hand.links, &hand.joints, |material| hand.friction.of(material));
    for joint in hand.groups.iter().filter(|group| group.encoder).flat_map(|group| &group.joints) {
        links[joint + 1].encoder = true;
    }
    Description {
        name: hand.name.clone(),
        links,
        tendons: hand.tendons.iter().map(tendon).collect(),
        actuators: actuators.map(|(index, one)| actuator(one, hand.grasp.closing.contains(&index))).collect(),
        sensors: hand.sensors.iter().map(sensor).collect(),
        base_from_hand: pose(&hand.base_from_hand),
        preshape: hand.grasp.coordinate.map(|coordinate| coordinate.actuator),
        preshape_limits: hand.preshape_limits().into(),
        named: hand.grasp.preshapes.iter().map(|preshape| preshape.positions.clone()).collect(),
        friction: (hand.friction.pad, hand.friction.bare),
        no_contact: hand.no_contact.shapes.iter().map(|pair| pair.map(shape_name).into()).collect(),
        overlapping: hand.no_contact.overlapping.iter().map(|&pair| pair.into()).collect(),
    }
}

fn described(links: &[CoreLink], joints: &[CoreJoint], friction: impl Fn(Material) -> f64) -> Vec<Link> {
    let of = |(index, link): (usize, &CoreLink)| Link {
        index,
        name: link.name.clone(),
        mass: link.mass,
        center: link.center_of_mass.into(),
        inertia: std::array::from_fn(|i| std::array::from_fn(|j| link.inertia[(i, j)])),
        shapes: link.colliders.iter().map(|collider| shape(collider, friction(collider.material))).collect(),
        ..index.checked_sub(1).map_or_else(base, |joint| moved(&joints[joint]))
    };
    links.iter().enumerate().map(of).collect()
}

fn shape(collider: &Collider, friction: f64) -> Shape {
    let (kind, size) = match collider.shape {
        Primitive::Cuboid(half) => ("box", vec![half.x, half.y, half.z]),
        Primitive::Cylinder { radius, half_length } => ("cylinder", vec![radius, half_length]),
        Primitive::Sphere { radius } => ("sphere", vec![radius]),
    };
    let link_from_shape = pose(&collider.link_from_shape);
    Shape {
        name: collider.name.clone(),
        kind,
        size,
        link_from_shape,
        pad: collider.material == Material::Pad,
        friction,
    }
}

/// The base, which no joint moves, with the fields of only the joint.
fn base() -> Link {
    let spring = Spring { stiffness: 0.0, reference: 0.0, damping: 0.0, armature: 0.0, stop_stiffness: 0.0 };
    Link {
        index: 0,
        name: String::new(),
        mass: 0.0,
        center: [0.0; 3],
        inertia: [[0.0; 3]; 3],
        shapes: Vec::new(),
        parent: -1,
        parent_from_link: pose(&Isometry3::identity()),
        joint: String::new(),
        kind: "fixed",
        axis: [1.0, 0.0, 0.0],
        limits: (0.0, 0.0),
        effort: 0.0,
        velocity: 0.0,
        mimic: None,
        encoder: false,
        spring,
    }
}

/// A link with the fields of only its joint.
fn moved(joint: &CoreJoint) -> Link {
    Link {
        parent: joint.parent as i64,
        parent_from_link: pose(&joint.parent_from_joint),
        joint: joint.name.clone(),
        kind: match joint.kind {
            JointKind::Fixed => "fixed",
            JointKind::Revolute => "revolute",
            JointKind::Prismatic => "prismatic",
        },
        axis: joint.axis.into_inner().into(),
        limits: joint.limits.into(),
        effort: joint.effort,
        velocity: joint.velocity,
        mimic: joint.mimic.map(|mimic| (mimic.joint + 1, mimic.ratio, mimic.offset)),
        spring: Spring {
            stiffness: joint.stiffness,
            reference: joint.spring_reference,
            damping: joint.damping,
            armature: joint.armature,
            stop_stiffness: joint.stop_stiffness,
        },
        ..base()
    }
}

fn actuator(actuator: &CoreActuator, closes: bool) -> Actuator {
    let (mut spool, mut joints, mut servo) = (None, Vec::new(), None);
    match &actuator.transmission {
        Transmission::Spool { tendon, radius } => spool = Some((*tendon, *radius)),
        Transmission::Joints { joints: driven, drive } => {
            joints = driven.iter().map(|one| (one.joint + 1, one.ratio, one.offset)).collect();
            if let Drive::Servo { stiffness, damping } = *drive {
                servo = Some((stiffness, damping));
            }
        }
    }
    Actuator {
        name: actuator.name.clone(),
        spool,
        joints,
        servo,
        speed: actuator.default_speed,
        travel: actuator.travel.into(),
        load_limit: actuator.load_limit,
        force_gain: actuator.force_gain,
        closes,
    }
}

fn pose(pose: &Isometry3<f64>) -> Pose {
    let matrix = pose.to_homogeneous();
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]))
}
