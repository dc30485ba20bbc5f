//! Actuators and their transmissions; nothing is moved twice.

use crate::error::ProblemKind;
use crate::model::{Actuator, Drive, DrivenJoint, Hand, JointKind, Transmission};
use crate::table::{ActuatorTable, DrivenTable, HandTable, Item, Named, Number, Reader};
use toml::Spanned;

use super::joints::spring_and_damper;
use super::names::{find, find_joint};

/// Units of the numbers of an actuator.
struct Units {
    position: &'static str,
    speed: &'static str,
    ratio: &'static str,
    load: &'static str,
    gain: &'static str,
}

const SPOOL: Units = Units { position: "rad", speed: "rad/s", ratio: "1", load: "N", gain: "rad/(s N)" };
const REVOLUTE: Units = Units { position: "rad", speed: "rad/s", ratio: "1", load: "N m", gain: "rad/(s N m)" };
const PRISMATIC: Units = Units { position: "m", speed: "m/s", ratio: "rad/m", load: "N", gain: "m/(s N)" };

/// Reads the actuators; `None` where a name cannot be resolved.
pub(super) fn read(hand: &mut Hand, table: &HandTable, reader: &mut Reader<'_, '_>) -> Option<()> {
    for (i, written) in table.actuators.iter().enumerate() {
        let name = written.name.get_ref();
        if table.actuators[..i].iter().any(|other| other.name.get_ref() == name) {
            reader.add(&written.name, ProblemKind::Duplicate { what: "actuator", name: name.clone() });
        }
        let transmission = read_transmission(hand, written, reader)?;
        let units = match transmission {
            Transmission::Spool { .. } => SPOOL,
            Transmission::Joints { ref joints, .. } => {
                let prismatic = joints.iter().any(|driven| hand.joints[driven.joint].kind == JointKind::Prismatic);
                if prismatic { PRISMATIC } else { REVOLUTE }
            }
        };
        let item: Item<'_> = ("actuator", name);
        let actuator = Actuator {
            name: name.clone(),
            transmission,
            travel: reader.interval(item, "travel", &written.travel, units.position),
            default_speed: reader.positive(item, "default_speed", &written.default_speed, units.speed),
            max_speed: reader.positive(item, "max_speed", &written.max_speed, units.speed),
            ratio: reader.positive(item, "ratio", &written.ratio, units.ratio),
            load_limit: reader.positive(item, "load_limit", &written.load_limit, units.load),
            force_gain: reader.positive(item, "force_gain", &written.force_gain, units.gain),
        };
        if actuator.default_speed > actuator.max_speed {
            let (value, must) = (actuator.default_speed, "at most max_speed");
            let (item, name, quantity) = ("actuator", name.clone(), "default_speed");
            reader.add(&written.default_speed, ProblemKind::Value { item, name, quantity, value, must });
        }
        hand.actuators.push(actuator);
    }
    check_spools(hand, table, reader);
    check_joints(hand, table, reader);
    Some(())
}

fn read_transmission(hand: &Hand, written: &ActuatorTable, reader: &mut Reader<'_, '_>) -> Option<Transmission> {
    let item: Item<'_> = ("actuator", written.name.get_ref());
    match (&written.spool, &written.rigid, &written.servo) {
        (Some(spool), None, None) => {
            let tendon = find(&spool.tendon, "tendon", hand.tendons.iter().map(|tendon| &tendon.name), reader)?;
            Some(Transmission::Spool { tendon, radius: reader.positive(item, "radius", &spool.radius, "m") })
        }
        (None, Some(rigid), None) => {
            let (joints, _) = read_driven(hand, &written.name, &rigid.joints, reader)?;
            Some(Transmission::Joints { joints, drive: Drive::Rigid })
        }
        (None, None, Some(servo)) => {
            let (joints, kind) = read_driven(hand, &written.name, &servo.joints, reader)?;
            let (stiffness, damping) = spring_and_damper(item, kind, &servo.stiffness, &servo.damping, reader);
            Some(Transmission::Joints { joints, drive: Drive::Servo { stiffness, damping } })
        }
        (spool, rigid, servo) => {
            let count = usize::from(spool.is_some()) + usize::from(rigid.is_some()) + usize::from(servo.is_some());
            let tables = "the tables spool, rigid and servo";
            let (item, name) = (item.0, item.1.to_owned());
            reader.add(&written.name, ProblemKind::OneOf { item, name, count, tables });
            None
        }
    }
}

