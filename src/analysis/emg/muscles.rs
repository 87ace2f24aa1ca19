//! Which simulated muscle stands for which human channel.
//!
//! Channels are matched by their labels, never by position. The electrode called *Biceps Femoris* is compared with the
//! long head, as in the authors' suite; an earlier notebook took the short head, which is another muscle and gives
//! other numbers.

use super::EmgError;

/// Labels of the human channels, in the order of their columns after the time.
pub const HUMAN_CHANNELS: [&str; 9] = [
    "Soleus",
    "Medial Gastrocnemius",
    "Lateral Gastrocnemius",
    "Tibialis Anterior",
    "Semimembranosus",
    "Biceps Femoris",
    "Vastus Lateral",
    "Rectus Femoris",
    "Vastus Medial",
];

/// A side of the body. Which leg is looked at changes the result, so nothing chooses it silently.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    Left,
    Right,
}

impl Side {
    /// What names of muscles on this side end with.
    #[must_use]
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Left => "_l",
            Self::Right => "_r",
        }
    }
}

/// Which head of the biceps femoris stands for the human channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BicepsFemoris {
    #[default]
    LongHead,
    ShortHead,
}

/// Names of the simulated muscles of one leg, in the order of [`HUMAN_CHANNELS`].
#[must_use]
pub fn model_muscles(side: Side, biceps_femoris: BicepsFemoris) -> [String; 9] {
    let biceps_femoris = match biceps_femoris {
        BicepsFemoris::LongHead => "bflh",
        BicepsFemoris::ShortHead => "bfsh",
    };
    let stems = [
        "soleus",
        "gasmed",
        "gaslat",
        "tibant",
        "semimem",
        biceps_femoris,
        "vaslat",
        "recfem",
        "vasmed",
    ];
    stems.map(|stem| format!("{stem}{}", side.suffix()))
}

/// Columns of the muscles called `wanted` in a recording whose columns are called `recorded`.
pub fn columns_named(
    recorded: &[String],
    wanted: &[impl AsRef<str>],
) -> Result<Vec<usize>, EmgError> {
    let column = |name: &str| {
        recorded.iter().position(|known| known == name).ok_or_else(|| EmgError::MissingMuscle {
            name: name.to_owned(),
            available: recorded.len(),
        })
    };
    wanted.iter().map(|name| column(name.as_ref())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_head_of_the_biceps_femoris_and_the_side_are_chosen() {
        let long = model_muscles(Side::Left, BicepsFemoris::default());
        let short = model_muscles(Side::Right, BicepsFemoris::ShortHead);
        assert_eq!((long[5].as_str(), short[5].as_str()), ("bflh_l", "bfsh_r"));
        assert_eq!((long[0].as_str(), short[8].as_str()), ("soleus_l", "vasmed_r"));
    }

    #[test]
    fn muscles_are_found_by_name_and_a_missing_one_is_named() {
        let recorded = ["b", "a", "c"].map(str::to_owned);
        assert_eq!(columns_named(&recorded, &["a", "c"]), Ok(vec![1, 2]));
        assert_eq!(
            columns_named(&recorded, &["d"]),
            Err(EmgError::MissingMuscle { name: "d".to_owned(), available: 3 })
        );
    }
}
