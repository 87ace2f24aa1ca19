//! What a run remembers, on disk: `replay_<steps>.bin`, too large for an array file.
//!
//! A line that says what it is; for every environment the number of entries it ever had, as eight bytes, then those that are
//! there, oldest first: observation, action, reward, age, mark; at the end the BLAKE3 of all that. Numbers are little-endian.
//! Sizes are those of the run, so a file of another length or content is refused before anything of it is used.

use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::Path;

use super::replay::{Mark, Replay, Ring};
use crate::files;
use crate::train::TrainError;

const MAGIC: &[u8; 16] = b"arnold replay 1\n";

/// Writes `replay` to `path`.
pub(super) fn write(path: &Path, replay: &Replay) -> Result<(), TrainError> {
    files::write_atomic_with(path, |file| {
        let mut hashed = Hashed { inner: BufWriter::new(file), hasher: blake3::Hasher::new() };
        let mut row = Vec::new();
        hashed.write_all(MAGIC)?;
        for ring in &replay.rings {
            hashed.write_all(&ring.count.to_le_bytes())?;
            for entry in ring.oldest()..ring.count {
                let slot = ring.slot(entry);
                let observation = &ring.observations[slot * ring.sensors..][..ring.sensors];
                let action = &ring.actions[slot * ring.width..][..ring.width];
                let numbers = observation.iter().chain(action).chain([&ring.rewards[slot]]);
                row.clear();
                row.extend(numbers.flat_map(|number| number.to_le_bytes()));
                row.extend(ring.ages[slot].to_le_bytes());
                row.push(ring.marks[slot] as u8);
                hashed.write_all(&row)?;
            }
        }
        let Hashed { mut inner, hasher } = hashed;
        inner.write_all(hasher.finalize().as_bytes())?;
        inner.flush()
    })?;
    Ok(())
}

/// Fills `replay`, which is empty, with what [`write`] wrote of one of the same sizes.
pub(super) fn read(path: &Path, replay: &mut Replay) -> Result<(), TrainError> {
    let file = BufReader::new(files::open(path)?);
    let mut hashed = Hashed { inner: file, hasher: blake3::Hasher::new() };
    let filled = fill(&mut hashed, replay);
    let is_whole = filled.is_ok_and(|fits| fits) && {
        let sum = *hashed.hasher.finalize().as_bytes();
        let mut end = Vec::new();
        // One byte more is enough to see that it goes on.
        let read = hashed.inner.by_ref().take(sum.len() as u64 + 1).read_to_end(&mut end);
        read.is_ok() && end == sum
    };
    if is_whole { Ok(()) } else { Err(TrainError::State { what: "replay buffer".to_owned() }) }
}

