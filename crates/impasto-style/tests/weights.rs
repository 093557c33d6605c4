//! Weight files: every form read back, hostile ones refused, VGG-19 normalised and installed.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod torch_files;

use impasto_kernels::{Border, ConvLayer, OddEnd, PerceptualStack};
use impasto_paintings::{Recipe, paint};
use impasto_style::weights::{FileFormat, Scheme, WeightsFile, inspect_vgg19, normalise};
use impasto_style::{Perceptual, Statistics, StyleError, picture};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use safetensors::tensor::{Dtype, TensorView};
use std::io::Cursor;
use std::path::Path;
use torch_files::*;

fn opened(bytes: &[u8]) -> Result<WeightsFile, StyleError> {
    WeightsFile::read("net.pth", Cursor::new(bytes.to_vec()))
}

fn refusal(bytes: &[u8]) -> String {
    opened(bytes).map(|_| ()).expect_err("refused").to_string()
}

fn safetensors_form(tensors: &[Saved]) -> Vec<u8> {
    let bytes: Vec<Vec<u8>> = (tensors.iter())
        .map(|t| t.numbers.iter().flat_map(|v| v.to_le_bytes()).collect())
        .collect();
    let views = tensors.iter().zip(&bytes).map(|(t, bytes)| {
        let shape = t.shape.iter().map(|s| *s as usize).collect();
        (&t.name, TensorView::new(Dtype::F32, shape, bytes).unwrap())
    });
    safetensors::serialize(views, None).unwrap()
}

/// Numbers that every kind of storage can hold.
fn handful() -> Vec<Saved> {
    let count = |n: u32| (0..n).map(|i| 0.25 * i as f32 - 3.0).collect();
    let mut tensors = vec![
        Saved::new("first.weight", &[4, 3, 2], count(24)),
        Saved::new("first.bias", &[4], count(4)),
        Saved::new("scale", &[], vec![0.5]),
        Saved::new("ünïcode", &[1, 300], count(300)),
    ];
    tensors[1].kind = "HalfStorage";
    tensors[2].kind = "DoubleStorage";
    tensors[0].offset = 5;
    // Along one pixel a stride means nothing.
    tensors[3].strides = Some(vec![77, 1]);
    tensors
}

fn forms(tensors: &[Saved]) -> [(FileFormat, Vec<u8>); 3] {
    [
        (FileFormat::TorchZip, zip_form(tensors, "archive")),
        (FileFormat::TorchStream, stream_form(tensors)),
        (FileFormat::Safetensors, safetensors_form(tensors)),
    ]
}

#[test]
fn every_form_reads_back_equal() {
    let tensors = handful();
    for (form, bytes) in forms(&tensors) {
        let mut file = opened(&bytes).unwrap();
        assert_eq!((file.format(), file.len()), (form, tensors.len()));
        for tensor in &tensors {
            let floats = file.floats(&tensor.name, &tensor.shape).unwrap();
            assert_eq!(floats, tensor.numbers, "{form}: {}", tensor.name);
        }
    }
    let other_folder = zip_form(&tensors, "vgg_normalised");
    assert_eq!(opened(&other_folder).unwrap().len(), tensors.len());
}

#[test]
fn a_tensor_of_no_numbers_may_claim_any_other_side() {
    let huge = 1 << 40;
    let mut empty = Saved::new("empty", &[huge, huge, 0], Vec::new());
    empty.strides = Some(vec![0, 0, 1]);
    for bytes in [
        zip_form(std::slice::from_ref(&empty), "archive"),
        stream_form(std::slice::from_ref(&empty)),
    ] {
        let floats = opened(&bytes).unwrap().floats("empty", &empty.shape);
        assert!(floats.unwrap().is_empty());
    }
}

#[test]
fn what_is_asked_for_must_be_there() {
    let mut file = opened(&zip_form(&handful(), "archive")).unwrap();
    let missing = file.floats("second.bias", &[4]).unwrap_err().to_string();
    assert_eq!(
        missing,
        "weight file net.pth: has no tensor \"second.bias\""
    );
    let shape = file.floats("first.bias", &[2, 2]).unwrap_err().to_string();
    assert!(
        shape.contains("\"first.bias\" of shape [4], [2, 2] was expected"),
        "{shape}"
    );
}

