//! The platforms for which official `MuJoCo` wheels exist, and how a wheel's file name spells them.

use std::fmt;

/// Operating system and processor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Platform {
    /// Linux (glibc) on 64-bit Intel and AMD.
    LinuxX86,
    /// Linux (glibc) on 64-bit Arm.
    LinuxArm,
    /// macOS on Intel.
    MacX86,
    /// macOS on Apple silicon.
    MacArm,
}

impl Platform {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::LinuxX86, Self::LinuxArm, Self::MacX86, Self::MacArm];

    /// The platform this program was built for, if there are wheels for it.
    #[must_use]
    pub fn here() -> Option<Self> {
        match (std::env::consts::OS, std::env::consts::ARCH) {
            ("linux", "x86_64") => Some(Self::LinuxX86),
            ("linux", "aarch64") => Some(Self::LinuxArm),
            ("macos", "x86_64") => Some(Self::MacX86),
            ("macos", "aarch64") => Some(Self::MacArm),
            _ => None,
        }
    }

    /// The name used for folders and messages.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::LinuxX86 => "linux-x86_64",
            Self::LinuxArm => "linux-aarch64",
            Self::MacX86 => "macos-x86_64",
            Self::MacArm => "macos-aarch64",
        }
    }

    /// The platform tags to ask `pip` for, newest first.
    pub(super) const fn wheel_tags(self) -> &'static [&'static str] {
        match self {
            Self::LinuxX86 => &[
                "manylinux_2_28_x86_64",
                "manylinux_2_27_x86_64",
                "manylinux_2_17_x86_64",
                "manylinux2014_x86_64",
            ],
            Self::LinuxArm => &[
                "manylinux_2_28_aarch64",
                "manylinux_2_27_aarch64",
                "manylinux_2_17_aarch64",
                "manylinux2014_aarch64",
            ],
            Self::MacX86 => &["macosx_11_0_x86_64", "macosx_10_16_x86_64"],
            Self::MacArm => &["macosx_11_0_arm64"],
        }
    }

    /// Whether a wheel's platform tag (the last part of its name; several are joined by dots) is ours.
    pub(super) fn runs(self, tag: &str) -> bool {
        tag == "any" || tag.split('.').any(|one| self.wheel_tags().contains(&one))
    }
}

impl fmt::Display for Platform {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(self.as_str())
    }
}

/// This machine in words, with or without wheels: `linux-x86_64`, `windows-x86_64`.
#[must_use]
pub fn describe_here() -> String {
    format!("{}-{}", std::env::consts::OS, std::env::consts::ARCH)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wheel_runs_on_its_own_platform_only() {
        let tag = "manylinux_2_17_x86_64.manylinux2014_x86_64";
        let able: Vec<_> = Platform::ALL.into_iter().filter(|p| p.runs(tag)).collect();
        assert_eq!(able, [Platform::LinuxX86]);
        assert!(Platform::ALL.into_iter().all(|platform| platform.runs("any")));
    }

    #[test]
    fn the_platform_names_itself_as_the_machine_does() {
        if let Some(platform) = Platform::here() {
            assert_eq!(platform.to_string(), describe_here());
        }
    }
}
