//! Whether a motion leaves room: each thing that must keep away from another one is proven for as much of the motion at once as a bound allows.
//!
//! A distance measured in one posture is true for all others in which the two things have moved by less against each other. This motion is bounded
//! axis by axis, from the outermost one inwards: a turn by `w` about an axis at a distance `r` moves a point by at most `w (r + D)`, where `D` is how
//! far the turns of the axes outside have moved it. Its height changes by no more than that times the sine of the angle of the axis to the vertical.
//!
//! A part of a motion that no known distance proves is divided about one that is measured within it, down to single postures. Distances are kept: the
//! way on which an arm can stop is nearly the one of a period before.

use super::{Asked, ENOUGH, Meeting, Pair, Part, ROUNDING, Room};
use crate::chain::{Chain, Frames, MAX_AXES, Positions};
use nalgebra::{Point3, Vector3};
use std::ops::Range;

/// Longest motion between postures that are checked, metres: twice the usual clearance, so nothing touches between them.
const CHECKED: f64 = 0.01;
/// Postures with known distances that are kept of each two things.
const SPOTS: usize = 2;

/// Distances that were measured in one room, each with the posture; they change no answer, but the time that it takes.
#[derive(Debug, Default)]
pub struct Measured {
    kept: Vec<Kept>,
    /// The two that were last found too near each other: where an arm is blocked once, it most often is again.
    blocked: usize,
    /// Frames on the present way: the line, its part, and the frames there.
    frames: Vec<(usize, usize, Frames)>,
}

/// A copy begins without them: that costs less than to copy them.
impl Clone for Measured {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// What is known of two things.
#[derive(Clone, Debug, Default)]
struct Kept {
    /// The last one first.
    spots: [Spot; SPOTS],
    /// Of each pair of shapes of the two.
    pairs: Vec<Pair>,
}

/// What is known in one posture.
#[derive(Clone, Copy, Debug)]
struct Spot {
    at: Positions,
    /// By how much more than is asked for the two things are apart, metres.
    room: f64,
    /// How far the farthest point that moves is from each axis, metres.
    levers: Positions,
    /// Sines of the angles between axes and the vertical where heights matter, else 1.
    slopes: Positions,
}

impl Default for Spot {
    fn default() -> Self {
        let zero = [0.0; MAX_AXES];
        Self { at: zero, room: f64::NEG_INFINITY, levers: zero, slopes: zero }
    }
}

/// Something on the flange that must stay above the table.
pub struct Hung<'a> {
    /// Its height above what is allowed, metres.
    pub height: &'a dyn Fn(&Frames) -> f64,
    /// A sphere that contains it: the centre in the flange's frame, and the radius, metres.
    pub center: Point3<f64>,
    pub radius: f64,
}

/// Least and greatest positions of a part of a motion.
#[derive(Clone, Copy)]
struct Hull {
    low: Positions,
    high: Positions,
}

/// A motion that is being checked.
struct Walk<'a> {
    room: &'a Room,
    chain: &'a Chain,
    way: &'a [Positions],
    least: f64,
    hung: &'a Hung<'a>,
    frames: &'a mut Vec<(usize, usize, Frames)>,
}

impl Room {
    /// True if all postures of a way leave at least `least` metres. Those on the lines between `way` count where they are longer than 1 cm; the
    /// first one does not.
    ///
    /// * `hung`: what else must stay above the table.
    pub fn is_clear(
        &self,
        chain: &Chain,
        way: &[Positions],
        least: f64,
        hung: &Hung<'_>,
        known: &mut Measured,
    ) -> bool {
        if way.len() < 2 {
            return true;
        }
        // The last one is what hangs on the flange.
        let Measured { kept, blocked, frames } = known;
        kept.resize_with(self.meetings.len() + 1, Kept::default);
        frames.clear();
        let lines = 0..way.len() - 1;
        let mut walk = Walk { room: self, chain, way, least, hung, frames };
        let hull = walk.hull(&lines);
        if !walk.ends_clear(*blocked, &mut kept[*blocked]) {
            return false;
        }
        for (index, kept) in kept.iter_mut().enumerate() {
            if !walk.is_clear(index, kept, lines.clone(), &hull) {
                *blocked = index;
                return false;
            }
        }
        true
    }
}

