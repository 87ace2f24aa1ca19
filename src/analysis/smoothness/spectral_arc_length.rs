//! Spectral arc length (SPARC): how long the way is along the amplitude spectrum of a speed profile.
//!
//! The speed, continued with zeros to `2^(⌈log₂ n⌉ + 4)` samples, has the spectrum |V(f)|; M is that spectrum divided
//! by its largest value, from 0 to the last frequency, at most 10 Hz, at which M reaches 0.05.
//! `SPARC = −Σ √((Δf / (f_last − f₀))² + ΔM²)`. No unit; negative; nearer to zero is smoother.
//!
//! Inputs: a speed profile and its rate. The authors set the rate to 1, one sample per step; the band then ends at
//! half a cycle per step and the 10 Hz never act. Another rate is an option and changes the number.
//!
//! Degenerate: undefined for fewer than four samples, for a speed that never exceeds 10⁻⁸, and where no frequency but
//! 0 reaches the threshold.
//!
//! Reference: Balasubramanian, Melendez-Calderon, Roby-Brami & Burdet 2015, doi:10.1186/s12984-015-0090-9. They start
//! at the first frequency that reaches the threshold, this (as the suite) always at 0. Oracle:
//! `tests/signals_parity.rs`, algorithms `sparc`, `smoothness_episode`; the bump exp(−5 t²) gives −1.41403.

use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

use super::{FEWEST_SAMPLES, SmoothnessError};
use crate::units::Hertz;

/// What is added to the width of the band, in Hz, so that it can be divided by; the suite's constant.
const WIDTH_GUARD: Hertz = 1e-12;

/// Which part of the spectrum counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectralArcLengthOptions {
    /// Rate of the speed profile, Hz; 1 counts time in steps.
    pub sample_rate: Hertz,
    /// End of the band, Hz.
    pub cutoff: Hertz,
    /// Share of the largest amplitude at which the band ends.
    pub amplitude_threshold: f64,
    /// Number of times the padded length is doubled.
    pub pad_level: u32,
    /// Speeds up to this, in rad per step, are standing still.
    pub least_speed: f64,
}

impl Default for SpectralArcLengthOptions {
    fn default() -> Self {
        Self {
            sample_rate: 1.0,
            cutoff: 10.0,
            amplitude_threshold: 0.05,
            pad_level: 4,
            least_speed: 1e-8,
        }
    }
}

impl SpectralArcLengthOptions {
    fn check(&self) -> Result<(), SmoothnessError> {
        let bounded = |name, value: f64, largest: f64, expected| {
            if value > 0.0 && value <= largest {
                return Ok(());
            }
            Err(SmoothnessError::Option { name, value, expected })
        };
        bounded("sample rate", self.sample_rate, f64::MAX, "a positive number of Hz")?;
        bounded("cut-off", self.cutoff, f64::MAX, "a positive number of Hz")?;
        bounded("amplitude threshold", self.amplitude_threshold, 1.0, "more than 0, at most 1")?;
        bounded("least speed", self.least_speed, f64::MAX, "a positive number")?;
        bounded("pad level", f64::from(self.pad_level) + 1.0, 9.0, "at most 8")
    }
}

/// Computes SPARC of one profile after the other; transforms and buffers are kept between them.
pub struct SpectralArcLength {
    options: SpectralArcLengthOptions,
    planner: RealFftPlanner<f64>,
    padded: Vec<f64>,
    spectrum: Vec<Complex<f64>>,
    scratch: Vec<Complex<f64>>,
    magnitudes: Vec<f64>,
}

impl SpectralArcLength {
    /// Ready for any number of profiles.
    pub fn new(options: SpectralArcLengthOptions) -> Result<Self, SmoothnessError> {
        options.check()?;
        Ok(Self {
            options,
            planner: RealFftPlanner::new(),
            padded: Vec::new(),
            spectrum: Vec::new(),
            scratch: Vec::new(),
            magnitudes: Vec::new(),
        })
    }

