//! `emg`: how human is the muscle activity of walking?

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::walking::{self, CycleArguments, Labelled, Leg, Walks};
use crate::analysis::emg::{BicepsFemoris, HUMAN_CHANNELS};
use crate::analysis::undefined::Undefined;
use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::PlayArguments;
use crate::cli::render::{self, Align, Hinted};
#[cfg(feature = "view")]
use crate::cli::viewing::WatchArguments;
use crate::experiment::emg::{EmgOptions, EmgResult, HUMAN};
use crate::experiment::emg_subjects::{Subjects, SubjectsError, WalkingSpeed, read_subjects};

/// Arguments of `emg`.
#[derive(Debug, Args)]
pub struct EmgArguments {
    /// Folder of human EMG; `setup --emg` fetches one [default: `emg` in the data folder]
    #[arg(long, value_name = "DIR")]
    subjects: Option<PathBuf>,
    /// Speed at which people walked, km/h
    #[arg(long, value_name = "KM/H", default_value = "4.5", value_parser = speed)]
    speed: WalkingSpeed,
    /// Recordings of walking, one per policy; named by its label, else by its file
    #[arg(long, value_name = "[LABEL=]FILE", num_args = 1.., value_parser = walking::labelled)]
    recording: Vec<Labelled>,
    /// Leg of the simulation
    #[arg(long, value_enum, default_value_t = Leg::Left)]
    side: Leg,
    /// Head of the biceps femoris that stands for the electrode
    #[arg(long, value_enum, default_value_t = Head::Long)]
    bf: Head,
    /// Average over what is defined where a correlation is not
    #[arg(long)]
    skip_undefined: bool,
    /// A policy without a gait cycle is a result, not an error
    #[arg(long)]
    allow_empty: bool,
    #[command(flatten)]
    cycles: CycleArguments,
    #[command(flatten)]
    play: PlayArguments,
    #[cfg(feature = "view")]
    #[command(flatten)]
    watch: WatchArguments,
}

/// A head of the biceps femoris.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Head {
    Long,
    Short,
}

/// Tenths of km/h, as the names of the files have it.
fn speed(text: &str) -> Result<WalkingSpeed, String> {
    let tenths = text.parse::<f64>().map(|speed| (10.0 * speed).round());
    match tenths {
        Ok(tenths) if (1.0..=99.0).contains(&tenths) => Ok(WalkingSpeed(tenths as u8)),
        _ => Err("expected a walking speed, 0.1 to 9.9 km/h".to_owned()),
    }
}

