//! Reading comma-separated text, RFC 4180, into a tidy table.
//!
//! The first row names the columns. A column is of whole numbers, else of numbers (an empty cell or `nan` is undefined),
//! else of flags (`true`, `false`), else of texts: the first kind that all its cells have. A column of empty cells only
//! is of undefined numbers. Line ends may be of either kind; a byte order mark is skipped.
//!
//! Gzipped text is recognised by its first bytes and unpacked in memory.
//!
//! Limits: 1 GiB of UTF-8, packed or not. Rows of another length than the first, quotes inside unquoted cells and
//! unfinished quotes are refused with their line.

use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;

use super::{Column, RecordError, Table, Values};
use crate::files;

/// No file may be larger than this.
const LARGEST_FILE: u64 = 1 << 30;

/// Reads a table.
pub fn read_csv(path: &Path) -> Result<Table, RecordError> {
    let bytes = files::read_bounded(path, LARGEST_FILE)?;
    let fail =
        |(place, what): Fault| RecordError::Malformed { place, what, path: path.to_path_buf() };
    let bytes = if bytes.starts_with(&[0x1F, 0x8B]) {
        unpack(&bytes, LARGEST_FILE).map_err(fail)?
    } else {
        bytes
    };
    let text = std::str::from_utf8(&bytes)
        .map_err(|e| fail((format!("byte {}", e.valid_up_to()), "it is not UTF-8".to_owned())))?;
    let columns = parse(text).map_err(fail)?;
    Table::new(columns)
}

/// Where and what is wrong.
type Fault = (String, String);

/// What was gzipped, refusing more than `limit` bytes: a small file can unpack to any size.
fn unpack(bytes: &[u8], limit: u64) -> Result<Vec<u8>, Fault> {
    let mut unpacked = Vec::new();
    MultiGzDecoder::new(bytes)
        .take(limit.saturating_add(1))
        .read_to_end(&mut unpacked)
        .map_err(|error| ("gzip".to_owned(), format!("it cannot be unpacked: {error}")))?;
    if unpacked.len() as u64 > limit {
        return Err(("gzip".to_owned(), format!("it unpacks to more than {limit} bytes")));
    }
    Ok(unpacked)
}

fn parse(text: &str) -> Result<Vec<Column>, Fault> {
    let mut rows = Rows { rest: text.strip_prefix('\u{FEFF}').unwrap_or(text), line: 1 };
    let Some(names) = rows.next_row()? else { return Ok(Vec::new()) };
    let mut cells: Vec<Vec<String>> = vec![Vec::new(); names.len()];
    loop {
        let line = rows.line;
        let Some(row) = rows.next_row()? else { break };
        if row.len() != names.len() {
            let what = format!("expected {} cells, found {}", names.len(), row.len());
            return Err((format!("line {line}"), what));
        }
        cells.iter_mut().zip(row).for_each(|(column, cell)| column.push(cell));
    }
    let column = |(name, cells)| Column::unitless(name, values_of(cells));
    Ok(names.into_iter().zip(cells).map(column).collect())
}

struct Rows<'a> {
    rest: &'a str,
    line: usize,
}

impl Rows<'_> {
    /// The cells of the next row.
    fn next_row(&mut self) -> Result<Option<Vec<String>>, Fault> {
        if self.rest.is_empty() {
            return Ok(None);
        }
        let mut row = Vec::new();
        loop {
            row.push(self.next_cell()?);
            if let Some(rest) = self.rest.strip_prefix(',') {
                self.rest = rest;
                continue;
            }
            let ended = self.rest.strip_prefix("\r\n").or_else(|| self.rest.strip_prefix('\n'));
            self.rest = ended.unwrap_or(self.rest);
            self.line += 1;
            return Ok(Some(row));
        }
    }

    /// The next cell; what follows it starts with a comma, a line end or is empty.
    fn next_cell(&mut self) -> Result<String, Fault> {
        let line = self.line;
        let fault = |what: &str| Err((format!("line {line}"), what.to_owned()));
        let Some(mut quoted) = self.rest.strip_prefix('"') else {
            let end = self.rest.find([',', '\n']).unwrap_or(self.rest.len());
            let (cell, rest) = self.rest.split_at(end);
            // A carriage return belongs to the line end only in front of a line feed.
            let cell =
                if rest.starts_with('\n') { cell.strip_suffix('\r').unwrap_or(cell) } else { cell };
            if cell.contains('"') {
                return fault("there is a quote inside a cell that does not start with one");
            }
            self.rest = rest;
            return Ok(cell.to_owned());
        };
        let mut cell = String::new();
        loop {
            let Some((part, rest)) = quoted.split_once('"') else {
                return fault("a quote is opened and never closed");
            };
            cell.push_str(part);
            self.line += part.matches('\n').count();
            if let Some(rest) = rest.strip_prefix('"') {
                cell.push('"');
                quoted = rest;
                continue;
            }
            self.rest = rest;
            let ends = rest.is_empty() || rest.starts_with([',', '\n']) || rest.starts_with("\r\n");
            return if ends { Ok(cell) } else { fault("there is text behind a closing quote") };
        }
    }
}

