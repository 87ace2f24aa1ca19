//! Muscle activity over the gait cycle, as upstream keeps it (`spec/analysis.md` §16.4): `human.npz` and `simulation.npz`.

use std::collections::BTreeMap;
use std::path::Path;

use super::RecordError;
use crate::npz::{Array, Elements, Member, TextArray, open_members, write_npz};

/// `human.npz`: recorded activity of several people.
#[derive(Debug, Clone, PartialEq)]
pub struct HumanProfiles {
    /// Numbers of the people.
    pub subjects: Vec<i64>,
    pub muscles: Vec<String>,
    /// Points of the cycle.
    pub points: usize,
    /// People × points × muscles, row-major.
    pub profiles: Vec<f64>,
}

/// `simulation.npz`: mean activity of the policies.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationProfiles {
    /// Rows of the profiles that are compared with people.
    pub emg_muscles: Vec<String>,
    /// Rows of the profile that is factorised.
    pub factor_muscles: Vec<String>,
    /// Name, such as `arnold_left`, to muscles × points.
    pub profiles: BTreeMap<String, Profile>,
}

/// Muscles × points of the cycle, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    pub muscles: usize,
    pub points: usize,
    pub values: Vec<f64>,
}

/// The members of a file, taken out one by one.
struct Members<'a> {
    members: BTreeMap<String, Member>,
    path: &'a Path,
}

impl<'a> Members<'a> {
    fn open(path: &'a Path) -> Result<Self, RecordError> {
        Ok(Self { members: open_members(path)?, path })
    }

    fn wrong(&self, what: String) -> RecordError {
        RecordError::Damaged { format: "npz", what, path: self.path.to_path_buf() }
    }

    fn take(&mut self, name: &str) -> Result<Member, RecordError> {
        self.members.remove(name).ok_or_else(|| self.wrong(format!("`{name}` is missing")))
    }

    fn texts(&mut self, name: &str) -> Result<Vec<String>, RecordError> {
        match self.take(name)? {
            Member::Texts(TextArray { shape, values }) if shape.len() == 1 => Ok(values),
            _ => Err(self.wrong(format!("`{name}` is no list of texts"))),
        }
    }

    fn numbers(&mut self, name: &str) -> Result<Array, RecordError> {
        match self.take(name)? {
            Member::Numbers(array) => Ok(array),
            Member::Texts(_) => Err(self.wrong(format!("`{name}` holds texts, not numbers"))),
        }
    }
}

impl HumanProfiles {
    /// Reads `human.npz`.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let mut file = Members::open(path)?;
        let muscles = file.texts("muscles")?;
        let subjects = file.numbers("subjects")?;
        let Elements::I64(subjects) = subjects.elements else {
            return Err(file.wrong("`subjects` are no whole numbers".to_owned()));
        };
        let profiles = file.numbers("profiles")?;
        let (people, columns) = (subjects.len(), muscles.len());
        let [found_people, points, found_columns] = profiles.shape[..] else {
            return Err(file.wrong(format!("`profiles` has shape {:?}", profiles.shape)));
        };
        if (found_people, found_columns) != (people, columns) {
            let expected = format!("expected {people} × {points} × {columns}");
            return Err(
                file.wrong(format!("`profiles` has shape {:?}, {expected}", profiles.shape))
            );
        }
        Ok(Self { subjects, muscles, points, profiles: profiles.to_f64() })
    }

    /// Writes `human.npz`.
    pub fn write(&self, path: &Path) -> Result<(), RecordError> {
        let shape = vec![self.subjects.len(), self.points, self.muscles.len()];
        let members = BTreeMap::from([
            ("profiles".to_owned(), numbers(shape, Elements::F64(self.profiles.clone()))),
            (
                "subjects".to_owned(),
                numbers(vec![self.subjects.len()], Elements::I64(self.subjects.clone())),
            ),
            ("muscles".to_owned(), texts(&self.muscles)),
        ]);
        Ok(write_npz(path, &members)?)
    }
}

impl SimulationProfiles {
    /// Reads `simulation.npz`.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let mut file = Members::open(path)?;
        let emg_muscles = file.texts("emg_muscles")?;
        let factor_muscles = file.texts("factor_muscles")?;
        let mut profiles = BTreeMap::new();
        let names: Vec<String> = file.members.keys().cloned().collect();
        for name in names {
            let array = file.numbers(&name)?;
            let [muscles, points] = array.shape[..] else {
                return Err(file.wrong(format!("`{name}` has shape {:?}", array.shape)));
            };
            if muscles != emg_muscles.len() && muscles != factor_muscles.len() {
                return Err(file.wrong(format!(
                    "`{name}` has {muscles} muscles, expected {} or {}",
                    emg_muscles.len(),
                    factor_muscles.len()
                )));
            }
            profiles.insert(name, Profile { muscles, points, values: array.to_f64() });
        }
        Ok(Self { emg_muscles, factor_muscles, profiles })
    }

    /// Writes `simulation.npz`.
    pub fn write(&self, path: &Path) -> Result<(), RecordError> {
        let mut members = BTreeMap::from([
            ("emg_muscles".to_owned(), texts(&self.emg_muscles)),
            ("factor_muscles".to_owned(), texts(&self.factor_muscles)),
        ]);
        for (name, Profile { muscles, points, values }) in &self.profiles {
            let array = numbers(vec![*muscles, *points], Elements::F64(values.clone()));
            members.insert(name.clone(), array);
        }
        Ok(write_npz(path, &members)?)
    }
}

fn numbers(shape: Vec<usize>, elements: Elements) -> Member {
    Member::Numbers(Array { shape, elements })
}

fn texts(values: &[String]) -> Member {
    Member::Texts(TextArray { shape: vec![values.len()], values: values.to_vec() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_come_back_and_wrong_shapes_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("human.npz");
        let mut human = HumanProfiles {
            subjects: vec![4, 12],
            muscles: vec!["Soleus".to_owned(), "Musculus gastrocnemius médial".to_owned()],
            points: 3,
            profiles: (0..12).map(|i| f64::from(i) / 7.0).collect(),
        };
        human.write(&path).unwrap();
        assert_eq!(HumanProfiles::open(&path).unwrap(), human);
        human.muscles.pop();
        human.points = 6;
        human.write(&path).unwrap();
        assert_eq!(HumanProfiles::open(&path).unwrap(), human);
        let simulation = SimulationProfiles {
            emg_muscles: vec!["Soleus".to_owned()],
            factor_muscles: vec!["TA".to_owned(), "LG".to_owned()],
            profiles: BTreeMap::from([
                (
                    "arnold_left".to_owned(),
                    Profile { muscles: 1, points: 2, values: vec![0.5, 1.0] },
                ),
                (
                    "arnold_right".to_owned(),
                    Profile { muscles: 2, points: 1, values: vec![0.1, 0.2] },
                ),
            ]),
        };
        simulation.write(&path).unwrap();
        assert_eq!(SimulationProfiles::open(&path).unwrap(), simulation);
        let error = HumanProfiles::open(&path).unwrap_err().to_string();
        assert!(error.contains("`muscles` is missing"), "{error}");
    }
}
