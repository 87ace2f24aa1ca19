//! Fetching a wheel with the user's own `pip`, or `pip` run by `uv`. Where packages come from is their business: the
//! project names a package and a version, never an address.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use super::{AssetError, Part, Platform};

/// The ways to run `pip`, best first: program and the words before `pip`'s own.
const WAYS: [(&str, &[&str]); 5] = [
    ("python3", &["-m", "pip"]),
    ("python", &["-m", "pip"]),
    ("pip3", &[]),
    ("pip", &[]),
    ("uv", &["tool", "run", "pip"]),
];
/// How much of what `pip` said an error repeats.
const LAST_LINES: usize = 6;

/// A way to run `pip` that works on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pip {
    program: &'static str,
    leading: &'static [&'static str],
    /// What the program says about its version.
    pub version: String,
}

impl Pip {
    /// The first way that works.
    #[must_use]
    pub fn find() -> Option<Self> {
        WAYS.iter().find_map(|&(program, leading)| {
            // `uv` fetches pip when it runs it; asking `uv` itself does not.
            let before: &[&str] = if program == "uv" { &[] } else { leading };
            let output = quiet(Command::new(program).args(before).arg("--version")).ok()?;
            let text = String::from_utf8_lossy(&output.stdout);
            let version = text.lines().next().unwrap_or_default().trim().to_owned();
            output.status.success().then_some(Self { program, leading, version })
        })
    }

    /// The command a person would type: `python3 -m pip`.
    #[must_use]
    pub fn command(&self) -> String {
        spell(self.program, self.leading)
    }

    /// Downloads the wheel of `part` for `platform` into `folder`.
    pub(super) fn download(
        &self,
        part: Part,
        platform: Option<Platform>,
        folder: &Path,
    ) -> Result<PathBuf, AssetError> {
        let requirement = format!("{}=={}", part.package(), part.version());
        let failed = |last_lines: String| AssetError::PipFailed {
            what: part.to_string(),
            command: format!("{} download {requirement}", self.command()),
            last_lines,
        };
        let mut command = Command::new(self.program);
        command.args(self.leading).args(["download", "--no-deps", "--only-binary=:all:"]);
        command.args(["--disable-pip-version-check", "--no-input", "--progress-bar=off"]);
        // The wheels hold plain libraries: any Python may fetch those of 3.11.
        command.args(["--python-version=3.11", "--implementation=cp", "--abi=cp311"]);
        for tag in platform.map_or(&[][..], Platform::wheel_tags) {
            command.arg(format!("--platform={tag}"));
        }
        command.arg("--dest").arg(folder).arg(&requirement);
        let output = quiet(&mut command).map_err(|error| failed(format!("  {error}")))?;
        if !output.status.success() {
            return Err(failed(last_lines(&output)));
        }
        find_wheel(part, platform, folder)
    }
}

/// The ways that are tried, as a person would type them.
#[must_use]
pub fn ways() -> String {
    let commands = WAYS.map(|(program, leading)| format!("`{}`", spell(program, leading)));
    commands.join(", ")
}

/// The wheel of `part` for `platform` in `folder`, by its file name; the last in alphabetical order if there are several.
pub(super) fn find_wheel(
    part: Part,
    platform: Option<Platform>,
    folder: &Path,
) -> Result<PathBuf, AssetError> {
    let absent = || AssetError::NoWheelIn { what: part.to_string(), folder: folder.to_path_buf() };
    let start = format!("{}-{}-", part.package(), part.version()).to_lowercase();
    let entries = std::fs::read_dir(folder).map_err(|_| absent())?;
    let fits = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let tags = name.strip_suffix(".whl").filter(|name| name.starts_with(&start));
        let tag = tags.and_then(|tags| tags.rsplit('-').next());
        tag.is_some_and(|tag| tag == "any" || platform.is_some_and(|known| known.runs(tag)))
    };
    entries.filter_map(|entry| Some(entry.ok()?.path())).filter(fits).max().ok_or_else(absent)
}

fn spell(program: &str, leading: &[&str]) -> String {
    leading.iter().fold(program.to_owned(), |text, word| text + " " + word)
}

fn quiet(command: &mut Command) -> std::io::Result<Output> {
    command.stdin(Stdio::null()).output()
}

/// The last lines of what a program said, indented; of stderr if it said anything there.
fn last_lines(output: &Output) -> String {
    let said = if output.stderr.is_empty() { &output.stdout } else { &output.stderr };
    let text = String::from_utf8_lossy(said);
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
    let last: Vec<String> = lines[lines.len().saturating_sub(LAST_LINES)..]
        .iter()
        .map(|line| format!("  {line}"))
        .collect();
    last.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assets::PhysicsVersion;
    use crate::files;

    #[test]
    fn a_wheel_is_found_by_package_version_and_platform() {
        let folder = tempfile::tempdir().unwrap();
        let names = [
            "mujoco-2.3.7-cp311-cp311-macosx_11_0_arm64.whl",
            "mujoco-2.3.7-cp311-cp311-manylinux_2_17_x86_64.manylinux2014_x86_64.whl",
            "mujoco-3.17.0-cp311-cp311-manylinux_2_27_aarch64.manylinux_2_28_aarch64.whl",
            "MyoSuite-2.2.0-py3-none-any.whl",
        ];
        for name in names {
            files::write_atomic(&folder.path().join(name), b"").unwrap();
        }
        let find = |part, platform| {
            let found = find_wheel(part, platform, folder.path()).ok()?;
            Some(found.file_name()?.to_str()?.to_owned())
        };
        let old = Part::Physics(PhysicsVersion::V2_3_7);
        let new = Part::Physics(PhysicsVersion::V3_17_0);
        assert_eq!(find(old, Some(Platform::MacArm)).as_deref(), Some(names[0]));
        assert_eq!(find(old, Some(Platform::LinuxX86)).as_deref(), Some(names[1]));
        assert_eq!(find(new, Some(Platform::LinuxArm)).as_deref(), Some(names[2]));
        assert_eq!(find(new, Some(Platform::LinuxX86)), None);
        assert_eq!(find(Part::MyoSuite, None).as_deref(), Some(names[3]));
    }

    #[cfg(unix)]
    #[test]
    fn only_the_last_lines_of_a_long_complaint_are_repeated() {
        use std::os::unix::process::ExitStatusExt;
        let stderr = "line\n\n".repeat(50).into_bytes();
        let stderr = [stderr, b"the end\n".to_vec()].concat();
        let status = std::process::ExitStatus::from_raw(1);
        let text = last_lines(&Output { status, stdout: b"ignored".to_vec(), stderr });
        assert_eq!(text.lines().count(), LAST_LINES);
        assert!(text.ends_with("  line\n  the end"), "{text}");
    }
}