/// The joints that an actuator drives, and their kind.
fn read_driven(
    hand: &Hand,
    name: &Spanned<String>,
    written: &Named<DrivenTable>,
    reader: &mut Reader<'_, '_>,
) -> Option<(Vec<DrivenJoint>, JointKind)> {
    let mut joints = Vec::with_capacity(written.len());
    for (joint, driven) in written {
        let index = find_joint(hand, joint, reader)?;
        let ratio = reader.value("ratio", &driven.ratio, "1");
        if ratio == 0.0 {
            let (item, name, must) = ("joint", joint.get_ref().clone(), "other than 0");
            reader.add(&driven.ratio, ProblemKind::Value { item, name, quantity: "ratio", value: ratio, must });
        }
        let unit = hand.joints[index].kind.unit();
        let read = |number: &Number<f64>| reader.value("offset", number, unit);
        let offset = driven.offset.as_ref().map_or(0.0, read);
        joints.push(DrivenJoint { joint: index, ratio, offset });
    }
    joints.sort_by_key(|driven| driven.joint);
    let Some(kind) = joints.first().map(|driven| hand.joints[driven.joint].kind) else {
        reader.add(name, ProblemKind::Empty("joints of an actuator"));
        return None;
    };
    if joints.iter().any(|driven| hand.joints[driven.joint].kind != kind) {
        reader.add(name, ProblemKind::MixedKinds { item: "actuator", name: name.get_ref().clone() });
    }
    Some((joints, kind))
}

/// Every tendon is wound by one spool.
fn check_spools(hand: &Hand, table: &HandTable, reader: &mut Reader<'_, '_>) {
    for (index, name) in table.tendons.keys().enumerate() {
        let winds = |actuator: &&Actuator| matches!(actuator.transmission, Transmission::Spool { tendon, .. } if tendon == index);
        let count = hand.actuators.iter().filter(winds).count();
        if count != 1 {
            reader.add(name, ProblemKind::SpoolCount { name: name.get_ref().clone(), count });
        }
    }
}

/// No joint is driven twice, and one that is driven rigidly has neither spring nor tendon.
fn check_joints(hand: &Hand, table: &HandTable, reader: &mut Reader<'_, '_>) {
    let mut driver: Vec<Option<usize>> = vec![None; hand.joints.len()];
    for (index, (actuator, written)) in hand.actuators.iter().zip(&table.actuators).enumerate() {
        let Transmission::Joints { joints, drive } = &actuator.transmission else { continue };
        for driven in joints {
            let name = hand.joints[driven.joint].name.clone();
            if driver[driven.joint].replace(index).is_some() {
                reader.add(&written.name, ProblemKind::UsedTwice { what: "joint", name, by: "[[actuators]]" });
                continue;
            }
            let spring = hand.groups.iter().any(|group| group.joints.contains(&driven.joint));
            let tendon = hand.tendons.iter().any(|tendon| tendon.arms.iter().any(|(joint, _)| *joint == driven.joint));
            let useless = [(spring, "its table in [joints]"), (tendon, "a tendon")];
            for (_, what) in useless.into_iter().filter(|(given, _)| *given && *drive == Drive::Rigid) {
                let (name, actuator) = (name.clone(), actuator.name.clone());
                reader.add(&written.name, ProblemKind::Rigid { name, actuator, what });
            }
        }
    }
}
