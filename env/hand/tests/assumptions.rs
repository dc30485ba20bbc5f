//! URDFs that other programs take: what is assumed is said, with the line, and what cannot be is refused.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_hand::{Hand, HandError, Shape, urdf_meshes};
use nalgebra::{Matrix3, Vector3};

const URDF: &str = include_str!("fixtures/gripper.urdf");
const TOML: &str = include_str!("fixtures/gripper.toml");
/// The lines of the inertial of the first link, of its label, and of a joint's range.
const PALM_INERTIAL: &str = "    <inertial>
      <origin xyz=\"0 0 0.02\"/>
      <mass value=\"0.3\"/>
      <inertia ixx=\"1e-4\" ixy=\"0\" ixz=\"0\" iyy=\"1e-4\" iyz=\"0\" izz=\"1e-4\"/>
    </inertial>
";
const LEFT_LIMIT: &str = "<limit lower=\"0\" upper=\"1.5\" effort=\"1\" velocity=\"5\"/>";

fn read(urdf: &str) -> Hand {
    Hand::from_strs(urdf, TOML, ["hand.urdf", "hand.toml"]).unwrap_or_else(|error| panic!("{error}"))
}

/// The hand with one change, and what is assumed.
fn changed(old: &str, new: &str) -> (Hand, Vec<String>) {
    assert!(URDF.contains(old), "{old}");
    let hand = read(&URDF.replacen(old, new, 1));
    let assumed = hand.assumptions.iter().map(ToString::to_string).collect();
    (hand, assumed)
}

fn added(new: &str) -> (Hand, Vec<String>) {
    changed("</robot>", &format!("{new}</robot>"))
}

