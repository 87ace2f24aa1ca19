//! A report: finished runs as one HTML page that needs nothing but a browser.
//!
//! Figures stand in the page as SVG and tables as tables, with the manifest and the command that makes them again. The page
//! opens from disk and asks nobody for anything: style and script are in it, and its content policy forbids the rest. It
//! follows the reader's light or dark setting. Files whose content is not what the manifest says are named and left out;
//! so are tables too large for a page. The same runs give the same bytes.

mod page;
mod tables;

use std::collections::BTreeSet;
use std::path::Path;

use crate::figure::{FigureError, InlineSvg, inline_svg};
use crate::files::{self, FileError};
use crate::record::{RecordError, Table, read_parquet};

use super::finished_runs::FinishedRun;

/// No figure may be larger.
const LARGEST_FIGURE: u64 = 16 << 20;
/// Larger tables are recordings, which belong in other programs.
const LARGEST_TABLE: u64 = 4 << 20;
/// Of a longer table, so many rows are in the page.
const MOST_ROWS: usize = 500;
/// Wider tables are recordings, too.
const MOST_COLUMNS: usize = 40;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error("{source}, in `{path}`")]
    Figure { source: FigureError, path: std::path::PathBuf },
    #[error("there is no finished run in `{path}`")]
    NoRun { path: std::path::PathBuf },
}

/// A run, ready for the page.
#[derive(Debug)]
pub struct Section {
    run: FinishedRun,
    figures: Vec<Figure>,
    tables: Vec<NamedTable>,
    /// What is not shown, and why.
    pub left_out: Vec<(String, &'static str)>,
}

#[derive(Debug)]
struct Figure {
    name: String,
    drawing: InlineSvg,
}

#[derive(Debug)]
struct NamedTable {
    name: String,
    table: Table,
}

/// Runs on one page.
#[derive(Debug, Default)]
pub struct Report {
    pub sections: Vec<Section>,
}

impl Report {
    /// Reads the finished run in `folder` and adds it at the end.
    pub fn add(&mut self, folder: &Path) -> Result<(), ReportError> {
        let run = FinishedRun::read(folder)
            .ok_or_else(|| ReportError::NoRun { path: folder.to_path_buf() })?;
        let number = self.sections.len() + 1;
        let mut section =
            Section { run, figures: Vec::new(), tables: Vec::new(), left_out: Vec::new() };
        for file in section.run.manifest.files.clone() {
            section.add(&file.name, &file.sha256, number)?;
        }
        self.sections.push(section);
        Ok(())
    }

    /// The page.
    #[must_use]
    pub fn html(&self) -> String {
        page::html(self)
    }

    fn colours(&self) -> BTreeSet<String> {
        let figures = self.sections.iter().flat_map(|section| &section.figures);
        figures.flat_map(|figure| figure.drawing.colours.iter().cloned()).collect()
    }
}

impl Section {
    fn add(&mut self, name: &str, sum: &str, number: usize) -> Result<(), ReportError> {
        let path = self.run.folder.join(name);
        let is_below = Path::new(name).components().count() == 1;
        let Some((stem, kind)) = name.rsplit_once('.').filter(|_| is_below) else { return Ok(()) };
        let limit = match kind {
            "svg" => LARGEST_FIGURE,
            "parquet" => LARGEST_TABLE,
            _ => return Ok(()),
        };
        let mut leave_out = |why| self.left_out.push((name.to_owned(), why));
        match files::length(&path) {
            Err(_) => leave_out("it is not there any more"),
            Ok(length) if length > limit => leave_out("it is too large for a page"),
            Ok(_) if files::sha256_of_file(&path)? != sum => {
                leave_out("it was changed after the run");
            }
            Ok(_) if kind == "svg" => {
                let bytes = files::read_bounded(&path, limit)?;
                let svg = String::from_utf8_lossy(&bytes);
                let prefix = format!("r{number}f{}-", self.figures.len() + 1);
                let drawing = inline_svg(&svg, &prefix, stem)
                    .map_err(|source| ReportError::Figure { source, path })?;
                self.figures.push(Figure { name: stem.to_owned(), drawing });
            }
            Ok(_) => {
                let (table, _) = read_parquet(&path)?;
                if table.columns().len() > MOST_COLUMNS {
                    leave_out("it is a recording, not a table");
                } else {
                    self.tables.push(NamedTable { name: stem.to_owned(), table });
                }
            }
        }
        Ok(())
    }
}
