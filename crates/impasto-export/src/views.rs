//! The pictures and depths that clouds are made of.

use glam::{Mat3, Vec2, Vec3};

use impasto_model::{Model, ModelScene, Stop, StyleLayer};
use impasto_scene::{Camera, Distortion, Normalisation, Split};

use crate::ExportError;

/// Training views that are rendered where nothing else is asked for.
const MOST_VIEWS: usize = 48;
/// Most pixels of a view, where no size is asked for.
const MOST_PIXELS: f64 = 200_000.0;

/// A scene from one camera: colour and depth.
#[derive(Debug, Clone)]
pub struct RgbdView {
    /// `height × width × 3` in `[0, 1]`, row by row.
    pub colours: Vec<f32>,
    /// `height × width`, depth along the camera's axis in scene units, infinite where nothing is.
    pub depth: Vec<f32>,
}

/// Which views are taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ViewSelection {
    /// Most views, evenly spaced among the training views; 48 where nothing is said.
    pub views: Option<usize>,
    /// Their pixels across and down; where nothing is said the photos' as trained, made smaller to
    /// 200,000 pixels. Decides how dense a cloud is.
    pub size: Option<(u32, u32)>,
}

/// Progress of an export, and what can end it.
pub struct Watch<'a> {
    /// Is told what is being done, and the share of all that is done, from 0 to 1.
    pub progress: &'a mut dyn FnMut(&'static str, f64),
    /// Ends the work with [`ExportError::Stopped`].
    pub stop: &'a Stop,
}

impl Watch<'_> {
    /// Reports a share of all that is done; an error if the end was asked for.
    pub(crate) fn at(&mut self, what: &'static str, share: f64) -> Result<(), ExportError> {
        (self.progress)(what, share);
        if self.stop.is_requested() {
            return Err(ExportError::Stopped);
        }
        Ok(())
    }
}

/// The share of all that is done after `done` of `count` steps of a part of the work, which begins
/// and ends at these shares.
pub(crate) fn share([begin, end]: [f64; 2], done: usize, count: usize) -> f64 {
    begin + (end - begin) * (done as f64 / count as f64)
}

/// An RGB-D view with its camera, in single precision.
#[derive(Debug, Clone)]
pub(crate) struct PosedView {
    pub camera: Pinhole,
    pub colours: Vec<Vec3>,
    pub depth: Vec<f32>,
}

/// RGB-D views of a scene's surfaces.
#[derive(Debug, Clone)]
pub struct Views {
    /// The scene's name.
    pub name: String,
    /// Whether its photos were made by a program.
    pub synthetic: bool,
    /// The way back to the capture's coordinates.
    pub normalisation: Normalisation,
    pub(crate) posed: Vec<PosedView>,
}

/// Share of an export's time that rendering takes.
pub(crate) const RENDERED: f64 = 0.6;

impl Views {
    /// Renders a scene from its training views. `render` is given pinhole cameras without
    /// distortion, in scene space.
    ///
    /// # Errors
    /// If there are no training views, or somebody asks for the end.
    pub fn of(
        scene: &ModelScene,
        options: &ViewSelection,
        render: &mut dyn FnMut(&Camera) -> RgbdView,
        watch: &mut Watch<'_>,
    ) -> Result<Self, ExportError> {
        let cameras = cameras(&scene.cameras(Split::Train), options);
        if cameras.is_empty() {
            return Err(ExportError::NoViews);
        }
        let mut posed = Vec::with_capacity(cameras.len());
        for (i, camera) in cameras.iter().enumerate() {
            watch.at("views", RENDERED * i as f64 / cameras.len() as f64)?;
            posed.push(PosedView::new(camera, render(camera)));
        }
        Ok(Self {
            name: scene.name.clone(),
            synthetic: scene.synthetic,
            normalisation: scene.normalisation,
            posed,
        })
    }

