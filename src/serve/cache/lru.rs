//! What was used last, and is worth keeping for a while.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Values by their keys, of which those are forgotten that were not asked for in the longest time.
pub struct Kept<K, V> {
    most: usize,
    entries: Mutex<VecDeque<(K, Arc<V>)>>,
}

impl<K: PartialEq, V> Kept<K, V> {
    /// Room for so many.
    #[must_use]
    pub fn new(most: usize) -> Self {
        Self {
            most,
            entries: Mutex::default(),
        }
    }

    /// The value of a key.
    #[must_use]
    pub fn get(&self, key: &K) -> Option<Arc<V>> {
        let mut entries = lock(&self.entries);
        let at = entries.iter().position(|(known, _)| known == key)?;
        let found = entries.remove(at)?;
        let value = Arc::clone(&found.1);
        entries.push_front(found);
        Some(value)
    }

    /// Keeps a value.
    pub fn put(&self, key: K, value: &Arc<V>) {
        let mut entries = lock(&self.entries);
        entries.push_front((key, Arc::clone(value)));
        entries.truncate(self.most);
    }
}

/// What a thread that panicked has left is as good as before: everything is pushed or replaced in one step.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_asked_for_last_is_kept() {
        let kept: Kept<u8, u8> = Kept::new(2);
        kept.put(1, &Arc::new(10));
        kept.put(2, &Arc::new(20));
        assert_eq!(kept.get(&1).as_deref(), Some(&10));
        kept.put(3, &Arc::new(30));
        assert_eq!(
            [1, 2, 3].map(|key| kept.get(&key).as_deref().copied()),
            [Some(10), None, Some(30)]
        );
    }
}