/// Runs the command.
pub fn run(context: &Context, arguments: &EmgArguments) -> anyhow::Result<Outcome> {
    let options = EmgOptions {
        side: arguments.side.into(),
        biceps_femoris: match arguments.bf {
            Head::Long => BicepsFemoris::LongHead,
            Head::Short => BicepsFemoris::ShortHead,
        },
        walk: arguments.cycles.options(),
        undefined: if arguments.skip_undefined { Undefined::Skip } else { Undefined::Propagate },
        allow_empty: arguments.allow_empty,
    };
    let folder = arguments.subjects.clone().unwrap_or_else(|| context.data.join("emg"));
    let subjects = read_subjects(&folder, arguments.speed).map_err(|error| {
        if let SubjectsError::OtherSpeed { walked, .. } = error {
            return Hinted::new(error.to_string(), format!("`--speed {walked:.1}`"));
        }
        let hint = "`arnold-analyze setup --emg` fetches the published people into the data folder, `--subjects DIR` \
                    names another; the format is in `data/emg/README.md`";
        Hinted::new(error.to_string(), hint)
    })?;
    warn_of_invented_people(context, &subjects);
    let walks = Walks::open(context, &arguments.recording, &arguments.play, &options.walk)?;
    let names = walks.names();
    for (place, name) in names.iter().enumerate() {
        if *name == HUMAN || names[..place].contains(name) {
            return Err(Hinted::new(
                format!("two things are called `{name}`"),
                "name each recording: `--recording arnold=FILE obc=FILE`",
            ));
        }
    }
    let plan = json!({
        "subjects_blake3": subjects.hash,
        "synthetic": subjects.synthetic,
        "speed_km_h": arguments.speed.to_string(),
        "side": options.side.suffix(),
        "biceps_femoris": format!("{:?}", options.biceps_femoris),
        "cycles": arguments.cycles.decides(),
        "undefined": format!("{:?}", options.undefined),
        "allow_empty": options.allow_empty,
        "walks": walks.plan,
    });
    let (folder, finished) = finish::open_below(context, arguments.play.out(), "emg", &plan)?;
    if let Some(manifest) = finished {
        #[cfg(feature = "view")]
        walks.show(context, &arguments.recording, arguments.watch.anywhere())?;
        finish::print(context, &folder, &manifest, &table)?;
        return Ok(outcome(&manifest.result));
    }
    #[cfg(feature = "view")]
    let walks = walks.watched(&arguments.watch)?;
    #[cfg(feature = "view")]
    let plays = walks.plays();
    let Some((walks, machine)) = walks.all(context, &folder)? else { return Ok(Outcome::Done) };
    let result = EmgResult::of(subjects, &walks, options).map_err(walking::with_hint)?;
    for warning in result.policies.iter().flat_map(|policy| &policy.warnings) {
        context.say(&format!("warning: {warning}"));
    }
    let mut output = Output::new(&folder);
    output.tidy("correlations", &result.correlation_table()?)?;
    output.tidy("subject_means", &result.subject_table()?)?;
    if !result.policies.is_empty() {
        if !result.comparisons.is_empty() {
            output.tidy("comparisons", &result.comparison_table()?)?;
        }
        output.tidy("gait_cycles", &result.cycle_table()?)?;
        let (simulation, counts) = result.simulation();
        output.written("simulation.npz", |path| simulation.write(path))?;
        output.json("simulation.json", &counts)?;
    }
    output.figure("correlations", &result.correlation_figure().to_svg()?)?;
    output.figure("profiles", &result.profile_figure().to_svg()?)?;
    let manifest = output.finish_with(json!([]), result.document(), machine)?;
    #[cfg(feature = "view")]
    if let (false, Some(viewer)) = (plays, arguments.watch.anywhere()) {
        walking::show_recorded(context, &arguments.recording, viewer)?;
    }
    finish::print(context, &folder, &manifest, &table)?;
    Ok(outcome(&manifest.result))
}

/// A policy without a gait cycle was skipped, or a person of whom something is missing.
fn outcome(result: &Value) -> Outcome {
    let mut policies = result["policies"].as_array().into_iter().flatten();
    let complete = result["people"]["left_out"].as_array().is_none_or(Vec::is_empty);
    if !complete || policies.any(|policy| policy["correlation"].is_null()) {
        Outcome::SomethingSkipped
    } else {
        Outcome::Done
    }
}

/// Says so before anything else is said.
fn warn_of_invented_people(context: &Context, subjects: &Subjects) {
    if subjects.synthetic {
        eprintln!(
            "warning: THE PEOPLE IN `{}` ARE INVENTED; numbers made with them say nothing about humans. \
             `arnold-analyze setup --emg` fetches real ones",
            subjects.folder.display()
        );
    }
    for text in &subjects.left_out {
        eprintln!("warning: {text}");
    }
    let (count, speed) = (subjects.people.subjects().len(), subjects.speed);
    context.say(&format!("People: {count} at {speed} km/h, {}\n", subjects.folder.display()));
}

fn number(value: &Value, digits: usize) -> String {
    value.as_f64().map_or_else(|| "–".to_owned(), |x| format!("{x:.digits$}"))
}

