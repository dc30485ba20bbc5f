//! Two scans over a grid, there and back, in which every node takes closer points from the 13 neighbours already visited.
//!
//! Twelve of them lie in rows that are done, so a row is processed for all of its nodes at once, which the compiler turns into vector code;
//! only the last neighbour, in the same row, has to wait for its predecessor.
//!
//! Danielsson, "Euclidean distance mapping", 1980.

/// Data of every node of a grid: columns, node by node.
pub(super) struct NodeColumns {
    /// Its closest face.
    pub face: Vec<u32>,
    /// The closest point of that face.
    pub closest: [Vec<f32>; 3],
}

impl NodeColumns {
    pub fn new(nodes: usize) -> Self {
        let column = || vec![f32::INFINITY; nodes];
        Self { face: vec![u32::MAX; nodes], closest: [column(), column(), column()] }
    }

    /// Squared distance from `p` to the point of node `i`.
    pub fn squared(&self, i: usize, p: &[f32; 3]) -> f32 {
        let [x, y, z] = &self.closest;
        squared([p[0] - x[i], p[1] - y[i], p[2] - z[i]])
    }

    pub fn set(&mut self, i: usize, face: u32, closest: [f32; 3]) {
        self.face[i] = face;
        self.closest.iter_mut().zip(closest).for_each(|(column, x)| column[i] = x);
    }

    /// Compares every node with the points of its neighbours.
    ///
    /// * `places`: coordinates of the nodes along each axis; their numbers are the grid's size.
    /// * `right`: nodes whose squared distance is no greater have the right face already.
    pub fn scan(&mut self, places: &[Vec<f32>; 3], right: f32) {
        let size = [0, 1, 2].map(|k| places[k].len());
        let mut rows = Rows::new(size[0]);
        for back in [false, true] {
            for k in 0..size[1] * size[2] {
                let row = if back { size[1] * size[2] - 1 - k } else { k };
                self.scan_row(places, [row % size[1], row / size[1]], back, right, &mut rows);
            }
        }
    }

    /// * `at`: the row's place along y and z.
    fn scan_row(&mut self, places: &[Vec<f32>; 3], at: [usize; 2], back: bool, right: f32, rows: &mut Rows) {
        let (count, sides) = (places[0].len(), [places[1].len(), places[2].len()]);
        let (y, z) = (places[1][at[0]], places[2][at[1]]);
        let row = (at[1] * sides[0] + at[0]) * count;
        for (x, best) in rows.best.iter_mut().enumerate() {
            let known = self.squared(row + x, &[places[0][x], y, z]);
            // Nothing is closer than a node that is right already.
            *best = if known <= right { f32::NEG_INFINITY } else { known };
        }
        let step = if back { 1 } else { -1 };
        for [dy, dz] in [[step, step], [0, step], [-step, step], [step, 0]] {
            let Some(y_of_other) = at[0].checked_add_signed(dy).filter(|y| *y < sides[0]) else { continue };
            let Some(z_of_other) = at[1].checked_add_signed(dz).filter(|z| *z < sides[1]) else { continue };
            let other = (z_of_other * sides[0] + y_of_other) * count;
            for dx in [step, 0, -step] {
                self.compare_row(&places[0], [y, z], [row, other], dx, rows);
            }
        }
        for k in 1..count {
            let x = if back { count - 1 - k } else { k };
            let other = row + x.wrapping_add_signed(step);
            let distance = self.squared(other, &[places[0][x], y, z]);
            if distance < rows.best[x] {
                self.set(row + x, self.face[other], [0, 1, 2].map(|k| self.closest[k][other]));
            }
        }
    }

    /// Compares every node of a row with its neighbour, `dx` nodes along x, in another row.
    fn compare_row(&mut self, xs: &[f32], [y, z]: [f32; 2], [row, other]: [usize; 2], dx: isize, rows: &mut Rows) {
        let count = xs.len();
        // The nodes that have such a neighbour.
        let (from, to) = (usize::from(dx < 0), count - usize::from(dx > 0));
        // `other + dx` may be -1 where `from` is 1.
        let neighbour = |x: usize| (other + x).wrapping_add_signed(dx);
        let (own, asked) = (row + from..row + to, neighbour(from)..neighbour(to));
        let (xs, best, distances) = (&xs[from..to], &mut rows.best[from..to], &mut rows.distances[from..to]);
        let masks = &mut rows.masks[from..to];
        let [bx, by, bz] = [0, 1, 2].map(|k| &self.closest[k][asked.clone()]);
        measure(distances, xs, [y, z], bx, by, bz);
        for ((mask, best), distance) in masks.iter_mut().zip(best.iter_mut()).zip(distances.iter()) {
            *mask = 0_u32.wrapping_sub(u32::from(distance < best));
            *best = f32::from_bits(chosen(best.to_bits(), distance.to_bits(), *mask));
        }
        for column in &mut self.closest {
            let (own, asked) = apart(column, &own, &asked);
            take_closer(own, asked, masks);
        }
        let (own, asked) = apart(&mut self.face, &own, &asked);
        for ((own, asked), mask) in own.iter_mut().zip(asked).zip(masks.iter()) {
            *own = chosen(*own, *asked, *mask);
        }
    }
}

/// Temporary buffers of a row.
struct Rows {
    /// Squared distance of the closest point so far; negative where nothing is closer.
    best: Vec<f32>,
    /// Squared distance of the neighbour's point.
    distances: Vec<f32>,
    /// All ones where that is closer.
    masks: Vec<u32>,
}

impl Rows {
    fn new(count: usize) -> Self {
        Self { best: vec![0.0; count], distances: vec![0.0; count], masks: vec![0; count] }
    }
}

/// Squared distances of the nodes of a row from their neighbours' points. Each loop has one result, which compilers turn into
/// vector code.
fn measure(distances: &mut [f32], xs: &[f32], [y, z]: [f32; 2], ax: &[f32], ay: &[f32], az: &[f32]) {
    for ((((distance, x), ax), ay), az) in distances.iter_mut().zip(xs).zip(ax).zip(ay).zip(az) {
        *distance = squared([x - ax, y - ay, z - az]);
    }
}

/// Takes the values of neighbours where they are closer.
fn take_closer(own: &mut [f32], asked: &[f32], masks: &[u32]) {
    for ((own, asked), mask) in own.iter_mut().zip(asked).zip(masks) {
        *own = f32::from_bits(chosen(own.to_bits(), asked.to_bits(), *mask));
    }
}

/// `b` where the mask is all ones, `a` where it is 0: compilers turn a condition into a jump, which cannot be guessed here.
fn chosen(a: u32, b: u32, mask: u32) -> u32 {
    a ^ ((a ^ b) & mask)
}

fn squared([x, y, z]: [f32; 3]) -> f32 {
    x * x + y * y + z * z
}

/// Two ranges of a column that do not overlap.
fn apart<'a, T>(
    column: &'a mut [T],
    own: &std::ops::Range<usize>,
    asked: &std::ops::Range<usize>,
) -> (&'a mut [T], &'a [T]) {
    if own.start > asked.start {
        let (before, rest) = column.split_at_mut(own.start);
        (&mut rest[..own.len()], &before[asked.clone()])
    } else {
        let (before, rest) = column.split_at_mut(own.end);
        let begin = asked.start - own.end;
        (&mut before[own.clone()], &rest[begin..begin + asked.len()])
    }
}
