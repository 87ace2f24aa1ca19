//! One installer at a time in a cache. The lock belongs to the open file, so it ends with the process that held it.

use std::fs::{File, TryLockError};
use std::path::Path;

use crate::files::{self, FileError};

/// Held while a part is being installed.
#[derive(Debug)]
pub(super) struct InstallLock {
    /// None on file systems that know no locks: installers then still cannot harm each other, because their staging
    /// folders have different names, but none may clear another's.
    file: Option<File>,
}

impl InstallLock {
    /// Waits for the lock of the cache in `root`, after calling `waiting` if somebody else holds it.
    pub(super) fn take(root: &Path, waiting: impl FnOnce()) -> Result<Self, FileError> {
        files::create_folder(root)?;
        let path = root.join(".lock");
        let file = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(&path)
            .map_err(|source| FileError::Write { path, source })?;
        let locked = match file.try_lock() {
            Ok(()) => true,
            Err(TryLockError::WouldBlock) => {
                waiting();
                file.lock().is_ok()
            }
            Err(TryLockError::Error(_)) => false,
        };
        Ok(Self { file: locked.then_some(file) })
    }

    /// Whether nobody else can be installing now.
    pub(super) fn is_exclusive(&self) -> bool {
        self.file.is_some()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn two_installers_are_never_inside_together() {
        let folder = tempfile::tempdir().unwrap();
        let (inside, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    let lock = InstallLock::take(folder.path(), || ()).unwrap();
                    assert!(lock.is_exclusive());
                    most.fetch_max(inside.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                    std::thread::sleep(std::time::Duration::from_millis(5));
                    inside.fetch_sub(1, Ordering::SeqCst);
                    drop(lock);
                });
            }
        });
        assert_eq!(most.into_inner(), 1);
    }
}
