//! Group and permissions of a file that takes the place of another one.

use std::fs::{File, Metadata, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
use std::path::Path;

use rustix::fs::{XattrFlags, fremovexattr, fsetxattr, lgetxattr};
use rustix::io::Errno;

/// The file that a new one will replace.
pub struct Replaced<'a> {
    path: &'a Path,
    data: Metadata,
    /// It belongs to the user of this process.
    pub is_own: bool,
}

impl<'a> Replaced<'a> {
    /// Looks at the file at `path`; `None` for no file, a link and all that is no regular file.
    pub fn at(path: &'a Path) -> Option<Self> {
        let data = std::fs::symlink_metadata(path).ok().filter(Metadata::is_file)?;
        let is_own = data.uid() == rustix::process::geteuid().as_raw();
        Some(Self { path, data, is_own })
    }

    /// Gives the user's `new` file the group and the permissions of the old one, if that was the
    /// user's, too: a file that was closed to others stays so.
    pub fn give_rights(&self, new: &File) {
        // A file system may give the files of root to nobody.
        if !self.is_own && new.metadata().map_or(true, |new| new.uid() != self.data.uid()) {
            return;
        }
        let of_group = fchown(new, None, Some(self.data.gid())).is_ok();
        let mode = mode_of(self.data.mode(), of_group && self.give_list(new));
        let _ = new.set_permissions(Permissions::from_mode(mode));
    }

    /// Gives `new` the list of access rights of the old file (`setfacl`), or none. A folder may
    /// have given it one. Returns whether that succeeded.
    fn give_list(&self, new: &File) -> bool {
        const NONE: [Errno; 4] = [Errno::NODATA, Errno::OPNOTSUPP, Errno::NOSYS, Errno::NOENT];
        let mut list = vec![0; MAX_LIST];
        match lgetxattr(self.path, ACCESS_LIST, &mut list[..]) {
            Ok(bytes) => fsetxattr(new, ACCESS_LIST, &list[..bytes], XattrFlags::empty()).is_ok(),
            Err(error) if NONE.contains(&error) => {
                fremovexattr(new, ACCESS_LIST).map_or_else(|error| NONE.contains(&error), |()| true)
            }
            Err(_) => false,
        }
    }
}

/// The attribute of a file with its list of access rights, acl(5).
const ACCESS_LIST: &str = "system.posix_acl_access";

/// Most bytes of an attribute, in Linux's limits.h.
const MAX_LIST: usize = 1 << 16;

/// Returns the permissions of a file that replaces one of mode `old`, without setuid. If it did not
/// get group and list of access rights, its group may do what all may: the bits would be for
/// another group, and beside a list they are the most that the list grants.
fn mode_of(old: u32, has_group: bool) -> u32 {
    let old = old & 0o777;
    if has_group { old } else { old & (!0o070 | (old & 0o007) << 3) }
}

#[cfg(test)]
mod tests {
    use super::super::PartFile;
    use super::*;

    fn mode_at(path: &Path) -> u32 {
        std::fs::metadata(path).unwrap().mode() & 0o7777
    }

    fn replace(path: &Path) -> Metadata {
        let mut part = PartFile::create(path).unwrap();
        part.fill(b"new").unwrap();
        part.commit().unwrap().1.metadata().unwrap()
    }

    #[test]
    fn a_file_gives_its_permissions_to_its_successor() {
        let folder = tempfile::tempdir().unwrap();
        let [path, other] = ["a.exr", "b.exr"].map(|name| folder.path().join(name));
        std::fs::write(&other, "old").unwrap();
        assert_eq!(replace(&path).mode() & 0o7777, mode_at(&other));
        assert!(Replaced::at(&folder.path().join("c.exr")).is_none());
        for (before, after) in [(0o640, 0o640), (0o604, 0o604), (0o444, 0o444), (0o4755, 0o755)] {
            std::fs::set_permissions(&path, Permissions::from_mode(before)).unwrap();
            assert!(Replaced::at(&path).unwrap().is_own);
            assert_eq!(replace(&path).mode() & 0o7777, after, "{before:o}");
        }
    }

    #[test]
    fn another_group_may_do_what_all_may() {
        let cases =
            [(0o660, 0o600), (0o664, 0o644), (0o4755, 0o755), (0o771, 0o711), (0o606, 0o606)];
        for (old, new) in cases {
            assert_eq!([mode_of(old, true), mode_of(old, false)], [old & 0o777, new], "{old:o}");
        }
    }

    #[test]
    fn a_file_gives_its_group_to_its_successor() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        std::fs::write(&path, "old").unwrap();
        let own = std::fs::metadata(&path).unwrap();
        // Only some users may give a file to a group that is not their own.
        let group = own.gid() + 4321;
        if fchown(File::open(&path).unwrap(), None, Some(group)).is_ok() {
            std::fs::set_permissions(&path, Permissions::from_mode(0o660)).unwrap();
            let new = replace(&path);
            assert_eq!((new.gid(), new.mode() & 0o7777), (group, 0o660));
            // The rights of another user's file do not count.
            if std::os::unix::fs::chown(&path, Some(own.uid() + 1), None).is_ok() {
                std::fs::write(folder.path().join("b.exr"), "").unwrap();
                let usual = mode_at(&folder.path().join("b.exr"));
                let new = replace(&path);
                assert_eq!((new.gid(), new.mode() & 0o7777), (own.gid(), usual));
            }
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_file_gives_its_list_of_access_rights_to_its_successor() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        // acl(5), linux/posix_acl_xattr.h: version 2; owner, user 65534, group, mask, all.
        let entries: [(u16, u16, u32); 5] =
            [(1, 6, !0), (2, 4, 65534), (4, 0, !0), (16, 4, !0), (32, 0, !0)];
        let mut list = 2u32.to_le_bytes().to_vec();
        for (tag, rights, id) in entries {
            list.extend([tag.to_le_bytes(), rights.to_le_bytes()].concat());
            list.extend(id.to_le_bytes());
        }
        let set = |path: &Path, name: &str| {
            rustix::fs::setxattr(path, name, &list, XattrFlags::empty()).is_ok()
        };
        let has_list = |path: &Path| {
            let mut found = [0; 256];
            lgetxattr(path, ACCESS_LIST, &mut found[..]).is_ok_and(|bytes| found[..bytes] == list)
        };
        std::fs::write(&path, "old").unwrap();
        if !set(&path, ACCESS_LIST) {
            return; // This file system has no such lists.
        }
        assert!(has_list(&path));
        assert_eq!(mode_at(&path), 0o640);
        replace(&path);
        assert!(has_list(&path));
        assert_eq!(mode_at(&path), 0o640);
        // A file without a list in a folder that gives one to new files.
        rustix::fs::removexattr(&path, ACCESS_LIST).unwrap();
        std::fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        assert!(set(folder.path(), "system.posix_acl_default"));
        replace(&path);
        assert!(!has_list(&path));
        assert_eq!(mode_at(&path), 0o640);
        let new = folder.path().join("b.exr");
        replace(&new);
        assert!(has_list(&new));
    }
}
