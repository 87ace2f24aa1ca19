//! Topic `curves`, and the smoothers of `filters`.

use arnold_analyze::analysis::curves::{
    Curve, Smoothing, TransferScale, band_on_grid, band_over_shared_steps, csi_finetuning_values,
    merge_resumed, multi_task_curve, portable_curve, rl_finetuning_values, running_mean,
    savitzky_golay, transfer_curve,
};
use arnold_analyze::record::{crc32c, masked_crc32c, read_event_files};

use crate::common::cases::{Case, Outputs, outputs, text};
use crate::{check, common};

#[test]
fn learning_curves_agree_with_the_suite() {
    check("curves", 16, |case| {
        Some(match case.algorithm() {
            "tfevents" => event_files(case),
            "crc32c" => outputs([
                ("crc32c", vec![f64::from(crc32c(b"123456789"))]),
                ("masked", vec![f64::from(masked_crc32c(b"123456789"))]),
            ]),
            "curve_transfer" => transfer(case),
            "seed_band" => seed_band(case),
            "curve_shared_steps" => shared_steps(case),
            "merge_resumed" => {
                let merged = merge_resumed(&["f0", "f1", "f2"].map(|name| curve(case, name)));
                outputs([("step", merged.steps().to_vec()), ("value", merged.values().to_vec())])
            }
            "curve_rl_finetune" => {
                outputs([("y", rl_finetuning_values(&case.input("y").to_f64()).unwrap())])
            }
            "curve_csi_finetune" => {
                let y = case.input("y").to_f64();
                outputs([("y", csi_finetuning_values(&y, case.number("expert")).unwrap())])
            }
            _ => return None,
        })
    });
}

#[test]
fn smoothers_agree_with_scipy() {
    check("filters", 6, |case| {
        let x = || case.input("x").to_f64();
        Some(match case.algorithm() {
            "savgol" => outputs([("y", savitzky_golay(&x(), case.count("window")).unwrap())]),
            "running_mean_valid" => outputs([("y", running_mean(&x(), case.count("window")))]),
            _ => return None,
        })
    });
}

fn curve(case: &Case, name: &str) -> Curve {
    let values = |axis| case.input(&format!("{name}_{axis}")).to_f64();
    Curve::new(values("x"), values("y")).unwrap()
}

fn event_files(case: &Case) -> Outputs {
    let root = common::golden("analysis").unwrap();
    let files = case.parameter("files").as_array().unwrap();
    let paths: Vec<_> = files.iter().map(|file| root.join(file.as_str().unwrap())).collect();
    let scalars = read_event_files(&paths).unwrap();
    assert_eq!(scalars.damaged.len(), 1, "the second file is cut short");
    assert_eq!(scalars.damaged[0].0, paths[1]);
    let tag = case.parameter("tag").as_str().unwrap();
    assert_eq!(scalars.solved().unwrap().tag, tag);
    let points = &scalars.series(tag).unwrap().points;
    let mut tags: Vec<&str> = scalars.series.iter().map(|series| series.tag.as_str()).collect();
    // The order of tags says nothing; the list of the case is in no particular one.
    tags.sort_unstable_by_key(|tag| (!tag.starts_with("other"), *tag));
    outputs([
        ("step", points.iter().map(|point| point.step as f64).collect()),
        ("value", points.iter().map(|point| point.value).collect()),
        ("tags", text(&tags.join("\n"))),
    ])
}

fn transfer(case: &Case) -> Outputs {
    let logged = Curve::new(case.input("x").to_f64(), case.input("y").to_f64()).unwrap();
    let scale = TransferScale {
        expert_solved_steps: case.number("expert_avg_solved_steps"),
        horizon: u32::try_from(case.count("max_episode_steps")).unwrap(),
        is_percent: case.parameter("percent").as_bool().unwrap_or(false),
    };
    let found = transfer_curve(&logged, scale);
    outputs([("x", found.steps().to_vec()), ("y", found.values().to_vec())])
}

fn seed_band(case: &Case) -> Outputs {
    let mut seeds = Vec::new();
    let mut found = Outputs::new();
    for (seed, runs) in case.parameter("n_runs").as_array().unwrap().iter().enumerate() {
        let runs: Vec<Curve> =
            (0..runs.as_u64().unwrap()).map(|run| curve(case, &format!("s{seed}r{run}"))).collect();
        let joined = multi_task_curve(&runs, case.number("expert"), case.count("window"));
        found.insert(format!("seed{seed}_x"), joined.steps().to_vec());
        found.insert(format!("seed{seed}_y"), joined.values().to_vec());
        seeds.push(joined);
    }
    let band = band_on_grid(&seeds, case.count("n_grid"), case.number("x_max")).unwrap();
    found.extend(outputs([
        ("grid", band.steps),
        ("mean", band.mean),
        ("sd", band.standard_deviation),
    ]));
    found
}

fn shared_steps(case: &Case) -> Outputs {
    let smoothing = match case.parameter("smoothing").as_str() {
        Some("moving") => Smoothing::Trailing(case.count("window")),
        Some("savgol") => Smoothing::SavitzkyGolay(case.count("window")),
        other => panic!("unknown smoothing {other:?}"),
    };
    let seeds =
        ["s0", "s1", "s2"].map(|name| portable_curve(&curve(case, name), smoothing).unwrap());
    let band = band_over_shared_steps(&seeds).unwrap();
    outputs([("step", band.steps), ("mean", band.mean), ("sd", band.standard_deviation)])
}
