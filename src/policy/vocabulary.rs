//! The words that describe sensors and muscles to the transformer (`spec/policy.md` §1.16).
//!
//! A word's id is its row in the embedding table. The table below is what the published models were trained with; a
//! `vocabulary.json` beside a checkpoint says otherwise for that checkpoint, and [`super::open`] then
//! brings its rows into this order.

use std::collections::BTreeMap;

use super::PolicyError;
use super::checkpoint::contents::{SignatureStatistics, Tensor, TensorMap};
use crate::files::printable;

/// Ids are positions. Checkpoints depend on the order: never change it, only append.
#[rustfmt::skip]
const WORDS: [&str; 214] = [
    "padding", "value", "extn", "adabR", "adabL", "mflx", "dflx", "IFadb", "IFmcp", "IFpip",
    "IFdip", "TRIlong", "TRIlat", "TRImed", "BIClong", "BICshort", "BRA", "r_elbow_flex", "ECRL",
    "ECRB", "ECU", "FCR", "FCU", "PL", "PT", "PQ", "FDS5", "FDS4", "FDS3", "FDS2", "FDP5", "FDP4",
    "FDP3", "FDP2", "EDC5", "EDC4", "EDC3", "EDC2", "EDM", "EIP", "EPL", "EPB", "FPL", "APL", "OP",
    "RI2", "LU_RB2", "UI_UB2", "RI3", "LU_RB3", "UI_UB3", "RI4", "LU_RB4", "UI_UB4", "RI5",
    "LU_RB5", "UI_UB5", "pro_sup", "deviation", "flexion", "cmc_abduction", "cmc_flexion",
    "mp_flexion", "ip_flexion", "mcp2_flexion", "mcp2_abduction", "pm2_flexion", "md2_flexion",
    "mcp3_flexion", "mcp3_abduction", "pm3_flexion", "md3_flexion", "mcp4_flexion",
    "mcp4_abduction", "pm4_flexion", "md4_flexion", "mcp5_flexion", "mcp5_abduction",
    "pm5_flexion", "md5_flexion", "THtip", "IFtip", "MFtip", "RFtip", "LFtip", "ball", "die",
    "addbrev", "addlong", "addmagDist", "addmagIsch", "addmagMid", "addmagProx", "bflh", "bfsh",
    "edl", "ehl", "fdl", "fhl", "gaslat", "gasmed", "glmax1", "glmax2", "glmax3", "glmed1",
    "glmed2", "glmed3", "glmin1", "glmin2", "glmin3", "grac", "iliacus", "perbrev", "perlong",
    "piri", "psoas", "recfem", "sart", "semimem", "semiten", "soleus", "tfl", "tibant", "tibpost",
    "vasint", "vaslat", "vasmed", "pelvis", "joint", "muscle", "tip", "target", "error",
    "position", "velocity", "acceleration", "force", "activation", "linear", "angular", "x", "y",
    "z", "left", "right", "object", "id_1", "id_2", "id_3", "id_4", "id_5", "id_6", "id_7", "id_8",
    "id_9", "id_10", "pen", "DELT1", "DELT2", "DELT3", "SUPSP", "INFSP", "SUBSC", "TMIN", "TMAJ",
    "PECM1", "PECM2", "PECM3", "LAT1", "LAT2", "LAT3", "CORB", "ANC", "SUP", "BRD",
    "sternoclavicular_r2", "sternoclavicular_r3", "unrotscap_r3", "unrotscap_r2",
    "acromioclavicular_r2", "acromioclavicular_r3", "acromioclavicular_r1", "unrothum_r1",
    "unrothum_r3", "unrothum_r2", "elv_angle", "shoulder_elv", "shoulder1_r2", "shoulder_rot",
    "elbow_flexion", "OBJTx", "OBJTy", "OBJTz", "OBJRx", "OBJRy", "OBJRz", "hip_flexion",
    "hip_adduction", "hip_rotation", "knee_angle_translation2", "knee_angle_translation1",
    "knee_angle", "knee_angle_rotation2", "knee_angle_rotation3", "ankle_angle", "subtalar_angle",
    "mtp_angle", "knee_angle_beta_translation2", "knee_angle_beta_translation1",
    "knee_angle_beta_rotation1", "foot", "toes", "root", "contact",
];

