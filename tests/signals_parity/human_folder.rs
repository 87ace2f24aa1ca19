//! A folder of human EMG: labels and one table per person, at 4.5 km/h. The format: `data/emg/README.md`.

use std::path::Path;

use arnold_analyze::analysis::emg::{HumanProfiles, SubjectTable};
use arnold_analyze::analysis::signal::Rows;
use arnold_analyze::npz::parse_npy;

/// The nine people in `folder`.
pub(crate) fn people_in(folder: &Path) -> HumanProfiles {
    let labels = texts(&folder.join("EMG_labels.npy"));
    let table = |subject| {
        let name = format!("EMG_subject_{subject:02}_walk_45_avg.npy");
        let array = parse_npy(&name, &std::fs::read(folder.join(&name)).unwrap()).unwrap();
        assert_eq!(array.shape, [100, 10], "{name}");
        (subject, array.to_f64())
    };
    let tables: Vec<(u32, Vec<f64>)> = (4..=12).map(table).collect();
    let tables: Vec<SubjectTable<'_>> = tables
        .iter()
        .map(|(subject, table)| SubjectTable {
            subject: *subject,
            rows: Rows::new(table, 10).unwrap(),
        })
        .collect();
    HumanProfiles::new(&labels, &tables).unwrap()
}

/// The texts of an array of fixed width, four bytes per character, padded with zeros.
pub(crate) fn texts(path: &Path) -> Vec<String> {
    let bytes = std::fs::read(path).unwrap();
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[10..start]).into_owned();
    let (_, after) = header.split_once("<U").unwrap();
    let width: usize = after.split('\'').next().unwrap().parse().unwrap();
    let character = |code: &[u8; 4]| char::from_u32(u32::from_le_bytes(*code)).unwrap();
    bytes[start..]
        .chunks_exact(4 * width)
        .map(|text| {
            text.as_chunks::<4>().0.iter().map(character).take_while(|c| *c != '\0').collect()
        })
        .collect()
}
