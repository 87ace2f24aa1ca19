//! Bounded zip reading: stored and deflated members, looked up by their exact name.
//!
//! Refused before any member is read: an archive that does not fill its file, two members of one name, members that
//! share bytes, names that lead elsewhere, members whose own header says something else than the directory, encrypted
//! members, symbolic links, sizes and compression ratios above the limits, other compression methods. Nothing is ever
//! written to disk.
//! A nested archive is borrowed from the bytes around it when it is stored, so that its unneeded members cost nothing.

use std::borrow::Cow;
use std::collections::HashSet;
use std::io::{Cursor, Read};

use zip::CompressionMethod;
use zip::read::{ArchiveOffset, Config, ZipArchive};
use zip::result::ZipError;

use super::limits::{Budget, LimitExceeded, check};
use super::records::printable;
use crate::zip_directory::{Directory, DirectoryError};

/// Why a zip archive cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    #[error("archive is damaged: {0}")]
    Damaged(ZipError),
    #[error(transparent)]
    Directory(#[from] DirectoryError),
    #[error("archive holds two members of the same name")]
    DuplicateMember,
    #[error("archive does not start where the file starts")]
    Displaced,
    #[error("archive members share bytes")]
    OverlappingMembers,
    #[error("archive says one thing in its directory and another before its members: {0}")]
    Contradiction(ZipError),
    #[error("archive member `{member}` is missing")]
    MissingMember { member: String },
    #[error("archive member `{member}` is encrypted")]
    EncryptedMember { member: String },
    #[error("archive member `{member}` is a symbolic link")]
    SymbolicLink { member: String },
    #[error("archive member `{member}` has a name that is no plain path below the archive")]
    UnsafeName { member: String },
    #[error("archive member `{member}` is packed with {method}; only stored and deflated are read")]
    UnknownCompression { member: String, method: CompressionMethod },
    #[error("archive member `{member}` cannot be unpacked: {fault}")]
    DamagedMember { member: String, fault: std::io::Error },
    #[error("archive member `{member}` has {found} bytes, its header says {expected}")]
    WrongLength { member: String, expected: u64, found: u64 },
    #[error("archive: {0}")]
    TooManyMembers(LimitExceeded),
    #[error("archive member `{member}`: {fault}")]
    MemberTooLarge { member: String, fault: LimitExceeded },
}

/// An open archive over bytes in memory.
pub(super) struct Archive<'a> {
    bytes: &'a [u8],
    zip: ZipArchive<Cursor<&'a [u8]>>,
}

impl<'a> Archive<'a> {
    /// Reads the directory of the archive and checks every entry of it.
    pub(super) fn open(bytes: &'a [u8], budget: &mut Budget) -> Result<Self, ArchiveError> {
        if !bytes.starts_with(b"PK\x03\x04") {
            return Err(ArchiveError::Displaced);
        }
        // The directory's own account of itself comes first: the zip reader allocates by it.
        let directory = Directory::read(bytes)?;
        check("members", directory.members, budget.limits.members)
            .and_then(|()| budget.charge_memory(directory.memory()))
            .map_err(ArchiveError::TooManyMembers)?;
        let config = Config { archive_offset: ArchiveOffset::Known(0) };
        let mut zip =
            ZipArchive::with_config(config, Cursor::new(bytes)).map_err(ArchiveError::Damaged)?;
        if zip.has_duplicate_names() || differ_by_case_only(&zip) {
            return Err(ArchiveError::DuplicateMember);
        }
        for index in 0..zip.len() {
            check_entry(&zip, index, budget)?;
        }
        if zip.has_overlapping_entries().map_err(ArchiveError::Damaged)? {
            return Err(ArchiveError::OverlappingMembers);
        }
        zip.validate_header_consistency().map_err(ArchiveError::Contradiction)?;
        Ok(Self { bytes, zip })
    }

    /// All names, in the order of the directory.
    pub(super) fn names(&self) -> Vec<String> {
        self.zip.file_names_raw().map(|name| String::from_utf8_lossy(name).into_owned()).collect()
    }

    /// Whether a member has exactly this name.
    pub(super) fn contains(&self, member: &str) -> bool {
        self.zip.index_for_name(member).is_some()
    }

    /// A member's content, its checksum verified.
    pub(super) fn read(
        &mut self,
        member: &str,
        budget: &mut Budget,
    ) -> Result<Vec<u8>, ArchiveError> {
        let mut content = Vec::new();
        self.read_into(member, &mut content, budget)?;
        Ok(content)
    }

