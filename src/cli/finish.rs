//! The common end of every command that fills a run folder: say what was found before, or write, publish and print.

use std::path::Path;

use serde_json::{Value, json};

use crate::experiment::ExperimentError;
use crate::experiment::gather;
use crate::experiment::run_folder::{Manifest, RunFolder};
use crate::figure::{Provenance, Theme, write_figure};
use crate::files;
use crate::record::{
    Format, Place, RecordError, Recording, Table, write_csv, write_parquet, write_recording,
};

use super::context::{Context, Outcome};
use super::laboratory::Laboratory;
use super::render::{self, Hinted};

/// No figure is larger.
const LARGEST_FIGURE: u64 = 64 << 20;

/// Files of a run, written one after the other.
pub struct Output<'a> {
    folder: &'a RunFolder,
    names: Vec<String>,
}

impl<'a> Output<'a> {
    /// Nothing yet.
    #[must_use]
    pub fn new(folder: &'a RunFolder) -> Self {
        Self { folder, names: Vec::new() }
    }

    /// Writes `table` with the run's provenance.
    pub fn table(&mut self, name: &str, table: &Table) -> Result<(), ExperimentError> {
        write_parquet(&self.folder.file(name), table, &self.folder.provenance())?;
        self.names.push(name.to_owned());
        Ok(())
    }

    /// Writes `table` as Parquet, which is the record, and as CSV, for looking.
    pub fn tidy(&mut self, stem: &str, table: &Table) -> Result<(), ExperimentError> {
        self.table(&format!("{stem}.parquet"), table)?;
        self.written(&format!("{stem}.csv"), |path| write_csv(path, table))
    }

    /// Writes a file with `write`, which is given its path.
    pub fn written(
        &mut self,
        name: &str,
        write: impl FnOnce(&Path) -> Result<(), RecordError>,
    ) -> Result<(), ExperimentError> {
        write(&self.folder.file(name))?;
        self.names.push(name.to_owned());
        Ok(())
    }

    /// Writes a recording in `formats` and gives the names of the files.
    pub fn recording(
        &mut self,
        stem: &str,
        recording: Recording,
        formats: &[Format],
    ) -> Result<Vec<String>, ExperimentError> {
        let name = |format: &Format| format!("{stem}.{}", format.extension());
        let names: Vec<String> = formats.iter().map(name).collect();
        let files: Vec<_> =
            formats.iter().zip(&names).map(|(&f, name)| (f, self.folder.file(name))).collect();
        write_recording(recording, &files, Place::Replace)?;
        self.names.extend(names.iter().cloned());
        Ok(names)
    }

    /// Writes a figure as SVG, PDF and PNG.
    pub fn figure(&mut self, stem: &str, svg: &str) -> Result<(), ExperimentError> {
        for path in write_figure(&self.folder.file(stem), svg)? {
            self.names.push(path.file_name().unwrap_or_default().to_string_lossy().into_owned());
        }
        Ok(())
    }

    /// Writes a JSON document.
    pub fn json(&mut self, name: &str, document: &Value) -> anyhow::Result<()> {
        let mut text = serde_json::to_string_pretty(document)?;
        text.push('\n');
        crate::files::write_atomic(&self.folder.file(name), text.as_bytes())?;
        self.names.push(name.to_owned());
        Ok(())
    }

    /// Writes the manifest, which makes the run complete.
    pub fn finish(
        self,
        laboratory: &Laboratory,
        result: Value,
        seconds: f64,
    ) -> Result<Manifest, ExperimentError> {
        self.finish_with(laboratory.left_out_document(), result, laboratory.circumstances(seconds))
    }

    /// The same for a run that played nothing.
    pub fn finish_with(
        self,
        left_out: Value,
        result: Value,
        mut machine: Value,
    ) -> Result<Manifest, ExperimentError> {
        if machine["command_line"].is_null() {
            machine["command_line"] = command_line(std::env::args().skip(1)).into();
        }
        Ok(self.folder.finish(&self.names, left_out, result, machine)?)
    }
}

/// What was typed, as it can be typed again: without what only says where results go and how they are shown.
fn command_line(words: impl Iterator<Item = String>) -> String {
    let mut line = String::from("arnold-analyze");
    let mut words = words;
    while let Some(word) = words.next() {
        match word.as_str() {
            "--out" | "--theme" => drop(words.next()),
            "--json" | "--quiet" | "-q" => {}
            other if other.starts_with("--out=") || other.starts_with("--theme=") => {}
            other => line.extend([" ", &quoted(other)]),
        }
    }
    line
}

/// A word as a shell takes it for one word.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-./=:,@%+".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// Opens the run folder; its manifest, if this very run was finished before.
pub fn open(
    context: &Context,
    laboratory: &Laboratory,
    command: &str,
    plan: &Value,
) -> anyhow::Result<(RunFolder, Option<Manifest>)> {
    open_below(context, &laboratory.out, command, plan)
}