/// Words and their ids.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Vocabulary {
    words: Vec<String>,
    ids: BTreeMap<String, u16>,
}

impl Vocabulary {
    /// The vocabulary of the published models.
    #[must_use]
    pub fn standard() -> Self {
        let words: Vec<String> = WORDS.iter().map(|&word| word.to_owned()).collect();
        let ids = words.iter().cloned().zip(0..).collect();
        Self { words, ids }
    }

    /// Reads a `vocabulary.json`, an object of words and ids. The ids must be 0, 1, 2, … without a gap.
    pub fn from_json(bytes: &[u8]) -> Result<Self, PolicyError> {
        let fail = |what: String| PolicyError::Vocabulary { what };
        let ids: BTreeMap<String, u16> =
            serde_json::from_slice(bytes).map_err(|error| fail(printable(&error.to_string())))?;
        let mut words = vec![String::new(); ids.len()];
        let mut taken = vec![false; ids.len()];
        for (word, &id) in &ids {
            let place = usize::from(id);
            if taken.get(place) != Some(&false) {
                return Err(fail(format!(
                    "id {id} of word `{}` leaves a gap or is used twice",
                    printable(word)
                )));
            }
            taken[place] = true;
            words[place].clone_from(word);
        }
        Ok(Self { words, ids })
    }

    /// Number of words, `padding` included.
    #[must_use]
    pub fn len(&self) -> usize {
        self.words.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// Whether its entries are whole descriptions, words joined by `/`, one id each (`spec/policy.md` §2.1).
    #[must_use]
    pub fn is_atomic(&self) -> bool {
        self.words.iter().any(|word| word.contains('/'))
    }

    #[must_use]
    pub fn id_of(&self, word: &str) -> Option<u16> {
        self.ids.get(word).copied()
    }

    #[must_use]
    pub fn word_of(&self, id: u16) -> Option<&str> {
        self.words.get(usize::from(id)).map(String::as_str)
    }

    /// The words in the order of their ids.
    #[must_use]
    pub fn words(&self) -> &[String] {
        &self.words
    }

    /// The vocabulary whose ids are the positions in `words`, no two of which may be the same.
    pub fn from_words(words: Vec<String>) -> Result<Self, PolicyError> {
        let fail = |what: String| PolicyError::Vocabulary { what };
        let mut ids = BTreeMap::new();
        for (id, word) in words.iter().enumerate() {
            let id = u16::try_from(id).map_err(|_| fail("it has too many words".to_owned()))?;
            if ids.insert(word.clone(), id).is_some() {
                return Err(fail(format!("word `{word}` occurs twice")));
            }
        }
        Ok(Self { words, ids })
    }

    /// Words of `target` that this one lacks, in their order.
    #[must_use]
    pub fn missing<'a>(&self, target: &'a Vocabulary) -> Vec<&'a str> {
        let words = target.words.iter().map(String::as_str);
        words.filter(|word| !self.ids.contains_key(*word)).collect()
    }

    /// Rewrites the embeddings of a checkpoint that was trained with `self` so that they are addressed with the ids
    /// of `target`: every word keeps its trained row, words new to the checkpoint get the padding row.
    pub(super) fn translate_embeddings(
        &self,
        target: &Vocabulary,
        tensors: &mut TensorMap,
    ) -> Result<(), PolicyError> {
        tensors
            .iter_mut()
            .filter(|(name, _)| is_table(name))
            .try_for_each(|(name, tensor)| self.translate_rows(target, name, tensor))
    }

    /// Rewrites the signatures of statistics that were gathered with `self`. A word that `target` lacks becomes one
    /// that no sensor has.
    pub(super) fn translate_signatures(
        &self,
        target: &Vocabulary,
        statistics: &mut SignatureStatistics,
    ) {
        for id in statistics.signatures.iter_mut().flatten() {
            let word = self.word_of(*id);
            *id = word.and_then(|word| target.id_of(word)).unwrap_or(u16::MAX);
        }
    }

    fn translate_rows(
        &self,
        target: &Vocabulary,
        name: &str,
        tensor: &mut Tensor,
    ) -> Result<(), PolicyError> {
        let [rows, width] = tensor.shape[..] else {
            return Err(PolicyError::TensorShape {
                name: name.to_owned(),
                expected: "a matrix".to_owned(),
                found: tensor.shape.clone(),
            });
        };
        if rows != self.len() || rows.checked_mul(width) != Some(tensor.data.len()) {
            return Err(PolicyError::TensorShape {
                name: name.to_owned(),
                expected: format!("{} rows, one per word of its vocabulary", self.len()),
                found: tensor.shape.clone(),
            });
        }
        let row_of = |word: &String| usize::from(self.id_of(word).unwrap_or(0));
        let sources = target.words.iter().map(row_of);
        tensor.data =
            sources.flat_map(|row| tensor.data[row * width..(row + 1) * width].to_vec()).collect();
        tensor.shape = vec![target.len(), width];
        Ok(())
    }
}

