//! The two files of a hand: another hand loads, and problems are named with file and line.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

use graspbox_hand::assets::{ASSETS, asset};
use graspbox_hand::load::MAX_FILE_BYTES;
use graspbox_hand::{Hand, HandError, Material, Shape};
use nalgebra::{Point3, Vector3};

const GRIPPER_URDF: &str = include_str!("fixtures/gripper.urdf");
const GRIPPER_TOML: &str = include_str!("fixtures/gripper.toml");

/// The error for a hand of these texts.
fn problems_of(urdf: &str, toml: &str) -> String {
    match Hand::from_strs(urdf, toml, ["hand.urdf", "hand.toml"]) {
        Ok(_) => "valid".to_owned(),
        Err(HandError::Invalid(problems)) => problems.to_string(),
        Err(other) => panic!("{other}"),
    }
}

/// The same with one change to the gripper's URDF.
fn urdf_with(old: &str, new: &str) -> String {
    assert!(GRIPPER_URDF.contains(old), "{old}");
    problems_of(&GRIPPER_URDF.replacen(old, new, 1), GRIPPER_TOML)
}

/// The same with one change to the gripper's TOML.
fn toml_with(old: &str, new: &str) -> String {
    assert!(GRIPPER_TOML.contains(old), "{old}");
    problems_of(GRIPPER_URDF, &GRIPPER_TOML.replacen(old, new, 1))
}

#[test]
fn another_hand_loads_from_its_own_two_files() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let hand = Hand::load(&folder.join("gripper.urdf"), &folder.join("gripper.toml")).unwrap();
    assert_eq!(hand, Hand::from_strs(GRIPPER_URDF, GRIPPER_TOML, ["a", "b"]).unwrap());
    let names: Vec<_> = hand.links.iter().map(|l| l.name.as_str()).collect();
    assert_eq!(names, ["palm", "left", "left_tip", "right", "right_tip", "label"], "parents before children");
    assert_eq!((hand.preshape_limits(), hand.grasp.coordinate), ([0.0, 0.0], None));
    // Actuators keep the order of the file, tendons that of their names, and arms that of the joints.
    let actuators: Vec<_> = hand.actuators.iter().map(|actuator| actuator.name.as_str()).collect();
    assert_eq!(actuators, ["right_motor", "left_motor"]);
    assert_eq!(hand.tendons[0].arms, [(0, 0.008), (1, 0.005)]);
    assert_eq!(hand.grasp.closing, [0, 1]);
    let chains: Vec<_> = hand.chains().into_iter().map(|chain| (chain.name, chain.joints)).collect();
    assert_eq!(chains, [("left".to_owned(), vec![0, 1]), ("right".to_owned(), vec![2, 3])]);
    assert!((hand.joints[0].axis.into_inner() + Vector3::y()).norm() < 1e-15, "axes are made unit vectors");
    assert!(hand.joints[4].is_fixed());
    // An inertial frame turned by a quarter about z exchanges the moments about x and y.
    assert!((hand.links[1].inertia.diagonal() - Vector3::new(2e-5, 3e-6, 1.8e-5)).norm() < 1e-12);
    let shapes: Vec<_> = hand.links.iter().flat_map(|l| &l.colliders).map(|c| (c.shape, c.material)).collect();
    let expected = [
        (Shape::Cylinder { radius: 0.03, half_length: 0.02 }, Material::Bare),
        (Shape::Cuboid(Vector3::new(0.03, 0.01, 0.005)), Material::Bare),
        (Shape::Sphere { radius: 0.01 }, Material::Pad),
    ];
    assert_eq!(shapes, expected);
    // Sensors go chain by chain, for any order in the file.
    assert_eq!(hand.sensors.iter().map(|s| s.link).collect::<Vec<_>>(), [2, 4]);
    let up = std::f64::consts::FRAC_PI_2;
    let tip = hand.hand_from_links(&[up, 0.0, up, 0.0]).unwrap()[4] * Point3::new(0.01, 0.0, 0.0);
    assert!((tip - Point3::new(-0.03, 0.0, 0.07)).norm() < 1e-12, "{tip}");
}