#[test]
fn code_is_refused_by_its_name() {
    let mut p = Pickler::start();
    p.global("os", "system")
        .text("echo")
        .op(0x85)
        .op(b'R')
        .op(b'.');
    let file = zip("a", &[("data.pkl".into(), p.bytes.clone())], 0);
    assert!(refusal(&file).contains("names os.system, which is refused"));
    let stream = [stream_head(true), p.bytes].concat();
    assert!(refusal(&stream).contains("os.system"));
    // What newer pickles write instead.
    let mut p = Pickler::start();
    p.text("builtins").text("eval").op(0x93).op(b'.');
    let file = zip("a", &[("data.pkl".into(), p.bytes)], 0);
    assert!(refusal(&file).contains("builtins.eval"));
}

#[test]
fn what_cannot_be_read_is_said_plainly() {
    let tensors = handful();
    let mut turned = tensors.clone();
    turned[0].strides = Some(vec![1, 4, 12]);
    assert!(refusal(&zip_form(&turned, "a")).contains("strides [1, 4, 12]"));
    let mut large = tensors.clone();
    large[0].shape = vec![4, 3, 3];
    assert!(refusal(&stream_form(&large)).contains("larger than its storage"));
    let mut endless = tensors.clone();
    endless[3].shape = vec![1 << 30, 1 << 30, 1 << 30];
    endless[3].strides = None;
    assert!(refusal(&zip_form(&endless, "a")).contains("impossible shape"));

    let data = [("data.pkl".to_owned(), vec![b'x'; 9])];
    assert!(refusal(&zip("a", &data, 8)).contains("compressed"));
    assert!(refusal(&zip("a", &data[..0], 0)).contains("neither"));
    let order = [data[0].clone(), ("byteorder".into(), b"big".to_vec())];
    assert!(refusal(&zip("a", &order, 0)).contains("big-endian"));
    assert!(refusal(&stream_head(false)).contains("big-endian"));
    assert!(refusal(b"").contains("neither a PyTorch checkpoint (.pth) nor"));
    assert!(refusal(b"<!DOCTYPE html>").contains("neither"));
    let mut tar = vec![b'a'; 600];
    tar[257..262].copy_from_slice(b"ustar");
    assert!(refusal(&tar).contains("before 2017"));

    let mut poisoned = tensors;
    poisoned[0].numbers[3] = f32::NAN;
    let mut file = opened(&stream_form(&poisoned)).unwrap();
    let error = file.floats("first.weight", &[4, 3, 2]).unwrap_err();
    assert!(error.to_string().contains("no finite number"), "{error}");
    let nowhere = WeightsFile::open(Path::new("nowhere.pth")).map(|_| ());
    assert!(
        nowhere
            .unwrap_err()
            .to_string()
            .contains("nowhere.pth: cannot be read")
    );
}

/// Opens a file and reads all it says it has: whatever is in it, this must end without a panic.
fn survive(bytes: &[u8]) -> bool {
    let Ok(mut file) = opened(bytes) else {
        return false;
    };
    let names: Vec<String> = file.names().map(str::to_owned).collect();
    names.iter().all(|name| {
        let shape = file.shape(name).map(<[u64]>::to_vec).unwrap_or_default();
        match file.floats(name, &shape) {
            Ok(floats) => {
                assert!(floats.len() <= bytes.len());
                true
            }
            Err(_) => false,
        }
    })
}

#[test]
fn no_cut_file_is_read_whole() {
    for (form, bytes) in forms(&handful()) {
        assert!(survive(&bytes));
        for length in 0..bytes.len() {
            assert!(!survive(&bytes[..length]), "{form} cut at {length}");
        }
    }
}

