//! The published data sets: where each is published, what it weighs, which sums prove it and where it goes.
//!
//! Sizes and MD5 of the archives are those of the record. The files of the human EMG have no published sums: their
//! SHA-256 were measured on 2026-11-22 on the copy in a public repository that committed the data set's files as they
//! are. A file that was replaced since is refused.

use std::fmt;

use super::error::DataError;

/// Files that belong together, and where they go below the data folder. Made only here and, for archives of their own,
/// in tests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DataSet<'a> {
    /// One word for it.
    pub name: &'a str,
    /// What it is for.
    pub purpose: &'a str,
    /// The command that fetches it.
    pub command: &'a str,
    /// Where it is published.
    pub record: Record<'a>,
    /// The licence it is under.
    pub licence: &'a str,
    /// What to cite when results made with it are published.
    pub citations: &'a [&'a str],
    /// The files of the record.
    pub files: &'a [RemoteFile<'a>],
    /// What these files are.
    pub content: Content<'a>,
    /// The folder it becomes, below the data folder, with `/` between folders.
    pub destination: &'a str,
}

/// Where a data set is published.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Record<'a> {
    /// A record of Zenodo, by number.
    Zenodo(u64),
    /// A folder of a data set of Hugging Face.
    HuggingFace { data_set: &'a str, folder: &'a str },
}

/// One file of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RemoteFile<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its size.
    pub bytes: u64,
    /// What it must sum up to.
    pub checksum: Checksum<'a>,
}

/// The sum of a file's bytes in hexadecimal digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Checksum<'a> {
    /// MD5, as Zenodo states it.
    Md5(&'a str),
    /// SHA-256.
    Sha256(&'a str),
}

/// What the files of a record are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content<'a> {
    /// The files themselves.
    Files,
    /// `.tar.gz` archives in which everything lies below the folder `root` and unpacks to at most that many bytes.
    Archives { root: &'a str, largest: u64 },
}

impl DataSet<'_> {
    /// How many bytes its files have together.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.files.iter().map(|file| file.bytes).sum()
    }
}

impl Record<'_> {
    /// The address of the file called `name`.
    #[must_use]
    pub fn address(&self, name: &str) -> String {
        match self {
            Self::Zenodo(number) => {
                format!("https://zenodo.org/records/{number}/files/{name}?download=1")
            }
            Self::HuggingFace { data_set, folder } => {
                format!("https://huggingface.co/datasets/{data_set}/resolve/main/{folder}/{name}")
            }
        }
    }
}

impl fmt::Display for Record<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Zenodo(number) => write!(formatter, "Zenodo {number}"),
            Self::HuggingFace { data_set, folder } => {
                write!(formatter, "Hugging Face data set {data_set}, {folder}")
            }
        }
    }
}

impl fmt::Display for Checksum<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Md5(sum) => write!(formatter, "MD5 {sum}"),
            Self::Sha256(sum) => write!(formatter, "SHA-256 {sum}"),
        }
    }
}

const RECORD: Record<'static> = Record::Zenodo(21_807_280);
const RECORD_LICENCE: &str = "as the record states: https://doi.org/10.5281/zenodo.21807280";
const RECORD_CITATION: &[&str] = &["Arnold, data record, version 3, doi 10.5281/zenodo.21807280"];
const MEGABYTE: u64 = 1_000_000;

/// The leg model of walking.
pub const KINESIS: DataSet<'static> = DataSet {
    name: "kinesis",
    purpose: "the leg model of the task `kinesis`",
    command: "arnold-analyze setup --kinesis",
    record: RECORD,
    licence: RECORD_LICENCE,
    citations: &[
        RECORD_CITATION[0],
        "Simos, Chiappa, Mathis (2025), Reinforcement learning-based motion imitation for physiologically plausible \
         musculoskeletal motor control, arXiv:2503.14637",
    ],
    files: &[RemoteFile {
        name: "kinesis.tar.gz",
        bytes: 13_129_926,
        checksum: Checksum::Md5("2479581598dabeb78894213f0e721c61"),
    }],
    content: Content::Archives { root: "kinesis", largest: 500 * MEGABYTE },
    destination: "kinesis",
};

