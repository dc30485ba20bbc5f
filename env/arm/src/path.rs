//! A path of the whole arm: from where it stands to a grasp, and with the thing up, on to a place, and away from it. Geometry alone: no times.
//!
//! | what | is checked against |
//! |---|---|
//! | arm | itself, the hand, the thing while it is carried, the table, points, objects; always |
//! | open hand on approach and retreat | the swept volume of its straight line against table and objects |
//! | hand in other motions | everything; while it carries, as if it were open, half closed and closed at once |
//! | thing in the hand | the arm, the table, points, objects |
//!
//! | module | purpose |
//! |---|---|
//! | `motion` | a straight motion between two postures, checked by the distance that bodies move |
//! | `params` | settings |
//! | [`mod@line`] | straight lines of the hand, from posture to posture |
//! | `roadmap` | ways between postures: RRT-Connect, shortcuts |
//!
//! What hand and thing are nearer to than the clearance where the grasp is, they may touch on the lift, and what they are nearer to at the place
//! while they are lowered to it. At the end of the lift, and where the lowering begins, nothing is excepted.

pub mod line;
mod motion;
mod params;
mod roadmap;

pub use motion::{Contact, Mover, With};
pub use params::PathParams;

use crate::bodies::{ArmBodies, Carried, check_payload, library};
use crate::chain::Positions;
use crate::error::ArmError;
use crate::inverse::Inverse;
use crate::reach::Reason;
use crate::scene::{Scene, Touched};
use graspbox_hand::{Arm, Hand};
use graspbox_plan::{Obstacle, OpenHand};
use line::{Broken, DEVIATION, Line};
use motion::Motions;
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::shape::SharedShape;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use roadmap::Roadmap;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Most postures of a grasp or a place that are tried.
const POSTURES: usize = 16;
/// Blocked postures from which a way is searched; the farther ones are then left out.
const GOALS: usize = 6;
/// Most grasp postures from which the way to the place is planned.
const CARRIES: usize = 4;
/// A measured point so near to the thing is of the thing, metres.
const OF_THING: f64 = 0.015;
/// Depth in the table or an object at which the thing may be placed: the rounding of a measured pose, metres.
const SUNK: f64 = 0.003;
/// Shares of its closing at which the hand is checked while it carries.
const SHARES: [f64; 2] = [0.5, 1.0];

/// An arm with its hand.
#[derive(Debug)]
pub struct Robot<'a> {
    pub arm: &'a Arm,
    pub inverse: &'a Inverse,
    pub bodies: &'a ArmBodies,
    pub hand: &'a Hand,
    /// Pose of the hand's base on the flange.
    pub flange_from_base: Isometry3<f64>,
    /// Acceleration of each axis by which ways are compared, rad/s2 or m/s2.
    pub accelerations: Positions,
}

/// What is grasped.
#[derive(Clone, Debug)]
pub struct Thing {
    pub obstacle: Arc<Obstacle>,
    pub world_from_thing: Isometry3<f64>,
    /// Where it is placed.
    pub place: Option<Isometry3<f64>>,
}

/// A grasp to be carried out.
#[derive(Clone, Debug)]
pub struct Task {
    /// Where the arm stands.
    pub start: Positions,
    pub world_from_hand: Isometry3<f64>,
    pub preshape: f64,
    pub thing: Option<Thing>,
}

/// Parts of a path, in their order. Hand and arm do not move together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// From the start to the approach.
    Reach,
    /// Straight to the grasp.
    Approach,
    /// Straight up, with the thing.
    Lift,
    /// To above the place.
    Carry,
    /// Straight down to the place.
    Lower,
    /// Straight back from it.
    Retreat,
}

/// A part of a path.
#[derive(Clone, Debug)]
pub struct Piece {
    pub phase: Phase,
    /// Postures from its beginning to its end.
    pub postures: Vec<Positions>,
    /// Of a straight line of the hand: the distance of each posture from its beginning, metres. Else the motions between postures are straight in
    /// joint space.
    pub lengths: Option<Vec<f64>>,
}

/// A path.
#[derive(Clone, Debug)]
pub struct Path {
    pub pieces: Vec<Piece>,
}

/// Why there is no path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cause {
    /// The position of an axis at the start is beyond its limits.
    Beyond(usize),
    Touches(Contact),
    /// No posture reaches the pose.
    Unreached(Reason),
    /// An axis is at its limit on a straight line.
    AtLimit(usize),
    /// A straight line passes a singularity.
    Jumps,
    /// No way was found with so many samples.
    NoWay(usize),
}

