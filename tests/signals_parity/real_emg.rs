//! The whole EMG chain on published data: nine people walking at 4.5 km/h (Wang et al. 2023) and a recording of the
//! KINESIS policy (Simos et al. 2025), against numbers computed independently (`emg_real.json`).
//!
//! The data lie beside the golden folder, in `data/emg_wang2023_kinesis_assets`; they are not ours to commit.

use std::path::PathBuf;

use arnold_analyze::analysis::emg::{
    self, BicepsFemoris, Correlations, CycleProfile, Fault, GaitEpisode, GaitOptions,
    HUMAN_CHANNELS, HumanProfiles, Segmentation, Side, Verdict,
};
use arnold_analyze::analysis::factor::{
    self, ExtractionOptions, ReferenceRotationOptions, Rotation,
};
use arnold_analyze::analysis::signal::Rows;
use arnold_analyze::analysis::undefined::Undefined;
use arnold_analyze::npz::{Array, parse_npy};
use serde_json::Value;

use super::human_folder::{people_in, texts};
use super::{common, numbers};

/// Rate of the recording, Hz.
const SAMPLE_RATE: f64 = 30.0;
/// What a foot on the ground is set to; the recording only says whether it is.
const CONTACT: f64 = 600.0;
const VASTUS_LATERAL: usize = 6;

/// The golden numbers and the data, if both are here.
fn material() -> Option<(Value, Data)> {
    let golden = common::golden("analysis")?;
    let folder = golden.join("../../data/emg_wang2023_kinesis_assets/emg_assets");
    if !folder.is_dir() {
        eprintln!("skipped: there is no folder `{}`", folder.display());
        return None;
    }
    let json = std::fs::read(golden.join("emg_real.json")).unwrap();
    Some((serde_json::from_slice(&json).unwrap(), Data { folder }))
}

struct Data {
    folder: PathBuf,
}

impl Data {
    fn array(&self, name: &str) -> Array {
        parse_npy(name, &std::fs::read(self.folder.join(name)).unwrap()).unwrap()
    }

    fn people(&self) -> HumanProfiles {
        people_in(&self.folder.join("human_emg"))
    }

    /// The KINESIS recording: contacts, activations, names of the muscles. Row 0 of the files is not a number.
    fn walk(&self) -> (Vec<f64>, Vec<f64>, Vec<String>) {
        let down = |codes: [f64; 2], code: f64| if codes.contains(&code) { CONTACT } else { 0.0 };
        let row = |code: &f64| [down([1.0, 2.0], *code), 0.0, down([0.0, 2.0], *code), 0.0];
        let contacts = self.array("kinesis/gait.npy").to_f64()[1..].iter().flat_map(row).collect();
        let controls = self.array("kinesis/muscle_controls.npy").to_f64();
        let names = texts(&self.folder.join("misc/muscle_names.npy"));
        (contacts, controls[names.len()..].to_vec(), names)
    }
}

/// Averages `muscles` over the cycles of the recording that begin with a strike of `side`.
fn profile(data: &Data, side: Side, muscles: &[String]) -> (Segmentation, CycleProfile) {
    let (contacts, activations, names) = data.walk();
    let contacts = Rows::new(&contacts, 4).unwrap();
    let velocity = vec![1.0; contacts.len()];
    let root_velocity = Rows::new(&velocity, 1).unwrap();
    let episode = GaitEpisode { contacts, root_velocity, sample_rate: SAMPLE_RATE };
    let found = emg::segment(&[episode], side, &GaitOptions::default()).unwrap();
    let activations = [Rows::new(&activations, names.len()).unwrap()];
    let columns = emg::columns_named(&names, muscles).unwrap();
    let profile = emg::cycle_profile(&found, &activations, &columns, 200, None).unwrap();
    (found, profile)
}

fn floats(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(floats).collect(),
        Value::Bool(flag) => vec![f64::from(u8::from(*flag))],
        value => vec![value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))],
    }
}

