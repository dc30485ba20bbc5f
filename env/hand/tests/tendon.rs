//! Tendon statics against virtual work.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_hand::{Finger, Hand, HandConfiguration};
use nalgebra::Point3;
use proptest::prelude::*;

fn finger() -> &'static Finger {
    &Hand::reflex().unwrap().fingers[0]
}

/// Elastic energy of the taut tendon (while it is not saturated) and of the flexure, J.
fn energy(spool: f64, p: f64, d: f64) -> f64 {
    let (t, f) = (&finger().tendon, &finger().flexure);
    0.5 * t.stiffness * t.stretch(spool, p, d).max(0.0).powi(2)
        + 0.5 * f.stiffness * (d - f.rest).powi(2)
        + 0.5 * f.proximal_stiffness * (p - f.proximal_rest).powi(2)
}

proptest! {
    /// Joint torques are minus the gradient of the energy in each joint's own angle.
    #[test]
    fn torques_do_the_work_of_the_tendon(p in 0.0..2.5f64, d in 0.0..2.5f64, tension in 0.0..49.0f64) {
        let (t, f) = (&finger().tendon, &finger().flexure);
        let spool = (t.take_up(p, d) + tension / t.stiffness) / t.spool_radius;
        prop_assert!((t.tension(t.stretch(spool, p, d), 0.0) - tension).abs() < 1e-6);
        let h = 1e-6;
        let slope_p = (energy(spool, p + h, d) - energy(spool, p - h, d)) / (2.0 * h);
        let slope_d = (energy(spool, p, d + h) - energy(spool, p, d - h)) / (2.0 * h);
        let [torque_p, torque_d] = t.torques(tension, f, p, d);
        // The tendon is slack on one side of the difference where the tension is near 0: 0.5 k r^2 h = 2.5e-6 N m.
        prop_assert!((torque_p + slope_p).abs() < 1e-5, "proximal {torque_p} against {slope_p}");
        prop_assert!((torque_d + slope_d).abs() < 1e-5, "distal {torque_d} against {slope_d}");
        prop_assert!((torque_p - (0.010 * tension - 0.01 * (p + 5.0))).abs() < 1e-12);
        prop_assert!((torque_d - (0.006 * tension - 0.1 * d)).abs() < 1e-12);
    }

    /// Never pushes, never pulls harder than it may.
    #[test]
    fn tension_is_unilateral_and_bounded(stretch in -0.01..0.01f64, rate in -1.0..1.0f64) {
        let tension = finger().tendon.tension(stretch, rate);
        prop_assert!((0.0..=50.0).contains(&tension));
        prop_assert!(stretch > 0.0 || tension == 0.0, "a slack tendon pulls with {} N", tension);
        let still = finger().tendon.tension(stretch, 0.0);
        prop_assert!((tension - still) * rate >= 0.0, "damping must resist the stretching");
    }
}

/// The spool of a free finger takes up both joints' whole range within the motor's travel.
#[test]
fn a_free_finger_closes_fully_at_the_end_of_the_travel() {
    let hand = Hand::reflex().unwrap();
    let [p, d] = [finger().proximal, finger().distal].map(|j| hand.joints[j].limits[1]);
    let spool = finger().tendon.take_up(p, d) / finger().tendon.spool_radius;
    let travel = hand.motors[finger().motor].travel[1];
    assert!((0.97..=1.0).contains(&(spool / travel)), "{spool} of {travel} rad");
}

/// Pressing with the distal link against something that does not yield, a straight finger at 50 N of tension pushes with
/// 8 to 15 N at each of its distal sensors: the force whose moment about the distal joint balances the tendon.
#[test]
fn a_fingertip_presses_with_8_to_15_newtons() {
    let hand = Hand::reflex().unwrap();
    let straight = hand.open_configuration(0.0);
    let h = 1e-6;
    let bent = HandConfiguration { distal: vec![h; 3], ..straight.clone() };
    let [before, after] = [straight, bent].map(|c| hand.forward_kinematics(&c).unwrap());
    let [_, torque] = finger().tendon.torques(50.0, &finger().flexure, 0.0, 0.0);
    let mut forces = Vec::new();
    for s in hand.sensors.iter().filter(|s| s.finger == 0 && s.link == hand.joints[finger().distal].child) {
        let [from, to]: [Point3<f64>; 2] = [before[s.link] * s.position, after[s.link] * s.position];
        let lever = ((to - from) / h).dot(&(before[s.link].rotation * s.normal));
        forces.push(torque / lever);
    }
    assert_eq!(forces.len(), 4);
    assert!(forces.iter().all(|f| (8.0..=15.0).contains(f)), "fingertip forces {forces:?} N");
}
