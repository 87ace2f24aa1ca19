//! Rotation conventions of the published tasks (`spec/tasks.md` §1.8).

use crate::units::Radians;

/// Quaternion (w, x, y, z) of the intrinsic x-y-z rotation by `angles`.
#[must_use]
pub fn quaternion_of_euler(angles: [Radians; 3]) -> [f64; 4] {
    let [(sx, cx), (sy, cy), (sz, cz)] = angles.map(|angle| (angle / 2.0).sin_cos());
    [
        cx * cy * cz - sx * sy * sz,
        sx * cy * cz + cx * sy * sz,
        cx * sy * cz - sx * cy * sz,
        cx * cy * sz + sx * sy * cz,
    ]
}

/// Angles (x, y, z) of the intrinsic x-y-z rotation whose matrix, row-major, is `matrix`.
///
/// Near the singularity (|cos y| ≤ 4 ε) the first angle is 0 and the last takes it all.
#[must_use]
pub fn euler_of_matrix(matrix: &[f64]) -> [Radians; 3] {
    let at = |row: usize, column: usize| matrix[3 * row + column];
    let cosine = (at(2, 2) * at(2, 2) + at(1, 2) * at(1, 2)).sqrt();
    let y = -(-at(0, 2)).atan2(cosine);
    if cosine > 4.0 * f64::EPSILON {
        [-at(1, 2).atan2(at(2, 2)), y, -at(0, 1).atan2(at(0, 0))]
    } else {
        [0.0, y, -(-at(1, 0)).atan2(at(1, 1))]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn euler_angles_come_back() {
        // R = Rx Ry Rz, multiplied out by hand.
        let (a, b, c) = (0.4_f64, -0.9_f64, 2.1_f64);
        let ((sa, ca), (sb, cb), (sc, cc)) = (a.sin_cos(), b.sin_cos(), c.sin_cos());
        let matrix = [
            cb * cc,
            -cb * sc,
            sb,
            ca * sc + sa * sb * cc,
            ca * cc - sa * sb * sc,
            -sa * cb,
            sa * sc - ca * sb * cc,
            sa * cc + ca * sb * sc,
            ca * cb,
        ];
        let got = euler_of_matrix(&matrix);
        for (got, want) in got.iter().zip([a, b, c]) {
            assert!((got - want).abs() < 1e-14, "{got} {want}");
        }
    }

    #[test]
    fn quaternions_are_the_hamilton_product_of_three_turns() {
        let product = |a: [f64; 4], b: [f64; 4]| {
            [
                a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
                a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
                a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
                a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
            ]
        };
        let [x, y, z] = [0.4_f64, -0.9, 2.1].map(|angle| (angle / 2.0).sin_cos());
        let turns =
            product(product([x.1, x.0, 0.0, 0.0], [y.1, 0.0, y.0, 0.0]), [z.1, 0.0, 0.0, z.0]);
        for (got, want) in quaternion_of_euler([0.4, -0.9, 2.1]).iter().zip(turns) {
            assert!((got - want).abs() < 1e-15, "{got} {want}");
        }
    }

    #[test]
    fn at_the_singularity_the_first_angle_is_zero() {
        let quarter_turn_about_y = [0.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0];
        let got = euler_of_matrix(&quarter_turn_about_y);
        assert!(got[0].abs() < 1e-15 && (got[1] - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    }
}