/// The same below any folder for results.
pub fn open_below(
    context: &Context,
    out: &Path,
    command: &str,
    plan: &Value,
) -> anyhow::Result<(RunFolder, Option<Manifest>)> {
    let folder = match &context.assignment {
        Some(assignment) => RunFolder::at(assignment.folder.clone(), command, plan),
        None => RunFolder::new(out, command, plan),
    };
    if let Some(manifest) = folder.finished() {
        context.say(&format!("Already done; delete `{}` to run it again", folder.path.display()));
        return Ok((folder, Some(manifest)));
    }
    folder.prepare().map_err(|error| {
        Hinted::new(error.to_string(), "choose a folder you may write to with `--out DIR`")
    })?;
    Ok((folder, None))
}

/// Where the figures of this run say they come from.
#[must_use]
pub fn provenance(laboratory: &Laboratory) -> Provenance {
    Provenance {
        physics: format!("MuJoCo {}", laboratory.physics),
        policy: laboratory.policy.name.clone(),
    }
}

/// Prints a finished run: its JSON document, or `table` and where the files are. A run that needed no extra step leaves
/// nothing but its results.
pub fn print(
    context: &Context,
    folder: &RunFolder,
    manifest: &Manifest,
    table: &dyn Fn(&Value) -> String,
) -> anyhow::Result<Outcome> {
    if context.assignment.is_none() {
        gather::tidy(&folder.path)?;
    }
    let slides = slides(context.theme, folder, manifest)?;
    if context.json {
        let mut document = json!({
            "command": manifest.command,
            "key": manifest.key,
            "plan": manifest.plan["plan"],
        });
        if let (Some(into), Value::Object(result)) = (document.as_object_mut(), &manifest.result) {
            into.extend(result.clone());
            into.insert("left_out".to_owned(), manifest.left_out.clone());
            into.insert("folder".to_owned(), json!(absolute(&folder.path)));
            let files: Vec<_> =
                manifest.files.iter().map(|f| absolute(&folder.file(&f.name))).collect();
            into.insert("files".to_owned(), json!(files));
            if !slides.is_empty() {
                let slides: Vec<_> = slides.iter().map(|path| absolute(path)).collect();
                into.insert("slides".to_owned(), json!(slides));
            }
        }
        render::print_json(&document)?;
    } else {
        let mut text = table(&manifest.result) + &divergence(&manifest.result);
        let names: Vec<&str> = manifest.files.iter().map(|file| file.name.as_str()).collect();
        text.extend(["\n", &folder.path.display().to_string(), "/\n"]);
        for name in names.into_iter().chain(["manifest.json"]) {
            text.extend(["  ", name, "\n"]);
        }
        for path in &slides {
            let below = path.strip_prefix(&folder.path).unwrap_or(path);
            text.extend(["  ", &below.display().to_string(), "\n"]);
        }
        render::print_text(&text)?;
    }
    Ok(Outcome::Done)
}

/// The figures of a run once more, in the colours of slides. The run itself stays what it is, so no other theme makes it
/// another run.
fn slides(
    theme: Theme,
    folder: &RunFolder,
    manifest: &Manifest,
) -> anyhow::Result<Vec<std::path::PathBuf>> {
    let mut drawn = Vec::new();
    if theme == Theme::Light {
        return Ok(drawn);
    }
    for file in &manifest.files {
        let Some(stem) = file.name.strip_suffix(".svg") else { continue };
        let bytes = files::read_bounded(&folder.file(&file.name), LARGEST_FIGURE)?;
        let svg = theme.apply(&String::from_utf8_lossy(&bytes));
        let slides = folder.file("dark");
        files::create_folder(&slides)?;
        drawn.extend(write_figure(&slides.join(stem), &svg)?);
    }
    Ok(drawn)
}

/// A line for each task in which the physics diverged; nothing if it never did.
fn divergence(result: &Value) -> String {
    let tasks = result["tasks"].as_object().into_iter().flatten();
    let diverged = tasks.filter_map(|(task, entry)| {
        let steps = entry["diverged_steps"].as_u64().filter(|&steps| steps > 0)?;
        let word = if steps == 1 { "step" } else { "steps" };
        Some(format!(
            "warning: the physics of `{task}` diverged in {steps} {word} and was reset there\n"
        ))
    });
    let lines: String = diverged.collect();
    if lines.is_empty() { lines } else { format!("\n{lines}") }
}

fn absolute(path: &Path) -> std::path::PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_can_be_typed_again_wherever_its_results_go() {
        let line = |words: &[&str]| command_line(words.iter().map(|word| (*word).to_owned()));
        let typed = [
            "evaluate",
            "--benchmarks",
            "a b",
            "it's=x",
            "--out",
            "runs",
            "--json",
            "--theme=dark",
        ];
        assert_eq!(line(&typed), r"arnold-analyze evaluate --benchmarks 'a b' 'it'\''s=x'");
        assert_eq!(line(&["stats", ""]), "arnold-analyze stats ''");
    }
}
