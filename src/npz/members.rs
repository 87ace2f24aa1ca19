//! Archives that also hold texts (`<U…`, fixed-width UTF-32), and writing archives.
//!
//! The same members give the same bytes: sorted by name, compressed at one level, without a clock.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use zip::write::SimpleFileOptions;

use super::{Account, Array, ArrayError, Elements, LARGEST_FILE, LARGEST_MEMORY, Npy};
use crate::files::{self, printable};

/// An n-dimensional array of texts in C order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextArray {
    pub shape: Vec<usize>,
    pub values: Vec<String>,
}

/// One array of an archive.
#[derive(Debug, Clone, PartialEq)]
pub enum Member {
    Numbers(Array),
    Texts(TextArray),
}

/// Reads every array of `path`, numbers and texts.
pub fn open_members(path: &Path) -> Result<BTreeMap<String, Member>, ArrayError> {
    let bytes = files::read_bounded(path, LARGEST_FILE)?;
    let mut members = BTreeMap::new();
    super::unpack(
        &bytes,
        LARGEST_MEMORY,
        |_| true,
        |account, name, content| {
            members.insert(name.to_owned(), account.parse_member(name, content)?);
            Ok(())
        },
    )
    .map_err(|fault| ArrayError::InFile { fault: Box::new(fault), path: path.to_path_buf() })?;
    Ok(members)
}

/// Parses one `.npy` file of numbers or texts.
pub fn parse_member(name: &str, bytes: &[u8]) -> Result<Member, ArrayError> {
    Account { left: LARGEST_MEMORY, limit: LARGEST_MEMORY }.parse_member(name, bytes)
}

impl Account {
    fn parse_member(&mut self, name: &str, bytes: &[u8]) -> Result<Member, ArrayError> {
        let fail = |what: &str| ArrayError::Array { array: printable(name), what: what.to_owned() };
        let npy = Npy::read(name, bytes)?;
        let Some(width) = npy.descr.strip_prefix("<U") else {
            return self.parse_npy(name, bytes).map(Member::Numbers);
        };
        let width: usize = width.parse().map_err(|_| fail("has an unreadable header"))?;
        if npy.fortran && npy.shape.len() > 1 {
            return Err(fail("holds texts column by column, which is not supported"));
        }
        let mismatch = || fail("has another length than its shape says");
        let size = width.checked_mul(4).ok_or_else(mismatch)?;
        if npy.count.checked_mul(size) != Some(npy.data.len()) {
            return Err(mismatch());
        }
        // A text of its own for each element, with as many bytes as it has in the file at most.
        let texts = (npy.count as u64).saturating_mul(size_of::<String>() as u64);
        self.charge(name, texts.saturating_add(npy.data.len() as u64))?;
        let text = |bytes: &[u8]| -> Option<String> {
            let points = || bytes.as_chunks::<4>().0.iter().map(|&point| u32::from_le_bytes(point));
            let used = points().rposition(|point| point != 0).map_or(0, |last| last + 1);
            points().take(used).map(char::from_u32).collect()
        };
        let values = if size == 0 {
            vec![String::new(); npy.count]
        } else {
            let values = npy.data.chunks_exact(size).map(text).collect::<Option<Vec<_>>>();
            values.ok_or_else(|| fail("holds what is no Unicode"))?
        };
        Ok(Member::Texts(TextArray { shape: npy.shape, values }))
    }
}

/// Writes `members` to `path`.
pub fn write_npz(path: &Path, members: &BTreeMap<String, Member>) -> Result<(), ArrayError> {
    files::write_atomic_with(path, |file| {
        let mut archive = zip::ZipWriter::new(io::BufWriter::new(file));
        let options = SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated)
            .last_modified_time(zip::DateTime::default());
        for (name, member) in members {
            let content = to_npy(member);
            let options = options.large_file(content.len() as u64 >= u64::from(u32::MAX));
            archive.start_file(format!("{name}.npy"), options).map_err(io::Error::other)?;
            archive.write_all(&content)?;
        }
        archive.finish().map_err(io::Error::other)?.flush()
    })?;
    Ok(())
}

