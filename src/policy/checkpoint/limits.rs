//! How much a file from outside may ask of this machine, and the account that is charged before anything is allocated.
//!
//! The defaults leave several times what the largest published policy needs (18 MB, 310 tensors, 34 000 pickle opcodes)
//! and keep the worst hostile file within a second and, beside itself, 128 MiB.

/// Upper bounds for reading one file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of a file on disk.
    pub file_bytes: u64,
    /// Bytes of memory for everything built from the file: records, tensors, unpacked members.
    pub memory: u64,
    /// Opcodes of all pickles of the file together; each builds at most one value.
    pub opcodes: u64,
    /// Values on the pickle machine's stack.
    pub stack: u64,
    /// Values a pickle may keep in its memo, and the largest number it may give one.
    pub memo_entries: u64,
    /// How deep values may contain values.
    pub depth: u64,
    /// Members of one archive.
    pub members: u64,
    /// Unpacked bytes of one archive member.
    pub member_bytes: u64,
    /// Unpacked divided by packed size of one archive member.
    pub compression_ratio: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            file_bytes: 512 << 20,
            memory: 128 << 20,
            opcodes: 1_000_000,
            stack: 250_000,
            memo_entries: 250_000,
            depth: 64,
            members: 20_000,
            member_bytes: 128 << 20,
            compression_ratio: 200,
        }
    }
}

/// A limit was reached; nothing was allocated for what would have crossed it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("needs {needed} {resource}, more than the limit of {limit}")]
pub struct LimitExceeded {
    /// What ran out, with its unit.
    pub resource: &'static str,
    pub needed: u64,
    pub limit: u64,
}

/// What is left of the limits while one file is read.
#[derive(Debug)]
pub(super) struct Budget {
    pub(super) limits: Limits,
    memory_used: u64,
    opcodes_used: u64,
}

impl Budget {
    /// A fresh account.
    pub(super) fn new(limits: &Limits) -> Self {
        Self { limits: *limits, memory_used: 0, opcodes_used: 0 }
    }

    /// Takes `bytes` of memory from the account. Called before the allocation.
    pub(super) fn charge_memory(&mut self, bytes: u64) -> Result<(), LimitExceeded> {
        self.memory_used = self.memory_used.saturating_add(bytes);
        check("bytes of memory", self.memory_used, self.limits.memory)
    }

    /// Takes one pickle opcode from the account.
    pub(super) fn charge_opcode(&mut self) -> Result<(), LimitExceeded> {
        self.opcodes_used = self.opcodes_used.saturating_add(1);
        check("pickle opcodes", self.opcodes_used, self.limits.opcodes)
    }
}

/// `Ok` while `needed` is within `limit`.
pub(super) fn check(resource: &'static str, needed: u64, limit: u64) -> Result<(), LimitExceeded> {
    if needed > limit { Err(LimitExceeded { resource, needed, limit }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_account_never_wraps_round() {
        let mut budget = Budget::new(&Limits::default());
        assert!(budget.charge_memory(u64::MAX).is_err());
        assert!(budget.charge_memory(u64::MAX).is_err());
    }

    #[test]
    fn the_limit_itself_is_allowed_and_one_more_is_not() {
        let limits = Limits { memory: 10, ..Limits::default() };
        assert_eq!(Budget::new(&limits).charge_memory(10), Ok(()));
        let refused = LimitExceeded { resource: "bytes of memory", needed: 11, limit: 10 };
        assert_eq!(Budget::new(&limits).charge_memory(11), Err(refused));
    }
}
