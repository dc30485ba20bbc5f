//! An object in its construction frame, and its resting pose.

use crate::surface::{P3, Surface};
use nalgebra::{Point2, Point3, Vector2};

/// Convex parts, each a cloud of at most 64 points.
pub(crate) type Parts = Vec<Vec<P3>>;

/// The resting pose of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rest {
    /// Upright as constructed: z stays up.
    Stands,
    /// Lying along x, pitched about y until it touches the table on both sides of its centre.
    Lies,
}

/// A shape in its own construction frame.
pub(crate) struct Draft {
    pub(crate) surface: Surface,
    pub(crate) parts: Parts,
    /// Mass, kilograms.
    pub(crate) mass: f64,
    pub(crate) rest: Rest,
}

impl Draft {
    /// Moves the draft into the object frame: z up, lowest vertex at z = 0, bounds centred in x and y.
    pub(crate) fn settle(&mut self) {
        if self.rest == Rest::Lies {
            let pitch = resting_pitch(&self.surface);
            let (sin, cos) = pitch.sin_cos();
            self.move_points(|p| Point3::new(cos * p.x + sin * p.z, p.y, cos * p.z - sin * p.x));
        }
        let mut low = self.surface.vertices[0];
        let mut high = low;
        for p in &self.surface.vertices {
            low = low.inf(p);
            high = high.sup(p);
        }
        let shift = nalgebra::Vector3::new(-(low.x + high.x) / 2.0, -(low.y + high.y) / 2.0, -low.z);
        self.move_points(|p| p + shift);
    }

    fn move_points(&mut self, place: impl Fn(&P3) -> P3) {
        for p in &mut self.surface.vertices {
            *p = place(p);
        }
        for p in self.parts.iter_mut().flatten() {
            *p = place(p);
        }
    }
}

/// Angle about y that brings the lower side of the hull below the centre of volume flat onto the table.
fn resting_pitch(surface: &Surface) -> f64 {
    let mut points: Vec<Point2<f64>> = surface.vertices.iter().map(|p| Point2::new(p.x, p.z)).collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let mut chain: Vec<Point2<f64>> = Vec::new();
    for p in points {
        while chain.len() >= 2 && turn(chain[chain.len() - 2], chain[chain.len() - 1], p) <= 0.0 {
            chain.pop();
        }
        chain.push(p);
    }
    let center = surface.centroid().x;
    let side = chain.windows(2).find(|w| w[1].x >= center).map(|w| w[1] - w[0]);
    let side = side.unwrap_or(Vector2::x());
    side.y.atan2(side.x)
}

fn turn(a: Point2<f64>, b: Point2<f64>, c: Point2<f64>) -> f64 {
    (b - a).perp(&(c - a))
}
