//! Which key is whose.

use std::fmt;

use ring::digest::{SHA256, SHA256_OUTPUT_LEN, digest};
use subtle::{Choice, ConditionallySelectable, ConstantTimeEq};

use crate::config::KeyConfig;
use crate::error::Result;

/// The digests of all keys, in the order of the settings. The keys themselves are not kept.
#[derive(Clone, PartialEq, Eq)]
pub(super) struct KeyRing(Vec<[u8; SHA256_OUTPUT_LEN]>);

/// Not even digests are shown.
impl fmt::Debug for KeyRing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "KeyRing({} keys)", self.0.len())
    }
}

impl KeyRing {
    pub(super) fn none() -> Self {
        Self(Vec::new())
    }

    /// Reads every key from where it is kept.
    pub(super) fn read(keys: &[KeyConfig]) -> Result<Self> {
        let digests = keys.iter().map(|key| Ok(digest_of(key.read()?.reveal().as_bytes())));
        Ok(Self(digests.collect::<Result<_>>()?))
    }

    /// The place of a key. How long this takes says nothing of how close a wrong key came: digests are
    /// compared, whole ones, and all of them.
    pub(super) fn find(&self, key: &[u8]) -> Option<usize> {
        let asked = digest_of(key);
        let (mut found, mut place) = (Choice::from(0), 0u64);
        for (at, known) in self.0.iter().enumerate() {
            let same = asked.as_slice().ct_eq(known.as_slice());
            place = u64::conditional_select(&place, &(at as u64), same);
            found |= same;
        }
        bool::from(found).then_some(place as usize)
    }
}

fn digest_of(key: &[u8]) -> [u8; SHA256_OUTPUT_LEN] {
    let mut bytes = [0; SHA256_OUTPUT_LEN];
    bytes.copy_from_slice(digest(&SHA256, key).as_ref());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{KeySource, Role, Secret};

    #[test]
    fn a_key_is_found_whole_or_not_at_all() {
        let key = |name: &str, text: &str| KeyConfig {
            name: name.into(),
            role: Role::Read,
            source: KeySource::Given(Secret::new(text)),
        };
        let (first, second) = ("first-0123456789abcdef", "second-0123456789abcdef");
        let ring = KeyRing::read(&[key("a", first), key("b", second)]).expect("good keys");
        assert_eq!(ring.find(first.as_bytes()), Some(0));
        assert_eq!(ring.find(second.as_bytes()), Some(1));
        let longer = format!("{first}0");
        for wrong in ["", "x", &first[1..], &longer, &first.to_uppercase()] {
            assert_eq!(ring.find(wrong.as_bytes()), None, "{wrong}");
        }
        assert_eq!(format!("{ring:?}"), "KeyRing(2 keys)");
    }

    #[test]
    fn a_file_holds_a_key_and_perhaps_the_end_of_its_line() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("key");
        let key = |source| KeyConfig { name: "a".into(), role: Role::Read, source };
        let read = || KeyRing::read(&[key(KeySource::File(path.clone()))]);
        let missing = read().expect_err("no file").to_string();
        assert!(missing.starts_with("auth.keys 'a'.key_file: "), "{missing}");
        std::fs::write(&path, "0123456789abcdef\n").expect("written");
        assert_eq!(read().expect("a key").find(b"0123456789abcdef"), Some(0));
        std::fs::write(&path, "two words of a key\n").expect("written");
        let error = read().expect_err("no key").to_string();
        assert!(error.starts_with("auth.keys 'a': ") && !error.contains("two"), "{error}");
        let unset = KeySource::Variable("NO_SUCH_VARIABLE_OF_ANYBODY".into());
        let error = KeyRing::read(&[key(unset)]).expect_err("unset").to_string();
        assert!(error.contains("NO_SUCH_VARIABLE_OF_ANYBODY"), "{error}");
    }
}
