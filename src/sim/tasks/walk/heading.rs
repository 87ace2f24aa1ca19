//! The frame that walks with the body: upright, its x axis along the root's x axis seen from above.

use crate::sim::engine::Simulation;

/// Rotation from world axes to heading axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Heading {
    sine: f64,
    cosine: f64,
}

impl Heading {
    /// That of body `root`.
    pub(super) fn of(simulation: &Simulation, root: usize) -> Self {
        Self::of_quaternion(&simulation.body_orientations()[4 * root..][..4])
    }

    /// That of a body with the orientation (w, x, y, z).
    fn of_quaternion(q: &[f64]) -> Self {
        let [w, x, y, z] = [q[0], q[1], q[2], q[3]];
        let angle = (2.0 * (x * y + w * z)).atan2(1.0 - 2.0 * (y * y + z * z));
        let (sine, cosine) = angle.sin_cos();
        Self { sine, cosine }
    }

    /// A world vector along heading axes.
    pub(super) fn localise(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        [self.cosine * x + self.sine * y, self.cosine * y - self.sine * x, z]
    }

    /// Angle from the world's x axis, rad.
    pub(super) fn angle(self) -> f64 {
        self.sine.atan2(self.cosine)
    }

    /// The unit vector ahead, in the world's plane.
    pub(super) fn ahead(self) -> [f64; 2] {
        [self.cosine, self.sine]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(got: &[f64], want: &[f64]) {
        for (got, want) in got.iter().zip(want) {
            assert!((got - want).abs() < 1e-15, "{got} {want}");
        }
    }

    #[test]
    fn a_body_that_faces_left_sees_the_left_ahead() {
        // A quarter turn about the vertical: its x axis points along the world's y.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let heading = Heading::of_quaternion(&[half, 0.0, 0.0, half]);
        close(&heading.ahead(), &[0.0, 1.0]);
        close(&heading.localise([0.0, 3.0, 5.0]), &[3.0, 0.0, 5.0]);
        close(&heading.localise([3.0, 0.0, 5.0]), &[0.0, -3.0, 5.0]);
    }

    #[test]
    fn leaning_forward_does_not_turn_the_heading() {
        // A turn by 0.6 rad about the body's own y axis after a turn by 0.25 rad about the vertical.
        let ((s, c), (sy, cy)) = (0.125_f64.sin_cos(), 0.3_f64.sin_cos());
        let heading = Heading::of_quaternion(&[c * cy, -s * sy, c * sy, s * cy]);
        close(&heading.ahead(), &[0.25_f64.cos(), 0.25_f64.sin()]);
    }
}