/// Where on the path which cause was met: that of the attempt that came farthest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Failure {
    pub phase: Phase,
    /// True if the posture at the end of the phase is the cause.
    pub at_end: bool,
    pub cause: Cause,
}

impl Failure {
    fn on(phase: Phase, cause: Cause) -> Self {
        Self { phase, at_end: false, cause }
    }

    fn at_end(phase: Phase, cause: Cause) -> Self {
        Self { phase, at_end: true, cause }
    }

    /// The one of two that came farther; of the same, the first.
    fn or(self, other: Option<Self>) -> Self {
        other.filter(|other| other.phase >= self.phase).unwrap_or(self)
    }
}

/// Surroundings before the grasp, with the thing in the hand, and after it is placed.
struct Scenes {
    before: Scene,
    carrying: Scene,
    after: Option<Scene>,
}

/// Plans a path for one grasp; the same for the same seed.
///
/// * `scene`: the surroundings without the thing.
///
/// # Errors
/// [`ArmError`] as [`crate::reach()`]; the inner result is a [`Failure`] where there is no path.
pub fn path(
    robot: &Robot<'_>,
    scene: &Scene,
    task: &Task,
    params: &PathParams,
) -> Result<Result<Path, Failure>, ArmError> {
    params.check()?;
    check_payload(robot.arm, robot.hand)?;
    let chain = robot.inverse.chain();
    let bad = || ArmError::Preshape { hand: robot.hand.name.clone(), preshape: task.preshape };
    let mount = &robot.flange_from_base;
    let open = Carried::new(robot.arm, chain, robot.bodies, robot.hand, task.preshape, mount)?;
    let mut hands = vec![open.clone()];
    for share in SHARES {
        let fingers = robot.hand.closed_configuration(task.preshape, share);
        hands.push(open.with_fingers(chain, robot.hand, &fingers, mount).ok_or_else(bad)?);
    }
    let scenes = Scenes::new(scene, task, &open, robot);
    let flange_from_hand = mount * robot.hand.base_from_hand;
    let last_from_hand = chain.axis_from_flange() * flange_from_hand;
    let carried = task.thing.as_ref().map(|thing| {
        let parts: Vec<SharedShape> = thing.obstacle.convex_parts().cloned().collect();
        (parts, last_from_hand * task.world_from_hand.inverse() * thing.world_from_thing)
    });
    let motions = |scene, hands, thing| Motions::new(chain, robot.bodies, scene, hands, thing);
    let planner = Planner {
        robot,
        task,
        params,
        flange_from_hand,
        radius: open.radius_about(&chain.axis_from_flange()),
        before: motions(&scenes.before, &hands[..1], None),
        carrying: motions(&scenes.carrying, &hands, carried),
        after: scenes.after.as_ref().map(|scene| motions(scene, &hands[..1], None)),
        scenes: &scenes,
    };
    Ok(planner.plan())
}

impl Scenes {
    fn new(scene: &Scene, task: &Task, open: &Carried, robot: &Robot<'_>) -> Self {
        let Some(thing) = &task.thing else {
            // Of a thing that is known by points alone, those are taken along that the hand encloses.
            let last_from_hand =
                robot.inverse.chain().axis_from_flange() * robot.flange_from_base * robot.hand.base_from_hand;
            let last_from_world = last_from_hand * task.world_from_hand.inverse();
            let carrying = scene.without_points(|point| open.encloses(&(last_from_world * point), 2.0 * OF_THING));
            return Self { before: scene.clone(), carrying, after: None };
        };
        let from_world = thing.world_from_thing.inverse();
        let is_thing = |point: &Point3<f64>| {
            let place = from_world * point;
            thing.obstacle.is_near(&place.coords, OF_THING)
                && thing.obstacle.distance(&place, 2.0 * OF_THING) < OF_THING
        };
        let carrying = scene.without_points(is_thing);
        Self {
            before: carrying.with(&thing.obstacle, &thing.world_from_thing),
            after: thing.place.as_ref().map(|place| carrying.with(&thing.obstacle, place)),
            carrying,
        }
    }
}

/// A posture of the grasp with its lines.
struct Candidate {
    approach: Line,
    lift: Line,
}

/// A posture of the place with its lines.
struct Placing {
    lower: Line,
    retreat: Line,
}

struct Planner<'a> {
    robot: &'a Robot<'a>,
    task: &'a Task,
    params: &'a PathParams,
    flange_from_hand: Isometry3<f64>,
    /// Distance of the farthest point of the hand from the flange, metres.
    radius: f64,
    before: Motions<'a>,
    carrying: Motions<'a>,
    after: Option<Motions<'a>>,
    scenes: &'a Scenes,
}

