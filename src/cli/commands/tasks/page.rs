//! One task on a page of 80 columns.

use crate::cli::render::{self, Align};
use crate::sim::environment::Environment;
use crate::sim::tasks::{Chosen, Definition, Event, RewardConfiguration, Start, Task, Threshold};

/// Columns of a terminal that nobody widened.
const WIDTH: usize = 80;

/// The whole page.
pub(super) fn text(task: &Definition, environment: &Environment) -> String {
    let played = environment.task();
    let muscles = environment.muscles();
    let clean: usize = clean_blocks(played).map(|(_, _, length)| length).sum();
    let sections = [
        format!("{} ({})\n{}\n", task.name, task.paper_name, task.summary),
        overview(task, environment),
        section("Start of an episode", &starts(&played.starts())),
        section("Reward", &rewards(played)),
        section(
            &format!(
                "Observation, {} elements; a single-task expert sees {clean}, marked *",
                played.layout().len()
            ),
            &observation(played),
        ),
        section(
            &format!("Muscles, {}, in the order of an action", muscles.len()),
            &lines(&muscles.join(" ")),
        ),
    ];
    sections.join("\n")
}

fn section(title: &str, body: &str) -> String {
    format!("{title}\n\n{body}")
}

/// Time between two actions.
fn interval(task: &Definition) -> String {
    format!("{:.0} ms", 1000.0 * task.control_interval())
}

fn overview(task: &Definition, environment: &Environment) -> String {
    let thresholds = environment.task().thresholds();
    let of = |event: Event| {
        let chosen = thresholds.iter().filter(move |threshold| threshold.event == event);
        chosen.map(condition).collect::<Vec<_>>()
    };
    let simulation = environment.simulation();
    let body = format!(
        "{}: {} muscles, {} coordinates, {} velocities",
        task.body,
        simulation.excitation().len(),
        simulation.qpos().len(),
        simulation.qvel().len()
    );
    let seconds = number(task.control_interval() * task.horizon as f64);
    let episode = format!("{} steps of {}, at most {seconds} s", task.horizon, interval(task));
    let mut rows = vec![("Body", body), ("Episode", episode)];
    rows.push(("Solved while", of(Event::Solved).join(" and ")));
    rows.push(("Ends when", of(Event::Ends).join(" or ")));
    rows.push(("Environment", task.environment.unwrap_or("none published").to_owned()));
    rows.push(("Model", task.model.to_owned()));
    let mut text = String::new();
    for (name, value) in rows {
        let mut name = name;
        for line in wrap(&value, WIDTH - 14) {
            text.extend([format!("{name:<14}").as_str(), &line, "\n"]);
            name = "";
        }
    }
    text
}

fn condition(threshold: &Threshold) -> String {
    let sign = if threshold.above { ">" } else { "<" };
    measure(&format!("{} {sign} {}", threshold.quantity, number(threshold.value)), threshold.unit)
}

fn measure(number: &str, unit: &str) -> String {
    if unit.is_empty() { number.to_owned() } else { format!("{number} {unit}") }
}

