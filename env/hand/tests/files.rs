//! The two files of a hand: another hand loads, and what is wrong is named with file and line.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

use graspbox_hand::load::MAX_FILE_BYTES;
use graspbox_hand::reflex::{REFLEX_TOML, REFLEX_URDF};
use graspbox_hand::{Hand, HandError, Material, MotorKind, Shape};
use nalgebra::{Point3, Vector3};

const GRIPPER_URDF: &str = include_str!("fixtures/gripper.urdf");
const GRIPPER_TOML: &str = include_str!("fixtures/gripper.toml");

/// What is said about a hand made of these texts.
fn complaint(urdf: &str, toml: &str) -> String {
    match Hand::from_strs(urdf, toml, ["hand.urdf", "hand.toml"]) {
        Ok(_) => "valid".to_owned(),
        Err(HandError::Invalid(problems)) => problems.to_string(),
        Err(other) => panic!("{other}"),
    }
}

/// The same with one change to the gripper's URDF.
fn urdf_with(old: &str, new: &str) -> String {
    assert!(GRIPPER_URDF.contains(old), "{old}");
    complaint(&GRIPPER_URDF.replacen(old, new, 1), GRIPPER_TOML)
}

/// The same with one change to the gripper's TOML.
fn toml_with(old: &str, new: &str) -> String {
    assert!(GRIPPER_TOML.contains(old), "{old}");
    complaint(GRIPPER_URDF, &GRIPPER_TOML.replacen(old, new, 1))
}

#[test]
fn another_hand_loads_from_its_own_two_files() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let hand = Hand::load(&folder.join("gripper.urdf"), &folder.join("gripper.toml")).unwrap();
    assert_eq!(hand, Hand::from_strs(GRIPPER_URDF, GRIPPER_TOML, ["a", "b"]).unwrap());
    let names: Vec<_> = hand.links.iter().map(|l| l.name.as_str()).collect();
    assert_eq!(names, ["palm", "left", "left_tip", "right", "right_tip", "label"], "parents before children");
    assert_eq!((hand.preshape_limits, hand.preshape_motor()), ([0.0, 0.0], None));
    // Motors keep the order of the file; fingers know theirs.
    assert_eq!(hand.motors[0].kind, MotorKind::Finger(1));
    assert_eq!((hand.fingers[0].motor, hand.fingers[1].motor), (1, 0));
    assert!((hand.joints[0].axis.into_inner() + Vector3::y()).norm() < 1e-15, "axes are made unit vectors");
    assert!(hand.joints[4].fixed);
    // An inertial frame turned by a quarter about z exchanges the moments about x and y.
    assert!((hand.links[1].inertia.diagonal() - Vector3::new(2e-5, 3e-6, 1.8e-5)).norm() < 1e-12);
    let shapes: Vec<_> = hand.links.iter().flat_map(|l| &l.colliders).map(|c| (c.shape, c.material)).collect();
    let expected = [
        (Shape::Cylinder { radius: 0.03, half_length: 0.02 }, Material::Bare),
        (Shape::Cuboid(Vector3::new(0.03, 0.01, 0.005)), Material::Bare),
        (Shape::Sphere { radius: 0.01 }, Material::Pad),
    ];
    assert_eq!(shapes, expected);
    // Sensors go finger by finger, whatever the order in the file.
    assert_eq!(hand.sensors.iter().map(|s| (s.finger, s.link)).collect::<Vec<_>>(), [(0, 2), (1, 4)]);
    let mut closed = hand.open_configuration(0.0);
    closed.proximal = vec![std::f64::consts::FRAC_PI_2; 2];
    let tip = hand.hand_from_links(&closed).unwrap()[4] * Point3::new(0.01, 0.0, 0.0);
    assert!((tip - Point3::new(-0.03, 0.0, 0.07)).norm() < 1e-12, "{tip}");
}

#[test]
fn names_that_do_not_exist_are_named_with_those_that_do() {
    assert_eq!(
        toml_with("proximal = \"left_root\"", "proximal = \"left_rot\""),
        "hand.toml:32: there is no joint \"left_rot\"; \
         known: left_root, left_middle, right_root, right_middle, label_joint"
    );
    assert_eq!(
        toml_with("tendon = \"cord\"", "tendon = \"rope\""),
        "hand.toml:34: there is no tendon \"rope\"; known: cord"
    );
    assert_eq!(
        toml_with("pads = [\"left_ball\"]", "pads = [\n\"left_ball\",\n\"ball\"]"),
        "hand.toml:4: there is no collider \"ball\"; known: palm_can, left_box, left_ball"
    );
    assert_eq!(
        toml_with("\"right_tip\", \"left_tip\"", "\"right_tip\", \"thumb\""),
        "hand.toml:65: there is no link \"thumb\"; known: palm, left, left_tip, right, right_tip, label"
    );
    assert_eq!(
        toml_with("\"right_tip\", \"left_tip\"", "\"palm\""),
        "hand.toml:65: link \"palm\" belongs to no finger, so it can carry no finger's sensor"
    );
    assert_eq!(
        urdf_with("<child link=\"left\"/>", "<child link=\"lefty\"/>"),
        "hand.urdf:54: there is no link \"lefty\"; known: palm, left, left_tip, right, right_tip, label"
    );
    assert_eq!(
        toml_with("drives = \"left\"", "drives = \"right\""),
        "hand.toml:31: \"left\" is driven by 0 motors; it needs exactly one\n\
         hand.toml:38: \"right\" is driven by 2 motors; it needs exactly one"
    );
}

