//! Who may name whom: the table of rooms and floors, and the crates that stay in their room.

use std::collections::BTreeMap;

use super::source::{imports, tokens};
use super::{SourceFile, assert_none, files, root};

/// A room's floor, and its place on that floor from the left.
type Place = (u32, usize);

/// A crate that only some rooms may name, and why.
struct Confined {
    name: &'static str,
    allowed: fn(floor: u32, path: &str) -> bool,
    reason: &'static str,
}

const ASYNC: &str = "below floor 4 everything runs without a runtime or a transport";

const BUS: &str = "a transport among others: its messages are those of wire";

const CONFINED: [Confined; 12] = [
    Confined { name: "tokio", allowed: |floor, _| floor >= 4, reason: ASYNC },
    Confined { name: "tonic", allowed: |floor, _| floor >= 4, reason: ASYNC },
    Confined { name: "axum", allowed: |floor, _| floor >= 4, reason: ASYNC },
    Confined { name: "zenoh", allowed: |floor, _| floor == 7, reason: BUS },
    Confined { name: "zenoh_ext", allowed: |floor, _| floor == 7, reason: BUS },
    Confined {
        name: "prost",
        allowed: |floor, path| floor >= 6 || path.starts_with("src/storage/journal"),
        reason: "protobuf types are converted once, in wire; frames on disk are a family of their own",
    },
    Confined {
        name: "wgpu",
        allowed: |_, path| path.starts_with("src/backend/gpu"),
        reason: "a machine without a GPU must not need it",
    },
    Confined {
        name: "bincode",
        allowed: |_, path| path.starts_with("src/storage/"),
        reason: "the crate is ended: one room to change when it is replaced",
    },
    Confined {
        name: "rten",
        allowed: |_, path| path.starts_with("src/encoder/"),
        reason: "networks stand behind a feature, and one room knows what runs them",
    },
    Confined {
        name: "tokenizers",
        allowed: |_, path| path.starts_with("src/encoder/"),
        reason: "files that come with networks are read where the networks are",
    },
    Confined {
        name: "safetensors",
        allowed: |_, path| path.starts_with("src/encoder/"),
        reason: "files that come with networks are read where the networks are",
    },
    Confined {
        name: "anyhow",
        allowed: |floor, _| floor == 8,
        reason: "below the command line an error is one that a caller can match",
    },
];

/// A small octree for unit tests, which the crate's root brings in for them alone.
const TEST_TREE: &str = "test_tree";

/// The rooms of the table in `page`: rows `| floor | `src/a/`, `src/b.rs` | … |`.
fn table(page: &str) -> BTreeMap<String, Place> {
    let mut places = BTreeMap::new();
    for row in page.lines().filter(|line| line.starts_with('|')) {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let (Some(Ok(floor)), Some(rooms)) = (cells.get(1).map(|c| c.parse()), cells.get(2)) else {
            continue;
        };
        for (position, room) in rooms.split('`').filter(|part| part.starts_with("src/")).enumerate()
        {
            let name = room.trim_start_matches("src/").trim_end_matches('/');
            let name = name.trim_end_matches(".rs");
            assert!(places.insert(name.to_owned(), (floor, position)).is_none(), "{room} twice");
        }
    }
    places
}

