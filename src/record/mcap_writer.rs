//! Writing an MCAP file whose chunks are made on one thread and packed on others, and which says the same thing in the same
//! bytes however many they are.
//!
//! The library's writer hands every field of every message to the compressor on its own, on the thread that makes the
//! messages, and lists its summary in the order of a hash map. Packing is most of the work: digits pack at some 350 MB/s. So
//! here a chunk is one run of memory; it goes to the next packing thread in turn, and comes back in the same order.
//!
//! The file: header, metadata, schemas and channels; chunks, each followed by an index of its messages by channel; the end
//! of the data with its CRC-32; then a summary with schemas and channels once more, statistics and all indexes, where
//! they begin, and its own CRC-32 (<https://mcap.dev/spec>). Numbers are little-endian; a text is preceded by its length.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::num::NonZeroUsize;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use flate2::Crc;
use mcap::records::op;

use super::mcap_chunk::crc32;

/// Strength of zstd: digits pack little better with more, and take longer.
const LEVEL: i32 = 1;
/// Unpacked size of a chunk.
const CHUNK: usize = 1 << 20;
/// More threads than this would wait for the one that makes the chunks.
const MOST_THREADS: usize = 4;
const COMPRESSION: &str = "zstd";
const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// The body of a record, being filled.
#[derive(Default)]
struct Body(Vec<u8>);

impl Body {
    fn u16(mut self, value: u16) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u64(mut self, value: u64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    /// A text or a list, preceded by its length in bytes.
    fn bytes(mut self, bytes: &[u8]) -> Self {
        self = self.u32(bytes.len() as u32);
        self.0.extend(bytes);
        self
    }

    fn pairs(self, pairs: &BTreeMap<String, String>) -> Self {
        let all = pairs.iter().fold(Self::default(), |all, (key, value)| {
            all.bytes(key.as_bytes()).bytes(value.as_bytes())
        });
        self.bytes(&all.0)
    }

    /// One number for each channel.
    fn by_channel(self, numbers: impl Iterator<Item = (u16, u64)>) -> Self {
        let all = numbers.fold(Self::default(), |all, (id, number)| all.u16(id).u64(number));
        self.bytes(&all.0)
    }
}

/// Messages that are packed together.
#[derive(Default)]
pub(super) struct Chunk {
    records: Vec<u8>,
    /// Log times of its first and last message.
    times: Option<(u64, u64)>,
    /// By channel: log time and place of every message.
    index: BTreeMap<u16, Vec<(u64, u64)>>,
}

impl Chunk {
    /// Whether the next message belongs into another chunk.
    pub(super) fn is_full(&self) -> bool {
        self.records.len() >= CHUNK
    }

    /// Whether it has no message.
    pub(super) fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Adds a message, whose text `write` appends. Times may not run back.
    pub(super) fn add(
        &mut self,
        channel: u16,
        sequence: u32,
        time: u64,
        write: impl FnOnce(&mut Vec<u8>),
    ) {
        let start = self.records.len();
        self.times = Some((self.times.map_or(time, |(first, _)| first), time));
        self.index.entry(channel).or_default().push((time, start as u64));
        self.records.push(op::MESSAGE);
        let length_at = self.records.len();
        self.records.extend([0; 8]);
        let body_at = self.records.len();
        self.records.extend(channel.to_le_bytes());
        self.records.extend(sequence.to_le_bytes());
        // When it was made and when it was said is the same here.
        self.records.extend(time.to_le_bytes());
        self.records.extend(time.to_le_bytes());
        write(&mut self.records);
        let length = (self.records.len() - body_at) as u64;
        self.records[length_at..body_at].copy_from_slice(&length.to_le_bytes());
    }

