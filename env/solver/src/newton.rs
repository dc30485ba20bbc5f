//! Newton's method for the equations of a step, and a convex fallback for where it does not get on.

use serde::{Deserialize, Serialize};

use crate::kinematics::{Kinematics, Twist};
use crate::matrix::Factors;
use crate::model::{Model, OBJECT};
use crate::problem::{Bounds, Problem};

/// Newton's step is taken if the residual falls by this share.
const DESCENT: f64 = 0.04;
/// The last derivative is used once more where it has reduced the residual to this share.
const QUIET: f64 = 0.2;
/// Convex steps at most before the iteration is given up.
const CROSSINGS: usize = 12;
/// Iterations of the convex problem in which friction's bounds still follow: in the first fallback, and in the last.
const BOUND_UPDATES: [usize; 2] = [3, 6];
/// Share of the first slope at which a line search ends, and its evaluations at most.
const FLAT: f64 = 0.1;
const LINE_EVALUATIONS: usize = 20;

/// Buffers of the iteration.
#[derive(Clone, Default)]
pub(crate) struct Newton {
    direction: Vec<f64>,
    from: Vec<f64>,
    /// Solution of the convex problem, kept while Newton's method tries again.
    convex: Vec<f64>,
    /// Where the iteration began, kept for a step that nothing solves.
    start: Vec<f64>,
    /// The derivative that was factored last, and the number of contact points that it was of.
    last: LastDerivative,
}

/// What is kept from step to step: a quiet step ends with the derivative of the one before.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct LastDerivative {
    factors: Factors,
    points: usize,
}

impl Newton {
    pub fn new(model: &Model) -> Self {
        let n = model.unknowns();
        Self {
            direction: vec![0.0; n],
            from: vec![0.0; n],
            convex: vec![0.0; n],
            start: vec![0.0; n],
            last: LastDerivative { factors: Factors::new(n), points: 0 },
        }
    }

    /// What the next step depends on.
    pub fn save(&self) -> LastDerivative {
        self.last.clone()
    }

    /// Takes what [`Newton::save`] gave; false, and nothing changes, for another number of unknowns.
    pub fn load(&mut self, saved: LastDerivative) -> bool {
        let fits = saved.factors.fits(&self.last.factors);
        if fits {
            self.last = saved;
        }
        fits
    }

    /// Solves for `problem.v`, beginning where it is, or with the object at rest on the `scenery`, which moves so; impulses and cable forces
    /// are those of the velocities found.
    ///
    /// False where the velocities do not balance: Newton's method did not end even after the fallback. They are never further from a
    /// balance than where it began: a diverged iteration would throw the object away.
    pub fn solve(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem, scenery: &Twist) -> bool {
        let begun = self.begin(model, kinematics, problem, scenery);
        self.start.copy_from_slice(&problem.v);
        let (first, done) = self.quiet(model, kinematics, problem, begun);
        if done || self.coulomb(model, kinematics, problem, first) {
            return true;
        }
        self.convex(model, kinematics, problem, BOUND_UPDATES[0]);
        self.convex.copy_from_slice(&problem.v);
        let first = problem.evaluate(model, kinematics, Bounds::Follow);
        if self.coulomb(model, kinematics, problem, first) {
            return true;
        }
        problem.v.copy_from_slice(&self.convex);
        let last = self.convex(model, kinematics, problem, BOUND_UPDATES[1]);
        if last > begun || last.is_nan() {
            problem.v.copy_from_slice(&self.start);
            problem.evaluate(model, kinematics, Bounds::Follow);
        }
        false
    }

    /// Evaluates where the iteration begins, and returns the residual's size there.
    ///
    /// The velocities of the last step are those in the frame of the base. What rests on the table has others once the base has been
    /// accelerated: it would seem to slide, and its friction would have to be found anew.
    fn begin(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem, scenery: &Twist) -> f64 {
        let now = problem.evaluate(model, kinematics, Bounds::Follow);
        if !problem.patches.iter().any(|p| p.a == OBJECT && p.b == model.scenery_body()) {
            return now;
        }
        self.from.copy_from_slice(&problem.v);
        problem.set_object_twist(scenery);
        self.direction.iter_mut().zip(&self.from).zip(&problem.v).for_each(|((d, from), v)| *d = v - from);
        let same = self.length(model) <= model.solver.stick_speed;
        if !same {
            let then = problem.evaluate(model, kinematics, Bounds::Follow);
            if then < now {
                return then;
            }
        }
        problem.v.copy_from_slice(&self.from);
        if same { now } else { problem.evaluate(model, kinematics, Bounds::Follow) }
    }

    /// Steps of Newton's method with the last derivative, which is nearly the present one where nothing begins or ends to touch or to slide.
    /// Returns the residual's size after them, and whether they end the iteration.
    fn quiet(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem, first: f64) -> (f64, bool) {
        let mut now = first;
        if !self.last.factors.is_valid() || self.last.points != problem.points.len() {
            return (now, false);
        }
        for _ in 0..model.solver.max_iterations {
            self.descend(problem);
            if !self.last.factors.solve(&mut self.direction) {
                return (now, false);
            }
            let length = self.length(model);
            self.from.copy_from_slice(&problem.v);
            self.move_by(problem, 1.0);
            let then = problem.evaluate(model, kinematics, Bounds::Follow);
            // Not where it falls to nothing from nothing, either: a share of that is no number.
            let falls = then < now * (1.0 - DESCENT);
            if !falls {
                problem.v.copy_from_slice(&self.from);
                return (problem.evaluate(model, kinematics, Bounds::Follow), false);
            }
            let shrunk = (then / now).sqrt();
            if length * shrunk <= 0.5 * model.solver.tolerance {
                return (then, true);
            }
            if shrunk > QUIET {
                return (then, false);
            }
            now = then;
        }
        (now, false)
    }