#[test]
fn every_number_has_a_unit_and_a_source() {
    let arm = "proximal_arm = { value = 0.008, unit = \"m\", source = \"made up for a test\" }";
    assert_eq!(
        toml_with(arm, "proximal_arm = { value = 8.0, unit = \"mm\", source = \"x\" }"),
        "hand.toml:13: proximal_arm is in \"mm\"; give it in \"m\""
    );
    assert_eq!(
        toml_with(arm, "proximal_arm = { value = 0.008, unit = \"m\", source = \" \" }"),
        "hand.toml:13: proximal_arm has an empty source; say where the number comes from"
    );
    assert_eq!(
        toml_with(arm, "proximal_arm = { value = 0.008, unit = \"m\" }"),
        "hand.toml:13: missing field `source`"
    );
    assert_eq!(
        toml_with(arm, "proximal_arm = 0.008"),
        "hand.toml:13: invalid type: floating point `0.008`, expected struct Quantity"
    );
    assert_eq!(
        toml_with(arm, &format!("{arm}\nspool_raduis = 3")),
        "hand.toml:14: unknown field `spool_raduis`, expected one of `proximal_arm`, `distal_arm`, `spool_radius`, \
         `stiffness`, `damping`, `max_tension`"
    );
}

#[test]
fn numbers_that_matter_cannot_have_are_refused() {
    assert_eq!(
        toml_with("distal_arm = { value = 0.005", "distal_arm = { value = 0.0"),
        "hand.toml:14: tendon \"cord\": distal_arm is 0; it must be greater than 0"
    );
    assert_eq!(
        toml_with("max_tension = { value = 20.0", "max_tension = { value = nan"),
        "hand.toml:18: max_tension is not a finite number within +-1e7"
    );
    assert_eq!(
        toml_with("default_speed = { value = 2.0", "default_speed = { value = 3.0"),
        "hand.toml:48: motor \"right_motor\": default_speed is 3; it must be at most max_speed"
    );
    assert_eq!(
        toml_with("travel = { value = [0.0, 2.0]", "travel = { value = [2.0, 0.0]"),
        "hand.toml:47: motor \"right_motor\": travel is [2, 0]; the upper end must be greater"
    );
    assert_eq!(
        toml_with("value = [1.0, 0.0, 0.0]", "value = [1.0, 1.0, 0.0]"),
        "hand.toml:67: sensor \"1\": length of the normal is 1.4142135623730951; it must be 1 within 1e-3"
    );
    assert_eq!(
        urdf_with("<mass value=\"0.3\"/>", "<mass value=\"-0.3\"/>"),
        "hand.urdf:5: link \"palm\": mass is -0.3; it must be greater than 0 kg"
    );
    assert_eq!(
        urdf_with("<mass value=\"0.3\"/>", "<mass value=\"NaN\"/>"),
        "hand.urdf:7: attribute value is \"NaN\"; give 1 finite number(s) within +-1000"
    );
    assert_eq!(
        urdf_with("xyz=\"0.06 0 0\"", "xyz=\"0.06 zero 0 0\""),
        "hand.urdf:64: attribute xyz is \"0.06 zero 0 0\"; give 3 finite number(s) within +-10"
    );
    assert_eq!(
        urdf_with("lower=\"0\" upper=\"1.5\"", "lower=\"2\" upper=\"1.5\""),
        "hand.urdf:59: joint \"left_root\": limit is [2, 1.5]; the upper end must be greater"
    );
    assert_eq!(
        urdf_with("ixx=\"3e-6\" ixy=\"0\" ixz=\"0\" iyy=\"2e-5\"", "ixx=\"3e-6\" ixy=\"0\" ixz=\"0\" iyy=\"9e-5\""),
        "hand.urdf:16: link \"left\": greatest principal moment of inertia is 0.00009; \
         it must be at most the sum of the other two"
    );
    assert_eq!(
        urdf_with("<sphere radius=\"0.01\"/>", "<sphere radius=\"0\"/>"),
        "hand.urdf:31: collider \"left_ball\": least size is 0; it must be greater than 0 m"
    );
}

