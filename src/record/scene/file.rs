//! A scene as a file that the viewer opens: the blueprints first, then one recording per episode, then the library's index,
//! which lists them in the order of a hash map: another in every run. Everything before it is the same bytes every time.

use std::collections::BTreeSet;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use re_sdk::external::re_log_encoding::{Encoder, EncodingOptions};

use crate::files;

use super::blueprint;
use super::script::Act;
use super::store::SceneError;

/// Writes `acts` to `path`, one after the other, so that only one is in memory. The first error of `acts` ends it.
pub fn write_scene<E: From<SceneError>>(
    path: &Path,
    acts: impl Iterator<Item = Result<Act, E>>,
) -> Result<usize, E> {
    let mut failure = None;
    let mut count = 0;
    let written = files::write_atomic_with(path, |file| {
        let mut buffer = BufWriter::with_capacity(1 << 20, file);
        match fill(&mut buffer, acts, &mut count) {
            Ok(()) => buffer.flush(),
            Err(error) => {
                failure = Some(error);
                Err(io::Error::other("the scene could not be made"))
            }
        }
    });
    match failure {
        Some(error) => Err(error),
        None => written.map(|()| count).map_err(|error| SceneError::from(error).into()),
    }
}

fn fill<E: From<SceneError>>(
    out: &mut impl Write,
    acts: impl Iterator<Item = Result<Act, E>>,
    count: &mut usize,
) -> Result<(), E> {
    let version = re_sdk::build_info().version;
    let fail = |error| E::from(SceneError::Encode(error));
    let options = EncodingOptions::PROTOBUF_COMPRESSED;
    let mut encoder = Encoder::new_eager(version, options, out).map_err(fail)?;
    let mut arranged = BTreeSet::new();
    for act in acts {
        let act = act?;
        if arranged.insert(act.task.clone()) {
            for message in blueprint::messages(&act)? {
                encoder.append(&message).map_err(fail)?;
            }
        }
        for message in act.messages()? {
            encoder.append(&message).map_err(fail)?;
        }
        *count += 1;
    }
    encoder.finish().map_err(fail)
}
