//! Combines the two files: resolves names, checks numbers, builds the hand.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use toml::Spanned;

use crate::error::ProblemKind;
use crate::model::{Finger, Flexure, Friction, Hand, Material, Motor, MotorKind, TactileSensor, Tendon};
use crate::table::{FingerTable, FlexureTable, HandTable, Item, Number, Reader, TendonTable};
use crate::urdf::Tree;

/// Largest number of fingers.
const MAX_FINGERS: usize = 16;
/// Largest number of pads: one per collider that a URDF may have.
const MAX_PADS: usize = 256;
/// Largest number of tactile sensors.
const MAX_SENSORS: usize = 1024;
/// Value of `drives` for the preshape motor.
const PRESHAPE: &str = "preshape";

/// Builds the hand and records every problem; the result may be used only if there are none.
///
/// `None` where the fingers cannot be resolved.
pub(crate) fn assemble(tree: Tree, table: &HandTable, reader: &mut Reader<'_, '_>) -> Option<Hand> {
    check_counts(table, reader)?;
    let mut hand = Hand {
        name: table.name.get_ref().clone(),
        links: tree.links,
        joints: tree.joints,
        fingers: Vec::new(),
        motors: Vec::new(),
        sensors: Vec::new(),
        base_from_hand: pose(&table.base_from_hand.xyz, &table.base_from_hand.rpy, reader),
        preshape_limits: preshape_limits(table, reader),
        friction: Friction {
            pad: reader.not_negative(("material", "pad"), "friction", &table.friction.pad, "1"),
            bare: reader.not_negative(("material", "bare"), "friction", &table.friction.bare, "1"),
        },
    };
    set_pads(&mut hand, &table.pads, reader);
    let tendons = tendons(table, reader);
    let flexures = flexures(table, reader);
    if table.fingers.is_empty() {
        reader.add(&table.name, ProblemKind::Empty("fingers"));
    }
    for finger in &table.fingers {
        if let Some(finger) = read_finger(&hand, finger, &tendons, &flexures, reader) {
            hand.fingers.push(finger);
        }
    }
    if hand.fingers.len() < table.fingers.len() {
        return None;
    }
    check_fingers(&hand, table, reader);
    read_motors(&mut hand, table, reader);
    read_sensors(&mut hand, table, reader);
    Some(hand)
}

/// Checks the numbers of parts, so that the work and the list of problems stay bounded.
fn check_counts(table: &HandTable, reader: &mut Reader<'_, '_>) -> Option<()> {
    let counts = [
        ("pads", table.pads.len(), MAX_PADS),
        ("tendons", table.tendons.len(), MAX_FINGERS),
        ("flexures", table.flexures.len(), MAX_FINGERS),
        ("fingers", table.fingers.len(), MAX_FINGERS),
        ("motors", table.motors.len(), MAX_FINGERS + 1),
        ("sensors", table.sensors.iter().map(|s| s.links.len().max(1)).sum(), MAX_SENSORS),
    ];
    let too_many = counts.into_iter().find(|&(_, count, limit)| count > limit);
    if let Some((what, count, limit)) = too_many {
        reader.add(&table.name, ProblemKind::TooMany { what, count, limit });
    }
    too_many.is_none().then_some(())
}

