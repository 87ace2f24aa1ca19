//! A low-pass without delay: once forward, once backward.
//!
//! The two passes delay by opposite amounts, so nothing moves in time, and their attenuations multiply: 6 dB at the
//! cut-off. The signal is first continued at both ends by 3 (N + 1) samples of its point reflection, `2 x₀ − xᵢ`, where
//! N is the order, and every pass starts as if its first sample had been there for ever; both keep the ends from
//! ringing.
//!
//! In the unit of the signal. Degenerate: a signal too short to be continued so far is continued by one sample less
//! than it has; one sample, or none, stays what it is.
//!
//! Reference: Gustafsson 1996 on starting filters; Oppenheim & Schafer for zero phase. Oracle:
//! `tests/signals_parity.rs`, algorithm `lowpass_zero_phase` (SciPy).

use super::LowPass;

/// A filter of second or first order: `y = b₀x + b₁x₋₁ + b₂x₋₂ − a₁y₋₁ − a₂y₋₂`, with unit gain for a constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

impl Section {
    /// With the pole `real ± i imaginary`, and both zeros at −1.
    pub(super) fn of_pole_pair((real, imaginary): (f64, f64)) -> Self {
        let a = [-2.0 * real, real * real + imaginary * imaginary];
        let gain = (1.0 + a[0] + a[1]) / 4.0;
        Self { b: [gain, 2.0 * gain, gain], a }
    }

    /// With one real pole, and its zero at −1.
    pub(super) fn of_real_pole(pole: f64) -> Self {
        let gain = (1.0 - pole) / 2.0;
        Self { b: [gain, gain, 0.0], a: [-pole, 0.0] }
    }

    /// Filters in place, starting in the steady state of the first sample.
    fn run<'a>(&self, samples: impl Iterator<Item = &'a mut f64>) {
        let Self { b, a } = *self;
        let mut state: Option<[f64; 2]> = None;
        for sample in samples {
            let input = *sample;
            let [near, far] = state.unwrap_or([(1.0 - b[0]) * input, (b[2] - a[1]) * input]);
            let output = b[0] * input + near;
            state = Some([b[1] * input - a[0] * output + far, b[2] * input - a[1] * output]);
            *sample = output;
        }
    }
}

impl LowPass {
    /// Filters `signal` forward and backward.
    #[must_use]
    pub fn zero_phase(&self, signal: &[f64]) -> Vec<f64> {
        let (Some(&first), Some(&last)) = (signal.first(), signal.last()) else {
            return Vec::new();
        };
        if self.is_identity() {
            return signal.to_vec();
        }
        let reach = (3 * (self.order + 1)).min(signal.len() - 1);
        let before = signal[1..=reach].iter().rev().map(|x| 2.0 * first - x);
        let after = signal[signal.len() - 1 - reach..signal.len() - 1].iter().rev();
        let mut extended: Vec<f64> =
            before.chain(signal.iter().copied()).chain(after.map(|x| 2.0 * last - x)).collect();
        self.sections.iter().for_each(|section| section.run(extended.iter_mut()));
        self.sections.iter().for_each(|section| section.run(extended.iter_mut().rev()));
        extended.drain(..reach);
        extended.truncate(signal.len());
        extended
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use proptest::prelude::*;

    use super::super::LowPassOptions;
    use super::*;

    fn filter(cutoff: f64, order: usize) -> LowPass {
        LowPass::design(&LowPassOptions { cutoff, order }, 100.0).unwrap()
    }

    /// Amplitude of the middle of a filtered sine of `frequency` Hz, sampled at 100 Hz, relative to the sine.
    fn gain(filter: &LowPass, frequency: f64) -> f64 {
        let sine: Vec<f64> =
            (0..4000).map(|i| (TAU * frequency * f64::from(i) / 100.0).sin()).collect();
        let filtered = filter.zero_phase(&sine);
        let project = |x: &[f64]| -> f64 { x.iter().zip(&sine).map(|(x, s)| x * s).sum() };
        project(&filtered[1000..3000]) / project(&sine[..2000])
    }

    #[test]
    fn two_passes_halve_the_amplitude_at_the_cut_off_and_do_not_shift_it() {
        for order in 1..=8 {
            let filter = filter(5.0, order);
            assert!(
                (gain(&filter, 5.0) - 0.5).abs() < 1e-6,
                "order {order}: {}",
                gain(&filter, 5.0)
            );
        }
        // |H|² of one pass is 1/(1 + r^2N), r the ratio of the warped frequencies.
        let ratio = (TAU / 2.0 * 0.1).tan() / (TAU / 2.0 * 0.05).tan();
        let want = 1.0 / (1.0 + ratio.powi(10));
        assert!((gain(&filter(5.0, 5), 10.0) - want).abs() < 1e-6);
    }

    #[test]
    fn one_sample_and_none_stay_what_they_are() {
        assert_eq!(filter(5.0, 5).zero_phase(&[]), [0.0; 0]);
        let one = filter(5.0, 5).zero_phase(&[3.5]);
        assert!(one.len() == 1 && (one[0] - 3.5).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn a_constant_passes_and_the_filter_is_linear(
            signal in prop::collection::vec(prop::array::uniform2(-10.0..10.0_f64), 0..80),
            cutoff in 2.0..60.0_f64,
            order in 1..7_usize,
        ) {
            let filter = filter(cutoff, order);
            let flat = filter.zero_phase(&vec![7.25; signal.len()]);
            prop_assert!(flat.iter().all(|x| (x - 7.25).abs() < 1e-6));
            let filtered = |of: fn(&[f64; 2]) -> f64| {
                filter.zero_phase(&signal.iter().map(of).collect::<Vec<_>>())
            };
            let (first, second) = (filtered(|x| x[0]), filtered(|x| x[1]));
            let combined = filtered(|x| 2.0 * x[0] - x[1]);
            prop_assert_eq!(combined.len(), signal.len());
            for ((first, second), combined) in first.iter().zip(&second).zip(&combined) {
                prop_assert!((2.0 * first - second - combined).abs() < 1e-6);
            }
        }
    }
}