/// Human muscle activity during walking: nine subjects, nine muscles, 4.5 km/h.
pub const EMG: DataSet<'static> = DataSet {
    name: "emg",
    purpose: "human EMG during walking, to compare policies with",
    command: "arnold-analyze setup --emg",
    record: Record::HuggingFace {
        data_set: "amathislab/kinesis-assets",
        folder: "emg_assets/human_emg",
    },
    licence: "CC BY 4.0 (recordings, Zenodo 7422031); MIT (this selection of them)",
    citations: &[
        "Wang, Basu, Durandau, Sartori (2023), A wearable real-time kinetic measurement sensor setup for human \
         locomotion, Wearable Technologies 4:e11",
        "Wang, Basu, Durandau, Sartori, Comprehensive kinetic and EMG dataset of daily locomotion, Zenodo 7422031",
        "Simos, Chiappa, Mathis (2025), Reinforcement learning-based motion imitation for physiologically plausible \
         musculoskeletal motor control, arXiv:2503.14637",
    ],
    files: &EMG_FILES,
    content: Content::Files,
    destination: "emg",
};

/// The four archives of the released policies and their results.
pub const ARNOLD: [DataSet<'static>; 4] = [
    DataSet {
        name: "checkpoints",
        purpose: "the trained Arnold policies",
        command: "arnold-analyze setup --arnold checkpoints",
        record: RECORD,
        licence: RECORD_LICENCE,
        citations: RECORD_CITATION,
        files: &[RemoteFile {
            name: "arnold-final-checkpoints.tar.gz",
            bytes: 2_808_003_156,
            checksum: Checksum::Md5("6c5fa8da01f47ad0d5a17ce21a8b5bdb"),
        }],
        content: Content::Archives { root: "final_checkpoints", largest: 30_000 * MEGABYTE },
        destination: "final_checkpoints",
    },
    DataSet {
        name: "experts",
        purpose: "the experts of single tasks",
        command: "arnold-analyze setup --arnold experts",
        record: RECORD,
        licence: RECORD_LICENCE,
        citations: RECORD_CITATION,
        files: &[RemoteFile {
            name: "expert-policies.tar.gz",
            bytes: 605_108_600,
            checksum: Checksum::Md5("ab0ea70690c28fef64b1646135858492"),
        }],
        content: Content::Archives { root: "expert_policies", largest: 10_000 * MEGABYTE },
        destination: "expert_policies",
    },
    DataSet {
        name: "benchmarks",
        purpose: "how well each policy does, seed by seed",
        command: "arnold-analyze setup --arnold benchmarks",
        record: RECORD,
        licence: RECORD_LICENCE,
        citations: RECORD_CITATION,
        files: &[RemoteFile {
            name: "arnold-benchmark-results.tar.gz",
            bytes: 381_952,
            checksum: Checksum::Md5("63fd5efaaa40500408d5821aecd6e1c8"),
        }],
        // Its folder inside is called like that of the checkpoints.
        content: Content::Archives { root: "final_checkpoints", largest: 500 * MEGABYTE },
        destination: "final_benchmarks",
    },
    DataSet {
        name: "extra_results",
        purpose: "results and curves of the additional trainings",
        command: "arnold-analyze setup --arnold extra_results",
        record: RECORD,
        licence: RECORD_LICENCE,
        citations: RECORD_CITATION,
        files: &[RemoteFile {
            name: "arnold-benchmark-results-extra.tar.gz",
            bytes: 2_853_958,
            checksum: Checksum::Md5("2e6d489d1c4a2905647b118806fe4202"),
        }],
        content: Content::Archives { root: "final_benchmarks_extra", largest: 1_000 * MEGABYTE },
        destination: "final_benchmarks_extra",
    },
];

/// All data sets, in the order they are shown.
pub const ALL: [DataSet<'static>; 6] = [KINESIS, EMG, ARNOLD[0], ARNOLD[1], ARNOLD[2], ARNOLD[3]];

/// The archive of [`ARNOLD`] called `name`.
pub fn archive(name: &str) -> Result<DataSet<'static>, DataError> {
    ARNOLD.into_iter().find(|set| set.name == name).ok_or_else(|| DataError::UnknownArchive {
        name: name.to_owned(),
        known: ARNOLD.map(|set| set.name).join(", "),
    })
}

