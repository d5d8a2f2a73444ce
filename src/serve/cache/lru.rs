//! A cache of the most recently used values.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use deaflow_base::is_interrupted;

/// Values by key; the least recently used ones are dropped.
pub struct LruCache<K, V> {
    capacity: usize,
    entries: Mutex<VecDeque<(K, Arc<V>)>>,
}

impl<K: PartialEq + Clone, V> LruCache<K, V> {
    /// Creates a cache for `capacity` values.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self {
            capacity,
            entries: Mutex::default(),
        }
    }

    /// Returns the value of a key.
    #[must_use]
    pub fn get(&self, key: &K) -> Option<Arc<V>> {
        let mut entries = lock(&self.entries);
        let at = entries.iter().position(|(known, _)| known == key)?;
        let found = entries.remove(at)?;
        let value = Arc::clone(&found.1);
        entries.push_front(found);
        Some(value)
    }

    /// Returns the value of a key, which is computed if it is not in the cache. The result of an interrupted computation
    /// is not kept.
    ///
    /// # Errors
    /// If the computation fails.
    pub fn get_or_insert<E>(&self, key: &K, compute: impl FnOnce() -> Result<V, E>) -> Result<Arc<V>, E> {
        if let Some(known) = self.get(key) {
            return Ok(known);
        }
        let value = Arc::new(compute()?);
        if !is_interrupted() {
            self.put(key.clone(), &value);
        }
        Ok(value)
    }

    /// Adds a value.
    pub fn put(&self, key: K, value: &Arc<V>) {
        let mut entries = lock(&self.entries);
        entries.push_front((key, Arc::clone(value)));
        entries.truncate(self.capacity);
    }
}

/// Locks a mutex. A poisoned one is used as well: its value is replaced in one step, never half-changed.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_value_is_dropped() {
        let kept: LruCache<u8, u8> = LruCache::new(2);
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
