//! The Butterworth low-pass: the flattest passband a filter of its order can have.
//!
//! The analogue prototype of order N has its poles on the left half of a circle, `ω exp(iπ(2k + N + 1)/(2N))` for
//! k = 0 … N − 1. The bilinear transform takes a pole s to `(2 fs + s)/(2 fs − s)` and all zeros to −1; ω is
//! `2 fs tan(π fc/fs)`, so that the digital filter is 3 dB down at exactly `fc`. Conjugate poles share a section of
//! second order, the real pole of an odd order has one of first order; each section passes a constant unchanged.
//!
//! Units: rates and cut-offs in Hz; the signal keeps its own.
//!
//! Degenerate: from half the sample rate on (less one part in 10⁹) there is nothing to cut: the filter is the identity
//! and says so. Rates and cut-offs that are not positive numbers, and orders outside 1 … 16, are errors.
//!
//! Reference: Butterworth 1930; Oppenheim & Schafer, *Discrete-Time Signal Processing*, chapter 7. Oracle:
//! `tests/signals_parity.rs`, algorithm `lowpass_zero_phase` (SciPy).

use std::f64::consts::PI;

use super::SignalError;
use super::zero_phase::Section;
use crate::units::Hertz;

/// Beyond this the poles crowd so closely round 1 that the coefficients lose their digits.
const HIGHEST_ORDER: usize = 16;

/// Where a low-pass cuts, and how steeply. The default is that of contacts and root velocity in the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowPassOptions {
    /// Frequency at which one pass is 3 dB down, Hz.
    pub cutoff: Hertz,
    /// Order of one pass; forward and backward together have twice as much.
    pub order: usize,
}

impl Default for LowPassOptions {
    fn default() -> Self {
        Self { cutoff: 5.0, order: 5 }
    }
}

/// A designed filter; [`LowPass::zero_phase`] applies it.
#[derive(Debug, Clone, PartialEq)]
pub struct LowPass {
    pub(super) sections: Vec<Section>,
    pub(super) order: usize,
}

impl LowPass {
    /// The filter for signals of `sample_rate`.
    pub fn design(options: &LowPassOptions, sample_rate: Hertz) -> Result<Self, SignalError> {
        let LowPassOptions { cutoff, order } = *options;
        if !(sample_rate.is_finite() && sample_rate > 0.0) {
            return Err(SignalError::SampleRate { rate: sample_rate });
        }
        if !(cutoff.is_finite() && cutoff > 0.0) {
            return Err(SignalError::Cutoff { cutoff });
        }
        if !(1..=HIGHEST_ORDER).contains(&order) {
            return Err(SignalError::Order { order, most: HIGHEST_ORDER });
        }
        if cutoff >= 0.5 * sample_rate * (1.0 - 1e-9) {
            return Ok(Self { sections: Vec::new(), order });
        }
        // All frequencies in units of 2 fs.
        let radius = (PI * cutoff / sample_rate).tan();
        let pairs = (0..order / 2).map(|k| {
            let angle = PI * (2 * k + order + 1) as f64 / (2 * order) as f64;
            Section::of_pole_pair(digital(radius * angle.cos(), radius * angle.sin()))
        });
        let (real_pole, _) = digital(-radius, 0.0);
        let single = (order % 2 == 1).then(|| Section::of_real_pole(real_pole));
        Ok(Self { sections: pairs.chain(single).collect(), order })
    }

    /// Whether the cut-off lies so high that signals pass unchanged.
    #[must_use]
    pub fn is_identity(&self) -> bool {
        self.sections.is_empty()
    }
}

/// The digital pole (1 + s)/(1 − s) of the analogue pole s, as real and imaginary part.
fn digital(real: f64, imaginary: f64) -> (f64, f64) {
    let norm = (1.0 - real) * (1.0 - real) + imaginary * imaginary;
    let numerator = (1.0 + real) * (1.0 - real) - imaginary * imaginary;
    (numerator / norm, 2.0 * imaginary / norm)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_filters_are_typed_errors() {
        let design = |cutoff, order, rate| {
            LowPass::design(&LowPassOptions { cutoff, order }, rate).unwrap_err()
        };
        assert_eq!(design(0.0, 5, 30.0), SignalError::Cutoff { cutoff: 0.0 });
        assert_eq!(design(5.0, 5, -1.0), SignalError::SampleRate { rate: -1.0 });
        assert_eq!(design(5.0, 0, 30.0), SignalError::Order { order: 0, most: 16 });
        assert_eq!(design(5.0, 17, 30.0), SignalError::Order { order: 17, most: 16 });
        assert!(matches!(design(f64::NAN, 5, 30.0), SignalError::Cutoff { .. }));
        assert!(matches!(design(5.0, 5, f64::INFINITY), SignalError::SampleRate { .. }));
    }

    #[test]
    fn half_the_sample_rate_and_more_is_the_identity() {
        for (cutoff, identity) in [(14.9, false), (15.0, true), (400.0, true)] {
            let filter = LowPass::design(&LowPassOptions { cutoff, order: 5 }, 30.0).unwrap();
            assert_eq!(filter.is_identity(), identity, "{cutoff}");
        }
    }
}
