//! The open and the closed hand: positions of actuators and joints at a preshape, and the units of both.

use crate::grasp::Preshape;
use crate::model::{Actuator, DrivenJoint, Hand, Joint, JointKind, Tendon, Transmission, within};

/// Halvings of an interval of tensions: to a millionth of a millionth of it.
const BISECTIONS: usize = 40;

impl Hand {
    /// The preshapes that a planner should try; never empty.
    #[must_use]
    pub fn preshapes(&self) -> &[Preshape] {
        &self.grasp.preshapes
    }

    /// Width of the widest object that goes between the fingers of the open hand, metres: the greatest that a preshape states,
    /// infinite where one states none.
    #[must_use]
    pub fn widest(&self) -> f64 {
        self.grasp.preshapes.iter().map(|preshape| preshape.face.width[1]).fold(0.0, f64::max)
    }

    /// Least and greatest preshape; equal for a hand without preshapes.
    #[must_use]
    pub fn preshape_limits(&self) -> [f64; 2] {
        match self.grasp.coordinate {
            Some(coordinate) => coordinate.limits,
            None => [0.0, self.grasp.preshapes.len().saturating_sub(1) as f64],
        }
    }

    /// True if the hand has more than one preshape.
    #[must_use]
    pub fn has_preshapes(&self) -> bool {
        let [low, high] = self.preshape_limits();
        low < high
    }

