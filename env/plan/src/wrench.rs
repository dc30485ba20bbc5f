//! The grasp wrench space of contacts in sampled directions. The planner evaluates predicted contacts, the environments present ones.
//!
//! Each finger presses with one unit of normal force in total; friction cones are exact; torques are divided by [`LENGTH`].

use crate::boxes::half_sphere;
use nalgebra::Vector3;
use std::f64::consts::FRAC_1_SQRT_2;
use std::sync::LazyLock;

/// Length by which torques are divided to compare them with forces, metres: half the size of a grasped object.
pub const LENGTH: f64 = 0.05;
/// Number of directions of the fine set besides the axes: as many forces, as many torques, and mixtures of both.
const FINE: usize = 24;

/// Directions of force and torque over which the minimum is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Directions {
    /// Forces and torques along the axes, and their pairs: 48 directions, fast enough for every control period.
    Axes,
    /// The axes, 24 directions spread over half a sphere in both senses, and mixtures: 204 directions.
    Fine,
}

/// The wrench space of one unit of normal force per finger, about a centre.
///
/// ```
/// use graspbox_plan::{Directions, WrenchSpace};
/// use nalgebra::Vector3;
///
/// let mut space = WrenchSpace::new(2);
/// // Two fingers face to face, 6 cm apart, each with contacts 2 cm above and below.
/// for (finger, x) in [(0, 0.03), (1, -0.03)] {
///     for y in [-0.02, 0.02] {
///         space.press(finger, &Vector3::new(x, y, 0.0), Vector3::new(-x, 0.0, 0.0).normalize(), 0.8);
///     }
/// }
/// let lift = space.support(&Vector3::z(), &Vector3::zeros());
/// assert!((lift - 1.6).abs() < 1e-12);
/// assert!(space.epsilon(Directions::Fine) > 0.0);
/// ```
#[derive(Clone, Debug)]
pub struct WrenchSpace {
    fingers: Vec<Vec<Contact>>,
}

#[derive(Clone, Copy, Debug)]
struct Contact {
    /// Unit normal into the object.
    inward: Vector3<f64>,
    /// From the centre, in units of [`LENGTH`].
    arm: Vector3<f64>,
    friction: f64,
}

impl Contact {
    /// Greatest component along (`force`, `torque`) of a wrench with at most one unit of normal force.
    fn support(&self, force: &Vector3<f64>, torque: &Vector3<f64>) -> f64 {
        // (arm x f) . torque = f . (torque x arm): one vector gives the contribution of each force component.
        let helps = force + torque.cross(&self.arm);
        let normal = helps.dot(&self.inward);
        let tangent = (helps - self.inward * normal).norm();
        (normal + self.friction * tangent).max(0.0)
    }
}

impl WrenchSpace {
    /// A wrench space without contacts, for `fingers` fingers (the palm may be one).
    pub fn new(fingers: usize) -> Self {
        Self { fingers: vec![Vec::new(); fingers] }
    }

    /// Adds a contact of `finger`; fingers beyond the number of [`WrenchSpace::new`] are ignored.
    ///
    /// * `arm`: vector from the centre to the contact, metres.
    /// * `inward`: unit normal into the object.
    /// * `friction`: coefficient of friction.
    pub fn press(&mut self, finger: usize, arm: &Vector3<f64>, inward: Vector3<f64>, friction: f64) {
        if let Some(contacts) = self.fingers.get_mut(finger) {
            contacts.push(Contact { inward, arm: arm / LENGTH, friction });
        }
    }

    /// Greatest component along (`force`, `torque`) of a wrench with at most one unit of normal force per finger.
    pub fn support(&self, force: &Vector3<f64>, torque: &Vector3<f64>) -> f64 {
        let best = |contacts: &Vec<Contact>| contacts.iter().map(|c| c.support(force, torque)).fold(0.0, f64::max);
        self.fingers.iter().map(best).sum()
    }

    /// Least support over sampled directions: 0 without force closure, or with fewer than two fingers in contact. An upper bound of the
    /// epsilon quality for a force bound per finger.
    ///
    /// Source: Ferrari, Canny, "Planning optimal grasps", ICRA 1992.
    pub fn epsilon(&self, directions: Directions) -> f64 {
        if self.fingers.iter().filter(|contacts| !contacts.is_empty()).count() < 2 {
            return 0.0;
        }
        match directions {
            Directions::Axes => self.least_along_axes(),
            Directions::Fine => self.least_all_around(),
        }
    }

