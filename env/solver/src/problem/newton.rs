//! Newton's method for the equations of a step, with a convex problem as the fallback when it stalls.
//!
//! 1. Start at the last velocities, or with the objects at rest on the scenery if that leaves a smaller residual.
//! 2. Take steps with the factors of the last derivative while they converge fast: this suffices for most steps of a held object.
//! 3. Newton's method on `r(v) = 0` with friction bounds that follow the normal impulses. A full step that does not reduce the residual crosses a
//!    kink of the contact law (contacts open, close, stick or slide); a step of the convex problem, with the bounds frozen, replaces it.
//! 4. Where that stalls: solve the convex problem several times, each time with friction bounds from the last solution, and run 3 from each of
//!    these solutions. Among many objects some contact opens, closes, sticks or slides in nearly every step, and 3 seldom descends before.
//! 5. Where that stalls too: keep the last solution of the convex problem, and report that the step did not converge.
//!
//! For many objects without the hand, two convex problems are enough, or one if its solution changes the bounds little. The first has the bounds
//! of the velocities at the start, like Drake's lagged model (Castro et al., "A theory of irrotational contact fields", 2023); by itself it lets an arch
//! slip while its thrust builds up (`an_arch_stands` in `tests/many_objects.rs`).

use serde::{Deserialize, Serialize};

use crate::error::StateError;
use crate::kinematics::{Kinematics, Twist};
use crate::model::Model;
use crate::problem::matrix::Factors;
use crate::problem::ordering::only;
use crate::problem::stiffness::Slope;
use crate::problem::{Bounds, Problem};

/// A Newton step is accepted if it reduces the residual's size (its squared norm) by this share, dimensionless: 2 % of the norm. A smooth
/// residual falls by far more; less means that the step crossed a kink.
const MIN_DECREASE: f64 = 0.04;
/// Factors are reused for another step if they reduced the residual's norm to this share, dimensionless. Slower convergence costs more
/// evaluations than a new factorization.
const REUSE_CONTRACTION: f64 = 0.2;
/// Most convex steps before Newton's method counts as stalled; it bounds the cost of a step, and the convex problem takes over.
const MAX_CONVEX_STEPS: usize = 12;
/// Islands of several objects with more unknowns than this begin with the convex problem, since Newton's method mostly stalls there: four objects
/// fit, or three and a hand of up to six coordinates.
const FEW_UNKNOWNS: usize = 24;
/// Most solutions of the convex problem in a step; it bounds the cost of a step that does not converge.
const ROUNDS: usize = 6;
/// Such solutions that are enough for objects without the hand.
const ROUNDS_WITHOUT_HAND: usize = 2;
/// One is enough for them if the residual would then change no speed by more than this, m/s: 2 micrometres in a step.
const NEAR: f64 = 1e-3;
/// Convex steps of Newton's method from each of these solutions.
const CONVEX_STEPS_OF_ROUND: usize = 2;
/// The bounds swing if the residual's size is more than this share of that of the last round, dimensionless.
const SWINGING: f64 = 0.25;
/// The convex problem is solved once its step changes no velocity by more than this many tolerances: the next bounds change more.
const ROUND_TOLERANCE: f64 = 50.0;
/// A step of the convex problem is blocked by a kink if the line search ends before this share of it, dimensionless.
const BLOCKED: f64 = 0.3;
/// A line search ends where the slope has fallen to this share of the first slope, dimensionless: Newton's next step corrects the rest.
const SLOPE_REDUCTION: f64 = 0.1;
/// Most evaluations of a line search: plain bisection would shrink the bracket to 1e-6 of the step.
const MAX_LINE_EVALUATIONS: usize = 20;
/// A line search evaluates no nearer to an end of its bracket than this share of its width, dimensionless: it keeps the bracket shrinking.
const BRACKET_MARGIN: f64 = 0.02;
/// The iteration ends if the next step is expected to be shorter than this share of the tolerance, dimensionless. The expectation assumes
/// that steps shrink with the residual, hence the margin of two.
const EXPECTED_STEP: f64 = 0.5;

/// Buffers of the iteration.
#[derive(Clone, Default)]
pub(crate) struct Newton {
    direction: Vec<f64>,
    from: Vec<f64>,
    /// Solution of the convex problem, kept while Newton's method runs again.
    convex: Vec<f64>,
    /// Velocities at the start of the iteration, kept for a step that does not converge.
    first_guess: Vec<f64>,
    /// Of the islands of the last step, and of this one.
    derivatives: Vec<FactoredDerivative>,
    /// That of the island that is being solved.
    now: usize,
}

