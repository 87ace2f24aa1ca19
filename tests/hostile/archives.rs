//! Zip archives that lie about their members.

use std::io::{Cursor, Write};

use zip::CompressionMethod;
use zip::write::{SimpleFileOptions, ZipWriter};

use arnold_analyze::policy::checkpoint::{self, ArchiveError, CheckpointError, Limits};

use super::build::*;
use super::case::check_policies;

/// An archive being written.
type Writer = ZipWriter<Cursor<Vec<u8>>>;

#[test]
#[expect(clippy::too_many_lines, reason = "a table of cases")]
fn hostile_archives_are_refused() {
    let weights =
        torch_file(&pickle(&named(&[("action_net.weight", vector("0", 3))])), &[("0", &ones(3))]);
    let bomb = |packed: &[u8]| {
        archive_with(CompressionMethod::Deflated, &[("data", packed), ("policy.pth", &weights)])
    };
    let special = |make: fn(&mut Writer)| {
        let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
        writer.start_file("data", SimpleFileOptions::default()).unwrap();
        writer.write_all(b"{}").unwrap();
        writer.start_file("policy.pth", SimpleFileOptions::default()).unwrap();
        writer.write_all(&weights).unwrap();
        make(&mut writer);
        writer.finish().unwrap().into_inner()
    };
    let deflated = bomb(b"{\"num_timesteps\": 1234567890123456789}");
    let settings = |text: &[u8]| archive(&[("data", text), ("policy.pth", &weights)]);
    let many: Vec<String> = (0..30_000).map(|k| k.to_string()).collect();
    let many: Vec<(&str, &[u8])> = many.iter().map(|name| (&name[..], &b""[..])).collect();
    assert!(
        checkpoint::read_checkpoint(&deflated, &Limits::default()).is_ok(),
        "deflated members are read"
    );
    check_policies(vec![
        case!(
            "two members of one name",
            replaced_everywhere(
                &special(|writer| {
                    writer.start_file("dbta", SimpleFileOptions::default()).unwrap();
                }),
                b"dbta",
                b"data"
            ),
            CheckpointError::Archive(ArchiveError::DuplicateMember)
        ),
        case!(
            "two members in one place",
            special(|writer| writer.shallow_copy_file("data", "twin").unwrap()),
            CheckpointError::Archive(ArchiveError::OverlappingMembers)
        ),
        case!("a symbolic link", special(|writer| {
                writer.add_symlink("link", "/etc/passwd", SimpleFileOptions::default()).unwrap();
            }),
            CheckpointError::Archive(ArchiveError::SymbolicLink { member }) if member == "link"),
        case!(
            "a bomb",
            bomb(&vec![b' '; 32 << 20]),
            CheckpointError::Archive(ArchiveError::MemberTooLarge { .. })
        ),
        case!(
            "too many members",
            archive(&many),
            CheckpointError::Archive(ArchiveError::TooManyMembers(_))
        ),
        case!("an encrypted member", {
            let mut bytes = settings(b"{}");
            bytes[6] |= 1;
            let at = central_header(&bytes, "data");
            bytes[at + 8] |= 1;
            bytes
        }, CheckpointError::Archive(ArchiveError::EncryptedMember { member }) if member == "data"),
        case!(
            "a stored member that claims to unpack",
            {
                let mut bytes = settings(b"{}");
                let at = central_header(&bytes, "data");
                bytes[at + 24..at + 28].copy_from_slice(&1_000_000_u32.to_le_bytes());
                bytes
            },
            CheckpointError::Archive(ArchiveError::WrongLength { expected: 1_000_000, .. })
        ),
        case!(
            "a deflated member that unpacks to more than it claims",
            {
                let mut bytes = deflated.clone();
                let at = central_header(&bytes, "data");
                bytes[at + 24..at + 28].copy_from_slice(&5_u32.to_le_bytes());
                bytes
            },
            CheckpointError::Archive(
                ArchiveError::WrongLength { .. } | ArchiveError::DamagedMember { .. }
            )
        ),
        case!(
            "a damaged member",
            replaced(&settings(b"{\"a\": 12345}"), b"12345", b"12346"),
            CheckpointError::Archive(ArchiveError::DamagedMember { .. })
        ),
        case!(
            "a damaged storage",
            {
                let mut bytes = good_policy();
                let one = 1.0_f32.to_le_bytes().repeat(3);
                let at = bytes.windows(12).position(|window| window == one).unwrap();
                bytes[at] ^= 1;
                bytes
            },
            CheckpointError::Archive(ArchiveError::DamagedMember { .. })
        ),
        case!(
            "weights that are no archive",
            policy_archive(b"PK\x03\x04 and nothing"),
            CheckpointError::Archive(ArchiveError::Damaged(_))
        ),
        case!(
            "weights without a pickle",
            policy_archive(&archive(&[("x", b"")])),
            CheckpointError::NotATorchFile { .. }
        ),
        case!(
            "weights with two pickles",
            policy_archive(&archive(&[("a/data.pkl", b""), ("b/data.pkl", b"")])),
            CheckpointError::NotATorchFile { .. }
        ),
        case!(
            "an archive of something else",
            archive(&[("x", b"")]),
            CheckpointError::NotAPolicy { .. }
        ),
        case!(
            "settings nested without end",
            settings(&b"[".repeat(1_000_000)),
            CheckpointError::Settings { .. }
        ),
        case!(
            "settings with ten million values",
            settings(&[&b"[0"[..], &b",0".repeat(10_000_000), b"]"].concat()),
            CheckpointError::Limit { .. }
        ),
        case!("settings that are no text", settings(b"\xff\xfe"), CheckpointError::Settings { .. }),
    ]);
}
