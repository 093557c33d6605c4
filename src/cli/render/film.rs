//! Films of a painted scene, for whoever has the model and the paint already.

use std::path::{Path, PathBuf};

use impasto::scene::Camera;
use impasto::{Model, Stop, StyleLayer};

use super::frames::FrameRenderer;
use crate::cli::CliError;
use crate::output::{FfmpegProgram, FilmFormat, FrameLayout, Target, TargetOptions, Viewpoint};

/// A film to be made.
pub struct FilmJob<'a> {
    /// One camera a frame, in scene space.
    pub cameras: &'a [Camera],
    /// Frames a second, where the format keeps a time.
    pub fps: f64,
    /// What the scene is painted with; as photographed without any.
    pub coats: &'a [StyleLayer],
    /// Whether the scene as photographed stands on the left.
    pub side_by_side: bool,
    /// Where to write it: a `.gif`, `.mp4`, `.webm`, a `.zip` of PNGs, or a folder for them.
    pub output: &'a Path,
    /// Which ffmpeg makes those films that need one.
    pub ffmpeg: FfmpegProgram,
}

/// What can be made with an ffmpeg that may be there, each with the ending of its file.
pub fn film_formats(ffmpeg: &FfmpegProgram) -> Vec<(&'static str, &'static str)> {
    // A sequence of pictures, in one file.
    let mut formats = vec![("png", "zip")];
    let films = FilmFormat::ALL.into_iter();
    let films = films.filter(|format| ffmpeg.encoder(*format, Path::new("")).is_ok());
    formats.extend(films.map(|format| (format.ending(), format.ending())));
    formats.sort_unstable();
    formats
}

/// Renders a film, frame by frame as `impasto render --views` does from the same cameras.
/// `progress` is told the part that is done, from 0 to 1, after each frame.
///
/// # Errors
/// When it cannot be made or written, and [`CliError::Stopped`] soon after `stop` was requested;
/// nothing is left then.
pub fn film(
    model: &Model,
    job: &FilmJob<'_>,
    progress: &mut dyn FnMut(f64),
    stop: &Stop,
) -> Result<PathBuf, CliError> {
    let wanted = TargetOptions {
        depth: false,
        fps: None,
        path_fps: Some(job.fps),
        ffmpeg: job.ffmpeg.clone(),
    };
    let target = Target::new(job.output, &wanted)?;
    target.check()?;
    let layout = FrameLayout::new(vec!["painted".to_owned()], job.side_by_side);
    let renderer = FrameRenderer::new(model, [job.coats], &layout, 1);
    let view = |camera: &Camera| Viewpoint {
        camera: *camera,
        photo: None,
    };
    let views: Vec<Viewpoint> = job.cameras.iter().map(view).collect();
    let sink = target.open(&layout, model.file.scene.synthetic)?;
    let mut done = |frames: usize| progress(frames as f64 / views.len() as f64);
    renderer.all(&views, sink, &mut done, stop)?;
    Ok(job.output.to_owned())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use clap::Parser;
    use impasto::scene::builtin::{BuiltinOptions, write_capture};
    use impasto::scene::paths::CameraPath;
    use impasto::scene::{LoadOptions, Split};
    use impasto::{
        Budget, Device, DeviceChoice, Recovery, Stages, TrainConfig, TrainOptions, train,
    };
    use serde_json::json;
    use tempfile::TempDir;

    use super::*;
    use crate::cli::render::{RenderArgs, run};

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: RenderArgs,
    }

    fn device() -> Device {
        DeviceChoice::Cpu.open().unwrap().device
    }

    /// A folder with a model that has hardly learned anything.
    fn trained() -> (TempDir, Model) {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("scene");
        let capture = BuiltinOptions {
            photos: 8,
            width: 40,
            height: 30,
            ..BuiltinOptions::default()
        };
        write_capture(&scene, &capture).unwrap();
        let options = TrainOptions {
            scene,
            output: folder.path().join("model"),
            styles: None,
            encoder: None,
            cache: Some(folder.path().join("cache")),
            stages: Stages::Geometry,
            config: TrainConfig::fast(),
            budget: Budget::Steps(5),
            load: LoadOptions::default(),
            seed: 0,
            device: device(),
            recovery: Recovery::default(),
        };
        let summary = train(&options, &mut |_| ()).unwrap();
        let model = Model::load_on(&summary.model, &device()).unwrap();
        (folder, model)
    }

    /// From one photo's place to another's, and back.
    fn path_through(model: &Model) -> CameraPath {
        let train = model.file.scene.cameras(Split::Train);
        let keyframes: Vec<_> = [0, 3, 5]
            .map(|i| json!({"camera_to_world": train[i].camera_to_world.to_cols_array(), "fov": 45.0}))
            .into();
        let path = json!({
            "keyframes": keyframes, "seconds": 0.5, "fps": 10, "closed": true, "size": [30, 20],
        });
        serde_json::from_value(path).unwrap()
    }

    #[test]
    fn the_frames_are_those_of_the_written_path() {
        let (folder, model) = trained();
        let path = path_through(&model);
        let at = |name: &str| folder.path().join(name);
        let frames = at("frames");
        let job = FilmJob {
            cameras: &path.cameras().unwrap(),
            fps: path.fps,
            coats: &[],
            side_by_side: false,
            output: &frames,
            ffmpeg: FfmpegProgram::new("ffmpeg".as_ref()),
        };
        let mut parts = Vec::new();
        let made = film(&model, &job, &mut |part| parts.push(part), &Stop::default());
        assert_eq!(made.unwrap(), frames);
        assert_eq!(parts, [0.2, 0.4, 0.6, 0.8, 1.0]);

        let text = path.to_nerfstudio(&model.file.scene.normalisation).unwrap();
        fs::write(at("path.json"), text).unwrap();
        let place = |name: &str| at(name).display().to_string();
        let (model, views, output) = (place("model"), place("path.json"), place("again"));
        let line = [
            "render", &model, "--views", &views, "--device", "cpu", "-o", &output,
        ];
        run(&Line::parse_from(line).args).unwrap();
        for frame in 0..5 {
            let name = format!("{frame:04}.png");
            let picture = |folder: &str| image::open(at(folder).join(&name)).unwrap().to_rgb8();
            assert_eq!(picture("frames").dimensions(), (30, 20));
            assert!(picture("frames") == picture("again"), "frame {frame}");
        }
        assert!(!at("again").join("0005.png").exists());
    }

    #[test]
    fn what_needs_no_other_program_can_always_be_made() {
        let none = film_formats(&FfmpegProgram::new("no-such-ffmpeg".as_ref()));
        assert_eq!(none, [("gif", "gif"), ("png", "zip")]);
    }

    #[test]
    fn a_stopped_film_leaves_nothing() {
        let (folder, model) = trained();
        let cameras = path_through(&model).cameras().unwrap();
        for name in ["clip.gif", "clip.zip", "frames"] {
            let output = folder.path().join("films").join(name);
            let job = FilmJob {
                cameras: &cameras,
                fps: 10.0,
                coats: &[],
                side_by_side: false,
                output: &output,
                ffmpeg: FfmpegProgram::new("ffmpeg".as_ref()),
            };
            let stop = Stop::default();
            let mut frames = 0;
            let mut progress = |_| {
                frames += 1;
                if frames == 2 {
                    stop.request();
                }
            };
            let made = film(&model, &job, &mut progress, &stop);
            assert!(matches!(made, Err(CliError::Stopped)), "{name}");
            assert_eq!(frames, 2);
            assert!(!folder.path().join("films").exists(), "{name}");
        }
    }
}
