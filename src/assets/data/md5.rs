//! MD5 (RFC 1321), because the published records state nothing better.
//!
//! It tells whether a file came over whole. It is no defence against somebody who can make two files with one MD5; the
//! receipt therefore holds SHA-256. Input: bytes in pieces of any size; output: 32 hexadecimal digits.

use std::fmt::Write as _;

const BLOCK: usize = 64;
/// How far each step rotates: four amounts per round, in turn.
const ROTATIONS: [[u32; 4]; 4] =
    [[7, 12, 17, 22], [5, 9, 14, 20], [4, 11, 16, 23], [6, 10, 15, 21]];

/// A sum that grows with every piece.
#[derive(Debug, Clone)]
pub(super) struct Md5 {
    state: [u32; 4],
    /// Entry `i` is the whole part of 2³² · |sin(i + 1)|.
    sines: [u32; 64],
    pending: [u8; BLOCK],
    filled: usize,
    length: u64,
}

impl Md5 {
    /// The sum of nothing yet.
    pub(super) fn new() -> Self {
        let sine = |step: usize| ((step as f64 + 1.0).sin().abs() * 4_294_967_296.0) as u32;
        Self {
            state: [0x6745_2301, 0xefcd_ab89, 0x98ba_dcfe, 0x1032_5476],
            sines: std::array::from_fn(sine),
            pending: [0; BLOCK],
            filled: 0,
            length: 0,
        }
    }

    /// Adds a piece.
    pub(super) fn update(&mut self, mut bytes: &[u8]) {
        self.length = self.length.wrapping_add(bytes.len() as u64);
        if self.filled > 0 {
            let taken = bytes.len().min(BLOCK - self.filled);
            self.pending[self.filled..self.filled + taken].copy_from_slice(&bytes[..taken]);
            self.filled += taken;
            bytes = &bytes[taken..];
            if self.filled < BLOCK {
                return;
            }
            let block = self.pending;
            self.absorb(&block);
        }
        let (blocks, rest) = bytes.as_chunks::<BLOCK>();
        for block in blocks {
            self.absorb(block);
        }
        self.pending[..rest.len()].copy_from_slice(rest);
        self.filled = rest.len();
    }

    /// The sum as 32 lower-case hexadecimal digits.
    pub(super) fn finish(mut self) -> String {
        let bits = self.length.wrapping_mul(8);
        // A one, then zeros up to 8 bytes before the end of a block, then the length in bits.
        let zeros = (2 * BLOCK - 9 - self.filled) % BLOCK;
        let mut end = vec![0x80];
        end.resize(1 + zeros, 0);
        end.extend(bits.to_le_bytes());
        self.update(&end);
        let digest = self.state.iter().flat_map(|word| word.to_le_bytes());
        digest.fold(String::with_capacity(32), |mut text, byte| {
            write!(text, "{byte:02x}").unwrap_or(());
            text
        })
    }

    fn absorb(&mut self, block: &[u8; BLOCK]) {
        let (words, _) = block.as_chunks::<4>();
        let word = |index: usize| u32::from_le_bytes(words[index % 16]);
        let [mut a, mut b, mut c, mut d] = self.state;
        for step in 0..64 {
            let (mixed, index) = match step / 16 {
                0 => ((b & c) | (!b & d), step),
                1 => ((d & b) | (!d & c), 5 * step + 1),
                2 => (b ^ c ^ d, 3 * step + 5),
                _ => (c ^ (b | !d), 7 * step),
            };
            let sum =
                a.wrapping_add(mixed).wrapping_add(self.sines[step]).wrapping_add(word(index));
            let turned = b.wrapping_add(sum.rotate_left(ROTATIONS[step / 16][step % 4]));
            (a, d, c, b) = (d, c, b, turned);
        }
        for (word, change) in self.state.iter_mut().zip([a, b, c, d]) {
            *word = word.wrapping_add(change);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn md5(bytes: &[u8]) -> String {
        let mut sum = Md5::new();
        sum.update(bytes);
        sum.finish()
    }

    #[test]
    fn the_test_suite_of_rfc_1321_comes_out() {
        let cases = [
            ("", "d41d8cd98f00b204e9800998ecf8427e"),
            ("a", "0cc175b9c0f1b6a831c399e269772661"),
            ("abc", "900150983cd24fb0d6963f7d28e17f72"),
            ("message digest", "f96b697d7cb7938d525a2f31aaf161d0"),
            ("abcdefghijklmnopqrstuvwxyz", "c3fcd3d76192e4007dfb496cca67e13b"),
            (
                "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789",
                "d174ab98d277d9f5a5611c2c9f419d9f",
            ),
            (
                "12345678901234567890123456789012345678901234567890123456789012345678901234567890",
                "57edf4a22be3c955ac49da2e2107b67a",
            ),
        ];
        for (text, want) in cases {
            assert_eq!(md5(text.as_bytes()), want, "{text}");
        }
    }

    #[test]
    fn the_pieces_do_not_matter() {
        let bytes: Vec<u8> = (0..1000_u32).map(|i| (i * 7 % 251) as u8).collect();
        let want = md5(&bytes);
        for size in [1, 3, 55, 56, 57, 63, 64, 65, 128, 999] {
            let mut sum = Md5::new();
            bytes.chunks(size).for_each(|piece| sum.update(piece));
            assert_eq!(sum.finish(), want, "pieces of {size}");
        }
    }

    #[test]
    fn every_length_around_a_block_is_padded_as_the_reference_pads() {
        // Of `python3 -c "import hashlib; …"`: the MD5 of the joined MD5s of 0 … 129 bytes `x`.
        let all: String = (0..130).map(|length| md5(&vec![b'x'; length])).collect();
        assert_eq!(md5(all.as_bytes()), "6638bf0c12c07cffaf1d9ecd65b95eeb");
    }
}
