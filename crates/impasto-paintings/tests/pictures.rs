//! What users of the generator rely on: the same recipe gives the same picture, families and
//! palettes look different, every size and scale works, and everything is labelled synthetic.

use image::RgbImage;
use impasto_paintings::{Family, LARGEST_SIDE, PALETTES, Recipe, label, paint, random};
use std::collections::HashSet;

/// Mean colour, spread of lightness, and mean gradients at two scales, each about 0…1.
fn statistics(picture: &RgbImage) -> [f32; 6] {
    let n = (picture.width() * picture.height()) as f32;
    let mut out = [0.0f32; 6];
    let tone = |p: &image::Rgb<u8>| p.0.iter().map(|v| f32::from(*v)).sum::<f32>() / 765.0;
    let mut squares = 0.0;
    for p in picture.pixels() {
        for (slot, v) in out.iter_mut().zip(p.0) {
            *slot += f32::from(v) / 255.0 / n;
        }
        squares += tone(p) * tone(p) / n;
    }
    let mean = (out[0] + out[1] + out[2]) / 3.0;
    out[3] = (squares - mean * mean).max(0.0).sqrt();
    for (slot, step) in [(4, 1), (5, 5)] {
        for y in 0..picture.height() - step {
            for x in 0..picture.width() - step {
                let here = tone(picture.get_pixel(x, y));
                let right = tone(picture.get_pixel(x + step, y));
                let below = tone(picture.get_pixel(x, y + step));
                out[slot] += ((right - here).abs() + (below - here).abs()) / n;
            }
        }
    }
    out
}

fn mean_difference(a: &RgbImage, b: &RgbImage) -> f32 {
    let sum: u64 = a
        .as_raw()
        .iter()
        .zip(b.as_raw())
        .map(|(x, y)| u64::from(x.abs_diff(*y)))
        .sum();
    sum as f32 / a.as_raw().len() as f32
}

#[test]
fn a_recipe_always_gives_the_same_picture() {
    for (i, family) in Family::ALL.iter().enumerate() {
        let recipe = Recipe::nth_of(*family, i as u64);
        assert_eq!(recipe, Recipe::nth_of(*family, i as u64));
        assert_eq!(
            paint(&recipe, 48, 40),
            paint(&recipe, 48, 40),
            "{}",
            label(&recipe)
        );
    }
}

/// A change here means that every model trained on generated styles saw other pictures: change it
/// knowingly, together with the changelog.
#[test]
fn pictures_are_the_same_on_every_platform() {
    let fingerprint = |recipe: &Recipe| {
        let bytes = paint(recipe, 40, 32).into_raw();
        bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| {
            (h ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3)
        })
    };
    let all = Family::ALL.iter().fold(0u64, |h, f| {
        h.rotate_left(5)
            ^ fingerprint(&Recipe {
                family: *f,
                palette: 3,
                seed: 11,
                scale: 1.0,
            })
    });
    assert_eq!(all, FINGERPRINT, "got {all:#x}");
}

const FINGERPRINT: u64 = 0xd324_0532_a65d_737f;

#[test]
fn families_differ_in_the_same_palette() {
    let pictures: Vec<RgbImage> = Family::ALL
        .iter()
        .map(|family| {
            paint(
                &Recipe {
                    family: *family,
                    palette: 5,
                    seed: 7,
                    scale: 1.0,
                },
                96,
                96,
            )
        })
        .collect();
    for (i, a) in pictures.iter().enumerate() {
        for (j, b) in pictures.iter().enumerate().skip(i + 1) {
            let apart = mean_difference(a, b);
            assert!(
                apart > 8.0,
                "{} and {}: {apart}",
                Family::ALL[i].name(),
                Family::ALL[j].name()
            );
        }
    }
}

#[test]
fn texture_separates_families_more_than_chance_does() {
    // Fine gradient per family over a few seeds: line techniques far above smooth ones.
    let fine = |family: Family| {
        (0..6u64)
            .map(|seed| {
                statistics(&paint(
                    &Recipe {
                        scale: 1.0,
                        ..Recipe::nth_of(family, seed)
                    },
                    128,
                    128,
                ))[4]
            })
            .sum::<f32>()
            / 6.0
    };
    let smooth = fine(Family::OldMaster).max(fine(Family::CutPaper));
    let lined = fine(Family::Engraving).min(fine(Family::Tapestry));
    assert!(lined > 1.5 * smooth, "{lined} against {smooth}");
}

