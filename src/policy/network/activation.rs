//! The activation functions that a checkpoint may name, and their slopes.

use statrs::function::erf::erf;

use crate::policy::checkpoint::contents::Activation;

/// `1/√(2π)`.
const NORMAL_DENSITY: f64 = 0.398_942_280_401_432_7;

impl Activation {
    /// The function of that name.
    #[must_use]
    pub fn function(self) -> fn(f32) -> f32 {
        match self {
            // A NaN stays a NaN.
            Self::Relu => |x| if x <= 0.0 { 0.0 } else { x },
            Self::Tanh => f32::tanh,
            Self::Elu => |x| if x > 0.0 { x } else { x.exp_m1() },
            Self::Silu => |x| x / (1.0 + (-x).exp()),
            // x Φ(x) with the normal distribution function, torch's default form.
            Self::Gelu => |x| {
                let x = f64::from(x);
                (x * normal_distribution(x)) as f32
            },
        }
    }

    /// The derivative of that function; 0 at the rectifier's corner, as in torch.
    #[must_use]
    pub fn slope(self) -> fn(f32) -> f32 {
        match self {
            Self::Relu => |x| if x <= 0.0 { 0.0 } else { 1.0 },
            Self::Tanh => |x| {
                let y = x.tanh();
                1.0 - y * y
            },
            Self::Elu => |x| if x > 0.0 { 1.0 } else { x.exp() },
            Self::Silu => |x| {
                let sigmoid = 1.0 / (1.0 + (-x).exp());
                sigmoid * (1.0 + x * (1.0 - sigmoid))
            },
            Self::Gelu => |x| {
                let x = f64::from(x);
                let density = NORMAL_DENSITY * (-0.5 * x * x).exp();
                (normal_distribution(x) + x * density) as f32
            },
        }
    }
}

fn normal_distribution(x: f64) -> f64 {
    0.5 * (1.0 + erf(x * std::f64::consts::FRAC_1_SQRT_2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_those_of_the_functions() {
        use Activation::{Elu, Gelu, Relu, Silu, Tanh};
        for activation in [Relu, Tanh, Elu, Silu, Gelu] {
            let (function, slope) = (activation.function(), activation.slope());
            for x in [-2.5_f32, -0.7, -0.1, 0.2, 0.9, 3.0] {
                let step = 1e-2;
                let difference = (function(x + step) - function(x - step)) / (2.0 * step);
                let error = (difference - slope(x)).abs();
                assert!(error < 1e-4, "{activation:?} at {x}: {error}");
            }
        }
    }
}
