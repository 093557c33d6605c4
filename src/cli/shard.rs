//! `--shard I/N`.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// One of several processes that share the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    index: usize,
    count: usize,
}

impl Shard {
    /// All of the work.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Whether the shard does the item of this number, where items are dealt out one by one.
    pub fn takes(self, item: usize) -> bool {
        item % self.count == self.index
    }

    /// The shard's part of `items`, where each shard has one block of neighbours. Shards that go
    /// without in one `turn` are not the same in the next.
    pub fn block(self, items: usize, turn: usize) -> Range<usize> {
        let place = (self.index + turn % self.count) % self.count;
        // Wider than usize: the product of two of them.
        let start = |place: usize| (place as u128 * items as u128 / self.count as u128) as usize;
        start(place)..start(place + 1)
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text
            .split_once('/')
            .and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
        match numbers {
            None | Some((_, 0)) => Err(format!(
                "\"{text}\" is not a shard; write I/N, for the task I (from 0) of N tasks, like 0/4"
            )),
            Some((index, count)) if index >= count => Err(format!(
                "there is no shard {text}: {count} tasks have the numbers 0 to {}",
                count - 1
            )),
            Some((index, count)) => Ok(Self { index, count }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shard_is_a_number_below_another() {
        assert_eq!("2/3".parse(), Ok(Shard { index: 2, count: 3 }));
        assert_eq!("0/1".parse(), Ok(Shard::WHOLE));
        for wrong in ["", "3", "/", "3/3", "0/0", "-1/2", "1/x", "1/2/3", "1 / 2"] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
        let problem = "4/4".parse::<Shard>().unwrap_err();
        assert!(problem.contains("0 to 3"), "{problem}");
    }

    #[test]
    fn shards_together_do_everything_once() {
        for (count, items, turn) in [(1, 5, 0), (3, 10, 0), (3, 10, 4), (8, 3, 1), (4, 0, 2)] {
            let shards: Vec<Shard> = (0..count).map(|index| Shard { index, count }).collect();
            let mut blocks: Vec<usize> = shards.iter().flat_map(|s| s.block(items, turn)).collect();
            blocks.sort_unstable();
            assert!(blocks.into_iter().eq(0..items));
            let sizes = shards.iter().map(|s| s.block(items, turn).len());
            assert!(sizes.clone().max() <= sizes.min().map(|least| least + 1));
            let dealt = (0..items).map(|item| shards.iter().filter(|s| s.takes(item)).count());
            assert!(dealt.into_iter().all(|times| times == 1));
        }
        let idle =
            |turn| (0..4).find(|&index| !Shard { index, count: 4 }.block(1, turn).is_empty());
        assert_ne!(idle(0), idle(1));
    }
}
