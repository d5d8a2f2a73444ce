//! The kind of a file system, by its number.

use std::path::Path;

use rustix::fs::statfs;

/// Local file systems by their `statfs` numbers (linux/magic.h).
const LOCAL: [(u64, &str); 14] = [
    (0xEF53, "ext4"),
    (0x5846_5342, "xfs"),
    (0x9123_683E, "btrfs"),
    (0x0102_1994, "tmpfs"),
    (0x8584_58F6, "ramfs"),
    (0x794C_7630, "overlayfs"),
    (0x2FC1_2FC1, "zfs"),
    (0xF2F5_2010, "f2fs"),
    (0xCA45_1A4E, "bcachefs"),
    (0x3153_464A, "jfs"),
    (0x5265_4973, "reiserfs"),
    (0x7366_746E, "ntfs3"),
    (0x4D44, "vfat"),
    (0x2011_BAB0, "exfat"),
];

/// Shared file systems, for the output of `deaflow doctor`.
const SHARED: [(u64, &str); 11] = [
    (0x6969, "NFS"),
    (0x6573_5546, "FUSE"),
    (0x0BD0_0BD0, "Lustre"),
    (0xFF53_4D42, "CIFS"),
    (0xFE53_4D42, "SMB2"),
    (0x00C3_6400, "Ceph"),
    (0x1983_0326, "BeeGFS"),
    (0x4750_4653, "GPFS"),
    (0x0102_1997, "9p"),
    (0x5346_414F, "AFS"),
    (0x7461_636F, "OCFS2"),
];

/// Returns the name of the file system of a folder, and whether it is local.
pub fn file_system(folder: &Path) -> (String, bool) {
    let Ok(found) = statfs(folder) else {
        return ("an unknown file system".to_owned(), false);
    };
    // The field is signed on some machines, and has 32 bits.
    #[allow(clippy::unnecessary_cast)]
    let number = (found.f_type as u64) & 0xFFFF_FFFF;
    let name = |list: &[(u64, &str)]| {
        list.iter()
            .find(|(known, _)| *known == number)
            .map(|(_, name)| (*name).to_owned())
    };
    match (name(&LOCAL), name(&SHARED)) {
        (Some(name), _) => (name, true),
        (_, Some(name)) => (name, false),
        _ => (format!("a file system of type {number:#x}"), false),
    }
}
