//! Every reference case of smoothness, filters, gait, EMG, factors and kinematic dimensionality, and the whole EMG chain
//! on published data.
//!
//! The numbers were recorded from the authors' suite, NumPy and SciPy; they lie in the `analysis` folder of the golden
//! data (`$ARNOLD_GOLDEN`, else `../shared/golden`).

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;
#[path = "signals_parity/human_folder.rs"]
mod human_folder;
#[path = "signals_parity/real_emg.rs"]
mod real_emg;
#[path = "signals_parity/synthetic_cohort.rs"]
mod synthetic_cohort;

use arnold_analyze::analysis::emg::{
    self, EmgError, GaitEpisode, GaitOptions, HUMAN_CHANNELS, HumanProfiles, Side, SubjectTable,
    Verdict,
};
use arnold_analyze::analysis::factor::{
    self, ExtractionOptions, ReferenceRotationOptions, Rotation, VarimaxOptions,
};
use arnold_analyze::analysis::kinematics::{Quantity, kinematic_dimensionality};
use arnold_analyze::analysis::signal::{LowPass, LowPassOptions, Rows, resample, resample_rows};
use arnold_analyze::analysis::smoothness::{
    ComparisonRow, DimensionlessJerk, DimensionlessJerkOptions, Smoothness, SmoothnessMeter,
    SmoothnessOptions, SpectralArcLength, SpectralArcLengthOptions, TaskRow, VelocityPeaks,
    VelocityPeaksOptions, comparisons, local_maxima,
};
use arnold_analyze::analysis::stats::{Divisor, Summary};
use arnold_analyze::analysis::subspace::components_reaching;
use arnold_analyze::analysis::undefined::Undefined;
use arnold_analyze::npz::Array;
use common::cases::{Case, Outputs, compare_topic, or_nan, outputs};

/// Compares a topic, all of whose cases of the given algorithms must agree.
fn check(topic: &str, cases: usize, run: fn(&Case) -> Option<Outputs>) {
    let Some(folder) = common::golden("analysis") else { return };
    let (compared, failures) = compare_topic(&folder, topic, run);
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(compared >= cases, "only {compared} cases of {topic} were compared");
}