    /// Replaces `content` by a member's content, its checksum verified. Charges the memory it adds.
    pub(super) fn read_into(
        &mut self,
        member: &str,
        content: &mut Vec<u8>,
        budget: &mut Budget,
    ) -> Result<(), ArchiveError> {
        let index = self.index(member)?;
        let file = self.zip.by_index(index).map_err(ArchiveError::Damaged)?;
        let expected = file.size();
        budget
            .charge_memory(expected.saturating_sub(content.capacity() as u64))
            .map_err(|fault| ArchiveError::MemberTooLarge { member: printable(member), fault })?;
        content.clear();
        content.reserve_exact(usize::try_from(expected).unwrap_or(0));
        // One byte more than announced is enough to notice a header that lies.
        file.take(expected.saturating_add(1))
            .read_to_end(content)
            .map_err(|fault| ArchiveError::DamagedMember { member: printable(member), fault })?;
        let found = content.len() as u64;
        if found != expected {
            return Err(ArchiveError::WrongLength { member: printable(member), expected, found });
        }
        Ok(())
    }

    /// A member that is an archive itself: borrowed if stored, unpacked otherwise. The checksum of a borrowed member
    /// is left unread, because each of its own members carries one.
    pub(super) fn nested(
        &mut self,
        member: &str,
        budget: &mut Budget,
    ) -> Result<Cow<'a, [u8]>, ArchiveError> {
        let index = self.index(member)?;
        let file = self.zip.by_index_raw(index).map_err(ArchiveError::Damaged)?;
        if file.compression() != CompressionMethod::Stored {
            drop(file);
            return self.read(member, budget).map(Cow::Owned);
        }
        let (start, length) = (file.data_start(), file.size());
        let slice = start
            .and_then(|start| {
                Some(
                    usize::try_from(start).ok()?
                        ..usize::try_from(start.checked_add(length)?).ok()?,
                )
            })
            .and_then(|range| self.bytes.get(range));
        slice.map(Cow::Borrowed).ok_or_else(|| ArchiveError::WrongLength {
            member: printable(member),
            expected: length,
            found: (self.bytes.len() as u64).saturating_sub(start.unwrap_or(0)),
        })
    }

    fn index(&self, member: &str) -> Result<usize, ArchiveError> {
        let missing = || ArchiveError::MissingMember { member: printable(member) };
        self.zip.index_for_name(member).ok_or_else(missing)
    }
}

/// Whether two names would be one file on a system that does not tell small letters from capitals.
fn differ_by_case_only(zip: &ZipArchive<Cursor<&[u8]>>) -> bool {
    let mut seen = HashSet::new();
    !zip.file_names_raw().all(|name| seen.insert(name.to_ascii_lowercase()))
}

/// Refuses what no checkpoint needs, from the directory alone.
fn check_entry(
    zip: &ZipArchive<Cursor<&[u8]>>,
    index: usize,
    budget: &Budget,
) -> Result<(), ArchiveError> {
    let entry = zip.by_index_data(index).map_err(ArchiveError::Damaged)?;
    let member = printable(&String::from_utf8_lossy(entry.name_raw()));
    if !is_plain_path(entry.name_raw()) {
        return Err(ArchiveError::UnsafeName { member });
    }
    if entry.encrypted() {
        return Err(ArchiveError::EncryptedMember { member });
    }
    if entry.is_symlink() {
        return Err(ArchiveError::SymbolicLink { member });
    }
    let (packed, unpacked) = (entry.compressed_size(), entry.size());
    match entry.compression() {
        CompressionMethod::Stored if packed != unpacked => {
            return Err(ArchiveError::WrongLength { member, expected: unpacked, found: packed });
        }
        CompressionMethod::Stored | CompressionMethod::Deflated => {}
        method => return Err(ArchiveError::UnknownCompression { member, method }),
    }
    let ratio = unpacked / packed.max(1);
    check("unpacked bytes", unpacked, budget.limits.member_bytes)
        .and_then(|()| check("times its packed size", ratio, budget.limits.compression_ratio))
        .map_err(|fault| ArchiveError::MemberTooLarge { member, fault })
}

/// Whether a member's name would stay below the folder that somebody unpacks it in, and is one that can be shown.
fn is_plain_path(name: &[u8]) -> bool {
    const LONGEST: usize = 1_000;
    let Ok(name) = std::str::from_utf8(name) else { return false };
    let escapes = name.starts_with('/') || name.split('/').any(|part| part == "..");
    let is_odd = |c: char| c.is_control() || matches!(c, '\\' | ':');
    !name.is_empty() && name.len() <= LONGEST && !escapes && !name.contains(is_odd)
}
