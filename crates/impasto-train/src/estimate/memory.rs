//! How much memory a run needs, and how much there is.

use impasto_field::{DistilledFeatures, Shading};
use impasto_model::TrainConfig;
use impasto_scene::{Photo, Scene};

/// What a run holds beside photos and patches: networks, tables, statistics of paintings, the
/// graphs of one step. Measured on two threads as the peak of short runs of either preset, less
/// what is computed below; for fields without a cascade and with one.
const REST: [u64; 2] = [440_000_000, 1_060_000_000];
/// Numbers that the painter sees of a sample: a colour, a place, a footprint and what is around it.
const PAINTED_NUMBERS: usize = 7 + DistilledFeatures::LEN;
/// Numbers of a kept sample beside what shades it: density, depth, indices.
const SAMPLE_NUMBERS: usize = 16;
/// Part of the photos' memory that freed pieces of other sizes take beside it.
const FRAGMENTS: f64 = 0.1;

/// Most bytes that training both stages on these photos holds, as far as measured ±15 %: photos as
/// bytes and as floats, rays of every lens, patches of the style stage and the rest.
pub fn bytes_needed(scene: &Scene, config: &TrainConfig) -> u64 {
    photos(scene) + other(scene, config)
}

/// The least whole number that photos must be shrunk by, beside what they are already, for training
/// to need no more than `bytes`. `None` where even tiny ones leave it more.
pub fn shrink_to_fit(scene: &Scene, config: &TrainConfig, bytes: u64) -> Option<u32> {
    let left = bytes.checked_sub(other(scene, config))?;
    (1..=MOST_SHRINKING).find(|k| photos(scene) / u64::from(k * k) <= left)
}

/// Photos shrunk by more show nothing.
const MOST_SHRINKING: u32 = 32;

/// Bytes that grow with the photos' pixels.
fn photos(scene: &Scene) -> u64 {
    let pixels = |photo: &Photo| u64::from(photo.pixels.width()) * u64::from(photo.pixels.height());
    let bytes: u64 = scene.photos.iter().map(|p| 3 * pixels(p)).sum();
    let trained: u64 = scene.train().map(|(_, p)| pixels(p)).sum();
    let floats = trained as f64 * 3.0 * 4.0 * (1.0 + FRAGMENTS);
    // Photos with the first one's lens share its table of rays.
    let mut trained = scene.train().map(|(_, photo)| photo);
    let first = trained.next();
    let others =
        trained.filter(|p| Some(p.camera.intrinsics) != first.map(|f| f.camera.intrinsics));
    let tables: u64 = first.into_iter().chain(others).map(|p| 8 * pixels(p)).sum();
    bytes + floats as u64 + tables
}

/// All other bytes.
fn other(scene: &Scene, config: &TrainConfig) -> u64 {
    let points: usize = scene.points.iter().map(|p| 80 + 48 * p.seen_by.len()).sum();
    let rest = REST[config.field.levels() - 1];
    points as u64 + patches(config) + rest
}

/// Bytes of a full pool of patches.
fn patches(config: &TrainConfig) -> u64 {
    let style = &config.style;
    let [height, width] = style.patch.map(|side| side * style.supersampling);
    let app = config.style_appearance();
    let view = app.app.view_bands.map_or(0, |bands| 3 * (1 + 2 * bands));
    // Numbers of a ray: of all of its samples, half of them in each volume, or of one in each.
    let numbers = match app.shading {
        Shading::Painted(_) => 2 * (PAINTED_NUMBERS + SAMPLE_NUMBERS),
        Shading::Samples => {
            let widths = config.field.inner.features() + config.field.outer.features();
            config.field.samples() / 2 * (widths + 2 * (view + SAMPLE_NUMBERS))
        }
    };
    (height * width * style.pool * numbers * 4) as u64
}

/// Bytes of memory that a process can have on this machine, or in its container. `None` where the
/// system does not tell.
pub fn available_memory() -> Option<u64> {
    let machine = std::fs::read_to_string("/proc/meminfo").ok()?;
    let container = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok();
    let limit = container.and_then(|limit| limit.trim().parse().ok());
    Some(total_of(&machine)?.min(limit.unwrap_or(u64::MAX)))
}

/// All memory by what Linux says of it.
fn total_of(told: &str) -> Option<u64> {
    let line = told
        .lines()
        .find_map(|line| line.strip_prefix("MemTotal:"))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kilobytes.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_read_from_what_linux_says() {
        let told = "MemTotal:       24690180 kB\nMemFree:         1204 kB\n";
        assert_eq!(total_of(told), Some(24_690_180 * 1024));
        assert_eq!(total_of("MemFree: 12 kB"), None);
        assert_eq!(total_of("MemTotal: much"), None);
    }

    #[test]
    fn patches_need_what_was_measured() {
        // "More than a gigabyte".
        let paper = patches(&TrainConfig::paper()) as f64;
        assert!((1.2e9..2.5e9).contains(&paper), "{paper}");
    }
}
