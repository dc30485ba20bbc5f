//! Indices of names, or problems that list the names that exist.

use toml::Spanned;

use crate::error::ProblemKind;
use crate::model::Hand;
use crate::table::Reader;

/// Index of a name, or a problem that lists the names that exist.
pub(crate) fn find<'n>(
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

/// Index of an independent joint.
pub(super) fn find_joint(hand: &Hand, name: &Spanned<String>, reader: &mut Reader<'_, '_>) -> Option<usize> {
    let index = find(name, "joint", hand.joints.iter().map(|j| &j.name), reader)?;
    let is = match hand.joints[index].mimic {
        _ if hand.joints[index].is_fixed() => "is fixed".to_owned(),
        Some(mimic) => format!("follows joint \"{}\"", hand.joints[mimic.joint].name),
        None => return Some(index),
    };
    reader.add(name, ProblemKind::NotIndependent { name: name.get_ref().clone(), is });
    None
}