/// An array of values as a table.
fn with_table<T>(array: &Array, work: impl FnOnce(Rows<'_>) -> T) -> T {
    work(Rows::new(&array.to_f64(), array.shape[1]).unwrap())
}

fn as_floats(indices: &[usize]) -> Vec<f64> {
    indices.iter().map(|&index| index as f64).collect()
}

fn numbers(values: &[Option<f64>]) -> Vec<f64> {
    values.iter().map(|&value| or_nan(value)).collect()
}

#[test]
fn smoothness_agrees_with_the_suite_and_scipy() {
    check("smoothness", 34, |case| {
        Some(match case.algorithm() {
            "smoothness_episode" => smoothness_episode(case),
            "sparc" => sparc(case),
            "local_maxima" => {
                let signal = case.input("x").to_f64();
                let found: Vec<usize> = local_maxima(&signal, case.number("min_height")).collect();
                outputs([("index", as_floats(&found))])
            }
            "smoothness_significance" => smoothness_significance(case),
            _ => return None,
        })
    });
}

/// The same values as the means of one metric, so that the whole way from task rows to the table is compared.
fn smoothness_significance(case: &Case) -> Outputs {
    let (values, task_count) = (case.input("values").to_f64(), case.input("values").shape[1]);
    let tasks: Vec<String> = (0..task_count).map(|task| format!("task {task}")).collect();
    let policies: Vec<(String, Vec<TaskRow>)> = values
        .chunks_exact(task_count)
        .enumerate()
        .map(|(policy, means)| {
            let row = |(task, &mean): (&String, &f64)| TaskRow {
                policy: policy.to_string(),
                task: task.clone(),
                means: Smoothness {
                    mean_abs_diff: Some(mean),
                    sparc: Some(mean),
                    ldlj_kin: Some(mean),
                    nvp: Some(mean),
                },
                episodes: 100,
                used: [100; 4],
            };
            (policy.to_string(), tasks.iter().zip(means).map(row).collect())
        })
        .collect();
    let rows = &comparisons(&policies, &tasks).unwrap()[..3];
    let summaries: Vec<Summary> = values
        .chunks_exact(task_count)
        .map(|means| Summary::of(means, Divisor::CountMinusOne))
        .collect();
    let column =
        |of: fn(&ComparisonRow) -> Option<f64>| rows.iter().map(|row| or_nan(of(row))).collect();
    outputs([
        ("mean", summaries.iter().map(|summary| or_nan(summary.mean)).collect()),
        ("sem", summaries.iter().map(|summary| or_nan(summary.standard_error)).collect()),
        ("W", column(|row| row.w)),
        ("p", column(|row| row.p_raw)),
        ("p_holm", column(|row| row.p_holm)),
    ])
}

fn spectral_arc_length_options(case: &Case, prefix: &str) -> SpectralArcLengthOptions {
    let name = |name: &str| format!("{prefix}{name}");
    SpectralArcLengthOptions {
        sample_rate: case.number(&name("fs")),
        cutoff: case.number(&name("fc")),
        amplitude_threshold: case.number(&name("amp")),
        pad_level: u32::try_from(case.count(&name("pad"))).unwrap(),
        ..Default::default()
    }
}

fn smoothness_episode(case: &Case) -> Outputs {
    let options = SmoothnessOptions {
        spectral_arc_length: spectral_arc_length_options(case, "sparc_"),
        dimensionless_jerk: DimensionlessJerkOptions {
            least_excursion: case.number("ldlj_min_excursion"),
            least_jerk: case.number("ldlj_min_jerk"),
        },
        velocity_peaks: VelocityPeaksOptions {
            height_share: case.number("nvp_frac"),
            least_speed: case.number("nvp_min_speed"),
        },
    };
    assert_eq!(options, SmoothnessOptions::default(), "the defaults are the paper's");
    let (actions, positions) = (case.input("a"), case.input("q"));
    let (actions, columns) = (actions.to_f32(), actions.shape[1]);
    let actions = Rows::new(&actions, columns).unwrap();
    with_table(positions, |positions| {
        let mut meter = SmoothnessMeter::new(&options).unwrap();
        let found = meter.measure(&actions, &positions).unwrap();
        let mut jerk = DimensionlessJerk::new(options.dimensionless_jerk).unwrap();
        let mut peaks = VelocityPeaks::new(options.velocity_peaks).unwrap();
        outputs([
            ("mean_abs_da", vec![or_nan(found.mean_abs_diff)]),
            ("sparc", vec![or_nan(found.sparc)]),
            ("ldlj", vec![or_nan(found.ldlj_kin)]),
            ("nvp", vec![or_nan(found.nvp)]),
            ("ldlj_joints", numbers(jerk.per_joint(&positions))),
            ("nvp_joints", numbers(peaks.per_joint(&positions))),
        ])
    })
}

fn sparc(case: &Case) -> Outputs {
    let mut meter = SpectralArcLength::new(spectral_arc_length_options(case, "")).unwrap();
    outputs([("sparc", vec![or_nan(meter.of(&case.input("speed").to_f64()))])])
}

#[test]
fn filters_and_resampling_agree_with_scipy_and_numpy() {
    check("filters", 13, |case| {
        let input = case.input("x");
        let channels = input.shape.get(1).copied().unwrap_or(1);
        let values = input.to_f64();
        let signals = Rows::new(&values, channels).unwrap();
        let found = match case.algorithm() {
            "lowpass_zero_phase" => {
                let options =
                    LowPassOptions { cutoff: case.number("fc"), order: case.count("order") };
                let filter = LowPass::design(&options, case.number("fs")).unwrap();
                let column =
                    |channel| filter.zero_phase(&signals.column(channel).collect::<Vec<_>>());
                by_row(&(0..channels).map(column).collect::<Vec<_>>())
            }
            "resample_linear" => resample_rows(&signals, case.count("n")).unwrap(),
            _ => return None,
        };
        Some(outputs([("y", found)]))
    });
}

/// Columns of equal length as one matrix, row by row.
fn by_row(columns: &[Vec<f64>]) -> Vec<f64> {
    let rows = 0..columns[0].len();
    rows.flat_map(|row| columns.iter().map(move |column| column[row])).collect()
}

#[test]
fn gait_cycles_and_profiles_agree_with_the_suite() {
    check("gait", 5, |case| {
        Some(match case.algorithm() {
            "gait_segmentation" => gait_segmentation(case),
            "gait_segmentation_empty" => gait_segmentation_empty(case),
            "forward_velocity" => {
                let [vx, vy, yaw] = ["vx", "vy", "yaw"].map(|name| case.input(name).to_f64());
                let at = |i: usize| emg::forward_velocity(vx[i], vy[i], yaw[i]);
                outputs([("v", (0..vx.len()).map(at).collect())])
            }
            _ => return None,
        })
    });
}

/// Values with their number of columns as a table.
fn table((values, columns): &(Vec<f64>, usize)) -> Rows<'_> {
    Rows::new(values, *columns).unwrap()
}

