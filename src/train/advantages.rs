//! Generalised advantages (Schulman et al. 2016; `spec/training.md` §5.5).
//!
//! Backward in time from `A_T = 0`, with `n_t` 0 if an episode ended in step t and else 1, and `V_T` the value of the
//! newest observation:
//!
//! `δ_t = r_t + γ n_t V_{t+1} − V_t`, `A_t = δ_t + γ λ n_t A_{t+1}`, and the λ-return `R_t = A_t + V_t`.
//!
//! An episode that the time limit ended has the value of its last observation added to its last reward already (§5.3).

/// How far rewards reach back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Discount {
    /// γ: what a reward is worth one step earlier.
    pub reward: f64,
    /// λ: how much of an advantage comes from rewards rather than from the values learned.
    pub advantage: f64,
}

/// What one environment gave in one rollout, one entry per step.
#[derive(Debug, Clone, Copy)]
pub struct Course<'a> {
    pub rewards: &'a [f32],
    pub values: &'a [f32],
    /// Whether an episode ended in the step.
    pub ended: &'a [bool],
    /// Value of the observation after the last step.
    pub next_value: f32,
}

/// Writes the advantage of every step of `course`.
pub fn advantages(course: Course<'_>, discount: Discount, advantages: &mut [f32]) {
    let mut next_value = f64::from(course.next_value);
    let mut next_advantage = 0.0;
    for step in (0..advantages.len()).rev() {
        let value = f64::from(course.values[step]);
        let goes_on = if course.ended[step] { 0.0 } else { 1.0 };
        let error =
            f64::from(course.rewards[step]) + discount.reward * goes_on * next_value - value;
        next_advantage = error + discount.reward * discount.advantage * goes_on * next_advantage;
        advantages[step] = next_advantage as f32;
        next_value = value;
    }
}

/// Share of the variance of `targets` that `values` explain: `1 − var(targets − values)/var(targets)`. Not defined for
/// targets that are all alike.
#[must_use]
pub fn explained_variance(values: &[f32], targets: &[f32]) -> Option<f64> {
    let variance = |numbers: &dyn Fn(usize) -> f64| {
        let count = targets.len() as f64;
        let mean = (0..targets.len()).map(numbers).sum::<f64>() / count;
        (0..targets.len()).map(|i| (numbers(i) - mean).powi(2)).sum::<f64>() / count
    };
    let whole = variance(&|i| f64::from(targets[i]));
    let rest = variance(&|i| f64::from(targets[i]) - f64::from(values[i]));
    (whole > 0.0).then(|| 1.0 - rest / whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HALVES: Discount = Discount { reward: 0.5, advantage: 0.5 };

    #[test]
    fn three_steps_by_hand() {
        // γ = λ = ½. Step 2: δ = 4 + ½·8 − 2 = 6. Step 1 ends an episode: δ = 1 − 3 = −2. Step 0: δ = 2 + ½·3 − 1 = 2.5,
        // A = 2.5 + ¼·(−2) = 2.
        let course = Course {
            rewards: &[2.0, 1.0, 4.0],
            values: &[1.0, 3.0, 2.0],
            ended: &[false, true, false],
            next_value: 8.0,
        };
        let mut got = [0.0; 3];
        advantages(course, HALVES, &mut got);
        assert_eq!(got.map(f32::to_bits), [2.0_f32, -2.0, 6.0].map(f32::to_bits));
    }

    #[test]
    fn with_lambda_one_the_lambda_return_is_the_discounted_sum_of_rewards() {
        let rewards = [1.0, -2.0, 0.5, 3.0];
        let course = Course {
            rewards: &rewards,
            values: &[7.0, -1.0, 2.0, 0.3],
            ended: &[false; 4],
            next_value: 10.0,
        };
        let discount = Discount { reward: 0.9, advantage: 1.0 };
        let mut got = [0.0; 4];
        advantages(course, discount, &mut got);
        let sum: f64 =
            rewards.iter().enumerate().map(|(t, &r)| 0.9_f64.powi(t as i32) * f64::from(r)).sum();
        let expected = sum + 0.9_f64.powi(4) * 10.0;
        assert!((f64::from(got[0] + 7.0) - expected).abs() < 1e-5);
    }

    #[test]
    fn nothing_after_the_last_step_of_an_episode_counts_even_at_the_end() {
        let course = Course { rewards: &[1.0], values: &[0.25], ended: &[true], next_value: 1e6 };
        let mut got = [0.0];
        advantages(course, HALVES, &mut got);
        assert_eq!(got[0].to_bits(), 0.75_f32.to_bits());
    }

    #[test]
    fn explained_variance_of_perfect_constant_and_opposite_values() {
        let targets = [1.0, 2.0, 3.0];
        assert_eq!(explained_variance(&targets, &targets), Some(1.0));
        assert_eq!(explained_variance(&[5.0; 3], &targets), Some(0.0));
        assert_eq!(explained_variance(&[-1.0, -2.0, -3.0], &targets), Some(-3.0));
        assert_eq!(explained_variance(&[1.0; 2], &[2.0; 2]), None);
    }
}
