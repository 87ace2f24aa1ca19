//! The parts: where each comes from, what is taken out of its wheel, and the hashes that prove it.
//!
//! The hashes were measured on the wheels `pip` fetched on 2026-11-22, one per platform; a wheel that was replaced since
//! is refused. `MuJoCo` is proven by its library's hash; `MyoSuite`, hundreds of files, by its wheel's hash when it is
//! installed and afterwards by the hash of the list of its files.

use std::fmt;

use super::{AssetError, PhysicsVersion, Platform, platform};

/// One thing the program needs and may not carry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Part {
    /// A `MuJoCo` shared library.
    Physics(PhysicsVersion),
    /// The `MyoSuite` models and baseline policies.
    MyoSuite,
}

/// How we know that a part is what it says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Proof {
    /// One file inside has a known SHA-256.
    File { path: &'static str, sha256: &'static str },
    /// The wheel has a known SHA-256, and so has the list of the files taken out of it.
    Wheel { sha256: &'static str, listing: &'static str },
}

/// The baseline policy used when no other is named: natural policy gradient, elbow, seed 1, below [`MYOSUITE_ROOT`].
pub(super) const ELBOW_POLICY: &str = "agents/baslines_NPG/myoElbowPose1D6MRandom-v0/\
    2022-02-26_21-16-27/33_env=myoElbowPose1D6MRandom-v0,seed=1/iterations/best_policy.pickle";

/// The package's folder inside its wheel.
pub(super) const MYOSUITE_ROOT: &str = "myosuite";

const MYOSUITE: Proof = Proof::Wheel {
    sha256: "1ae4bceff62b289ca490328566bb1c0afe2bfb097dd23c597916f127fae41ebd",
    listing: "a722f7f2b522a06abaa0a321b72c10e4e69a32236f183d64f46a443c2f169dc8",
};

impl Part {
    /// All parts, in the order they are shown.
    pub const ALL: [Self; 3] = [
        Self::Physics(PhysicsVersion::V2_3_7),
        Self::Physics(PhysicsVersion::V3_17_0),
        Self::MyoSuite,
    ];

    /// The Python package it comes from.
    #[must_use]
    pub const fn package(self) -> &'static str {
        match self {
            Self::Physics(_) => "mujoco",
            Self::MyoSuite => "MyoSuite",
        }
    }

    /// The version of that package.
    #[must_use]
    pub const fn version(self) -> &'static str {
        match self {
            Self::Physics(version) => version.as_str(),
            Self::MyoSuite => "2.2.0",
        }
    }

    /// The licence it is under, as SPDX writes it.
    #[must_use]
    pub const fn licence(self) -> &'static str {
        "Apache-2.0"
    }

    /// What to cite when results made with it are published.
    #[must_use]
    pub const fn citation(self) -> &'static str {
        match self {
            Self::Physics(_) => {
                "Todorov, Erez, Tassa (2012), MuJoCo: a physics engine for model-based control, IROS"
            }
            Self::MyoSuite => {
                "Caggiano, Wang, Durandau, Sartori, Kumar (2022), MyoSuite: a contact-rich simulation suite \
                 for musculoskeletal motor control, L4DC"
            }
        }
    }

    /// Whether there is a wheel of it for this machine.
    #[must_use]
    pub fn is_available(self) -> bool {
        self.proof(Platform::here()).is_ok()
    }

    /// Its folder in the cache. Libraries carry their platform, so that machines of two kinds can share a home folder.
    pub(super) fn folder(self, platform: Option<Platform>) -> String {
        match (self, platform) {
            (Self::Physics(version), Some(platform)) => format!("mujoco-{version}-{platform}"),
            (Self::Physics(version), None) => format!("mujoco-{version}"),
            (Self::MyoSuite, _) => format!("myosuite-{}", self.version()),
        }
    }

    /// The hashes that prove it on `platform`.
    pub(super) fn proof(self, platform: Option<Platform>) -> Result<Proof, AssetError> {
        let proof = match self {
            Self::Physics(version) => platform.and_then(|platform| library(version, platform)),
            Self::MyoSuite => Some(MYOSUITE),
        };
        proof.ok_or_else(|| AssetError::NoWheel {
            what: self.to_string(),
            platform: platform.map_or_else(platform::describe_here, |known| known.to_string()),
        })
    }

    /// Whether the file called `name` in its wheel is one we need.
    pub(super) fn keeps(self, name: &str) -> bool {
        let file = name.rsplit('/').next().unwrap_or(name);
        match self {
            Self::Physics(_) => {
                name.starts_with("mujoco/libmujoco.")
                    || (name.contains(".dist-info/") && file.starts_with("LICENSE"))
            }
            Self::MyoSuite => {
                let is_model = name.starts_with("myosuite/envs/myo/assets/")
                    || name.starts_with("myosuite/simhive/myo_sim/")
                    // The one file the models use of the furniture: the texture of the arm's table.
                    || name == "myosuite/simhive/furniture_sim/common/textures/stone1.png";
                let extension = file.rsplit_once('.').map(|(_, extension)| extension);
                let is_policy = name.starts_with("myosuite/agents/baslines_NPG/")
                    && file == "best_policy.pickle";
                file == "LICENSE"
                    || is_policy
                    || (is_model && matches!(extension, Some("xml" | "stl" | "msh" | "png")))
            }
        }
    }
}

