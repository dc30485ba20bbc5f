//! The arms that come with the project, and errors in the files of arms.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_hand::arm::assets::{ARMS, arm_asset};
use graspbox_hand::assets::ASSETS;
use graspbox_hand::{Arm, HandError, Slowing};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

fn arm(name: &str) -> Arm {
    arm_asset(name).unwrap().read().unwrap()
}

#[test]
fn included_arms_assume_nothing_and_carry_every_light_hand() {
    for asset in ARMS {
        let arm = asset.read().unwrap_or_else(|error| panic!("{}: {error}", asset.name));
        assert_eq!(arm.name, asset.name);
        assert!(arm.assumptions.is_empty(), "{}: {:?}", asset.name, arm.assumptions);
        assert!(arm.axes.iter().all(|axis| axis.speed > 0.0));
        let flange = arm.forward_kinematics(&arm.home()).unwrap()[arm.flange];
        assert!((flange * Vector3::z()).z < -0.9, "{}: at home the flange points down", asset.name);
        for hand in ASSETS {
            let pose = arm.flange_from_base_of(&hand.read().unwrap());
            assert!(pose.translation.vector.norm() < 0.15, "{} on {}", hand.name, asset.name);
        }
    }
    assert!((arm("fr3").flange_from_base_of(&ASSETS[1].read().unwrap()).rotation.angle() - PI / 4.0).abs() < 1e-12);
}

/// One row of a table of Denavit and Hartenberg: a, alpha, d.
type Row = [f64; 3];

fn about_z(angle: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle))
}

fn along_x(a: f64, alpha: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::new(a, 0.0, 0.0), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), alpha))
}

fn product(motions: impl Iterator<Item = Isometry3<f64>>) -> Isometry3<f64> {
    motions.fold(Isometry3::identity(), |all, motion| all * motion)
}

fn check_flange(name: &str, wanted: impl Fn(&[f64]) -> Isometry3<f64>) {
    let arm = arm(name);
    for sample in 0..50_u32 {
        let share = |axis: usize| (f64::from(sample) * 0.618_034 + axis as f64 * 0.414_214).fract();
        let joints = arm.axis_joints().enumerate();
        let q: Vec<f64> = joints.map(|(i, j)| j.limits[0] + share(i) * (j.limits[1] - j.limits[0])).collect();
        let (found, wanted) = (arm.forward_kinematics(&q).unwrap()[arm.flange], wanted(&q));
        assert!((found.translation.vector - wanted.translation.vector).norm() < 1e-12, "{name} at {q:?}");
        assert!(found.rotation.angle_to(&wanted.rotation) < 1e-7, "{name} at {q:?}");
    }
}

/// A mismatch is a wrong joint frame in the URDF: these are the makers' tables.
#[test]
fn flanges_are_where_the_makers_tables_put_them() {
    // Craig's convention: a and alpha before the turn.
    let craig = |rows: [Row; 7], d: f64| {
        move |q: &[f64]| {
            let link = |(row, angle): (&Row, &f64)| {
                along_x(row[0], row[1]) * about_z(*angle) * Translation3::new(0.0, 0.0, row[2])
            };
            product(rows.iter().zip(q).map(link)) * Translation3::new(0.0, 0.0, d)
        }
    };
    let h = FRAC_PI_2;
    let fr3 = [
        [0.0, 0.0, 0.333],
        [0.0, -h, 0.0],
        [0.0, h, 0.316],
        [0.0825, h, 0.0],
        [-0.0825, -h, 0.384],
        [0.0, h, 0.0],
        [0.088, h, 0.0],
    ];
    check_flange("fr3", craig(fr3, 0.107));
    let xarm7 = [
        [0.0, 0.0, 0.267],
        [0.0, -h, 0.0],
        [0.0, h, 0.293],
        [0.0525, h, 0.0],
        [0.0775, h, 0.3425],
        [0.0, h, 0.0],
        [0.076, -h, 0.097],
    ];
    check_flange("xarm7", craig(xarm7, 0.0));
    // The standard convention: a and alpha after the turn, and a base turned by pi.
    let ur5e = [
        [0.0, h, 0.1625],
        [-0.425, 0.0, 0.0],
        [-0.3922, 0.0, 0.0],
        [0.0, h, 0.1333],
        [0.0, -h, 0.0997],
        [0.0, 0.0, 0.0996],
    ];
    check_flange("ur5e", |q| {
        let link = |(row, angle): (&Row, &f64)| {
            about_z(*angle) * Translation3::new(0.0, 0.0, row[2]) * along_x(row[0], row[1])
        };
        about_z(PI) * product(ur5e.iter().zip(q).map(link))
    });
}

const URDF: &str = r#"<robot name="two">
  <link name="world"/>
  <link name="base"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="stand" type="fixed"><parent link="world"/><child link="base"/><origin xyz="0 0 1"/></joint>
  <link name="upper"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="2"/></joint>
  <link name="tool"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="upper"/><child link="tool"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.5" effort="1" velocity="0"/></joint>
  <link name="jaw"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="grip" type="prismatic"><parent link="tool"/><child link="jaw"/><limit lower="0" upper="0.1" effort="1" velocity="1"/></joint>
</robot>
"#;
const TOML: &str = r#"name = "two"
base = "base"
flange = "tool"
payload = { value = 2.0, unit = "kg", source = "test" }
[home]
shoulder = { value = 0.5, unit = "rad", source = "test" }
slide = { value = 0.1, unit = "m", source = "test" }
[limits.slide]
speed = { value = 0.2, unit = "m/s", source = "test" }
"#;