#[test]
fn random_recipes_span_dark_and_pale_grey_and_colourful() {
    let all: Vec<[f32; 6]> = (0..60)
        .map(|s| statistics(&paint(&Recipe::random(s), 64, 64)))
        .collect();
    let range = |of: &dyn Fn(&[f32; 6]) -> f32| {
        let values: Vec<f32> = all.iter().map(of).collect();
        let low = values.iter().copied().fold(f32::INFINITY, f32::min);
        (
            low,
            values.iter().copied().fold(f32::NEG_INFINITY, f32::max),
        )
    };
    let (dark, pale) = range(&|s| (s[0] + s[1] + s[2]) / 3.0);
    assert!(dark < 0.25 && pale > 0.65, "lightness {dark}…{pale}");
    let (cold, warm) = range(&|s| s[0] - s[2]);
    assert!(cold < -0.05 && warm > 0.2, "warmth {cold}…{warm}");
    let (soft, harsh) = range(&|s| s[3]);
    assert!(soft < 0.12 && harsh > 0.25, "contrast {soft}…{harsh}");
}

#[test]
fn no_picture_is_blank() {
    for family in Family::ALL {
        for seed in 0..4 {
            let recipe = Recipe::nth_of(*family, seed);
            let s = statistics(&paint(&recipe, 96, 96));
            assert!(s[3] > 0.015, "{}: contrast {}", label(&recipe), s[3]);
        }
    }
}

#[test]
fn every_size_and_scale_is_painted() {
    for family in Family::ALL {
        for (w, h) in [(1, 1), (7, 300), (300, 7), (2, 2), (33, 1)] {
            for scale in [0.0, 1.0, 1e9, f32::NAN, -3.0, f32::INFINITY] {
                let recipe = Recipe {
                    family: *family,
                    palette: usize::MAX,
                    seed: u64::MAX,
                    scale,
                };
                let picture = paint(&recipe, w, h);
                assert_eq!(picture.dimensions(), (w, h));
            }
        }
    }
    let nothing = paint(&Recipe::random(1), 0, 0);
    assert_eq!(nothing.dimensions(), (1, 1));
    let ribbon = paint(&Recipe::random(1), u32::MAX, 1);
    assert_eq!(ribbon.dimensions(), (LARGEST_SIDE, 1));
}

#[test]
fn palettes_colour_the_picture() {
    let with = |palette| {
        statistics(&paint(
            &Recipe {
                family: Family::Gouache,
                palette,
                seed: 3,
                scale: 1.0,
            },
            64,
            64,
        ))
    };
    let of = |name: &str| {
        PALETTES
            .iter()
            .position(|p| p.name == name)
            .expect("a palette of that name")
    };
    let (blue, red) = (with(of("blue melancholy")), with(of("sanguine")));
    assert!(red[0] - red[2] > blue[0] - blue[2] + 0.2);
}

#[test]
fn another_size_shows_the_same_composition() {
    for family in [Family::OldMaster, Family::CutPaper, Family::Watercolour] {
        let recipe = Recipe::nth_of(family, 5);
        let small = paint(&recipe, 96, 96);
        let large = image::imageops::thumbnail(&paint(&recipe, 192, 192), 96, 96);
        let other = paint(&Recipe { seed: 6, ..recipe }, 96, 96);
        let (same, unlike) = (
            mean_difference(&small, &large),
            mean_difference(&small, &other),
        );
        assert!(
            same < 0.75 * unlike,
            "{}: {same} against {unlike}",
            family.name()
        );
    }
}

#[test]
fn labels_say_synthetic_and_name_family_palette_and_seed() {
    let palette = PALETTES
        .iter()
        .position(|p| p.name == "ukiyo-e indigo")
        .expect("the palette exists");
    let recipe = Recipe {
        family: Family::Pointillism,
        palette,
        seed: 42,
        scale: 1.0,
    };
    assert_eq!(label(&recipe), "synthetic: pointillism, ukiyo-e indigo #42");
    let names: HashSet<&str> = Family::ALL.iter().map(|f| f.name()).collect();
    assert_eq!(names.len(), Family::ALL.len());
    assert!(Family::ALL.len() >= 14);
}

#[test]
fn random_recipes_reach_every_family_and_most_palettes() {
    let recipes: Vec<Recipe> = (0..2000).map(Recipe::random).collect();
    let families: HashSet<Family> = recipes.iter().map(|r| r.family).collect();
    let palettes: HashSet<usize> = recipes.iter().map(|r| r.palette).collect();
    assert_eq!(families.len(), Family::ALL.len());
    assert_eq!(palettes.len(), PALETTES.len());
    assert!(recipes.iter().all(|r| (0.6..2.0).contains(&r.scale)));
}

#[test]
fn a_number_is_a_painting() {
    let (recipe, picture) = random(42, 32);
    assert_eq!(recipe, Recipe::random(42));
    assert_eq!(picture, paint(&recipe, 32, 32));
    assert_ne!(picture, random(43, 32).1);
}
