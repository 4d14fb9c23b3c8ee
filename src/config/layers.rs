//! Where settings come from, each layer over the one before: the defaults, the file, the
//! environment, the flags.
//!
//! One rule for every key: `key` of `[section]` is the variable `ORENX_SECTION_KEY` and the flag
//! `--set section.key=value`.

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::path::Path;

use toml::{Table, Value};

use super::MapSettings;
use super::server::{DEFAULT_FILE, Settings};
use crate::error::{Error, Result};

/// How the names of our variables begin.
const PREFIX: &str = "ORENX_";
/// Variables of ours that are no settings: what is logged, a client's key and whom it trusts, and where
/// tests find data, text encoders and tools.
const OTHERS: [&str; 10] = [
    "ORENX_LOG",
    "ORENX_API_KEY",
    "ORENX_API_KEY_FILE",
    "ORENX_CA",
    "ORENX_CLIENT_CERT",
    "ORENX_CLIENT_KEY",
    "ORENX_TEST_BROWSER",
    "ORENX_TEST_DATA",
    "ORENX_TEST_ENCODERS",
    "ORENX_TEST_TOOLS",
];
/// The section that may hold keys.
const SECRETS: &str = "auth";

impl Settings {
    /// The settings of a process: those of `file` over the defaults, `variables` over them (the whole
    /// environment; what does not begin with `ORENX_` is not ours), and `flags`, each
    /// `section.key=value`, over all.
    pub fn layered(
        file: Option<&Path>,
        variables: impl IntoIterator<Item = (OsString, OsString)>,
        flags: &[String],
    ) -> Result<Self> {
        let mut layers = Layers::defaults()?;
        if let Some(path) = file {
            let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
            layers.put_file(&text, &path.display().to_string())?;
        }
        let mut ours: Vec<(OsString, OsString)> = variables
            .into_iter()
            .filter(|(name, _)| name.as_encoded_bytes().starts_with(PREFIX.as_bytes()))
            .collect();
        ours.sort(); // so that of two errors it is always the same one that is told
        for (name, value) in &ours {
            layers.put_variable(&name.to_string_lossy(), value)?;
        }
        for flag in flags {
            layers.put_flag(flag)?;
        }
        layers.settings("settings")
    }

    /// The settings of a file's text over the defaults; `name` names it in errors.
    pub fn parse(text: &str, name: &str) -> Result<Self> {
        let mut layers = Layers::defaults()?;
        layers.put_file(text, name)?;
        layers.settings(name)
    }
}

impl Settings {
    /// As a settings file of them would be. Keys are not shown.
    pub fn shown(&self) -> Result<String> {
        toml::to_string(self).map_err(|e| Error::Internal(format!("settings: {e}")))
    }
}

impl MapSettings {
    /// These settings with some changed, by their names in `[map]`, each as it would be written in a flag.
    pub fn with(&self, changes: &BTreeMap<String, String>) -> Result<Self> {
        let mut table = Table::try_from(self)
            .map_err(|e| Error::Internal(format!("settings of a map: {e}")))?;
        for (key, text) in changes {
            let value = typed(table.get(key), text);
            table.insert(key.clone(), value);
            let source = format!("settings.{key}");
            table.clone().try_into::<Self>().map_err(|e| wrong(&source, &e))?;
        }
        table.try_into().map_err(|e| wrong("settings", &e))
    }
}

/// Tables that begin as [`DEFAULT_FILE`], so that a section keeps its defaults even where they
/// differ from those of its type.
struct Layers(Table);

impl Layers {
    fn defaults() -> Result<Self> {
        let table = toml::from_str(DEFAULT_FILE).map_err(|e| wrong("deploy/orenx.toml", &e))?;
        Ok(Self(table))
    }

    fn settings(&self, source: &str) -> Result<Settings> {
        self.0.clone().try_into().map_err(|e| wrong(source, &e))
    }

    /// Reads the text alone first, so that a wrong key or value is shown with its line.
    fn put_file(&mut self, text: &str, name: &str) -> Result<()> {
        toml::from_str::<Settings>(text).map_err(|e| wrong_in(text, name, &e))?;
        for (section, keys) in
            toml::from_str::<Table>(text).map_err(|e| wrong_in(text, name, &e))?
        {
            match (self.0.get_mut(&section), keys) {
                (Some(Value::Table(below)), Value::Table(keys)) => below.extend(keys),
                (_, keys) => {
                    self.0.insert(section, keys);
                }
            }
        }
        Ok(())
    }

    fn put_variable(&mut self, name: &str, value: &OsStr) -> Result<()> {
        if OTHERS.contains(&name) {
            return Ok(());
        }
        let key = name.trim_start_matches(PREFIX).to_lowercase();
        let Some((section, key)) = key.split_once('_') else {
            return Err(self.unknown_section(name));
        };
        let value = value.to_str().ok_or_else(|| Error::invalid(name, "is no UTF-8"))?;
        self.put(name, section, key, value)
    }

