//! Combines the two files: resolves names, checks numbers, builds the hand.
//!
//! | module | purpose |
//! |---|---|
//! | `joints` | springs and losses of joints, tendons |
//! | `actuators` | transmission of each actuator; nothing is moved twice |
//! | `grasp` | closing actuators and preshapes |
//! | `contact` | shapes that pass through each other |
//! | `names` | indices of names |

mod actuators;
mod contact;
mod grasp;
mod joints;
mod names;

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use toml::Spanned;

use crate::error::ProblemKind;
use crate::grasp::Grasp;
use crate::model::{Friction, Hand, Material, NoContact, TactileSensor};
use crate::table::{HandTable, Number, Reader};
use crate::urdf::Tree;
pub(crate) use names::find;

/// Largest number of tendons, of actuators, and of preshapes.
const MAX_PARTS: usize = 32;
/// Largest number of names in a list of joints.
const MAX_NAMES: usize = 64;
/// Largest number of pads: one per collider that a URDF may have.
const MAX_PADS: usize = 1024;
/// Largest number of names in all lists of `no_contact` together: two for every pair of links.
const MAX_APART: usize = 4096;
/// Largest number of tactile sensors.
const MAX_SENSORS: usize = 1024;

/// Builds the hand and records every problem; the result may be used only if there are none.
///
/// `None` where names cannot be resolved.
pub(crate) fn assemble(tree: Tree, table: &HandTable, reader: &mut Reader<'_, '_>) -> Option<Hand> {
    check_counts(table, reader)?;
    let mut hand = Hand {
        name: table.name.get_ref().clone(),
        links: tree.links,
        joints: tree.joints,
        groups: Vec::new(),
        tendons: Vec::new(),
        actuators: Vec::new(),
        sensors: Vec::new(),
        base_from_hand: pose(&table.grasp.xyz, &table.grasp.rpy, reader),
        grasp: Grasp::default(),
        friction: Friction {
            pad: reader.not_negative(("material", "pad"), "friction", &table.friction.pad, "1"),
            bare: reader.not_negative(("material", "bare"), "friction", &table.friction.bare, "1"),
        },
        assumptions: Vec::new(),
        no_contact: NoContact::default(),
        mount: table.mount.as_ref().map(|mount| pose(&mount.xyz, &mount.rpy, reader)),
        carrier: None,
    };
    set_pads(&mut hand, &table.pads, reader);
    read_sensors(&mut hand, table, reader);
    let groups = joints::read_groups(&mut hand, table, reader);
    let tendons = joints::read_tendons(&mut hand, table, reader);
    (groups && tendons).then_some(())?;
    if table.actuators.is_empty() {
        reader.add(&table.name, ProblemKind::Empty("actuators"));
    }
    actuators::read(&mut hand, table, reader)?;
    grasp::read(&mut hand, table, reader)?;
    contact::read(&mut hand, table, reader);
    Some(hand)
}

/// Checks the numbers of parts, so that the work and the list of problems stay bounded.
fn check_counts(table: &HandTable, reader: &mut Reader<'_, '_>) -> Option<()> {
    let most = |counts: &mut dyn Iterator<Item = usize>| counts.max().unwrap_or(0);
    let named = most(&mut table.joints.values().map(|joint| joint.names.as_ref().map_or(1, Vec::len)));
    let spanned = most(&mut table.tendons.values().map(|tendon| tendon.arms.len()));
    let driven = most(&mut table.actuators.iter().map(|actuator| {
        let rigid = actuator.rigid.as_ref().map_or(0, |rigid| rigid.joints.len());
        rigid.max(actuator.servo.as_ref().map_or(0, |servo| servo.joints.len()))
    }));
    let counts = [
        ("pads", table.pads.len(), MAX_PADS),
        ("names in `no_contact`", table.no_contact.iter().map(|names| names.get_ref().len()).sum(), MAX_APART),
        ("tables of joints", table.joints.len(), MAX_NAMES),
        ("joints in a table", named, MAX_NAMES),
        ("tendons", table.tendons.len(), MAX_PARTS),
        ("joints on a tendon", spanned, MAX_NAMES),
        ("actuators", table.actuators.len(), MAX_PARTS),
        ("joints of an actuator", driven, MAX_NAMES),
        ("closing actuators", table.grasp.closing.len(), MAX_PARTS),
        ("preshapes", table.grasp.preshapes.len(), MAX_PARTS),
        ("sensors", table.sensors.iter().map(|s| s.links.len().max(1)).sum(), MAX_SENSORS),
    ];
    let too_many = counts.into_iter().find(|&(_, count, limit)| count > limit);
    if let Some((what, count, limit)) = too_many {
        reader.add(&table.name, ProblemKind::TooMany { what, count, limit });
    }
    too_many.is_none().then_some(())
}

pub(crate) fn pose(xyz: &Number<[f64; 3]>, rpy: &Number<[f64; 3]>, reader: &mut Reader<'_, '_>) -> Isometry3<f64> {
    let xyz = reader.value("position", xyz, "m");
    let [roll, pitch, yaw] = reader.value("roll, pitch, yaw", rpy, "rad");
    Isometry3::from_parts(Translation3::from(xyz), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

fn set_pads(hand: &mut Hand, pads: &[Spanned<String>], reader: &mut Reader<'_, '_>) {
    let known: Vec<String> = hand.links.iter().flat_map(|l| &l.colliders).map(|c| c.name.clone()).collect();
    for pad in pads {
        let name = pad.get_ref();
        let colliders = hand.links.iter_mut().flat_map(|l| &mut l.colliders);
        let named: Vec<_> = colliders.filter(|c| is_named(&c.name, name)).collect();
        if named.is_empty() {
            let name = name.clone();
            reader.add(pad, ProblemKind::Unknown { what: "collider", name, known: known.clone() });
        } else if named.iter().any(|collider| collider.material == Material::Pad) {
            reader.add(pad, ProblemKind::Duplicate { what: "pad", name: name.clone() });
        }
        named.into_iter().for_each(|collider| collider.material = Material::Pad);
    }
}

/// True for a collider of this name, and for one of the shapes that stand for a mesh of this name: `NAME.0`, `NAME.1`, ...
fn is_named(collider: &str, name: &str) -> bool {
    let number = collider.strip_prefix(name).and_then(|rest| rest.strip_prefix('.'));
    collider == name || number.is_some_and(|n| !n.is_empty() && n.bytes().all(|byte| byte.is_ascii_digit()))
}

fn read_sensors(hand: &mut Hand, table: &HandTable, reader: &mut Reader<'_, '_>) {
    let mut sensors = Vec::new();
    for (number, s) in table.sensors.iter().enumerate() {
        let position = Point3::from(reader.value("position", &s.position, "m"));
        let normal = Vector3::from(reader.value("normal", &s.normal, "1"));
        if (normal.norm() - 1.0).abs() > 1e-3 {
            let (name, quantity, must) = (format!("{}", number + 1), "length of the normal", "1 within 1e-3");
            let kind = ProblemKind::Value { item: "sensor", name, quantity, value: normal.norm(), must };
            reader.add(&s.normal, kind);
        }
        for name in &s.links {
            let Some(link) = find(name, "link", hand.links.iter().map(|l| &l.name), reader) else {
                continue;
            };
            sensors.push(TactileSensor { link, position, normal: Unit::new_normalize(normal) });
        }
    }
    if sensors.len() > MAX_SENSORS {
        let count = sensors.len();
        reader.add(&table.name, ProblemKind::TooMany { what: "sensors", count, limit: MAX_SENSORS });
    }
    sensors.sort_by_key(|s| s.link);
    hand.sensors = sensors;
}
