//! A pickle reader that cannot execute anything: a bounded stack machine that builds inert records.
//!
//! Pickle is a program for a small stack machine; Python's own machine imports and calls whatever the program names.
//! This one knows only the opcodes that checkpoints are made of, accepts a global only from the list of its kind of
//! file, and turns every call into a record of name and arguments. It rejects values that contain themselves, and it
//! never recurses, so that no input can exhaust the stack.
//!
//! Reference: the opcode documentation in Python's module `pickletools`.

use super::allowed::Kind;
use super::limits::{Budget, LimitExceeded, check};
use super::records::{Id, Node, Record, Records, printable};

/// Why a pickle is refused. Offsets count bytes from the pickle's start.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PickleError {
    #[error("ends too early, at byte {offset}")]
    Truncated { offset: usize },
    #[error("protocol {protocol} is not supported (byte {offset})")]
    UnsupportedProtocol { protocol: u8, offset: usize },
    #[error("opcode 0x{opcode:02x} at byte {offset} is not one that checkpoints use")]
    ForbiddenOpcode { opcode: u8, offset: usize },
    #[error("names the global `{name}`, which this kind of file may not name (byte {offset})")]
    UnknownGlobal { name: String, offset: usize },
    #[error("would call `{name}` with other arguments than allowed (byte {offset})")]
    ForbiddenCall { name: String, offset: usize },
    #[error("{operation} needs another operand than {found} (byte {offset})")]
    WrongOperand { operation: &'static str, found: String, offset: usize },
    #[error("takes a value from an empty stack (byte {offset})")]
    EmptyStack { offset: usize },
    #[error("leaves {count} values behind (byte {offset})")]
    LeftoverValues { count: usize, offset: usize },
    #[error("recalls value {index} that was never kept (byte {offset})")]
    UnknownMemo { index: u64, offset: usize },
    #[error(
        "holds a text that is not UTF-8, or a name or number that is not plain text (byte {offset})"
    )]
    InvalidText { offset: usize },
    #[error("claims a length of {length} bytes (byte {offset})")]
    ImpossibleLength { length: i128, offset: usize },
    #[error("holds a value that contains itself")]
    Recursive,
    #[error("is followed by {count} bytes that do not belong to it (byte {offset})")]
    TrailingBytes { count: usize, offset: usize },
    #[error("{fault} (byte {offset})")]
    Limit { fault: LimitExceeded, offset: usize },
}

/// A pickle that was read.
#[derive(Debug)]
pub(super) struct Pickle<'a> {
    pub(super) records: Records<'a>,
    pub(super) root: Id,
    /// How many bytes it occupied.
    pub(super) length: usize,
}

/// Reads a pickle that fills `bytes` exactly.
pub(super) fn read<'a>(
    bytes: &'a [u8],
    kind: Kind,
    budget: &mut Budget,
) -> Result<Pickle<'a>, PickleError> {
    let pickle = read_prefix(bytes, kind, budget)?;
    match bytes.len() - pickle.length {
        0 => Ok(pickle),
        count => Err(PickleError::TrailingBytes { count, offset: pickle.length }),
    }
}

/// Reads a pickle from the start of `bytes`, which may go on after it.
pub(super) fn read_prefix<'a>(
    bytes: &'a [u8],
    kind: Kind,
    budget: &mut Budget,
) -> Result<Pickle<'a>, PickleError> {
    let mut machine = Machine {
        bytes,
        position: 0,
        opcode_offset: 0,
        kind,
        budget,
        records: Records::default(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: Vec::new(),
        memo_entries: 0,
    };
    while machine.step()? {}
    machine.finish()
}

/// The first global that a pickle names, e.g. the class of the object it holds.
pub(super) fn first_global(bytes: &[u8], budget: &mut Budget) -> Option<String> {
    match read_prefix(bytes, Kind::Nothing, budget) {
        Err(PickleError::UnknownGlobal { name, .. }) => Some(name),
        _ => None,
    }
}

struct Machine<'a, 'b> {
    bytes: &'a [u8],
    position: usize,
    /// Where the opcode being executed starts, for error messages.
    opcode_offset: usize,
    kind: Kind,
    budget: &'b mut Budget,
    records: Records<'a>,
    stack: Vec<Id>,
    /// Heights of the stack at each open mark.
    marks: Vec<usize>,
    /// Kept values by their number.
    memo: Vec<Option<Id>>,
    memo_entries: u64,
}