/// Whether what is read can be a buffer of these sizes.
fn fill(source: &mut impl Read, replay: &mut Replay) -> io::Result<bool> {
    if bytes::<16>(source)? != *MAGIC {
        return Ok(false);
    }
    for ring in &mut replay.rings {
        let count = u64::from_le_bytes(bytes(source)?);
        let live = count.min(ring.capacity() as u64) as usize;
        let mut entries = Entries::of(ring, live);
        for _ in 0..live {
            if !entries.read(source)? {
                return Ok(false);
            }
        }
        if !entries.put(ring, count) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Entries in the order of a file.
struct Entries {
    row: Vec<u8>,
    numbers: Vec<f32>,
    ages: Vec<u32>,
    marks: Vec<Mark>,
}

impl Entries {
    fn of(ring: &Ring, live: usize) -> Self {
        let row = vec![0; 4 * (ring.sensors + ring.width + 2) + 1];
        Self { row, numbers: Vec::new(), ages: Vec::with_capacity(live), marks: Vec::new() }
    }

    /// Reads one.
    fn read(&mut self, source: &mut impl Read) -> io::Result<bool> {
        source.read_exact(&mut self.row)?;
        let (words, rest) = self.row.as_chunks::<4>();
        let Some((age, numbers)) = words.split_last() else { return Ok(false) };
        let mark = match rest {
            [0] => Mark::Open,
            [1] => Mark::GoesOn,
            [2] => Mark::Ends,
            _ => return Ok(false),
        };
        let first = self.numbers.len();
        self.numbers.extend(numbers.iter().map(|&number| f32::from_le_bytes(number)));
        self.ages.push(u32::from_le_bytes(*age));
        self.marks.push(mark);
        Ok(self.numbers[first..].iter().all(|number| number.is_finite()))
    }

    /// Puts them where they belong. The newest entry waits for its step, or there is none.
    fn put(&self, ring: &mut Ring, count: u64) -> bool {
        let live = self.marks.len();
        if self.marks.last() != Some(&Mark::Open) {
            return false;
        }
        let (sensors, width) = (ring.sensors, ring.width);
        ring.observations.resize(live * sensors, 0.0);
        ring.actions.resize(live * width, 0.0);
        ring.rewards.resize(live, 0.0);
        ring.ages.resize(live, 0);
        ring.marks.resize(live, Mark::Open);
        ring.count = count;
        for (index, numbers) in self.numbers.chunks_exact(sensors + width + 1).enumerate() {
            let slot = ring.slot(ring.oldest() + index as u64);
            ring.observations[slot * sensors..][..sensors].copy_from_slice(&numbers[..sensors]);
            ring.actions[slot * width..][..width].copy_from_slice(&numbers[sensors..][..width]);
            ring.rewards[slot] = numbers[sensors + width];
            ring.ages[slot] = self.ages[index];
            ring.marks[slot] = self.marks[index];
        }
        true
    }
}

fn bytes<const N: usize>(source: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    source.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// Everything that passes is hashed.
struct Hashed<I> {
    inner: I,
    hasher: blake3::Hasher,
}

impl<W: Write> Write for Hashed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl<R: Read> Read for Hashed<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(bytes)?;
        self.hasher.update(&bytes[..read]);
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(steps: usize) -> Replay {
        let mut replay = Replay::new(128, &[2, 3], 2, 3).unwrap();
        for (seat, ring) in replay.rings.iter_mut().enumerate() {
            let seen = |step: usize| -> Vec<f32> { vec![(seat + step) as f32; ring_sensors(seat)] };
            ring.begin(&seen(0));
            for step in 1..=steps {
                ring.step(&[0.5, step as f32], 0.25 * step as f32, step % 7 == 0, &seen(step));
                if step % 7 == 0 {
                    ring.begin(&seen(step));
                }
            }
        }
        replay
    }

    fn ring_sensors(seat: usize) -> usize {
        2 + seat
    }

    #[test]
    fn a_buffer_comes_back_as_it_was_before_and_after_it_went_round() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("replay.bin");
        for steps in [0, 5, 200] {
            let replay = filled(steps);
            write(&path, &replay).unwrap();
            let mut again = Replay::new(128, &[2, 3], 2, 3).unwrap();
            read(&path, &mut again).unwrap();
            assert_eq!(again, replay, "{steps}");
        }
    }

    #[test]
    fn a_file_that_was_cut_changed_or_made_longer_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("replay.bin");
        write(&path, &filled(20)).unwrap();
        let good = std::fs::read(&path).unwrap();
        let mut changes: Vec<Vec<u8>> = (0..good.len())
            .step_by(37)
            .map(|place| {
                let mut bytes = good.clone();
                bytes[place] ^= 0x55;
                bytes
            })
            .collect();
        changes.extend((0..good.len()).step_by(53).map(|end| good[..end].to_vec()));
        changes.push([&good[..], &[0]].concat());
        for bytes in changes {
            files::write_atomic(&path, &bytes).unwrap();
            let mut replay = Replay::new(128, &[2, 3], 2, 3).unwrap();
            assert!(matches!(read(&path, &mut replay), Err(TrainError::State { .. })));
        }
    }
}
