//! What a pickle says, as inert data: values in one flat table that refer to each other by index.
//!
//! Sharing is kept (two names for one value have one index), so a pickle cannot unfold into more than it spells out.
//! Texts and byte strings are borrowed from the file. A "record" is what Python would have built by calling something:
//! here it is only the callable's name, its arguments and the state attached to it.

use std::collections::HashMap;

use super::limits::{Budget, LimitExceeded, check};
pub(super) use crate::files::printable;

/// Index of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Id(u32);

/// One value. Texts, bytes and wide integers point into the file.
#[derive(Debug)]
pub(super) enum Node<'a> {
    None,
    Bool(bool),
    Int(i64),
    /// Little-endian two's complement of more than eight bytes.
    WideInt(&'a [u8]),
    Float(f64),
    Text(&'a str),
    Bytes(&'a [u8]),
    Tuple(Vec<Id>),
    List(Vec<Id>),
    Set(Vec<Id>),
    Dict(Vec<(Id, Id)>),
    /// Index into the table of names.
    Global(usize),
    Record(Box<Record>),
    /// torch's reference to a storage: the persistent id.
    Storage(Id),
}

/// A call that was never made.
#[derive(Debug)]
pub(super) struct Record {
    /// A global.
    pub(super) constructor: Id,
    /// A tuple.
    pub(super) arguments: Id,
    /// Key-value pairs set on it, if it is an ordered dictionary.
    pub(super) entries: Vec<(Id, Id)>,
    /// What `__setstate__` would have received.
    pub(super) state: Option<Id>,
}

/// Why a value cannot be read as what it should be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RecordError {
    #[error("`{attribute}` is missing")]
    Missing { attribute: String },
    #[error("{place} is {found}, expected {expected}")]
    Unexpected { place: String, expected: &'static str, found: String },
}

/// All values of one pickle.
#[derive(Debug, Default)]
pub(super) struct Records<'a> {
    nodes: Vec<Node<'a>>,
    globals: Vec<String>,
    global_indices: HashMap<String, usize>,
}

impl<'a> Records<'a> {
    /// Adds a value. `extra` is the memory behind it, in bytes.
    pub(super) fn add(
        &mut self,
        node: Node<'a>,
        extra: usize,
        budget: &mut Budget,
    ) -> Result<Id, LimitExceeded> {
        // Twice, because a growing vector doubles.
        budget.charge_memory(2 * size_of::<Node<'_>>() as u64 + extra as u64)?;
        let id = u32::try_from(self.nodes.len()).map_err(|_| LimitExceeded {
            resource: "pickled values",
            needed: self.nodes.len() as u64,
            limit: u64::from(u32::MAX),
        })?;
        self.nodes.push(node);
        Ok(Id(id))
    }

    /// Adds a global by its canonical name; the same name gives the same table entry.
    pub(super) fn add_global(
        &mut self,
        name: String,
        budget: &mut Budget,
    ) -> Result<Id, LimitExceeded> {
        let index = if let Some(&index) = self.global_indices.get(&name) {
            index
        } else {
            let index = self.globals.len();
            check("different globals", index as u64 + 1, 1_000)?;
            self.globals.push(name.clone());
            self.global_indices.insert(name, index);
            index
        };
        self.add(Node::Global(index), 64, budget)
    }

    /// Names of all globals, in order of first appearance.
    pub(super) fn globals(&self) -> &[String] {
        &self.globals
    }

    pub(super) fn node(&self, id: Id) -> &Node<'a> {
        &self.nodes[id.0 as usize]
    }

    pub(super) fn node_mut(&mut self, id: Id) -> &mut Node<'a> {
        &mut self.nodes[id.0 as usize]
    }

    pub(super) fn is_none(&self, id: Id) -> bool {
        matches!(self.node(id), Node::None)
    }

    pub(super) fn text(&self, id: Id) -> Option<&'a str> {
        match *self.node(id) {
            Node::Text(text) => Some(text),
            // Python 2 wrote its texts as byte strings.
            Node::Bytes(bytes) if bytes.is_ascii() => std::str::from_utf8(bytes).ok(),
            _ => None,
        }
    }

    pub(super) fn bytes(&self, id: Id) -> Option<&'a [u8]> {
        match *self.node(id) {
            Node::Bytes(bytes) => Some(bytes),
            _ => None,
        }
    }

    pub(super) fn bool(&self, id: Id) -> Option<bool> {
        match *self.node(id) {
            Node::Bool(value) => Some(value),
            _ => None,
        }
    }

    pub(super) fn int(&self, id: Id) -> Option<i64> {
        match *self.node(id) {
            Node::Int(value) => Some(value),
            _ => None,
        }
    }

    /// A size or an index: an integer that is not negative.
    pub(super) fn size(&self, id: Id) -> Option<usize> {
        self.int(id).and_then(|value| usize::try_from(value).ok())
    }

    /// The elements of a tuple or list.
    pub(super) fn elements(&self, id: Id) -> Option<&[Id]> {
        match self.node(id) {
            Node::Tuple(items) | Node::List(items) => Some(items),
            _ => None,
        }
    }

    /// A tuple or list of sizes, one per axis of an array.
    pub(super) fn sizes(&self, id: Id) -> Option<Vec<usize>> {
        // NumPy's own bound; a message that names a shape stays short by it.
        const MOST_AXES: usize = 64;
        let axes = self.elements(id).filter(|axes| axes.len() <= MOST_AXES)?;
        axes.iter().map(|&item| self.size(item)).collect()
    }

    /// The pairs of a dictionary, ordered or not.
    pub(super) fn pairs(&self, id: Id) -> Option<&[(Id, Id)]> {
        match self.node(id) {
            Node::Dict(pairs) => Some(pairs),
            Node::Record(record)
                if self.global(record.constructor) == Some("collections.OrderedDict") =>
            {
                Some(&record.entries)
            }
            _ => None,
        }
    }

    /// The value of a text key; as in Python the last one counts.
    pub(super) fn value(&self, dictionary: Id, key: &str) -> Option<Id> {
        let pairs = self.pairs(dictionary)?;
        pairs.iter().rev().find(|&&(k, _)| self.text(k) == Some(key)).map(|&(_, value)| value)
    }

    pub(super) fn global(&self, id: Id) -> Option<&str> {
        match *self.node(id) {
            Node::Global(index) => self.globals.get(index).map(String::as_str),
            _ => None,
        }
    }

    pub(super) fn record(&self, id: Id) -> Option<&Record> {
        match self.node(id) {
            Node::Record(record) => Some(record),
            _ => None,
        }
    }

    /// The name of the callable that a record stands for.
    pub(super) fn class(&self, id: Id) -> Option<&str> {
        self.global(self.record(id)?.constructor)
    }

    /// The arguments of a record of `class`.
    pub(super) fn arguments(&self, id: Id, class: &str) -> Option<&[Id]> {
        let record = self.record(id)?;
        (self.global(record.constructor) == Some(class)).then(|| self.elements(record.arguments))?
    }

    /// An attribute of a record whose state is a dictionary.
    pub(super) fn attribute(&self, id: Id, name: &str) -> Option<Id> {
        self.value(self.record(id)?.state?, name)
    }

    /// An attribute, or an error that names it.
    pub(super) fn require(&self, id: Id, name: &str) -> Result<Id, RecordError> {
        self.attribute(id, name).ok_or_else(|| RecordError::Missing { attribute: name.to_owned() })
    }

    /// The error that says what was found at `place` instead.
    pub(super) fn unexpected(&self, place: &str, id: Id, expected: &'static str) -> RecordError {
        RecordError::Unexpected { place: format!("`{place}`"), expected, found: self.describe(id) }
    }

    /// What a value is, in words for an error message.
    pub(super) fn describe(&self, id: Id) -> String {
        match self.node(id) {
            Node::None => "None".to_owned(),
            Node::Bool(value) => format!("the boolean {value}"),
            Node::Int(value) => format!("the integer {value}"),
            Node::WideInt(_) => "an integer of more than 64 bits".to_owned(),
            Node::Float(value) => format!("the number {value}"),
            Node::Text(_) => "a text".to_owned(),
            Node::Bytes(bytes) => format!("{} bytes", bytes.len()),
            Node::Tuple(items) => format!("a tuple of {}", items.len()),
            Node::List(items) => format!("a list of {}", items.len()),
            Node::Set(items) => format!("a set of {}", items.len()),
            Node::Dict(pairs) => format!("a dictionary of {}", pairs.len()),
            Node::Global(_) => format!("the global `{}`", self.global(id).unwrap_or("?")),
            Node::Record(_) => format!("a record of `{}`", self.class(id).unwrap_or("?")),
            Node::Storage(_) => "a tensor storage".to_owned(),
        }
    }

    /// How many values lie on the longest way from `root` down, or `None` if a value contains itself.
    pub(super) fn height(&self, root: Id) -> Option<u64> {
        const UNSEEN: u32 = 0;
        const OPEN: u32 = u32::MAX;
        // Height of each finished value, or one of the two marks above.
        let mut heights = vec![UNSEEN; self.nodes.len()];
        let mut open = vec![(root, false)];
        while let Some((id, children_done)) = open.pop() {
            let mut highest_child = 0;
            let mut circular = false;
            if children_done {
                self.for_each_child(id, |child| {
                    highest_child = highest_child.max(heights[child.0 as usize]);
                });
                heights[id.0 as usize] = highest_child + 1;
            } else if heights[id.0 as usize] == UNSEEN {
                heights[id.0 as usize] = OPEN;
                open.push((id, true));
                self.for_each_child(id, |child| match heights[child.0 as usize] {
                    UNSEEN => open.push((child, false)),
                    OPEN => circular = true,
                    _ => {}
                });
            }
            if circular {
                return None;
            }
        }
        Some(u64::from(heights[root.0 as usize]))
    }

    fn for_each_child(&self, id: Id, mut visit: impl FnMut(Id)) {
        match self.node(id) {
            Node::Tuple(items) | Node::List(items) | Node::Set(items) => {
                items.iter().copied().for_each(visit);
            }
            Node::Dict(pairs) => pairs.iter().for_each(|&(key, value)| {
                visit(key);
                visit(value);
            }),
            Node::Record(record) => {
                visit(record.arguments);
                record.entries.iter().for_each(|&(key, value)| {
                    visit(key);
                    visit(value);
                });
                record.state.into_iter().for_each(visit);
            }
            Node::Storage(reference) => visit(*reference),
            _ => {}
        }
    }
}
