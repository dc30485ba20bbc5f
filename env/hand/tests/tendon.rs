//! Statics of tendons and springs against virtual work.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_hand::assets::asset;
use graspbox_hand::{Hand, Joint, Tendon, Transmission};
use nalgebra::Point3;
use proptest::prelude::*;

fn hand() -> &'static Hand {
    Hand::reflex().unwrap()
}

/// The tendon of finger 1, and the two joints that it spans.
fn finger() -> (&'static Tendon, [&'static Joint; 2]) {
    let tendon = &hand().tendons[0];
    assert_eq!(tendon.arms.len(), 2);
    (tendon, [0, 1].map(|i| &hand().joints[tendon.arms[i].0]))
}

fn take_up(p: f64, d: f64) -> f64 {
    let tendon = finger().0;
    tendon.take_up(|joint| if joint == tendon.arms[0].0 { p } else { d })
}

/// Elastic energy of the taut tendon (while it is not saturated) and of both springs, J.
fn energy(wound: f64, p: f64, d: f64) -> f64 {
    let (t, joints) = finger();
    let spring = |joint: &Joint, q: f64| 0.5 * joint.stiffness * (q - joint.spring_reference).powi(2);
    0.5 * t.stiffness * (wound - take_up(p, d)).max(0.0).powi(2) + spring(joints[0], p) + spring(joints[1], d)
}

proptest! {
    /// Joint torques are minus the gradient of the energy in each joint's own angle.
    #[test]
    fn torques_do_the_work_of_the_tendon(p in 0.0..2.5f64, d in 0.0..2.5f64, tension in 0.0..49.0f64) {
        let (t, joints) = finger();
        let wound = take_up(p, d) + tension / t.stiffness;
        prop_assert!((t.tension(wound - take_up(p, d), 0.0) - tension).abs() < 1e-6);
        let h = 1e-6;
        let slope_p = (energy(wound, p + h, d) - energy(wound, p - h, d)) / (2.0 * h);
        let slope_d = (energy(wound, p, d + h) - energy(wound, p, d - h)) / (2.0 * h);
        let torque_p = t.arms[0].1 * tension + joints[0].spring_force(p);
        let torque_d = t.arms[1].1 * tension + joints[1].spring_force(d);
        // The tendon is slack on one side of the difference where the tension is near 0: 0.5 k r^2 h = 2.5e-6 N m.
        prop_assert!((torque_p + slope_p).abs() < 1e-5, "proximal {torque_p} against {slope_p}");
        prop_assert!((torque_d + slope_d).abs() < 1e-5, "distal {torque_d} against {slope_d}");
        prop_assert!((torque_p - (0.010 * tension - 0.01 * (p + 5.0))).abs() < 1e-12);
        prop_assert!((torque_d - (0.006 * tension - 0.1 * d)).abs() < 1e-12);
    }

    /// Never pushes, never pulls harder than it may.
    #[test]
    fn tension_is_unilateral_and_bounded(stretch in -0.01..0.01f64, rate in -1.0..1.0f64) {
        let tension = finger().0.tension(stretch, rate);
        prop_assert!((0.0..=50.0).contains(&tension));
        prop_assert!(stretch > 0.0 || tension == 0.0, "a slack tendon pulls with {} N", tension);
        let still = finger().0.tension(stretch, 0.0);
        prop_assert!((tension - still) * rate >= 0.0, "damping must resist the stretching");
    }
}

/// The spool of a free finger takes up both joints' whole range within the actuator's travel.
#[test]
fn a_free_finger_closes_fully_at_the_end_of_the_travel() {
    let [p, d] = finger().1.map(|joint| joint.limits[1]);
    let Transmission::Spool { tendon: 0, radius } = hand().actuators[0].transmission else { panic!("winds finger 1") };
    let (spool, travel) = (take_up(p, d) / radius, hand().actuators[0].travel[1]);
    assert!((0.97..=1.0).contains(&(spool / travel)), "{spool} of {travel} rad");
}

/// Pressing with the distal link against something that does not yield, a straight finger at 50 N of tension pushes with
/// 8 to 15 N at each of its distal sensors: the force whose moment about the distal joint balances the tendon.
#[test]
fn a_fingertip_presses_with_8_to_15_newtons() {
    let (hand, (tendon, [_, distal])) = (hand(), finger());
    let straight = hand.open_configuration(0.0);
    let h = 1e-6;
    let bent: Vec<f64> = straight
        .iter()
        .zip(hand.coordinates())
        .map(|(q, j)| if hand.joints[j] == *distal { q + h } else { *q })
        .collect();
    let [before, after] = [straight, bent].map(|c| hand.forward_kinematics(&c).unwrap());
    let torque = tendon.arm(tendon.arms[1].0) * 50.0 + distal.spring_force(0.0);
    let mut forces = Vec::new();
    for s in hand.sensors.iter().filter(|s| s.link == distal.child) {
        let [from, to]: [Point3<f64>; 2] = [before[s.link] * s.position, after[s.link] * s.position];
        let lever = ((to - from) / h).dot(&(before[s.link].rotation * s.normal));
        forces.push(torque / lever);
    }
    assert_eq!(forces.len(), 4);
    assert!(forces.iter().all(|f| (8.0..=15.0).contains(f)), "fingertip forces {forces:?} N");
}

/// A preshape that winds the tendon: springs and tendon are in balance, or the joint is at its limit.
#[test]
fn a_preshape_that_winds_a_tendon_begins_in_balance() {
    let files = asset("soft_hand").unwrap();
    let preshape = "[[grasp.preshapes]]\nname = \"bent\"\n\
        positions.motor = { value = 8.0, unit = \"rad\", source = \"test\" }\n\n[grasp.ranking]\n";
    let toml = files.toml.replace("[grasp.ranking]\n", preshape);
    let hand = Hand::from_strs(files.urdf, &toml, ["soft_hand.urdf", "hand.toml"]).unwrap();
    let joints = hand.joint_positions(&hand.open_configuration(0.0)).unwrap();
    let Transmission::Spool { tendon: 0, radius } = hand.actuators[0].transmission else {
        panic!("the motor winds the tendon");
    };
    let tendon = &hand.tendons[0];
    let stretch = 8.0 * radius - tendon.take_up(|joint| joints[joint]);
    let tension = tendon.tension(stretch, 0.0);
    assert!((1.0..tendon.max_tension).contains(&tension), "{tension} N");
    let mut moved = 0;
    for &(joint, arm) in &tendon.arms {
        let (data, position) = (&hand.joints[joint], joints[joint]);
        let [low, high] = data.limits;
        let torque = arm * tension + data.spring_force(position);
        let held = (position == low && torque <= 0.0) || (position == high && torque >= 0.0);
        assert!(held || torque.abs() < 1e-6, "{}: {torque} N m at {position}", data.name);
        moved += usize::from(position > low + 0.05 && position < high - 0.05);
    }
    assert!(moved > 10, "{moved} joints between their limits");
}
