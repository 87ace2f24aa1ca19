//! Unpacking a chunk of an MCAP file: the records inside, after the checksum has been compared.
//!
//! The MCAP library can do this too, but does not come back from a chunk that unpacks to fewer bytes than it claims.

use mcap::records::{ChunkHeader, Record};

use super::RecordError;

/// Opcode and length of a record.
const HEAD: usize = 1 + 8;

/// CRC-32 as in zip and Ethernet.
pub(super) fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// Why a chunk cannot be unpacked.
pub(super) enum ChunkError {
    /// The chunk is damaged, in words.
    Damaged(String),
    /// What `on_record` said.
    Record(RecordError),
}

/// Calls `on_record` for every record in a chunk of at most `limit` bytes, until it says that it has seen enough. Gives
/// what it said last.
pub(super) fn for_each(
    header: &ChunkHeader,
    data: &[u8],
    limit: usize,
    on_record: &mut dyn FnMut(Record<'_>) -> Result<bool, RecordError>,
) -> Result<bool, ChunkError> {
    let damaged = |what: &str| ChunkError::Damaged(format!("a chunk {what}"));
    let size = usize::try_from(header.uncompressed_size).ok().filter(|&size| size <= limit);
    let size = size.ok_or_else(|| damaged("claims to be too large"))?;
    let unpacked;
    let mut rest = match header.compression.as_str() {
        "" => data,
        "zstd" => {
            let result = zstd::bulk::decompress(data, size);
            unpacked = result.map_err(|error| damaged(&format!("cannot be unpacked: {error}")))?;
            unpacked.as_slice()
        }
        other => return Err(damaged(&format!("is packed with `{other}`, not with zstd"))),
    };
    if rest.len() != size {
        return Err(damaged(&format!("has {} bytes, expected {size}", rest.len())));
    }
    // 0 means that the writer took no checksum.
    if header.uncompressed_crc != 0 && header.uncompressed_crc != crc32(rest) {
        return Err(damaged("does not have its checksum"));
    }
    while let Some((&opcode, after)) = rest.split_first() {
        let cut = || damaged("ends inside a record");
        let length = after.first_chunk::<8>().map(|bytes| u64::from_le_bytes(*bytes));
        let length = length.and_then(|length| usize::try_from(length).ok()).ok_or_else(cut)?;
        let end = length.checked_add(HEAD).ok_or_else(cut)?;
        let (record, others) = rest.split_at_checked(end).ok_or_else(cut)?;
        let record = mcap::parse_record(opcode, &record[HEAD..])
            .map_err(|error| ChunkError::Damaged(error.to_string()))?;
        if !on_record(record).map_err(ChunkError::Record)? {
            return Ok(false);
        }
        rest = others;
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_the_published_one() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    }
}
