//! Mutated descriptions: never a panic, and a hand only where the numbers are a hand's.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_hand::assets::ASSETS;
use graspbox_hand::{Hand, HandError};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Insertions of a mutation: the words and signs with a meaning in the two formats.
const WORDS: [&str; 34] = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "1e-308",
    "\"",
    "<",
    ">",
    "/>",
    "[",
    "]",
    "{",
    "}",
    "=",
    "\n",
    "\u{0}",
    "\u{fffd}",
    "&amp;",
    "<link name=\"base\">",
    "value",
    "0 0 0",
    "floating",
    "continuous",
    "<inertial/>",
    "<visual>",
    "<limit lower=\"-1\" upper=\"1\"/>",
    "<mimic joint=\"preshape_1\" multiplier=\"-1\"/>",
    "<a:b c:d=\"\">",
    "<link name=\"frame\"/>",
    "<joint name=\"f\" type=\"fixed\"><parent link=\"base\"/><child link=\"frame\"/></joint>",
    "<capsule radius=\"0.01\" length=\"0.02\"/>",
    "<mesh filename=\"a\"/>",
    "ixx=\"0\" a",
];

/// One to four random edits: delete, repeat, overwrite, insert a word.
fn mutate(text: &str, rng: &mut ChaCha8Rng) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..rng.random_range(1..=4) {
        let at = rng.random_range(0..bytes.len());
        let end = (at + rng.random_range(1..=40usize)).min(bytes.len());
        match rng.random_range(0..4u8) {
            0 => drop(bytes.drain(at..end)),
            1 => {
                let copy = bytes[at..end].to_vec();
                let to = rng.random_range(0..=bytes.len());
                bytes.splice(to..to, copy);
            }
            2 => bytes[at] = rng.random(),
            _ => {
                let word = WORDS[rng.random_range(0..WORDS.len())];
                let end = if rng.random_bool(0.5) { end.min(at + word.len()) } else { at };
                bytes.splice(at..end, word.bytes());
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// A URDF without masses and inertias, whose shapes are for display.
fn bare(urdf: &str) -> String {
    let mut text = urdf.replace("collision", "visual");
    while let Some((before, rest)) = text.split_once("<inertial>") {
        let after = rest.split_once("</inertial>").unwrap().1;
        text = format!("{before}{after}");
    }
    text
}

/// How many files to mutate: `GRASPBOX_FUZZ_ROUNDS`, else 2000 (2 s).
fn rounds() -> usize {
    std::env::var("GRASPBOX_FUZZ_ROUNDS").map_or(2000, |n| n.parse().unwrap())
}

#[test]
fn mutated_files_never_panic_and_never_make_an_impossible_hand() {
    let mut rng = ChaCha8Rng::seed_from_u64(0x4a9d);
    let (mut refused, mut accepted) = (0, 0);
    let bare = ASSETS.map(|asset| bare(asset.urdf));
    for round in 0..rounds() {
        let both = round % 3 == 0;
        let asset = &ASSETS[round % ASSETS.len()];
        // Every other file says less than it might.
        let whole = if round % 2 == 0 { asset.urdf } else { &bare[round % ASSETS.len()] };
        let urdf = if both || round % 3 == 1 { mutate(whole, &mut rng) } else { whole.to_owned() };
        let toml = if both || round % 3 == 2 { mutate(asset.toml, &mut rng) } else { asset.toml.to_owned() };
        match Hand::from_strs(&urdf, &toml, ["hand.urdf", "hand.toml"]) {
            Ok(hand) => {
                accepted += 1;
                assert_sound(&hand);
            }
            Err(HandError::Invalid(problems)) => {
                refused += 1;
                let lines = [urdf.split('\n').count(), toml.split('\n').count()];
                assert!(!problems.0.is_empty(), "refused without a reason");
                if let Some(tree) = graspbox_hand::read_urdf_anyway(&urdf) {
                    assert_eq!(tree.0.len(), tree.1.len() + 1);
                }
                if let Ok(found) = graspbox_hand::urdf_meshes(&urdf, "hand.urdf") {
                    assert!(found.meshes.iter().all(|mesh| urdf[mesh.span.clone()].ends_with('>')));
                    assert!(found.unnamed.iter().all(|(byte, _)| urdf.is_char_boundary(*byte)));
                }
                for p in &problems.0 {
                    let last = lines[usize::from(p.file == "hand.toml")];
                    assert!((1..=last).contains(&p.line), "{p} is past the end of the file, {last}");
                }
            }
            Err(other) => panic!("{other}"),
        }
    }
    assert!(refused > 500 && accepted > 50, "{refused} refused, {accepted} accepted");
}

fn assert_sound(hand: &Hand) {
    let limits = hand.preshape_limits();
    for preshape in limits {
        for pose in hand.forward_kinematics(&hand.open_configuration(preshape)).unwrap() {
            assert!(pose.to_homogeneous().iter().all(|x| x.is_finite() && x.abs() < 1e3));
        }
    }
    for first in (0..hand.links.len()).filter(|link| hand.carrier(*link) == *link) {
        let body =
            || hand.links.iter().enumerate().filter(|(link, _)| hand.carrier(*link) == first).map(|(_, link)| link);
        assert!(body().any(|link| link.mass > 0.0), "nothing of the body of {} has mass", hand.links[first].name);
        for link in body() {
            let moments = link.inertia.symmetric_eigenvalues();
            let possible = moments.min() > 0.0 && 2.0 * moments.max() <= moments.sum() * (1.0 + 1e-2);
            assert!(if link.mass == 0.0 { link.inertia.norm() == 0.0 } else { possible }, "{}: {moments}", link.name);
        }
    }
    for joint in hand.joints.iter().filter(|joint| !joint.is_fixed()) {
        let Some(mimic) = joint.mimic else { continue };
        let ends = hand.joints[mimic.joint].limits.map(|end| mimic.ratio * end + mimic.offset);
        assert!(
            ends.iter().all(|end| (joint.limits[0] - 1e-9..=joint.limits[1] + 1e-9).contains(end)),
            "{}",
            joint.name
        );
    }
    assert!(
        hand.tendons
            .iter()
            .all(|t| t.max_tension > 0.0 && t.arms.iter().all(|(j, _)| hand.joints[*j].is_independent()))
    );
    assert!(hand.sensors.iter().all(|s| s.link < hand.links.len()));
    assert!(
        hand.grasp.closing.iter().all(|actuator| *actuator < hand.actuators.len()) && !hand.grasp.closing.is_empty()
    );
    assert!(hand.preshapes().iter().all(|named| (limits[0]..=limits[1]).contains(&named.value)));
}