fn table(result: &Value) -> String {
    let people = &result["people"];
    let policies = || result["policies"].as_array().into_iter().flatten();
    let walked = || policies().filter(|policy| policy["correlation"].is_object());
    let found: Vec<&Value> = [&people["leave_one_out"], &people["pairwise"]]
        .into_iter()
        .chain(walked().map(|policy| &policy["correlation"]))
        .collect();
    let titles = ["leave-one-out", "pairwise"].into_iter();
    let titles = titles.chain(walked().filter_map(|policy| policy["policy"].as_str()));
    let columns: Vec<(&str, Align)> = [("correlation (r)", Align::Left)]
        .into_iter()
        .chain(titles.map(|title| (title, Align::Right)))
        .collect();
    let row = |label: String, value: &dyn Fn(&Value) -> String| -> Vec<String> {
        [label].into_iter().chain(found.iter().map(|found| value(found))).collect()
    };
    let mut rows: Vec<Vec<String>> = HUMAN_CHANNELS
        .iter()
        .enumerate()
        .map(|(place, muscle)| {
            row((*muscle).to_owned(), &|found| number(&found["muscles"][place], 4))
        })
        .collect();
    rows.push(row("Mean of nine muscles".to_owned(), &|found| number(&found["mean"], 4)));
    rows.push(row("  ± s.e.m.".to_owned(), &|found| number(&found["sem"], 4)));
    let faulty: Vec<&str> = people["faulty_muscles"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    if !faulty.is_empty() {
        let label = match faulty[..] {
            [muscle] => format!("  without {muscle}"),
            _ => format!("  without {} muscles below", faulty.len()),
        };
        rows.push(row(label, &|found| number(&found["without_faulty_muscles"], 4)));
    }
    let mut text = render::table(&columns, &rows);
    text += &faults(people);
    if policies().next().is_some() {
        text += &cycles(result);
    }
    text += &comparisons(result);
    if people["synthetic"] == true {
        text.push_str("\nTHE PEOPLE ARE INVENTED: this says nothing about humans.\n");
    }
    text
}

/// The dead and flat channels, a line each.
fn faults(people: &Value) -> String {
    let line = |fault: &Value| {
        format!(
            "{} of subject {} is {}: {} to {}\n",
            fault["muscle"].as_str().unwrap_or_default(),
            fault["subject"],
            fault["fault"].as_str().unwrap_or_default(),
            number(&fault["range"][0], 5),
            number(&fault["range"][1], 5),
        )
    };
    let lines: String = people["faults"].as_array().into_iter().flatten().map(line).collect();
    if lines.is_empty() { lines } else { format!("\n{lines}") }
}

fn cycles(result: &Value) -> String {
    let columns = [
        ("gait cycles", Align::Left),
        ("detected", Align::Right),
        ("retained", Align::Right),
        ("fits best delayed by", Align::Right),
    ];
    let row = |policy: &Value| {
        let delay = number(&policy["best_delay_percent"], 0);
        vec![
            policy["policy"].as_str().unwrap_or_default().to_owned(),
            policy["detected"].to_string(),
            policy["retained"].to_string(),
            if delay == "–" { delay } else { format!("{delay} %") },
        ]
    };
    let policies = result["policies"].as_array().into_iter().flatten();
    format!("\n{}", render::table(&columns, &policies.map(row).collect::<Vec<_>>()))
}

fn comparisons(result: &Value) -> String {
    let columns = [
        ("Wilcoxon, paired over people", Align::Left),
        ("n", Align::Right),
        ("W", Align::Right),
        ("p", Align::Right),
        ("p (Bonferroni)", Align::Right),
    ];
    let rows: Vec<Vec<String>> = result["comparisons"]
        .as_array()
        .into_iter()
        .flatten()
        .map(|pair| {
            let name = |key: &str| pair[key].as_str().unwrap_or_default();
            vec![
                format!("{} – {}", name("a"), name("b")),
                pair["n_subjects"].to_string(),
                number(&pair["W"], 1),
                number(&pair["p_raw"], 4),
                number(&pair["p_bonferroni"], 4),
            ]
        })
        .collect();
    if rows.is_empty() { String::new() } else { format!("\n{}", render::table(&columns, &rows)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_are_those_of_file_names() {
        assert_eq!(speed("4.5"), Ok(WalkingSpeed(45)));
        assert_eq!(speed("0.9").unwrap().to_string(), "0.9");
        for wrong in ["0", "-1", "NaN", "12", "fast"] {
            assert!(speed(wrong).is_err(), "{wrong}");
        }
    }
}
