//! How this program is called from where its user is, for lines that are printed to be pasted.

use std::ffi::OsStr;
use std::path::Path;

const NAME: &str = "orenx";

/// The word that runs this very program: its name where `PATH` finds it, else its path, from the
/// current folder if it lies below.
pub(super) fn invocation() -> String {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    match (std::env::current_exe(), std::env::current_dir()) {
        (Ok(own), Ok(here)) => word(&own, &here, &paths),
        (Ok(own), Err(_)) => word(&own, Path::new(""), &paths),
        (Err(_), _) => NAME.into(),
    }
}

fn word(own: &Path, here: &Path, paths: &OsStr) -> String {
    let found = std::env::split_paths(paths).map(|dir| dir.join(NAME)).find(|file| file.is_file());
    let real = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.into());
    if found.is_some_and(|found| real(&found) == real(own)) {
        return NAME.into();
    }
    let path = match own.strip_prefix(here) {
        Ok(below) if !here.as_os_str().is_empty() => Path::new(".").join(below),
        _ => own.into(),
    };
    quoted(&path.display().to_string())
}

/// As a shell reads it back: quoted where a character could mean something else.
fn quoted(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+:@%".contains(c);
    if text.chars().all(is_plain) {
        return text.into();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_is_enough_where_it_leads_here() {
        let folder = tempfile::tempdir().expect("a folder");
        let (bin, own) = (folder.path().join("bin"), folder.path().join("target/release/orenx"));
        std::fs::create_dir_all(&bin).expect("a folder");
        std::fs::create_dir_all(own.parent().expect("a parent")).expect("a folder");
        std::fs::write(&own, "").expect("a file");
        let paths = bin.as_os_str();
        assert_eq!(word(&own, folder.path(), paths), "./target/release/orenx");
        assert_eq!(word(&own, &bin, paths), own.display().to_string());
        // Another orenx comes first.
        std::fs::write(bin.join(NAME), "").expect("a file");
        assert_eq!(word(&own, folder.path(), paths), "./target/release/orenx");
        assert_eq!(word(&bin.join(NAME), folder.path(), paths), "orenx");
    }

    #[test]
    fn a_shell_reads_back_what_is_printed() {
        assert_eq!(quoted("./target/release/orenx"), "./target/release/orenx");
        assert_eq!(quoted("/my maps/orenx"), "'/my maps/orenx'");
        assert_eq!(quoted("/it's/orenx"), r"'/it'\''s/orenx'");
    }
}