fn gait_segmentation(case: &Case) -> Outputs {
    let episode_count = case.count("n_episodes");
    let of = |kind: &str| -> Vec<(Vec<f64>, usize)> {
        let arrays = (0..episode_count).map(|i| case.input(&format!("e{i}_{kind}")));
        arrays.map(|array| (array.to_f64(), array.shape[1])).collect()
    };
    let [contacts, velocities, activations] = ["foot_contacts", "root_vel", "activations"].map(of);
    let episodes: Vec<GaitEpisode<'_>> = contacts
        .iter()
        .zip(&velocities)
        .map(|(contacts, velocities)| GaitEpisode {
            contacts: table(contacts),
            root_velocity: table(velocities),
            sample_rate: case.number("fs"),
        })
        .collect();
    let percentiles = case.parameter("duration_percentiles");
    let options = GaitOptions {
        contact_threshold: case.number("threshold"),
        low_pass: LowPassOptions { cutoff: case.number("fc"), order: case.count("order") },
        duration_percentiles: [0, 1].map(|end| percentiles[end].as_f64().unwrap()),
        least_speed: case.number("min_velocity"),
        fewest_samples: case.count("min_samples"),
        ..Default::default()
    };
    assert_eq!(options, GaitOptions::default(), "the defaults are the authors'");
    let leading = match case.parameter("lead").as_str().unwrap() {
        "left" => Side::Left,
        _ => Side::Right,
    };
    let found = emg::segment(&episodes, leading, &options).unwrap();
    let activations: Vec<Rows<'_>> = activations.iter().map(table).collect();
    let columns: Vec<usize> = (0..activations[0].columns()).collect();
    let profile =
        emg::cycle_profile(&found, &activations, &columns, case.count("n_points"), None).unwrap();
    let cycles = found.cycles.iter().flat_map(|cycle| {
        let kept = f64::from(u8::from(cycle.verdict == Verdict::Kept));
        let place = [cycle.episode, cycle.start, cycle.end].map(|at| at as f64);
        [place[0], place[1], place[2], cycle.mean_speed, kept]
    });
    let mut outputs = outputs([
        ("cycle_table", cycles.collect()),
        ("detected", vec![profile.detected as f64]),
        ("retained", vec![profile.retained as f64]),
        ("mean_profile", profile.mean),
        ("sd_profile", profile.standard_deviation),
    ]);
    for (index, strikes) in found.strikes.iter().enumerate() {
        outputs.insert(format!("e{index}_lead_strikes"), as_floats(&strikes.leading));
        outputs.insert(format!("e{index}_other_strikes"), as_floats(&strikes.opposite));
    }
    outputs
}

fn gait_segmentation_empty(case: &Case) -> Outputs {
    with_table(case.input("foot_contacts"), |contacts| {
        let episode =
            GaitEpisode { contacts, root_velocity: contacts, sample_rate: case.number("fs") };
        let found = emg::segment(&[episode], Side::Left, &GaitOptions::default()).unwrap();
        let profile = emg::cycle_profile(&found, &[contacts], &[0], 200, None);
        assert_eq!(profile, Err(EmgError::NoCycle { detected: 0 }));
        outputs([
            ("detected", vec![found.detected() as f64]),
            ("retained", vec![found.retained() as f64]),
        ])
    })
}

/// People from an array of subjects × points × columns, of which the first is the time if there are ten.
fn people(array: &Array) -> HumanProfiles {
    let (points, columns) = (array.shape[1], array.shape[2]);
    let labels: Vec<String> =
        ["Time"].into_iter().chain(HUMAN_CHANNELS).map(str::to_owned).collect();
    let values = array.to_f64();
    let with_time = |row: &[f64]| [vec![0.0; 10 - columns], row.to_vec()].concat();
    let tables: Vec<Vec<f64>> = values
        .chunks_exact(points * columns)
        .map(|subject| subject.chunks_exact(columns).flat_map(with_time).collect())
        .collect();
    let tables: Vec<SubjectTable<'_>> = (4..)
        .zip(&tables)
        .map(|(subject, table)| SubjectTable { subject, rows: Rows::new(table, 10).unwrap() })
        .collect();
    HumanProfiles::new(&labels, &tables).unwrap()
}

fn flat(rows: &[[Option<f64>; 9]]) -> Vec<f64> {
    rows.iter().flat_map(|row| numbers(row)).collect()
}

