//! Small dense matrices that allocate nothing in a step: LU factors with row exchanges, and Cholesky's method.

use serde::{Deserialize, Serialize};

/// Entries per vector operation. Rows and row operations begin at multiples of this number; a row operation may therefore change entries left of
/// its first one, which nothing reads afterwards.
const LANES: usize = 4;
/// Rows that Cholesky's method eliminates together: the unknowns of an object.
const PANEL: usize = 6;
/// Greatest number of rows of a matrix that is treated as dense, as one panel: that of a hand and an object.
const SMALL: usize = 24;

/// A square matrix of `n` rows of fixed stride.
#[derive(Clone, Default)]
pub(crate) struct Matrix {
    n: usize,
    stride: usize,
    values: Vec<f64>,
    /// Buffers of the substitution.
    sums: Vec<f64>,
    ends: Vec<usize>,
}

impl Matrix {
    pub fn new(n: usize) -> Self {
        let stride = n.next_multiple_of(LANES);
        Self { n, stride, values: vec![0.0; n * stride], ..Self::default() }
    }

    /// Sets the number of rows; the entries are then arbitrary.
    pub fn resize(&mut self, n: usize) {
        if n != self.n {
            self.n = n;
            self.stride = n.next_multiple_of(LANES);
            self.values.clear();
            self.values.resize(n * self.stride, 0.0);
        }
    }

    /// Sets all entries to 0.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }

    #[inline]
    pub fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.stride..][..self.n]
    }

    #[inline]
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.values[i * self.stride..][..self.n]
    }

    /// Six entries of row `i` from column `j` on: those of an object.
    #[inline(always)]
    pub fn six_mut(&mut self, i: usize, j: usize) -> &mut [f64] {
        &mut self.values[i * self.stride + j..][..6]
    }

    #[inline(always)]
    pub fn entry_mut(&mut self, i: usize, j: usize) -> &mut f64 {
        &mut self.values[i * self.stride + j]
    }

    /// Factors the matrix by Gaussian elimination with partial pivoting, and writes the result to `factors`. Returns false if it is singular.
    ///
    /// With the order of the unknowns (each chain of the hand, then the object) most entries below a pivot are 0; their rows are skipped.
    pub fn factor(&mut self, factors: &mut Factors) -> bool {
        let (n, stride) = (self.n, self.stride);
        factors.valid = false;
        for i in 0..n {
            let (mut best, mut most) = (i, self.values[i * stride + i].abs());
            for k in i + 1..n {
                let value = self.values[k * stride + i].abs();
                if value > most {
                    (best, most) = (k, value);
                }
            }
            if most.is_nan() || most <= 0.0 {
                return false;
            }
            if best != i {
                let (above, below) = self.values.split_at_mut(best * stride);
                above[i * stride..(i + 1) * stride].swap_with_slice(&mut below[..stride]);
            }
            factors.exchanges[i] = best;
            let (above, below) = self.values.split_at_mut((i + 1) * stride);
            let row = &above[i * stride..];
            let pivot = &row[..end(row, n)];
            let inverse = 1.0 / pivot[i];
            let shares = &mut factors.shares[i * n..(i + 1) * n][i + 1..];
            for (row, share) in below.chunks_exact_mut(stride).zip(shares) {
                let x = row[i] * inverse;
                *share = x;
                if x != 0.0 {
                    subtract(row, pivot, x, i + 1);
                }
            }
        }
        for i in 0..n {
            factors.upper[i * n..(i + 1) * n].copy_from_slice(self.row(i));
        }
        factors.valid = true;
        true
    }

    /// Solves `self x = b` in place for a symmetric positive definite matrix by Cholesky's method. Returns false if it is not positive definite.
    /// Reads only the upper triangle, and destroys it.
    pub fn solve_definite(&mut self, b: &mut [f64]) -> bool {
        let definite = self.factor_definite();
        if definite {
            self.substitute_definite(b);
        }
        definite
    }

    /// Rows are eliminated by panels of [`PANEL`]: each row below a panel is read and written once for all its rows.
    fn factor_definite(&mut self) -> bool {
        let (n, stride) = (self.n, self.stride);
        if n <= SMALL {
            return self.factor_panel(0, n);
        }
        for first in (0..n).step_by(PANEL) {
            let last = n.min(first + PANEL);
            if !self.factor_panel(first, last) {
                return false;
            }
            let (above, below) = self.values.split_at_mut(last * stride);
            let panel: [&[f64]; PANEL] =
                std::array::from_fn(|i| &above[(first + i).min(last - 1) * stride..][..stride]);
            let rows = last - first;
            let end = panel.iter().map(|row| end(row, n)).max().unwrap_or(0);
            for (k, row) in (last..end.min(n)).zip(below.chunks_exact_mut(stride)) {
                let shares: [f64; PANEL] = std::array::from_fn(|i| if i < rows { panel[i][k] } else { 0.0 });
                if shares != [0.0; PANEL] {
                    subtract_panel(&mut row[..end], &panel, &shares, k);
                }
            }
        }
        true
    }

    /// Eliminates the rows of a panel from each other. Returns false if a pivot is not positive.
    fn factor_panel(&mut self, first: usize, last: usize) -> bool {
        let stride = self.stride;
        for i in first..last {
            let pivot = self.values[i * stride + i];
            if pivot.is_nan() || pivot <= 0.0 {
                return false;
            }
            let inverse = 1.0 / pivot.sqrt();
            let (above, below) = self.values.split_at_mut((i + 1) * stride);
            let above = &mut above[i * stride..];
            let end = end(above, self.n);
            let above = &mut above[..end];
            for x in &mut above[i..] {
                *x *= inverse;
            }
            for (k, row) in (i + 1..last.min(end)).zip(below.chunks_exact_mut(stride)) {
                if above[k] != 0.0 {
                    subtract(&mut row[..end], above, above[k], k);
                }
            }
        }
        true
    }

    /// Forward and back substitution with the triangle of [`Matrix::factor_definite`].
    fn substitute_definite(&mut self, b: &mut [f64]) {
        let n = self.n;
        let mut sums = std::mem::take(&mut self.sums);
        sums.clear();
        sums.resize(n, 0.0);
        self.ends.clear();
        for i in 0..n {
            let row = &self.values[i * self.stride..][..self.stride];
            let end = end(row, n).min(n);
            self.ends.push(end);
            b[i] = (b[i] - sums[i]) / row[i];
            for (sum, x) in sums[i + 1..end].iter_mut().zip(&row[i + 1..end]) {
                *sum += x * b[i];
            }
        }
        self.sums = sums;
        for i in (0..n).rev() {
            let (row, end) = (&self.values[i * self.stride..], self.ends[i]);
            let sum: f64 = row[i + 1..end].iter().zip(&b[i + 1..end]).map(|(a, x)| a * x).sum();
            b[i] = (b[i] - sum) / row[i];
        }
    }
}