    fn put_flag(&mut self, flag: &str) -> Result<()> {
        let (name, value) = flag.split_once('=').unwrap_or((flag, ""));
        match name.split_once('.') {
            Some((section, key)) if flag.contains('=') => {
                self.put(&format!("--set {name}"), section, key, value)
            }
            _ => Err(Error::invalid("--set", format!("'{flag}' is not section.key=value"))),
        }
    }

    /// Puts one value in its place; `source` names it in errors.
    fn put(&mut self, source: &str, section: &str, key: &str, text: &str) -> Result<()> {
        let Some(Value::Table(keys)) = self.0.get_mut(section) else {
            return Err(self.unknown_section(source));
        };
        let value = typed(keys.get(key), text);
        keys.insert(key.to_owned(), value);
        self.settings(source).map(drop)
    }

    fn unknown_section(&self, source: &str) -> Error {
        let sections: Vec<&str> = self.0.keys().map(String::as_str).collect();
        Error::invalid(
            source,
            format!("is no setting: its section is none of {}", sections.join(", ")),
        )
    }
}

/// A value of the kind that is there already: words stay as they are, lists are separated by commas,
/// and anything else is a number if it reads like one.
fn typed(below: Option<&Value>, text: &str) -> Value {
    match below {
        Some(Value::String(_)) => Value::String(text.to_owned()),
        Some(Value::Array(_)) => {
            let words = text.split(',').map(str::trim).filter(|word| !word.is_empty());
            Value::Array(words.map(|word| Value::String(word.to_owned())).collect())
        }
        _ => text
            .parse()
            .map(Value::Integer)
            .or_else(|_| text.parse().map(Value::Float))
            .or_else(|_| text.parse().map(Value::Boolean))
            .unwrap_or_else(|_| Value::String(text.to_owned())),
    }
}

/// What is wrong in a file, with its line, which is not shown where it may hold a key.
fn wrong_in(text: &str, source: &str, error: &toml::de::Error) -> Error {
    let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    // The section of that line, itself included.
    let is_header = |line: &&str| line.trim_start().starts_with('[');
    let header = text.lines().take(line).filter(is_header).last().unwrap_or_default();
    match header.trim_start_matches([' ', '\t', '[']).starts_with(SECRETS) {
        true => Error::invalid(source, format!("line {line}: {}", error.message().trim_end())),
        false => wrong(source, error),
    }
}