    /// SPARC of a profile of finite speeds. Does not allocate after the first profile of a length.
    pub fn of(&mut self, speed: &[f64]) -> Option<f64> {
        let moves = speed.iter().any(|v| v.abs() > self.options.least_speed);
        if speed.len() < FEWEST_SAMPLES || !moves {
            return None;
        }
        let length = speed.len().next_power_of_two() << self.options.pad_level;
        let largest = self.transform(speed, length)?;
        let step = self.options.sample_rate / length as f64;
        let in_band = |bin: &usize| *bin as f64 * step <= self.options.cutoff;
        let threshold = self.options.amplitude_threshold;
        let last = (0..self.magnitudes.len())
            .take_while(in_band)
            .filter(|&bin| self.magnitudes[bin] / largest >= threshold)
            .last()
            .filter(|&bin| bin > 0)?;
        let width = step / (last as f64 * step + WIDTH_GUARD);
        let arc: f64 = self.magnitudes[..=last]
            .windows(2)
            .map(|pair| {
                let rise = pair[1] / largest - pair[0] / largest;
                (width * width + rise * rise).sqrt()
            })
            .sum();
        Some(-arc).filter(|arc| arc.is_finite())
    }

    /// Fills `magnitudes` with the amplitude spectrum and returns its largest value, if that is a positive number.
    fn transform(&mut self, speed: &[f64], length: usize) -> Option<f64> {
        let transform = self.planner.plan_fft_forward(length);
        self.padded.clear();
        self.padded.extend_from_slice(speed);
        self.padded.resize(length, 0.0);
        self.spectrum.resize(length / 2 + 1, Complex::default());
        self.scratch.resize(transform.get_scratch_len(), Complex::default());
        transform
            .process_with_scratch(&mut self.padded, &mut self.spectrum, &mut self.scratch)
            .ok()?;
        self.magnitudes.clear();
        self.magnitudes.extend(self.spectrum.iter().map(|value| value.norm_sqr().sqrt()));
        let largest = self.magnitudes.iter().copied().fold(0.0, f64::max);
        (largest > 0.0 && largest.is_finite()).then_some(largest)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn sparc(speed: &[f64]) -> Option<f64> {
        SpectralArcLength::new(SpectralArcLengthOptions::default()).unwrap().of(speed)
    }

    fn bump(t: f64) -> f64 {
        (-5.0 * t * t).exp()
    }

    #[test]
    fn the_published_bump_has_its_published_value() {
        let speed: Vec<f64> = (-100..100).map(|i| bump(f64::from(i) / 100.0)).collect();
        let options = SpectralArcLengthOptions { sample_rate: 100.0, ..Default::default() };
        let found = SpectralArcLength::new(options).unwrap().of(&speed).unwrap();
        assert!((found + 1.41403).abs() < 5e-6, "{found}");
    }

    #[test]
    fn standing_still_and_three_samples_are_undefined() {
        assert_eq!(sparc(&[]), None);
        assert_eq!(sparc(&[1.0; 3]), None);
        assert_eq!(sparc(&[0.0; 50]), None);
        assert_eq!(sparc(&[1e-9; 50]), None);
        assert!(sparc(&[1e-7; 50]).is_some());
    }

    #[test]
    fn speeds_beyond_what_can_be_squared_are_undefined_and_no_panic() {
        assert_eq!(sparc(&[1e300; 50]), None);
    }

    #[test]
    fn options_that_mean_nothing_are_refused() {
        let default = SpectralArcLengthOptions::default();
        for options in [
            SpectralArcLengthOptions { sample_rate: 0.0, ..default },
            SpectralArcLengthOptions { cutoff: f64::NAN, ..default },
            SpectralArcLengthOptions { amplitude_threshold: 1.5, ..default },
            SpectralArcLengthOptions { pad_level: 40, ..default },
            SpectralArcLengthOptions { least_speed: 0.0, ..default },
        ] {
            let refused = SpectralArcLength::new(options).err();
            assert!(matches!(refused, Some(SmoothnessError::Option { .. })), "{options:?}");
        }
    }

    proptest! {
        #[test]
        fn scale_does_not_matter_and_profiles_before_leave_no_trace(
            speed in prop::collection::vec(0.01..1.0_f64, 4..80),
            before in prop::collection::vec(0.01..1.0_f64, 4..80),
            scale in 0.1..10.0_f64,
        ) {
            let mut meter = SpectralArcLength::new(Default::default()).unwrap();
            meter.of(&before);
            let found = meter.of(&speed);
            prop_assert_eq!(found, sparc(&speed));
            let scaled: Vec<f64> = speed.iter().map(|v| scale * v).collect();
            if let (Some(found), Some(scaled)) = (found, sparc(&scaled)) {
                prop_assert!(found < 0.0);
                prop_assert!((found - scaled).abs() < 1e-6, "{} {}", found, scaled);
            }
        }
    }
}