/// LU factors of a matrix, which solve its equations for any number of right-hand sides.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Factors {
    /// False before the first factorization, and after a singular one.
    valid: bool,
    /// Row that was exchanged with row i before step i.
    exchanges: Vec<usize>,
    /// By step i and row: the multiple of row i that was subtracted from the row.
    shares: Vec<f64>,
    /// The upper triangle: row i from its diagonal on.
    upper: Vec<f64>,
}

impl Factors {
    pub fn new(n: usize) -> Self {
        Self { valid: false, exchanges: vec![0; n], shares: vec![0.0; n * n], upper: vec![0.0; n * n] }
    }

    pub fn is_valid(&self) -> bool {
        self.valid
    }

    pub fn forget(&mut self) {
        self.valid = false;
    }

    /// Whether a matrix can have them: finite numbers, and no row that eliminates to nothing.
    pub fn is_possible(&self) -> bool {
        let stride = self.exchanges.len() + 1;
        let diagonal = self.upper.iter().step_by(stride);
        let regular = !self.valid || diagonal.into_iter().all(|x| x.abs() > f64::MIN_POSITIVE);
        regular && self.upper.iter().chain(&self.shares).all(|x| x.is_finite())
    }

    /// True if these factors are those of a matrix of `n` rows.
    pub fn fits(&self, n: usize) -> bool {
        self.exchanges.len() == n
            && self.exchanges.iter().all(|row| *row < n)
            && self.shares.len() == n * n
            && self.upper.len() == n * n
    }

    /// Solves the equations in place for the right-hand side `b`. Returns false if the solution is not finite.
    pub fn solve(&self, b: &mut [f64]) -> bool {
        let n = self.exchanges.len();
        for (i, (&other, shares)) in self.exchanges.iter().zip(self.shares.chunks_exact(n)).enumerate() {
            b.swap(i, other);
            let solved = b[i];
            for (b, x) in b[i + 1..].iter_mut().zip(&shares[i + 1..]) {
                *b -= x * solved;
            }
        }
        back_substitute(&self.upper, n, b);
        b.iter().all(|x| x.is_finite())
    }
}

