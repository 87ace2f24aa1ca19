//! Turning two columns of loadings into each other, as the rotations of factors do pair by pair.
//!
//! With x, y the two columns, `u = x² − y²` and `v = 2xy`, everything an angle is made of are four sums over the p
//! muscles.

/// The sums of one pair of columns.
pub(super) struct PairSums {
    /// p Σ 2uv.
    pub(super) mixed: f64,
    /// Σu Σv.
    pub(super) product: f64,
    /// p Σ (u² − v²) − (Σu)² + (Σv)².
    pub(super) denominator: f64,
    /// p Σ (u² + v²): how large all of these could be.
    pub(super) scale: f64,
}

impl PairSums {
    pub(super) fn of(x: &[f64], y: &[f64]) -> Self {
        let (mut sum_u, mut sum_v, mut mixed, mut squares, mut scale) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (x, y) in x.iter().zip(y) {
            let (u, v) = (x * x - y * y, 2.0 * x * y);
            sum_u += u;
            sum_v += v;
            mixed += 2.0 * u * v;
            squares += u * u - v * v;
            scale += u * u + v * v;
        }
        let muscles = x.len() as f64;
        Self {
            mixed: muscles * mixed,
            product: sum_u * sum_v,
            denominator: muscles * squares - (sum_u * sum_u - sum_v * sum_v),
            scale: muscles * scale,
        }
    }
}

/// Turns columns i < j by `angle`: x ← x cos θ + y sin θ, y ← y cos θ − x sin θ.
pub(super) fn turn(columns: &mut [Vec<f64>], i: usize, j: usize, angle: f64) {
    let (sine, cosine) = angle.sin_cos();
    let (left, right) = columns.split_at_mut(j);
    for (x, y) in left[i].iter_mut().zip(&mut right[0]) {
        (*x, *y) = (*x * cosine + *y * sine, *y * cosine - *x * sine);
    }
}