#[test]
fn damaged_files_end_in_errors_or_other_numbers() {
    let mut rng = Pcg64::seed_from_u64(19);
    for (_, bytes) in forms(&handful()[..2]) {
        for _ in 0..20_000 {
            let mut damaged = bytes.clone();
            for _ in 0..rng.random_range(1..4) {
                let at = rng.random_range(0..damaged.len());
                damaged[at] = rng.random();
            }
            survive(&damaged);
        }
    }
}

#[test]
fn a_small_pickle_cannot_ask_for_much_memory() {
    let file = |p: &Pickler| zip("a", &[("data.pkl".into(), p.bytes.clone())], 0);
    // A list of pairs that is made into dictionaries again and again.
    let mut bomb = Pickler::start();
    bomb.global("collections", "OrderedDict").op(b']').op(b'(');
    for _ in 0..40_000 {
        bomb.op(b'N').op(b'N').op(0x86);
    }
    bomb.op(b'e').op(0x85).bytes.extend([b'q', 9]);
    for _ in 0..100_000 {
        bomb.bytes.extend([b'h', 0, b'h', 9, b'R']);
    }
    bomb.op(b'.');
    assert!(refusal(&file(&bomb)).contains("more values"));
    // A long key that many storages have.
    let mut bomb = Pickler::start();
    bomb.op(b'(')
        .text("storage")
        .global("torch", "FloatStorage");
    bomb.text(&"k".repeat(100_000)).text("cpu").int(1).op(b't');
    bomb.bytes.extend([b'q', 9]);
    for _ in 0..100_000 {
        bomb.bytes.extend([b'h', 9, b'Q']);
    }
    bomb.op(b'.');
    assert!(refusal(&file(&bomb)).contains("more values"));
}

fn paintings() -> Vec<image::RgbImage> {
    (0..3)
        .map(|seed| paint(&Recipe::random(seed), 49, 41))
        .collect()
}

fn installed(folder: &Path, bytes: &[u8]) -> Perceptual {
    let path = folder.join("vgg19.safetensors");
    std::fs::write(&path, bytes).unwrap();
    Perceptual::vgg19(&path).unwrap()
}

#[test]
fn torchvisions_filters_are_normalised_to_a_mean_of_one() {
    let tensors = random_vgg19(1, "features.", TORCHVISION);
    let pictures = paintings();
    let made = forms(&tensors).map(|(_, bytes)| {
        let mut file = opened(&bytes).unwrap();
        normalise(&mut file, &pictures).unwrap()
    });
    let (bytes, facts) = &made[0];
    assert_eq!(facts.made_from, Scheme::Torchvision);
    assert!(
        made.iter().all(|(other, _)| other == bytes),
        "the form made a difference"
    );

    let folder = tempfile::tempdir().unwrap();
    let vgg = installed(folder.path(), bytes);
    let mut mean = vec![0.0; Statistics::LEN];
    for image in &pictures {
        let features = vgg.features(&picture(image), 41, 49).unwrap();
        assert_eq!(features.content.len(), 6 * 7 * 512);
        assert_eq!(features.content.len(), vgg.content_len(41, 49));
        for (m, s) in mean.iter_mut().zip(&features.statistics.0) {
            *m += s / pictures.len() as f32;
        }
    }
    let mut start = 0;
    for channels in [64, 128, 256, 512] {
        let means = &mean[start..start + channels];
        // Filters that hardly fire are left below 1.
        let normal = means.iter().filter(|m| (*m - 1.0).abs() < 0.02).count();
        assert!(means.iter().all(|m| *m < 1.02), "{means:?}");
        assert!(normal > channels / 2, "{normal} of {channels}");
        start += 2 * channels;
    }
    assert!(matches!(
        vgg.features(&[0.5; 8 * 9 * 3], 9, 8),
        Err(StyleError::TooSmall { least: 9, .. })
    ));
}