/// Back substitution with the upper triangle of `values`, whose rows begin at multiples of `stride`.
fn back_substitute(values: &[f64], stride: usize, b: &mut [f64]) {
    for i in (0..b.len()).rev() {
        let row = &values[i * stride..][..b.len()];
        let sum: f64 = row[i + 1..].iter().zip(&b[i + 1..]).map(|(a, x)| a * x).sum();
        b[i] = (b[i] - sum) / row[i];
    }
}

/// Number of entries of a row of `n` up to the last one that is not 0, in whole [`LANES`]: distant objects of a heap do not touch each other.
/// All of them for a small matrix, see [`SMALL`].
#[inline(always)]
fn end(row: &[f64], n: usize) -> usize {
    if n <= SMALL {
        n.next_multiple_of(LANES)
    } else {
        row[..n].iter().rposition(|x| *x != 0.0).map_or(0, |last| last + 1).next_multiple_of(LANES)
    }
}

/// `row -= x * other`, from entry `first` (see [`LANES`]).
#[inline]
fn subtract(row: &mut [f64], other: &[f64], x: f64, first: usize) {
    let (row, other) = (row.as_chunks_mut::<LANES>().0, other.as_chunks::<LANES>().0);
    for (a, p) in row[first / LANES..].iter_mut().zip(&other[first / LANES..]) {
        *a = std::array::from_fn(|lane| a[lane] - x * p[lane]);
    }
}

/// `row -= sum of shares[i] * panel[i]`, one after the other, from entry `first` (see [`LANES`]).
#[inline]
fn subtract_panel(row: &mut [f64], panel: &[&[f64]; PANEL], shares: &[f64; PANEL], first: usize) {
    let row = &mut row.as_chunks_mut::<LANES>().0[first / LANES..];
    let panel = panel.map(|other| &other.as_chunks::<LANES>().0[first / LANES..][..row.len()]);
    for (chunk, a) in row.iter_mut().enumerate() {
        for (other, x) in panel.iter().zip(shares) {
            *a = std::array::from_fn(|lane| a[lane] - x * other[chunk][lane]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers in [-1, 1) from a small generator.
    fn numbers() -> impl FnMut() -> f64 {
        let mut state = 1_u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }
    }

    fn filled(n: usize, mut value: impl FnMut(usize, usize) -> f64) -> Matrix {
        let mut m = Matrix::new(n);
        for i in 0..n {
            for j in 0..n {
                m.row_mut(i)[j] = value(i, j);
            }
        }
        m
    }

    fn residual(m: &Matrix, x: &[f64], b: &[f64]) -> f64 {
        let each = (0..m.n).map(|i| (m.row(i).iter().zip(x).map(|(a, x)| a * x).sum::<f64>() - b[i]).abs());
        each.fold(0.0, f64::max)
    }

    #[test]
    fn both_ways_solve() {
        let mut next = numbers();
        for n in 1..30 {
            let general = filled(n, |_, _| next());
            let b: Vec<f64> = (0..n).map(|_| next()).collect();
            let mut x = b.clone();
            let mut factors = Factors::new(n);
            assert!(general.clone().factor(&mut factors) && factors.solve(&mut x));
            assert!(residual(&general, &x, &b) < 1e-9, "{n} unknowns");
            let other: Vec<f64> = (0..n).map(|_| next()).collect();
            x.copy_from_slice(&other);
            assert!(factors.solve(&mut x));
            assert!(residual(&general, &x, &other) < 1e-9, "{n} unknowns, once more");
            let dot = |i: usize, j: usize| (0..n).map(|k| general.row(i)[k] * general.row(j)[k]).sum::<f64>();
            let definite = filled(n, |i, j| dot(i, j) + if i == j { 0.1 } else { 0.0 });
            let mut x = b.clone();
            assert!(definite.clone().solve_definite(&mut x));
            assert!(residual(&definite, &x, &b) < 1e-9, "{n} unknowns");
        }
    }

    #[test]
    fn singular_and_indefinite_matrices_are_reported() {
        let mut b = [1.0, 1.0];
        assert!(!filled(2, |_, _| 1.0).solve_definite(&mut b));
        let mut factors = Factors::new(2);
        assert!(!filled(2, |_, _| 0.0).factor(&mut factors) && !factors.is_valid());
        assert!(!filled(2, |_, _| f64::NAN).factor(&mut factors) && !factors.is_valid());
    }
}
