//! Names for what is kept on disk.

/// A stable hash (FNV-1a): it is written to disk.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hash(pub u64);

impl Hash {
    /// Of some value's text.
    pub(crate) fn of(value: &impl ToString) -> Self {
        Self::of_bytes(value.to_string().as_bytes())
    }

    /// Of bytes.
    pub(crate) fn of_bytes(bytes: &[u8]) -> Self {
        Self(0xcbf2_9ce4_8422_2325).with(bytes)
    }

    fn with(self, bytes: &[u8]) -> Self {
        Self(bytes.iter().fold(self.0, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
        }))
    }

    /// Of this and more bytes, eight at a time, for what is large.
    pub(crate) fn with_words(self, bytes: &[u8]) -> Self {
        let (words, rest) = bytes.as_chunks::<8>();
        let hash = words.iter().fold(self.0, |hash, word| {
            (hash ^ u64::from_le_bytes(*word))
                .wrapping_mul(0x0100_0000_01b3)
                .rotate_left(23)
        });
        Self(hash).with(rest)
    }

    /// Of this and one more value.
    pub(crate) fn and(self, value: &impl ToString) -> Self {
        self.with(b"/").with(value.to_string().as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_fnv() {
        // From the published test vectors.
        assert_eq!(Hash::of_bytes(b"").0, 0xcbf2_9ce4_8422_2325);
        assert_eq!(Hash::of_bytes(b"foobar").0, 0x8594_4171_f739_67e8);
        assert_eq!(Hash::of(&"a").and(&1).0, Hash::of_bytes(b"a/1").0);
    }
}