#[test]
fn the_normalised_sequential_keeps_its_filters_and_colours() {
    let mut tensors = random_vgg19(2, "", SEQUENTIAL);
    // The first layer sees hundreds.
    tensors[0].numbers.iter_mut().for_each(|w| *w /= 100.0);
    let mut matrix = vec![0.0; 9];
    for at in [2, 4, 6] {
        matrix[at] = 255.0;
    }
    tensors.push(Saved::new("0.weight", &[3, 3, 1, 1], matrix));
    let shift = vec![-103.939, -116.779, -123.68];
    tensors.push(Saved::new("0.bias", &[3], shift));
    let mut file = opened(&zip_form(&tensors, "vgg_normalised")).unwrap();
    let (bytes, facts) = normalise(&mut file, &[]).unwrap();
    assert_eq!(facts.made_from, Scheme::Normalised);

    let layers = tensors[..18].chunks(2).enumerate().map(|(i, layer)| {
        let mut weight = layer[0].numbers.clone();
        if i == 0 {
            for filter in weight.chunks_exact_mut(27) {
                let (blue, rest) = filter.split_at_mut(9);
                blue.swap_with_slice(&mut rest[9..]);
            }
        }
        let statistics = [0, 2, 4, 8].contains(&i);
        ConvLayer::new(
            &weight,
            layer[1].numbers.clone(),
            statistics && i > 0,
            statistics,
        )
    });
    let direct = PerceptualStack::new(layers.collect(), 255.0, [123.68, 116.779, 103.939])
        .bordered(Border::Mirrored)
        .ending(OddEnd::Kept);
    let image = picture(&paintings()[0]);
    let expected = direct.forward(&image, 41, 49).0;
    let folder = tempfile::tempdir().unwrap();
    let found = installed(folder.path(), &bytes)
        .features(&image, 41, 49)
        .unwrap();
    let found = [found.content, found.statistics.0].concat();
    let error: f32 = found
        .iter()
        .zip(&expected)
        .map(|(a, b)| (a - b).powi(2))
        .sum();
    let size: f32 = expected.iter().map(|v| v * v).sum();
    // Half precision rounds every weight by 2⁻¹² of itself, on average.
    assert!(
        error < 1e-6 * size,
        "relative error {}",
        (error / size).sqrt()
    );
}

#[test]
fn checkpoints_of_other_networks_are_refused() {
    let refused = |tensors: &[Saved]| {
        let mut file = opened(&zip_form(tensors, "a")).unwrap();
        normalise(&mut file, &paintings()).unwrap_err().to_string()
    };
    let message = refused(&handful());
    assert!(
        message.contains("is no VGG-19") && message.contains("first.bias"),
        "{message}"
    );
    let tensors = random_vgg19(3, "features.", TORCHVISION);
    let message = refused(&tensors[..8]);
    assert!(
        message.contains("no tensor \"features.10.weight\""),
        "{message}"
    );
    // VGG-16 has its third pool where VGG-19 has one more layer.
    let mut vgg16 = tensors.clone();
    vgg16[14].name = "features.17.weight".into();
    vgg16[16].name = "features.16.weight".into();
    let message = refused(&vgg16);
    let words = "\"features.16.weight\" of shape [512, 256, 3, 3], [256, 256, 3, 3] was expected";
    assert!(message.contains(words), "{message}");
    let mut dead = tensors;
    dead[2].numbers.fill(0.0);
    dead[3].numbers.fill(-1.0);
    let message = refused(&dead);
    assert!(message.contains("conv1_2 that never fires"), "{message}");
}

#[test]
fn an_installed_file_is_whole_or_refused() {
    let tensors = random_vgg19(4, "features.", TORCHVISION);
    let mut file = opened(&stream_form(&tensors)).unwrap();
    let (bytes, facts) = normalise(&mut file, &paintings()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("vgg19.safetensors");
    let refused = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        inspect_vgg19(&path).unwrap_err().to_string()
    };
    for length in [0, 7, 100, bytes.len() / 2, bytes.len() - 1] {
        let message = refused(&bytes[..length]);
        assert!(message.contains("is damaged"), "{length}: {message}");
    }
    let mut changed = bytes.clone();
    changed[bytes.len() - 9] ^= 4;
    assert!(refused(&changed).contains("wrong SHA-256"));
    let message = refused(&safetensors_form(&handful()));
    assert!(message.contains("`impasto weights --add`"), "{message}");
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(inspect_vgg19(&path).unwrap(), facts);
}