fn problems(urdf: &str, toml: &str) -> String {
    match Arm::from_strs(urdf, toml, ["arm.urdf", "arm.toml"]) {
        Err(HandError::InvalidArm(problems)) => problems.to_string(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_arm_begins_at_its_base_and_ends_at_its_flange() {
    let arm = Arm::from_strs(URDF, TOML, ["arm.urdf", "arm.toml"]).unwrap();
    let links: Vec<&str> = arm.links.iter().map(|link| link.name.as_str()).collect();
    assert_eq!(links, ["base", "upper", "tool"]);
    assert_eq!(arm.home(), [0.5, 0.1]);
    assert_eq!([arm.axes[0].speed, arm.axes[1].speed], [2.0, 0.2]);
    assert_eq!([arm.axes[0].acceleration, arm.axes[1].jerk], [None, None]);
    let told: Vec<String> = arm.assumptions.iter().map(ToString::to_string).collect();
    assert_eq!(
        told,
        [
            "arm.urdf:12: link \"jaw\": joint \"grip\" carries it beyond the flange or beside the arm; it is left out, with what it carries"
        ]
    );
    // The base is the origin, wherever it stands in the file.
    let flange = arm.forward_kinematics(&[0.0, 0.3]).unwrap()[arm.flange];
    assert!((flange.translation.vector - Vector3::new(0.0, 0.0, 0.3)).norm() < 1e-12);
}

const SLOWING: &str = r#"[slowing.shoulder]
ends = { value = [-1.05, 1.0], unit = "rad", source = "test" }
rate = { value = 5.0, unit = "rad/s2", source = "test" }
offset = { value = 0.45, unit = "rad/s", source = "test" }
"#;

#[test]
fn a_joint_that_slows_down_leaves_the_ends_of_its_range_out() {
    let arm = Arm::from_strs(URDF, &format!("{TOML}{SLOWING}"), ["arm.urdf", "arm.toml"]).unwrap();
    let slowing = Slowing { ends: [-1.05, 1.0], rate: 5.0, offset: 0.45 };
    assert_eq!([arm.axes[0].slowing, arm.axes[1].slowing], [Some(slowing), None]);
    // Slower than 0.05 rad/s within 0.05 rad of an end: (0.45 + 0.05)^2 / 5.
    assert_eq!(arm.joints[arm.axes[0].joint].limits, [-1.0, 0.95]);
    let with = |from: &str, to: &str| problems(URDF, &format!("{TOML}{}", SLOWING.replace(from, to)));
    assert_eq!(with("5.0", "0.0"), "arm.toml:12: joint \"shoulder\": rate is 0; it must be greater than 0");
    assert_eq!(
        with("[-1.05, 1.0]", "[0.5, 0.55]"),
        "arm.toml:11: joint \"shoulder\": ends is [0.5, 0.55]; the joint must be able to move between them"
    );
    assert!(with("[slowing.shoulder]", "[slowing.grip]").contains("known: shoulder, slide"));
}

#[test]
fn errors_name_line_value_and_remedy() {
    let with = |from: &str, to: &str| problems(URDF, &TOML.replace(from, to));
    assert_eq!(
        with("value = 0.5", "value = 1.5"),
        "arm.toml:6: joint \"shoulder\": home is 1.5; it must be within its limits [-1, 1]"
    );
    assert_eq!(
        with("flange = \"tool\"", "flange = \"hand\""),
        "arm.toml:3: there is no link \"hand\"; known: world, base, upper, tool, jaw"
    );
    assert_eq!(
        with("flange = \"tool\"", "flange = \"world\""),
        "arm.toml:3: link \"world\" is not carried by \"base\"; base and flange must be on one chain of joints"
    );
    assert_eq!(
        with("slide = { value = 0.1, unit = \"m\", source = \"test\" }\n", ""),
        "arm.toml:1: joint \"slide\" has no position in [home]"
    );
    assert_eq!(
        with("[limits.slide]\nspeed = { value = 0.2, unit = \"m/s\", source = \"test\" }\n", ""),
        "arm.urdf:9: joint \"slide\" has no velocity in its <limit>; state it there, or as `speed` in [limits.slide]"
    );
    assert_eq!(
        with("speed = { value = 0.2, unit = \"m/s\"", "position = { value = [0.4, 0.2], unit = \"m\""),
        "arm.urdf:9: joint \"slide\" has no velocity in its <limit>; state it there, or as `speed` in [limits.slide]\n\
         arm.toml:9: joint \"slide\": position is [0.4, 0.2]; the upper end must be greater"
    );
    assert!(
        with("[limits.slide]", "[limits.grip]")
            .contains("there is no joint between base and flange \"grip\"; known: shoulder, slide")
    );
    assert!(with("unit = \"kg\"", "unit = \"g\"").contains("payload is in \"g\"; give it in \"kg\""));
    assert!(with("value = 2.0", "value = -2.0").contains("payload is -2; it must be greater than 0"));
    assert!(with("[home]", "[homes]").contains("unknown field"));
    let upside_down = URDF.replace("lower=\"-1\" upper=\"1\"", "lower=\"1\" upper=\"-1\"");
    assert!(
        problems(&upside_down, TOML)
            .contains("arm.urdf:7: joint \"shoulder\": limit is [1, -1]; the upper end must be greater")
    );
}

#[test]
fn unknown_names_list_the_known_ones() {
    let error = arm_asset("panda").unwrap_err().to_string();
    assert!(error.contains("known: fr3, ur5e, xarm7, so101"), "{error}");
}