/// Writes one array to `path`.
pub fn write_npy(path: &Path, member: &Member) -> Result<(), ArrayError> {
    Ok(files::write_atomic(path, &to_npy(member))?)
}

/// The bytes of one `.npy` file.
fn to_npy(member: &Member) -> Vec<u8> {
    let (descr, shape, data): (String, &[usize], Vec<u8>) = match member {
        Member::Numbers(Array { shape, elements }) => match elements {
            Elements::F32(values) => {
                ("<f4".to_owned(), shape, values.iter().flat_map(|x| x.to_le_bytes()).collect())
            }
            Elements::F64(values) => {
                ("<f8".to_owned(), shape, values.iter().flat_map(|x| x.to_le_bytes()).collect())
            }
            Elements::I64(values) => {
                ("<i8".to_owned(), shape, values.iter().flat_map(|x| x.to_le_bytes()).collect())
            }
        },
        Member::Texts(TextArray { shape, values }) => {
            let width = values.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
            let padded = |text: &String| -> Vec<u32> {
                let points = text.chars().map(u32::from).chain(std::iter::repeat(0));
                points.take(width).collect()
            };
            let data = values.iter().flat_map(padded).flat_map(u32::to_le_bytes).collect();
            (format!("<U{width}"), shape, data)
        }
    };
    let axes: Vec<String> = shape.iter().map(ToString::to_string).collect();
    // A tuple of one has a comma.
    let axes = axes.join(", ") + if shape.len() == 1 { "," } else { "" };
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({axes}), }}");
    // Magic, version and length take 10 bytes; the data begins at a multiple of 64, after a line end.
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_texts_come_back_and_the_bytes_do_not_change() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let numbers =
            |shape: &[usize], elements| Member::Numbers(Array { shape: shape.to_vec(), elements });
        let texts = |values: &[&str]| {
            let values: Vec<String> = values.iter().map(|text| (*text).to_owned()).collect();
            Member::Texts(TextArray { shape: vec![values.len()], values })
        };
        let members = BTreeMap::from([
            (
                "a".to_owned(),
                numbers(&[2, 3], Elements::F64(vec![0.1, -0.0, 5e-324, 1e300, 2.0, 3.0])),
            ),
            ("b".to_owned(), numbers(&[], Elements::F32(vec![0.5]))),
            ("c".to_owned(), numbers(&[2], Elements::I64(vec![i64::MIN, 7]))),
            ("d".to_owned(), texts(&["Soleus", "", "μ-🦵"])),
            ("e".to_owned(), texts(&[])),
        ]);
        write_npz(&path, &members).unwrap();
        assert_eq!(open_members(&path).unwrap(), members);
        let bytes = std::fs::read(&path).unwrap();
        write_npz(&path, &members).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), bytes);
    }

    #[test]
    fn texts_that_are_none_are_refused() {
        let good =
            to_npy(&Member::Texts(TextArray { shape: vec![1], values: vec!["ab".to_owned()] }));
        let npy = |from: &str, to: &str| {
            let text = String::from_utf8_lossy(&good[10..74]).replace(from, to);
            [&good[..10], &text.as_bytes()[..64], &good[74..]].concat()
        };
        let mut no_unicode = good.clone();
        *no_unicode.last_mut().unwrap() = 0xff;
        for (bytes, why) in [
            (no_unicode, "no Unicode"),
            (npy("(1,)", "(9,)"), "another length"),
            (npy("<U2", "<U0"), "another length"),
            (npy("<U2", "<Ux"), "unreadable header"),
            (good[..good.len() - 1].to_vec(), "another length"),
        ] {
            let error = parse_member("x", &bytes).unwrap_err().to_string();
            assert!(error.contains(why), "{error}");
        }
    }
}
