//! What a time was taken on.

use serde::Serialize;
use std::fmt;

/// A machine, as far as it decides times.
#[derive(Debug, Clone, Serialize)]
pub struct Machine {
    /// The processor's name, or its architecture where the system does not tell.
    pub processor: String,
    /// Threads used.
    pub threads: usize,
    /// Instruction set in use.
    pub instructions: &'static str,
    /// The operating system.
    pub system: &'static str,
}

impl Machine {
    /// The one that this runs on.
    pub fn this() -> Self {
        // Linux alone says it in a file.
        let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        Self {
            processor: processor(&told)
                .unwrap_or(std::env::consts::ARCH)
                .to_owned(),
            threads: rayon::current_num_threads(),
            instructions: instructions(),
            system: std::env::consts::OS,
        }
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            processor,
            threads,
            instructions,
            system,
        } = self;
        write!(
            f,
            "{processor}, {threads} threads, {instructions}, {system}"
        )
    }
}

/// The first processor's name in what Linux says of all.
fn processor(told: &str) -> Option<&str> {
    let lines = told.lines().filter_map(|line| line.split_once(':'));
    let mut named = lines.filter(|(key, _)| key.trim() == "model name");
    named.next().map(|(_, name)| name.trim())
}

fn instructions() -> &'static str {
    struct Lanes;
    impl pulp::WithSimd for Lanes {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: pulp::Simd>(self, _: S) -> usize {
            S::F32_LANES
        }
    }
    match pulp::Arch::new().dispatch(Lanes) {
        16 => "16 numbers a vector (AVX-512)",
        8 => "8 numbers a vector (AVX2)",
        4 => "4 numbers a vector (NEON)",
        _ => "no vectors",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_processor_is_the_one_that_the_system_names() {
        let told = "processor\t: 0\nmodel\t\t: 17\nmodel name\t: Fast: one\nprocessor\t: 1\n";
        assert_eq!(processor(told), Some("Fast: one"));
        assert_eq!(processor("Hardware\t: board\n"), None);
    }
}
