//! Procedural paint-like style images, labelled synthetic; knows nothing of tensors or scenes.
//!
//! A [`Recipe`] (family, palette, seed, scale) fully determines a picture. [`paint`] composes a
//! loose landscape, figure, still life or abstraction from shapes and noise, then paints it in the
//! technique of the family with a historical palette. Any family combines with any palette.
//!
//! No picture is copied from a painting: everything is made from chance and code, and [`label`]
//! says so wherever a picture is shown.

#![warn(missing_docs)]

mod canvas;
mod colour;
mod compose;
mod dice;
mod maths;
mod noise;
mod palettes;
mod recipe;
mod sketch;
mod technique;

pub use palettes::{NamedPalette, PALETTES};
pub use recipe::{Family, Recipe, label};

use canvas::Canvas;
use colour::Pigments;
use glam::Vec3;
use image::RgbImage;
use sketch::Sketch;
use technique::PaintingStudio;

/// Largest width or height that [`paint`] paints at; larger requests are clamped to it.
pub const LARGEST_SIDE: u32 = 8192;

/// Paints a recipe at `width`×`height` pixels (each clamped to 1…[`LARGEST_SIDE`]).
///
/// The same recipe and size give the same pixels on every platform: only operations that IEEE 754
/// rounds exactly are used. Another size gives the same composition with marks in proportion.
pub fn paint(recipe: &Recipe, width: u32, height: u32) -> RgbImage {
    let w = width.clamp(1, LARGEST_SIDE) as usize;
    let h = height.clamp(1, LARGEST_SIDE) as usize;
    let recipe = recipe.in_range();
    let dice = dice::Dice::new(recipe.seed, recipe.family as u64 + 1);
    let pigments = Pigments::mixed(recipe.palette(), &dice);
    let composition = compose::compose(&pigments, &dice, w as f32 / h as f32);
    let sketch = Sketch::draw(&composition, w, h);
    // Marks scale with the picture, but never below what a pixel can show.
    let unit = (((w * h) as f32).sqrt() / 256.0 * recipe.scale).max(0.4);
    let mut studio = PaintingStudio {
        canvas: Canvas::new(w, h, Vec3::ONE),
        sketch,
        pigments,
        dice,
        light: composition.light,
        unit,
    };
    technique::of(recipe.family)(&mut studio);
    technique::finish(&mut studio);
    studio.canvas.to_image()
}

/// The generated painting of a number: any family, palette and scale, square, `side` pixels long.
/// [`Recipe::random`] and [`paint`] in one; the same number is the same painting everywhere.
pub fn random(seed: u64, side: u32) -> (Recipe, RgbImage) {
    let recipe = Recipe::random(seed);
    (recipe, paint(&recipe, side, side))
}
