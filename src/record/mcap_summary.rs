//! Puts the schemas and channels of an MCAP file's summary in the order of their numbers.
//!
//! The library repeats them there in the order of a hash map, which is another in every run. The records keep their
//! lengths, so only their places change, and with them the summary's checksum.
//!
//! The file ends with the footer (opcode, length, start of the summary, start of its offsets, checksum) and the magic
//! bytes; the checksum is CRC-32 of everything from the start of the summary to itself.

use std::io::{self, Read, Seek, SeekFrom, Write};

/// Opcode and length.
const RECORD_HEAD: usize = 1 + 8;
const FOOTER: usize = RECORD_HEAD + 8 + 8 + 4;
const MAGIC: usize = 8;
const CHECKSUM: usize = 4;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;

/// Sorts the summary of the complete file `file`.
pub(super) fn sort(file: &mut (impl Read + Write + Seek)) -> io::Result<()> {
    let damaged = || io::Error::other("the MCAP library wrote a summary that is not one");
    let end = file.seek(SeekFrom::End(-((FOOTER + MAGIC) as i64)))?;
    let mut footer = [0; FOOTER];
    file.read_exact(&mut footer)?;
    let start = footer[RECORD_HEAD..].first_chunk::<8>().map(|b| u64::from_le_bytes(*b));
    let start = start.filter(|&start| 0 < start && start <= end).ok_or_else(damaged)?;
    file.seek(SeekFrom::Start(start))?;
    let mut summary = vec![0; (end - start) as usize];
    file.read_exact(&mut summary)?;
    let mut sorted = in_order(&summary).ok_or_else(damaged)?;
    sorted.extend_from_slice(&footer[..FOOTER - CHECKSUM]);
    let checksum = crc32(&sorted);
    sorted.extend_from_slice(&checksum.to_le_bytes());
    file.seek(SeekFrom::Start(start))?;
    file.write_all(&sorted)?;
    file.seek(SeekFrom::End(0)).map(drop)
}

/// The records of a summary, runs of schemas and of channels sorted by number.
fn in_order(summary: &[u8]) -> Option<Vec<u8>> {
    let mut records = Vec::new();
    let mut rest = summary;
    while let Some((&opcode, after)) = rest.split_first() {
        let length = usize::try_from(u64::from_le_bytes(*after.first_chunk::<8>()?)).ok()?;
        let (record, others) = rest.split_at_checked(RECORD_HEAD.checked_add(length)?)?;
        // Both kinds begin with their number.
        let number = record.get(RECORD_HEAD..RECORD_HEAD + 2)?.try_into().ok()?;
        records.push((opcode, u16::from_le_bytes(number), record));
        rest = others;
    }
    for run in records.chunk_by_mut(|(a, ..), (b, ..)| a == b) {
        if matches!(run[0].0, SCHEMA | CHANNEL) {
            run.sort_by_key(|(_, number, _)| *number);
        }
    }
    Some(records.into_iter().flat_map(|(.., record)| record).copied().collect())
}

/// CRC-32 as in zip and Ethernet.
pub(super) fn crc32(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut byte = 0;
        while byte < table.len() {
            let mut crc = byte as u32;
            let mut bit = 0;
            while bit < 8 {
                crc = (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg());
                bit += 1;
            }
            table[byte] = crc;
            byte += 1;
        }
        table
    };
    !bytes.iter().fold(!0_u32, |crc, &byte| (crc >> 8) ^ TABLE[usize::from(crc as u8 ^ byte)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_the_published_one() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn schemas_and_channels_are_sorted_and_nothing_else_moves() {
        let record = |opcode: u8, number: u16| {
            let mut bytes = vec![opcode];
            bytes.extend(3_u64.to_le_bytes());
            bytes.extend(number.to_le_bytes());
            bytes.push(7);
            bytes
        };
        let join = |list: &[(u8, u16)]| -> Vec<u8> {
            list.iter().flat_map(|&(opcode, number)| record(opcode, number)).collect()
        };
        let mixed = join(&[(3, 2), (3, 1), (4, 300), (4, 2), (14, 9), (14, 1)]);
        let want = join(&[(3, 1), (3, 2), (4, 2), (4, 300), (14, 9), (14, 1)]);
        assert_eq!(in_order(&mixed), Some(want));
        assert_eq!(in_order(&mixed[..20]), None);
    }
}