    fn pack(self, packer: &mut zstd::bulk::Compressor<'_>) -> io::Result<Packed> {
        Ok(Packed {
            size: self.records.len() as u64,
            checksum: crc32(&self.records),
            records: packer.compress(&self.records)?,
            times: self.times.unwrap_or_default(),
            index: self.index,
        })
    }
}

/// A chunk as it is written.
struct Packed {
    /// Unpacked.
    size: u64,
    /// Of what is unpacked.
    checksum: u32,
    records: Vec<u8>,
    times: (u64, u64),
    index: BTreeMap<u16, Vec<(u64, u64)>>,
}

/// Where chunks go to be packed, and where they come back.
type Packer = (SyncSender<Chunk>, Receiver<io::Result<Packed>>);

/// The file being written.
pub(super) struct Writer<W> {
    out: W,
    /// Bytes so far.
    position: u64,
    checksum: Crc,
    /// Records of the summary, by kind.
    schemas: Vec<u8>,
    channels: Vec<u8>,
    chunk_indexes: Vec<u8>,
    metadata_indexes: Vec<u8>,
    metadata_count: u32,
    channel_count: u16,
    chunk_count: u32,
    /// Messages of each channel.
    messages: BTreeMap<u16, u64>,
    times: Option<(u64, u64)>,
}

impl<W: Write> Writer<W> {
    /// A file made by `library`.
    pub(super) fn new(out: W, library: &str) -> io::Result<Self> {
        let mut writer = Self {
            out,
            position: 0,
            checksum: Crc::new(),
            schemas: Vec::new(),
            channels: Vec::new(),
            chunk_indexes: Vec::new(),
            metadata_indexes: Vec::new(),
            metadata_count: 0,
            channel_count: 0,
            chunk_count: 0,
            messages: BTreeMap::new(),
            times: None,
        };
        writer.put(MAGIC)?;
        let profile = "";
        let header = Body::default().bytes(profile.as_bytes()).bytes(library.as_bytes());
        writer.record(op::HEADER, &header)?;
        Ok(writer)
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.checksum.update(bytes);
        self.position += bytes.len() as u64;
        self.out.write_all(bytes)
    }

    fn record(&mut self, kind: u8, body: &Body) -> io::Result<()> {
        self.put(&record(kind, body))
    }

    /// Pairs of words that belong to the file as a whole.
    pub(super) fn metadata(
        &mut self,
        name: &str,
        pairs: &BTreeMap<String, String>,
    ) -> io::Result<()> {
        let start = self.position;
        self.record(op::METADATA, &Body::default().bytes(name.as_bytes()).pairs(pairs))?;
        let index = Body::default().u64(start).u64(self.position - start).bytes(name.as_bytes());
        self.metadata_indexes.extend(record(op::METADATA_INDEX, &index));
        self.metadata_count += 1;
        Ok(())
    }

    /// A channel of JSON messages that look as `schema` says; its number.
    pub(super) fn channel(
        &mut self,
        name: &str,
        schema: &str,
        pairs: &BTreeMap<String, String>,
    ) -> io::Result<u16> {
        let id = self.channel_count;
        // Schema 0 would mean that there is none.
        let schema_id = id + 1;
        let schema = Body::default()
            .u16(schema_id)
            .bytes(name.as_bytes())
            .bytes(b"jsonschema")
            .bytes(schema.as_bytes());
        let schema = record(op::SCHEMA, &schema);
        let topic = format!("/{name}");
        let channel = Body::default()
            .u16(id)
            .u16(schema_id)
            .bytes(topic.as_bytes())
            .bytes(b"json")
            .pairs(pairs);
        let channel = record(op::CHANNEL, &channel);
        self.put(&schema)?;
        self.put(&channel)?;
        self.schemas.extend(schema);
        self.channels.extend(channel);
        self.channel_count += 1;
        Ok(id)
    }

    /// Writes the chunks that `make` hands over, in that order.
    pub(super) fn chunks(
        &mut self,
        make: impl FnOnce(&mut dyn FnMut(Chunk) -> io::Result<()>) -> io::Result<()>,
    ) -> io::Result<()> {
        let threads = thread::available_parallelism().map_or(1, NonZeroUsize::get);
        self.chunks_packed_by(threads.min(MOST_THREADS), make)
    }