#[test]
fn names_that_do_not_exist_are_named_with_those_that_do() {
    assert_eq!(
        toml_with("arms.left_root", "arms.left_rot"),
        "hand.toml:31: there is no joint \"left_rot\"; \
         known: left_root, left_middle, right_root, right_middle, label_joint"
    );
    assert_eq!(
        toml_with("closing = [\"left_motor\"", "closing = [\"left_moto\""),
        "hand.toml:69: there is no actuator \"left_moto\"; known: right_motor, left_motor"
    );
    assert_eq!(
        toml_with("tendon = \"left\"", "tendon = \"rope\""),
        "hand.toml:56: there is no tendon \"rope\"; known: left, right"
    );
    assert_eq!(
        toml_with("pads = [\"left_ball\"]", "pads = [\n\"left_ball\",\n\"ball\"]"),
        "hand.toml:4: there is no collider \"ball\"; known: palm_can, left_box, left_ball"
    );
    assert_eq!(
        toml_with("\"right_tip\", \"left_tip\"", "\"right_tip\", \"thumb\""),
        "hand.toml:72: there is no link \"thumb\"; known: palm, left, left_tip, right, right_tip, label"
    );
    assert_eq!(
        urdf_with("<child link=\"left\"/>", "<child link=\"lefty\"/>"),
        "hand.urdf:54: there is no link \"lefty\"; known: palm, left, left_tip, right, right_tip, label"
    );
    assert_eq!(
        toml_with("tendon = \"left\"", "tendon = \"right\""),
        "hand.toml:29: tendon \"left\" is wound by 0 actuators; it needs exactly one\n\
         hand.toml:36: tendon \"right\" is wound by 2 actuators; it needs exactly one"
    );
    assert_eq!(
        asset("reflexx").unwrap_err().to_string(),
        format!(
            "there is no hand \"reflexx\"; known: {}; for another hand give the paths of its URDF and its hand.toml",
            ASSETS.map(|asset| asset.name).join(", ")
        )
    );
}

#[test]
fn every_number_has_a_unit_and_a_source() {
    let arm = "arms.left_root = { value = 0.008, unit = \"m\", source = \"made up for a test\" }";
    assert_eq!(
        toml_with(arm, "arms.left_root = { value = 8.0, unit = \"mm\", source = \"x\" }"),
        "hand.toml:31: arm is in \"mm\"; give it in \"m\""
    );
    assert_eq!(
        toml_with(arm, "arms.left_root = { value = 0.008, unit = \"m\", source = \" \" }"),
        "hand.toml:31: arm has an empty source; say where the number comes from"
    );
    assert_eq!(
        toml_with(arm, "arms.left_root = { value = 0.008, unit = \"m\" }"),
        "hand.toml:31: missing field `source` in the table that begins here; docs/reference/hands.md lists the fields of every table"
    );
    assert_eq!(
        toml_with(arm, "arms.left_root = 0.008"),
        "hand.toml:31: invalid type: floating point `0.008`, expected a table { value = ..., unit = \"...\", source = \"...\" }"
    );
    assert_eq!(
        toml_with(arm, &format!("{arm}\nspool_raduis = 3")),
        "hand.toml:32: unknown field `spool_raduis`, expected one of `arms`, `stiffness`, `damping`, `max_tension`"
    );
}

