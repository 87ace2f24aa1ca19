//! The policies that the program carries: small ones, trained by itself, so that a first command needs nothing from elsewhere.
//!
//! They are inside the binary and lie in the cache while they are used, laid out as a data folder is. The folder's name
//! holds a hash of all of them, so versions of the program do not meet in it. What they can do: `data/policies/README.md`.

use std::path::{Path, PathBuf};

use super::{AssetError, Cache};
use crate::files;

/// The muscle transformer, by its name in `--policy`.
pub const CARRIED: &str = "mini";
/// The experts of its tasks.
pub const CARRIED_EXPERTS: &str = "expert:mini";

/// Path below the folder, and what is in it.
const FILES: [(&str, &[u8]); 9] = [
    (
        "student_policies/mini/mini.safetensors",
        include_bytes!("../../data/policies/mini/transformer.safetensors"),
    ),
    ("expert_configs/mini.json", include_bytes!("../../data/policies/mini/experts.json")),
    (
        "expert_policies/mini/elbow_pose/policy.safetensors",
        include_bytes!("../../data/policies/mini/elbow_pose.safetensors"),
    ),
    (
        "expert_policies/mini/hand_thumb_reach/policy.safetensors",
        include_bytes!("../../data/policies/mini/hand_thumb_reach.safetensors"),
    ),
    (
        "expert_policies/mini/hand_index_reach/policy.safetensors",
        include_bytes!("../../data/policies/mini/hand_index_reach.safetensors"),
    ),
    (
        "expert_policies/mini/hand_middle_reach/policy.safetensors",
        include_bytes!("../../data/policies/mini/hand_middle_reach.safetensors"),
    ),
    (
        "expert_policies/mini/hand_ring_reach/policy.safetensors",
        include_bytes!("../../data/policies/mini/hand_ring_reach.safetensors"),
    ),
    (
        "expert_policies/mini/hand_little_reach/policy.safetensors",
        include_bytes!("../../data/policies/mini/hand_little_reach.safetensors"),
    ),
    ("README.md", include_bytes!("../../data/policies/README.md")),
];

impl Cache {
    /// The folder of the policies that the program carries, a data folder of its own. A file that is missing or not what
    /// it was is written again.
    pub fn shipped(&self) -> Result<PathBuf, AssetError> {
        let mut hasher = blake3::Hasher::new();
        for (path, bytes) in FILES {
            hasher.update(path.as_bytes()).update(blake3::hash(bytes).as_bytes());
        }
        let hash = hasher.finalize().to_hex();
        let folder = self.root().join(format!("policies-{}", &hash[..12]));
        for (path, bytes) in FILES {
            let path = folder.join(path);
            if !holds(&path, bytes) {
                files::write_atomic(&path, bytes)?;
            }
        }
        Ok(folder)
    }
}

fn holds(path: &Path, bytes: &[u8]) -> bool {
    files::read_bounded(path, bytes.len() as u64).is_ok_and(|found| found == bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_carried_is_unpacked_whole_and_mended() {
        let cache = tempfile::tempdir().unwrap();
        let cache = Cache::at(cache.path());
        let folder = cache.shipped().unwrap();
        for (path, bytes) in FILES {
            assert!(holds(&folder.join(path), bytes), "{path}");
        }
        let first = folder.join(FILES[0].0);
        files::write_atomic(&first, b"something else").unwrap();
        assert_eq!(cache.shipped().unwrap(), folder);
        assert!(holds(&first, FILES[0].1));
    }

    #[test]
    fn they_are_at_most_two_megabytes() {
        assert!(FILES.iter().map(|(_, bytes)| bytes.len()).sum::<usize>() <= 2_000_000);
    }
}
