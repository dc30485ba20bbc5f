//! A finger that closes in its plane until it is blocked: what an underactuated finger does, without dynamics.
//!
//! The finger is two chains of rectangles in the plane across its joints' axis. One tendon pulls both joints: it shortens by
//! `r_p dq_p + r_d dq_d`, and the finger moves wherever that is positive and nothing is in the way. First the proximal joint closes, the
//! distal straight; then the distal closes alone; and where only the tip is held, it curls further while the proximal joint gives way.

use super::plane::{Frame, LinkShape, Obstacles, PlanePoint, PlaneTable, Rect};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::PlanError;
use graspbox_hand::{Hand, Material};

/// A finger at one preshape.
#[derive(Clone, Debug)]
pub(crate) struct FingerModel {
    /// Plane of the finger: origin on the proximal joint, x along the open finger, y across, z towards the closing side.
    pub hand_from_plane: Isometry3<f64>,
    links: [LinkShape; 2],
    /// Distal joint, proximal link's frame.
    distal_at: [f64; 2],
    /// Half the width of the finger.
    pub half_width: f64,
    /// Furthest reach from the proximal joint.
    pub reach: f64,
    limits: [f64; 2],
    arms: [f64; 2],
}

/// A finger after closing.
#[derive(Clone, Debug, Default)]
pub(crate) struct ClosedFinger {
    pub proximal: f64,
    pub distal: f64,
    /// Points touched by the proximal and the distal link: index, on a pad.
    pub touched: [Vec<(u32, bool)>; 2],
    /// The table stood in the way at some time.
    pub met_table: bool,
}

/// What blocks a finger.
#[derive(Clone, Copy, PartialEq)]
enum Block {
    Free,
    Object,
    Table,
}

/// Coarse step of a closing joint, radians: the tip moves by 11 mm, less than a link is thick.
const STEP: f64 = 0.1;
/// A step is halved this often: to 0.7 degrees.
const HALVINGS: usize = 3;
/// A point this near to a link is touched, metres: half the distance of surface samples on a hand-sized object.
const TOUCH: f64 = 0.003;

impl FingerModel {
    /// Every finger of `hand` at `preshape`.
    ///
    /// # Errors
    /// [`PlanError::UnsupportedHand`] where the kinematics refuse the preshape.
    pub fn all(hand: &Hand, preshape: f64) -> Result<Vec<Self>, PlanError> {
        let links = hand.hand_from_links(&hand.open_configuration(preshape)).map_err(|_| {
            PlanError::UnsupportedHand { name: hand.name.clone(), reason: "does not take this preshape" }
        })?;
        Ok(hand.fingers.iter().map(|finger| Self::new(hand, finger, &links)).collect())
    }

    fn new(hand: &Hand, finger: &graspbox_hand::Finger, links: &[Isometry3<f64>]) -> Self {
        let joints = [&hand.joints[finger.proximal], &hand.joints[finger.distal]];
        let [proximal, distal] = joints.map(|joint| joint.child);
        let y = -joints[0].axis.into_inner();
        let x = (Vector3::x() - y * y.x).normalize();
        let basis = Matrix3::from_columns(&[x, y, x.cross(&y)]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(basis));
        let hand_from_plane = links[proximal] * Isometry3::from_parts(Translation3::identity(), rotation);
        let plane_from_distal = hand_from_plane.inverse() * links[distal];
        let at = plane_from_distal.translation.vector;
        let mut half_width: f64 = 0.0;
        let mut rects = |link: usize, origin: &Vector3<f64>| -> Vec<Rect> {
            let plane_from_link = hand_from_plane.inverse() * links[link];
            let collider = |c: &graspbox_hand::Collider| {
                let place = plane_from_link * c.link_from_shape;
                let half = c.shape.half_extents(&place.rotation);
                half_width = half_width.max(half.y);
                let middle = place.translation.vector - origin;
                let side = |i: usize| [middle[i] - half[i], middle[i] + half[i]];
                Rect { x: side(0), z: side(2), pad: c.material == Material::Pad }
            };
            hand.links[link].colliders.iter().map(collider).collect()
        };
        let links = [rects(proximal, &Vector3::zeros()), rects(distal, &at)].map(LinkShape::new);
        let corner = |r: &Rect| r.x[1].hypot(r.z[1].abs().max(r.z[0].abs()));
        let furthest = links[1].rects.iter().map(corner).fold(0.0, f64::max);
        Self {
            hand_from_plane,
            links,
            distal_at: [at.x, at.z],
            half_width,
            reach: at.norm() + furthest,
            limits: joints.map(|joint| joint.limits[1]),
            arms: [finger.tendon.proximal_arm, finger.tendon.distal_arm],
        }
    }

    /// Axes of the finger's plane in the hand frame.
    pub fn axes(&self) -> [Vector3<f64>; 3] {
        [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| self.hand_from_plane * axis)
    }

