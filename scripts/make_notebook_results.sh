#!/usr/bin/env bash
# Makes the small result set that the notebooks read, with nothing but this program and what `setup` fetched: MyoSuite's
# elbow policy, uniformly random actions, the invented people of `data/emg`, and a minute of training.
#
#     scripts/make_notebook_results.sh [PROGRAM]
#
# Everything that decides a number is in this file, so the tables come out the same, byte for byte, on one kind of machine.
set -euo pipefail
cd "$(dirname "$0")/.."
program=$(realpath "${1:-target/release/arnold-analyze}")
results=notebooks/results
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Runs a command and says in which folder its results are.
run() { "$program" --quiet --json "$@" --out "$work/runs" | sed -n 's/^  "folder": "\(.*\)",\{0,1\}$/\1/p'; }

# keep FOLDER NAME TABLE…: copies tables of a run to the result set.
keep() {
    local folder=$1 name=$2
    shift 2
    mkdir -p "$results/$name"
    for table; do cp "$folder/$table.parquet" "$results/$name/$table.parquet"; done
}

rm -rf "$results"
unset ARNOLD_POLICY ARNOLD_DATA
data=(--data "$work/data")

keep "$(run csi "${data[@]}" --task myosuite_elbow_pose --episodes 20)" csi curves
keep "$(run evaluate "${data[@]}" --task myosuite_elbow_pose --episodes 20)" evaluate episodes

# Two policies of all hand tasks that need no checkpoint: uniform actions, and the same with noise on top.
calm=$(run rollout "${data[@]}" --policy random --task hand --episodes 4 --seed 1)
noisy=$(run rollout "${data[@]}" --policy random --task hand --episodes 4 --seed 2 --action-noise 0.5)
both=(--recording "Random=$calm" "Noisy=$noisy" --episodes 4)
keep "$(run smoothness "${data[@]}" "${both[@]}")" smoothness per_task comparisons
keep "$(run kinematics "${data[@]}" "${both[@]}" --task baoding_p1_ccw)" kinematics cumulative_variance human_comparison
keep "$(run subspaces "${data[@]}" "${both[@]}")" subspaces summary
# Components and synergies of what the elbow policy does: random actions have none.
elbow=$(run rollout "${data[@]}" --task myosuite_elbow_pose --episodes 10)
keep "$(run synergies "${data[@]}" --recording "Elbow=$elbow" --episodes 10 --n-fits 2)" synergies variance reconstruction

keep "$(run emg "${data[@]}" --subjects data/emg)" emg correlations subject_means
keep "$(run factors "${data[@]}" --profiles data/emg/synthetic/invented_simulation.npz)" factors loadings

for seed in 0 1; do
    "$program" --quiet train ppo --task elbow_pose --steps 40000 --seed "$seed" --out "$work/seed_$seed" > "$work/train.json"
done
runs=(--run "ppo:elbow_pose=$work/seed_0" --run "ppo:elbow_pose=$work/seed_1")
keep "$(run curves "${data[@]}" "${runs[@]}" --recipe single-task --raw)" curves curves bands

"$program" --quiet figures "${data[@]}" table1_families tables_per_task tables_method_tests --runs "$work/none" --out "$work/figures" > "$work/figures.txt"
mkdir -p "$results/performance"
for table in table1_families tables_per_task tables_method_tests; do
    cp "$work/figures/$table.parquet" "$results/performance/$table.parquet"
done
du -sh "$results"