/// What a file breaks.
fn broken(file: &SourceFile, places: &BTreeMap<String, Place>) -> Vec<String> {
    let path = file.path.trim_start_matches("src/").trim_end_matches(".rs");
    if path == "lib" {
        return Vec::new(); // lists the rooms and names nothing in them
    }
    let modules: Vec<&str> = path.split('/').filter(|part| *part != "mod").collect();
    let room = modules[0];
    let Some(&place) = places.get(room) else {
        return vec![format!("{}: the room '{room}' is not in the table", file.path)];
    };
    // main.rs is the root of its own crate.
    let depth = if path == "main" { 0 } else { modules.len() };
    let tokens = tokens(&file.text);
    let mut broken = Vec::new();
    for import in imports(&tokens, depth) {
        let at = format!("{}:{}", file.path, import.line);
        match places.get(import.name) {
            None if import.name == TEST_TREE => {}
            None => broken.push(format!("{at}: '{}' names no room", import.name)),
            Some(&other) if import.name != room && !below_or_left(other, place) => {
                broken.push(format!(
                    "{at}: {room} (floor {}) must not name {} (floor {})",
                    place.0, import.name, other.0
                ));
            }
            Some(_) => {}
        }
    }
    for token in &tokens {
        for rule in CONFINED.iter().filter(|rule| rule.name == token.text) {
            if !(rule.allowed)(place.0, &file.path) {
                broken.push(format!(
                    "{}:{}: must not name {}: {}",
                    file.path, token.line, rule.name, rule.reason
                ));
            }
        }
    }
    broken
}

fn below_or_left(other: Place, place: Place) -> bool {
    other.0 < place.0 || (other.0 == place.0 && other.1 < place.1)
}

fn page() -> String {
    std::fs::read_to_string(root().join("src/ARCHITECTURE.md")).unwrap()
}

#[test]
fn rooms_name_only_what_is_below_them_or_to_their_left() {
    let places = table(&page());
    let broken: Vec<String> =
        files("src", &[".rs"]).iter().flat_map(|file| broken(file, &places)).collect();
    assert_none(&broken);
}

#[test]
fn the_page_has_the_whole_table() {
    let places = table(&page());
    assert_eq!(places["error"], (0, 0));
    assert_eq!(places["map"], (3, 0));
    assert_eq!(places["engine"], (4, 2));
    assert_eq!(places["main"], (8, 1));
}

#[test]
fn a_room_out_of_order_is_noticed() {
    let page = "| floor | rooms |\n|---|---|\n\
        | 8 | `src/cli/`, `src/main.rs` | x |\n| 4 | `src/storage/`, `src/engine/` | x |\n\
        | 3 | `src/map/` | x |\n| 0 | `src/error.rs` | x |\n";
    let places = table(page);
    let check = |path: &str, text: &str| {
        broken(&SourceFile { path: path.into(), text: text.into() }, &places)
    };
    assert_eq!(check("src/map/view.rs", "use crate::error::Error; use crate::map::x;"), [""; 0]);
    assert_eq!(check("src/engine/mod.rs", "use crate::storage::save;"), [""; 0]);
    assert_eq!(check("src/main.rs", "fn main() { orenx::cli::run() }"), [""; 0]);
    let cases = [
        ("src/map/view.rs", "use crate::engine::Handle;", "must not name engine (floor 4)"),
        ("src/map/view.rs", "use super::super::engine;", "must not name engine (floor 4)"),
        ("src/map/mod.rs", "use super::{error, storage};", "must not name storage (floor 4)"),
        ("src/storage/mod.rs", "\n use crate::engine::Handle;", "src/storage/mod.rs:2:"),
        ("src/error.rs", "use super::map;", "must not name map (floor 3)"),
        ("src/map/view.rs", "use crate::Error;", "'Error' names no room"),
        ("src/map/view.rs", "use crate as house;", "'crate' names no room"),
        ("src/attic/mod.rs", "", "the room 'attic' is not in the table"),
        ("src/map/view.rs", "use tokio::sync::watch;", "must not name tokio"),
        ("src/map/view.rs", "fn f() -> anyhow::Result<()>", "must not name anyhow"),
        ("src/engine/mod.rs", "use bincode::config;", "must not name bincode"),
        ("src/engine/mod.rs", "use wgpu::Device;", "must not name wgpu"),
    ];
    for (path, text, expected) in cases {
        let found = check(path, text);
        assert!(found.len() == 1 && found[0].contains(expected), "{text}: {found:?}");
    }
}