fn assert_close(found: &[f64], want: &Value, tolerance: f64, what: &str) {
    let want = floats(want);
    assert_eq!(found.len(), want.len(), "{what}");
    for (at, (found, want)) in found.iter().zip(&want).enumerate() {
        let difference = (found - want).abs();
        assert!(difference <= tolerance * (1.0 + want.abs()), "{what}[{at}]: {found}, not {want}");
    }
}

/// Compares everything the golden numbers say about a set of correlations.
fn assert_correlations(found: &Correlations, want: &Value, what: &str) {
    let check = |name: &str, values: &[f64]| {
        if !want[name].is_null() {
            assert_close(values, &want[name], 1e-8, &format!("{what} {name}"));
        }
    };
    let all = Undefined::Propagate;
    check("r", &found.rows().iter().flat_map(|row| numbers(row)).collect::<Vec<_>>());
    check("pair_mean", &numbers(&found.row_means(&[], all)));
    check("subject_mean", &numbers(&found.row_means(&[], all)));
    check("muscle_mean", &numbers(&found.channel_means(all)));
    check("overall", &numbers(&[found.overall(&[], all)]));
    let without = found.overall(&[VASTUS_LATERAL], all);
    check("overall_without_vastus_lateral", &numbers(&[without]));
}

#[test]
fn nine_people_agree_with_each_other_as_published() {
    let Some((golden, data)) = material() else { return };
    let people = data.people();
    let pairs = emg::pairwise(&people).unwrap();
    let numbered: Vec<f64> =
        pairs.pairs.iter().flat_map(|&(a, b)| [f64::from(a), f64::from(b)]).collect();
    assert_close(&numbered, &golden["pairwise"]["pairs"], 0.0, "pairs");
    assert_correlations(&pairs.correlations, &golden["pairwise"], "pairwise");
    let ceiling = emg::leave_one_out(&people).unwrap();
    assert_correlations(&ceiling, &golden["leave_one_out"], "leave-one-out");
    let overall = |found: &Correlations| found.overall(&[], Undefined::Propagate).unwrap();
    assert!((overall(&ceiling) - 0.8212).abs() < 1e-4);
    assert!((overall(&pairs.correlations) - 0.7314).abs() < 1e-4);
}

#[test]
fn the_dead_and_the_flat_channel_are_named_and_no_other() {
    let Some((_, data)) = material() else { return };
    let faults = emg::channel_faults(&data.people());
    let found: Vec<_> = faults.iter().map(|f| (f.subject, f.channel, f.fault)).collect();
    assert_eq!(found, [(4, VASTUS_LATERAL, Fault::Flat), (11, VASTUS_LATERAL, Fault::Dead)]);
    assert_eq!(emg::faulty_muscles(&faults), [VASTUS_LATERAL]);
}

#[test]
fn the_published_walk_correlates_with_people_as_recorded() {
    let Some((golden, data)) = material() else { return };
    let people = data.people();
    let mut walks = Vec::new();
    for (name, side, head, overall) in [
        ("left_long_head", Side::Left, BicepsFemoris::LongHead, 0.2211),
        ("left_short_head", Side::Left, BicepsFemoris::ShortHead, 0.2889),
        ("right_long_head", Side::Right, BicepsFemoris::LongHead, 0.1668),
    ] {
        let want = &golden["kinesis_recording"]["results"][name];
        let muscles = emg::model_muscles(side, head);
        assert_eq!(serde_json::to_value(&muscles).unwrap(), want["model_muscles"]);
        let (segmentation, profile) = profile(&data, side, &muscles);
        let counts = [profile.detected, profile.retained].map(|count| count as f64);
        assert_close(&counts[..1], &want["detected"], 0.0, "detected");
        assert_close(&counts[1..], &want["retained"], 0.0, "retained");
        let cycles: Vec<f64> = segmentation
            .cycles
            .iter()
            .flat_map(|cycle| {
                let kept = u8::from(cycle.verdict == Verdict::Kept);
                [cycle.start as f64, cycle.end as f64, f64::from(kept)]
            })
            .collect();
        assert_close(&cycles, &want["cycles"], 0.0, "cycles");
        let rows = profile.rows().unwrap();
        if !want["profile_every_20th_point"].is_null() {
            let every_20th: Vec<f64> = rows.iter().step_by(20).flat_map(<[f64]>::to_vec).collect();
            assert_close(&every_20th, &want["profile_every_20th_point"], 1e-8, "profile");
        }
        let found = emg::correlate(&people, &rows).unwrap();
        assert_correlations(&found, want, name);
        assert!((found.overall(&[], Undefined::Propagate).unwrap() - overall).abs() < 1e-4);
        let table = emg::correlation_rows(name, &people, &found);
        assert_eq!((table.len(), table[10].subject, table[10].muscle), (81, 5, HUMAN_CHANNELS[1]));
        walks.push((name.to_owned(), found.row_means(&[], Undefined::Propagate)));
    }
    let wanted = golden["comparisons"].as_array().unwrap();
    let rows = emg::comparisons(&walks).unwrap();
    assert_eq!(rows.len(), wanted.len());
    for (row, want) in rows.iter().zip(wanted) {
        let row = serde_json::to_value(row).unwrap();
        assert_eq!((&row["a"], &row["b"]), (&want["a"], &want["b"]));
        for name in ["n_subjects", "W", "p_raw", "p_bonferroni"] {
            assert_close(&floats(&row[name]), &want[name], 1e-8, name);
        }
    }
}

