//! Principal components of a set of sparse rows: the mean, and the few orthonormal axes that hold most of what is left.
//!
//! ```text
//!     A = rows - mean;   Y <- orthonormal(A A^T Y), a few times;   Z = orthonormal(A^T Y);   axes = Z E,  (A Z)^T A Z = E L E^T
//! ```
//!
//! Block power iteration finds the subspace; its axes, and how much each of them holds, come from one more pass over the rows
//! and a small eigenproblem. Orthonormalisation runs twice (Kahan's "twice is enough"). Nothing of the size rows x rows or
//! columns x columns is ever made, so that thousands of equal rows are no harder than ten.
//! (Not by the Gram matrix of the rows: its eigenvalues are squares, so that axes below 1e-8 of the largest are noise, and an
//! open floor has clusters of a thousand rows and more.)

use crate::sampling::mixed;

/// Columns of the block beyond the axes that are wanted: the last of those converge faster.
const BEYOND: usize = 8;
/// What is left of a column of a block below this share of it is rounding.
const DEPENDENT: f64 = 1e-15;
/// Axes that hold less than this share of the rows' norm are rounding.
const RANK: f64 = 1e-9;
/// Sweeps of Jacobi's method, of which six to ten are needed.
const SWEEPS: usize = 30;

/// Rows by their non-zero numbers: those of row i are `starts[i]..starts[i + 1]`.
#[derive(Clone, Debug, Default)]
pub struct SparseRows {
    /// Rows + 1 numbers, from 0 on.
    pub starts: Vec<usize>,
    /// The column of each number, below `width`.
    pub columns: Vec<u32>,
    /// The numbers.
    pub values: Vec<f64>,
    /// Columns.
    pub width: usize,
}

/// A mean and orthonormal axes through it.
#[derive(Clone, Debug)]
pub struct Subspace {
    /// Of the rows, or what stands for it.
    pub mean: Vec<f64>,
    /// Columns of the block, the axis that holds most first; as many as were asked, or as the rows' rank.
    pub axes: Block,
    /// The sum of squares of the rows' coordinates along each axis.
    pub held: Vec<f64>,
    /// The mean's own coordinates, and its square.
    of_mean: Vec<f64>,
    square: f64,
}

/// A dense matrix of few columns, row by row.
#[derive(Clone, Debug)]
pub struct Block {
    /// Columns.
    pub width: usize,
    /// `[row][column]`
    pub values: Vec<f64>,
}

impl SparseRows {
    /// How many.
    pub fn count(&self) -> usize {
        self.starts.len() - 1
    }

    /// The columns and numbers of a row.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> {
        let own = self.starts[row]..self.starts[row + 1];
        self.columns[own.clone()].iter().zip(&self.values[own]).map(|(&column, &value)| (column as usize, value))
    }

    fn mean(&self) -> Vec<f64> {
        let mut mean = vec![0.0; self.width];
        self.columns.iter().zip(&self.values).for_each(|(&column, value)| mean[column as usize] += value);
        let share = 1.0 / self.count().max(1) as f64;
        mean.iter_mut().for_each(|sum| *sum *= share);
        mean
    }

    /// (rows - mean) X.
    fn times(&self, mean: &[f64], x: &Block) -> Block {
        let width = x.width;
        let of_mean = mean.iter().zip(x.rows()).fold(vec![0.0; width], |mut sum, (&mean, row)| {
            add(&mut sum, mean, row);
            sum
        });
        let mut out = Block::zeros(self.count(), width);
        for (row, sums) in out.values.chunks_exact_mut(width).enumerate() {
            self.row(row).for_each(|(column, value)| add(sums, value, x.row(column)));
            add(sums, -1.0, &of_mean);
        }
        out
    }

    /// (rows - mean)^T Y.
    fn transposed_times(&self, mean: &[f64], y: &Block) -> Block {
        let width = y.width;
        let mut out = Block::zeros(self.width, width);
        let mut all = vec![0.0; width];
        for (row, own) in y.rows().enumerate() {
            add(&mut all, 1.0, own);
            for (column, value) in self.row(row) {
                add(&mut out.values[column * width..(column + 1) * width], value, own);
            }
        }
        for (sums, &mean) in out.values.chunks_exact_mut(width).zip(mean) {
            add(sums, -mean, &all);
        }
        out
    }
}

impl Block {
    fn zeros(rows: usize, width: usize) -> Block {
        Block { width, values: vec![0.0; rows * width] }
    }

    /// One row.
    pub fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.width..(row + 1) * self.width]
    }

    /// All rows in their order.
    pub fn rows(&self) -> std::slice::ChunksExact<'_, f64> {
        self.values.chunks_exact(self.width.max(1))
    }

    /// Makes the columns orthonormal, the first first; those that hang on others become zero.
    fn orthonormalise(&mut self) {
        for column in 0..self.width {
            let whole = self.norm(column);
            for _ in 0..2 {
                let mut along = vec![0.0; column];
                self.rows().for_each(|row| add(&mut along, row[column], &row[..column]));
                for row in self.values.chunks_exact_mut(self.width) {
                    row[column] -= dot(&row[..column], &along);
                }
            }
            let left = self.norm(column);
            let scale = if left > DEPENDENT * whole { 1.0 / left } else { 0.0 };
            self.values.iter_mut().skip(column).step_by(self.width).for_each(|value| *value *= scale);
        }
    }

    fn norm(&self, column: usize) -> f64 {
        self.rows().map(|row| row[column] * row[column]).sum::<f64>().sqrt()
    }

    /// This^T this, row by row.
    fn gram(&self) -> Vec<f64> {
        let mut gram = vec![0.0; self.width * self.width];
        for row in self.rows() {
            gram.chunks_exact_mut(self.width).zip(row).for_each(|(sums, &value)| add(sums, value, row));
        }
        gram
    }
}

