//! What a task says about itself to people: which numbers decide, and what an episode starts from. Tasks build these from
//! the constants they play by, so that what is shown is what holds.

/// What happens when a number passes its threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// The step counts as solved. With several such thresholds, all must hold.
    Solved,
    /// The episode ends.
    Ends,
}

impl Event {
    /// `solved` or `ends`.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Solved => "solved",
            Self::Ends => "ends",
        }
    }
}

/// A number that decides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Threshold {
    /// What it decides.
    pub event: Event,
    /// What is compared with it.
    pub quantity: &'static str,
    /// Whether the quantity must be above it, rather than below.
    pub above: bool,
    /// The threshold.
    pub value: f64,
    /// Unit of both.
    pub unit: &'static str,
}

impl Threshold {
    /// Solved while `quantity` is below `value`.
    pub(super) const fn solved_below(
        quantity: &'static str,
        value: f64,
        unit: &'static str,
    ) -> Self {
        Self { event: Event::Solved, quantity, above: false, value, unit }
    }

    /// Solved while `quantity` is above `value`.
    pub(super) const fn solved_above(
        quantity: &'static str,
        value: f64,
        unit: &'static str,
    ) -> Self {
        Self { event: Event::Solved, quantity, above: true, value, unit }
    }

    /// The episode ends when `quantity` is below `value`.
    pub(super) const fn ends_below(quantity: &'static str, value: f64, unit: &'static str) -> Self {
        Self { event: Event::Ends, quantity, above: false, value, unit }
    }

    /// The episode ends when `quantity` is above `value`.
    pub(super) const fn ends_above(quantity: &'static str, value: f64, unit: &'static str) -> Self {
        Self { event: Event::Ends, quantity, above: true, value, unit }
    }
}

/// How a part of the initial state or of the goal is chosen.
#[derive(Debug, Clone, PartialEq)]
pub enum Chosen {
    /// Uniformly between two corners, every component on its own.
    Uniform {
        /// Smallest values.
        low: Vec<f64>,
        /// Largest values.
        high: Vec<f64>,
    },
    /// Always the same.
    Fixed(Vec<f64>),
    /// One of these, equally likely.
    OneOf(&'static [&'static str]),
    /// By a rule.
    Rule(&'static str),
}

/// A part of the initial state or of the goal.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// What it is.
    pub quantity: String,
    /// How it is chosen.
    pub chosen: Chosen,
    /// Unit of its numbers.
    pub unit: &'static str,
}

impl Start {
    /// Uniform between `low` and `high`; if these are the same, there is nothing to draw.
    pub(super) fn uniform(
        quantity: impl Into<String>,
        low: &[f64],
        high: &[f64],
        unit: &'static str,
    ) -> Self {
        let chosen = if low == high {
            Chosen::Fixed(low.to_vec())
        } else {
            Chosen::Uniform { low: low.to_vec(), high: high.to_vec() }
        };
        Self { quantity: quantity.into(), chosen, unit }
    }

    /// Always `values`.
    pub(super) fn fixed(quantity: impl Into<String>, values: &[f64], unit: &'static str) -> Self {
        Self { quantity: quantity.into(), chosen: Chosen::Fixed(values.to_vec()), unit }
    }

    /// One of `choices`.
    pub(super) fn one_of(quantity: impl Into<String>, choices: &'static [&'static str]) -> Self {
        Self { quantity: quantity.into(), chosen: Chosen::OneOf(choices), unit: "" }
    }

    /// By `rule`.
    pub(super) fn rule(quantity: impl Into<String>, rule: &'static str) -> Self {
        Self { quantity: quantity.into(), chosen: Chosen::Rule(rule), unit: "" }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_without_width_is_a_constant() {
        let start = Start::uniform("mass", &[0.043], &[0.043], "kg");
        assert_eq!(start, Start::fixed("mass", &[0.043], "kg"));
        let wide = Start::uniform("mass", &[0.03], &[0.3], "kg");
        assert_eq!(wide.chosen, Chosen::Uniform { low: vec![0.03], high: vec![0.3] });
    }
}
