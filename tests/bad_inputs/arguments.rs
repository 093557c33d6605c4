//! Settings, camera paths, outputs and arguments.

use super::base::{pipe, write};
use super::{Case, bad};

const CONFIG: &str = "train scene -o new --config c.toml";
const VIEWS: &str = "render model -o new --views views.json";

fn usage(what: &'static str, command: &'static str, says: &'static [&'static str]) -> Case {
    Case {
        what,
        spoil: |_| {},
        command,
        code: 2,
        says,
    }
}

pub fn cases() -> Vec<Case> {
    [settings(), views(), outputs(), arguments()]
        .into_iter()
        .flatten()
        .collect()
}

#[allow(clippy::too_many_lines, reason = "one table")]
fn settings() -> Vec<Case> {
    vec![
        bad(
            "no settings file",
            CONFIG,
            |_| {},
            &["c.toml", "no such file", "check"],
        ),
        bad(
            "settings that are no TOML",
            CONFIG,
            |f| write(f, "c.toml", "a = = 1"),
            &["c.toml", "line 1"],
        ),
        bad(
            "settings that are a list",
            "train scene -o new --config c.json",
            |f| write(f, "c.json", "[1]"),
            &["c.json", "not a table"],
        ),
        bad(
            "settings that are not text",
            CONFIG,
            |f| write(f, "c.toml", [0xFF]),
            &["c.toml", "not text"],
        ),
        bad(
            "settings that are a pipe",
            CONFIG,
            |f| pipe(f, "c.toml"),
            &["c.toml", "pipe", "regular file"],
        ),
        bad(
            "a setting misspelt in a file",
            CONFIG,
            |f| write(f, "c.toml", "[geometry]\ngird_rate = 1"),
            &["c.toml", "geometry.gird_rate", "geometry.grid_rate"],
        ),
        bad(
            "a setting misspelt",
            "train scene -o new --set geometry.gird_rate=1",
            |_| {},
            &["geometry.gird_rate", "closest", "geometry.grid_rate"],
        ),
        bad(
            "a word for a number",
            "train scene -o new --set geometry.grid_rate=fast",
            |_| {},
            &["geometry.grid_rate", "fast"],
        ),
        bad(
            "a setting out of range",
            "train scene -o new --set geometry_share=7",
            |_| {},
            &["geometry_share", "0 to 1"],
        ),
        usage(
            "a setting without a value",
            "train scene -o new --set geometry.grid_rate",
            &["--set geometry.grid_rate", "KEY=VALUE"],
        ),
    ]
}

fn views() -> Vec<Case> {
    vec![
        bad(
            "no file of views",
            "render model -o new --views none.json",
            |_| {},
            &["none.json", "no such file"],
        ),
        bad(
            "views that are no JSON",
            VIEWS,
            |f| write(f, "views.json", "left"),
            &["views.json", "not valid", "line 1"],
        ),
        bad(
            "views without frames",
            VIEWS,
            |_| {},
            &["views.json", "no frames", "\"frames\""],
        ),
        bad(
            "a view that is no rotation",
            VIEWS,
            |f| write(f, "views.json", VIEW.replacen("1, 0", "2, 0", 1)),
            &["views.json", "frame 0", "rotation"],
        ),
        bad(
            "a view with a focal length of zero",
            VIEWS,
            |f| write(f, "views.json", VIEW.replace("50", "0")),
            &["views.json", "frame 0", "focal length"],
        ),
        bad(
            "views that are a pipe",
            VIEWS,
            |f| pipe(f, "views.json"),
            &["views.json", "pipe", "regular file"],
        ),
        bad(
            "a NeRF++ path without cameras",
            "render model -o new --views nerf/empty",
            |f| {
                for part in ["pose", "intrinsics"] {
                    std::fs::create_dir_all(f.join("nerf/empty").join(part)).unwrap();
                }
            },
            &["nerf/empty", "0 poses"],
        ),
        bad(
            "a NeRF++ path of words",
            "render model -o new --views nerf/train",
            |f| write(f, "nerf/train/pose/a.txt", "left"),
            &["pose/a.txt", "\"left\"", "number"],
        ),
    ]
}

const VIEW: &str = r#"{"frames": [{"camera_to_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    "w": 60, "h": 40, "fl_x": 50, "fl_y": 50, "cx": 30, "cy": 20}]}"#;

fn outputs() -> Vec<Case> {
    vec![
        bad(
            "a file where the model is to be",
            "train scene -o views.json",
            |_| {},
            &["cannot write views.json", "choose another"],
        ),
        bad(
            "a file above where the model is to be",
            "train scene -o views.json/model",
            |_| {},
            &["cannot write views.json", "choose another"],
        ),
        bad(
            "a picture below a file",
            "render model -o views.json/a.png",
            |_| {},
            &["cannot write", "views.json", "choose another"],
        ),
        bad(
            "a film below a file",
            "render model -o views.json/a.gif",
            |_| {},
            &["cannot write", "views.json", "choose another"],
        ),
        bad(
            "a report below a file",
            "eval model --styles styles -o views.json/report",
            |_| {},
            &["cannot write", "views.json"],
        ),
        bad(
            "a demo below a file",
            "demo --out views.json/demo",
            |_| {},
            &["cannot write", "views.json"],
        ),
        bad(
            "a film in a format that is not made",
            "render model -o new.avi",
            |_| {},
            &["new.avi", "not supported", ".mp4", ".gif"],
        ),
        bad(
            "a film without ffmpeg",
            "render model -o new.mp4 --ffmpeg no-ffmpeg",
            |_| {},
            &["new.mp4", "no-ffmpeg", "install", ".gif"],
        ),
    ]
}

