//! The notebooks: they read what is committed, hold no output, and run from the first cell to the last.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// The result set is for looking at tables, so it has to stay small.
const LARGEST_RESULT_SET: u64 = 1 << 20;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("notebooks")
}

fn notebooks() -> Vec<(String, Value)> {
    let mut found: Vec<(String, Value)> = std::fs::read_dir(root())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "ipynb"))
        .map(|path| {
            let document = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
            (path.file_name().unwrap().to_string_lossy().into_owned(), document)
        })
        .collect();
    found.sort_by(|one, two| one.0.cmp(&two.0));
    assert!(found.len() >= 9, "{} notebooks", found.len());
    found
}

fn code(notebook: &Value) -> String {
    let cells =
        notebook["cells"].as_array().unwrap().iter().filter(|cell| cell["cell_type"] == "code");
    let lines = cells.flat_map(|cell| match &cell["source"] {
        Value::Array(lines) => lines.iter().map(|line| line.as_str().unwrap().to_owned()).collect(),
        source => vec![source.as_str().unwrap().to_owned()],
    });
    lines.collect::<Vec<String>>().concat()
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let paths = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

#[test]
fn every_notebook_reads_tables_that_are_there_and_no_table_is_there_for_nothing() {
    let mut read: Vec<PathBuf> = Vec::new();
    for (name, notebook) in notebooks() {
        let code = code(&notebook);
        let tables = code.split("results / \"").skip(1).map(|rest| {
            let (folder, rest) = rest.split_once("\" / \"").unwrap();
            root().join("results").join(folder).join(rest.split('"').next().unwrap())
        });
        let tables: Vec<PathBuf> = tables.collect();
        assert!(!tables.is_empty(), "{name} reads nothing");
        for table in &tables {
            assert!(table.is_file(), "{name} reads `{}`", table.display());
        }
        read.extend(tables);
    }
    let committed = files(&root().join("results"));
    for table in &committed {
        assert!(read.contains(table), "no notebook reads `{}`", table.display());
    }
    let size: u64 = committed.iter().map(|table| table.metadata().unwrap().len()).sum();
    assert!(size < LARGEST_RESULT_SET, "{size} bytes");
}

#[test]
fn notebooks_hold_no_output_and_no_analysis() {
    for (name, notebook) in notebooks() {
        for cell in notebook["cells"].as_array().unwrap() {
            let outputs = cell["outputs"].as_array().map_or(0, Vec::len);
            assert!(outputs == 0 && cell["execution_count"].is_null(), "{name} has output");
        }
        let code = code(&notebook);
        for package in
            ["scipy", "sklearn", "numpy.linalg", "np.linalg", ".corr(", ".std(", ".mean("]
        {
            assert!(!code.contains(package), "{name}: {package} belongs into the program");
        }
    }
}

#[test]
fn notebooks_run_from_the_first_cell_to_the_last() {
    let python = std::env::var("NOTEBOOK_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/run_notebooks.py");
    let output = match Command::new(&python).arg(script).arg(root()).output() {
        Ok(output) if output.status.code() != Some(3) => output,
        Ok(output) => {
            eprintln!("skipped: {}", String::from_utf8_lossy(&output.stderr).trim());
            return;
        }
        Err(error) => {
            eprintln!("skipped: `{python}`: {error}");
            return;
        }
    };
    let (out, err) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{out}{err}");
    assert_eq!(out.lines().count(), notebooks().len(), "{out}");
}