    fn chunks_packed_by(
        &mut self,
        threads: usize,
        make: impl FnOnce(&mut dyn FnMut(Chunk) -> io::Result<()>) -> io::Result<()>,
    ) -> io::Result<()> {
        thread::scope(|scope| {
            let packers: Vec<Packer> = (0..threads)
                .map(|_| {
                    let (chunks, unpacked) = sync_channel::<Chunk>(1);
                    let (packed, done) = sync_channel(1);
                    scope.spawn(move || {
                        let mut packer = zstd::bulk::Compressor::new(LEVEL);
                        for chunk in unpacked {
                            let result = match &mut packer {
                                Ok(packer) => chunk.pack(packer),
                                Err(error) => Err(io::Error::other(error.to_string())),
                            };
                            if packed.send(result).is_err() {
                                return;
                            }
                        }
                    });
                    (chunks, done)
                })
                .collect();
            let gone = || io::Error::other("a thread that packs chunks has ended");
            let back = |place: usize, writer: &mut Self| -> io::Result<()> {
                let (_, done) = &packers[place % packers.len()];
                writer.chunk(done.recv().map_err(|_| gone())??)
            };
            let mut sent = 0_usize;
            make(&mut |chunk| {
                // Everyone has one at hand and one waiting.
                if let Some(place) = sent.checked_sub(2 * packers.len()) {
                    back(place, self)?;
                }
                let (chunks, _) = &packers[sent % packers.len()];
                sent += 1;
                chunks.send(chunk).map_err(|_| gone())
            })?;
            (sent.saturating_sub(2 * packers.len())..sent).try_for_each(|place| back(place, self))
        })
    }

    fn chunk(&mut self, chunk: Packed) -> io::Result<()> {
        let Packed { size, checksum, records, times: (first, last), index } = chunk;
        let start = self.position;
        let packed = records.len() as u64;
        let head = Body::default()
            .u64(first)
            .u64(last)
            .u64(size)
            .u32(checksum)
            .bytes(COMPRESSION.as_bytes())
            .u64(packed);
        self.put(&[op::CHUNK])?;
        self.put(&(head.0.len() as u64 + packed).to_le_bytes())?;
        self.put(&head.0)?;
        self.put(&records)?;
        let length = self.position - start;
        let mut places = Vec::with_capacity(index.len());
        for (&id, messages) in &index {
            places.push((id, self.position));
            let entry = |all: Body, &(time, place): &(u64, u64)| all.u64(time).u64(place);
            let entries = messages.iter().fold(Body::default(), entry);
            self.record(op::MESSAGE_INDEX, &Body::default().u16(id).bytes(&entries.0))?;
            *self.messages.entry(id).or_default() += messages.len() as u64;
        }
        let index = Body::default()
            .u64(first)
            .u64(last)
            .u64(start)
            .u64(length)
            .by_channel(places.into_iter())
            .u64(self.position - start - length)
            .bytes(COMPRESSION.as_bytes())
            .u64(packed)
            .u64(size);
        self.chunk_indexes.extend(record(op::CHUNK_INDEX, &index));
        self.chunk_count += 1;
        self.times = Some((self.times.map_or(first, |(first, _)| first), last));
        Ok(())
    }