fn pose(xyz: &Number<[f64; 3]>, rpy: &Number<[f64; 3]>, reader: &mut Reader<'_, '_>) -> Isometry3<f64> {
    let xyz = reader.value("position", xyz, "m");
    let [roll, pitch, yaw] = reader.value("roll, pitch, yaw", rpy, "rad");
    Isometry3::from_parts(Translation3::from(xyz), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

/// Limits of the preshape; `[0, 0]` for a hand without swivels.
fn preshape_limits(table: &HandTable, reader: &mut Reader<'_, '_>) -> [f64; 2] {
    let name = table.name.get_ref();
    if let Some(preshape) = &table.preshape {
        return reader.interval(("hand", name), "preshape limits", &preshape.limits, "rad");
    }
    if let Some(swivel) = table.fingers.iter().find_map(|f| f.swivel.as_ref()) {
        let missing = "preshape limits, which its swivels need";
        reader.add(&swivel.joint, ProblemKind::Missing { item: "hand", name: name.clone(), missing });
    }
    [0.0, 0.0]
}

fn set_pads(hand: &mut Hand, pads: &[Spanned<String>], reader: &mut Reader<'_, '_>) {
    let known: Vec<String> = hand.links.iter().flat_map(|l| &l.colliders).map(|c| c.name.clone()).collect();
    for pad in pads {
        let mut colliders = hand.links.iter_mut().flat_map(|l| &mut l.colliders);
        match colliders.find(|c| c.name == *pad.get_ref()) {
            Some(collider) if collider.material == Material::Pad => {
                reader.add(pad, ProblemKind::Duplicate { what: "pad", name: pad.get_ref().clone() });
            }
            Some(collider) => collider.material = Material::Pad,
            None => {
                let name = pad.get_ref().clone();
                reader.add(pad, ProblemKind::Unknown { what: "collider", name, known: known.clone() });
            }
        }
    }
}

fn tendons(table: &HandTable, reader: &mut Reader<'_, '_>) -> BTreeMap<String, Tendon> {
    let read = |(name, t): (&String, &TendonTable)| {
        let item: Item<'_> = ("tendon", name);
        let tendon = Tendon {
            proximal_arm: reader.positive(item, "proximal_arm", &t.proximal_arm, "m"),
            distal_arm: reader.positive(item, "distal_arm", &t.distal_arm, "m"),
            spool_radius: reader.positive(item, "spool_radius", &t.spool_radius, "m"),
            stiffness: reader.positive(item, "stiffness", &t.stiffness, "N/m"),
            damping: reader.not_negative(item, "damping", &t.damping, "N s/m"),
            max_tension: reader.positive(item, "max_tension", &t.max_tension, "N"),
        };
        (name.clone(), tendon)
    };
    table.tendons.iter().map(read).collect()
}

fn flexures(table: &HandTable, reader: &mut Reader<'_, '_>) -> BTreeMap<String, Flexure> {
    let read = |(name, t): (&String, &FlexureTable)| {
        let item: Item<'_> = ("flexure", name);
        let flexure = Flexure {
            stiffness: reader.not_negative(item, "stiffness", &t.stiffness, "N m/rad"),
            rest: reader.value("rest", &t.rest, "rad"),
            proximal_stiffness: reader.not_negative(item, "proximal_stiffness", &t.proximal_stiffness, "N m/rad"),
            proximal_rest: reader.value("proximal_rest", &t.proximal_rest, "rad"),
            distal_damping: reader.not_negative(item, "distal_damping", &t.distal_damping, "N m s/rad"),
            proximal_damping: reader.not_negative(item, "proximal_damping", &t.proximal_damping, "N m s/rad"),
            armature: reader.not_negative(item, "armature", &t.armature, "kg m2"),
            stop_stiffness: reader.not_negative(item, "stop_stiffness", &t.stop_stiffness, "N m/rad"),
        };
        (name.clone(), flexure)
    };
    table.flexures.iter().map(read).collect()
}

/// Index of a name, or a problem that lists the names that exist.
fn find<'n>(
    name: &Spanned<String>,
    what: &'static str,
    names: impl Iterator<Item = &'n String>,
    reader: &mut Reader<'_, '_>,
) -> Option<usize> {
    let known: Vec<String> = names.cloned().collect();
    let found = known.iter().position(|n| n == name.get_ref());
    if found.is_none() {
        reader.add(name, ProblemKind::Unknown { what, name: name.get_ref().clone(), known });
    }
    found
}

/// Index of a revolute joint.
fn find_joint(hand: &Hand, name: &Spanned<String>, reader: &mut Reader<'_, '_>) -> Option<usize> {
    let index = find(name, "joint", hand.joints.iter().map(|j| &j.name), reader)?;
    if hand.joints[index].fixed {
        reader.add(name, ProblemKind::FixedJoint(name.get_ref().clone()));
        return None;
    }
    Some(index)
}

fn read_finger(
    hand: &Hand,
    table: &FingerTable,
    tendons: &BTreeMap<String, Tendon>,
    flexures: &BTreeMap<String, Flexure>,
    reader: &mut Reader<'_, '_>,
) -> Option<Finger> {
    let mut swivel = Some(None);
    if let Some(s) = &table.swivel {
        let sign = reader.value("sign", &s.sign, "1");
        if sign.abs() != 1.0 {
            let (item, name, quantity, must) = ("finger", table.name.get_ref().clone(), "sign", "1 or -1");
            reader.add(&s.sign, ProblemKind::Value { item, name, quantity, value: sign, must });
        }
        swivel = find_joint(hand, &s.joint, reader).map(|j| Some((j, sign)));
    }
    let proximal = find_joint(hand, &table.proximal, reader);
    let distal = find_joint(hand, &table.distal, reader);
    let tendon = find(&table.tendon, "tendon", tendons.keys(), reader);
    let flexure = find(&table.flexure, "flexure", flexures.keys(), reader);
    Some(Finger {
        name: table.name.get_ref().clone(),
        swivel: swivel?,
        proximal: proximal?,
        distal: distal?,
        tendon: *tendons.values().nth(tendon?)?,
        flexure: *flexures.values().nth(flexure?)?,
        motor: 0,
    })
}

/// Checks that names are unique, joints used once and in order, and swivel limits cover the preshape range.
fn check_fingers(hand: &Hand, table: &HandTable, reader: &mut Reader<'_, '_>) {
    let mut used = vec![false; hand.joints.len()];
    let pairs = hand.fingers.iter().zip(&table.fingers);
    for (i, (finger, written)) in pairs.enumerate() {
        let name = written.name.get_ref();
        if name == PRESHAPE || hand.fingers[..i].iter().any(|f| f.name == *name) {
            reader.add(&written.name, ProblemKind::Duplicate { what: "finger", name: name.clone() });
        }
        for joint in finger.owned() {
            if std::mem::replace(&mut used[joint], true) {
                reader.add(&written.name, ProblemKind::UsedTwice(hand.joints[joint].name.clone()));
            }
        }
        let chain: Vec<usize> = finger.owned().collect();
        for pair in chain.windows(2) {
            if !hand.is_below(pair[1], pair[0]) {
                let [parent, child] = [pair[0], pair[1]].map(|j| hand.joints[j].name.clone());
                reader.add(&written.name, ProblemKind::Chain { parent, child });
            }
        }
        if let (Some((joint, sign)), Some(swivel)) = (finger.swivel, &written.swivel) {
            let [lower, upper] = hand.joints[joint].limits;
            if hand.preshape_limits.iter().any(|theta| !(lower - 1e-9..=upper + 1e-9).contains(&(sign * theta))) {
                let (quantity, must) = ("limit", "it must hold sign times the preshape limits");
                let name = hand.joints[joint].name.clone();
                let kind = ProblemKind::Interval { item: "joint", name, quantity, lower, upper, must };
                reader.add(&swivel.joint, kind);
            }
        }
    }
}

fn read_motors(hand: &mut Hand, table: &HandTable, reader: &mut Reader<'_, '_>) {
    let drivable: Vec<String> = hand.fingers.iter().map(|f| f.name.clone()).chain([PRESHAPE.to_owned()]).collect();
    let mut count = vec![0usize; drivable.len()];
    for (i, m) in table.motors.iter().enumerate() {
        let name = m.name.get_ref();
        if table.motors[..i].iter().any(|other| other.name.get_ref() == name) {
            reader.add(&m.name, ProblemKind::Duplicate { what: "motor", name: name.clone() });
        }
        let Some(driven) = find(&m.drives, "finger", drivable.iter(), reader) else {
            continue;
        };
        count[driven] += 1;
        let (kind, load, gain) = match hand.fingers.get_mut(driven) {
            Some(finger) => {
                finger.motor = hand.motors.len();
                (MotorKind::Finger(driven), "N", "rad/(s N)")
            }
            None => (MotorKind::Preshape, "N m", "rad/(s N m)"),
        };
        let item: Item<'_> = ("motor", name);
        let motor = Motor {
            name: name.clone(),
            kind,
            travel: reader.interval(item, "travel", &m.travel, "rad"),
            default_speed: reader.positive(item, "default_speed", &m.default_speed, "rad/s"),
            max_speed: reader.positive(item, "max_speed", &m.max_speed, "rad/s"),
            ratio: reader.positive(item, "ratio", &m.ratio, "1"),
            load_limit: reader.positive(item, "load_limit", &m.load_limit, load),
            force_gain: reader.positive(item, "force_gain", &m.force_gain, gain),
        };
        if motor.default_speed > motor.max_speed {
            let (quantity, must) = ("default_speed", "at most max_speed");
            let kind =
                ProblemKind::Value { item: "motor", name: name.clone(), quantity, value: motor.default_speed, must };
            reader.add(&m.default_speed, kind);
        }
        hand.motors.push(motor);
    }
    let swivels = hand.fingers.iter().any(|f| f.swivel.is_some());
    for (i, (drives, count)) in drivable.into_iter().zip(count).enumerate() {
        let needed = i < hand.fingers.len() || swivels;
        if count > 1 || (needed && count == 0) {
            let at = table.fingers.get(i).map_or(&table.name, |f| &f.name);
            reader.add(at, ProblemKind::MotorCount { drives, count });
        }
    }
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
            let Some(finger) = hand.finger_of_link(link) else {
                reader.add(name, ProblemKind::SensorLink(name.get_ref().clone()));
                continue;
            };
            sensors.push(TactileSensor { finger, link, position, normal: Unit::new_normalize(normal) });
        }
    }
    if sensors.len() > MAX_SENSORS {
        let count = sensors.len();
        reader.add(&table.name, ProblemKind::TooMany { what: "sensors", count, limit: MAX_SENSORS });
    }
    sensors.sort_by_key(|s| (s.finger, s.link));
    hand.sensors = sensors;
}