/// Whether a tensor holds one row per word: the shared table, learned or fixed, or one task's own.
fn is_table(name: &str) -> bool {
    let table = name.split_once("positional_encoder.").map(|(_, table)| table);
    table.is_some_and(|table| {
        matches!(table, "embedding" | "embedding.weight")
            || (table.starts_with("task_embeddings.") && table.ends_with(".weight"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_vocabulary_has_214_distinct_words() {
        let vocabulary = Vocabulary::standard();
        assert_eq!((vocabulary.len(), vocabulary.ids.len()), (214, 214));
        for (word, id) in [("padding", 0), ("value", 1), ("FDS5", 26), ("hip_flexion", 196)] {
            assert_eq!((vocabulary.id_of(word), vocabulary.word_of(id)), (Some(id), Some(word)));
        }
    }

    #[test]
    fn a_vocabulary_with_gaps_is_refused() {
        for text in [r#"{"a": 0, "b": 2}"#, r#"{"a": 0, "b": 0}"#, r#"{"a": -1}"#, "[]"] {
            assert!(Vocabulary::from_json(text.as_bytes()).is_err(), "{text}");
        }
    }

    #[test]
    fn every_kind_of_table_is_recognised() {
        let prefix = "pi_features_extractor.positional_encoder";
        for table in ["embedding", "embedding.weight", "task_embeddings.pen.weight"] {
            assert!(is_table(&format!("{prefix}.{table}")), "{table}");
        }
        for other in ["features_extractor.tokenizer.weight", "a.positional_encoder.embedding.bias"]
        {
            assert!(!is_table(other), "{other}");
        }
    }

    #[test]
    fn a_word_twice_is_refused() {
        let words = |words: &[&str]| words.iter().map(|&word| word.to_owned()).collect();
        assert!(Vocabulary::from_words(words(&["a", "b", "a"])).is_err());
        let small = Vocabulary::from_words(words(&["a", "b"])).unwrap();
        let large = Vocabulary::from_words(words(&["c", "b", "a"])).unwrap();
        assert_eq!(small.missing(&large), ["c"]);
    }

    #[test]
    fn translation_moves_rows_and_signatures_with_their_words() {
        let old = Vocabulary::from_json(br#"{"padding": 0, "hip": 1, "knee": 2}"#).unwrap();
        let new = Vocabulary::from_json(br#"{"padding": 0, "knee": 1, "toe": 2}"#).unwrap();
        let name = "features_extractor.positional_encoder.embedding.weight".to_owned();
        let table = Tensor { shape: vec![3, 1], data: vec![0.0, 5.0, 6.0] };
        let mut tensors = TensorMap::from([(name.clone(), table)]);
        old.translate_embeddings(&new, &mut tensors).unwrap();
        assert_eq!(tensors[&name].data, [0.0, 6.0, 0.0]);

        let mut statistics = SignatureStatistics {
            signatures: vec![vec![0], vec![1, 2], vec![2]],
            mean: Vec::new(),
            variance: Vec::new(),
            count: Vec::new(),
            lags: 1,
            epsilon: 1e-8,
            clip: 10.0,
            enabled: true,
        };
        old.translate_signatures(&new, &mut statistics);
        assert_eq!(statistics.signatures, [vec![0], vec![u16::MAX, 1], vec![1]]);
    }
}