#[test]
fn numbers_that_matter_cannot_have_are_refused() {
    assert_eq!(
        toml_with("spool.radius = { value = 0.01", "spool.radius = { value = 0.0"),
        "hand.toml:46: actuator \"right_motor\": radius is 0; it must be greater than 0"
    );
    assert_eq!(
        toml_with("max_tension = { value = 20.0", "max_tension = { value = nan"),
        "hand.toml:34: max_tension is not a finite number within +-1e7"
    );
    assert_eq!(
        toml_with("default_speed = { value = 2.0", "default_speed = { value = 3.0"),
        "hand.toml:48: actuator \"right_motor\": default_speed is 3; it must be at most max_speed"
    );
    assert_eq!(
        toml_with("travel = { value = [0.0, 2.0]", "travel = { value = [2.0, 0.0]"),
        "hand.toml:47: actuator \"right_motor\": travel is [2, 0]; the upper end must be greater"
    );
    assert_eq!(
        toml_with("value = [1.0, 0.0, 0.0]", "value = [1.0, 1.0, 0.0]"),
        "hand.toml:74: sensor \"1\": length of the normal is 1.4142135623730951; it must be 1 within 1e-3"
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
        urdf_with("<sphere radius=\"0.01\"/>", "<sphere radius=\"-0.01\"/>"),
        "hand.urdf:32: collider \"left_ball\": least size is -0.01; it must be greater than 0 m"
    );
    assert_eq!(
        urdf_with("<sphere radius=\"0.01\"/>", "<box size=\"0.01 0.01 0\"/>"),
        "hand.urdf:32: collider \"left_ball\": least size is 0; it must be greater than 0 m"
    );
}