    /// Closes the finger on points (those in its width, and within reach) over a table.
    pub fn close(&self, points: &[PlanePoint], table: &PlaneTable) -> ClosedFinger {
        let mut obstacles = Obstacles::new(points);
        let mut at = [0.0, 0.0];
        let mut met_table = false;
        let [rp, rd] = self.arms;
        // The tip curls while the proximal joint opens by `give` of it, as long as the tendon still shortens.
        let most = 0.95 * rd / rp;
        let moves = [[1.0, 0.0], [0.0, 1.0], [-most / 3.0, 1.0], [-most * 2.0 / 3.0, 1.0], [-most, 1.0]];
        // A curl of 2.7 rad takes 27 steps, a closing proximal joint as many.
        for _ in 0..80 {
            let mut moved = false;
            for direction in moves {
                let (reached, block) = self.advance(at, direction, &mut obstacles, table);
                met_table |= block == Block::Table;
                if reached != at {
                    at = reached;
                    moved = true;
                    break;
                }
            }
            if !moved {
                break;
            }
        }
        let touched = self.touched(at, points);
        ClosedFinger { proximal: at[0], distal: at[1], touched, met_table }
    }

    /// One step along `direction`, shortened by halving until it is free.
    fn advance(
        &self,
        at: [f64; 2],
        direction: [f64; 2],
        obstacles: &mut Obstacles,
        table: &PlaneTable,
    ) -> ([f64; 2], Block) {
        let mut step = STEP;
        let mut first = Block::Free;
        for _ in 0..=HALVINGS {
            let next = [at[0] + step * direction[0], at[1] + step * direction[1]];
            let inside = next[0] <= self.limits[0] && next[1] <= self.limits[1] && next[0] >= 0.0;
            if inside {
                let block = self.block(next, obstacles, table);
                if block == Block::Free {
                    return (next, first);
                }
                first = block;
            }
            step *= 0.5;
        }
        (at, first)
    }

    fn block(&self, q: [f64; 2], obstacles: &mut Obstacles, table: &PlaneTable) -> Block {
        let frames = self.frames(q);
        if self.links.iter().zip(&frames).any(|(link, frame)| link.hits_table(frame, table)) {
            Block::Table
        } else if obstacles.block(&self.links, &frames, q[0]) {
            Block::Object
        } else {
            Block::Free
        }
    }

    fn touched(&self, q: [f64; 2], points: &[PlanePoint]) -> [Vec<(u32, bool)>; 2] {
        let frames = self.frames(q);
        [0, 1].map(|link| {
            let LinkShape { rects, bounds } = &self.links[link];
            let touch = |p: &PlanePoint| {
                let (x, z) = frames[link].inward(p.x, p.z);
                if x <= bounds.x[0] || x >= bounds.x[1] + TOUCH || z <= bounds.z[0] || z >= bounds.z[1] + TOUCH {
                    return None;
                }
                let near = |r: &&Rect| {
                    x > r.x[0] && x < r.x[1] + TOUCH && z > r.z[0].max(r.z[1] - 2.0 * TOUCH) && z < r.z[1] + TOUCH
                };
                let rects = rects.iter().filter(near);
                let pad = rects.clone().any(|r| r.pad);
                rects.clone().next().map(|_| (p.index, pad))
            };
            points.iter().filter_map(touch).collect()
        })
    }

    fn frames(&self, q: [f64; 2]) -> [Frame; 2] {
        let proximal = Frame::new([0.0, 0.0], q[0]);
        let distal = Frame::new(proximal.outward(self.distal_at[0], self.distal_at[1]), q[0] + q[1]);
        [proximal, distal]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finger_3() -> FingerModel {
        let mut fingers = FingerModel::all(Hand::reflex().unwrap(), 0.0).unwrap();
        fingers.remove(2)
    }

    /// No table: far below.
    const NO_TABLE: PlaneTable = PlaneTable { normal: [0.0, 1.0], offset: -10.0 };

    #[test]
    fn a_free_finger_closes_to_its_stops() {
        let finger = finger_3();
        let closed = finger.close(&[], &NO_TABLE);
        assert!((closed.proximal - finger.limits[0]).abs() < 0.02, "{closed:?}");
        assert!((closed.distal - finger.limits[1]).abs() < 0.02, "{closed:?}");
        assert!(closed.touched.iter().all(Vec::is_empty) && !closed.met_table);
    }

    #[test]
    fn a_post_stops_the_proximal_link_and_the_distal_link_wraps_on() {
        let finger = finger_3();
        // A point above the middle of the proximal pad (its surface 15.4 mm over the joint): met at asin(z / r) - asin(h / r).
        let (x, z) = (0.0, 0.040);
        let closed = finger.close(&[PlanePoint { x, z, index: 7 }], &NO_TABLE);
        let expected = std::f64::consts::FRAC_PI_2 - (0.0154_f64 / z).asin();
        assert!((closed.proximal - expected).abs() < 0.02, "{} against {expected}", closed.proximal);
        assert!(closed.distal > 1.0, "the tip goes on: {}", closed.distal);
        assert_eq!(closed.touched[0], vec![(7, true)]);
    }

    #[test]
    fn the_table_makes_a_finger_curl() {
        let finger = finger_3();
        // The closing side points down, at a table 6 cm below the joint.
        let closed = finger.close(&[], &PlaneTable { normal: [0.0, -1.0], offset: -0.06 });
        assert!(closed.met_table);
        for frame in finger.frames([closed.proximal, closed.distal]) {
            assert!(frame.at[1] < 0.06);
        }
        assert!(closed.proximal + closed.distal > 1.5, "{closed:?}");
    }
}
