//! Corrections for testing several hypotheses at once.
//!
//! *Holm*: with the p values rising, `p₍ᵢ₎ ← max over j ≤ i of min(1, (k − j + 1) p₍ⱼ₎)`, in the original order.
//! *Bonferroni*: `min(1, k p)`. k is the number of p values given: pass all tests of a family together.
//!
//! Degenerate: none give none. An undefined (NaN) p value stays NaN and does not count as a test.
//! Reference: Holm 1979. Oracle: `tests/analysis_parity.rs`, algorithms `holm`, `bonferroni`, `t_sf_then_holm`.

/// How p values of a family of tests are corrected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Correction {
    None,
    Holm,
    Bonferroni,
}

impl Correction {
    /// Corrects the p values of one family of tests.
    #[must_use]
    pub fn apply(self, p: &[f64]) -> Vec<f64> {
        match self {
            Self::None => p.to_vec(),
            Self::Holm => holm(p),
            Self::Bonferroni => bonferroni(p),
        }
    }
}

/// Holm's step-down correction.
#[must_use]
pub fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).filter(|&index| !p[index].is_nan()).collect();
    order.sort_by(|&a, &b| p[a].total_cmp(&p[b]));
    let mut adjusted = vec![f64::NAN; p.len()];
    let mut highest = 0.0_f64;
    for (place, &index) in order.iter().enumerate() {
        highest = highest.max((p[index] * (order.len() - place) as f64).min(1.0));
        adjusted[index] = highest;
    }
    adjusted
}

/// Bonferroni's correction.
#[must_use]
pub fn bonferroni(p: &[f64]) -> Vec<f64> {
    let tests = p.iter().filter(|p| !p.is_nan()).count() as f64;
    p.iter().map(|p| if p.is_nan() { f64::NAN } else { (p * tests).min(1.0) }).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn an_undefined_test_is_no_test() {
        let holm = holm(&[0.03, f64::NAN, 0.01]);
        assert!((holm[0] - 0.03).abs() < 1e-15 && (holm[2] - 0.02).abs() < 1e-15);
        assert!(holm[1].is_nan());
        assert!((bonferroni(&[0.03, f64::NAN])[0] - 0.03).abs() < 1e-15);
        assert!(Correction::Holm.apply(&[]).is_empty());
    }

    proptest! {
        #[test]
        fn holm_never_lowers_a_p_value_and_never_exceeds_bonferroni(
            p in prop::collection::vec(0.0..=1.0_f64, 0..12),
        ) {
            let (holm, bonferroni) = (holm(&p), bonferroni(&p));
            for ((raw, holm), bonferroni) in p.iter().zip(&holm).zip(&bonferroni) {
                prop_assert!(raw <= holm && holm <= bonferroni && *bonferroni <= 1.0);
            }
        }

        #[test]
        fn holm_keeps_the_order_of_p_values(p in prop::collection::vec(0.0..=1.0_f64, 2..12)) {
            let holm = holm(&p);
            for i in 0..p.len() {
                for j in 0..p.len() {
                    prop_assert!(p[i] > p[j] || holm[i] <= holm[j]);
                }
            }
        }
    }
}
