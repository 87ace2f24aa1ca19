//! The two versions of `MuJoCo`. They give different results (tendons wrap differently, contacts differ), so the version
//! is part of every key, manifest and caption.

use std::fmt;
use std::str::FromStr;

/// Which `MuJoCo`.
#[derive(
    Debug,
    Clone,
    Copy,
    Default,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    serde::Serialize,
    serde::Deserialize,
)]
pub enum PhysicsVersion {
    /// 2.3.7: what the published checkpoints were trained with.
    #[default]
    #[serde(rename = "2.3.7")]
    V2_3_7,
    /// 3.17.0: the newest with official libraries and the same models.
    #[serde(rename = "3.17.0")]
    V3_17_0,
}

/// A version of `MuJoCo` the program cannot drive.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown physics version `{0}`, expected 2.3.7 or 3.17.0")]
pub struct UnknownPhysics(pub String);

impl PhysicsVersion {
    /// Both, oldest first.
    pub const ALL: [Self; 2] = [Self::V2_3_7, Self::V3_17_0];

    /// The version as `MuJoCo` writes it.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::V2_3_7 => "2.3.7",
            Self::V3_17_0 => "3.17.0",
        }
    }
}

impl fmt::Display for PhysicsVersion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(self.as_str())
    }
}

impl FromStr for PhysicsVersion {
    type Err = UnknownPhysics;

    fn from_str(text: &str) -> Result<Self, UnknownPhysics> {
        let known = Self::ALL.into_iter().find(|version| version.as_str() == text);
        known.ok_or_else(|| UnknownPhysics(text.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_reads_back_as_it_was_written() {
        for version in PhysicsVersion::ALL {
            assert_eq!(version.to_string().parse(), Ok(version));
            let json = serde_json::to_string(&version).unwrap();
            assert_eq!(json, format!("\"{version}\""));
        }
    }

    #[test]
    fn an_unknown_version_is_named_together_with_the_known_ones() {
        let error = "3.2.0".parse::<PhysicsVersion>().unwrap_err();
        assert_eq!(error.to_string(), "unknown physics version `3.2.0`, expected 2.3.7 or 3.17.0");
    }
}