#[test]
fn the_factors_of_the_published_walk_are_those_recorded() {
    let Some((golden, data)) = material() else { return };
    let want = &golden["factors"];
    let (_, profile) = profile(&data, Side::Left, &factor::compartments(Side::Left));
    let muscles = factor::sum_compartments(&profile.rows().unwrap()).unwrap();
    let rows = Rows::new(&muscles, factor::FACTOR_MUSCLES.len()).unwrap();
    let extraction = factor::extract(&rows, &ExtractionOptions::default()).unwrap();
    assert_close(&extraction.eigenvalues, &want["eigenvalues"], 1e-8, "eigenvalues");
    let reference =
        factor::rotate(&extraction, Rotation::Reference(ReferenceRotationOptions::default()))
            .unwrap();
    let row = factor::StatisticsRow::of(&extraction, &reference);
    let found = serde_json::to_value(&row).unwrap();
    for name in [
        "n_factors",
        "n_time",
        "explained_variance",
        "bartlett_chi2",
        "bartlett_df",
        "bartlett_p",
        "kmo",
        "sweeps",
    ] {
        assert_close(&floats(&found[name]), &want[name], 1e-8, name);
    }
    assert_eq!(want["rotation_steady"], reference.is_reproducible());
    let count = extraction.factor_count;
    let signs = signs_like(&reference.loadings, &floats(&want["loadings"]), count);
    assert_close(&signed(&reference.loadings, &signs), &want["loadings"], 1e-5, "loadings");
    let every_20th: Vec<f64> =
        reference.waveforms.chunks_exact(count).step_by(20).flatten().copied().collect();
    assert_close(&signed(&every_20th, &signs), &want["scores_every_20th_point"], 1e-5, "scores");

    let varimax = factor::rotate(&extraction, Rotation::default()).unwrap();
    let want = &want["varimax_option"];
    assert_close(&varimax.shares, &want["variance"], 1e-6, "varimax shares");
    let signs = signs_like(&varimax.loadings, &floats(&want["loadings"]), count);
    assert_close(&signed(&varimax.loadings, &signs), &want["loadings"], 1e-5, "varimax loadings");
}

/// The sign each column of `found` needs to point like that of `want`.
fn signs_like(found: &[f64], want: &[f64], columns: usize) -> Vec<f64> {
    let product = |column: usize| -> f64 {
        let pairs = found.iter().zip(want).skip(column).step_by(columns);
        pairs.map(|(found, want)| found * want).sum()
    };
    (0..columns).map(|column| product(column).signum()).collect()
}

fn signed(values: &[f64], signs: &[f64]) -> Vec<f64> {
    values
        .chunks_exact(signs.len())
        .flat_map(|row| row.iter().zip(signs).map(|(x, s)| x * s))
        .collect()
}
