//! Worlds without a hand, for truths about objects.

use graspbox_solver::{
    Body, FrameMotion, Model, Object, ObjectPart, Primitive, Scenery, Solver, StepInput, Tree, Wall,
};
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};

pub const DT: f64 = 0.002;
pub const GRAVITY: f64 = 9.81;
pub const TABLE_FRICTION: f64 = 0.8;

/// A box by its half extents, metres, and its mass, kg.
pub fn cuboid(half: [f64; 3], mass: f64, friction: f64) -> Object {
    let half = Vector3::from(half);
    let square = half.component_mul(&half);
    let about = Vector3::new(square.y + square.z, square.x + square.z, square.x + square.y) * (mass / 3.0);
    Object {
        parts: vec![ObjectPart::Primitive(Primitive::Cuboid(half))],
        mass,
        center: Point3::origin(),
        inertia: Matrix3::from_diagonal(&about),
        friction,
    }
}

/// An upright cylinder.
pub fn can(radius: f64, half_length: f64, mass: f64, friction: f64) -> Object {
    let across = mass * (radius * radius / 4.0 + half_length * half_length / 3.0);
    Object {
        parts: vec![ObjectPart::Primitive(Primitive::Cylinder { radius, half_length })],
        mass,
        center: Point3::origin(),
        inertia: Matrix3::from_diagonal(&Vector3::new(across, across, mass * radius * radius / 2.0)),
        friction,
    }
}

pub fn ball(radius: f64, mass: f64, friction: f64) -> Object {
    Object {
        parts: vec![ObjectPart::Primitive(Primitive::Sphere { radius })],
        mass,
        center: Point3::origin(),
        inertia: Matrix3::identity() * (0.4 * mass * radius * radius),
        friction,
    }
}

/// A convex body of constant density by its corners and triangles, about its centre of mass: the sum of the tetrahedra between each
/// triangle and the origin.
pub fn hull(corners: &[Vector3<f64>], faces: &[[u32; 3]], density: f64, friction: f64) -> Object {
    let (mut volume, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
    for face in faces {
        let [a, b, c] = face.map(|i| corners[i as usize]);
        let each = a.dot(&b.cross(&c)) / 6.0;
        let sum = a + b + c;
        volume += each;
        first += sum * (each / 4.0);
        let squares = a * a.transpose() + b * b.transpose() + c * c.transpose();
        second += (squares + sum * sum.transpose()) * (each / 20.0);
    }
    assert!(volume > 0.0, "the triangles look inwards");
    let center = first / volume;
    let about = (second - center * center.transpose() * volume) * density;
    Object {
        parts: vec![ObjectPart::Hull {
            vertices: corners.iter().map(|p| Point3::from(*p)).collect(),
            faces: faces.to_vec(),
        }],
        mass: volume * density,
        center: Point3::from(center),
        inertia: Matrix3::identity() * about.trace() - about,
        friction,
    }
}

/// A world of objects at poses in the world, seen from a base 1 m above the table.
pub struct Scene {
    pub solver: Solver,
    pub world_from_base: Isometry3<f64>,
    pub gravity: Vector3<f64>,
    pub objects: Vec<Object>,
    /// Duration of a step, seconds.
    pub dt: f64,
}

impl Scene {
    pub fn new(objects: Vec<(Object, Isometry3<f64>)>) -> Self {
        Self::with_walls(objects, vec![])
    }

    pub fn with_walls(objects: Vec<(Object, Isometry3<f64>)>, walls: Vec<Wall>) -> Self {
        Self::on_table(objects, walls, TABLE_FRICTION)
    }

    pub fn on_table(objects: Vec<(Object, Isometry3<f64>)>, walls: Vec<Wall>, friction: f64) -> Self {
        let base = Body {
            center: Point3::origin(),
            inertia: Matrix3::zeros(),
            mass: 0.0,
            parent: 0,
            joint: None,
            shapes: vec![],
        };
        let table = Scenery { table_side: 1.2, table_thickness: 0.1, table_height: 0.75, walls, friction };
        let (objects, poses): (Vec<Object>, Vec<Isometry3<f64>>) = objects.into_iter().unzip();
        let hand = Tree { bodies: vec![base], ..Tree::default() };
        let model = Model::new(hand, objects.clone(), table, Default::default()).unwrap();
        let mut solver = Solver::new(model.into());
        let world_from_base = Isometry3::translation(0.0, 0.0, 1.0);
        for (state, pose) in solver.state_mut().objects.iter_mut().zip(&poses) {
            state.base_from_object = world_from_base.inv_mul(pose);
        }
        Self { solver, world_from_base, gravity: Vector3::new(0.0, 0.0, -GRAVITY), objects, dt: DT }
    }

    pub fn step(&mut self) {
        let base_from_world = self.world_from_base.inverse();
        let frame = FrameMotion { gravity: self.gravity, omega: Vector3::zeros(), alpha: Vector3::zeros() };
        self.solver.step(&StepInput {
            dt: self.dt,
            base_from_world,
            base_from_world_after: base_from_world,
            frame,
            forces: &[],
            driven: &[],
            cables: &[],
            idle: 0,
        });
    }

    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / self.dt).round() as usize {
            self.step();
        }
    }

    /// Centre of mass in the world.
    pub fn center(&self, index: usize) -> Vector3<f64> {
        (self.world_from_base * Point3::from(self.solver.object_center(index))).coords
    }

    pub fn centers(&self) -> Vec<Vector3<f64>> {
        (0..self.objects.len()).map(|index| self.center(index)).collect()
    }

    /// Momentum and angular momentum about the base's origin.
    pub fn momentum(&self) -> (Vector3<f64>, Vector3<f64>) {
        let (mut linear, mut angular) = (Vector3::zeros(), Vector3::zeros());
        for (index, (object, state)) in self.objects.iter().zip(&self.solver.state().objects).enumerate() {
            let turn = state.base_from_object.rotation.to_rotation_matrix();
            let inertia = turn.matrix() * object.inertia * turn.matrix().transpose();
            linear += object.mass * state.linear;
            angular += inertia * state.angular + self.solver.object_center(index).cross(&(object.mass * state.linear));
        }
        (linear, angular)
    }

    /// Kinetic and potential energy, joules.
    pub fn energy(&self) -> f64 {
        let each = |(index, (object, state)): (usize, (&Object, &graspbox_solver::ObjectState))| {
            let turn = state.base_from_object.rotation.to_rotation_matrix();
            let spin = turn.matrix().tr_mul(&state.angular);
            let kinetic = 0.5 * (object.mass * state.linear.norm_squared() + spin.dot(&(object.inertia * spin)));
            kinetic - object.mass * self.gravity.dot(&self.center(index))
        };
        self.objects.iter().zip(&self.solver.state().objects).enumerate().map(each).sum()
    }

    pub fn unconverged(&self) -> u64 {
        self.solver.state().unconverged_steps
    }
}

pub fn at(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Isometry3::translation(x, y, z)
}

pub fn turned(x: f64, y: f64, z: f64, axis: [f64; 3], degrees: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(axis).normalize() * degrees.to_radians());
    Isometry3::from_parts(Translation3::new(x, y, z), turn)
}

/// Numbers in [-1, 1) from a small generator.
pub fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}