/// On straight lines to and from the thing the hand's swept volume is checked instead, and points are not asked for.
fn hand_apart(mover: Mover, _: Touched) -> bool {
    mover == Mover::Hand
}

fn nothing(_: Mover, _: Touched) -> bool {
    false
}

impl Planner<'_> {
    fn plan(&self) -> Result<Path, Failure> {
        self.check_start()?;
        self.check_place()?;
        if self.is_exact() {
            self.check_sweep(&self.scenes.before, &self.task.world_from_hand, DEVIATION, Phase::Approach)?;
        }
        let start = &self.task.start;
        let mut random = ChaCha8Rng::seed_from_u64(self.params.seed);
        let mut worst: Option<Failure> = None;
        let mut blocked: Vec<Candidate> = Vec::new();
        for posture in self
            .postures(&self.task.world_from_hand, start)
            .map_err(|why| Failure::at_end(Phase::Approach, Cause::Unreached(why)))?
        {
            let result = self.candidate(&posture).and_then(|candidate| {
                if self.before.contact(&[*start, candidate.approach.postures[0]], &nothing).is_some() {
                    blocked.push(candidate);
                    return Ok(None);
                }
                let way = vec![*start, candidate.approach.postures[0]];
                self.finished(&candidate, way, &mut random).map(Some)
            });
            match result {
                Ok(Some(path)) => return Ok(path),
                Ok(None) => {}
                Err(failure) => worst = Some(failure.or(worst)),
            }
            if blocked.len() >= GOALS {
                break;
            }
        }
        for _ in 0..CARRIES {
            let goals: Vec<Positions> = blocked.iter().map(|candidate| candidate.approach.postures[0]).collect();
            let Some(last) = goals.first().and_then(|_| self.way(&self.before, start, &goals, &mut random)) else {
                break;
            };
            let end = last.last().copied().unwrap_or(*start);
            let index = goals.iter().position(|goal| *goal == end).unwrap_or(0);
            match self.finished(&blocked.remove(index), last, &mut random) {
                Ok(path) => return Ok(path),
                Err(failure) => worst = Some(failure.or(worst)),
            }
        }
        let none = Failure::on(Phase::Reach, Cause::NoWay(self.params.iterations));
        Err(if blocked.is_empty() {
            worst.unwrap_or(none)
        } else {
            worst.filter(|w| w.phase > Phase::Lift).unwrap_or(none)
        })
    }

    fn check_start(&self) -> Result<(), Failure> {
        let (chain, start) = (self.robot.inverse.chain(), &self.task.start);
        let beyond = (0..chain.len()).find(|&axis| {
            let [lower, upper] = chain.limits(axis);
            !(lower..=upper).contains(&start[axis])
        });
        let touches = || self.before.contact_at(start, &nothing).map(Cause::Touches);
        match beyond.map(Cause::Beyond).or_else(touches) {
            Some(cause) => Err(Failure::on(Phase::Reach, cause)),
            None => Ok(()),
        }
    }

    /// The thing must not be in something at its place.
    fn check_place(&self) -> Result<(), Failure> {
        let Some((thing, place)) = self.task.thing.as_ref().and_then(|thing| Some((thing, thing.place?))) else {
            return Ok(());
        };
        let at = library(&place);
        for part in thing.obstacle.convex_parts() {
            let low = part.as_support_map().map_or(0.0, |map| map.support_point(&at, -parry3d_f64::math::Vector::Z).z);
            let hit = self
                .scenes
                .carrying
                .obstacles()
                .iter()
                .position(|(obstacle, from_world)| obstacle.depth(part, &(library(from_world) * at)) > SUNK);
            if let Some(touched) = (low < -SUNK).then_some(Touched::Table).or(hit.map(Touched::Obstacle)) {
                let contact = (Mover::Thing, With::World(touched));
                return Err(Failure::at_end(Phase::Lower, Cause::Touches(contact)));
            }
        }
        Ok(())
    }

    /// Postures of a pose of the hand, the nearest first.
    fn postures(&self, world_from_hand: &Isometry3<f64>, near: &Positions) -> Result<Vec<Positions>, Reason> {
        let (inverse, params) = (self.robot.inverse, &self.params.reach);
        let base_from_world = self.scenes.before.world_from_base().inverse();
        let base_from_flange = base_from_world * world_from_hand * self.flange_from_hand.inverse();
        let mut found: Vec<Positions> = Vec::new();
        inverse.solve(&base_from_flange, params.starts, params.max_angle, |solution| {
            found.push(solution.positions);
            if found.len() >= POSTURES { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })?;
        let mut ranked: Vec<(f64, Positions)> =
            found.into_iter().map(|at| (self.roadmap(&|_, _| true).time(near, &at), at)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(ranked.into_iter().map(|(_, posture)| posture).collect())
    }

    fn roadmap<'b>(&'b self, is_free: &'b dyn Fn(&Positions, &Positions) -> bool) -> Roadmap<'b> {
        let (chain, accelerations) = (self.robot.inverse.chain(), &self.robot.accelerations);
        Roadmap { chain, accelerations, is_free, iterations: self.params.iterations }
    }

    fn way(
        &self,
        motions: &Motions<'_>,
        from: &Positions,
        goals: &[Positions],
        random: &mut ChaCha8Rng,
    ) -> Option<Vec<Positions>> {
        self.roadmap(&|from, to| motions.contact(&[*from, *to], &nothing).is_none()).way(from, goals, random)
    }

    fn world_from_hand(&self, posture: &Positions) -> Isometry3<f64> {
        let flange = self.robot.inverse.chain().frames(posture).flange.isometry();
        self.scenes.before.world_from_base() * flange * self.flange_from_hand
    }

    /// A straight line of the hand; `way` in the world, metres.
    fn line(&self, from: &Positions, way: &Vector3<f64>, phase: Phase) -> Result<Line, Failure> {
        let way = self.scenes.before.world_from_base().rotation.inverse() * way;
        let chain = self.robot.inverse.chain();
        Line::follow(chain, from, &way, self.radius, self.params.reach.max_angle).map_err(|broken| {
            let cause = match broken {
                Broken::AtLimit(axis) => Cause::AtLimit(axis),
                Broken::Jumps => Cause::Jumps,
            };
            Failure::on(phase, cause)
        })
    }

    /// Checks the motions of a line, and the posture of its end that is `free`.
    fn check_line(
        &self,
        motions: &Motions<'_>,
        line: &Line,
        phase: Phase,
        ignored: &dyn Fn(Mover, Touched) -> bool,
        free: &Positions,
    ) -> Result<(), Failure> {
        let touched = motions.contact(&line.postures, ignored);
        let touched = touched.or_else(|| motions.contact_at(free, &nothing));
        touched.map_or(Ok(()), |contact| Err(Failure::on(phase, Cause::Touches(contact))))
    }

    /// What the open hand touches on its straight line to or from a pose.
    ///
    /// * `grown`: distance by which its points may be beside the line, metres.
    fn check_sweep(&self, scene: &Scene, at: &Isometry3<f64>, grown: f64, phase: Phase) -> Result<(), Failure> {
        let touched = match OpenHand::new(self.robot.hand, self.task.preshape, grown, self.params.standoff) {
            Err(_) => None,
            Ok(open) if open.meets_table(at) => Some(Touched::Table),
            Ok(open) => scene
                .obstacles()
                .iter()
                .position(|(obstacle, from_world)| obstacle.is_on_approach(&open, &(from_world * at)))
                .map(Touched::Obstacle),
        };
        let contact = touched.map(|touched| (Mover::Hand, With::World(touched)));
        contact.map_or(Ok(()), |contact| Err(Failure::on(phase, Cause::Touches(contact))))
    }

    /// True for an arm that meets poses exactly: the hand's lines are then the same in all postures.
    fn is_exact(&self) -> bool {
        self.robot.inverse.chain().len() >= 6
    }

    /// The lines of a posture at the grasp.
    fn candidate(&self, grasp: &Positions) -> Result<Candidate, Failure> {
        if let Some(contact) = self.before.contact_at(grasp, &hand_apart) {
            return Err(Failure::at_end(Phase::Approach, Cause::Touches(contact)));
        }
        let back = self.world_from_hand(grasp) * Vector3::z() * -self.params.standoff;
        let away = self.line(grasp, &back, Phase::Approach)?;
        self.check_line(&self.before, &away, Phase::Approach, &hand_apart, &away.end())?;
        if !self.is_exact() {
            let (scene, at) = (&self.scenes.before, self.world_from_hand(grasp));
            self.check_sweep(scene, &at, away.deviation + DEVIATION, Phase::Approach)?;
        }
        let lift = self.line(grasp, &(Vector3::z() * self.params.lift), Phase::Lift)?;
        self.check_vertical(&lift, Phase::Lift)?;
        Ok(Candidate { approach: away.reversed(), lift })
    }

    /// Checks a straight way up with the thing from where it is nearer to something than the clearance.
    fn check_vertical(&self, up: &Line, phase: Phase) -> Result<(), Failure> {
        let near = |mover| self.carrying.touched_by(mover, &up.postures[0]);
        let (hand, thing) = (near(Mover::Hand), near(Mover::Thing));
        let ignored = |mover: Mover, what: Touched| match mover {
            Mover::Arm(_) => false,
            Mover::Hand => hand.contains(&what),
            Mover::Thing => thing.contains(&what),
        };
        self.check_line(&self.carrying, up, phase, &ignored, &up.end())
    }

    /// The path by a posture of the grasp.
    fn finished(&self, candidate: &Candidate, way: Vec<Positions>, random: &mut ChaCha8Rng) -> Result<Path, Failure> {
        let straight =
            |phase, line: &Line| Piece { phase, postures: line.postures.clone(), lengths: Some(line.lengths.clone()) };
        let free = |phase, postures| Piece { phase, postures, lengths: None };
        let mut pieces = vec![
            free(Phase::Reach, way),
            straight(Phase::Approach, &candidate.approach),
            straight(Phase::Lift, &candidate.lift),
        ];
        let place = self.task.thing.as_ref().and_then(|thing| Some((thing.world_from_thing, thing.place?)));
        if let Some((world_from_thing, place)) = place {
            let grasp = self.world_from_hand(&candidate.lift.postures[0]);
            let there = place * world_from_thing.inverse() * grasp;
            let (carry, placing) = self.carry(&there, &candidate.lift.end(), random)?;
            pieces.push(free(Phase::Carry, carry));
            pieces.push(straight(Phase::Lower, &placing.lower));
            pieces.push(straight(Phase::Retreat, &placing.retreat));
        }
        Ok(Path { pieces })
    }

    /// The way from a posture to a pose of the hand at the place, and its lines.
    fn carry(
        &self,
        world_from_hand: &Isometry3<f64>,
        lifted: &Positions,
        random: &mut ChaCha8Rng,
    ) -> Result<(Vec<Positions>, Placing), Failure> {
        if let (true, Some(scene)) = (self.is_exact(), &self.scenes.after) {
            self.check_sweep(scene, world_from_hand, DEVIATION, Phase::Retreat)?;
        }
        let postures = self.postures(world_from_hand, lifted);
        let (mut blocked, mut worst) = (Vec::new(), None);
        for posture in postures.map_err(|why| Failure::at_end(Phase::Lower, Cause::Unreached(why)))? {
            match self.placing(&posture) {
                Ok(placing) => {
                    let way = vec![*lifted, placing.lower.postures[0]];
                    if self.carrying.contact(&way, &nothing).is_none() {
                        return Ok((way, placing));
                    }
                    blocked.push(placing);
                }
                Err(failure) => worst = Some(failure.or(worst)),
            }
            if blocked.len() >= GOALS {
                break;
            }
        }
        let none = Failure::on(Phase::Carry, Cause::NoWay(self.params.iterations));
        if blocked.is_empty() {
            return Err(worst.unwrap_or(none));
        }
        let goals: Vec<Positions> = blocked.iter().map(|placing| placing.lower.postures[0]).collect();
        let way = self.way(&self.carrying, lifted, &goals, random).ok_or(none)?;
        let end = way.last().copied().unwrap_or(*lifted);
        Ok((way, blocked.remove(goals.iter().position(|goal| *goal == end).unwrap_or(0))))
    }

    fn placing(&self, place: &Positions) -> Result<Placing, Failure> {
        if let Some(contact) = self.carrying.contact_at(place, &|mover, _| !matches!(mover, Mover::Arm(_))) {
            return Err(Failure::at_end(Phase::Lower, Cause::Touches(contact)));
        }
        let up = self.line(place, &(Vector3::z() * self.params.lift), Phase::Lower)?;
        self.check_vertical(&up, Phase::Lower)?;
        let back = self.world_from_hand(place) * Vector3::z() * -self.params.standoff;
        let retreat = self.line(place, &back, Phase::Retreat)?;
        if let (Some(after), Some(scene)) = (&self.after, &self.scenes.after) {
            self.check_line(after, &retreat, Phase::Retreat, &hand_apart, &retreat.end())?;
            if !self.is_exact() {
                let at = self.world_from_hand(place);
                self.check_sweep(scene, &at, retreat.deviation + DEVIATION, Phase::Retreat)?;
            }
        }
        Ok(Placing { lower: up.reversed(), retreat })
    }
}