#[test]
fn correlations_with_people_agree_with_the_suite() {
    check("emg", 2, |case| {
        Some(match case.algorithm() {
            "emg_comparison" => emg_comparison(case),
            "emg_comparison_degenerate" => emg_comparison_degenerate(case),
            _ => return None,
        })
    });
}

fn emg_comparison(case: &Case) -> Outputs {
    let people = people(case.input("human_files"));
    let loo = emg::leave_one_out(&people).unwrap();
    let pairs = emg::pairwise(&people).unwrap().correlations;
    let by_muscle = |profile: &dyn Fn(usize) -> Vec<f64>| -> Vec<f64> {
        by_row(&(0..9).map(profile).collect::<Vec<_>>())
    };
    let arnold = case.input("sim_arnold").to_f64();
    let arnold = Rows::new(&arnold, 9).unwrap();
    let resampled = |m: usize| resample(&arnold.column(m).collect::<Vec<_>>(), 100).unwrap();
    let mut found = outputs([
        ("loo", flat(loo.rows())),
        ("loo_subject", numbers(&loo.row_means(&[], Undefined::Propagate))),
        ("pairwise", flat(pairs.rows())),
        ("pairwise_mean", numbers(&pairs.row_means(&[], Undefined::Propagate))),
        ("resampled_arnold", by_muscle(&resampled)),
        ("traces_arnold", by_muscle(&|m| emg::relative_to_maximum(&resampled(m)).values)),
        ("traces_human_mean", by_muscle(&|m| emg::muscle_trace(&people, m).mean.values)),
        ("timeshift", numbers(&emg::timing(&people, &arnold, Undefined::Propagate).unwrap())),
    ]);
    let mut policies = Vec::new();
    for policy in ["arnold", "obc", "kinesis"] {
        let r = with_table(case.input(&format!("sim_{policy}")), |simulated| {
            emg::correlate(&people, &simulated).unwrap()
        });
        found.insert(format!("r_{policy}"), flat(r.rows()));
        let means = r.row_means(&[], Undefined::Propagate);
        found.insert(format!("subject_{policy}"), numbers(&means));
        policies.push((policy.to_owned(), means));
    }
    for row in emg::comparisons(&policies).unwrap() {
        let values = [
            ("W", row.w),
            ("p", row.p_raw),
            ("p_bonferroni", row.p_bonferroni),
            ("rank_biserial", row.rank_biserial),
        ];
        for (name, value) in values {
            found.insert(format!("{}_vs_{}.{name}", row.a, row.b), vec![or_nan(value)]);
        }
    }
    found
}

fn emg_comparison_degenerate(case: &Case) -> Outputs {
    let people = people(case.input("human"));
    let r = with_table(case.input("sim"), |simulated| emg::correlate(&people, &simulated).unwrap());
    outputs([
        ("r", flat(r.rows())),
        ("subject", numbers(&r.row_means(&[], Undefined::Propagate))),
        ("subject_skip", numbers(&r.row_means(&[], Undefined::Skip))),
    ])
}

#[test]
fn factors_agree_with_the_suite_and_varimax_with_its_reference() {
    check("factor", 16, |case| {
        Some(match case.algorithm() {
            "factor_analysis" => {
                let options = ReferenceRotationOptions {
                    most_passes: case.count("max_sweeps"),
                    tolerance: case.number("tol"),
                };
                factor_analysis(case, Rotation::Reference(options), case.count("n_init"))
            }
            "factor_analysis_exact" => {
                let options = VarimaxOptions {
                    kaiser: case.parameter("kaiser").as_bool().unwrap(),
                    tolerance: case.number("varimax_tol"),
                    most_iterations: case.count("varimax_max_iter"),
                };
                factor_analysis(case, Rotation::Varimax(options), 10)
            }
            "planar_rotation" => {
                let (loadings, factors) = (case.input("A").to_f64(), case.input("A").shape[1]);
                let options = ReferenceRotationOptions {
                    most_passes: case.count("max_sweeps"),
                    tolerance: case.number("tol"),
                };
                let found = factor::reference_rotation(&loadings, factors, &options);
                outputs([
                    ("rotated", found.loadings),
                    ("T", found.rotation),
                    ("sweeps", vec![found.iterations as f64]),
                ])
            }
            "varimax" => varimax(case),
            "muscle_aggregation" => with_table(case.input("X"), |compartments| {
                outputs([("Y", factor::sum_compartments(&compartments).unwrap())])
            }),
            _ => return None,
        })
    });
}

