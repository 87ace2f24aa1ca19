//! Scripts for Slurm: a job array that plays the shards of a sweep, and a job that gathers when they are through.
//!
//! The array is safe to requeue, because its work is: a shard that is killed loses the episodes in play. Two minutes before
//! its time is up, or when the node is needed for something else, Slurm sends `SIGTERM` to the script, which hands it to
//! the worker, waits for the end of the episodes in play, and puts the shard back into the queue.
//!
//! The gathering job starts when all shards have ended, however they ended; it says what is missing if something is.

use std::path::Path;

/// Folder of the scripts in that of the sweep.
pub const FOLDER: &str = "slurm";
/// Holds the number of the array job, once it is submitted.
pub const JOB: &str = "job";
/// Holds the number of shards.
pub const SHARDS: &str = "shards";

/// What the scripts ask of the cluster.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cluster {
    pub shards: usize,
    pub partition: Option<String>,
    /// In Slurm's own way of writing it.
    pub time: Option<String>,
    /// Shards at work at the same time.
    pub array_limit: Option<usize>,
    /// Cores of a shard.
    pub cores: usize,
}

/// Where the sweep is, and with what it is played.
#[derive(Debug, Clone, Copy)]
pub struct Place<'a> {
    /// The program.
    pub program: &'a Path,
    /// Folder of the sweep.
    pub sweep: &'a Path,
    /// Folder in which the command was typed.
    pub folder: &'a Path,
    /// Name of the jobs.
    pub name: &'a str,
}

/// Names and contents of the scripts.
#[must_use]
pub fn scripts(place: &Place<'_>, cluster: &Cluster) -> [(&'static str, String); 3] {
    [
        ("work.sbatch", work(place, cluster)),
        ("gather.sbatch", gather(place, cluster)),
        ("submit.sh", submit(place)),
    ]
}

fn work(place: &Place<'_>, cluster: &Cluster) -> String {
    let Cluster { shards, array_limit, cores, .. } = cluster;
    let limit = array_limit.map_or_else(String::new, |limit| format!("%{limit}"));
    let head = head(place, cluster, "%A_%a");
    let (program, sweep) = (quoted(place.program), quoted(place.sweep));
    format!(
        r#"{head}#SBATCH --array=1-{shards}{limit}
#SBATCH --cpus-per-task={cores}
#SBATCH --requeue
#SBATCH --signal=B:TERM@120

stopped=
trap 'stopped=yes; kill -TERM "$worker" 2>/dev/null' TERM
{program} work {sweep} --shard "$SLURM_ARRAY_TASK_ID/{shards}" --threads "$SLURM_CPUS_PER_TASK" --quiet &
worker=$!
# A signal ends `wait` before the worker has ended.
while true; do
    wait "$worker" && code=0 || code=$?
    kill -0 "$worker" 2>/dev/null || break
done
if [ -n "$stopped" ] && [ "$code" -ne 0 ]; then
    scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}"
fi
exit "$code"
"#
    )
}

fn gather(place: &Place<'_>, cluster: &Cluster) -> String {
    let head = head(place, cluster, "gather_%j");
    let (program, sweep) = (quoted(place.program), quoted(place.sweep));
    format!("{head}#SBATCH --cpus-per-task={}\n\n{program} gather {sweep}\n", cluster.cores)
}

fn submit(place: &Place<'_>) -> String {
    let scripts = place.sweep.join(FOLDER);
    let script = |name: &str| quoted(&scripts.join(name));
    format!(
        r#"#!/bin/bash
# Hands both jobs to Slurm and notes the number of the array for `status`.
set -eu
array=$(sbatch --parsable {})
array=${{array%%;*}}
echo "$array" > {}
gather=$(sbatch --parsable --dependency="afterany:$array" {})
echo "array $array, gather ${{gather%%;*}}"
"#,
        script("work.sbatch"),
        script(JOB),
        script("gather.sbatch"),
    )
}

/// What both jobs begin with.
fn head(place: &Place<'_>, cluster: &Cluster, log: &str) -> String {
    let mut head = format!("#!/bin/bash\n#SBATCH --job-name={}\n", place.name);
    let options = [("partition", &cluster.partition), ("time", &cluster.time)];
    for (name, value) in options.iter().filter_map(|(name, value)| Some((name, value.as_ref()?))) {
        head.extend([format!("#SBATCH --{name}={value}\n")]);
    }
    let log = place.sweep.join(FOLDER).join(format!("{log}.log"));
    // Slurm takes quotes here, but no spaces without them.
    head.extend([format!("#SBATCH --output=\"{}\"\n#SBATCH --open-mode=append\n", log.display())]);
    head + &format!("#SBATCH --chdir=\"{}\"\n", place.folder.display())
}

/// A path as one word of a shell.
fn quoted(path: &Path) -> String {
    format!("'{}'", path.display().to_string().replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(cluster: &Cluster) -> [(&'static str, String); 3] {
        let place = Place {
            program: Path::new("/opt/it's/arnold-analyze"),
            sweep: Path::new("/data/a sweep"),
            folder: Path::new("/home/me"),
            name: "csi-abc",
        };
        scripts(&place, cluster)
    }

    #[test]
    fn scripts_ask_for_what_was_wanted_and_quote_paths() {
        let cluster = Cluster {
            shards: 7,
            partition: Some("cpu".to_owned()),
            time: Some("04:00:00".to_owned()),
            array_limit: Some(3),
            cores: 2,
        };
        let [(_, work), (_, gather), (_, submit)] = written(&cluster);
        for line in [
            "#SBATCH --job-name=csi-abc",
            "#SBATCH --partition=cpu",
            "#SBATCH --time=04:00:00",
            "#SBATCH --array=1-7%3",
            "#SBATCH --cpus-per-task=2",
            "#SBATCH --output=\"/data/a sweep/slurm/%A_%a.log\"",
        ] {
            assert!(work.lines().any(|found| found == line), "no `{line}` in\n{work}");
        }
        let call = r#"'/opt/it'\''s/arnold-analyze' work '/data/a sweep' --shard "$SLURM_ARRAY_TASK_ID/7""#;
        assert!(work.contains(call), "{work}");
        assert!(gather.contains("gather '/data/a sweep'"), "{gather}");
        assert!(submit.contains("afterany:$array"), "{submit}");
    }

    #[test]
    fn what_was_not_wanted_is_not_asked_for() {
        let cluster =
            Cluster { shards: 1, partition: None, time: None, array_limit: None, cores: 1 };
        let [(_, work), ..] = written(&cluster);
        assert!(work.contains("--array=1-1\n") && !work.contains("--partition"), "{work}");
        assert!(!work.contains("--time"), "{work}");
    }
}