fn refused(urdf: &str) -> String {
    match Hand::from_strs(urdf, TOML, ["hand.urdf", "hand.toml"]) {
        Err(HandError::Invalid(problems)) => problems.to_string(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_file_without_gaps_needs_no_assumption() {
    assert_eq!(read(URDF).assumptions, []);
}

#[test]
fn shapes_without_size_are_left_out() {
    for point in ["<sphere radius=\"0\"/>", "<box size=\"0 0 0\"/>", "<cylinder radius=\"0\" length=\"0\"/>"] {
        let mark = format!("<collision name=\"mark\"><geometry>{point}</geometry></collision>");
        let (hand, assumed) = changed("<link name=\"palm\">", &format!("<link name=\"palm\">{mark}"));
        assert_eq!(assumed, ["hand.urdf:4: collider \"mark\": all its sizes are 0; it is left out"]);
        assert!(hand.links.iter().flat_map(|link| &link.colliders).all(|shape| shape.name != "mark"));
    }
}

#[test]
fn frames_have_no_mass_and_stay_usable_by_name() {
    let frame = "<link name=\"tool\"/>\n<joint name=\"t\" type=\"fixed\"><parent link=\"right_tip\"/><child link=\"tool\"/></joint>";
    let (hand, assumed) = added(frame);
    let line = URDF.lines().count();
    assert_eq!(
        assumed,
        [format!(
            "hand.urdf:{line}: link \"tool\": has no <inertial> and is fixed to \"right_tip\"; it has no mass of its own"
        )]
    );
    let tool = hand.links.iter().position(|link| link.name == "tool").unwrap();
    assert_eq!((hand.links[tool].mass, hand.links[tool].inertia), (0.0, Matrix3::zeros()));
    let toml = TOML.replacen("\"right_tip\", \"left_tip\"", "\"tool\", \"left_tip\"", 1);
    let with_sensor = URDF.replacen("</robot>", &format!("{frame}</robot>"), 1);
    let sensors = Hand::from_strs(&with_sensor, &toml, ["a", "b"]).unwrap().sensors;
    assert!(sensors.iter().any(|sensor| sensor.link == tool));
}

#[test]
fn moving_links_and_roots_weigh_what_their_shapes_weigh() {
    let (hand, assumed) = changed(PALM_INERTIAL, "");
    assert_eq!(
        assumed,
        [
            "hand.urdf:4: link \"palm\": has no <inertial>; its mass and inertia are those of its collision shapes at 1000 kg/m3, \
          0.1131 kg"
        ]
    );
    let (palm, radius, length) = (&hand.links[0], 0.03_f64, 0.04_f64);
    let mass = 1000.0 * std::f64::consts::PI * radius * radius * length;
    let across = mass * (3.0 * radius * radius + length * length) / 12.0;
    assert!(
        (palm.mass - mass).abs() < 1e-12 && (palm.center_of_mass.coords - Vector3::new(0.0, 0.0, 0.02)).norm() < 1e-15
    );
    let moments = Vector3::new(across, across, mass * radius * radius / 2.0);
    assert!((palm.inertia - Matrix3::from_diagonal(&moments)).norm() < 1e-12, "{}", palm.inertia);
    // A root without shapes is carried by what is fixed to it; a link with nothing at all gets a gram.
    let root =
        "<link name=\"world\"/><joint name=\"w\" type=\"fixed\"><parent link=\"world\"/><child link=\"palm\"/></joint>";
    let (hand, assumed) = added(root);
    assert!(hand.links[0].name == "world" && hand.links[0].mass == 0.0);
    assert!(assumed[0].ends_with(
        "link \"world\": has no <inertial> and no collision shape; its mass is that of the links fixed to it"
    ));
    let tip = URDF.split("<link name=\"right_tip\">").nth(1).unwrap().split("</link>").next().unwrap();
    let (hand, assumed) = changed(&format!("<link name=\"right_tip\">{tip}"), "<link name=\"right_tip\">");
    assert!(assumed[0].contains("its mass is 0.001 kg, a ball of 1000 kg/m3"), "{assumed:?}");
    assert!(hand.links[4].mass == 1e-3 && hand.links[4].inertia[(0, 0)] > 0.0);
}

#[test]
fn inertias_that_no_body_has_become_possible_ones() {
    let (hand, assumed) =
        changed("ixx=\"3e-6\" ixy=\"0\" ixz=\"0\" iyy=\"2e-5\"", "ixx=\"3e-6\" ixy=\"0\" ixz=\"0\" iyy=\"3e-5\"");
    assert!(assumed[0].starts_with("hand.urdf:16: link \"left\": its greatest principal moment"), "{assumed:?}");
    assert!(assumed[0].contains("by 42.9 %"), "{assumed:?}");
    // 30 - (3 + 18) = 9: a third of it from the greatest, to each of the others; the axes are turned by a quarter about z.
    let moments = hand.links[1].inertia.diagonal();
    assert!((moments - Vector3::new(27e-6, 6e-6, 21e-6)).norm() < 1e-12, "{moments}");
    for moment in ["0", "-1e-6"] {
        let (hand, assumed) = changed("iyy=\"2e-5\"", &format!("iyy=\"{moment}\""));
        assert!(assumed[0].ends_with("its inertia is that of its collision shapes with its mass"), "{assumed:?}");
        let sides = Vector3::new(0.06_f64, 0.02, 0.01).map(|side| side * side);
        let expected = (Vector3::repeat(sides.sum()) - sides) * 0.05 / 12.0;
        assert!((hand.links[1].inertia.diagonal() - expected).norm() < 1e-12);
    }
}

#[test]
fn followers_go_where_their_leaders_take_them() {
    let middle = "<axis xyz=\"0 -1 0\"/>\n    <limit lower=\"0\" upper=\"1.2\" effort=\"1\" velocity=\"5\"/>";
    assert!(URDF.contains(middle));
    let following = |change: &str| {
        let urdf = URDF.replacen(middle, &format!("<axis xyz=\"0 -1 0\"/>\n{change}"), 1);
        graspbox_hand::read_urdf(&urdf, "hand.urdf").unwrap().1[1].clone()
    };
    let wide = following("<limit lower=\"0\" upper=\"1.2\"/><mimic joint=\"left_root\"/>");
    assert_eq!(wide.limits, [0.0, 1.5]);
    let none = following("<mimic joint=\"left_root\" multiplier=\"-2\" offset=\"0.5\"/>");
    assert_eq!(none.limits, [-2.5, 0.5]);
    // A follower of a follower follows its leader: 0.5 (2 q + 0.1) + 0.2.
    let first = "<limit lower=\"0\" upper=\"3.2\"/><mimic joint=\"left_root\" multiplier=\"2\" offset=\"0.1\"/>";
    let second = URDF.replacen(middle, &format!("<axis xyz=\"0 -1 0\"/>\n{first}"), 1);
    let right = "<joint name=\"right_middle\" type=\"revolute\">";
    let chained =
        second.replacen(right, &format!("{right}<mimic joint=\"left_middle\" multiplier=\"0.5\" offset=\"0.2\"/>"), 1);
    let (_, joints) = graspbox_hand::read_urdf(&chained, "hand.urdf").unwrap();
    let law = joints[3].mimic.unwrap();
    assert!(law.joint == 0 && law.ratio == 1.0 && (law.offset - 0.25).abs() < 1e-15, "{law:?}");
    let cycle = second.replacen(
        "<joint name=\"left_root\" type=\"revolute\">",
        "<joint name=\"left_root\" type=\"revolute\"><mimic joint=\"left_middle\"/>",
        1,
    );
    assert!(refused(&cycle).contains("which follows it in turn"));
}

#[test]
fn joints_of_other_kinds_are_what_they_come_nearest_to() {
    let left = "<joint name=\"left_root\" type=\"revolute\">";
    let continuous = left.replacen("revolute", "continuous", 1);
    let (hand, assumed) = changed(left, &continuous);
    assert_eq!(hand.joints[0].limits, [0.0, 1.5]);
    assert_eq!(
        assumed,
        ["hand.urdf:59: joint \"left_root\": is continuous; its range is that of its <limit>, [0.0000, 1.5000] rad"]
    );
    let urdf = URDF.replacen(left, &continuous, 1).replacen(LEFT_LIMIT, "<limit effort=\"1\" velocity=\"nan\"/>", 1);
    let hand = read(&urdf);
    assert_eq!((hand.joints[0].limits, hand.joints[0].velocity), ([-std::f64::consts::PI, std::f64::consts::PI], 0.0));
    let (hand, assumed) = changed(LEFT_LIMIT, &format!("{LEFT_LIMIT}\n<limit lower=\"-9\" upper=\"9\"/>"));
    assert_eq!(
        (hand.joints[0].limits, &assumed[0]),
        ([0.0, 1.5], &"hand.urdf:60: joint \"left_root\": has several <limit>; the first is used".to_owned())
    );
    let label = "<joint name=\"label_joint\" type=\"fixed\">";
    let (_, assumed) = changed(label, &format!("{label}<mimic joint=\"left_root\"/>"));
    assert_eq!(assumed, ["hand.urdf:82: joint \"label_joint\": is fixed; its <mimic> is ignored"]);
    for kind in ["floating", "planar"] {
        let (hand, assumed) = added(&format!(
            "<link name=\"world\"/><joint name=\"w\" type=\"{kind}\"><parent link=\"world\"/><child link=\"palm\"/></joint>"
        ));
        assert!(
            hand.joints[0].is_fixed()
                && assumed[0].contains(&format!("joint \"w\": is {kind}, and only it leaves the root")),
            "{assumed:?}"
        );
    }
}

#[test]
fn elements_of_other_programs_do_no_harm() {
    let (hand, assumed) = added(
        "<drake:proximity a:b=\"nan\"><drake:deep size=\"x\"/></drake:proximity><gazebo><mass value=\"nan\"/></gazebo>",
    );
    assert!(assumed.is_empty() && hand.links == read(URDF).links);
    let same = "<collision name=\"c\"><geometry><sphere radius=\"0.01\"/></geometry></collision>";
    let (hand, assumed) = changed(
        "<link name=\"right\">",
        &format!("<link name=\"right\">{same}{same}{}", same.replacen("\"c\"", "\"\"", 1)),
    );
    let names: Vec<_> = hand.links[3].colliders.iter().map(|collider| collider.name.as_str()).collect();
    assert!(assumed.is_empty() && names[..3] == ["c", "c_2", "right_2"], "{names:?}");
}

#[test]
fn capsules_and_visual_shapes_collide() {
    let (hand, assumed) = changed("<sphere radius=\"0.01\"/>", "<capsule radius=\"0.01\" length=\"0.04\"/>");
    assert!(assumed.is_empty());
    let shapes: Vec<_> =
        hand.links[2].colliders.iter().map(|c| (c.name.as_str(), c.shape, c.link_from_shape.translation.z)).collect();
    let ball = Shape::Sphere { radius: 0.01 };
    assert_eq!(shapes[0], ("left_ball.0", Shape::Cylinder { radius: 0.01, half_length: 0.02 }, 0.0));
    assert_eq!(shapes[1..], [("left_ball.1", ball, -0.02), ("left_ball.2", ball, 0.02)]);
    let visual = URDF.replace("collision", "visual");
    let hand = read(&visual);
    assert_eq!(hand.links, read(URDF).links);
    assert_eq!(
        hand.assumptions[0].to_string(),
        "hand.urdf:10: no link has a <collision>; the <visual> shapes are the collision shapes"
    );
}

#[test]
fn meshes_are_found_with_their_places() {
    let mesh = "<mesh filename=\"a.stl\" scale=\"0.001 0.001 0.001\"/>";
    let beside = "<collision>\n<geometry><sphere radius=\"0.01\"/></geometry></collision>";
    let urdf = URDF.replacen("<box size=\"0.06 0.02 0.01\"/>", mesh, 1).replacen(
        "<collision name=\"left_box\">",
        &format!("{beside}<collision name=\"left_box\">"),
        1,
    );
    let found = urdf_meshes(&urdf, "hand.urdf").unwrap();
    let [one] = &found.meshes[..] else { panic!("{found:?}") };
    assert_eq!((one.name.as_str(), one.line, one.file.as_str(), one.scale), ("left_box", 24, "a.stl", [1e-3; 3]));
    assert!(
        urdf[one.span.clone()].starts_with("<collision name=\"left_box\">")
            && urdf[one.span.clone()].ends_with("</collision>")
    );
    let [(byte, name)] = &found.unnamed[..] else { panic!("{found:?}") };
    assert!(name == "left_0" && urdf[..*byte].ends_with("<collision") && urdf[*byte..].starts_with('>'));
    assert!(refused(&urdf).starts_with("hand.urdf:24: collider \"left_box\" is the mesh \"a.stl\""));
    for (scale, message) in
        [("1 1", "attribute scale is \"1 1\"; give 3"), ("0 1 1", "scale is 0; it must be other than 0")]
    {
        let wrong = urdf.replacen("0.001 0.001 0.001", scale, 1);
        assert!(urdf_meshes(&wrong, "hand.urdf").unwrap_err().to_string().contains(message));
    }
}

#[test]
fn many_frames_are_no_obstacle_but_many_joints_are() {
    let frame = |n: usize, kind: &str| {
        format!(
            "<link name=\"f{n}\"/><joint name=\"j{n}\" type=\"{kind}\"><parent link=\"palm\"/><child link=\"f{n}\"/><limit lower=\"0\" upper=\"1\"/></joint>"
        )
    };
    let (hand, _) = added(&(0..150).map(|n| frame(n, "fixed")).collect::<String>());
    assert_eq!(hand.links.len(), 156);
    for (count, kind, what) in
        [(200, "fixed", "206 links; at most 192"), (61, "revolute", "65 moving joints; at most 64")]
    {
        let frames: String = (0..count).map(|n| frame(n, kind)).collect();
        let urdf = URDF.replacen("</robot>", &format!("{frames}</robot>"), 1);
        assert!(refused(&urdf).contains(what), "{}", refused(&urdf));
    }
}

/// Shapes keep their names when a mesh of their name becomes several shapes.
#[test]
fn a_shape_beside_a_mesh_of_its_name_is_numbered() {
    let shape =
        |name: &str| format!("<collision name=\"{name}\"><geometry><sphere radius=\"0.01\"/></geometry></collision>");
    let own = ["c.0", "c.1", "c"].map(shape).concat();
    let (hand, _) = changed("<link name=\"right\">", &format!("<link name=\"right\">{own}"));
    let names: Vec<_> = hand.links[3].colliders.iter().map(|collider| collider.name.as_str()).collect();
    assert_eq!(names[..3], ["c.0", "c.1", "c_2"]);
}

#[test]
fn many_attributes_and_links_are_refused_at_once() {
    let attributes: String = (0..100).map(|number| format!(" a{number}=\"\"")).collect();
    let text = URDF.replacen("<robot", &format!("<robot{attributes}"), 1);
    assert!(graspbox_hand::read_urdf(&text, "x").unwrap_err().to_string().contains("more than 64 attributes"));
    let links: String = (0..4000).map(|number| format!("<link name=\"l{number}\"/>")).collect();
    let joint = "<joint name=\"j\" type=\"fixed\"><parent link=\"n\"/><child link=\"m\"/></joint>";
    assert!(graspbox_hand::read_urdf_anyway(&format!("<robot>{links}{joint}</robot>")).is_none());
}
