//! `figures`: every figure and table of the paper, from what there is. Nothing is played.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use crate::cli::context::{Context, Outcome};
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::benchmarks::{
    PrintedTable, Results, expert_figure, expert_table, printed_ablation, printed_radar,
};
use crate::experiment::finished_runs::{FinishedRun, finished_runs};
use crate::experiment::gallery::{self, Picture};
use crate::experiment::paper_index::{INDEX, IndexEntry, Published};
use crate::experiment::published_curves::PublishedCurves;
use crate::figure::{Basis, Theme, write_figure};
use crate::files;
use crate::record::{SubspacePoint, Table, read_subspace_curves, write_csv, write_parquet};

/// Arguments of `figures`.
#[derive(Debug, Args)]
pub struct FiguresArguments {
    /// Only these, by name as `fig3b_radar`, or by its beginning as `fig3`
    #[arg(value_name = "NAME")]
    names: Vec<String>,
    /// Folder with finished runs; of several runs the newest is taken
    #[arg(long, value_name = "DIR", default_value = "runs")]
    runs: PathBuf,
    /// Published results of experts [default: in the data folder]
    #[arg(long, value_name = "DIR")]
    experts: Option<PathBuf>,
    /// Folder for the figures and tables
    #[arg(long, value_name = "DIR", default_value = "figures")]
    out: PathBuf,
    /// Write `README.md` there, too: a page with a picture of each, and of every other figure of the finished runs
    #[arg(long)]
    gallery: bool,
}

/// Where published results of experts may lie in the data folder.
const EXPERT_FOLDERS: [&str; 2] =
    ["final_benchmarks/expert_policies", "arnold_published/expert_policies"];
/// Where published curves of control-subspace inactivation may lie in the data folder.
const CURVE_FILES: [&str; 6] = [
    "arnold_published/upstream/subspaces/curves_pca.csv",
    "arnold_published/upstream/subspaces/curves_nmf.csv",
    "arnold_published/subspaces/curves_pca.csv",
    "arnold_published/subspaces/curves_nmf.csv",
    "analysis/subspaces/curves.csv",
    "subspaces/curves.csv",
];

/// No figure or table of a run is larger.
const LARGEST_FILE: u64 = 1 << 30;

/// What became of an entry.
struct Made {
    entry: IndexEntry,
    /// Where it is from; `None` if it is missing.
    from: Option<String>,
    files: Vec<PathBuf>,
}

/// Runs the command.
pub fn run(context: &Context, arguments: &FiguresArguments) -> anyhow::Result<Outcome> {
    let chosen: Vec<IndexEntry> =
        INDEX.into_iter().filter(|e| is_chosen(e, &arguments.names)).collect();
    if chosen.is_empty() {
        return Err(Hinted::new(
            format!("no figure or table is called {}", arguments.names.join(", ")),
            "`arnold-analyze figures` lists all of them",
        ));
    }
    files::create_folder(&arguments.out)
        .and_then(|()| files::check_writable(&arguments.out))
        .map_err(|e| {
            Hinted::new(e.to_string(), "choose a folder you may write to with `--out DIR`")
        })?;
    let runs = finished_runs(&arguments.runs)?;
    let sources = Sources::find(context, arguments, &runs)?;
    let mut made = Vec::new();
    for entry in chosen {
        made.push(make(entry, &runs, &sources, &arguments.out, context.theme)?);
    }
    if arguments.gallery {
        write_gallery(context, &made, &runs, &arguments.out)?;
    }
    if context.json {
        render::print_json(&document(&made))?;
    } else {
        render::print_text(&text(&made, &arguments.out))?;
    }
    let is_whole = made.iter().all(|made| made.from.is_some());
    Ok(if is_whole { Outcome::Done } else { Outcome::SomethingSkipped })
}

fn is_chosen(entry: &IndexEntry, names: &[String]) -> bool {
    names.is_empty() || names.iter().any(|name| entry.stem.starts_with(name.as_str()))
}

