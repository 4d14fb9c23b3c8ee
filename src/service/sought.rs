//! What a question looks for: words, or the numbers that an encoder made of them.

use std::sync::Arc;

use tokio::sync::Semaphore;

use crate::config::MODALITIES;
use crate::encoder::TextEncoder;
use crate::error::{Error, Result};
use crate::frame::Contract;
use crate::map::{MapView, Scorer};
use crate::modality::language::NEGATIVES;

/// Prompts of a question, and negatives, at most.
pub const MAX_PROMPTS: usize = 64;
/// Questions whose words are embedded at a time: a network takes milliseconds a text.
const EMBEDDING: usize = 2;

/// What places are compared with. Of several prompts the best counts.
#[derive(Debug, Clone, PartialEq)]
pub enum Sought {
    /// Embedded by the server. Without negatives of their own, LERF's take their place; an empty list
    /// asks for plain cosines.
    Words { prompts: Vec<String>, negatives: Option<Vec<String>> },
    /// By an encoder that the caller has. No negatives: plain cosines.
    Embeddings { encoder_id: String, prompts: Vec<Vec<f32>>, negatives: Vec<Vec<f32>> },
}

impl Sought {
    /// Words against LERF's negatives.
    pub fn words(prompts: &[&str]) -> Self {
        let prompts = prompts.iter().map(|prompt| (*prompt).to_owned()).collect();
        Self::Words { prompts, negatives: None }
    }

    /// Whether places get relevancies, within 0..=1, and no cosines.
    pub fn is_relevancy(&self) -> bool {
        match self {
            Self::Words { negatives, .. } => negatives.as_ref().is_none_or(|n| !n.is_empty()),
            Self::Embeddings { negatives, .. } => !negatives.is_empty(),
        }
    }

    /// The same for who compares prompts with each other alone.
    pub(super) fn without_negatives(self) -> Self {
        match self {
            Self::Words { prompts, .. } => Self::Words { prompts, negatives: Some(Vec::new()) },
            Self::Embeddings { encoder_id, prompts, .. } => {
                Self::Embeddings { encoder_id, prompts, negatives: Vec::new() }
            }
        }
    }

    /// Refuses too many; `names` are what errors call prompts and negatives.
    fn check(&self, names: &Names, max_prompts: usize) -> Result<()> {
        let (prompts, negatives) = match self {
            Self::Words { prompts, negatives } => {
                (prompts.len(), negatives.as_ref().map_or(0, Vec::len))
            }
            Self::Embeddings { prompts, negatives, .. } => (prompts.len(), negatives.len()),
        };
        if prompts == 0 {
            return Err(Error::invalid(&names.prompts, "at least one is needed"));
        }
        for (name, count, limit) in
            [(&names.prompts, prompts, max_prompts), (&names.negatives, negatives, MAX_PROMPTS)]
        {
            if count > limit {
                return Err(Error::invalid(name, format!("are {count}; the limit is {limit}")));
            }
        }
        Ok(())
    }
}

/// What errors call the parts of a question.
pub(super) struct Names {
    pub(super) prompts: String,
    pub(super) negatives: String,
    pub(super) encoder_id: String,
}

impl Names {
    /// `of` goes before each, as in `text.`.
    pub(super) fn of(of: &str) -> Self {
        Self {
            prompts: format!("{of}prompts"),
            negatives: format!("{of}negatives"),
            encoder_id: format!("{of}encoder_id"),
        }
    }

    /// Where the prompts are classes.
    pub(super) fn of_classes() -> Self {
        Self { prompts: "classes".into(), ..Self::of("") }
    }

    /// The error of a scorer in the words of the question.
    fn rename(&self, error: Error) -> Error {
        let Error::InvalidArgument { field, problem } = error else { return error };
        let place = |name: &str| field.strip_prefix(name).map(str::to_owned);
        let field = place("prompts")
            .map(|place| format!("{}{place}", self.prompts))
            .or_else(|| place("negatives").map(|place| format!("{}{place}", self.negatives)))
            .unwrap_or(field);
        Error::InvalidArgument { field, problem }
    }
}

/// What embeds the words of questions, if anything does.
pub(super) struct Words {
    pub(super) encoder: Option<Arc<TextEncoder>>,
    places: Arc<Semaphore>,
}

impl Words {
    pub(super) fn new(encoder: Option<TextEncoder>) -> Self {
        let places = Arc::new(Semaphore::new(EMBEDDING));
        Self { encoder: encoder.map(Arc::new), places }
    }

