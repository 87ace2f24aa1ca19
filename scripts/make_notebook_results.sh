#!/usr/bin/env bash
# Makes the small result set that the notebooks read, with nothing but this program and what `setup` fetched: the policies
# that come with the program, the invented people of `data/emg`, and a minute of training.
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

keep "$(run csi "${data[@]}" --task hand_index_reach --components 1,2,3,5,8,12,20,30,39 --episodes 10)" csi curves
keep "$(run evaluate "${data[@]}" --task all --episodes 20)" evaluate episodes

# The small transformer, and those who taught it, on the hand.
fingers=(hand_index_reach hand_middle_reach hand_ring_reach hand_little_reach hand_thumb_reach)
mini=$(run rollout "${data[@]}" --policy mini --task "${fingers[@]}" --episodes 4 --seed 1)
teachers=$(run rollout "${data[@]}" --policy expert:mini --task "${fingers[@]}" --episodes 4 --seed 1)
both=(--recording "mini=$mini" "Its teachers=$teachers" --episodes 4)
keep "$(run smoothness "${data[@]}" "${both[@]}")" smoothness per_task comparisons
keep "$(run kinematics "${data[@]}" "${both[@]}" --task hand_index_reach)" kinematics cumulative_variance human_comparison
keep "$(run subspaces "${data[@]}" "${both[@]}")" subspaces summary
# Components and synergies of one finger.
finger=$(run rollout "${data[@]}" --policy mini --task hand_index_reach --episodes 10)
keep "$(run synergies "${data[@]}" --recording "mini=$finger" --episodes 10 --n-fits 2)" synergies variance reconstruction

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
