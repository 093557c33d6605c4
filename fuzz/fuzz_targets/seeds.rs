//! Writes small valid inputs for every target to `$SEEDS/TARGET/` and leaves. It is linked like a
//! target because cargo-fuzz compiles whatever it uses for them.
#![no_main]

#[path = "../../crates/impasto-style/tests/torch_files/mod.rs"]
mod torch_files;

use std::fs;
use std::path::PathBuf;

use impasto_fuzz::{scene, write_f16};
use libfuzzer_sys::fuzz_target;
use torch_files::{Saved, stream_form, zip_form};

fuzz_target!(init: write(), |_bytes: &[u8]| {});

fn write() {
    let folder = PathBuf::from(std::env::var_os("SEEDS").expect("SEEDS names a folder"));
    let seeds = scene::seeds().into_iter().chain(weights());
    #[cfg(feature = "tensors")]
    let seeds = seeds.chain(impasto_fuzz::tensors::seeds(&impasto_fuzz::scratch()));
    for (target, name, bytes) in seeds {
        let into = folder.join(target);
        fs::create_dir_all(&into).expect("the folder is writable");
        fs::write(into.join(name), bytes).expect("the folder is writable");
    }
}

fn weights() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let tensors = tensors();
    let mut empty = Saved::new("empty", &[1 << 40, 1 << 40, 0], Vec::new());
    empty.strides = Some(vec![0, 0, 1]);
    let flat: [(&str, &[f32]); 3] = [
        ("mean", &[0.5, 1.0, 2.0, -3.0]),
        ("scale", &[0.5, 1.0, 2.0, 4.0]),
        ("gain", &[1.0, 2.0]),
    ];
    let file = write_f16(&flat).expect("a safetensors file");
    vec![
        ("checkpoint", "zip", zip_form(&tensors, "archive")),
        ("checkpoint", "stream", stream_form(&tensors)),
        ("checkpoint", "empty", zip_form(&[empty], "archive")),
        ("checkpoint", "safetensors", file.clone()),
        ("tensor_file", "safetensors", file),
    ]
}

/// A few tensors of every kind of storage.
fn tensors() -> Vec<Saved> {
    let mut tensors = vec![
        Saved::new("0.weight", &[2, 3], vec![0.5; 6]),
        Saved::new("0.bias", &[2], vec![1.0, -1.0]),
        Saved::new("scale", &[], vec![2.0]),
    ];
    tensors[0].offset = 2;
    tensors[1].kind = "HalfStorage";
    tensors[2].kind = "DoubleStorage";
    tensors
}