    /// What is sought, as the codes of a view are asked for it.
    pub(super) async fn scorer(
        &self,
        view: &MapView,
        sought: Sought,
        names: Names,
        max_prompts: usize,
    ) -> Result<Scorer> {
        sought.check(&names, max_prompts)?;
        let contract = contract(view)?;
        let (prompts, negatives) = match sought {
            Sought::Words { prompts, negatives } => {
                self.embed(contract, &names, prompts, negatives).await?
            }
            Sought::Embeddings { encoder_id, prompts, negatives } => {
                let dimension = contract.dimension;
                let theirs = Contract { encoder_id: encoder_id.into(), dimension };
                demand(contract, &theirs, &names.encoder_id)?;
                (prompts, negatives)
            }
        };
        view.scorer(&prompts, &negatives).map_err(|error| names.rename(error))
    }

    /// The same for the text of a question about points or for an image, if it has one.
    pub(super) async fn text(
        &self,
        view: &MapView,
        text: Option<Sought>,
    ) -> Result<Option<Scorer>> {
        match text {
            Some(text) => self.scorer(view, text, Names::of("text."), MAX_PROMPTS).await.map(Some),
            None => Ok(None),
        }
    }

    async fn embed(
        &self,
        contract: &Contract,
        names: &Names,
        prompts: Vec<String>,
        negatives: Option<Vec<String>>,
    ) -> Result<(Vec<Vec<f32>>, Vec<Vec<f32>>)> {
        let Some(encoder) = self.encoder.clone() else {
            return Err(Error::FailedPrecondition(format!(
                "{}: the server has no text encoder (encoder.kind); send embeddings of '{}'",
                names.prompts, contract.encoder_id
            )));
        };
        demand(contract, encoder.contract(), &names.prompts)?;
        let negatives = negatives.unwrap_or_else(|| NEGATIVES.map(str::to_owned).to_vec());
        let failed = |_| Error::Internal("embedding these words failed".into());
        let place = self.places.clone().acquire_owned().await;
        let place = place.map_err(|e| Error::Internal(e.to_string()))?;
        let fields = [names.prompts.clone(), names.negatives.clone()];
        let embedding = tokio::task::spawn_blocking(move || {
            // Kept until it is done, even if nobody waits for it.
            let _place = place;
            let embed = |field: &str, texts: &[String]| {
                let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
                encoder.embed_field(field, &texts)
            };
            Ok((embed(&fields[0], &prompts)?, embed(&fields[1], &negatives)?))
        });
        embedding.await.map_err(failed)?
    }
}

/// The encoder that a view's codes come from.
pub(super) fn contract(view: &MapView) -> Result<&Contract> {
    view.contract().ok_or_else(|| {
        let language = MODALITIES[3];
        Error::FailedPrecondition(if view.config().has(language) {
            "the map has no language yet: no frame with features or labels has come".into()
        } else {
            format!("the map keeps no {language} (map.modalities)")
        })
    })
}

/// Refuses what comes from another encoder than the map's features, with both names.
fn demand(ours: &Contract, theirs: &Contract, field: &str) -> Result<()> {
    match ours.mismatch(theirs) {
        Some(problem) => Err(Error::FailedPrecondition(format!("{field}: {problem}"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relevancies_need_negatives_and_words_have_some_by_themselves() {
        let words = |negatives: Option<&[&str]>| Sought::Words {
            prompts: vec!["chair".into()],
            negatives: negatives.map(|all| all.iter().map(|n| (*n).to_owned()).collect()),
        };
        assert!(words(None).is_relevancy() && words(Some(&["wall"])).is_relevancy());
        assert!(!words(Some(&[])).is_relevancy());
        let negatives = vec![vec![1.0]];
        let embeddings = |negatives| Sought::Embeddings {
            encoder_id: "clip".into(),
            prompts: vec![vec![1.0]],
            negatives,
        };
        assert!(embeddings(negatives).is_relevancy() && !embeddings(Vec::new()).is_relevancy());
    }

    #[test]
    fn too_many_are_refused_by_name_and_limit() {
        let check = |prompts: usize, negatives: usize| {
            let words = |count| vec!["chair".to_owned(); count];
            let negatives = Some(words(negatives));
            let sought = Sought::Words { prompts: words(prompts), negatives };
            sought.check(&Names::of("text."), MAX_PROMPTS)
        };
        check(64, 64).expect("as many as there may be");
        for (counts, field, words) in [
            ((0, 0), "text.prompts", "at least one"),
            ((65, 0), "text.prompts", "are 65; the limit is 64"),
            ((1, 65), "text.negatives", "are 65; the limit is 64"),
        ] {
            let error = check(counts.0, counts.1).expect_err(words);
            assert_eq!(error.field(), Some(field));
            assert!(error.to_string().contains(words), "{error}");
        }
        let renamed = Names::of_classes().rename(Error::invalid("prompts[3]", "is nothing"));
        assert_eq!(renamed.to_string(), "classes[3]: is nothing");
    }
}