fn wrong(source: &str, error: &toml::de::Error) -> Error {
    Error::invalid(source, error.to_string().trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Profile, Schedule, ServerConfig};

    fn layered(file: &str, variables: &[(&str, &str)], flags: &[&str]) -> Result<Settings> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("my.toml");
        std::fs::write(&path, file).expect("written");
        let variables = variables.iter().map(|(name, value)| (name.into(), value.into()));
        let flags: Vec<String> = flags.iter().map(|flag| (*flag).to_owned()).collect();
        Settings::layered(Some(&path), variables, &flags)
    }

    #[test]
    fn each_layer_goes_over_the_one_before() {
        let file = "[server]\nlanes = 1\nlane_frames = 11\nqueued_mib = 101\n";
        let variables = [("ORENX_SERVER_LANE_FRAMES", "12"), ("ORENX_SERVER_QUEUED_MIB", "102")];
        let settings = layered(file, &variables, &["server.queued_mib=103"]).expect("fine");
        let server = &settings.server;
        assert_eq!((server.lanes, server.lane_frames, server.queued_mib), (1, 12, 103));
        assert_eq!(server.max_points, Settings::default().server.max_points);
    }

    #[test]
    fn every_kind_of_value_comes_from_the_environment() {
        let variables = [
            ("ORENX_SERVER_GRPC", "0.0.0.0:1234"),
            ("ORENX_SERVER_INSECURE_PUBLIC", "true"),
            ("ORENX_SERVER_MAX_FRAME_AGE_S", "3"),
            ("ORENX_STORAGE_PATH", "2024"),
            ("ORENX_MAP_R0_M", "0.05"),
            ("ORENX_MAP_STEPS", "4"),
            ("ORENX_MAP_PROFILE", "full"),
            ("ORENX_MAP_MODALITIES", "sdf, occupancy"),
            ("ORENX_LOG", "info"),
            ("ORENX_API_KEY", "a client's"),
            ("ORENX_TEST_BROWSER", "/chromium"),
            ("ORENX_TEST_DATA", "/data"),
            ("ORENX_TEST_ENCODERS", "/encoders"),
            ("ORENX_TEST_TOOLS", "/bin"),
            ("PATH", "/bin"),
        ];
        let settings = layered("", &variables, &[]).expect("fine");
        assert_eq!(settings.server.grpc, "0.0.0.0:1234");
        assert_eq!(settings.server.max_frame_age_s, 3.0);
        assert_eq!(settings.storage.path, Path::new("2024"), "a word, though it looks like none");
        assert_eq!((settings.map.r0_m, settings.map.steps), (0.05, Some(4)));
        assert_eq!(settings.map.profile, Profile::Full);
        assert_eq!(settings.map.modalities, ["sdf", "occupancy"]);
        assert_eq!(settings.map.schedule, Schedule::Adaptive, "as for every server");
        ServerConfig::from_settings(&settings).expect("and they pass their checks");
    }

    #[test]
    fn a_map_is_made_with_settings_of_its_own() {
        let changes = |changes: &[(&str, &str)]| {
            changes.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect()
        };
        let usual = Settings::default().map;
        let fine =
            changes(&[("profile", "full"), ("r0_m", "0.05"), ("modalities", "sdf,occupancy")]);
        let made = usual.with(&fine).expect("known");
        assert_eq!((made.profile, made.r0_m), (Profile::Full, 0.05));
        assert_eq!(made.modalities, ["sdf", "occupancy"]);
        assert_eq!(
            MapSettings { profile: usual.profile, r0_m: 0.1, ..made }.schedule,
            usual.schedule
        );
        assert_eq!(usual.with(&changes(&[])).expect("nothing changed"), usual);
        for (key, value) in [("size", "3"), ("profile", "huge"), ("seed", "-1"), ("r0_m", "wide")] {
            let error = usual.with(&changes(&[(key, value)])).expect_err(key).to_string();
            assert!(error.starts_with(&format!("settings.{key}: ")), "{error}");
        }
    }

    #[test]
    fn settings_are_shown_as_they_are_written_and_without_keys() {
        let file = "[[auth.keys]]\nname = \"a\"\nrole = \"read\"\nkey = \"0123456789abcdef\"\n\
                    [server]\nlanes = 7\n";
        let settings = layered(file, &[], &["map.steps=3"]).expect("fine");
        let shown = settings.shown().expect("text");
        assert!(!shown.contains("0123456789abcdef") && shown.contains("(hidden)"), "{shown}");
        let mut back = Settings::parse(&shown, "shown").expect("a settings file");
        assert_eq!((back.server.lanes, back.map.steps), (7, Some(3)));
        back.auth = settings.auth.clone();
        assert_eq!(back, settings);
    }

    /// Every key of the default file can be written as a variable and as a flag, and back.
    #[test]
    fn one_rule_fits_every_key() {
        let table: Table = toml::from_str(DEFAULT_FILE).expect("it parses");
        let (mut variables, mut flags) = (Vec::new(), Vec::new());
        for (section, keys) in &table {
            for (key, value) in keys.as_table().expect("sections alone") {
                let text = match value {
                    Value::String(text) => text.clone(),
                    Value::Array(words) if words.is_empty() => String::new(),
                    number => number.to_string(),
                };
                let variable = format!("ORENX_{}_{}", section.to_uppercase(), key.to_uppercase());
                variables.push((OsString::from(variable), OsString::from(&text)));
                flags.push(format!("{section}.{key}={text}"));
            }
        }
        assert!(variables.len() > 15);
        let settings = Settings::layered(None, variables, &flags).expect("all are known");
        assert_eq!(settings, Settings::default());
    }

    #[test]
    fn what_is_no_setting_is_named() {
        type Case =
            (&'static [(&'static str, &'static str)], &'static [&'static str], [&'static str; 2]);
        let cases: [Case; 8] = [
            (&[("ORENX_SERVER_LANE", "3")], &[], ["ORENX_SERVER_LANE:", "unknown field `lane`"]),
            (&[("ORENX_SERVERS_LANES", "3")], &[], ["ORENX_SERVERS_LANES:", "server"]),
            (
                &[("ORENX_GRPC", "3")],
                &[],
                ["ORENX_GRPC:", "map, ros2, server, storage, tls, zenoh"],
            ),
            (&[("ORENX_SERVER_LANES", "many")], &[], ["ORENX_SERVER_LANES:", "many"]),
            (&[("ORENX_MAP_PROFILE", "huge")], &[], ["ORENX_MAP_PROFILE:", "huge"]),
            (&[], &["server.lane=3"], ["--set server.lane:", "unknown field `lane`"]),
            (&[], &["lanes=3"], ["--set:", "section.key=value"]),
            (&[], &["server.lanes"], ["--set:", "'server.lanes'"]),
        ];
        for (variables, flags, parts) in cases {
            let error = layered("", variables, flags).expect_err(parts[0]).to_string();
            assert!(error.starts_with(parts[0]) && error.contains(parts[1]), "{error}");
        }
        let missing = Settings::layered(Some(Path::new("no.toml")), [], &[]);
        assert!(missing.expect_err("no file").to_string().starts_with("no.toml"));
    }
}