impl<'a> Machine<'a, '_> {
    /// Executes one opcode; `false` after the last.
    #[expect(clippy::too_many_lines, reason = "one arm per opcode reads best in one piece")]
    fn step(&mut self) -> Result<bool, PickleError> {
        self.opcode_offset = self.position;
        let charged = self.budget.charge_opcode();
        self.limit(charged)?;
        let opcode = self.array::<1>()?[0];
        match opcode {
            // PROTO, FRAME, STOP
            0x80 => {
                let protocol = self.array::<1>()?[0];
                if protocol > 5 || self.opcode_offset != 0 {
                    let offset = self.opcode_offset;
                    return Err(PickleError::UnsupportedProtocol { protocol, offset });
                }
            }
            0x95 => {
                let length = u64::from_le_bytes(self.array()?);
                let left = (self.bytes.len() - self.position) as u64;
                if length > left {
                    return Err(self.impossible(i128::from(length)));
                }
            }
            b'.' => return Ok(false),

            // Constants: NONE, NEWTRUE, NEWFALSE, BININT, BININT1, BININT2, LONG1, BINFLOAT
            b'N' => self.push(Node::None)?,
            0x88 => self.push(Node::Bool(true))?,
            0x89 => self.push(Node::Bool(false))?,
            b'J' => {
                let value = i32::from_le_bytes(self.array()?);
                self.push(Node::Int(i64::from(value)))?;
            }
            b'K' => {
                let value = self.array::<1>()?[0];
                self.push(Node::Int(i64::from(value)))?;
            }
            b'M' => {
                let value = u16::from_le_bytes(self.array()?);
                self.push(Node::Int(i64::from(value)))?;
            }
            0x8a => {
                let length = usize::from(self.array::<1>()?[0]);
                let digits = self.take(length)?;
                self.push(integer(digits))?;
            }
            b'G' => {
                let value = f64::from_be_bytes(self.array()?);
                self.push(Node::Float(value))?;
            }

            // Texts and bytes: SHORT_BINUNICODE, BINUNICODE, BINUNICODE8, SHORT_BINBYTES, BINBYTES, BINBYTES8,
            // BYTEARRAY8, SHORT_BINSTRING, BINSTRING
            0x8c | b'X' | 0x8d => {
                let content = self.counted(opcode)?;
                let offset = self.opcode_offset;
                let text = std::str::from_utf8(content)
                    .map_err(|_| PickleError::InvalidText { offset })?;
                self.push(Node::Text(text))?;
            }
            b'C' | b'B' | 0x8e | 0x96 | b'U' | b'T' => {
                let content = self.counted(opcode)?;
                self.push(Node::Bytes(content))?;
            }

            // Containers
            b')' => self.push(Node::Tuple(Vec::new()))?,
            0x85 => self.tuple(1)?,
            0x86 => self.tuple(2)?,
            0x87 => self.tuple(3)?,
            b't' => {
                let items = self.pop_to_mark()?;
                self.push_many(Node::Tuple, items)?;
            }
            b']' => self.push(Node::List(Vec::new()))?,
            b'}' => self.push(Node::Dict(Vec::new()))?,
            0x8f => self.push(Node::Set(Vec::new()))?,
            0x91 => {
                let items = self.pop_to_mark()?;
                self.push_many(Node::Set, items)?;
            }
            b'a' => {
                let item = self.pop()?;
                self.extend("APPEND", &[item])?;
            }
            b'e' => {
                let items = self.pop_to_mark()?;
                self.extend("APPENDS", &items)?;
            }
            0x90 => {
                let items = self.pop_to_mark()?;
                self.extend("ADDITEMS", &items)?;
            }
            b's' => {
                let value = self.pop()?;
                let key = self.pop()?;
                self.set_items("SETITEM", &[key, value])?;
            }
            b'u' => {
                let items = self.pop_to_mark()?;
                self.set_items("SETITEMS", &items)?;
            }

            // Stack and memo: MARK, POP, POP_MARK, DUP, PUT, BINPUT, LONG_BINPUT, MEMOIZE, GET, BINGET, LONG_BINGET
            b'(' => {
                let height = self.stack.len();
                let checked =
                    check("open marks", self.marks.len() as u64, self.budget.limits.stack);
                self.limit(checked)?;
                self.marks.push(height);
            }
            b'0' => {
                if self.marks.last() == Some(&self.stack.len()) {
                    self.marks.pop();
                } else {
                    self.pop()?;
                }
            }
            b'1' => drop(self.pop_to_mark()?),
            b'2' => {
                let top = self.top()?;
                self.push_id(top)?;
            }
            b'p' => {
                let index = self.decimal_line()?;
                self.keep(index)?;
            }
            b'q' => {
                let index = u64::from(self.array::<1>()?[0]);
                self.keep(index)?;
            }
            b'r' => {
                let index = u64::from(u32::from_le_bytes(self.array()?));
                self.keep(index)?;
            }
            0x94 => self.keep(self.memo_entries)?,
            b'g' => {
                let index = self.decimal_line()?;
                self.recall(index)?;
            }
            b'h' => {
                let index = u64::from(self.array::<1>()?[0]);
                self.recall(index)?;
            }
            b'j' => {
                let index = u64::from(u32::from_le_bytes(self.array()?));
                self.recall(index)?;
            }

            // Names and records: GLOBAL, STACK_GLOBAL, REDUCE, NEWOBJ, BUILD, BINPERSID
            b'c' => {
                let module = self.line()?;
                let name = self.line()?;
                self.global(module, name)?;
            }
            0x93 => {
                let name = self.pop()?;
                let module = self.pop()?;
                let texts = (self.records.text(module), self.records.text(name));
                let (Some(module), Some(name)) = texts else {
                    return Err(self.wrong_operand("STACK_GLOBAL", name));
                };
                self.global(module, name)?;
            }
            b'R' => self.record("REDUCE")?,
            0x81 => self.record("NEWOBJ")?,
            b'b' => self.build()?,
            b'Q' if self.kind.has_storages() => {
                let reference = self.pop()?;
                self.push(Node::Storage(reference))?;
            }
            opcode => {
                return Err(PickleError::ForbiddenOpcode { opcode, offset: self.opcode_offset });
            }
        }
        Ok(true)
    }

    /// Checks that exactly one value is left, and that it is a finite tree of bounded depth.
    fn finish(mut self) -> Result<Pickle<'a>, PickleError> {
        let root = self.pop()?;
        let offset = self.opcode_offset;
        if !self.stack.is_empty() || !self.marks.is_empty() {
            let count = self.stack.len() + self.marks.len();
            return Err(PickleError::LeftoverValues { count, offset });
        }
        let height = self.records.height(root).ok_or(PickleError::Recursive)?;
        let checked = check("levels of nesting", height, self.budget.limits.depth);
        self.limit(checked)?;
        Ok(Pickle { records: self.records, root, length: self.position })
    }

    // ---- input -----------------------------------------------------------------------------------------------------

    fn take(&mut self, length: usize) -> Result<&'a [u8], PickleError> {
        let rest = &self.bytes[self.position..];
        let taken =
            rest.get(..length).ok_or(PickleError::Truncated { offset: self.bytes.len() })?;
        self.position += length;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], PickleError> {
        let taken = self.take(N)?;
        taken.try_into().map_err(|_| PickleError::Truncated { offset: self.bytes.len() })
    }

    /// The content of a text or byte string, whose length field depends on the opcode.
    fn counted(&mut self, opcode: u8) -> Result<&'a [u8], PickleError> {
        let length = match opcode {
            0x8c | b'C' | b'U' => i128::from(self.array::<1>()?[0]),
            b'X' | b'B' => i128::from(u32::from_le_bytes(self.array()?)),
            b'T' => i128::from(i32::from_le_bytes(self.array()?)),
            _ => i128::from(u64::from_le_bytes(self.array()?)),
        };
        let length = usize::try_from(length).map_err(|_| self.impossible(length))?;
        self.take(length)
    }

    /// A line of plain text, without its line break.
    fn line(&mut self) -> Result<&'a str, PickleError> {
        const LONGEST: usize = 1_000;
        let rest = &self.bytes[self.position..];
        let window = &rest[..rest.len().min(LONGEST)];
        let offset = self.opcode_offset;
        let length =
            window.iter().position(|&byte| byte == b'\n').ok_or(if window.len() < LONGEST {
                PickleError::Truncated { offset: self.bytes.len() }
            } else {
                PickleError::InvalidText { offset }
            })?;
        let line = self.take(length)?;
        self.position += 1;
        std::str::from_utf8(line).map_err(|_| PickleError::InvalidText { offset })
    }

    fn decimal_line(&mut self) -> Result<u64, PickleError> {
        let offset = self.opcode_offset;
        self.line()?.parse().map_err(|_| PickleError::InvalidText { offset })
    }

    // ---- stack and memo --------------------------------------------------------------------------------------------

    fn push(&mut self, node: Node<'a>) -> Result<(), PickleError> {
        let added = self.records.add(node, 0, self.budget);
        let id = self.limit(added)?;
        self.push_id(id)
    }

    fn push_many(
        &mut self,
        container: impl FnOnce(Vec<Id>) -> Node<'a>,
        items: Vec<Id>,
    ) -> Result<(), PickleError> {
        let extra = items.len() * size_of::<Id>();
        let added = self.records.add(container(items), extra, self.budget);
        let id = self.limit(added)?;
        self.push_id(id)
    }

    fn push_id(&mut self, id: Id) -> Result<(), PickleError> {
        let checked =
            check("values on the stack", self.stack.len() as u64 + 1, self.budget.limits.stack);
        self.limit(checked)?;
        self.stack.push(id);
        Ok(())
    }

    /// The topmost value above the last mark.
    fn top(&self) -> Result<Id, PickleError> {
        let floor = self.marks.last().copied().unwrap_or(0);
        let above = self.stack.get(floor..).and_then(<[Id]>::last).copied();
        above.ok_or(PickleError::EmptyStack { offset: self.opcode_offset })
    }

    fn pop(&mut self) -> Result<Id, PickleError> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Id>, PickleError> {
        let empty = PickleError::EmptyStack { offset: self.opcode_offset };
        let mark = self.marks.pop().ok_or(empty)?;
        Ok(self.stack.split_off(mark))
    }

    fn keep(&mut self, index: u64) -> Result<(), PickleError> {
        let top = self.top()?;
        let checked =
            check("values in the memo", index.saturating_add(1), self.budget.limits.memo_entries);
        self.limit(checked)?;
        // Within the limit just checked, the number fits and the table is small.
        let index = usize::try_from(index).unwrap_or(0);
        if index >= self.memo.len() {
            self.memo.resize(index + 1, None);
        }
        if self.memo[index].replace(top).is_none() {
            self.memo_entries += 1;
        }
        Ok(())
    }

    fn recall(&mut self, index: u64) -> Result<(), PickleError> {
        let unknown = PickleError::UnknownMemo { index, offset: self.opcode_offset };
        let kept = usize::try_from(index).ok().and_then(|index| *self.memo.get(index)?);
        self.push_id(kept.ok_or(unknown)?)
    }

    // ---- containers ------------------------------------------------------------------------------------------------

    fn tuple(&mut self, length: usize) -> Result<(), PickleError> {
        let mut items = Vec::with_capacity(length);
        for _ in 0..length {
            items.push(self.pop()?);
        }
        items.reverse();
        self.push_many(Node::Tuple, items)
    }

    /// Adds `items` to the list or set on top of the stack.
    fn extend(&mut self, operation: &'static str, items: &[Id]) -> Result<(), PickleError> {
        let charged = self.budget.charge_memory(2 * size_of_val(items) as u64);
        self.limit(charged)?;
        let target = self.top()?;
        match (operation, self.records.node_mut(target)) {
            ("ADDITEMS", Node::Set(list)) | ("APPEND" | "APPENDS", Node::List(list)) => {
                list.extend_from_slice(items);
                Ok(())
            }
            _ => Err(self.wrong_operand(operation, target)),
        }
    }

    /// Adds key-value pairs to the dictionary on top of the stack.
    fn set_items(&mut self, operation: &'static str, items: &[Id]) -> Result<(), PickleError> {
        let charged = self.budget.charge_memory(2 * size_of_val(items) as u64);
        self.limit(charged)?;
        let target = self.top()?;
        let is_dictionary = self.records.pairs(target).is_some();
        let (pairs, []) = items.as_chunks::<2>() else {
            return Err(self.wrong_operand(operation, target));
        };
        let pairs = pairs.iter().map(|&[key, value]| (key, value));
        match self.records.node_mut(target) {
            Node::Dict(dictionary) => dictionary.extend(pairs),
            Node::Record(record) if is_dictionary => record.entries.extend(pairs),
            _ => return Err(self.wrong_operand(operation, target)),
        }
        Ok(())
    }

    // ---- names and records -----------------------------------------------------------------------------------------

    fn global(&mut self, module: &str, name: &str) -> Result<(), PickleError> {
        let offset = self.opcode_offset;
        let admitted = self.kind.admit(module, name);
        let name = admitted.ok_or_else(|| PickleError::UnknownGlobal {
            name: printable(&format!("{module}.{name}")),
            offset,
        })?;
        let added = self.records.add_global(name, self.budget);
        let id = self.limit(added)?;
        self.push_id(id)
    }

    /// REDUCE and NEWOBJ: a name and a tuple become a record.
    fn record(&mut self, operation: &'static str) -> Result<(), PickleError> {
        let arguments = self.pop()?;
        let constructor = self.pop()?;
        let Some(name) = self.records.global(constructor) else {
            return Err(self.wrong_operand(operation, constructor));
        };
        let Node::Tuple(items) = self.records.node(arguments) else {
            return Err(self.wrong_operand(operation, arguments));
        };
        if self.kind != Kind::Listing && !self.understands_call(name, items) {
            let (name, offset) = (name.to_owned(), self.opcode_offset);
            return Err(PickleError::ForbiddenCall { name, offset });
        }
        let record = Record { constructor, arguments, entries: Vec::new(), state: None };
        let added =
            self.records.add(Node::Record(Box::new(record)), size_of::<Record>(), self.budget);
        let id = self.limit(added)?;
        self.push_id(id)
    }

    /// Whether a call has the meaning for which its name is admitted. Of Python's built-in functions that is one use each.
    fn understands_call(&self, name: &str, arguments: &[Id]) -> bool {
        let records = &self.records;
        match (name, arguments) {
            ("builtins.getattr", &[owner, attribute]) => matches!(
                (records.global(owner), records.text(attribute)),
                // The activation function of `mjrl` networks.
                (Some("torch._C._VariableFunctions" | "torch._C._VariableFunctionsClass"), Some("tanh"))
                // What `policy.save` writes in place of a learning rate.
                | (Some("stable_baselines3.common.policies.BasePolicy"), Some("_dummy_schedule"))
            ),
            ("builtins.set", &[items]) => {
                matches!(records.node(items), Node::List(items) if items.is_empty())
            }
            // How protocol 2 writes bytes.
            ("_codecs.encode", &[text, encoding]) => {
                records.text(text).is_some() && records.text(encoding) == Some("latin1")
            }
            ("builtins.getattr" | "builtins.set" | "_codecs.encode", _) => false,
            _ => true,
        }
    }

    /// BUILD: attaches a state to the record below it, once.
    fn build(&mut self) -> Result<(), PickleError> {
        let state = self.pop()?;
        let target = self.top()?;
        if let Node::Record(record) = self.records.node_mut(target)
            && record.state.is_none()
        {
            record.state = Some(state);
            return Ok(());
        }
        Err(self.wrong_operand("BUILD", target))
    }

    // ---- errors ----------------------------------------------------------------------------------------------------

    fn limit<T>(&self, result: Result<T, LimitExceeded>) -> Result<T, PickleError> {
        let offset = self.opcode_offset;
        result.map_err(|fault| PickleError::Limit { fault, offset })
    }

    fn impossible(&self, length: i128) -> PickleError {
        PickleError::ImpossibleLength { length, offset: self.opcode_offset }
    }

    fn wrong_operand(&self, operation: &'static str, operand: Id) -> PickleError {
        let found = self.records.describe(operand);
        PickleError::WrongOperand { operation, found, offset: self.opcode_offset }
    }
}

/// Little-endian two's complement of any width.
fn integer(digits: &[u8]) -> Node<'_> {
    if digits.len() > 8 {
        return Node::WideInt(digits);
    }
    let negative = digits.last().is_some_and(|&highest| highest & 0x80 != 0);
    let mut wide = [if negative { 0xff } else { 0 }; 8];
    wide[..digits.len()].copy_from_slice(digits);
    Node::Int(i64::from_le_bytes(wide))
}
