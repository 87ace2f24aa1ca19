//! Speed profiles: how far the joints move in each step.
//!
//! `vₜ = ‖qₜ₊₁ − qₜ‖₂` over all joints together, in rad per step; one value fewer than there are samples. The joints
//! count alike, whatever their range. Oracle: `tests/signals_parity.rs`, algorithm `smoothness_episode`.

use crate::analysis::signal::Rows;

/// Fills `speed` with the speed of all joints together. Does not allocate once `speed` is long enough.
pub fn joint_space_speed(positions: &Rows<'_>, speed: &mut Vec<f64>) {
    let columns = positions.columns();
    speed.clear();
    speed.extend(positions.iter().zip(positions.iter().skip(1)).map(|(earlier, later)| {
        let mut sum = 0.0;
        for joint in 0..columns {
            let difference = later[joint] - earlier[joint];
            sum += difference * difference;
        }
        sum.sqrt()
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_of_three_and_four_has_speed_five() {
        let mut speed = vec![9.0; 7];
        joint_space_speed(&Rows::new(&[0.0, 0.0, 3.0, 4.0, 3.0, 4.0], 2).unwrap(), &mut speed);
        assert_eq!(speed, [5.0, 0.0]);
        joint_space_speed(&Rows::new(&[0.0, 0.0], 2).unwrap(), &mut speed);
        assert!(speed.is_empty());
    }
}
