//! What the painter remembers for one page: its view in parts, and the paint.

use std::collections::VecDeque;
use std::time::Instant;

use image::RgbImage;
use impasto_model::StyleLayers;
use impasto_scene::Camera;

use super::pace::{Pace, bands};
use crate::frame::Level;
use crate::message::{Picked, ViewMessage};
use crate::painter::{Painter, ViewGeometry};

/// A part of a view, rendered at once.
pub(super) struct ViewPart<V> {
    pub(super) level: Level,
    /// First row and number of rows, in the view's pixels.
    pub(super) rows: (u32, u32),
    /// Sees this part, on as many pixels as are rendered.
    pub(super) camera: Camera,
    pub(super) geometry: Option<V>,
    picture: Option<RgbImage>,
}

impl<V: ViewGeometry> ViewPart<V> {
    fn new(level: Level, rows: (u32, u32), camera: Camera) -> Self {
        Self {
            level,
            rows,
            camera,
            geometry: None,
            picture: None,
        }
    }

    /// Width and height of what is rendered.
    pub(super) fn size(&self) -> (u32, u32) {
        (self.camera.intrinsics.width, self.camera.intrinsics.height)
    }

    /// Keeps what was painted, for those who point at it.
    pub(super) fn keep(&mut self, picture: RgbImage) {
        self.picture = Some(picture);
    }

    fn bytes(&self) -> usize {
        let picture = self.picture.as_ref().map_or(0, |p| p.as_raw().len());
        self.geometry.as_ref().map_or(0, ViewGeometry::bytes) + picture
    }

    /// What is at a place of the picture, in the pixels that were rendered.
    fn at(&self, x: f64, y: f64) -> Option<Picked> {
        let (geometry, picture) = (self.geometry.as_ref()?, self.picture.as_ref()?);
        let (width, height) = self.size();
        // Inside, so the casts keep the value.
        let (column, row) = (
            (x as u32).min(width.saturating_sub(1)),
            (y as u32).min(height.saturating_sub(1)),
        );
        let index = row as usize * width as usize + column as usize;
        let depth = geometry.depth().get(index).copied().map(f64::from);
        let depth = depth.filter(|depth| depth.is_finite());
        let ray = self
            .camera
            .ray(f64::from(column) + 0.5, f64::from(row) + 0.5);
        Some(Picked {
            point: depth.map(|depth| (ray.origin + ray.direction * depth).to_array()),
            depth,
            colour: picture
                .get_pixel(column, row)
                .0
                .map(|c| f64::from(c) / 255.0),
        })
    }
}

/// One page's view and paint.
pub(super) struct Easel<P: Painter> {
    pub(super) view: Option<(ViewMessage, Instant)>,
    /// The coats that are on it, and since when.
    pub(super) coats: (u32, StyleLayers, Instant),
    pub(super) paint: Option<P::Paint>,
    parts: Vec<ViewPart<P::Geometry>>,
    /// Indices of the parts that are still to be painted.
    plan: VecDeque<usize>,
}

impl<P: Painter> Easel<P> {
    pub(super) fn new() -> Self {
        Self {
            view: None,
            coats: (0, StyleLayers { coats: Vec::new() }, Instant::now()),
            paint: None,
            parts: Vec::new(),
            plan: VecDeque::new(),
        }
    }

    /// Shows another view from now on; geometry is kept where it is the same.
    pub(super) fn set_view(&mut self, view: ViewMessage, since: Instant, pace: &Pace) {
        let same = |(old, _): &(ViewMessage, Instant)| old.camera == view.camera;
        if !self.view.as_ref().is_some_and(same) {
            self.parts.clear();
        }
        self.view = Some((view, since));
        self.plan(pace);
    }

    /// Begins the view anew, with what geometry there is.
    pub(super) fn plan(&mut self, pace: &Pace) {
        self.plan.clear();
        let Some((view, _)) = self.view else {
            return;
        };
        let size = (view.camera.intrinsics.width, view.camera.intrinsics.height);
        if self.parts.is_empty() {
            let (width, height) = pace.coarse(size.0, size.1);
            let camera = view.camera.resized(width, height);
            let level = if (width, height) == size {
                Level::Sharp
            } else {
                Level::Coarse
            };
            self.parts.push(ViewPart::new(level, (0, size.1), camera));
        }
        let is_sharp = self.parts[0].level == Level::Sharp;
        if !view.moving && !is_sharp && self.parts.len() == 1 {
            let bands = bands(size.1, pace.rows(size.0, size.1));
            self.parts.extend(
                bands.into_iter().map(|rows| {
                    ViewPart::new(Level::Sharp, rows, view.camera.rows(rows.0, rows.1))
                }),
            );
        }
        let sharp = 1..self.parts.len();
        let all_there = || {
            let mut bands = self.parts[1..].iter();
            bands.all(|part| part.geometry.is_some())
        };
        // What can be sharp at once need not be coarse first.
        if view.moving || is_sharp || !all_there() {
            self.plan.push_back(0);
        }
        if !view.moving {
            self.plan.extend(sharp);
        }
    }

    /// Whether nothing of the view is left to be painted.
    pub(super) fn is_done(&self) -> bool {
        self.plan.is_empty()
    }

    /// The next part, and whether it is the last.
    pub(super) fn next(&mut self) -> Option<(&mut ViewPart<P::Geometry>, bool)> {
        let index = self.plan.pop_front()?;
        let last = self.plan.is_empty();
        Some((self.parts.get_mut(index)?, last))
    }

    /// What is at a place of the view, from 0 to 1; from the sharpest part that shows it.
    pub(super) fn pick(&self, x: f64, y: f64) -> Option<Picked> {
        let (view, _) = self.view.as_ref()?;
        let row = y * f64::from(view.camera.intrinsics.height);
        self.parts.iter().rev().find_map(|part| {
            let (width, height) = part.size();
            let down = (row - f64::from(part.rows.0)) / f64::from(part.rows.1);
            (0.0..=1.0)
                .contains(&down)
                .then(|| part.at(x * f64::from(width), down * f64::from(height)))?
        })
    }

    /// Memory that its parts take.
    pub(super) fn bytes(&self) -> usize {
        self.parts.iter().map(ViewPart::bytes).sum()
    }

    /// Lets go of geometry. What is painted already stays painted.
    pub(super) fn forget(&mut self) {
        for part in &mut self.parts {
            part.geometry = None;
            part.picture = None;
        }
    }
}
