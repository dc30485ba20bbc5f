//! Small dense matrices without allocation in a step, and the two ways in which the solver solves with them.

/// A square matrix of `n` rows of fixed stride; `n` is set once.
#[derive(Clone, Default)]
pub(crate) struct Matrix {
    n: usize,
    values: Vec<f64>,
}

impl Matrix {
    pub fn new(n: usize) -> Self {
        Self { n, values: vec![0.0; n * n] }
    }

    #[inline]
    pub fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.n..(i + 1) * self.n]
    }

    #[inline]
    pub fn row_mut(&mut self, i: usize) -> &mut [f64] {
        &mut self.values[i * self.n..(i + 1) * self.n]
    }

    /// Rows `i` (shared) and `k > i` (exclusive).
    #[inline]
    fn two_rows(&mut self, i: usize, k: usize) -> (&[f64], &mut [f64]) {
        let (head, tail) = self.values.split_at_mut(k * self.n);
        (&head[i * self.n..(i + 1) * self.n], &mut tail[..self.n])
    }

    /// Solves `self x = b` in place by elimination with row exchanges; false where the matrix is singular. Destroys the matrix.
    ///
    /// The order of the unknowns (each chain of the hand, then the object) leaves most entries left of the pivots 0: these rows are
    /// skipped.
    pub fn solve(&mut self, b: &mut [f64]) -> bool {
        let n = self.n;
        for i in 0..n {
            let (mut best, mut most) = (i, self.values[i * n + i].abs());
            for (k, value) in self.values[i..].iter().step_by(n).enumerate().skip(i + 1) {
                if value.abs() > most {
                    (best, most) = (k, value.abs());
                }
            }
            if most.is_nan() || most <= 0.0 {
                return false;
            }
            if best != i {
                for j in i..n {
                    self.values.swap(i * n + j, best * n + j);
                }
                b.swap(i, best);
            }
            let (above, below) = self.values.split_at_mut((i + 1) * n);
            let pivot = &above[i * n..];
            let inverse = 1.0 / pivot[i];
            let (_, rest) = b.split_at_mut(i);
            let [solved, rest @ ..] = rest else { break };
            for (row, b) in below.chunks_exact_mut(n).zip(rest) {
                let x = row[i] * inverse;
                if x != 0.0 {
                    for (a, p) in row[i + 1..].iter_mut().zip(&pivot[i + 1..]) {
                        *a -= x * p;
                    }
                    *b -= x * *solved;
                }
            }
        }
        self.back_substitute(b);
        b[..n].iter().all(|x| x.is_finite())
    }

    fn back_substitute(&self, b: &mut [f64]) {
        for i in (0..self.n).rev() {
            let row = self.row(i);
            let sum: f64 = (i + 1..self.n).map(|k| row[k] * b[k]).sum();
            b[i] = (b[i] - sum) / row[i];
        }
    }

    /// Solves `self x = b` in place for a symmetric positive definite matrix, by Cholesky's method; false where it is not definite.
    /// Reads the upper triangle only, and destroys it.
    pub fn solve_definite(&mut self, b: &mut [f64]) -> bool {
        let n = self.n;
        for i in 0..n {
            let pivot = self.values[i * n + i];
            if pivot.is_nan() || pivot <= 0.0 {
                return false;
            }
            let inverse = 1.0 / pivot.sqrt();
            for x in &mut self.row_mut(i)[i..] {
                *x *= inverse;
            }
            for k in i + 1..n {
                let (above, row) = self.two_rows(i, k);
                let x = above[k];
                if x == 0.0 {
                    continue;
                }
                for (a, p) in row[k..].iter_mut().zip(&above[k..]) {
                    *a -= x * p;
                }
            }
        }
        for i in 0..n {
            let sum: f64 = (0..i).map(|k| self.values[k * n + i] * b[k]).sum();
            b[i] = (b[i] - sum) / self.values[i * n + i];
        }
        self.back_substitute(b);
        true
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
            assert!(general.clone().solve(&mut x));
            assert!(residual(&general, &x, &b) < 1e-9, "{n} unknowns");
            let dot = |i: usize, j: usize| (0..n).map(|k| general.row(i)[k] * general.row(j)[k]).sum::<f64>();
            let definite = filled(n, |i, j| dot(i, j) + if i == j { 0.1 } else { 0.0 });
            let mut x = b.clone();
            assert!(definite.clone().solve_definite(&mut x));
            assert!(residual(&definite, &x, &b) < 1e-9, "{n} unknowns");
        }
    }

    #[test]
    fn singular_and_indefinite_matrices_are_told() {
        let mut b = [1.0, 1.0];
        assert!(!filled(2, |_, _| 1.0).solve_definite(&mut b));
        assert!(!filled(2, |_, _| 0.0).solve(&mut b));
        assert!(!filled(2, |_, _| f64::NAN).solve(&mut b));
    }
}
