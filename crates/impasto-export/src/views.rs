//! The pictures and depths that clouds are made of.

use glam::{Mat3, Vec2, Vec3};

use impasto_scene::{Camera, Distortion, Normalisation, Split};
use impasto_train::{Coat, Model, ModelScene, Stop};

use crate::ExportError;

/// Training views that are looked from where nothing else is asked for.
const MOST_VIEWS: usize = 48;
/// Most pixels of a view, where no size is asked for.
const MOST_PIXELS: f64 = 200_000.0;

/// What a scene looks like from one camera.
#[derive(Debug, Clone)]
pub struct View {
    /// `height × width × 3` in `[0, 1]`, row by row.
    pub colours: Vec<f32>,
    /// `height × width`, depth along the camera's axis in scene units, infinite where nothing is.
    pub depth: Vec<f32>,
}

/// Which views are taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ViewOptions {
    /// Most views, evenly spaced among the training views; 48 where nothing is said.
    pub views: Option<usize>,
    /// Their pixels across and down; where nothing is said the photos' as trained, made smaller to
    /// 200,000 pixels. Decides how dense a cloud is.
    pub size: Option<(u32, u32)>,
}

/// Who is told how far things are, and who can end them.
pub struct Watch<'a> {
    /// Hears what is being done, and the share of all that is done, from 0 to 1.
    pub progress: &'a mut dyn FnMut(&'static str, f64),
    /// Ends the work with [`ExportError::Stopped`].
    pub stop: &'a Stop,
}

impl Watch<'_> {
    /// Tells, and asks whether to go on.
    pub(crate) fn at(&mut self, what: &'static str, share: f64) -> Result<(), ExportError> {
        (self.progress)(what, share);
        match self.stop.is_requested() {
            true => Err(ExportError::Stopped),
            false => Ok(()),
        }
    }
}

/// A view with its camera, ready for arithmetic.
#[derive(Debug, Clone)]
pub(crate) struct Seen {
    pub lens: Lens,
    pub colours: Vec<Vec3>,
    pub depth: Vec<f32>,
}

/// What is seen of a scene's surfaces.
#[derive(Debug, Clone)]
pub struct Views {
    /// The scene's name.
    pub name: String,
    /// Whether its photos were made by a program.
    pub synthetic: bool,
    /// The way back to the capture's coordinates.
    pub normalisation: Normalisation,
    pub(crate) seen: Vec<Seen>,
}

/// Share of an export's time that rendering takes.
pub(crate) const RENDERED: f64 = 0.6;

impl Views {
    /// Looks at a scene from its training views. `look` is given pinhole cameras without
    /// distortion, in scene space.
    ///
    /// # Errors
    /// If there are no training views, or somebody asks for the end.
    pub fn of(
        scene: &ModelScene,
        options: &ViewOptions,
        look: &mut dyn FnMut(&Camera) -> View,
        watch: &mut Watch<'_>,
    ) -> Result<Self, ExportError> {
        let cameras = cameras(&scene.cameras(Split::Train), options);
        if cameras.is_empty() {
            return Err(ExportError::NoViews);
        }
        let mut seen = Vec::with_capacity(cameras.len());
        for (i, camera) in cameras.iter().enumerate() {
            watch.at("views", RENDERED * i as f64 / cameras.len() as f64)?;
            seen.push(Seen::new(camera, look(camera)));
        }
        Ok(Self {
            name: scene.name.clone(),
            synthetic: scene.synthetic,
            normalisation: scene.normalisation,
            seen,
        })
    }

    /// Looks at a model that is painted with these coats; without any, as photographed.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn of_model(
        model: &Model,
        coats: &[Coat],
        options: &ViewOptions,
        watch: &mut Watch<'_>,
    ) -> Result<Self, ExportError> {
        let mut look = |camera: &Camera| {
            let mut rendered = model.render_coats(camera, &[coats], 1);
            View {
                colours: rendered.pixels.pop().unwrap_or_default(),
                depth: rendered.depth,
            }
        };
        Self::of(&model.file.scene, options, &mut look, watch)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.seen.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.seen.is_empty()
    }
}

/// Evenly spaced ones, on the grid that was asked for, without distortion.
fn cameras(all: &[Camera], options: &ViewOptions) -> Vec<Camera> {
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

impl Seen {
    fn new(camera: &Camera, view: View) -> Self {
        let (colours, _) = view.colours.as_chunks::<3>();
        Self {
            lens: Lens::new(camera),
            colours: colours.iter().map(|c| Vec3::from_array(*c)).collect(),
            depth: view.depth,
        }
    }
}

/// A pinhole camera in single precision.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lens {
    pub width: usize,
    pub height: usize,
    pub focal: Vec2,
    pub middle: Vec2,
    pub centre: Vec3,
    /// From camera space to scene space.
    pub rotation: Mat3,
}

impl Lens {
    fn new(camera: &Camera) -> Self {
        let k = &camera.intrinsics;
        Self {
            width: k.width as usize,
            height: k.height as usize,
            focal: Vec2::new(k.fl_x as f32, k.fl_y as f32),
            middle: Vec2::new(k.cx as f32, k.cy as f32),
            centre: camera.centre().as_vec3(),
            rotation: Mat3::from_mat4(camera.camera_to_world.as_mat4()),
        }
    }

    /// Direction with z = 1, in camera space, through the middle of a pixel.
    pub fn aim(&self, x: usize, y: usize) -> Vec3 {
        let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
        ((at - self.middle) / self.focal).extend(1.0)
    }

    /// The point at a depth behind the middle of a pixel.
    pub fn point(&self, x: usize, y: usize, depth: f32) -> Vec3 {
        self.centre + self.rotation * (self.aim(x, y) * depth)
    }

    /// A point in camera space.
    pub fn local(&self, point: Vec3) -> Vec3 {
        self.rotation.transpose() * (point - self.centre)
    }

    /// Where a point of camera space is on the picture, in pixels.
    pub fn onto(&self, local: Vec3) -> Vec2 {
        local.truncate() / local.z * self.focal + self.middle
    }

    /// The pixel that shows a point, and its depth there.
    pub fn pixel(&self, point: Vec3) -> Option<(usize, usize, f32)> {
        let local = self.local(point);
        if local.z <= 1e-6 {
            return None;
        }
        let at = self.onto(local);
        let inside = at.x >= 0.0 && at.y >= 0.0;
        let (x, y) = (at.x as usize, at.y as usize);
        (inside && x < self.width && y < self.height).then_some((x, y, local.z))
    }

    /// Length along the longer side of a pixel at a depth.
    pub fn footprint(&self, depth: f32) -> f32 {
        depth / self.focal.min_element()
    }
}