/// A number with at most six significant digits.
fn number(x: f64) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    let decimals = (5.0 - x.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{x:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

fn vector(numbers: &[f64]) -> String {
    match numbers {
        [one] => number(*one),
        _ => format!("({})", numbers.iter().map(|&x| number(x)).collect::<Vec<_>>().join(", ")),
    }
}

fn alike(numbers: &[f64]) -> bool {
    numbers.iter().all(|x| x.to_bits() == numbers[0].to_bits())
}

fn starts(starts: &[Start]) -> String {
    let how = |start: &Start| match &start.chosen {
        Chosen::Uniform { low, high } if low.len() > 1 && alike(low) && alike(high) => {
            measure(&format!("uniform, {} to {}", number(low[0]), number(high[0])), start.unit)
                + " each"
        }
        Chosen::Uniform { low, high } => {
            measure(&format!("uniform, {} to {}", vector(low), vector(high)), start.unit)
        }
        Chosen::Fixed(values) => measure(&vector(values), start.unit),
        Chosen::OneOf(choices) => format!("one of {}, equally likely", choices.join(", ")),
        Chosen::Rule(rule) => (*rule).to_owned(),
    };
    let columns = [("what", Align::Left), ("how it is chosen", Align::Left)];
    wrapped_table(&columns, starts.iter().map(|start| vec![start.quantity.clone(), how(start)]))
}

fn rewards(task: &dyn Task) -> String {
    let weight = |configuration, component: &str| {
        let weights = task.weights(configuration).iter();
        let found = weights.clone().find(|(name, _)| *name == component);
        found.map_or_else(|| "–".to_owned(), |&(_, weight)| number(weight))
    };
    let columns = [
        ("component", Align::Left),
        ("benchmark (sparse)", Align::Right),
        ("training (dense)", Align::Right),
    ];
    let row = |component: &&str| {
        let of = |configuration| weight(configuration, component);
        vec![
            (*component).to_owned(),
            of(RewardConfiguration::Sparse),
            of(RewardConfiguration::Dense),
        ]
    };
    let components = task.components();
    let (weighted, idle): (Vec<_>, Vec<_>) =
        components.iter().map(row).partition(|row| row[1] != "–" || row[2] != "–");
    let mut text = render::table(&columns, &weighted);
    if !idle.is_empty() {
        let names: Vec<String> = idle.into_iter().map(|row| row[0].clone()).collect();
        let sentence = format!("Computed without weight: {}", names.join(", "));
        text.push('\n');
        text += &lines(&sentence);
    }
    text
}

/// Key, unit and length of each block of the clean observation, in its order.
pub(super) fn clean_blocks(
    task: &dyn Task,
) -> impl Iterator<Item = (&'static str, &'static str, usize)> {
    let layout = task.layout();
    let worded = layout.blocks().iter().map(|b| (b.key, b.unit, b.phrases.len()));
    let unworded = layout.clean_only().iter().map(|b| (b.key, b.unit, b.length));
    let blocks: Vec<_> = worded.chain(unworded).collect();
    let find = move |key: &&str| blocks.iter().find(|block| block.0 == *key).copied();
    task.clean_keys().iter().filter_map(find)
}

fn observation(task: &dyn Task) -> String {
    let columns = [
        ("", Align::Left),
        ("index", Align::Right),
        ("key", Align::Left),
        ("unit", Align::Left),
        ("words", Align::Left),
    ];
    let clean = task.clean_keys();
    let mut start = 0;
    let mut rows = Vec::new();
    for block in task.layout().blocks() {
        let end = start + block.phrases.len();
        rows.push(vec![
            if clean.contains(&block.key) { "*" } else { "" }.to_owned(),
            span(start, end),
            block.key.to_owned(),
            block.unit.to_owned(),
            pattern(&block.phrases),
        ]);
        start = end;
    }
    for block in task.layout().clean_only() {
        rows.push(vec![
            "*".to_owned(),
            format!("{} more", block.length),
            block.key.to_owned(),
            block.unit.to_owned(),
            "(for the expert only)".to_owned(),
        ]);
    }
    wrapped_table(&columns, rows.into_iter())
}

fn span(start: usize, end: usize) -> String {
    if end == start + 1 { start.to_string() } else { format!("{start}–{}", end - 1) }
}

/// What the phrases of a block have in common; where they differ, the few words or what they are names of.
fn pattern(phrases: &[Vec<String>]) -> String {
    let first = &phrases[0];
    let word_at = |place: usize| {
        let mut words: Vec<&str> = Vec::new();
        for word in phrases.iter().filter_map(|phrase| phrase.get(place)) {
            if !words.contains(&word.as_str()) {
                words.push(word);
            }
        }
        match &words[..] {
            [word] => (*word).to_owned(),
            few if few.len() <= 3 => few.join("|"),
            _ => format!("<{}>", first.last().map_or("name", String::as_str)),
        }
    };
    (0..first.len()).map(word_at).collect::<Vec<_>>().join(" ")
}

/// A table whose last column goes on below itself where it would pass the page's edge.
pub(super) fn wrapped_table(
    columns: &[(&str, Align)],
    rows: impl Iterator<Item = Vec<String>>,
) -> String {
    let rows: Vec<Vec<String>> = rows.collect();
    let last = columns.len() - 1;
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.fold(columns[column].0.chars().count(), usize::max)
    };
    let before: usize = (0..last).map(|column| width(column) + 2).sum();
    let mut wrapped = Vec::new();
    for mut row in rows.iter().cloned() {
        let cell = row.pop().unwrap_or_default();
        for line in wrap(&cell, WIDTH.saturating_sub(before).max(20)) {
            let blank = vec![String::new(); last];
            let mut cells = std::mem::replace(&mut row, blank);
            cells.push(line);
            wrapped.push(cells);
        }
    }
    render::table(columns, &wrapped)
}

/// `text` as lines that fit the page.
fn lines(text: &str) -> String {
    wrap(text, WIDTH).join("\n") + "\n"
}

/// `text` in lines of at most `width` characters, broken at spaces outside parentheses; at least one line.
fn wrap(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    let mut open = 0_usize;
    let outside = |c: char| {
        match c {
            '(' => open += 1,
            ')' => open = open.saturating_sub(1),
            _ => {}
        }
        c == ' ' && open == 0
    };
    for word in text.split(outside) {
        let line = lines.len() - 1;
        let current = &mut lines[line];
        if current.is_empty() {
            current.push_str(word);
        } else if current.chars().count() + 1 + word.chars().count() <= width {
            current.push(' ');
            current.push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_six_digits_and_no_idle_zeros() {
        for (x, want) in [
            (0.0, "0"),
            (0.00008, "0.00008"),
            (-1.5, "-1.5"),
            (100.0, "100"),
            (std::f64::consts::TAU, "6.28319"),
            (0.707_318_365_573_883_1, "0.707318"),
            (1_234_567.0, "1234567"),
        ] {
            assert_eq!(number(x), want);
        }
    }

    #[test]
    fn lines_break_at_spaces_and_lose_nothing() {
        assert_eq!(wrap("one two three", 7), ["one two", "three"]);
        assert_eq!(wrap("incomprehensible", 4), ["incomprehensible"]);
        assert_eq!(wrap("", 4), [""]);
        assert_eq!(wrap("from (1, 2) to (3, 4)", 12), ["from (1, 2)", "to (3, 4)"]);
    }

    #[test]
    fn a_pattern_names_what_differs() {
        let phrases = |list: &[&str]| -> Vec<Vec<String>> {
            list.iter().map(|p| p.split(' ').map(str::to_owned).collect()).collect()
        };
        assert_eq!(
            pattern(&phrases(&["pen linear x", "pen linear y", "pen linear z"])),
            "pen linear x|y|z"
        );
        let joints =
            phrases(&["a angular joint", "b angular joint", "c angular joint", "d angular joint"]);
        assert_eq!(pattern(&joints), "<joint> angular joint");
        assert_eq!(pattern(&phrases(&["elbow position"])), "elbow position");
    }
}