#[test]
fn joints_must_form_a_tree() {
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
        urdf_with("name=\"label_joint\" type=\"fixed\"", "name=\"label_joint\" type=\"spherical\""),
        "hand.urdf:82: joint \"label_joint\" is spherical; use three revolute joints with a small link between each two"
    );
    assert_eq!(
        urdf_with("name=\"label_joint\" type=\"fixed\"", "name=\"label_joint\" type=\"floating\""),
        "hand.urdf:82: joint \"label_joint\" is floating; only one that moves the whole hand may be so; use revolute and \
         prismatic joints, or a fixed one"
    );
    assert_eq!(
        urdf_with("name=\"left_root\" type=\"revolute\"", "name=\"left_root\" type=\"fixed\""),
        "hand.toml:9: joint \"left_root\" is fixed; name an independent joint instead\n\
         hand.toml:31: joint \"left_root\" is fixed; name an independent joint instead"
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

/// Nothing that moves is left without something that holds it, and nothing is held twice.
#[test]
fn joints_are_held_by_one_thing_each() {
    let joint = "[joints.right_middle]";
    assert_eq!(
        toml_with("arms.right_middle", "arms.left_middle"),
        "hand.urdf:75: joint \"right_middle\" moves, but no tendon, actuator or spring holds it; make it fixed, or name it in [joints], \
         [tendons] or [[actuators]]"
    );
    assert_eq!(
        toml_with(joint, "[joints.other]\nnames = [\"left_middle\"]"),
        "hand.toml:25: joint \"left_middle\" is named more than once by [joints]"
    );
    assert_eq!(
        toml_with("spring_reference = { value = 0.1, unit = \"rad\", source = \"made up for a test\" }\n", ""),
        "hand.toml:17: table of joints \"left_middle\" has no spring_reference"
    );
    let radius = "spool.radius = { value = 0.01, unit = \"m\", source = \"made up for a test\" }\n";
    let driven = "rigid.joints.right_root.ratio = { value = 1.0, unit = \"1\", source = \"x\" }\n";
    assert_eq!(
        toml_with(&format!("spool.tendon = \"right\"\n{radius}"), driven),
        "hand.toml:36: tendon \"right\" is wound by 0 actuators; it needs exactly one\n\
         hand.toml:44: joint \"right_root\" is driven rigidly by actuator \"right_motor\", so its table in [joints] has no effect on it; \
         leave it out\n\
         hand.toml:44: joint \"right_root\" is driven rigidly by actuator \"right_motor\", so a tendon has no effect on it; leave it out\n\
         hand.toml:50: load_limit is in \"N\"; give it in \"N m\"\n\
         hand.toml:51: force_gain is in \"rad/(s N)\"; give it in \"rad/(s N m)\""
    );
    assert_eq!(
        toml_with(radius, &format!("{radius}{driven}")),
        "hand.toml:44: actuator \"right_motor\" has 2 of the tables spool, rigid and servo; give exactly one of them"
    );
}

/// A joint follows a leader of the same kind, over the whole range of the leader.
#[test]
fn joints_follow_what_they_can_follow() {
    let middle = "<axis xyz=\"0 -1 0\"/>\n    <limit lower=\"0\" upper=\"1.2\" effort=\"1\" velocity=\"5\"/>";
    let following = |mimic: &str| urdf_with(middle, &format!("{middle}\n    {mimic}"));
    assert_eq!(
        following("<mimic joint=\"left_roots\"/>"),
        "hand.urdf:67: there is no joint \"left_roots\"; known: left_root, left_middle, right_root, right_middle, label_joint"
    );
    assert_eq!(
        following("<mimic joint=\"label_joint\"/>"),
        "hand.urdf:67: joint \"left_middle\" mimics \"label_joint\", which is of another kind"
    );
    assert_eq!(
        following("<mimic joint=\"left_middle\"/>"),
        "hand.urdf:67: joint \"left_middle\" mimics \"left_middle\", which follows it in turn"
    );
    assert_eq!(
        following("<mimic joint=\"left_root\" multiplier=\"-8\"/>").lines().next().unwrap(),
        "hand.urdf:67: joint \"left_middle\": range to which it follows is [-12, 0]; it must be within +-10"
    );
    assert_eq!(
        following("<mimic joint=\"left_root\"/>"),
        "hand.toml:17: joint \"left_middle\" follows joint \"left_root\"; name an independent joint instead\n\
         hand.toml:30: joint \"left_middle\" follows joint \"left_root\"; name an independent joint instead"
    );
}

/// A swivel that cannot take the whole preshape would tear the two fingers' mirror.
#[test]
fn driven_joints_must_reach_the_whole_preshape() {
    let reflex = asset("reflex").unwrap();
    let both = reflex.urdf.replace("1.5707963267948966", "1.0");
    assert_eq!(
        problems_of(&both, reflex.toml).split_once(": ").unwrap().1,
        "joint \"preshape_1\": limit is [0, 1]; it must hold the preshape limits, times the ratio, plus the offset"
    );
}

/// With a preshape coordinate, a preshape is a position of this coordinate only.
#[test]
fn preshapes_are_positions_of_the_coordinate() {
    let reflex = asset("reflex").unwrap();
    let power = "positions.preshape = { value = 0.0, unit = \"rad\"";
    assert!(reflex.toml.contains(power));
    let message = |new: &str| {
        let text = problems_of(reflex.urdf, &reflex.toml.replacen(power, new, 1));
        text.split_once(": ").unwrap().1.to_owned()
    };
    let other = power.replacen("preshape", "finger_1", 1);
    assert_eq!(message(&other), "preshape \"power\" has no position of the preshape coordinate");
    let both = format!("positions.finger_1 = {{ value = 0.0, unit = \"rad\", source = \"a test\" }}\n{power}");
    assert_eq!(
        message(&both),
        "preshape \"power\" has positions of several actuators; with `[grasp.coordinate]` a preshape has only that of \
         \"preshape\""
    );
}

/// Both files are checked in one go.
#[test]
fn problems_of_both_files_are_reported_together() {
    let urdf = GRIPPER_URDF.replacen("<mass value=\"0.3\"/>", "<mass value=\"-1\"/>", 1);
    let toml = GRIPPER_TOML.replacen("unit = \"m\"", "unit = \"cm\"", 1);
    let toml = toml.replacen("unit = \"N/m\"", "unit = \"N/mm\"", 1);
    assert_eq!(
        problems_of(&urdf, &toml),
        "hand.urdf:5: link \"palm\": mass is -1; it must be greater than 0 kg\n\
         hand.toml:30: arm is in \"cm\"; give it in \"m\"\n\
         hand.toml:32: stiffness is in \"N/mm\"; give it in \"N/m\""
    );
}

#[test]
fn texts_that_are_no_hand_are_refused() {
    assert_eq!(
        problems_of(GRIPPER_URDF, "name = "),
        "hand.toml:1: string values must be quoted, expected literal string"
    );
    assert_eq!(
        problems_of("<robot name=\"x\"/>", GRIPPER_TOML),
        "hand.urdf:1: there are no links; at least one is needed"
    );
    let bomb = "<!DOCTYPE a [<!ENTITY b \"bbbb\">]>\n<robot/>";
    assert_eq!(problems_of(bomb, GRIPPER_TOML), "hand.urdf:1: a document type declaration is not allowed; remove it");
    for (text, message) in [
        ("<mujoco/>", "the file is an MJCF file; `graspbox hand convert` makes the two files of a hand from it"),
        ("<sdf/>", "the file is an SDF file; give the URDF or the MJCF file of this hand"),
        (
            "<robot xmlns:xacro=\"x\"><xacro:include/></robot>",
            "the file is a xacro; expand it: `xacro hand.urdf.xacro > hand.urdf`, or install graspbox[urdf], which does so",
        ),
        ("<html/>", "the file is no URDF: its root element is <html>; a URDF has <robot>"),
        ("<robot><link></robot>", "ill-formed document: expected `</link>`, but `</robot>` was found"),
        ("<robot><link>", "the element <link> is not closed"),
        ("<robot/><robot/>", "there is a second root element"),
        ("", "there is no element"),
    ] {
        assert_eq!(problems_of(text, GRIPPER_TOML), format!("hand.urdf:1: {message}"));
    }
    let deep = format!("<robot>{}", "<a>".repeat(100_000));
    assert_eq!(problems_of(&deep, GRIPPER_TOML), "hand.urdf:1: elements are nested deeper than 32");
    let brackets = "a=[".repeat(100) + &"[".repeat(100_000);
    assert!(problems_of(GRIPPER_URDF, &brackets).starts_with("hand.toml:1: "));
    let large = " ".repeat(usize::try_from(MAX_FILE_BYTES).unwrap() + 1);
    assert_eq!(
        problems_of(GRIPPER_URDF, &large),
        "hand.toml:1: the file has 1048577 bytes; a description has at most 1048576"
    );
    let pads = format!("pads = [{}]", "\"left_ball\", ".repeat(1100));
    assert_eq!(
        toml_with("pads = [\"left_ball\"]", &pads),
        "hand.toml:1: there are 1100 pads; at most 1024 are allowed"
    );
    let missing = Hand::load(Path::new("no/such.urdf"), Path::new("no/such.toml")).unwrap_err();
    assert!(missing.to_string().starts_with("cannot read no/such.urdf: "), "{missing}");
}

#[test]
fn a_hand_may_state_where_it_holds_and_the_weights_of_its_ranking() {
    let quantity = |value: &str, unit: &str| format!("{{ value = {value}, unit = \"{unit}\", source = \"ours\" }}");
    let with = |range: &str, weight: &str| {
        let more = format!("[grasp]\nclosing_range = {range}\nranking.fingers = {weight}\n");
        GRIPPER_TOML.replacen("[grasp]\n", &more, 1)
    };
    let (range, weight) = (quantity("[-0.01, 0.05]", "m"), quantity("0.5", "1"));
    let hand = Hand::from_strs(GRIPPER_URDF, &with(&range, &weight), ["a", "b"]).unwrap();
    assert_eq!(hand.grasp.closing_range, [-0.01, 0.05]);
    assert_eq!(hand.grasp.ranking.iter().collect::<Vec<_>>(), [(&"fingers".to_owned(), &0.5)]);
    let plain = Hand::from_strs(GRIPPER_URDF, GRIPPER_TOML, ["a", "b"]).unwrap();
    assert!(plain.grasp.closing_range == [0.0; 2] && plain.grasp.ranking.is_empty());
    let reversed = problems_of(GRIPPER_URDF, &with(&quantity("[0.05, -0.01]", "m"), &weight));
    assert!(reversed.contains("closing_range") && reversed.contains("the upper end must be greater"), "{reversed}");
    let wrong_unit = problems_of(GRIPPER_URDF, &with(&range, &quantity("0.5", "m")));
    assert!(wrong_unit.contains("weight of the ranking"), "{wrong_unit}");
}
