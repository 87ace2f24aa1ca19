//! Where parameters start: the draws of PyTorch and Stable-Baselines3, from our own stream (`spec/policy.md` §1.13).

use crate::random::Random;

/// Fills a matrix (outputs × inputs) with rows, or columns if there are fewer, that are orthogonal and of length `gain`:
/// the factor Q of a matrix of normal numbers, with signs that make it unique.
pub fn orthogonal(matrix: &mut [f32], inputs: usize, gain: f64, random: &mut Random) {
    let outputs = matrix.len() / inputs;
    let (length, count) = (inputs.max(outputs), inputs.min(outputs));
    let mut vectors: Vec<Vec<f64>> = Vec::with_capacity(count);
    while vectors.len() < count {
        let mut vector: Vec<f64> = (0..length).map(|_| random.normal()).collect();
        // Twice is enough (Kahan): the second time removes what rounding left.
        for _ in 0..2 {
            for other in &vectors {
                let along: f64 = other.iter().zip(&vector).map(|(a, b)| a * b).sum();
                vector.iter_mut().zip(other).for_each(|(x, o)| *x -= along * o);
            }
        }
        let norm = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
        vector.iter_mut().for_each(|x| *x /= norm);
        vectors.push(vector);
    }
    for (index, x) in matrix.iter_mut().enumerate() {
        let (output, input) = (index / inputs, index % inputs);
        let q = if outputs <= inputs { vectors[output][input] } else { vectors[input][output] };
        *x = (gain * q) as f32;
    }
}

/// Xavier's uniform distribution: `±√(6/(rows + columns))`.
pub fn xavier(matrix: &mut [f32], columns: usize, random: &mut Random) {
    let rows = matrix.len() / columns;
    uniform(matrix, (6.0 / (rows + columns) as f64).sqrt(), random);
}

/// PyTorch's default for a dense layer's weight and bias: `±1/√inputs`.
pub fn dense(numbers: &mut [f32], inputs: usize, random: &mut Random) {
    uniform(numbers, 1.0 / (inputs as f64).sqrt(), random);
}

/// Uniform on [−`bound`, `bound`).
pub fn uniform(numbers: &mut [f32], bound: f64, random: &mut Random) {
    for x in numbers {
        *x = random.uniform(-bound, bound) as f32;
    }
}

/// Normal with this standard deviation.
pub fn normal(numbers: &mut [f32], deviation: f64, random: &mut Random) {
    for x in numbers {
        *x = (deviation * random.normal()) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orthogonal_rows_and_columns_have_the_length_of_the_gain() {
        for (outputs, inputs) in [(5, 12), (12, 5), (4, 4)] {
            let mut matrix = vec![0.0; outputs * inputs];
            orthogonal(&mut matrix, inputs, 2.0, &mut Random::new([1; 32]));
            let element = |vector: usize, k: usize| {
                let (row, column) = if outputs <= inputs { (vector, k) } else { (k, vector) };
                f64::from(matrix[row * inputs + column])
            };
            let (count, length) = (outputs.min(inputs), outputs.max(inputs));
            for (i, j) in (0..count).flat_map(|i| (0..count).map(move |j| (i, j))) {
                let product: f64 = (0..length).map(|k| element(i, k) * element(j, k)).sum();
                let expected = if i == j { 4.0 } else { 0.0 };
                assert!((product - expected).abs() < 1e-6, "{outputs}×{inputs}: {product}");
            }
        }
    }

    #[test]
    fn bounds_are_kept_and_nearly_reached() {
        let largest = |numbers: &[f32]| numbers.iter().fold(0.0_f32, |a, b| a.max(b.abs()));
        let mut numbers = vec![0.0; 6000];
        xavier(&mut numbers, 60, &mut Random::new([2; 32]));
        let bound = (6.0_f32 / 160.0).sqrt();
        assert!(largest(&numbers) <= bound && largest(&numbers) > 0.99 * bound);
        dense(&mut numbers, 25, &mut Random::new([3; 32]));
        assert!(largest(&numbers) <= 0.2 && largest(&numbers) > 0.198);
    }
}
