//! Model files, encoders and other networks.

use std::fs;
use std::path::Path;

use super::base::{cut, pipe, write};
use super::{Case, bad};

const RENDER: &str = "render model -o new";
const MODEL: &str = "model/model.safetensors";

#[allow(clippy::too_many_lines, reason = "one table")]
pub fn cases() -> Vec<Case> {
    vec![
        bad(
            "no model",
            "render nothing -o new",
            |_| {},
            &["nothing", "no model", "impasto train"],
        ),
        bad(
            "a folder without a model",
            "render scene -o new",
            |_| {},
            &["scene", "no model", "impasto train"],
        ),
        bad(
            "a model cut off",
            RENDER,
            |f| cut(f, MODEL),
            &["model.safetensors", "not a whole", "again"],
        ),
        bad(
            "a model of no bytes",
            RENDER,
            |f| write(f, MODEL, ""),
            &["model.safetensors", "not a whole", "again"],
        ),
        bad(
            "a model that is text",
            "info model",
            |f| write(f, MODEL, "a model"),
            &["model.safetensors", "not a whole", "again"],
        ),
        bad(
            "a safetensors file of another program",
            RENDER,
            |f| write(f, MODEL, b"\x02\0\0\0\0\0\0\0{}"),
            &[
                "model.safetensors",
                "not a model of Impasto",
                "impasto train",
            ],
        ),
        bad(
            "a model of another version",
            RENDER,
            |f| patch(f, "version\\\":9", "version\\\":1"),
            &["model.safetensors", "version 1", "train it again"],
        ),
        bad(
            "a model that lacks a tensor",
            RENDER,
            |f| patch(f, "\"inner.base\"", "\"inner.bose\""),
            &["model.safetensors", "inner.base", "again"],
        ),
        bad(
            "a model with an unknown setting",
            RENDER,
            |f| patch(f, "geometry_share", "geometry_shore"),
            &["model.safetensors", "another version", "train it again"],
        ),
        bad(
            "a model that is a pipe",
            RENDER,
            |f| pipe(f, MODEL),
            &["model.safetensors", "pipe", "regular file"],
        ),
        bad(
            "styles for a model that learned none",
            "render model -o new --style styles/red.png",
            |_| {},
            &["no styles", "--stage style"],
        ),
        bad(
            "an evaluation of a model without styles",
            "eval model --styles styles",
            |_| {},
            &["style stage", "--stage style"],
        ),
        bad(
            "the style stage without a model",
            "train scene -o new --stage style --set style.patch=[24,24]",
            |_| {},
            &["new", "no model", "impasto train"],
        ),
        bad(
            "the style stage on another capture",
            "train colmap -o model --stage style --set style.patch=[24,24]",
            |_| {},
            &["not the capture", "3 photos instead of 8"],
        ),
        bad(
            "no encoder file",
            "train scene -o new --encoder none.safetensors --set style.patch=[24,24]",
            |_| {},
            &["none.safetensors", "no such file", "train-encoder"],
        ),
        bad(
            "an encoder that is text",
            "train scene -o new --encoder e.safetensors --set style.patch=[24,24]",
            |f| write(f, "e.safetensors", "an encoder"),
            &["e.safetensors"],
        ),
        bad(
            "a model instead of an encoder",
            "train scene -o new --encoder model/model.safetensors --set style.patch=[24,24]",
            |_| {},
            &["model.safetensors"],
        ),
        bad(
            "VGG-19 that is not installed",
            "train scene -o new --set style.perceptual=vgg19 --set style.patch=[24,24]",
            |_| {},
            &["VGG-19", "not installed", "impasto weights"],
        ),
        bad(
            "no file of weights",
            "weights --add none.pth",
            |_| {},
            &["none.pth", "no such file", "check"],
        ),
        bad(
            "weights that are text",
            "weights --add w.pth",
            |f| write(f, "w.pth", "weights"),
            &["w.pth"],
        ),
        bad(
            "weights that are a pipe",
            "weights --add w.pth",
            |f| pipe(f, "w.pth"),
            &["w.pth", "pipe", "regular file"],
        ),
        bad(
            "weights whose name has another checksum",
            "weights --add vgg19-dcbb9e9d.pth",
            |f| write(f, "vgg19-dcbb9e9d.pth", "weights"),
            &["vgg19-dcbb9e9d.pth", "damaged", "download it again"],
        ),
    ]
}

/// Replaces bytes of the model by as many others.
fn patch(folder: &Path, from: &str, to: &str) {
    assert_eq!(from.len(), to.len());
    let path = folder.join(MODEL);
    let mut bytes = fs::read(&path).unwrap();
    let at = bytes
        .windows(from.len())
        .position(|w| w == from.as_bytes())
        .expect(from);
    bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
    fs::write(path, bytes).unwrap();
}