/// The factors of an island's last derivative, kept from step to step.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct FactoredDerivative {
    /// Whether an island of the last step has it, or one of this step that is solved.
    #[serde(skip)]
    used: bool,
    /// Whether the hand was among the unknowns of the island, and which objects.
    hand: bool,
    objects: Vec<usize>,
    /// Number of contact points.
    points: usize,
    factors: Factors,
}

impl FactoredDerivative {
    /// Whether an island of the model can have it.
    ///
    /// # Errors
    /// [`StateError`] if it cannot.
    fn check(&self, model: &Model) -> Result<(), StateError> {
        let known = self.objects.iter().all(|object| *object < model.object_count());
        let distinct = known
            && self.objects.iter().fold(0, |set, object| set | only(*object)).count_ones() as usize
                == self.objects.len();
        let unknowns = if self.hand { model.tree.coordinates.len() } else { 0 } + 6 * self.objects.len();
        if !(distinct && self.factors.fits(unknowns)) {
            return Err(StateError::OtherModel { what: "unknowns" });
        }
        if self.factors.is_possible() { Ok(()) } else { Err(StateError::Impossible { what: "factors" }) }
    }
}

impl Newton {
    /// The state that the next step depends on.
    pub fn save(&self) -> Vec<FactoredDerivative> {
        self.derivatives.iter().filter(|each| each.used).cloned().collect()
    }

    /// Restores the result of [`Newton::save`].
    ///
    /// # Errors
    /// [`StateError`] for another number of unknowns, or factors that no matrix has; nothing changes then.
    pub fn load(&mut self, model: &Model, saved: Vec<FactoredDerivative>) -> Result<(), StateError> {
        saved.iter().try_for_each(|each| each.check(model))?;
        self.derivatives = saved;
        self.derivatives.iter_mut().for_each(|each| each.used = true);
        Ok(())
    }

    /// Begins a step: the factors of the last one's islands are kept for islands of the same bodies.
    pub fn begin(&mut self) {
        self.derivatives.retain(|each| each.used);
        self.derivatives.iter_mut().for_each(|each| each.used = false);
    }

    /// Finds the kept factors of an island, or begins with none.
    fn recall(&mut self, hand: bool, objects: &[usize], unknowns: usize) {
        let same = |kept: &FactoredDerivative| kept.hand == hand && kept.objects == objects;
        self.now = self.derivatives.iter().position(same).unwrap_or_else(|| {
            let (objects, factors) = (objects.to_vec(), Factors::new(unknowns));
            self.derivatives.push(FactoredDerivative { hand, objects, factors, ..FactoredDerivative::default() });
            self.derivatives.len() - 1
        });
        self.derivatives[self.now].used = true;
        for buffer in [&mut self.direction, &mut self.from, &mut self.convex, &mut self.first_guess] {
            buffer.resize(unknowns, 0.0);
        }
    }

    /// Solves for the velocities of an island, starting at those of the beginning of the step; impulses and cable forces are those at the
    /// solution.
    ///
    /// * `scenery`: twist of the scenery, for the start with the objects at rest on it.
    ///
    /// Returns false if the iteration did not converge. The velocities are then those of the last convex problem, unless its residual is larger
    /// than that of the start: then they are the start's, since a diverged iteration would throw the object.
    pub fn solve(
        &mut self,
        model: &Model,
        kinematics: &Kinematics,
        problem: &mut Problem,
        island: (bool, &[usize], &[usize]),
        scenery: &Twist,
    ) -> bool {
        let (hand, objects, _) = island;
        problem.enter(model, kinematics, island);
        self.recall(hand, objects, problem.unknowns());
        let solved = self.solve_island(model, kinematics, problem, scenery);
        problem.leave();
        solved
    }

    fn solve_island(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem, scenery: &Twist) -> bool {
        let begun = self.start(model, kinematics, problem, scenery);
        self.first_guess.copy_from_slice(&problem.v);
        let (first, done) = self.reuse_factors(model, kinematics, problem, begun);
        let many = problem.unknowns() > FEW_UNKNOWNS && problem.has_several_objects();
        if done || (!many && self.newton(model, kinematics, problem, first, MAX_CONVEX_STEPS)) {
            return true;
        }
        self.solve_in_rounds(model, kinematics, problem, begun)
    }

