//! Why a policy cannot be opened, and what to type next: the file that is at fault is named, checkpoint or normaliser.

use std::path::Path;

use crate::policy::PolicyError;
use crate::policy::checkpoint::normaliser_beside;

use super::render::Hinted;

/// The error of opening the checkpoint `path` with `normaliser`, or with the one beside it.
pub fn policy_error(error: &PolicyError, path: &Path, normaliser: Option<&Path>) -> anyhow::Error {
    let (mut fact, mut path) = (error, path);
    while let PolicyError::InFile { path: file, source } = fact {
        (fact, path) = (source, file);
    }
    let beside = normaliser_beside(path).into_iter().next();
    let used = normaliser.map(Path::to_path_buf).or(beside);
    match (fact, used) {
        (PolicyError::MissingNormaliser { .. }, _) => Hinted::new(
            error.to_string(),
            "give the normaliser that was saved with this checkpoint: `--normaliser FILE`; if it was trained without \
             one, `--normaliser none`",
        ),
        (
            PolicyError::WrongNormaliser { .. }
            | PolicyError::NormaliserLength { .. }
            | PolicyError::NormaliserValues,
            Some(used),
        ) => Hinted::new(
            format!("`{}` does not fit `{}`: {fact}", used.display(), path.display()),
            "give the normaliser that was saved with this checkpoint with `--normaliser FILE`, or leave the option \
             out to use the one beside it",
        ),
        (_, used) => {
            let message = error.to_string();
            let named = |file: &Path| message.contains(&format!("`{}`", file.display()));
            let culprit = used.filter(|used| named(used)).unwrap_or_else(|| path.to_path_buf());
            let hint = format!("`arnold-analyze inspect {}` says more", culprit.display());
            Hinted::new(message, hint)
        }
    }
}
