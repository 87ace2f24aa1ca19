//! Where the parts live: `$ARNOLD_CACHE`, else `$XDG_CACHE_HOME/arnold-analyze`, else `~/.cache/arnold-analyze` (on macOS
//! `~/Library/Caches/arnold-analyze`). One folder per part.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::part::{ELBOW_POLICY, MYOSUITE_ROOT, Proof};
use super::{AssetError, Part, PhysicsVersion, Platform, Receipt};

/// A folder of parts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cache {
    root: PathBuf,
}

impl Cache {
    /// The user's cache. Nothing is created.
    #[must_use]
    pub fn locate() -> Self {
        let variable = |name| std::env::var_os(name).filter(|value: &OsString| !value.is_empty());
        let own = variable("ARNOLD_CACHE").map(PathBuf::from);
        let shared = || {
            let home = std::env::home_dir();
            let base = if cfg!(target_os = "macos") {
                home.map(|home| home.join("Library/Caches"))
            } else {
                let named = variable("XDG_CACHE_HOME").map(PathBuf::from);
                // The specification says to ignore relative paths.
                named.filter(|p| p.is_absolute()).or_else(|| home.map(|home| home.join(".cache")))
            };
            base.unwrap_or_else(std::env::temp_dir).join("arnold-analyze")
        };
        Self::at(own.unwrap_or_else(shared))
    }

    /// The cache in `root`.
    #[must_use]
    pub fn at(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// Its folder.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The folder in which `part` lies or would lie.
    #[must_use]
    pub fn folder(&self, part: Part) -> PathBuf {
        self.root.join(part.folder(Platform::here()))
    }

    /// Hashes every file of `part` and compares it with what was committed.
    pub fn verify(&self, part: Part) -> Result<Receipt, AssetError> {
        Receipt::verify(part, &self.folder(part), part.proof(Platform::here())?)
    }

    /// The verified `MuJoCo` shared library of that version.
    pub fn physics_library(&self, version: PhysicsVersion) -> Result<PathBuf, AssetError> {
        let part = Part::Physics(version);
        self.verify(part)?;
        match part.proof(Platform::here())? {
            Proof::File { path, .. } => Ok(self.folder(part).join(path)),
            Proof::Wheel { .. } => Err(AssetError::Damaged {
                what: part.to_string(),
                reason: "no library".to_owned(),
                path: self.folder(part),
            }),
        }
    }

    /// The verified `MyoSuite` package: the folder below which `envs/myo/assets` and `simhive` lie.
    pub fn myosuite(&self) -> Result<PathBuf, AssetError> {
        self.verify(Part::MyoSuite)?;
        Ok(self.folder(Part::MyoSuite).join(MYOSUITE_ROOT))
    }

    /// The verified baseline policy for the elbow, a pickle: natural policy gradient, seed 1.
    pub fn npg_elbow_policy(&self) -> Result<PathBuf, AssetError> {
        Ok(self.myosuite()?.join(ELBOW_POLICY))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_cache_says_what_is_missing_and_which_command_mends_it() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path());
        let error = cache.myosuite().unwrap_err();
        assert_eq!(error.to_string(), "MyoSuite 2.2.0 is not installed");
        assert_eq!(error.hint(), "run `arnold-analyze setup`");
        if Part::Physics(PhysicsVersion::V2_3_7).is_available() {
            let error = cache.physics_library(PhysicsVersion::V2_3_7).unwrap_err();
            assert!(matches!(error, AssetError::Missing { .. }), "{error}");
        }
    }
}