/// What can be drawn without playing.
struct Sources {
    /// Results of the experts.
    experts: Option<Results>,
    /// Published curves, if their files and the experts' results are there.
    curves: Option<PublishedCurves>,
    /// The newest curves of one's own.
    ours: Option<(PublishedCurves, String)>,
}

impl Sources {
    fn find(
        context: &Context,
        arguments: &FiguresArguments,
        runs: &[FinishedRun],
    ) -> anyhow::Result<Self> {
        let results = experts(context, arguments.experts.as_deref())?;
        let experts = results.as_ref().map(|found| found.experts.clone()).unwrap_or_default();
        let mut points: Vec<SubspacePoint> = Vec::new();
        for path in CURVE_FILES.map(|file| context.data.join(file)).iter().filter(|p| p.is_file()) {
            points.extend(read_subspace_curves(path).map_err(|error| {
                Hinted::new(
                    error.to_string(),
                    "published curves are read from the data folder (`--data DIR`)",
                )
            })?);
        }
        let has_both = !points.is_empty() && !experts.is_empty();
        let curves = has_both.then(|| PublishedCurves::new(points, &experts));
        let own = runs.iter().find(|run| run.manifest.command == "csi");
        let own_file = own.map(|run| run.folder.join("curves.parquet")).filter(|p| p.is_file());
        let ours = match own_file.filter(|_| !experts.is_empty()) {
            Some(path) => {
                let curves = PublishedCurves::new(read_subspace_curves(&path)?, &experts);
                (!curves.points.is_empty()).then(|| (curves, folder_name(&path)))
            }
            None => None,
        };
        Ok(Self { experts: results, curves, ours })
    }
}

fn experts(context: &Context, named: Option<&Path>) -> anyhow::Result<Option<Results>> {
    let known = EXPERT_FOLDERS.map(|folder| context.data.join(folder));
    let found = named.or_else(|| known.iter().map(PathBuf::as_path).find(|path| path.is_dir()));
    let Some(path) = found else { return Ok(None) };
    let mut results = Results::default();
    results.add_experts_at(path).and_then(|()| results.choose(&[], &[])).map_err(|error| {
        Hinted::new(error.to_string(), "`--experts DIR` takes a folder of `expert_*_results.json`")
    })?;
    Ok(Some(results))
}

/// The name of the folder that a file lies in.
fn folder_name(path: &Path) -> String {
    path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned()
}

/// From the newest run that has it, else from published data.
fn make(
    entry: IndexEntry,
    runs: &[FinishedRun],
    sources: &Sources,
    out: &Path,
    theme: Theme,
) -> anyhow::Result<Made> {
    for run in runs {
        let there = run.files_of(&entry);
        if there.is_empty() {
            continue;
        }
        let copied = copy(&there, &out.join(entry.stem), theme)?;
        let from = format!("run {}", run.folder.file_name().unwrap_or_default().to_string_lossy());
        return Ok(Made { entry, from: Some(from), files: copied });
    }
    let mut sheet = Sheet { stem: out.join(entry.stem), theme, files: Vec::new() };
    let from = match entry.published {
        Some(published) => sheet.draw(published, sources)?,
        None => None,
    };
    Ok(Made { entry, from, files: sheet.files })
}

/// The files of an entry under its own name; figures that are not for print are drawn again from their SVG.
fn copy(there: &[PathBuf], stem: &Path, theme: Theme) -> anyhow::Result<Vec<PathBuf>> {
    let mut copied = Vec::new();
    for path in there {
        let extension = path.extension().unwrap_or_default().to_string_lossy().into_owned();
        let is_drawing = ["svg", "pdf", "png"].contains(&extension.as_str());
        let bytes = files::read_bounded(path, LARGEST_FILE)?;
        if is_drawing && theme != Theme::Light {
            if extension == "svg" {
                let svg = theme.apply(&String::from_utf8_lossy(&bytes));
                copied.extend(write_figure(stem, &svg)?);
            }
            continue;
        }
        let mut name = stem.file_name().unwrap_or_default().to_os_string();
        name.push(format!(".{extension}"));
        let target = stem.with_file_name(name);
        files::write_atomic(&target, &bytes)?;
        copied.push(target);
    }
    Ok(copied)
}