impl Subspace {
    /// Of `rows`, with at most `each` axes; `rounds` of power iteration. What it finds depends on nothing else.
    pub fn fit(rows: &SparseRows, each: usize, rounds: usize) -> Subspace {
        Subspace::about(rows, rows.mean(), each, rounds)
    }

    /// The same through a point that is given in the place of the mean.
    pub fn about(rows: &SparseRows, mean: Vec<f64>, each: usize, rounds: usize) -> Subspace {
        let count = rows.count();
        let width = (each + BEYOND).min(count).min(rows.width);
        if each == 0 || width == 0 {
            return Subspace::new(mean, Block::zeros(rows.width, 0), Vec::new());
        }
        let mut y = Block::zeros(count, width);
        for (k, value) in y.values.iter_mut().enumerate() {
            *value = (mixed(k as u64) >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
        }
        for _ in 0..rounds {
            y.orthonormalise();
            y = rows.times(&mean, &rows.transposed_times(&mean, &y));
        }
        y.orthonormalise();
        let mut z = rows.transposed_times(&mean, &y);
        z.orthonormalise();

        // The axes inside the subspace, by what the rows hold along them.
        let (held, turn) = eigen(rows.times(&mean, &z).gram(), width);
        let floor = RANK * RANK * rows.values.iter().map(|value| value * value).sum::<f64>();
        let kept = held.iter().take(each).filter(|&&held| held > floor).count();
        let mut axes = Block::zeros(rows.width, kept);
        if kept > 0 {
            for (axes, row) in axes.values.chunks_exact_mut(kept).zip(z.rows()) {
                row.iter().zip(turn.chunks_exact(width)).for_each(|(&value, turn)| add(axes, value, &turn[..kept]));
            }
        }
        Subspace::new(mean, axes, held[..kept].to_vec())
    }

    fn new(mean: Vec<f64>, axes: Block, held: Vec<f64>) -> Subspace {
        let mut of_mean = vec![0.0; axes.width];
        (0..mean.len()).for_each(|column| add(&mut of_mean, mean[column], axes.row(column)));
        let square = mean.iter().map(|mean| mean * mean).sum();
        Subspace { mean, axes, held, of_mean, square }
    }

    /// Coordinates of row - mean along the axes, and the square of what they leave of it.
    pub fn coordinates(&self, row: impl Iterator<Item = (usize, f64)>) -> (Vec<f64>, f64) {
        let (mut along, mut left) = (self.of_mean.iter().map(|x| -x).collect::<Vec<_>>(), self.square);
        for (column, value) in row {
            add(&mut along, value, self.axes.row(column));
            left += value * (value - 2.0 * self.mean[column]);
        }
        left -= along.iter().map(|x| x * x).sum::<f64>();
        (along, left.max(0.0))
    }
}

#[inline(always)]
fn add(sums: &mut [f64], factor: f64, values: &[f64]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Eigenvalues of a symmetric matrix, the largest first, and its eigenvectors as the columns of a matrix: Jacobi's method.
pub fn eigen(mut a: Vec<f64>, n: usize) -> (Vec<f64>, Vec<f64>) {
    let mut vectors = vec![0.0; n * n];
    (0..n).for_each(|k| vectors[k * n + k] = 1.0);
    let size: f64 = a.iter().map(|x| x * x).sum();
    for _ in 0..SWEEPS {
        let outside: f64 = (0..n * n).filter(|k| k / n != k % n).map(|k| a[k] * a[k]).sum();
        if outside <= 1e-30 * size {
            break;
        }
        for (p, q) in (0..n).flat_map(|p| (p + 1..n).map(move |q| (p, q))) {
            if let Some(rotation) = rotation(a[p * n + p], a[q * n + q], a[p * n + q]) {
                rotate_columns(&mut a, n, p, q, rotation);
                rotate_rows(&mut a, n, p, q, rotation);
                rotate_columns(&mut vectors, n, p, q, rotation);
            }
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| a[j * n + j].total_cmp(&a[i * n + i]));
    let values = order.iter().map(|&k| a[k * n + k]).collect();
    let sorted = (0..n).flat_map(|row| order.iter().map(move |&k| row * n + k)).map(|at| vectors[at]).collect();
    (values, sorted)
}

/// Cosine and sine that make the element (p, q) zero.
fn rotation(pp: f64, qq: f64, pq: f64) -> Option<(f64, f64)> {
    if pq == 0.0 {
        return None;
    }
    let theta = (qq - pp) / (2.0 * pq);
    let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
    Some((cosine, tangent * cosine))
}

fn rotate_columns(a: &mut [f64], n: usize, p: usize, q: usize, (cosine, sine): (f64, f64)) {
    for row in a.chunks_exact_mut(n) {
        (row[p], row[q]) = (cosine * row[p] - sine * row[q], sine * row[p] + cosine * row[q]);
    }
}

fn rotate_rows(a: &mut [f64], n: usize, p: usize, q: usize, (cosine, sine): (f64, f64)) {
    for column in 0..n {
        let (x, y) = (a[p * n + column], a[q * n + column]);
        (a[p * n + column], a[q * n + column]) = (cosine * x - sine * y, sine * x + cosine * y);
    }
}