    /// Solves the convex problem several times, each time with friction bounds from the last solution, and tries to end each time with Newton's
    /// method; objects without the hand need no such end. Returns false if that does not converge. The velocities are then those of the last
    /// solution, or those of the first guess, where the residual has the size `begun`, if it is smaller there. Objects without the hand keep the
    /// last solution in any case; it counts as converged if the residual would change no speed by more than [`NEAR`].
    ///
    /// Where the bounds swing from one solution to the next, the residual falls slowly or not at all; then they move halfway.
    fn solve_in_rounds(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem, begun: f64) -> bool {
        let (mut bounds, mut last) = (Bounds::Follow, f64::INFINITY);
        let without_hand = !self.derivatives[self.now].hand && problem.has_several_objects();
        for round in 1..=ROUNDS {
            problem.evaluate(model, kinematics, bounds);
            let solved = self.solve_convex(model, kinematics, problem);
            self.convex.copy_from_slice(&problem.v);
            problem.keep_bounds();
            let now = problem.evaluate_size(model, kinematics);
            if without_hand {
                let near = problem.residual_speed() <= NEAR;
                if solved && (near || round >= ROUNDS_WITHOUT_HAND) {
                    return near;
                }
            } else if self.newton(model, kinematics, problem, now, CONVEX_STEPS_OF_ROUND) {
                return true;
            }
            problem.v.copy_from_slice(&self.convex);
            problem.restore_bounds();
            bounds = if now < SWINGING * last { Bounds::Follow } else { Bounds::Halfway };
            last = now;
        }
        if last > begun || last.is_nan() {
            problem.v.copy_from_slice(&self.first_guess);
        }
        problem.evaluate(model, kinematics, Bounds::Follow);
        false
    }

    /// Chooses the start of the iteration, and returns the residual's size there.
    ///
    /// The last velocities are relative to the base. When the base accelerates, the velocities of objects that rest on the table change in that
    /// frame; with the last velocities they would seem to slide, and the iteration would have to find their friction anew.
    fn start(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem, scenery: &Twist) -> f64 {
        let now = problem.evaluate_size(model, kinematics);
        if !problem.rests_on_scenery() {
            return now;
        }
        self.from.copy_from_slice(&problem.v);
        problem.set_twist_of_objects(scenery);
        self.direction.iter_mut().zip(&self.from).zip(&problem.v).for_each(|((d, from), v)| *d = v - from);
        if self.step_size(problem) <= model.config.stick_speed {
            problem.v.copy_from_slice(&self.from);
            return now;
        }
        problem.keep();
        let then = problem.evaluate_size(model, kinematics);
        if then < now {
            return then;
        }
        problem.restore(&self.from);
        now
    }

    /// Takes Newton steps with the factors of the last derivative, which is close to the present one unless contacts open, close, stick or slide.
    /// Returns the residual's size after them, and whether the iteration converged.
    fn reuse_factors(
        &mut self,
        model: &Model,
        kinematics: &Kinematics,
        problem: &mut Problem,
        first: f64,
    ) -> (f64, bool) {
        let mut now = first;
        let last = &self.derivatives[self.now];
        if !last.factors.is_valid() || last.points != problem.point_count() {
            return (now, false);
        }
        for _ in 0..model.config.max_iterations {
            self.negate_residual(problem);
            if !self.derivatives[self.now].factors.solve(&mut self.direction) {
                return (now, false);
            }
            let length = self.step_size(problem);
            self.from.copy_from_slice(&problem.v);
            self.move_by(problem, 1.0);
            let then = problem.evaluate_size(model, kinematics);
            // Strictly less: a residual of 0 cannot fall, and `then / now` would be NaN.
            let falls = then < now * (1.0 - MIN_DECREASE);
            if !falls {
                problem.v.copy_from_slice(&self.from);
                return (problem.evaluate_size(model, kinematics), false);
            }
            let shrunk = (then / now).sqrt();
            if length * shrunk <= EXPECTED_STEP * model.config.tolerance {
                return (then, true);
            }
            if shrunk > REUSE_CONTRACTION {
                return (then, false);
            }
            now = then;
        }
        (now, false)
    }

    /// Newton's method with friction bounds that follow, from a residual of size `now`. Returns false if it stalls.
    ///
    /// Where a Newton step does not descend, contacts are about to open, close, stick or slide: a step of the convex problem crosses these kinks,
    /// `crossings` times at most.
    fn newton(
        &mut self,
        model: &Model,
        kinematics: &Kinematics,
        problem: &mut Problem,
        mut now: f64,
        crossings: usize,
    ) -> bool {
        let tolerance = model.config.tolerance;
        let mut convex_steps = 0;
        for _ in 0..model.config.max_iterations {
            problem.differentiate(model, kinematics, Slope::Follow);
            self.negate_residual(problem);
            let last = &mut self.derivatives[self.now];
            last.points = problem.point_count();
            if !problem.derivative.factor(&mut last.factors) || !last.factors.solve(&mut self.direction) {
                last.factors.forget();
                return false;
            }
            let length = self.step_size(problem);
            self.from.copy_from_slice(&problem.v);
            problem.keep();
            self.move_by(problem, 1.0);
            let then = problem.evaluate_size(model, kinematics);
            if length <= tolerance {
                return true;
            }
            if then <= now * (1.0 - MIN_DECREASE) {
                if length * (then / now).sqrt() <= EXPECTED_STEP * tolerance {
                    return true;
                }
                now = then;
                continue;
            }
            convex_steps += 1;
            if convex_steps > crossings {
                return false;
            }
            problem.restore(&self.from);
            if !self.convex_step(model, kinematics, problem) {
                return false;
            }
            now = problem.evaluate_size(model, kinematics);
        }
        false
    }

