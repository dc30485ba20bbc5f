//! Shapes of a hand that pass through each other: as its file says, and where links overlap in the open hand.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_hand::assets::ASSETS;
use graspbox_hand::{Hand, NoContact};

const URDF: &str = include_str!("fixtures/gripper.urdf");
const TOML: &str = include_str!("fixtures/gripper.toml");

/// The gripper with a box on its right finger, from `near` to 60 mm from the joint, and with further lines in its other file.
fn with(near: f64, lines: &str) -> Result<Hand, String> {
    let (length, middle) = (0.06 - near, 0.5 * (0.06 + near));
    let right = format!(
        "<link name=\"right\"><collision name=\"right_box\"><origin xyz=\"{middle} 0 0\"/><geometry><box size=\"{length} 0.02 0.01\"/></geometry></collision>"
    );
    let urdf = URDF.replacen("<link name=\"right\">", &right, 1);
    let toml = TOML.replacen("[friction]", &format!("{lines}\n[friction]"), 1);
    Hand::from_strs(&urdf, &toml, ["hand.urdf", "hand.toml"]).map_err(|error| error.to_string())
}

/// Link and index of a shape.
fn shape(hand: &Hand, name: &str) -> (usize, usize) {
    let of = |(link, l): (usize, &graspbox_hand::Link)| {
        l.colliders.iter().position(|collider| collider.name == name).map(|shape| (link, shape))
    };
    hand.links.iter().enumerate().find_map(of).unwrap()
}

/// Golden results of these hands depend on every contact.
#[test]
fn shapes_of_the_hands_of_the_project_do_not_overlap() {
    for asset in &ASSETS {
        assert_eq!(asset.read().unwrap().no_contact, NoContact::default(), "{}", asset.name);
    }
}

#[test]
fn lists_name_links_and_shapes_that_do_not_touch() {
    let hand = with(0.0, "no_contact = [[\"left\", \"right_box\"]]").unwrap();
    let [left, ball, right] = ["left_box", "left_ball", "right_box"].map(|name| shape(&hand, name));
    assert_eq!(hand.no_contact.shapes, [[left, right]]);
    assert!(!hand.shapes_touch(left, right) && !hand.shapes_touch(right, left));
    assert!(hand.shapes_touch(ball, right));
    // Of more than two names no two touch.
    let hand = with(0.0, "no_contact = [[\"left\", \"left_tip\", \"right\"]]").unwrap();
    assert_eq!(hand.no_contact.shapes, [[left, ball], [left, right], [ball, right]]);
}

#[test]
fn wrong_lists_are_named() {
    let error = |list: &str| with(0.0, &format!("no_contact = [{list}]")).unwrap_err();
    let unknown = error("[\"left\", \"ritgh\"]");
    let expected = "hand.toml:4: there is no link or collider \"ritgh\"; known: palm, left, left_tip, right";
    assert!(unknown.contains(expected), "{unknown}");
    let alone = error("[\"left\"]");
    assert!(alone.contains("hand.toml:4: a list of `no_contact` has 1 name(s); give at least two"), "{alone}");
    let twice = error("[\"left\", \"right\", \"left\"]");
    assert!(twice.contains("\"left\" is named more than once by a list of `no_contact`"), "{twice}");
    let many = vec!["[\"left\", \"right\"]"; 2049].join(", ");
    assert!(error(&many).contains("there are 4098 names in `no_contact`; at most 4096 are allowed"));
}

/// The right finger reaches past its joint into the left one, whose box begins 60 mm away.
#[test]
fn links_that_overlap_in_the_open_hand_pass_through_each_other() {
    for (near, overlaps) in [(0.0, false), (-0.0599, false), (-0.0601, false), (-0.061, true)] {
        let hand = with(near, "").unwrap();
        let found = &hand.no_contact.overlapping;
        assert_eq!(found.contains(&[1, 3]), overlaps, "{near}: {found:?}");
        assert_eq!(hand.shapes_touch(shape(&hand, "left_box"), shape(&hand, "right_box")), !overlaps);
        assert!(hand.shapes_touch(shape(&hand, "left_ball"), shape(&hand, "right_box")));
    }
    // A list that has the pair leaves nothing to find.
    let hand = with(-0.061, "no_contact = [[\"left\", \"right\"]]").unwrap();
    assert_eq!((hand.no_contact.shapes.len(), hand.no_contact.overlapping.len()), (1, 0));
}