/// The files of one entry.
struct Sheet {
    stem: PathBuf,
    theme: Theme,
    files: Vec<PathBuf>,
}

impl Sheet {
    fn figure(&mut self, svg: &str) -> anyhow::Result<()> {
        self.files.extend(write_figure(&self.stem, &self.theme.apply(svg))?);
        Ok(())
    }

    fn table(&mut self, table: &Table) -> anyhow::Result<()> {
        let name = self.stem.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let [parquet, csv] = ["parquet", "csv"]
            .map(|extension| self.stem.with_file_name(format!("{name}.{extension}")));
        write_parquet(&parquet, table, &[])?;
        write_csv(&csv, table)?;
        self.files.extend([parquet, csv]);
        Ok(())
    }

    /// Draws from published data, and says from which; `None` if it is not there.
    fn draw(&mut self, published: Published, sources: &Sources) -> anyhow::Result<Option<String>> {
        const PRINTED: &str = "the paper's printed tables";
        const TASK_AND_POOLED: [Basis; 2] = [Basis::TaskSpecific, Basis::Pooled];
        match published {
            Published::Radar => {
                self.figure(&printed_radar().to_svg()?)?;
                self.table(&PrintedTable::Tasks.table()?)?;
            }
            Published::Bars => {
                self.figure(&printed_ablation().to_svg()?)?;
                self.table(&PrintedTable::Tasks.table()?)?;
            }
            Published::Experts => {
                let Some(experts) = &sources.experts else { return Ok(None) };
                self.figure(&expert_figure(experts).to_svg()?)?;
                self.table(&expert_table(experts)?)?;
                return Ok(Some("published results".to_owned()));
            }
            Published::Table(table) => self.table(&table.table()?)?,
            Published::MeanCurves => {
                let Some(curves) = &sources.curves else { return Ok(None) };
                self.figure(&curves.mean_figure().to_svg()?)?;
                self.table(&curves.table()?)?;
                return Ok(Some("published curves".to_owned()));
            }
            Published::PcaCurves => return self.curves(sources, "pca", &TASK_AND_POOLED),
            Published::NmfCurves => return self.curves(sources, "nmf", &TASK_AND_POOLED),
            Published::ExpertCurves => {
                let kinds = [Basis::TaskSpecific, Basis::Pooled, Basis::Expert];
                return self.curves(sources, "pca", &kinds);
            }
        }
        Ok(Some(PRINTED.to_owned()))
    }

    /// Published curves per task, with one's own in front where there are some.
    fn curves(
        &mut self,
        sources: &Sources,
        method: &str,
        kinds: &[Basis],
    ) -> anyhow::Result<Option<String>> {
        let Some(curves) = &sources.curves else { return Ok(None) };
        let own =
            sources.ours.as_ref().filter(|(own, _)| own.points.iter().any(|p| p.method == method));
        let Some(svg) = curves.task_figure(method, kinds, own.map(|(own, _)| own))? else {
            return Ok(None);
        };
        self.figure(&svg)?;
        self.table(&curves.table()?)?;
        Ok(Some(own.map_or_else(
            || "published curves".to_owned(),
            |(_, run)| format!("run {run} over published curves"),
        )))
    }
}

