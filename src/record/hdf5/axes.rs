//! Order of the joints and muscles of `MyoHand` in upstream's recordings (`spec/analysis.md` §16.5), for files that do not
//! say it themselves.

use std::path::Path;

use serde::Deserialize;

use crate::files;
use crate::record::RecordError;

/// No file of names is larger.
const LARGEST_FILE: u64 = 1 << 20;

/// What the columns of a recording are.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct Axes {
    pub joint_names: Vec<String>,
    pub muscle_names: Vec<String>,
}

impl Axes {
    /// Those of `MyoHand`: 23 joints, 39 muscles.
    #[must_use]
    pub fn hand() -> Self {
        const WRIST_AND_THUMB: [&str; 7] = [
            "pro_sup",
            "deviation",
            "flexion",
            "cmc_abduction",
            "cmc_flexion",
            "mp_flexion",
            "ip_flexion",
        ];
        const FIRST_MUSCLES: [&str; 27] = [
            "ECRL", "ECRB", "ECU", "FCR", "FCU", "PL", "PT", "PQ", "FDS5", "FDS4", "FDS3", "FDS2",
            "FDP5", "FDP4", "FDP3", "FDP2", "EDC5", "EDC4", "EDC3", "EDC2", "EDM", "EIP", "EPL",
            "EPB", "FPL", "APL", "OP",
        ];
        let fingers = 2..=5;
        let joints = fingers.clone().flat_map(|finger| {
            [
                format!("mcp{finger}_flexion"),
                format!("mcp{finger}_abduction"),
                format!("pm{finger}_flexion"),
                format!("md{finger}_flexion"),
            ]
        });
        let muscles = fingers
            .flat_map(|finger| ["RI", "LU_RB", "UI_UB"].map(|name| format!("{name}{finger}")));
        let owned = |name: &&str| (*name).to_owned();
        Self {
            joint_names: WRIST_AND_THUMB.iter().map(owned).chain(joints).collect(),
            muscle_names: FIRST_MUSCLES.iter().map(owned).chain(muscles).collect(),
        }
    }

    /// Reads a `hand_axes.json`.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let bytes = files::read_bounded(path, LARGEST_FILE)?;
        serde_json::from_slice(&bytes).map_err(|error| RecordError::Damaged {
            format: "JSON",
            what: error.to_string(),
            path: path.to_path_buf(),
        })
    }
}