fn factor_analysis(case: &Case, rotation: Rotation, most_factors: usize) -> Outputs {
    let least_eigenvalue = case.number("min_eigenvalue");
    let options = ExtractionOptions { least_eigenvalue, most_factors };
    let extraction = with_table(case.input("X"), |rows| factor::extract(&rows, &options).unwrap());
    let factors = factor::rotate(&extraction, rotation).unwrap();
    let keep = |column| f64::from(u8::from(extraction.muscles.contains(&column)));
    let row = factor::StatisticsRow::of(&extraction, &factors);
    let adequacy = extraction.sampling_adequacy.as_ref().unwrap();
    outputs([
        ("keep", (0..case.input("X").shape[1]).map(keep).collect()),
        ("R", extraction.correlations.clone()),
        ("eigenvalues", extraction.eigenvalues.clone()),
        ("unrotated", extraction.loadings.clone()),
        ("loadings", factors.loadings),
        ("scores", factors.waveforms),
        ("variance", factors.shares),
        ("kmo_items", numbers(&adequacy.per_muscle)),
        ("n_factors", vec![row.n_factors as f64]),
        ("sweeps", vec![row.sweeps as f64]),
        ("explained_variance", vec![row.explained_variance]),
        ("total_variance", vec![row.explained_variance]),
        ("bartlett_chi2", vec![or_nan(row.bartlett_chi2)]),
        ("bartlett_df", vec![or_nan(row.bartlett_df.map(|df| df as f64))]),
        ("bartlett_p", vec![or_nan(row.bartlett_p)]),
        ("kmo", vec![or_nan(row.kmo)]),
    ])
}

fn varimax(case: &Case) -> Outputs {
    let (loadings, factors) = (case.input("A").to_f64(), case.input("A").shape[1]);
    let options = VarimaxOptions {
        kaiser: case.parameter("kaiser").as_bool().unwrap(),
        tolerance: case.number("tol"),
        most_iterations: case.count("max_iter"),
    };
    let found = factor::varimax(&loadings, factors, &options).unwrap();
    let length = |row: &[f64]| row.iter().map(|x| x * x).sum::<f64>().sqrt();
    let normalised: Vec<f64> = found
        .loadings
        .chunks_exact(factors)
        .flat_map(|row| row.iter().map(move |x| x / length(row)))
        .collect();
    let criterion = factor::varimax_criterion(&normalised, factors);
    outputs([("rotated", found.loadings), ("T", found.rotation), ("criterion", vec![criterion])])
}

#[test]
fn kinematic_dimensionality_agrees_with_scikit_learn() {
    check("pca", 3, |case| {
        Some(match case.algorithm() {
            "kinematic_dimensionality" => kinematics(case),
            "count_above" => {
                let mut sum = 0.0;
                let add = |share: f64| {
                    sum += share;
                    sum
                };
                let cumulative: Vec<f64> =
                    case.input("ratio").to_f64().into_iter().map(add).collect();
                let counts = case.parameter("thresholds").as_array().unwrap().iter().map(|share| {
                    components_reaching(&cumulative, share.as_f64().unwrap()).unwrap() as f64
                });
                outputs([("n", counts.collect())])
            }
            _ => return None,
        })
    });
}

fn kinematics(case: &Case) -> Outputs {
    let (values, joints) = (case.input("q").to_f64(), case.input("q").shape[1]);
    let lengths = case.parameter("episode_lengths").as_array().unwrap();
    let mut rest = values.as_slice();
    let mut episodes = Vec::new();
    for length in lengths {
        let length = usize::try_from(length.as_u64().unwrap()).unwrap();
        let (own, others) = rest.split_at(length * joints);
        episodes.push(Rows::new(own, joints).unwrap());
        rest = others;
    }
    let mut found = Outputs::new();
    for (quantity, name) in [(Quantity::Position, "pos"), (Quantity::Velocity, "vel")] {
        let result = kinematic_dimensionality(&episodes, quantity).unwrap();
        let cumulative = &result.cumulative;
        let before = |k: usize| if k == 0 { 0.0 } else { cumulative[k - 1] };
        let ratios = (0..joints).map(|k| cumulative[k] - before(k)).collect();
        found.insert(format!("ratio_{name}"), ratios);
        found.insert(format!("dims_{name}"), as_floats(&[result.dim_85, result.dim_95]));
        found.insert(format!("avg_{name}"), vec![result.average()]);
        found.insert(format!("cum_{name}"), result.cumulative);
    }
    found
}
