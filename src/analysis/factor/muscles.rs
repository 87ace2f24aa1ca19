//! The fourteen muscles of the factor analysis and the simulated compartments that make them up.
//!
//! The activations of the compartments of a muscle are summed, not averaged. Oracle: `tests/signals_parity.rs`,
//! algorithm `muscle_aggregation`.

use super::FactorError;
use crate::analysis::emg::Side;
use crate::analysis::signal::Rows;

/// Label and simulated compartments of each muscle, without the suffix of the side, in the order of the figure.
pub const FACTOR_MUSCLES: [(&str, &[&str]); 14] = [
    ("TA", &["tibant"]),
    ("LG", &["gaslat"]),
    ("PERL", &["perlong"]),
    ("VL", &["vaslat"]),
    ("RF", &["recfem"]),
    ("SART", &["sart"]),
    ("BF", &["bflh"]),
    ("ST", &["semiten"]),
    ("TFL", &["tfl"]),
    ("ADD", &["addlong"]),
    ("GM", &["glmax1", "glmax2", "glmax3"]),
    ("Sol", &["soleus"]),
    ("MG", &["gasmed"]),
    ("Gmed", &["glmed1", "glmed2", "glmed3"]),
];

/// Names of all compartments of one leg, muscle by muscle.
#[must_use]
pub fn compartments(side: Side) -> Vec<String> {
    let stems = FACTOR_MUSCLES.iter().flat_map(|(_, stems)| stems.iter());
    stems.map(|stem| format!("{stem}{}", side.suffix())).collect()
}

/// Sums columns in the order of [`compartments`] to the fourteen muscles; row by row.
pub fn sum_compartments(activations: &Rows<'_>) -> Result<Vec<f64>, FactorError> {
    let (expected, found) = (compartments(Side::Left).len(), activations.columns());
    if expected != found {
        return Err(FactorError::CompartmentCount { expected, found });
    }
    let mut sums = Vec::with_capacity(activations.len() * FACTOR_MUSCLES.len());
    for row in activations {
        let mut rest = row;
        for (_, stems) in FACTOR_MUSCLES {
            let (own, others) = rest.split_at(stems.len());
            sums.push(own.iter().sum());
            rest = others;
        }
    }
    Ok(sums)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eighteen_compartments_make_fourteen_muscles() {
        let row: Vec<f64> = (1..=18).map(f64::from).collect();
        let sums = sum_compartments(&Rows::new(&row, 18).unwrap()).unwrap();
        assert_eq!(sums, [1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 36., 14., 15., 51.]);
        assert_eq!(compartments(Side::Right)[10..13], ["glmax1_r", "glmax2_r", "glmax3_r"]);
    }

    #[test]
    fn another_number_of_columns_is_refused() {
        let error = FactorError::CompartmentCount { expected: 18, found: 17 };
        assert_eq!(sum_compartments(&Rows::new(&[0.0; 34], 17).unwrap()), Err(error));
    }
}
