//! Colours of a scene. Activation runs from blue (0) over violet to red (1), in the scene as in the heat map.

/// Colours of activation at equal distances.
const ACTIVATION: [[f32; 3]; 5] = [
    [38.0, 70.0, 150.0],
    [88.0, 82.0, 168.0],
    [160.0, 70.0, 140.0],
    [222.0, 62.0, 78.0],
    [255.0, 96.0, 32.0],
];

/// A target that is not reached, and one that is: no bone, tendon or ball has these colours.
pub(super) const OPEN: [u8; 3] = [235, 80, 200];
pub(super) const SOLVED: [u8; 3] = [60, 200, 90];
/// Where shapes touch.
pub(super) const CONTACT: [u8; 3] = [255, 235, 120];
/// What something is called.
pub(super) const NAME: [u8; 3] = [200, 200, 200];
/// Now.
pub(super) const CURSOR: [u8; 3] = [255, 255, 255];

/// The colour of `activation`, 0..1; undefined numbers are black.
pub(super) fn activation(activation: f32) -> [u8; 3] {
    if activation.is_nan() {
        return [0; 3];
    }
    let place = activation.clamp(0.0, 1.0) * (ACTIVATION.len() - 1) as f32;
    let left = (place as usize).min(ACTIVATION.len() - 2);
    let share = place - left as f32;
    let (low, high) = (ACTIVATION[left], ACTIVATION[left + 1]);
    std::array::from_fn(|channel| {
        (low[channel] + share * (high[channel] - low[channel])).round() as u8
    })
}

/// Colours of lines that have to be told apart, also by the colour-blind (Okabe and Ito, lightened for a dark ground).
const LINES: [[u8; 3]; 8] = [
    [86, 180, 233],
    [230, 159, 0],
    [0, 190, 140],
    [240, 228, 66],
    [213, 110, 50],
    [204, 121, 167],
    [120, 150, 255],
    [200, 200, 200],
];

/// The colour of line `index`.
pub(super) fn line(index: usize) -> [u8; 3] {
    LINES[index % LINES.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn activation_runs_from_blue_to_red_and_stays_inside() {
        assert_eq!(activation(0.0), [38, 70, 150]);
        assert_eq!(activation(0.5), [160, 70, 140]);
        assert_eq!(activation(1.0), [255, 96, 32]);
        assert_eq!(activation(7.0), activation(1.0));
        assert_eq!(activation(-1.0), activation(0.0));
        assert_eq!(activation(f32::NAN), [0; 3]);
    }
}