/// The page, and the figures of runs that no entry took.
fn write_gallery(
    context: &Context,
    made: &[Made],
    runs: &[FinishedRun],
    out: &Path,
) -> anyhow::Result<()> {
    let mut pictures: Vec<Picture> = Vec::new();
    for made in made.iter().filter(|made| made.from.is_some()) {
        let has = |extension: &str| made.files.iter().any(|f| files::has_extension(f, extension));
        if has("svg") {
            let others = ["pdf", "parquet", "csv"].into_iter().filter(|e| has(e));
            pictures.push(Picture {
                title: made.entry.id.to_owned(),
                shows: made.entry.shows.to_owned(),
                from: made.from.clone().unwrap_or_default(),
                stem: made.entry.stem.to_owned(),
                others: others.map(str::to_owned).collect(),
            });
        }
    }
    let mut by_name: Vec<&FinishedRun> = runs.iter().collect();
    by_name.sort_by_key(|run| &run.folder);
    for run in by_name {
        let name = run.folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        for file in &run.manifest.files {
            let taken = || {
                INDEX.iter().any(|e| {
                    e.command == run.manifest.command
                        && Some(e.file) == file.name.strip_suffix(".svg")
                })
            };
            let Some(stem) = file.name.strip_suffix(".svg").filter(|_| !taken()) else { continue };
            let target = format!("{}_{stem}", run.manifest.command);
            // A manifest from elsewhere may call its command as it likes.
            let is_name = Path::new(&target).components().count() == 1;
            if !is_name || pictures.iter().any(|picture| picture.stem == target) {
                continue;
            }
            let Some(path) = run.intact(file) else { continue };
            let svg = files::read_bounded(&path, LARGEST_FILE)?;
            write_figure(&out.join(&target), &context.theme.apply(&String::from_utf8_lossy(&svg)))?;
            pictures.push(Picture {
                title: run.manifest.command.clone(),
                shows: if stem == run.manifest.command {
                    String::new()
                } else {
                    stem.replace('_', " ")
                },
                from: format!("run {name}"),
                stem: target,
                others: vec!["pdf".to_owned()],
            });
        }
    }
    let words = format!("arnold-analyze {}", context.words.join(" "));
    files::write_atomic(&out.join("README.md"), gallery::page(&pictures, &words).as_bytes())?;
    Ok(())
}

fn document(made: &[Made]) -> Value {
    let entry = |made: &Made| {
        json!({
            "id": made.entry.id,
            "name": made.entry.stem,
            "shows": made.entry.shows,
            "from": made.from,
            "files": made.files,
            "make": made.entry.make,
        })
    };
    json!({"command": "figures", "figures": made.iter().map(entry).collect::<Vec<_>>()})
}

fn text(made: &[Made], out: &Path) -> String {
    let columns = [("", Align::Left), ("name", Align::Left), ("from", Align::Left)];
    let done = made.iter().filter_map(|made| Some((made, made.from.clone()?)));
    let rows: Vec<Vec<String>> = done
        .map(|(made, from)| vec![made.entry.id.to_owned(), made.entry.stem.to_owned(), from])
        .collect();
    let mut text = String::new();
    if !rows.is_empty() {
        text += &render::table(&columns, &rows);
        let counts = format!("\n{} of {} written to {}/\n", rows.len(), made.len(), out.display());
        text += &counts;
    }
    let missing: Vec<&Made> = made.iter().filter(|made| made.from.is_none()).collect();
    if missing.is_empty() {
        return text;
    }
    text += if text.is_empty() { "Missing\n" } else { "\nMissing\n" };
    // What one command makes stands together.
    let mut makers: Vec<&str> = missing.iter().map(|made| made.entry.make).collect();
    let mut seen = std::collections::BTreeSet::new();
    makers.retain(|make| seen.insert(*make));
    for make in makers {
        for made in missing.iter().filter(|made| made.entry.make == make) {
            let IndexEntry { id, stem, shows, .. } = made.entry;
            let line = format!("  {id:<10}  {stem:<24}  {shows}\n");
            text += &line;
        }
        for command in make.split_inclusive(" && ") {
            text += &render::command_lines(command.trim_end());
        }
    }
    text
}
