//! Force laws of cables and joint stops, implicit: the force at the end of the step as a function of the unknown velocity.

use crate::tree::{Cable, Coordinate};

/// Share of its damping that a cable keeps while its force is at the limit, dimensionless: friction between tendon and sheath still brakes
/// the joints, but the motor no longer resists. Without it, held objects wobble.
const SATURATED_DAMPING: f64 = 0.2;

/// Greatest force of a unilateral cable as a multiple of its elastic force, dimensionless: a cable that is barely taut must not pull by
/// damping alone.
const MAX_FORCE_RATIO: f64 = 20.0;

/// State of a cable during one step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CableState {
    /// Stretch at the beginning of the step, metres.
    pub stretch: f64,
    /// Commanded rate of its length, m/s.
    pub command_rate: f64,
    /// Force at the end of the step, N.
    pub force: f64,
}

impl CableState {
    /// Damping that a cable exerts while it is saturated at the beginning of the step, N s/m; 0 otherwise.
    pub fn saturated_damping(&self, cable: &Cable) -> f64 {
        let saturated = cable.stiffness * self.stretch.abs() >= cable.max_force;
        let pulls = !cable.unilateral || self.stretch > 0.0;
        if saturated && pulls { SATURATED_DAMPING * cable.damping } else { 0.0 }
    }

    /// Rate of the stretch at the given velocities of the free coordinates, m/s.
    #[inline]
    pub fn rate(&self, cable: &Cable, velocity: &[f64]) -> f64 {
        self.command_rate - cable.arms.iter().map(|(c, arm)| arm * velocity[*c]).sum::<f64>()
    }

    /// Force at the end of a step in which the stretch grows at `rate`, N, and its derivative with respect to that rate, N s/m.
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
        let (force, slope) = if full < MAX_FORCE_RATIO * elastic {
            (full, slope)
        } else {
            (MAX_FORCE_RATIO * elastic, MAX_FORCE_RATIO * cable.stiffness * dt)
        };
        if force >= cable.max_force { (cable.max_force, 0.0) } else { (force, slope) }
    }
}

/// Torque of a coordinate's stops at the end of a step from position `q` at velocity `v`, and the negative of its derivative with respect to
/// `v`.
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

    /// A bug here: a derivative for Newton's method that is not the derivative of the force.
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