/// The cells as the narrowest kind of values they all are.
fn values_of(cells: Vec<String>) -> Values {
    fn all<T>(cells: &[String], parse: impl Fn(&str) -> Option<T>) -> Option<Vec<T>> {
        cells.iter().map(|cell| parse(cell)).collect()
    }
    if let Some(integers) = all(&cells, |cell| cell.parse::<i64>().ok()) {
        return integers.into();
    }
    let float = |cell: &str| if cell.is_empty() { Some(f64::NAN) } else { cell.parse().ok() };
    if let Some(floats) = all::<f64>(&cells, float) {
        return floats.into();
    }
    let flag = |cell: &str| cell.to_ascii_lowercase().parse::<bool>().ok();
    if let Some(flags) = all(&cells, flag) {
        return flags.into();
    }
    cells.into()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::to_csv;
    use super::*;

    #[test]
    fn columns_get_the_narrowest_kind_that_fits() {
        let text = "\u{FEFF}n,x,flag,\"a, \"\"b\"\"\",none\r\n1,0.5,True,pen,\r\n-2,,false,\"two\nlines\",\r\n";
        let columns = parse(text).unwrap();
        assert_eq!(columns[0].values, Values::Integers(vec![1, -2]));
        assert!(
            matches!(&columns[1].values, Values::Floats(x) if (x[0] - 0.5).abs() < 1e-15 && x[1].is_nan())
        );
        assert_eq!(columns[2].values, Values::Flags(vec![true, false]));
        assert_eq!(columns[3].name, "a, \"b\"");
        assert_eq!(columns[3].values, Values::Texts(vec!["pen".into(), "two\nlines".into()]));
        assert!(matches!(&columns[4].values, Values::Floats(x) if x.iter().all(|x| x.is_nan())));
        assert!(parse("").unwrap().is_empty());
    }

    #[test]
    fn faults_are_named_with_their_line() {
        for (text, line) in [
            ("a,b\n1\n", "line 2"),
            ("a\n\"x\ny\"\nz\"\n", "line 4"),
            ("a\n\"x\n", "line 2"),
            ("a\n\"x\"y\n", "line 2"),
        ] {
            assert_eq!(parse(text).unwrap_err().0, line, "{text:?}");
        }
    }

    #[test]
    fn gzipped_text_is_unpacked_and_never_to_more_than_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv.gz");
        let packed = packed(b"n\n1\n2\n");
        files::write_atomic(&path, &packed).unwrap();
        let table = read_csv(&path).unwrap();
        assert_eq!(table.columns()[0].values, Values::Integers(vec![1, 2]));
        assert_eq!(unpack(&packed, 6).unwrap(), b"n\n1\n2\n");
        assert!(unpack(&packed, 5).unwrap_err().1.contains("more than 5 bytes"));
        assert!(unpack(&packed[..packed.len() - 9], 100).is_err());
    }

    fn packed(text: &[u8]) -> Vec<u8> {
        use std::io::Write;
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        gzip.write_all(text).unwrap();
        gzip.finish().unwrap()
    }

    #[test]
    fn broken_archives_and_foreign_bytes_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv");
        for bytes in [&[0x1F, 0x8B, 8][..], &[b'a', 0xFF]] {
            files::write_atomic(&path, bytes).unwrap();
            assert!(matches!(read_csv(&path), Err(RecordError::Malformed { .. })));
        }
    }

    proptest! {
        #[test]
        fn what_was_written_is_read_back(
            texts in prop::collection::vec("[a-z,\"\n\r ]{1,6}x", 1..8),
            seed in any::<u64>(),
        ) {
            let floats: Vec<f64> = (0..texts.len()).map(|i| (seed % 97) as f64 / (i + 1) as f64 + 0.1).collect();
            let table = Table::new(vec![
                Column::unitless("text", texts),
                Column::unitless("number", floats),
            ])
            .unwrap();
            prop_assert_eq!(Table::new(parse(&to_csv(&table)).unwrap()).unwrap(), table);
        }

        #[test]
        fn no_text_makes_it_panic(text in "[a-c,\"\n\r]{0,40}") {
            let _outcome = parse(&text);
        }
    }
}
