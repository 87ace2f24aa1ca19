#!/usr/bin/env bash
# Plays a sweep on a real Slurm of one machine and compares it with one process: a job array of three shards, one of them
# requeued by the administrator, another told to end, then the job that gathers.
#
#     tests/slurm/cluster.sh PROGRAM
#
# Needs root, munged, slurmctld and slurmd (Debian: slurm-wlm munge). The cluster lives in a temporary folder, with ports
# and sockets of its own, and goes away at the end.
set -euo pipefail
program=$(realpath "$1")

folder=$(mktemp -d)
daemons=()
clean_up() {
    for daemon in "${daemons[@]}"; do kill "$daemon" 2> /dev/null || true; done
    wait || true
    rm -rf "$folder"
}
trap clean_up EXIT
fail() {
    echo "failed: $1" >&2
    tail -n 20 "$folder"/*.log "$folder"/sweep/slurm/*.log >&2 || true
    exit 1
}
# Waits until the words after the first succeed, for so many seconds at most.
until_true() {
    local seconds=$1
    shift
    for _ in $(seq $((seconds * 5))); do
        if "$@" > /dev/null 2>&1; then return; fi
        sleep 0.2
    done
    fail "waited $seconds s for: $*"
}
free_port() { python3 -c 'import socket; s = socket.socket(); s.bind(("", 0)); print(s.getsockname()[1])'; }

# The cluster.
mkdir "$folder"/{state,spool}
head -c 1024 /dev/urandom > "$folder/munge.key"
chmod 400 "$folder/munge.key"
munged --foreground --force --socket="$folder/munge.socket" --key-file="$folder/munge.key" \
    --pid-file="$folder/munge.pid" --log-file="$folder/munge.log" --seed-file="$folder/munge.seed" &
daemons+=($!)
host=$(hostname -s)
cat > "$folder/slurm.conf" << END
ClusterName=arnold
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
# Requeued jobs wait until their credential has expired.
AuthInfo=socket=$folder/munge.socket,cred_expire=5
CryptoType=crypto/munge
SlurmctldPort=$(free_port)
SlurmdPort=$(free_port)
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
MpiDefault=none
ReturnToService=2
SchedulerParameters=sched_interval=1,batch_sched_delay=0
NodeName=$host NodeAddr=127.0.0.1 CPUs=2
PartitionName=cpu Nodes=$host Default=YES State=UP
END
export SLURM_CONF="$folder/slurm.conf"
until_true 10 test -S "$folder/munge.socket"
slurmctld -D -i -f "$SLURM_CONF" > "$folder/controller.log" 2>&1 &
daemons+=($!)
slurmd -D -f "$SLURM_CONF" > "$folder/node.log" 2>&1 &
daemons+=($!)
until_true 30 bash -c "sinfo --noheader --format=%T | grep -qx idle"

# One process, then the same in shards.
command=(csi --task elbow_pose --episodes "${EPISODES:-400}" --quiet)
cd "$folder"
"$program" "${command[@]}" --out one > /dev/null
"$program" plan --quiet --out sweep --emit sbatch --shards 3 --partition cpu --time 10 --array-limit 2 "${command[@]}"
bash sweep/slurm/submit.sh
array=$(cat sweep/slurm/job)

played() { cat sweep/ledger/*.log 2> /dev/null | wc -l; }
grown() { [ "$(played)" -ge "$1" ]; }
running() { squeue --noheader --array --format='%K %T' --jobs "$array" | grep -qx "$1 RUNNING"; }

until_true 60 running 1
until_true 60 grown 20
"$program" status sweep
scontrol requeue "${array}_1"
until_true 60 running 2
until_true 60 grown $(($(played) + 20))
scancel --signal=TERM --batch "${array}_2"

until_true 180 test -e sweep/manifest.json
until_true 60 bash -c "! squeue --noheader | grep -q ."
"$program" status sweep
grep -rqs 'stopped after' sweep/slurm/ || fail 'no shard was told to end'
for file in one/csi-*/*; do
    name=$(basename "$file")
    [ "$name" = manifest.json ] || cmp "$file" "sweep/$name" || fail "$name has other bytes"
done
restarted=$(scontrol show job "$array" | grep -c 'Restarts=[1-9]' || true)
[ "$restarted" -eq 2 ] || fail "$restarted shards were restarted, not 2"
echo 'same bytes as one process, with a shard requeued and another told to end'