    /// Newton's method on the true balance, bounds and all, from where the residual has size `now`; false where it does not get on.
    ///
    /// Where a step along Newton's direction does not descend, contacts are about to open, close or stick: a step of the convex problem, with
    /// friction's bounds as they are, crosses these kinks.
    fn coulomb(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem, mut now: f64) -> bool {
        let tolerance = model.solver.tolerance;
        let mut crossings = 0;
        for _ in 0..model.solver.max_iterations {
            problem.differentiate(model, kinematics, Bounds::Follow);
            self.descend(problem);
            self.last.points = problem.points.len();
            if !problem.derivative.factor(&mut self.last.factors) || !self.last.factors.solve(&mut self.direction) {
                self.last.factors.forget();
                return false;
            }
            let length = self.length(model);
            self.from.copy_from_slice(&problem.v);
            self.move_by(problem, 1.0);
            let then = problem.evaluate(model, kinematics, Bounds::Follow);
            if length <= tolerance {
                return true;
            }
            if then <= now * (1.0 - DESCENT) {
                // The next step would be as much shorter as the residual is smaller.
                if length * (then / now).sqrt() <= 0.5 * tolerance {
                    return true;
                }
                now = then;
                continue;
            }
            crossings += 1;
            if crossings > CROSSINGS {
                return false;
            }
            problem.v.copy_from_slice(&self.from);
            problem.evaluate(model, kinematics, Bounds::Follow);
            if !self.convex_step(model, kinematics, problem) {
                return false;
            }
            now = problem.evaluate(model, kinematics, Bounds::Follow);
        }
        false
    }

    /// One step of the convex problem from where it was evaluated last; false where there is no direction.
    fn convex_step(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem) -> bool {
        problem.differentiate(model, kinematics, Bounds::Frozen);
        self.descend(problem);
        if !problem.derivative.solve_definite(&mut self.direction) {
            return false;
        }
        self.from.copy_from_slice(&problem.v);
        self.line_search(model, kinematics, problem);
        true
    }

    /// Newton's method with exact line search on the convex problem: friction's bounds follow for `updates` iterations, then they stay.
    /// Returns the size of the residual that is left.
    fn convex(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem, updates: usize) -> f64 {
        let mut size = f64::INFINITY;
        for iteration in 0..model.solver.max_iterations {
            if iteration < updates {
                problem.evaluate(model, kinematics, Bounds::Follow);
            }
            size = problem.evaluate(model, kinematics, Bounds::Frozen);
            problem.differentiate(model, kinematics, Bounds::Frozen);
            self.descend(problem);
            if !problem.derivative.solve_definite(&mut self.direction) {
                return size;
            }
            self.from.copy_from_slice(&problem.v);
            if self.length(model) <= model.solver.tolerance {
                self.move_by(problem, 1.0);
                return problem.evaluate(model, kinematics, Bounds::Frozen);
            }
            self.line_search(model, kinematics, problem);
        }
        size
    }

    /// Moves along the direction to where the cost is least: a root of its slope, by the Illinois method.
    fn line_search(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem) {
        let slope = |this: &mut Self, problem: &mut Problem, step: f64| {
            this.move_by(problem, step);
            problem.evaluate(model, kinematics, Bounds::Frozen);
            problem.residual.iter().zip(&this.direction).map(|(r, d)| r * d).sum::<f64>()
        };
        let start: f64 = problem.residual.iter().zip(&self.direction).map(|(r, d)| r * d).sum();
        let full = slope(self, problem, 1.0);
        if full <= FLAT * start.abs() {
            return;
        }
        let (mut low, mut at_low, mut high, mut at_high) = (0.0, start, 1.0, full);
        let mut last = 0.0_f64;
        for _ in 0..LINE_EVALUATIONS {
            let margin = 0.02 * (high - low);
            let (least, most): (f64, f64) = (low + margin, high - margin);
            if least.is_nan() || most.is_nan() || least > most {
                return; // Forces beyond all numbers, of a state that nobody reached; `Solver::is_finite` tells.
            }
            let step = ((low * at_high - high * at_low) / (at_high - at_low)).clamp(least, most);
            let found = slope(self, problem, step);
            if found.abs() <= FLAT * start.abs() {
                return;
            }
            if found > 0.0 {
                (high, at_high) = (step, found);
                at_low *= if last > 0.0 { 0.5 } else { 1.0 };
            } else {
                (low, at_low) = (step, found);
                at_high *= if last < 0.0 { 0.5 } else { 1.0 };
            }
            last = found;
        }
    }

    /// The right-hand side of Newton's equation.
    fn descend(&mut self, problem: &Problem) {
        for (d, r) in self.direction.iter_mut().zip(&problem.residual) {
            *d = -r;
        }
    }

    fn move_by(&self, problem: &mut Problem, step: f64) {
        for ((v, from), d) in problem.v.iter_mut().zip(&self.from).zip(&self.direction) {
            *v = from + step * d;
        }
    }

    /// Largest change of a velocity along the direction, m/s.
    fn length(&self, model: &Model) -> f64 {
        self.direction.iter().zip(&model.levers).fold(0.0, |most, (d, lever)| most.max(d.abs() * lever))
    }
}