    /// [`WrenchSpace::support`] if it is less than `bound`; otherwise any value of at least `bound`, at less cost.
    fn support_below(&self, force: &Vector3<f64>, torque: &Vector3<f64>, bound: f64) -> f64 {
        let mut sum = 0.0;
        for contacts in &self.fingers {
            sum += contacts.iter().map(|c| c.support(force, torque)).fold(0.0, f64::max);
            // The other fingers can only increase it.
            if sum >= bound {
                break;
            }
        }
        sum
    }

    /// Least support over `directions`; stops once it is 0.
    fn least(&self, directions: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)>) -> f64 {
        let mut least = f64::INFINITY;
        for (force, torque) in directions {
            least = least.min(self.support_below(&force, &torque, least));
            if least <= 0.0 {
                break;
            }
        }
        least
    }

    fn least_along_axes(&self) -> f64 {
        let none = Vector3::zeros();
        let around = |axis: Vector3<f64>| {
            let mixed = move |j: usize| {
                let (force, torque) = (axis * FRAC_1_SQRT_2, Vector3::ith(j, FRAC_1_SQRT_2));
                [(force, torque), (force, -torque)]
            };
            [(axis, none), (none, axis)].into_iter().chain((0..3).flat_map(mixed))
        };
        let axes = (0..3).map(|i| Vector3::ith(i, 1.0)).flat_map(|axis| [axis, -axis]);
        self.least(axes.flat_map(around))
    }

    fn least_all_around(&self) -> f64 {
        self.least(FINE_DIRECTIONS.iter().flat_map(|&(force, torque)| [(force, torque), (-force, -torque)]))
    }
}

/// The axes, and the directions of [`FINE`] with their mixtures, each in one sense only.
static FINE_DIRECTIONS: LazyLock<Vec<(Vector3<f64>, Vector3<f64>)>> = LazyLock::new(|| {
    let none = Vector3::zeros();
    let axes = (0..3).map(|i| Vector3::ith(i, 1.0)).flat_map(|a| [(a, none), (none, a)]);
    let mut torques: Vec<Vector3<f64>> = half_sphere(FINE).collect();
    torques.reverse();
    let mixed = |(f, t): (Vector3<f64>, Vector3<f64>)| {
        let shares = [(1.0, 0.0), (0.0, 1.0), (FRAC_1_SQRT_2, FRAC_1_SQRT_2), (FRAC_1_SQRT_2, -FRAC_1_SQRT_2)];
        shares.map(|(a, b)| (f * a, t * b))
    };
    axes.chain(half_sphere(FINE).zip(torques).flat_map(mixed)).collect()
});

#[cfg(test)]
mod tests {
    use super::*;

    fn pinch(friction: f64) -> WrenchSpace {
        let mut space = WrenchSpace::new(2);
        // Two fingers, each with a contact line, face to face.
        for (finger, x) in [(0, 0.03_f64), (1, -0.03)] {
            for y in [-0.02, 0.02] {
                space.press(finger, &Vector3::new(x, y, 0.0), Vector3::new(-x.signum(), 0.0, 0.0), friction);
            }
        }
        space
    }

    #[test]
    fn friction_lifts_as_coulomb_says() {
        let lift = |friction| pinch(friction).support(&Vector3::z(), &Vector3::zeros());
        assert!((lift(0.5) - 1.0).abs() < 1e-12, "{}", lift(0.5));
        assert_eq!(lift(0.0), 0.0);
    }

    #[test]
    fn without_friction_a_pinch_closes_nothing() {
        for directions in [Directions::Axes, Directions::Fine] {
            assert_eq!(pinch(0.0).epsilon(directions), 0.0);
            assert!(pinch(1.0).epsilon(directions) > 0.1);
        }
    }

    /// A bug here: a missing direction, or a bound that ends a sum too early.
    #[test]
    fn epsilon_is_the_least_support_of_all_directions() {
        let mut space = pinch(0.7);
        space.press(1, &Vector3::new(-0.02, 0.01, 0.03), Vector3::new(0.6, -0.64, 0.48), 1.0);
        let support = |(f, t): &(Vector3<f64>, Vector3<f64>)| space.support(f, t).min(space.support(&-f, &-t));
        assert_eq!(FINE_DIRECTIONS.len(), 102);
        let least = FINE_DIRECTIONS.iter().map(support).fold(f64::INFINITY, f64::min);
        assert!(least > 0.0);
        assert_eq!(space.epsilon(Directions::Fine), least);
    }

    #[test]
    fn one_sided_contacts_close_nothing() {
        let mut space = WrenchSpace::new(1);
        space.press(0, &Vector3::new(0.03, 0.0, 0.0), -Vector3::x(), 1.0);
        assert_eq!(space.epsilon(Directions::Fine), 0.0);
    }
}
