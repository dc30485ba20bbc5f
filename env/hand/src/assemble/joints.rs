//! Springs and losses of joints, and tendons.

use crate::error::ProblemKind;
use crate::model::{Hand, JointGroup, JointKind, Tendon};
use crate::table::{HandTable, Item, JointTable, Reader, TendonTable};
use toml::Spanned;

use super::names::find_joint;

/// Units of the numbers of a joint.
struct Units {
    stiffness: &'static str,
    damping: &'static str,
    armature: &'static str,
}

fn units(kind: JointKind) -> Units {
    match kind {
        JointKind::Fixed | JointKind::Revolute => {
            Units { stiffness: "N m/rad", damping: "N m s/rad", armature: "kg m2" }
        }
        JointKind::Prismatic => Units { stiffness: "N/m", damping: "N s/m", armature: "kg" },
    }
}

/// Stiffness and damping of a spring and a damper along joints of a kind.
pub(super) fn spring_and_damper(
    item: Item<'_>,
    kind: JointKind,
    stiffness: &crate::table::Number<f64>,
    damping: &crate::table::Number<f64>,
    reader: &mut Reader<'_, '_>,
) -> (f64, f64) {
    let units = units(kind);
    (
        reader.positive(item, "stiffness", stiffness, units.stiffness),
        reader.not_negative(item, "damping", damping, units.damping),
    )
}

/// Reads the tables of joints; false where a name cannot be resolved.
pub(super) fn read_groups(hand: &mut Hand, table: &HandTable, reader: &mut Reader<'_, '_>) -> bool {
    let mut used = vec![false; hand.joints.len()];
    let mut resolved = true;
    for (name, group) in &table.joints {
        let own = std::slice::from_ref(name);
        let names = group.names.as_deref().unwrap_or(own);
        if names.is_empty() {
            reader.add(name, ProblemKind::Empty("names in a table of joints"));
        }
        let joints: Vec<Option<usize>> = names.iter().map(|joint| find_joint(hand, joint, reader)).collect();
        for (joint, written) in joints.iter().zip(names) {
            if joint.is_some_and(|joint| std::mem::replace(&mut used[joint], true)) {
                let name = written.get_ref().clone();
                reader.add(written, ProblemKind::UsedTwice { what: "joint", name, by: "[joints]" });
            }
        }
        let Some(joints) = joints.into_iter().collect::<Option<Vec<usize>>>() else {
            resolved = false;
            continue;
        };
        set_joints(hand, name, group, &joints, reader);
        hand.groups.push(JointGroup { name: name.get_ref().clone(), joints, encoder: group.encoder });
    }
    resolved
}

fn set_joints(
    hand: &mut Hand,
    name: &Spanned<String>,
    group: &JointTable,
    joints: &[usize],
    reader: &mut Reader<'_, '_>,
) {
    let item: Item<'_> = ("table of joints", name.get_ref());
    let kind = joints.first().map_or(JointKind::Revolute, |joint| hand.joints[*joint].kind);
    if joints.iter().any(|joint| hand.joints[*joint].kind != kind) {
        reader.add(name, ProblemKind::MixedKinds { item: item.0, name: item.1.to_owned() });
        return;
    }
    let units = units(kind);
    if group.stiffness.is_some() != group.spring_reference.is_some() {
        let missing = if group.stiffness.is_some() { "spring_reference" } else { "stiffness" };
        reader.add(name, ProblemKind::Missing { item: item.0, name: item.1.to_owned(), missing });
    }
    let stiffness =
        group.stiffness.as_ref().map_or(0.0, |number| reader.not_negative(item, "stiffness", number, units.stiffness));
    let reference = group.spring_reference.as_ref();
    let reference = reference.map_or(0.0, |number| reader.value("spring_reference", number, kind.unit()));
    let damping = reader.not_negative(item, "damping", &group.damping, units.damping);
    let armature = reader.not_negative(item, "armature", &group.armature, units.armature);
    let stops = reader.not_negative(item, "stop_stiffness", &group.stop_stiffness, units.stiffness);
    for joint in joints {
        let joint = &mut hand.joints[*joint];
        joint.stiffness = stiffness;
        joint.spring_reference = reference;
        joint.damping = damping;
        joint.armature = armature;
        joint.stop_stiffness = stops;
    }
}

/// Reads the tendons; false where a name cannot be resolved.
pub(super) fn read_tendons(hand: &mut Hand, table: &HandTable, reader: &mut Reader<'_, '_>) -> bool {
    for (name, tendon) in &table.tendons {
        match read_tendon(hand, name, tendon, reader) {
            Some(tendon) => hand.tendons.push(tendon),
            None => return false,
        }
    }
    true
}

fn read_tendon(
    hand: &Hand,
    name: &Spanned<String>,
    tendon: &TendonTable,
    reader: &mut Reader<'_, '_>,
) -> Option<Tendon> {
    let item: Item<'_> = ("tendon", name.get_ref());
    let mut arms = Vec::with_capacity(tendon.arms.len());
    for (joint, arm) in &tendon.arms {
        let joint = find_joint(hand, joint, reader)?;
        let unit = if hand.joints[joint].kind == JointKind::Prismatic { "1" } else { "m" };
        arms.push((joint, reader.value("arm", arm, unit)));
    }
    arms.sort_by_key(|(joint, _)| *joint);
    if arms.iter().all(|(_, arm)| *arm == 0.0) {
        reader.add(name, ProblemKind::Empty("arms of a tendon other than 0"));
    }
    Some(Tendon {
        name: name.get_ref().clone(),
        arms,
        stiffness: reader.positive(item, "stiffness", &tendon.stiffness, "N/m"),
        damping: reader.not_negative(item, "damping", &tendon.damping, "N s/m"),
        max_tension: reader.positive(item, "max_tension", &tendon.max_tension, "N"),
    })
}
