//! The build script's part of the dashboard: what is in `dist` becomes a table of files that are
//! compiled in. Where the page was not built, the table is empty.

use std::error::Error;
use std::fmt::Write;
use std::path::Path;

const DIST: &str = "clients/web/dist";
/// What is served, by the ending of its name.
const MEDIA: [(&str, &str); 5] = [
    ("html", "text/html; charset=utf-8"),
    ("js", "text/javascript; charset=utf-8"),
    ("css", "text/css; charset=utf-8"),
    ("svg", "image/svg+xml"),
    ("png", "image/png"),
];

/// Writes the table into the folder for what is generated.
pub(crate) fn dashboard(out: &Path) -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed={DIST}");
    let root = Path::new(&std::env::var("CARGO_MANIFEST_DIR")?).join(DIST);
    let mut table = String::from("static FILES: &[File] = &[\n");
    // Without its page the rest is of no use.
    if root.join("index.html").is_file() {
        for folder in [root.clone(), root.join("assets")] {
            add(&folder, &mut table)?;
        }
    }
    table.push_str("];\n");
    std::fs::write(out.join("dashboard.rs"), table)?;
    Ok(())
}

fn add(folder: &Path, table: &mut String) -> Result<(), Box<dyn Error>> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(()) };
    let mut paths = entries.map(|e| Ok(e?.path())).collect::<Result<Vec<_>, std::io::Error>>()?;
    paths.sort();
    for path in paths {
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        let Some((_, media)) = MEDIA.iter().find(|(known, _)| *known == ending) else { continue };
        let name = path.file_name().and_then(|n| n.to_str()).ok_or("a name is not UTF-8")?;
        let included = |path: &Path| match path.is_file() {
            true => format!("include_bytes!({path:?})"),
            false => "b\"\"".to_owned(),
        };
        let packed = |ending: &str| {
            let mut packed = path.clone().into_os_string();
            packed.push(ending);
            included(Path::new(&packed))
        };
        writeln!(
            table,
            "File {{ name: {name:?}, media: {media:?}, plain: {}, gzip: {}, brotli: {} }},",
            included(&path),
            packed(".gz"),
            packed(".br")
        )?;
    }
    Ok(())
}