#[allow(clippy::too_many_lines, reason = "one table")]
fn arguments() -> Vec<Case> {
    vec![
        usage(
            "no time",
            "train scene -o new --budget soon",
            &["soon", "90s, 10m or 1h30m"],
        ),
        usage(
            "a time and a number of steps",
            "train scene -o new --budget 1m --steps 3",
            &["--budget", "--steps"],
        ),
        usage(
            "a downscale of zero",
            "train scene -o new --downscale 0",
            &["--downscale", "0"],
        ),
        usage(
            "an unknown format",
            "train scene -o new --format obj",
            &["obj", "transforms"],
        ),
        usage(
            "an unknown use of masks",
            "train scene -o new --masks blur",
            &["blur", "--masks"],
        ),
        usage("an unknown command", "paint scene", &["paint"]),
        usage(
            "views of an unknown name",
            "render model -o new --views around",
            &["around", "orbit"],
        ),
        usage(
            "a size of one number",
            "render model -o new --size 300",
            &["300", "WIDTHxHEIGHT"],
        ),
        usage(
            "no frames",
            "render model -o new --frames 0",
            &["--frames", "at least 1"],
        ),
        usage(
            "a strength of two",
            "render model -o new --style styles/red.png --strength 2",
            &["2", "0 to 1"],
        ),
        usage(
            "two looks into one file",
            "render model -o new --style styles/red.png --style styles/red.png --refine 1s \
             --save-look look.safetensors",
            &["--save-look", "one --style"],
        ),
        bad(
            "a painting as a look",
            "render model -o new --look styles/red.png",
            |_| (),
            &["red.png", "safetensors", "--save-look"],
        ),
        bad(
            "a model as a look",
            "render model -o new --look model/model.safetensors",
            |_| (),
            &["model.safetensors", "not a look", "--save-look"],
        ),
        usage(
            "strokes three times as large",
            "render model -o new --style styles/red.png --stroke-size 3",
            &["3", "0.5 to 2"],
        ),
        usage(
            "a mask of no shape",
            "render model -o new --style styles/red.png --mask sky",
            &["sky", "near, far", "sphere:"],
        ),
        usage(
            "a mask around nothing",
            "render model -o new --style styles/red.png --mask sphere:0,0,0,0",
            &["radius of 0", "more than 0"],
        ),
        usage(
            "colours kept in an unknown way",
            "render model -o new --style styles/red.png --keep-color hue",
            &["hue", "luminance", "palette"],
        ),
        usage(
            "coats and a style",
            "render model -o new --style styles/red.png --coats coats.json",
            &["--coats", "cannot be used with"],
        ),
        bad(
            "coats that are no JSON",
            "render model -o new --coats coats.json",
            |d| write(d, "coats.json", "{\"coats\": ["),
            &["coats.json", "line 1", "docs/studio.md"],
        ),
        bad(
            "a coat of an impossible strength",
            "render model -o new --coats coats.json",
            |d| {
                let coat = r#"{"paintings": [{"painting": "styles/red.png"}], "strength": 3}"#;
                write(d, "coats.json", format!("{{\"coats\": [{coat}]}}"))
            },
            &["coats.json", "coat 1", "strength of 3", "0 to 1"],
        ),
        bad(
            "a coat of a painting that is not there",
            "render model -o new --coats coats.json",
            |d| {
                let coat = r#"{"paintings": [{"painting": "styles/gone.png"}]}"#;
                write(d, "coats.json", format!("{{\"coats\": [{coat}]}}"))
            },
            &["styles/gone.png", "cannot be read"],
        ),
        usage(
            "a weight below zero",
            "render model -o new --style styles/red.png:-1",
            &["styles/red.png:-1", "not negative"],
        ),
        usage(
            "weights for some styles only",
            "render model -o new --style styles/red.png:1 --style styles/red.png",
            &["--style", "weight"],
        ),
        usage(
            "a generated painting without a number",
            "render model -o new --style random:blue",
            &["random:blue", "random:SEED"],
        ),
        usage(
            "nothing to show on the other side",
            "render model -o new --side-by-side",
            &["--side-by-side", "--style or --coats"],
        ),
        usage(
            "the speed of a folder",
            "render model -o new --fps 24",
            &["--fps", "films", ".gif"],
        ),
        usage(
            "a GIF too fast for viewers",
            "render model -o new.gif --fps 60",
            &["0.1 to 50", "60", "--fps"],
        ),
        usage(
            "depth of a film",
            "render model -o new.gif --depth",
            &["--depth", "folder"],
        ),
    ]
}
