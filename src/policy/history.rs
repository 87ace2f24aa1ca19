//! The last few observations of every body, as the transformer sees them (`spec/policy.md` §1.2).
//!
//! For each sensor a window of `lags` raw values, oldest first. Before the first observation of an episode there are
//! zeros, raw ones: they are normalised like any other value.

/// History windows of several bodies that play the same task.
#[derive(Debug, Clone)]
pub struct History {
    lags: usize,
    window_length: usize,
    /// Slots × sensors × lags.
    windows: Vec<f32>,
}

impl History {
    /// No windows yet, for so many bodies with so many sensors.
    #[must_use]
    pub fn new(slots: usize, sensors: usize, lags: usize) -> Self {
        let window_length = sensors * lags;
        Self { lags, window_length, windows: vec![0.0; slots * window_length] }
    }

    /// Forgets what the body in `slot` has seen.
    pub fn clear(&mut self, slot: usize) {
        self.window_mut(slot).fill(0.0);
    }

    /// Takes in the newest observation of `slot` and returns its windows, sensors × lags.
    pub fn push(&mut self, slot: usize, observation: &[f32]) -> &[f32] {
        let lags = self.lags;
        let windows = self.window_mut(slot);
        for (window, &newest) in windows.chunks_exact_mut(lags).zip(observation) {
            window.copy_within(1.., 0);
            window[lags - 1] = newest;
        }
        windows
    }

    /// The windows of `slot`, sensors × lags.
    #[must_use]
    pub fn windows(&self, slot: usize) -> &[f32] {
        &self.windows[slot * self.window_length..(slot + 1) * self.window_length]
    }

    fn window_mut(&mut self, slot: usize) -> &mut [f32] {
        &mut self.windows[slot * self.window_length..(slot + 1) * self.window_length]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_run_from_oldest_to_newest_and_start_with_zeros() {
        let mut history = History::new(2, 2, 3);
        history.push(1, &[9.0, 9.0]);
        assert_eq!(history.push(0, &[1.0, 10.0]), [0.0, 0.0, 1.0, 0.0, 0.0, 10.0]);
        history.push(0, &[2.0, 20.0]);
        history.push(0, &[3.0, 30.0]);
        assert_eq!(history.push(0, &[4.0, 40.0]), [2.0, 3.0, 4.0, 20.0, 30.0, 40.0]);
        history.clear(0);
        assert_eq!(history.push(0, &[5.0, 50.0]), [0.0, 0.0, 5.0, 0.0, 0.0, 50.0]);
        assert_eq!(history.push(1, &[8.0, 8.0]), [0.0, 9.0, 8.0, 0.0, 9.0, 8.0]);
    }
}