    /// Unit of a preshape: `rad`, `m`, or `1` for the number of a name.
    #[must_use]
    pub fn preshape_unit(&self) -> &'static str {
        self.grasp.coordinate.map_or("1", |coordinate| self.position_unit(&self.actuators[coordinate.actuator]))
    }

    /// The named preshape nearest to `preshape`.
    #[must_use]
    pub fn nearest_preshape(&self, preshape: f64) -> Option<&Preshape> {
        let distance = |named: &Preshape| (named.value - preshape).abs();
        self.grasp.preshapes.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// Indices of the actuators but the preshape coordinate's, in the order of `actuators`.
    pub fn grasp_actuators(&self) -> impl Iterator<Item = usize> + '_ {
        let preshape = self.grasp.coordinate.map(|coordinate| coordinate.actuator);
        (0..self.actuators.len()).filter(move |actuator| preshape != Some(*actuator))
    }

    /// Position of every actuator of the open hand at `preshape`, in the order of `actuators`, rad or m.
    #[must_use]
    pub fn open_positions(&self, preshape: f64) -> Vec<f64> {
        let mut positions: Vec<f64> = self.actuators.iter().map(|actuator| actuator.travel[0]).collect();
        if let Some(coordinate) = self.grasp.coordinate {
            positions[coordinate.actuator] = preshape;
        } else if let Some(named) = self.nearest_preshape(preshape) {
            for &(actuator, position) in &named.positions {
                positions[actuator] = position;
            }
        }
        positions
    }

    /// Position of every actuator of the hand closed as far as it goes from `preshape`, in the order of `actuators`, rad or m.
    #[must_use]
    pub fn closed_positions(&self, preshape: f64) -> Vec<f64> {
        let mut positions = self.open_positions(preshape);
        for &actuator in &self.grasp.closing {
            positions[actuator] = self.actuators[actuator].travel[1];
        }
        positions
    }

    /// Positions of the independent joints of the open hand at `preshape`, in the order of [`Hand::coordinates`]: where their actuators
    /// lead them, where a tendon that the preshape winds balances their springs, and otherwise at 0 or the nearest limit.
    #[must_use]
    pub fn open_configuration(&self, preshape: f64) -> Vec<f64> {
        let actuators = self.open_positions(preshape);
        let open = |joint: usize| {
            let driven = self.driver(joint).map(|(actuator, driven, _)| self.led(driven, actuators[actuator]));
            driven.or_else(|| self.pulled(joint, &actuators)).unwrap_or_else(|| self.joints[joint].within_limits(0.0))
        };
        self.coordinates().map(open).collect()
    }

    /// Where a sprung joint of the free hand balances the tendon that a spool has wound, rad or m; `None` without such a tendon.
    fn pulled(&self, joint: usize, actuators: &[f64]) -> Option<f64> {
        let wound = self.actuators.iter().zip(actuators).find_map(|(actuator, position)| match actuator.transmission {
            Transmission::Spool { tendon, radius } => {
                let tendon = &self.tendons[tendon];
                (tendon.arm(joint) != 0.0 && *position > 0.0).then_some((tendon, radius * position))
            }
            Transmission::Joints { .. } => None,
        });
        let (tendon, length) = wound?;
        let data = &self.joints[joint];
        let force = || tendon.arm(joint) * self.free_tension(tendon, length);
        (data.stiffness > 0.0).then(|| data.within_limits(data.balanced(force())))
    }

    /// Tension of a tendon of which a length is wound while only springs and limits hold its joints, N.
    fn free_tension(&self, tendon: &Tendon, length: f64) -> f64 {
        let sprung = tendon.arms.iter().map(|&(joint, arm)| (&self.joints[joint], arm));
        let sprung: Vec<(&Joint, f64)> = sprung.filter(|(joint, _)| joint.stiffness > 0.0).collect();
        let taken = |tension: f64| -> f64 {
            sprung.iter().map(|(joint, arm)| arm * joint.within_limits(joint.balanced(arm * tension))).sum()
        };
        // What the joints and the tendon itself take up grows with the tension.
        let halve = |[low, high]: [f64; 2], _| {
            let middle = 0.5 * (low + high);
            if taken(middle) + middle / tendon.stiffness < length { [middle, high] } else { [low, middle] }
        };
        (0..BISECTIONS).fold([0.0, tendon.max_tension], halve)[0]
    }

    /// Positions of the independent joints of a free hand that has closed by a share of the way, in the order of [`Hand::coordinates`]: a
    /// joint that closes goes from where it is in the open hand to its limit, any other stays.
    ///
    /// * `share`: 0 open, 1 closed.
    #[must_use]
    pub fn closed_configuration(&self, preshape: f64, share: f64) -> Vec<f64> {
        let closed = |(joint, open): (usize, f64)| {
            let [lower, upper] = self.joints[joint].limits;
            let rate = self.closing_rate(joint);
            let end = if rate > 0.0 { upper } else { lower };
            if rate == 0.0 { open } else { open + share * (end - open) }
        };
        self.coordinates().zip(self.open_configuration(preshape)).map(closed).collect()
    }

    /// Where a driven joint is led with its actuator at `position`, rad or m.
    #[must_use]
    pub fn led(&self, driven: &DrivenJoint, position: f64) -> f64 {
        within(driven.ratio * position + driven.offset, self.joints[driven.joint].limits)
    }

    /// How fast a joint moves as its closing actuator closes: the moment arm of the tendon, or the ratio at which it is driven; that of the
    /// joint that it follows, times the ratio. 0 for a joint that does not close.
    #[must_use]
    pub fn closing_rate(&self, joint: usize) -> f64 {
        if let Some(mimic) = self.joints[joint].mimic {
            return mimic.ratio * self.closing_rate(mimic.joint);
        }
        let rate = |actuator: &usize| match &self.actuators[*actuator].transmission {
            Transmission::Spool { tendon, .. } => self.tendons[*tendon].arm(joint),
            Transmission::Joints { joints, .. } => {
                joints.iter().find(|driven| driven.joint == joint).map_or(0.0, |driven| driven.ratio)
            }
        };
        self.grasp.closing.iter().map(rate).find(|rate| *rate != 0.0).unwrap_or(0.0)
    }

    /// Kind of the motion that an actuator's positions mean: that of its joints, or revolute for a spool.
    #[must_use]
    pub fn motion_kind(&self, actuator: &Actuator) -> JointKind {
        match &actuator.transmission {
            Transmission::Spool { .. } => JointKind::Revolute,
            Transmission::Joints { joints, .. } => {
                joints.first().map_or(JointKind::Revolute, |driven| self.joints[driven.joint].kind)
            }
        }
    }

    /// Unit of an actuator's positions: `rad` or `m`.
    #[must_use]
    pub fn position_unit(&self, actuator: &Actuator) -> &'static str {
        self.motion_kind(actuator).unit()
    }

    /// Unit of an actuator's load: `N` at a tendon, else that of its joints.
    #[must_use]
    pub fn load_unit(&self, actuator: &Actuator) -> &'static str {
        match actuator.transmission {
            Transmission::Spool { .. } => "N",
            Transmission::Joints { .. } => self.motion_kind(actuator).force_unit(),
        }
    }
}
