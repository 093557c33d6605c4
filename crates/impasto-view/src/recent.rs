//! Memory of what was used last.

use std::borrow::Borrow;
use std::collections::VecDeque;

/// The values that were used last.
pub(crate) struct Recent<K, V> {
    most: usize,
    all: VecDeque<(K, V)>,
}

impl<K: PartialEq, V: Clone> Recent<K, V> {
    pub(crate) fn new(most: usize) -> Self {
        Self {
            most,
            all: VecDeque::new(),
        }
    }

    pub(crate) fn get<Q: PartialEq + ?Sized>(&mut self, key: &Q) -> Option<V>
    where
        K: Borrow<Q>,
    {
        let index = self
            .all
            .iter()
            .position(|(known, _)| known.borrow() == key)?;
        let found = self.all.remove(index)?;
        let value = found.1.clone();
        self.all.push_back(found);
        Some(value)
    }

    pub(crate) fn keep(&mut self, key: K, value: V) {
        if self.all.len() >= self.most {
            self.all.pop_front();
        }
        self.all.push_back((key, value));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_used_last_is_kept() {
        let mut kept = Recent::new(2);
        kept.keep("a", 1);
        kept.keep("b", 2);
        assert_eq!(kept.get("a"), Some(1));
        kept.keep("c", 3);
        assert_eq!(kept.get("b"), None);
        assert_eq!((kept.get("a"), kept.get("c")), (Some(1), Some(3)));
    }
}
