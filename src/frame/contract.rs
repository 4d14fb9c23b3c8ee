//! Which encoder numbers come from, so that only those of one encoder are compared.

use std::sync::Arc;

use crate::error::{Error, Result};

/// The longest name of an encoder, bytes.
const MAX_ID_BYTES: usize = 256;
/// Numbers of a feature or an embedding at most.
pub const MAX_DIMENSION: usize = 4096;

/// What features of frames, embeddings of texts and a map must have in common to be compared. All of
/// them count by their direction alone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Contract {
    /// Names the encoder and its version.
    pub encoder_id: Arc<str>,
    /// Numbers of a feature.
    pub dimension: usize,
}

impl Contract {
    /// Checks the name and the dimension; `of` is what errors call them a part of.
    pub fn check(&self, of: &str) -> Result<()> {
        let id = &self.encoder_id;
        if id.trim().is_empty() || id.len() > MAX_ID_BYTES || id.contains(char::is_control) {
            let problem = format!("must be 1 to {MAX_ID_BYTES} bytes of plain text");
            return Err(Error::invalid(format!("{of}.encoder_id"), problem));
        }
        if !(1..=MAX_DIMENSION).contains(&self.dimension) {
            let problem = format!("{} must lie within 1..={MAX_DIMENSION}", self.dimension);
            return Err(Error::invalid(format!("{of}.dimension"), problem));
        }
        Ok(())
    }

    /// What keeps something of another encoder from being compared with what has this one.
    pub fn mismatch(&self, other: &Self) -> Option<String> {
        (self != other).then(|| {
            format!(
                "{} numbers of the encoder '{}', but the map has {} of '{}'",
                other.dimension, other.encoder_id, self.dimension, self.encoder_id
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contract_is_a_name_and_a_dimension() {
        let clip = Contract { encoder_id: "clip".into(), dimension: 512 };
        assert!(clip.check("features").is_ok());
        assert_eq!(clip.mismatch(&clip.clone()), None);
        let other = Contract { encoder_id: "siglip".into(), ..clip.clone() };
        let problem = clip.mismatch(&other).expect("another encoder");
        assert!(problem.contains("'clip'") && problem.contains("'siglip'"), "{problem}");
        let longer = Contract { dimension: 768, ..clip.clone() };
        assert!(clip.mismatch(&longer).is_some_and(|p| p.contains("768") && p.contains("512")));
        let named = |encoder_id: &str| Contract { encoder_id: encoder_id.into(), ..clip.clone() };
        for (wrong, field) in [
            (named(" "), "features.encoder_id"),
            (named("a\nb"), "features.encoder_id"),
            (named(&"a".repeat(257)), "features.encoder_id"),
            (Contract { dimension: 0, ..clip.clone() }, "features.dimension"),
            (Contract { dimension: 4097, ..clip.clone() }, "features.dimension"),
        ] {
            assert_eq!(wrong.check("features").expect_err(field).field(), Some(field));
        }
    }
}
