//! Whether correlations are worth factoring: Bartlett's test and the Kaiser–Meyer–Olkin measure.
//!
//! * **Bartlett's test of sphericity**: are the muscles correlated at all? `χ² = −(n − 1 − (2p + 5)/6) ln det R` with
//!   p(p − 1)/2 degrees of freedom, for n time steps of p muscles with correlations R; the p-value is the upper tail.
//!   Samples of a smooth cycle are not independent, so the p-value is far too small; it is given because the paper does.
//! * **Kaiser–Meyer–Olkin (KMO)**: `Σ r² / (Σ r² + Σ q²)` over pairs of muscles, where q are the partial correlations
//!   `−Qᵢⱼ / √(Qᵢᵢ Qⱼⱼ)`, Q the pseudoinverse of R. In [0, 1]; near 1 when few factors explain all correlations.
//!
//! Both take R as its eigenvectors and eigenvalues. Degenerate: with a singular R (an eigenvalue not above rounding, no
//! more samples than muscles) Bartlett's test is undefined; the pseudoinverse leaves such directions out. One muscle
//! has neither.
//!
//! Reference: Bartlett 1951; Kaiser 1974. Oracle: `tests/signals_parity.rs`, algorithm `factor_analysis`.

use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::analysis::subspace::PrincipalComponents;

/// Result of Bartlett's test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bartlett {
    pub chi_squared: f64,
    pub degrees_of_freedom: usize,
    /// Zero where it is too small for a double.
    pub p_value: f64,
}

/// The Kaiser–Meyer–Olkin measure.
#[derive(Debug, Clone, PartialEq)]
pub struct SamplingAdequacy {
    pub overall: f64,
    /// For each muscle alone, in the order of the columns; `None` for one that correlates with none.
    pub per_muscle: Vec<Option<f64>>,
}

/// Bartlett's test of the correlations whose eigenvectors and eigenvalues are `spectrum`.
#[must_use]
pub fn bartlett(spectrum: &PrincipalComponents) -> Option<Bartlett> {
    let muscles = spectrum.muscle_count();
    let largest = *spectrum.variances.first()?;
    let rounding = muscles as f64 * f64::EPSILON * largest;
    if muscles < 2 || spectrum.variances.iter().any(|&eigenvalue| eigenvalue <= rounding) {
        return None;
    }
    let log_determinant: f64 = spectrum.variances.iter().map(|eigenvalue| eigenvalue.ln()).sum();
    let factor = (spectrum.rows as f64 - 1.0) - (2.0 * muscles as f64 + 5.0) / 6.0;
    let chi_squared = -factor * log_determinant;
    let degrees_of_freedom = muscles * (muscles - 1) / 2;
    let distribution = ChiSquared::new(degrees_of_freedom as f64).ok()?;
    // Of uncorrelated muscles ln det R is 0, and rounding may leave it above.
    let p_value = distribution.sf(chi_squared.max(0.0));
    (factor > 0.0).then_some(Bartlett { chi_squared, degrees_of_freedom, p_value })
}

/// The measure for the `correlations` (muscles × muscles) with this `spectrum`.
#[must_use]
pub fn sampling_adequacy(
    correlations: &[f64],
    spectrum: &PrincipalComponents,
) -> Option<SamplingAdequacy> {
    /// Singular values up to this share of the largest count as zero.
    const NEGLIGIBLE: f64 = 1e-15;
    let muscles = spectrum.muscle_count();
    let largest = *spectrum.variances.first()?;
    let inverse = |row: usize, column: usize| -> f64 {
        let directions = spectrum.variances.iter().enumerate();
        directions
            .filter(|(_, eigenvalue)| **eigenvalue > NEGLIGIBLE * largest)
            .map(|(index, eigenvalue)| {
                let component = spectrum.component(index);
                component[row] * component[column] / eigenvalue
            })
            .sum()
    };
    let diagonal: Vec<f64> = (0..muscles).map(|muscle| inverse(muscle, muscle)).collect();
    let sums: Vec<[f64; 2]> = (0..muscles)
        .map(|row| {
            let others = (0..muscles).filter(|&column| column != row);
            others.fold([0.0, 0.0], |[simple, partial], column| {
                let r = correlations[row * muscles + column];
                let q = inverse(row, column);
                // q² / (Qᵢᵢ Qⱼⱼ); the sign of the partial correlation does not matter here.
                [simple + r * r, partial + q * q / (diagonal[row] * diagonal[column])]
            })
        })
        .collect();
    let share = |[simple, partial]: [f64; 2]| {
        let share = simple / (simple + partial);
        share.is_finite().then_some(share)
    };
    let total = sums.iter().fold([0.0, 0.0], |total, own| [total[0] + own[0], total[1] + own[1]]);
    Some(SamplingAdequacy {
        overall: share(total)?,
        per_muscle: sums.into_iter().map(share).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two muscles with correlation `r`: eigenvalues 1 ± r.
    fn pair(r: f64, rows: u64) -> PrincipalComponents {
        let half = 0.5_f64.sqrt();
        PrincipalComponents {
            mean: vec![0.0; 2],
            variances: vec![1.0 + r, 1.0 - r],
            components: vec![half, half, half, -half],
            rows,
        }
    }

    #[test]
    fn bartlett_of_two_muscles_by_hand() {
        let found = bartlett(&pair(0.5, 101)).unwrap();
        let want = -(100.0 - 1.5) * 0.75_f64.ln();
        assert!((found.chi_squared - want).abs() < 1e-12);
        assert_eq!(found.degrees_of_freedom, 1);
        // χ² with one degree of freedom is a squared normal: 28.3 is 5.3 standard deviations.
        assert!((found.p_value - 1.02e-7).abs() < 1e-9, "{}", found.p_value);
    }

    #[test]
    fn singular_correlations_and_too_few_samples_have_no_test() {
        assert_eq!(bartlett(&pair(1.0, 101)), None);
        assert_eq!(bartlett(&pair(0.5, 2)), None);
    }

    #[test]
    fn two_muscles_have_an_adequacy_of_one_half_whatever_they_share() {
        for r in [0.2, -0.9] {
            let found = sampling_adequacy(&[1.0, r, r, 1.0], &pair(r, 100)).unwrap();
            assert!((found.overall - 0.5).abs() < 1e-12);
            assert!(found.per_muscle.iter().all(|own| (own.unwrap() - 0.5).abs() < 1e-12));
        }
        assert_eq!(sampling_adequacy(&[1.0, 0.0, 0.0, 1.0], &pair(0.0, 100)), None);
    }
}
