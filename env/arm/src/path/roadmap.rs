//! A way between postures in joint space: RRT-Connect, then shortcuts.
//!
//! Source: Kuffner, LaValle, "RRT-Connect: an efficient approach to single-query path planning", ICRA 2000.

use crate::chain::{Chain, Positions};
use crate::postures::within_limits;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Longest step of a tree, rad (and m).
const STEP: f64 = 0.5;
/// Shortcuts that are tried.
const SHORTCUTS: usize = 40;
/// A shortcut must save this share of the time.
const WORTH: f64 = 0.02;

/// What a way is planned with.
pub(crate) struct Roadmap<'a> {
    pub chain: &'a Chain,
    /// Greatest acceleration of each axis, rad/s2 or m/s2.
    pub accelerations: &'a Positions,
    /// True if the straight motion touches nothing.
    pub is_free: &'a dyn Fn(&Positions, &Positions) -> bool,
    /// Most samples.
    pub iterations: usize,
}

/// A tree of postures: each with its parent, a root with itself.
struct Tree {
    postures: Vec<Positions>,
    parents: Vec<usize>,
}

impl Tree {
    fn new(roots: &[Positions]) -> Self {
        Self { postures: roots.to_vec(), parents: (0..roots.len()).collect() }
    }

    fn nearest(&self, to: &Positions) -> usize {
        let distance = |index: usize| squared(&self.postures[index], to);
        let nearest = |best: (usize, f64), index: usize| {
            let own = distance(index);
            if own < best.1 { (index, own) } else { best }
        };
        (0..self.postures.len()).fold((0, f64::INFINITY), nearest).0
    }

    fn add(&mut self, posture: Positions, parent: usize) -> usize {
        self.postures.push(posture);
        self.parents.push(parent);
        self.postures.len() - 1
    }

    /// The postures from one to its root.
    fn to_root(&self, mut at: usize) -> Vec<Positions> {
        let mut all = vec![self.postures[at]];
        while self.parents[at] != at {
            at = self.parents[at];
            all.push(self.postures[at]);
        }
        all
    }
}

fn squared(a: &Positions, b: &Positions) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

impl Roadmap<'_> {
    /// The time that a straight motion takes from rest to rest, without a limit of jerk, seconds.
    pub fn time(&self, from: &Positions, to: &Positions) -> f64 {
        let one = |axis: usize| {
            let (way, speed) = ((to[axis] - from[axis]).abs(), self.chain.speed(axis));
            let acceleration = self.accelerations[axis];
            let whole = way / speed + speed / acceleration;
            if way * acceleration < speed * speed { 2.0 * (way / acceleration).sqrt() } else { whole }
        };
        (0..self.chain.len()).map(one).fold(0.0, f64::max)
    }

    /// Postures from `start` to one of the goals, to none of which the straight motion is free; `None` if none was found.
    pub fn way(&self, start: &Positions, goals: &[Positions], random: &mut ChaCha8Rng) -> Option<Vec<Positions>> {
        let found = self.connect(start, goals, random)?;
        Some(self.shortened(found, random))
    }

    fn connect(&self, start: &Positions, goals: &[Positions], random: &mut ChaCha8Rng) -> Option<Vec<Positions>> {
        let mut trees = [Tree::new(&[*start]), Tree::new(goals)];
        for number in 0..self.iterations {
            let sample = within_limits(self.chain, || random.random());
            let [one, two] = &mut trees;
            let (own, other) = if number % 2 == 0 { (one, two) } else { (two, one) };
            let Some(reached) = self.extend(own, &sample, 1) else { continue };
            let wanted = own.postures[reached];
            if let Some(met) = self.extend(other, &wanted, usize::MAX)
                && squared(&other.postures[met], &wanted) == 0.0
            {
                let [mut from, to] = if number % 2 == 0 {
                    [own.to_root(reached), other.to_root(met)]
                } else {
                    [other.to_root(met), own.to_root(reached)]
                };
                from.reverse();
                from.extend(&to[1..]);
                return Some(from);
            }
        }
        None
    }

    /// Grows a tree towards a posture by some steps; returns the last new one, `None` if the first step is blocked.
    fn extend(&self, tree: &mut Tree, to: &Positions, steps: usize) -> Option<usize> {
        let mut last = None;
        let mut at = tree.nearest(to);
        for _ in 0..steps {
            let from = tree.postures[at];
            let apart = squared(&from, to).sqrt();
            if apart == 0.0 {
                return Some(at);
            }
            let share = STEP / apart;
            let next = if share >= 1.0 {
                *to
            } else {
                std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]))
            };
            if !(self.is_free)(&from, &next) {
                break;
            }
            at = tree.add(next, at);
            last = Some(at);
        }
        last
    }

    /// Fewer and shorter motions between the same ends: each of them begins and ends at rest.
    fn shortened(&self, mut way: Vec<Positions>, random: &mut ChaCha8Rng) -> Vec<Positions> {
        self.skip(&mut way);
        for _ in 0..SHORTCUTS {
            if way.len() < 3 {
                break;
            }
            let pieces = way.len() - 1;
            let mut place = || {
                let at = random.random::<f64>() * pieces as f64;
                (at as usize, at.fract())
            };
            let [mut first, mut second] = [place(), place()];
            if first.0 > second.0 {
                std::mem::swap(&mut first, &mut second);
            }
            if first.0 == second.0 {
                continue;
            }
            let on = |(piece, share): (usize, f64)| -> Positions {
                let (from, to) = (&way[piece], &way[piece + 1]);
                std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]))
            };
            let mut cut = way[..=first.0].to_vec();
            cut.extend([on(first), on(second)]);
            cut.extend_from_slice(&way[second.0 + 1..]);
            if self.total(&cut) < (1.0 - WORTH) * self.total(&way) && (self.is_free)(&on(first), &on(second)) {
                way = cut;
            }
        }
        self.skip(&mut way);
        way
    }

    /// Leaves out postures between two that a free straight motion joins faster.
    fn skip(&self, way: &mut Vec<Positions>) {
        let mut at = 0;
        while at + 2 < way.len() {
            let until = (at + 2..way.len()).rev().find(|&other| {
                self.time(&way[at], &way[other]) < self.total(&way[at..=other]) && (self.is_free)(&way[at], &way[other])
            });
            if let Some(until) = until {
                way.drain(at + 1..until);
            }
            at += 1;
        }
    }

    fn total(&self, way: &[Positions]) -> f64 {
        way.windows(2).map(|pair| self.time(&pair[0], &pair[1])).sum()
    }
}
