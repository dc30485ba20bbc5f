//! Table, ground and walls, and their places in the frame of the hand's base.

use nalgebra::{Isometry3, Point3, Vector3};

/// A box that does not move in the world, such as the side of a bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// Its pose in the world.
    pub world_from_wall: Isometry3<f64>,
    /// Half extents, metres.
    pub half: Vector3<f64>,
}

/// A table (top at z = 0 of the world, centred at the origin) above an unbounded ground, and walls.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenery {
    /// Side of the table top, metres.
    pub table_side: f64,
    /// Thickness of the table top, metres.
    pub table_thickness: f64,
    /// Height of the table top above the ground, metres.
    pub table_height: f64,
    pub walls: Vec<Wall>,
    /// Friction factor of all surfaces.
    pub friction: f64,
}

/// A horizontal plane in the frame of the base.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plane {
    /// Its axes, and its normal `up`.
    pub x: Vector3<f64>,
    pub y: Vector3<f64>,
    pub up: Vector3<f64>,
    /// `up . p` of its points.
    pub height: f64,
    /// `x . p` and `y . p` of its centre.
    pub middle: [f64; 2],
    /// Half its side; infinite for the ground.
    pub half: f64,
}

/// The plane of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Surface {
    /// The table top.
    Table,
    Ground,
    Wall,
}

impl Scenery {
    /// The planes of table and ground, in this order.
    pub(crate) fn planes(&self, base_from_world: &Isometry3<f64>) -> [Plane; 2] {
        let turn = base_from_world.rotation.to_rotation_matrix();
        let (x, y, up) = (turn * Vector3::x(), turn * Vector3::y(), turn * Vector3::z());
        let origin = base_from_world.translation.vector;
        let plane = |z: f64, half| Plane {
            x,
            y,
            up,
            height: up.dot(&origin) + z,
            middle: [x.dot(&origin), y.dot(&origin)],
            half,
        };
        [plane(0.0, self.table_side / 2.0), plane(-self.table_height, f64::INFINITY)]
    }
}

impl Wall {
    /// Distance of a point in the world from the wall, metres; 0 inside it.
    pub(crate) fn distance(&self, point: &Point3<f64>) -> f64 {
        let local = self.world_from_wall.inverse_transform_point(point).coords.abs();
        (local - self.half).sup(&Vector3::zeros()).norm()
    }
}

impl Plane {
    /// Height of a point above the plane.
    #[inline]
    pub fn gap(&self, p: &Vector3<f64>) -> f64 {
        self.up.dot(p) - self.height
    }
}