#[test]
fn joints_must_form_a_tree_of_fingers() {
    assert_eq!(
        urdf_with(
            "<parent link=\"palm\"/>\n    <child link=\"right\"/>",
            "<parent link=\"right_tip\"/>\n    <child link=\"right\"/>"
        ),
        "hand.urdf:35: link \"right\" cannot be reached from the base: the joints form a cycle or a second tree\n\
         hand.urdf:42: link \"right_tip\" cannot be reached from the base: the joints form a cycle or a second tree"
    );
    assert_eq!(
        urdf_with("<child link=\"label\"/>", "<child link=\"left\"/>"),
        "hand.urdf:82: link \"left\" is the child of more than one joint"
    );
    assert_eq!(
        urdf_with("name=\"label_joint\" type=\"fixed\"", "name=\"label_joint\" type=\"continuous\""),
        "hand.urdf:82: joint \"label_joint\" is continuous; only revolute and fixed joints are supported"
    );
    assert_eq!(
        urdf_with("name=\"left_root\" type=\"revolute\"", "name=\"left_root\" type=\"fixed\""),
        "hand.toml:32: joint \"left_root\" is fixed; a finger needs a revolute one"
    );
    assert_eq!(
        toml_with("distal = \"left_middle\"", "distal = \"right_middle\""),
        "hand.urdf:61: joint \"left_middle\" moves but belongs to no finger; make it fixed or name it in a finger\n\
         hand.toml:31: joint \"right_middle\" is not below joint \"left_root\"; \
         a finger is swivel, proximal, distal, outward\n\
         hand.toml:38: joint \"right_middle\" is used more than once by the fingers"
    );
    assert_eq!(
        urdf_with("<link name=\"right\">", "<link name=\"left\">"),
        "hand.urdf:35: the link name \"left\" is used twice; names must be unique"
    );
    assert_eq!(
        urdf_with("    <limit lower=\"0\" upper=\"1.5\" effort=\"1\" velocity=\"5\"/>\n", ""),
        "hand.urdf:54: joint \"left_root\" has no limit"
    );
}

/// A swivel that cannot take the whole preshape would tear the two fingers' mirror.
#[test]
fn a_swivel_must_reach_the_whole_preshape() {
    let urdf = REFLEX_URDF.replacen("lower=\"-1.5707963267948966\"", "lower=\"-1.0\"", 1);
    let text = complaint(&urdf, REFLEX_TOML);
    assert_eq!(
        text.split_once(": ").unwrap().1,
        "joint \"preshape_2\": limit is [-1, 0]; it must hold sign times the preshape limits"
    );
}

/// Both files are checked in one go.
#[test]
fn problems_of_both_files_are_told_together() {
    let urdf = GRIPPER_URDF.replacen("<mass value=\"0.3\"/>", "<mass value=\"0\"/>", 1);
    let toml = GRIPPER_TOML.replacen("unit = \"m\"", "unit = \"cm\"", 1);
    let toml = toml.replacen("unit = \"N/m\"", "unit = \"N/mm\"", 1);
    assert_eq!(
        complaint(&urdf, &toml),
        "hand.urdf:5: link \"palm\": mass is 0; it must be greater than 0 kg\n\
         hand.toml:5: position is in \"cm\"; give it in \"m\"\n\
         hand.toml:16: stiffness is in \"N/mm\"; give it in \"N/m\""
    );
}

#[test]
fn texts_that_are_no_hand_are_refused() {
    assert_eq!(
        complaint(GRIPPER_URDF, "name = "),
        "hand.toml:1: string values must be quoted, expected literal string"
    );
    assert_eq!(
        complaint("<robot name=\"x\"/>", GRIPPER_TOML),
        "hand.urdf:1: there are no links; a hand needs at least one"
    );
    let bomb = "<!DOCTYPE a [<!ENTITY b \"bbbb\">]>\n<robot/>";
    assert_eq!(complaint(bomb, GRIPPER_TOML), "hand.urdf:1: a document type declaration is not allowed; remove it");
    let deep = format!("<robot>{}", "<a>".repeat(100_000));
    assert_eq!(complaint(&deep, GRIPPER_TOML), "hand.urdf:1: elements are nested deeper than 16");
    let brackets = "a=[".repeat(100) + &"[".repeat(100_000);
    assert!(complaint(GRIPPER_URDF, &brackets).starts_with("hand.toml:1: "));
    let large = " ".repeat(usize::try_from(MAX_FILE_BYTES).unwrap() + 1);
    assert_eq!(
        complaint(GRIPPER_URDF, &large),
        "hand.toml:1: the file has 1048577 bytes; a hand description has at most 1048576"
    );
    let pads = format!("pads = [{}]", "\"left_ball\", ".repeat(300));
    assert_eq!(toml_with("pads = [\"left_ball\"]", &pads), "hand.toml:1: there are 300 pads; at most 256 are allowed");
    let missing = Hand::load(Path::new("no/such.urdf"), Path::new("no/such.toml")).unwrap_err();
    assert!(missing.to_string().starts_with("cannot read no/such.urdf: "), "{missing}");
}