    /// Renders a model that is painted with these coats; without any, as photographed.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn of_model(
        model: &Model,
        coats: &[StyleLayer],
        options: &ViewSelection,
        watch: &mut Watch<'_>,
    ) -> Result<Self, ExportError> {
        let mut render = |camera: &Camera| {
            let mut rendered = model.render_layers(camera, &[coats], 1);
            RgbdView {
                colours: rendered.pixels.pop().unwrap_or_default(),
                depth: rendered.depth,
            }
        };
        Self::of(&model.file.scene, options, &mut render, watch)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.posed.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.posed.is_empty()
    }
}

/// Evenly spaced ones, on the grid that was asked for, without distortion.
fn cameras(all: &[Camera], options: &ViewSelection) -> Vec<Camera> {
    let most = options.views.unwrap_or(MOST_VIEWS).min(all.len());
    let chosen = (0..most).map(|i| &all[i * all.len() / most]);
    let ideal = chosen.map(|camera| {
        let k = &camera.intrinsics;
        let pixels = f64::from(k.width) * f64::from(k.height);
        let scale = (MOST_PIXELS / pixels).sqrt().min(1.0);
        let side = |side: u32| ((f64::from(side) * scale).round() as u32).max(1);
        let (width, height) = options.size.unwrap_or((side(k.width), side(k.height)));
        let mut camera = camera.resized(width, height);
        camera.intrinsics.distortion = Distortion::default();
        camera
    });
    ideal.collect()
}

impl PosedView {
    fn new(camera: &Camera, view: RgbdView) -> Self {
        let (colours, _) = view.colours.as_chunks::<3>();
        Self {
            camera: Pinhole::new(camera),
            colours: colours.iter().map(|c| Vec3::from_array(*c)).collect(),
            depth: view.depth,
        }
    }
}

/// A pinhole camera in single precision.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pinhole {
    pub width: usize,
    pub height: usize,
    pub focal: Vec2,
    pub principal: Vec2,
    pub centre: Vec3,
    /// From camera space to scene space.
    pub rotation: Mat3,
}

impl Pinhole {
    fn new(camera: &Camera) -> Self {
        let k = &camera.intrinsics;
        Self {
            width: k.width as usize,
            height: k.height as usize,
            focal: Vec2::new(k.fl_x as f32, k.fl_y as f32),
            principal: Vec2::new(k.cx as f32, k.cy as f32),
            centre: camera.centre().as_vec3(),
            rotation: Mat3::from_mat4(camera.camera_to_world.as_mat4()),
        }
    }

    /// Direction with z = 1, in camera space, through the middle of a pixel.
    pub fn direction(&self, x: usize, y: usize) -> Vec3 {
        let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        ((at - self.principal) / self.focal).extend(1.0)
    }

    /// The point at a depth behind the middle of a pixel.
    pub fn point(&self, x: usize, y: usize, depth: f32) -> Vec3 {
        self.centre + self.rotation * (self.direction(x, y) * depth)
    }

    /// A point in camera space.
    pub fn local(&self, point: Vec3) -> Vec3 {
        self.rotation.transpose() * (point - self.centre)
    }

    /// Where a point of camera space is on the picture, in pixels.
    pub fn project(&self, local: Vec3) -> Vec2 {
        local.truncate() / local.z * self.focal + self.principal
    }

    /// The pixel that shows a point, and its depth there.
    pub fn pixel(&self, point: Vec3) -> Option<(usize, usize, f32)> {
        let local = self.local(point);
        if local.z <= 1e-6 {
            return None;
        }
        let at = self.project(local);
        let inside = at.x >= 0.0 && at.y >= 0.0;
        let (x, y) = (at.x as usize, at.y as usize);
        (inside && x < self.width && y < self.height).then_some((x, y, local.z))
    }

    /// Length along the longer side of a pixel at a depth.
    pub fn footprint(&self, depth: f32) -> f32 {
        depth / self.focal.min_element()
    }
}
