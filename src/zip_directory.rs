//! The end of a zip archive, read before anything else of it: how many members it claims, and where its directory lies.
//!
//! The records at the end say how much memory the directory needs, and they may say anything. So they are checked here,
//! and the claim can be charged to an account, before the zip reader allocates for it. Only archives that fill their file
//! exactly are accepted: members, directory, end records, nothing after them. Where the directory lies has then one
//! answer, whoever reads it. Python, NumPy and torch write such archives.
//!
//! Reference: APPNOTE.TXT 6.3.10, §4.3.14 to §4.3.16.

/// Why an archive's end cannot be right.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DirectoryError {
    #[error(
        "archive is damaged: it does not end where the file ends; it is cut short, or something follows it"
    )]
    NoEnd,
    #[error("archive is one part of several")]
    Split,
    #[error(
        "archive claims a directory of {members} members in {length} bytes at byte {offset}, where there is none"
    )]
    Impossible { members: u64, length: u64, offset: u64 },
}

/// What the end of an archive says about its directory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Directory {
    pub members: u64,
    /// Bytes of the directory in the file.
    pub length: u64,
    offset: u64,
}

impl Directory {
    /// Reads the end of an archive that fills `bytes`.
    pub fn read(bytes: &[u8]) -> Result<Self, DirectoryError> {
        let (before, end) =
            bytes.split_last_chunk::<{ End::LENGTH }>().ok_or(DirectoryError::NoEnd)?;
        let end = End::read(end)?;
        let locator = before.split_last_chunk::<{ Wide::LOCATOR_LENGTH }>();
        let (directory, directory_end) = match locator {
            Some((before, locator)) if locator.starts_with(b"PK\x06\x07") => {
                let (before, wide) =
                    before.split_last_chunk::<{ Wide::LENGTH }>().ok_or(DirectoryError::NoEnd)?;
                (Wide::read(wide, locator, before.len() as u64, end)?, before.len() as u64)
            }
            _ => (end, before.len() as u64),
        };
        directory.check(directory_end)
    }

    /// Memory that reading the directory takes, in bytes: a record per member, and for every extra field, which may be
    /// as short as four bytes, a value of its own.
    #[must_use]
    pub fn memory(&self) -> u64 {
        (512 * self.members).saturating_add(self.length.saturating_mul(24))
    }

    /// Checks that the directory is large enough for its members and ends at `end`.
    fn check(self, end: u64) -> Result<Self, DirectoryError> {
        const SHORTEST_ENTRY: u64 = 46;
        let Self { members, length, offset } = self;
        let ends = offset.checked_add(length) == Some(end);
        let fits = members.checked_mul(SHORTEST_ENTRY).is_some_and(|least| least <= length);
        if ends && fits {
            Ok(self)
        } else {
            Err(DirectoryError::Impossible { members, length, offset })
        }
    }
}

/// The end record that every archive has.
struct End;

impl End {
    const LENGTH: usize = 22;

    fn read(record: &[u8; Self::LENGTH]) -> Result<Directory, DirectoryError> {
        if !record.starts_with(b"PK\x05\x06") || number(&record[20..22]) != 0 {
            return Err(DirectoryError::NoEnd);
        }
        let members = number(&record[10..12]);
        one_part(number(&record[4..6]), number(&record[6..8]), number(&record[8..10]), members)?;
        let (length, offset) = (number(&record[12..16]), number(&record[16..20]));
        Ok(Directory { members, length, offset })
    }
}

/// The record with wider numbers (ZIP64) that may come before it, and the locator between the two.
struct Wide;

impl Wide {
    const LENGTH: usize = 56;
    const LOCATOR_LENGTH: usize = 20;

    /// Reads the record at byte `position`. The narrow record must say the same or "see there".
    fn read(
        record: &[u8; Self::LENGTH],
        locator: &[u8; Self::LOCATOR_LENGTH],
        position: u64,
        narrow: Directory,
    ) -> Result<Directory, DirectoryError> {
        // The record states its length without its first twelve bytes; a longer one would hold data that nobody needs.
        let expected = Self::LENGTH as u64 - 12;
        let is_record = record.starts_with(b"PK\x06\x06") && number(&record[4..12]) == expected;
        if !is_record || number(&locator[8..16]) != position {
            return Err(DirectoryError::NoEnd);
        }
        let members = number(&record[32..40]);
        one_part(
            number(&record[16..20]),
            number(&record[20..24]),
            number(&record[24..32]),
            members,
        )?;
        let (length, offset) = (number(&record[40..48]), number(&record[48..56]));
        let agrees = |narrow: u64, wide: u64, elsewhere: u64| narrow == wide || narrow == elsewhere;
        if agrees(narrow.members, members, 0xffff)
            && agrees(narrow.length, length, 0xffff_ffff)
            && agrees(narrow.offset, offset, 0xffff_ffff)
        {
            Ok(Directory { members, length, offset })
        } else {
            Err(DirectoryError::Impossible { members, length, offset })
        }
    }
}

fn one_part(disk: u64, first_disk: u64, here: u64, members: u64) -> Result<(), DirectoryError> {
    if disk == 0 && first_disk == 0 && here == members {
        Ok(())
    } else {
        Err(DirectoryError::Split)
    }
}

/// A little-endian number of up to eight bytes.
fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An end record for `members` in `length` bytes at `offset`.
    fn end(members: u16, length: u32, offset: u32) -> Vec<u8> {
        let mut record = b"PK\x05\x06\0\0\0\0".to_vec();
        record.extend([members.to_le_bytes(), members.to_le_bytes()].concat());
        record.extend([length.to_le_bytes(), offset.to_le_bytes()].concat());
        record.extend([0, 0]);
        record
    }

    #[test]
    fn a_directory_is_where_the_end_says_or_nowhere() {
        let file = |record: Vec<u8>| [vec![0; 100], record].concat();
        let right = Directory::read(&file(end(2, 92, 8))).unwrap();
        assert_eq!((right.members, right.length, right.offset), (2, 92, 8));
        for (members, length, offset) in [(2, 92, 7), (2, 91, 9), (3, 92, 8), (0, u32::MAX, 8)] {
            let refused = Directory::read(&file(end(members, length, offset)));
            assert!(matches!(refused, Err(DirectoryError::Impossible { .. })), "{refused:?}");
        }
    }

    #[test]
    fn nothing_may_follow_the_end() {
        let file = [vec![0; 100], end(2, 92, 8)].concat();
        assert_eq!(Directory::read(&file[..121]), Err(DirectoryError::NoEnd));
        assert_eq!(Directory::read(&[&file[..], b"x"].concat()), Err(DirectoryError::NoEnd));
        assert_eq!(Directory::read(b""), Err(DirectoryError::NoEnd));
    }
}