impl Walk<'_> {
    /// Least and greatest positions on lines.
    fn hull(&self, lines: &Range<usize>) -> Hull {
        let mut hull = Hull { low: self.way[lines.start], high: self.way[lines.start] };
        for posture in &self.way[lines.start + 1..=lines.end] {
            for (axis, at) in posture.iter().enumerate().take(self.room.count) {
                hull.low[axis] = hull.low[axis].min(*at);
                hull.high[axis] = hull.high[axis].max(*at);
            }
        }
        hull
    }

    /// True if two things keep apart on a part of the way.
    ///
    /// * `lines`: those that end at the postures after these; `hull`: of all their postures.
    fn is_clear(&mut self, index: usize, kept: &mut Kept, lines: Range<usize>, hull: &Hull) -> bool {
        if kept.spots.iter().any(|spot| self.proves(index, spot, hull)) {
            return true;
        }
        if lines.len() <= 1 {
            return lines.into_iter().all(|line| self.line_is_clear(index, kept, line));
        }
        let middle = self.middle(&lines);
        let parts = self.parts(middle - 1);
        let spot = self.measure(index, kept, (&self.between(middle - 1, parts, parts), middle - 1, parts), hull);
        if spot.room < 0.0 && parts > 0 {
            return false;
        }
        if self.proves(index, &spot, hull) {
            return true;
        }
        [lines.start..middle, middle..lines.end].into_iter().all(|half| {
            let hull = self.hull(&half);
            self.is_clear(index, kept, half, &hull)
        })
    }

    /// False if two things are too near each other at the end of the way; else they may be so before it.
    fn ends_clear(&mut self, index: usize, kept: &mut Kept) -> bool {
        let line = self.way.len() - 2;
        let parts = self.parts(line);
        let at = self.between(line, parts, parts);
        let hull = Hull { low: at, high: at };
        parts == 0
            || kept.spots.iter().any(|spot| self.proves(index, spot, &hull))
            || self.measure(index, kept, (&at, line, parts), &hull).room >= 0.0
    }

    /// The same for one line, posture by posture.
    fn line_is_clear(&mut self, index: usize, kept: &mut Kept, line: usize) -> bool {
        let parts = self.parts(line);
        (1..=parts).all(|part| {
            let between = self.between(line, part, parts);
            let hull = Hull { low: between, high: between };
            kept.spots.iter().any(|spot| self.proves(index, spot, &hull))
                || self.measure(index, kept, (&between, line, part), &hull).room >= 0.0
        })
    }

    /// Into how many parts a line is divided; none if it is of no length.
    fn parts(&self, line: usize) -> usize {
        (self.room.motion(&self.way[line], &self.way[line + 1]) / CHECKED).ceil() as usize
    }

    /// The posture at the end of a part of a line.
    fn between(&self, line: usize, part: usize, parts: usize) -> Positions {
        let (mut at, to) = (self.way[line], &self.way[line + 1]);
        let share = part as f64 / parts.max(1) as f64;
        at.iter_mut().zip(to).for_each(|(from, to)| *from += share * (to - *from));
        at
    }

    /// The posture within a part of the way from which it is about as far to both ends.
    fn middle(&self, lines: &Range<usize>) -> usize {
        let (start, end) = (&self.way[lines.start], &self.way[lines.end]);
        let is_beyond = |at: &usize| self.room.motion(start, &self.way[*at]) >= self.room.motion(&self.way[*at], end);
        (lines.start + 1..lines.end).find(is_beyond).unwrap_or(lines.end - 1)
    }

    /// Axes that move one thing against the other, and how far at most per change of each axis, metres.
    fn axes(&self, index: usize) -> (Range<usize>, &Positions) {
        // The sphere about what hangs on the flange is enough.
        let hung = (0..self.room.count, &[f64::INFINITY; MAX_AXES]);
        self.room.meetings.get(index).map_or(hung, |meeting| (meeting.axes.clone(), &meeting.levers))
    }

    /// True if a known distance is enough for all postures of a hull.
    fn proves(&self, index: usize, spot: &Spot, hull: &Hull) -> bool {
        spot.room - self.nearer(index, spot, hull) >= ROUNDING
    }

    /// A bound of how much less two things are apart in any posture of a hull than in the one of a spot, metres.
    fn nearer(&self, index: usize, spot: &Spot, hull: &Hull) -> f64 {
        let (axes, most) = self.axes(index);
        let (mut moved, mut nearer) = (0.0, 0.0);
        for axis in axes.rev() {
            let change = (spot.at[axis] - hull.low[axis]).max(hull.high[axis] - spot.at[axis]);
            let arc = change * (spot.levers[axis] + moved).min(most[axis]);
            moved += arc;
            nearer += arc * spot.slopes[axis];
        }
        nearer
    }

    /// Measures and keeps a distance, as far as a hull needs it.
    ///
    /// * `line`, `part`: where the posture is on the way.
    fn measure(
        &mut self,
        index: usize,
        kept: &mut Kept,
        (at, line, part): (&Positions, usize, usize),
        hull: &Hull,
    ) -> Spot {
        let found = self.frames.iter().position(|own| own.0 == line && own.1 == part);
        let found = found.unwrap_or_else(|| {
            self.frames.push((line, part, self.chain.frames(at)));
            self.frames.len() - 1
        });
        let frames = &self.frames[found].2;
        let (levers, slopes) = self.levers(index, frames);
        let mut spot = Spot { at: *at, room: 0.0, levers, slopes };
        spot.room = match self.room.meetings.get(index) {
            Some(meeting) => {
                let enough = (self.least + self.nearer(index, &spot, hull) + 2.0 * ROUNDING).max(ENOUGH);
                let asked = Asked { pairs: &mut kept.pairs, least: self.least, enough };
                self.room.distance(meeting, frames, Some(asked)) - self.least
            }
            None => (self.hung.height)(frames),
        };
        if spot.room >= 0.0 {
            kept.spots.rotate_right(1);
            kept.spots[0] = spot;
        }
        spot
    }

    /// [`Spot::levers`] and [`Spot::slopes`].
    fn levers(&self, index: usize, frames: &Frames) -> (Positions, Positions) {
        let Room { parts, world_from_base, walls, count, .. } = self.room;
        let meeting = self.room.meetings.get(index);
        let hung = || (*count, self.chain.axis_from_flange() * self.hung.center, self.hung.radius);
        let part = |meeting: &Meeting| {
            let Part { carrier, body } = &parts[meeting.moving];
            (*carrier, body.center, body.radius)
        };
        let (carrier, own, radius) = meeting.map_or_else(hung, part);
        let carrier = &frames.axes[carrier - 1];
        let center = carrier.turn * own.coords + carrier.shift;
        let falls = meeting.is_none_or(|meeting| meeting.other.is_none() && walls.is_empty());
        let up = world_from_base.rotation.inverse() * Vector3::z();
        let (mut levers, mut slopes) = ([0.0; MAX_AXES], [1.0; MAX_AXES]);
        for axis in self.axes(index).0 {
            let along = frames.axes[axis].turn.column(2).into_owned();
            if self.chain.is_revolute(axis) {
                levers[axis] = along.cross(&(center - frames.axes[axis].shift)).norm() + radius;
                if falls {
                    slopes[axis] = along.cross(&up).norm();
                }
            } else {
                levers[axis] = 1.0;
            }
        }
        (levers, slopes)
    }
}