    /// Takes one step of the convex problem from the last evaluation. Returns false if its matrix is not positive definite.
    fn convex_step(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem) -> bool {
        problem.differentiate(model, kinematics, Slope::Frozen);
        if !self.solve_direction(problem) {
            return false;
        }
        self.line_search(model, kinematics, problem);
        true
    }

    /// Solves for the direction of a step from the present velocities. Returns false if the matrix is not positive definite.
    fn solve_direction(&mut self, problem: &mut Problem) -> bool {
        self.negate_residual(problem);
        let solved = problem.derivative.solve_definite(&mut self.direction);
        if solved {
            self.from.copy_from_slice(&problem.v);
        }
        solved
    }

    /// Newton's method with line search on the convex problem, with the friction bounds of the last evaluation. Returns whether it converged.
    ///
    /// Where a kink blocks a step, the next one takes the secant of friction instead of its derivative: contacts that slide backwards then come to
    /// rest together, where Newton's steps would bring them to rest one after the other. A single object has too few contacts to gain by it.
    fn solve_convex(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem) -> bool {
        let several = problem.has_several_objects();
        let mut slope = Slope::Frozen;
        problem.evaluate(model, kinematics, Bounds::Frozen);
        for _ in 0..model.config.max_iterations {
            problem.differentiate(model, kinematics, slope);
            if !self.solve_direction(problem) {
                return false;
            }
            if slope == Slope::Frozen && self.step_size(problem) <= ROUND_TOLERANCE * model.config.tolerance {
                self.move_by(problem, 1.0);
                return true;
            }
            let share = self.line_search(model, kinematics, problem);
            let blocked = several && slope == Slope::Frozen && share < BLOCKED;
            slope = if blocked { Slope::Secant } else { Slope::Frozen };
        }
        false
    }

    /// Moves along the direction to the least cost: finds a root of the cost's slope by the Illinois method (modified regula falsi). Returns the
    /// share of the direction that it moved.
    fn line_search(&mut self, model: &Model, kinematics: &Kinematics, problem: &mut Problem) -> f64 {
        let slope = |this: &mut Self, problem: &mut Problem, step: f64| {
            this.move_by(problem, step);
            problem.evaluate(model, kinematics, Bounds::Frozen);
            problem.residual.iter().zip(&this.direction).map(|(r, d)| r * d).sum::<f64>()
        };
        let start: f64 = problem.residual.iter().zip(&self.direction).map(|(r, d)| r * d).sum();
        let full = slope(self, problem, 1.0);
        if full <= SLOPE_REDUCTION * start.abs() {
            return 1.0;
        }
        let (mut low, mut at_low, mut high, mut at_high) = (0.0, start, 1.0, full);
        let (mut step, mut last) = (1.0, 0.0_f64);
        for _ in 0..MAX_LINE_EVALUATIONS {
            let margin = BRACKET_MARGIN * (high - low);
            let (least, most): (f64, f64) = (low + margin, high - margin);
            if least.is_nan() || most.is_nan() || least > most {
                return step; // The forces overflowed; `Solver::is_finite` reports that.
            }
            step = ((low * at_high - high * at_low) / (at_high - at_low)).clamp(least, most);
            let found = slope(self, problem, step);
            if found.abs() <= SLOPE_REDUCTION * start.abs() {
                return step;
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
        step
    }

    /// Writes the right-hand side of Newton's equation, `-r`.
    fn negate_residual(&mut self, problem: &Problem) {
        for (d, r) in self.direction.iter_mut().zip(&problem.residual) {
            *d = -r;
        }
    }

    /// Sets the velocities to `from + step * direction`.
    fn move_by(&self, problem: &mut Problem, step: f64) {
        for ((v, from), d) in problem.v.iter_mut().zip(&self.from).zip(&self.direction) {
            *v = from + step * d;
        }
    }

    /// Largest change of a velocity in a full step along the direction, m/s; angular velocities count by their levers.
    fn step_size(&self, problem: &Problem) -> f64 {
        self.direction.iter().zip(&problem.levers).fold(0.0, |most, (d, lever)| most.max(d.abs() * lever))
    }
}