const EMG_FILES: [RemoteFile<'static>; 10] = [
    RemoteFile {
        name: "EMG_labels.npy",
        bytes: 968,
        checksum: Checksum::Sha256(
            "e2eb976874003866aed524bd4f57aae744f616348cf7b8eb6164ffb85493b7b6",
        ),
    },
    subject(
        "EMG_subject_04_walk_45_avg.npy",
        "40cc9e526baae3205d948e5ee8f7f6215d10d3842eda581ed912c86acea1c31b",
    ),
    subject(
        "EMG_subject_05_walk_45_avg.npy",
        "c4455b4bce0e57a368e693453ef5bc60fb36b63f6966d5aab9de2e85dcf29301",
    ),
    subject(
        "EMG_subject_06_walk_45_avg.npy",
        "40acb45437d91945440bf334176bd7ce3d089f2f58a2b51304365e65d7752ed8",
    ),
    subject(
        "EMG_subject_07_walk_45_avg.npy",
        "5b2f5c9a0092f6c7cd0f42980cde3719c6c366597db91898d8871c0f91f91be3",
    ),
    subject(
        "EMG_subject_08_walk_45_avg.npy",
        "b7e465897c4982a7bba4de8a4c67ef36437879116ff3f4628eecaf5fc5ce2728",
    ),
    subject(
        "EMG_subject_09_walk_45_avg.npy",
        "be11b56615a0c549106d90577bbd68fb53d31bf273561de29c39ccb39321f6b5",
    ),
    subject(
        "EMG_subject_10_walk_45_avg.npy",
        "f859a2bfff7c0c9a95ec7e2d97132db495d620d764cf8f2f877548aa2c182322",
    ),
    subject(
        "EMG_subject_11_walk_45_avg.npy",
        "5170fde07896d3dca0ca8653b2e45f99f216f4d9d8c31c6e678cccdb15c8e7df",
    ),
    subject(
        "EMG_subject_12_walk_45_avg.npy",
        "a171ba0a28952cbd7a612f917eb837c2df2a066324bda364d2005c840efb328b",
    ),
];

const fn subject(name: &'static str, sha256: &'static str) -> RemoteFile<'static> {
    RemoteFile { name, bytes: 8128, checksum: Checksum::Sha256(sha256) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sum_has_its_length_and_no_two_files_or_folders_are_the_same() {
        let files: Vec<_> = ALL.iter().flat_map(|set| set.files).collect();
        assert_eq!(files.len(), 15);
        for file in &files {
            let (sum, length) = match file.checksum {
                Checksum::Md5(sum) => (sum, 32),
                Checksum::Sha256(sum) => (sum, 64),
            };
            assert_eq!(sum.len(), length, "{}", file.name);
            assert!(sum.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f')), "{sum}");
        }
        let distinct = |mut all: Vec<String>| {
            let count = all.len();
            all.sort();
            all.dedup();
            assert_eq!(all.len(), count);
        };
        distinct(files.iter().map(|file| file.name.to_owned()).collect());
        distinct(files.iter().map(|file| file.checksum.to_string()).collect());
        distinct(ALL.iter().map(|set| set.destination.to_owned()).collect());
    }

    #[test]
    fn an_address_is_the_one_a_person_would_open() {
        assert_eq!(
            KINESIS.record.address(KINESIS.files[0].name),
            "https://zenodo.org/records/21807280/files/kinesis.tar.gz?download=1"
        );
        assert_eq!(
            EMG.record.address("EMG_labels.npy"),
            "https://huggingface.co/datasets/amathislab/kinesis-assets/resolve/main/emg_assets/human_emg/EMG_labels.npy"
        );
    }

    #[test]
    fn an_unknown_archive_is_answered_with_the_known_ones() {
        assert_eq!(archive("experts").unwrap().destination, "expert_policies");
        let text = archive("expert").unwrap_err().to_string();
        assert!(text.contains("checkpoints, experts, benchmarks, extra_results"), "{text}");
    }
}
