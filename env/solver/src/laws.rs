//! Forces along the coordinates that depend on the velocity to be found: cables and joint stops, each implicit in its own rate.

use crate::tree::{Cable, Coordinate};

/// Share of its damping that a cable keeps while its force is at the limit: friction of tendon and sheath still brakes the joints, but the
/// motor no longer resists. Without it held objects wobble.
const SATURATED_DAMPING: f64 = 0.2;

/// A cable that is just taut pulls with this multiple of its elastic force at most: it does not pull by its damping alone.
const TAUT: f64 = 20.0;

/// A cable during one step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CableState {
    /// Stretch at the beginning of the step, metres.
    pub stretch: f64,
    /// Rate at which its length is given, m/s.
    pub given_rate: f64,
    /// Force at the end of the step, N.
    pub force: f64,
}

impl CableState {
    /// Damping that acts on the coordinates through the arms while the cable is saturated at the beginning of the step, N s/m.
    pub fn saturated_damping(&self, cable: &Cable) -> f64 {
        let saturated = cable.stiffness * self.stretch.abs() >= cable.max_force;
        let pulls = !cable.unilateral || self.stretch > 0.0;
        if saturated && pulls { SATURATED_DAMPING * cable.damping } else { 0.0 }
    }

    /// Rate of the stretch for the velocities of the free coordinates.
    #[inline]
    pub fn rate(&self, cable: &Cable, velocity: &[f64]) -> f64 {
        self.given_rate - cable.arms.iter().map(|(c, arm)| arm * velocity[*c]).sum::<f64>()
    }

    /// Force at the end of a step in which the stretch grows at `rate`, and its derivative by that rate.
    #[inline]
    pub fn law(&self, cable: &Cable, rate: f64, dt: f64) -> (f64, f64) {
        let after = self.stretch + dt * rate;
        let (elastic, full) = (cable.stiffness * after, cable.stiffness * after + cable.damping * rate);
        let slope = cable.stiffness * dt + cable.damping;
        if !cable.unilateral {
            let bounded = full.clamp(-cable.max_force, cable.max_force);
            return (bounded, if bounded == full { slope } else { 0.0 });
        }
        if after <= 0.0 || full <= 0.0 {
            return (0.0, 0.0);
        }
        let (force, slope) =
            if full < TAUT * elastic { (full, slope) } else { (TAUT * elastic, TAUT * cable.stiffness * dt) };
        if force >= cable.max_force { (cable.max_force, 0.0) } else { (force, slope) }
    }
}

/// Torque of a coordinate's stops at the end of a step with velocity `v` from position `q`, and minus its derivative by `v`.
#[inline]
pub(crate) fn stop(coordinate: &Coordinate, q: f64, v: f64, dt: f64) -> (f64, f64) {
    let after = q + dt * v;
    let [low, high] = coordinate.limits;
    let beyond = if after < low {
        low - after
    } else if after > high {
        high - after
    } else {
        return (0.0, 0.0);
    };
    (coordinate.stop_stiffness * beyond, coordinate.stop_stiffness * dt)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tendon() -> Cable {
        Cable { arms: vec![(0, 0.01), (1, 0.006)], stiffness: 5e4, damping: 300.0, max_force: 50.0, unilateral: true }
    }

    /// The derivative that Newton's method uses is the one of the law.
    #[test]
    fn slopes_are_derivatives() {
        let mut servo = tendon();
        servo.unilateral = false;
        for cable in [tendon(), servo] {
            for stretch in [-1e-4, 1e-6, 3e-4, 9e-4, 2e-3] {
                let state = CableState { stretch, ..CableState::default() };
                for rate in [-0.3, -0.02, 0.0, 0.013, 0.2] {
                    let h = 1e-9;
                    let ((f, slope), (after, _)) = (state.law(&cable, rate, 0.002), state.law(&cable, rate + h, 0.002));
                    assert!(((after - f) / h - slope).abs() < 1e-3 * slope.max(1.0), "{stretch} {rate}");
                }
            }
        }
    }

    #[test]
    fn a_tendon_does_not_push_and_a_servo_does() {
        let slack = CableState { stretch: -1e-4, ..CableState::default() };
        let mut cable = tendon();
        assert_eq!(slack.law(&cable, 0.0, 0.002).0, 0.0);
        cable.unilateral = false;
        assert_eq!(slack.law(&cable, 0.0, 0.002).0, -5.0);
        let pulled = CableState { stretch: 1.0, ..CableState::default() };
        assert_eq!(pulled.law(&cable, 0.0, 0.002).0, 50.0);
    }

    #[test]
    fn stops_push_back_from_both_ends() {
        let coordinate = Coordinate {
            armature: 0.0,
            damping: 0.0,
            stiffness: 0.0,
            spring_reference: 0.0,
            limits: [0.0, 1.0],
            stop_stiffness: 20.0,
        };
        assert_eq!(stop(&coordinate, 0.5, 0.0, 0.002).0, 0.0);
        assert!((stop(&coordinate, -0.1, 0.0, 0.002).0 - 2.0).abs() < 1e-12);
        assert!((stop(&coordinate, 1.1, 0.0, 0.002).0 + 2.0).abs() < 1e-12);
    }
}
