//! Sizes, names, leftovers, and what stands at the top level.

use std::fs;

use super::source::tokens;
use super::{SourceFile, assert_none, files, root};

/// A file is about one thing: about 150 lines, never over this. The unit tests at its end do not
/// count, so that nobody saves on them.
const MAX_LINES: usize = 400;

/// Files that are longer, and why. An entry that is no longer needed fails as well.
const LONGER: [(&str, &str); 2] = [
    ("src/octree/topology.rs", "all that may change nodes and rows, so that no one else can"),
    (
        "clients/python/src/orenx/verbs/planner.py",
        "planners' verbs, with the types of their answers",
    ),
];

/// Such a list.
type Listed<'a> = &'a [(&'a str, &'a str)];

/// Names that say nothing about what is inside.
const GRAB_BAGS: [&str; 8] =
    ["manager", "helper", "helpers", "common", "util", "utils", "misc", "stuff"];

/// Marks of unfinished work, spelled so that this file does not hold them.
const LEFTOVERS: [&str; 5] = [
    concat!("TO", "DO"),
    concat!("FIX", "ME"),
    concat!("XX", "X"),
    concat!("todo", "!("),
    concat!("unimplemented", "!("),
];

/// What may stand at the top level.
const TOP: [&str; 23] = [
    ".dockerignore",
    ".ci",
    ".cargo",
    ".clippy.toml",
    ".deny.toml",
    ".git",
    ".gitattributes",
    ".github",
    ".gitignore",
    ".rustfmt.toml",
    ".typos.toml",
    "Cargo.lock",
    "Cargo.toml",
    "LICENSE-APACHE",
    "LICENSE-MIT",
    "Makefile",
    "README.md",
    "clients",
    "deploy",
    "proto",
    "shaders",
    "src",
    "tests",
];

fn is_word_in(words: &str, listed: &[&str]) -> bool {
    words.split(['_', '-', '.', '/']).any(|word| listed.contains(&word.to_lowercase().as_str()))
}

/// `CamelCase` as `Camel_Case`, so that its words can be told apart.
fn split_camel(name: &str) -> String {
    let mut split = String::new();
    for c in name.chars() {
        if c.is_uppercase() {
            split.push('_');
        }
        split.push(c);
    }
    split
}

fn broken(file: &SourceFile, longer: Listed) -> Vec<String> {
    let path = &file.path;
    let mut broken = Vec::new();
    let own = file.text.split("\n#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let lines = if path.ends_with("/tests.rs") { 0 } else { own.lines().count() };
    let listed = longer.iter().any(|(name, _)| name == path);
    if lines > MAX_LINES && !listed {
        broken.push(format!("{path}: {lines} lines are more than {MAX_LINES}"));
    }
    if lines <= MAX_LINES && listed {
        broken.push(format!("{path}: is no longer long; take it off the list"));
    }
    if is_word_in(path, &GRAB_BAGS) {
        broken.push(format!("{path}: the name says nothing about what is inside"));
    }
    for (number, line) in file.text.lines().enumerate() {
        if let Some(mark) = LEFTOVERS.iter().find(|mark| line.contains(**mark)) {
            broken.push(format!("{path}:{}: {mark} leaves work for later", number + 1));
        }
    }
    if path.ends_with(".rs") {
        broken.extend(broken_in_code(file));
    }
    broken
}

fn broken_in_code(file: &SourceFile) -> Vec<String> {
    let tokens = tokens(&file.text);
    let mut broken = Vec::new();
    for pair in tokens.windows(2) {
        let (keyword, name) = (pair[0].text, &pair[1]);
        let declares = matches!(keyword, "struct" | "enum" | "trait" | "mod" | "fn" | "type");
        if declares && is_word_in(&split_camel(name.text), &GRAB_BAGS) {
            broken.push(format!(
                "{}:{}: the name {} says nothing about what it is",
                file.path, name.line, name.text
            ));
        }
    }
    if file.path.starts_with("tests/") {
        for token in tokens.iter().filter(|token| token.text == "sleep") {
            broken.push(format!(
                "{}:{}: a test waits for what it needs, never for time to pass",
                file.path, token.line
            ));
        }
    }
    broken
}

#[test]
fn files_are_short_finished_and_well_named() {
    let text =
        [".rs", ".wgsl", ".proto", ".md", ".toml", ".py", ".js", ".mjs", ".ts", ".html", ".css"];
    let folders = ["src", "tests", "proto", "shaders", "clients", "deploy"];
    let mut all: Vec<SourceFile> = folders.iter().flat_map(|f| files(f, &text)).collect();
    all.extend(files(".ci", &["run", "setup"]));
    for name in ["README.md", "Cargo.toml", "Makefile"] {
        let text = fs::read_to_string(root().join(name)).unwrap();
        all.push(SourceFile { path: name.into(), text });
    }
    let broken: Vec<String> = all.iter().flat_map(|file| broken(file, &LONGER)).collect();
    assert_none(&broken);
    for (path, _) in LONGER {
        assert!(all.iter().any(|file| file.path == path), "{path} is on the list but not there");
    }
}

#[test]
fn the_top_level_stays_as_it_is() {
    let ignored = fs::read_to_string(root().join(".gitignore")).unwrap();
    let strange = |name: &String| {
        let is_ignored = ignored.lines().any(|line| {
            line.trim_start_matches('/').trim_end_matches('/') == name
                || line.strip_prefix('*').is_some_and(|ending| name.ends_with(ending))
        });
        !is_ignored && !TOP.contains(&name.as_str())
    };
    let names =
        fs::read_dir(root()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let strange: Vec<String> =
        names.filter(strange).map(|n| format!("{n}: does not belong at the top level")).collect();
    assert_none(&strange);
}

#[test]
fn disorder_is_noticed() {
    let check = |path: &str, text: &str, longer: Listed| {
        broken(&SourceFile { path: path.into(), text: text.into() }, longer)
    };
    let long = "x\n".repeat(MAX_LINES + 1);
    assert_eq!(check("src/a.rs", "struct Commonplace; fn utilise() {}", &[]), [""; 0]);
    assert_eq!(check("src/a.rs", &long, &[("src/a.rs", "a table")]), [""; 0]);
    assert_eq!(check("src/a.rs", "// sleep", &[]), [""; 0]);
    let tested = format!("fn f() {{}}\n#[cfg(test)]\nmod tests {{\n{long}}}");
    assert_eq!(check("src/a.rs", &tested, &[]), [""; 0]);
    let left = format!("fn f() {{ {}) }}", LEFTOVERS[3]);
    let cases: [(&str, &str, Listed, &str); 8] = [
        ("src/a.rs", &long, &[], "401 lines are more than 400"),
        ("src/a.rs", "x", &[("src/a.rs", "a table")], "take it off the list"),
        ("src/utils.rs", "", &[], "src/utils.rs: the name says nothing"),
        ("src/map/common/mod.rs", "", &[], "the name says nothing"),
        ("src/a.rs", "struct MapManager;", &[], "the name MapManager"),
        ("src/a.rs", "\nfn test_helper() {}", &[], "src/a.rs:2: the name test_helper"),
        ("src/a.rs", &left, &[], "leaves work for later"),
        ("tests/a.rs", "std::thread::sleep(x)", &[], "never for time to pass"),
    ];
    for (path, text, longer, expected) in cases {
        let found = check(path, text, longer);
        assert!(found.len() == 1 && found[0].contains(expected), "{path}: {found:?}");
    }
}
