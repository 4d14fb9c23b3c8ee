//! What was embedded lately: the same prompts, negatives and class names come again and again.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How often the cache knew a text, and how often not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CacheCounts {
    pub hits: u64,
    pub misses: u64,
}

/// The embeddings of up to `capacity` texts; the one that was not asked for the longest goes first.
pub(super) struct Cache {
    capacity: usize,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    entries: HashMap<Arc<str>, Entry>,
    /// By the time of the last use, oldest first; as many as entries.
    uses: BTreeMap<u64, Arc<str>>,
    /// Counts questions; it orders uses.
    now: u64,
    counts: CacheCounts,
}

struct Entry {
    embedding: Arc<[f32]>,
    used: u64,
}

impl Cache {
    pub(super) fn new(capacity: usize) -> Self {
        Self { capacity, state: Mutex::default() }
    }

    pub(super) fn get(&self, text: &str) -> Option<Arc<[f32]>> {
        self.state().get(text)
    }

    /// Keeps `embedding`. Two threads that missed the same text store the same numbers.
    pub(super) fn put(&self, text: &str, embedding: Arc<[f32]>) {
        self.state().put(text, embedding, self.capacity);
    }

    pub(super) fn counts(&self) -> CacheCounts {
        self.state().counts
    }

    /// A panic elsewhere leaves at worst an entry without its use, which `put` replaces.
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn get(&mut self, text: &str) -> Option<Arc<[f32]>> {
        self.now += 1;
        let Some(entry) = self.entries.get_mut(text) else {
            self.counts.misses += 1;
            return None;
        };
        self.counts.hits += 1;
        if let Some(name) = self.uses.remove(&entry.used) {
            self.uses.insert(self.now, name);
        }
        entry.used = self.now;
        Some(entry.embedding.clone())
    }

    fn put(&mut self, text: &str, embedding: Arc<[f32]>, capacity: usize) {
        self.now += 1;
        let name: Arc<str> = text.into();
        let entry = Entry { embedding, used: self.now };
        if let Some(old) = self.entries.insert(name.clone(), entry) {
            self.uses.remove(&old.used);
        }
        self.uses.insert(self.now, name);
        while self.entries.len() > capacity {
            let Some((_, oldest)) = self.uses.pop_first() else { return };
            self.entries.remove(&oldest);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_that_was_not_asked_for_the_longest_goes_first() {
        let cache = Cache::new(2);
        let number = |text: &str| cache.get(text).map(|embedding| embedding[0]);
        cache.put("a", [1.0].into());
        cache.put("b", [2.0].into());
        assert_eq!(number("a"), Some(1.0));
        cache.put("c", [3.0].into());
        assert_eq!((number("a"), number("b"), number("c")), (Some(1.0), None, Some(3.0)));
        assert_eq!(cache.counts(), CacheCounts { hits: 3, misses: 1 });
    }

    #[test]
    fn a_text_takes_one_place_however_often_it_comes() {
        let cache = Cache::new(3);
        for round in 0..50 {
            cache.put("a", [round as f32].into());
            cache.put(&format!("{}", round % 2), [0.0].into());
        }
        let state = cache.state();
        assert_eq!((state.entries.len(), state.uses.len()), (3, 3));
        assert_eq!(state.entries["a"].embedding[0], 49.0);
    }
}