    /// Writes what belongs at the end.
    pub(super) fn finish(mut self) -> io::Result<()> {
        let checksum = self.checksum.sum();
        self.record(op::DATA_END, &Body::default().u32(checksum))?;
        let start = self.position;
        self.checksum = Crc::new();
        let (first, last) = self.times.unwrap_or_default();
        let statistics = Body::default()
            .u64(self.messages.values().sum())
            .u16(self.channel_count)
            .u32(u32::from(self.channel_count))
            .u32(0)
            .u32(self.metadata_count)
            .u32(self.chunk_count)
            .u64(first)
            .u64(last)
            .by_channel(self.messages.iter().map(|(&id, &count)| (id, count)));
        let mut offsets = Vec::new();
        for (kind, records) in [
            (op::SCHEMA, std::mem::take(&mut self.schemas)),
            (op::CHANNEL, std::mem::take(&mut self.channels)),
            (op::STATISTICS, record(op::STATISTICS, &statistics)),
            (op::CHUNK_INDEX, std::mem::take(&mut self.chunk_indexes)),
            (op::METADATA_INDEX, std::mem::take(&mut self.metadata_indexes)),
        ] {
            if !records.is_empty() {
                let mut offset = Body(vec![kind]);
                offset = offset.u64(self.position).u64(records.len() as u64);
                offsets.extend(record(op::SUMMARY_OFFSET, &offset));
                self.put(&records)?;
            }
        }
        let offsets_start = self.position;
        self.put(&offsets)?;
        let footer = Body::default().u64(start).u64(offsets_start);
        let with_checksum = footer.0.len() as u64 + 4;
        self.put(&[op::FOOTER])?;
        self.put(&with_checksum.to_le_bytes())?;
        self.put(&footer.0)?;
        // The checksum is of everything in the summary before itself.
        let checksum = self.checksum.sum();
        self.put(&checksum.to_le_bytes())?;
        self.put(MAGIC)?;
        self.out.flush()
    }
}

/// A record with its kind and its length.
fn record(kind: u8, body: &Body) -> Vec<u8> {
    let mut record = vec![kind];
    record.extend((body.0.len() as u64).to_le_bytes());
    record.extend(&body.0);
    record
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of `count` chunks of one message each, which are all different.
    fn file(count: u64, threads: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes, "test").unwrap();
        let pairs = BTreeMap::from([("a".to_owned(), "b".to_owned())]);
        writer.metadata("words", &pairs).unwrap();
        let id = writer.channel("joint", "{}", &pairs).unwrap();
        let make = |hand_over: &mut dyn FnMut(Chunk) -> io::Result<()>| {
            (0..count).try_for_each(|number| {
                let mut chunk = Chunk::default();
                chunk.add(id, number as u32, 10 * number, |text| {
                    text.extend(number.to_string().repeat(1000).bytes());
                });
                hand_over(chunk)
            })
        };
        writer.chunks_packed_by(threads, make).unwrap();
        writer.finish().unwrap();
        bytes
    }

    #[test]
    fn the_bytes_do_not_depend_on_how_many_threads_pack() {
        for count in [0, 1, 2, 5, 40] {
            let one = file(count, 1);
            for threads in 2..6 {
                assert!(file(count, threads) == one, "{count} chunks, {threads} threads");
            }
        }
    }

    #[test]
    fn the_library_finds_messages_summary_and_checksums() {
        let bytes = file(40, 3);
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let stats = summary.stats.as_ref().unwrap();
        assert_eq!((stats.chunk_count, stats.message_count, stats.metadata_count), (40, 40, 1));
        assert_eq!((stats.message_start_time, stats.message_end_time), (0, 390));
        assert_eq!(stats.channel_message_counts, BTreeMap::from([(0, 40)]));
        assert_eq!(summary.metadata_indexes[0].name, "words");
        let chunk = &summary.chunk_indexes[7];
        assert_eq!((chunk.message_start_time, chunk.message_end_time), (70, 70));
        let indexes = summary.read_message_indexes(&bytes, chunk).unwrap();
        assert_eq!(indexes.values().map(Vec::len).sum::<usize>(), 1);
        // Reading compares the checksums of chunks and data.
        let messages: Vec<mcap::Message<'_>> =
            mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
        assert_eq!((messages.len(), messages[7].log_time, messages[7].sequence), (40, 70, 7));
        assert_eq!(messages[7].channel.topic, "/joint");
        assert_eq!(messages[7].data[..], *b"7".repeat(1000));
    }

    #[test]
    fn an_error_on_the_way_ends_the_threads_too() {
        let mut writer = Writer::new(io::sink(), "test").unwrap();
        let made = writer.chunks_packed_by(2, |hand_over| {
            (0..7).try_for_each(|_| hand_over(Chunk::default()))?;
            Err(io::Error::other("no more"))
        });
        assert_eq!(made.unwrap_err().to_string(), "no more");
    }
}