impl fmt::Display for Part {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Physics(version) => write!(formatter, "MuJoCo {version}"),
            Self::MyoSuite => write!(formatter, "MyoSuite {}", self.version()),
        }
    }
}

/// The library inside the official wheel of a version for a platform; none where there is no such wheel.
fn library(version: PhysicsVersion, platform: Platform) -> Option<Proof> {
    use PhysicsVersion::{V2_3_7, V3_17_0};
    use Platform::{LinuxArm, LinuxX86, MacArm, MacX86};
    let (path, sha256) = match (version, platform) {
        (V2_3_7, LinuxX86) => (
            "mujoco/libmujoco.so.2.3.7",
            "a82e1280ec6a72a309135202aff5f7a2ee71fc1eb69c719ac9bbf30ce7b9ef0e",
        ),
        (V2_3_7, LinuxArm) => (
            "mujoco/libmujoco.so.2.3.7",
            "5b0c7dd9afc55c0a6431e649cf737cc94549181678a12c433763cd6dd971fe9d",
        ),
        (V2_3_7, MacX86) => (
            "mujoco/libmujoco.2.3.7.dylib",
            "2bf6e64bc8305ba9cba076f850cebd3691439f85f9c6194d6f58e86a3ec91f52",
        ),
        (V2_3_7, MacArm) => (
            "mujoco/libmujoco.2.3.7.dylib",
            "ae77169a21671da60fcf22b0516b4606e47abfdae9e2e8124911e0e906c857ce",
        ),
        (V3_17_0, LinuxX86) => (
            "mujoco/libmujoco.so.3.17.0",
            "23496b023ee80fb61ab71167e94bc649f9941710fde96b18bb8204fb332523ad",
        ),
        (V3_17_0, LinuxArm) => (
            "mujoco/libmujoco.so.3.17.0",
            "e2edd0204fb9229f75f332a4fcd1a32345bb9f90651dc0fddfa20ec0670db789",
        ),
        (V3_17_0, MacArm) => (
            "mujoco/libmujoco.3.17.0.dylib",
            "454d51fa639100018579716bd68e61285e9b53c9241b029680d82dec95bc8d53",
        ),
        // The last wheels for Intel Macs are older than 3.17.0.
        (V3_17_0, MacX86) => return None,
    };
    Some(Proof::File { path, sha256 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_hash_is_a_sha256_and_no_two_are_the_same() {
        let mut hashes = Vec::new();
        for part in Part::ALL {
            for platform in Platform::ALL {
                match part.proof(Some(platform)) {
                    Ok(Proof::File { sha256, .. }) => hashes.push(sha256),
                    Ok(Proof::Wheel { sha256, listing }) if platform == Platform::LinuxX86 => {
                        hashes.extend([sha256, listing]);
                    }
                    Ok(Proof::Wheel { .. }) | Err(_) => {}
                }
            }
        }
        assert_eq!(hashes.len(), 9);
        for hash in &hashes {
            assert_eq!(hash.len(), 64, "{hash}");
            assert!(hash.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f')), "{hash}");
        }
        hashes.sort_unstable();
        hashes.dedup();
        assert_eq!(hashes.len(), 9);
    }

    #[test]
    fn a_platform_without_a_wheel_is_an_error_that_names_it() {
        let part = Part::Physics(PhysicsVersion::V3_17_0);
        let error = part.proof(Some(Platform::MacX86)).unwrap_err();
        assert_eq!(error.to_string(), "there is no official MuJoCo 3.17.0 for macos-x86_64");
        assert!(part.proof(None).is_err());
        assert!(Part::MyoSuite.proof(None).is_ok());
    }

    #[test]
    fn the_library_and_the_default_policy_are_among_the_files_kept() {
        for part in Part::ALL {
            for platform in Platform::ALL {
                if let Ok(Proof::File { path, .. }) = part.proof(Some(platform)) {
                    assert!(part.keeps(path), "{path}");
                }
            }
        }
        assert!(Part::MyoSuite.keeps(&format!("{MYOSUITE_ROOT}/{ELBOW_POLICY}")));
        assert!(!Part::MyoSuite.keeps("myosuite/envs/env_base.py"));
        assert!(!Part::MyoSuite.keeps("myosuite/simhive/myo_sim/.git"));
    }
}
