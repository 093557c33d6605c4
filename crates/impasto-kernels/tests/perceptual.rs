//! The perceptual stack: twin, gradients, degenerate images, determinism, golden numbers.

mod common;

use burn::tensor::Tensor;
use common::convnet::*;
use common::on::perceptual;
use common::*;
use impasto_kernels::{ConvLayer, PerceptualStack, ops};
use std::path::Path;
use std::sync::Arc;

#[test]
fn equals_its_twin() {
    let layers = small_vgg(1);
    // The last one makes several tasks of every convolution.
    for (height, width) in [(8, 8), (9, 15), (16, 11), (45, 38)] {
        let image = numbers(2, height * width * 3, 0.0..1.0);
        let stack = stack(&layers);
        let (out, _) = perceptual::forward(&stack, &image, height, width);
        let (expected, _) = twin(&layers, &wide(&image), height, width);
        let shape = stack.content_shape(height, width);
        let content: usize = shape.iter().product();
        assert_eq!(shape, [height / 8, width / 8, 5]);
        assert_eq!(out.len(), content + stack.statistics_len());
        let what = format!("{width}×{height}");
        assert_close(
            &format!("{what}: content"),
            &out[..content],
            &expected[..content],
            1e-5,
        );
        assert_close(
            &format!("{what}: statistics"),
            &out[content..],
            &expected[content..],
            1e-5,
        );
    }
}

#[test]
fn many_channels_equal_the_twin_forward_and_backward() {
    let layers = wide_stack(21);
    let stack = stack(&layers);
    let (height, width) = (17, 20);
    let image = numbers(22, height * width * 3, 0.0..1.0);
    let (out, tape) = perceptual::forward(&stack, &image, height, width);
    let (expected, _) = twin(&layers, &wide(&image), height, width);
    assert_close("features", &out, &expected, 1e-5);
    let grad = numbers(23, out.len(), -1.0..1.0);
    let found = perceptual::backward(&tape, &grad);
    let loss = |image: &[f64]| dot64(&twin(&layers, image, height, width).0, &grad);
    // The twin is too slow for every pixel.
    for at in [0, 61, 500, 733, image.len() - 1] {
        let moved = |by: f64| {
            let mut image = wide(&image);
            image[at] += by;
            loss(&image)
        };
        let wanted = (moved(1e-6) - moved(-1e-6)) / 2e-6;
        let error = (f64::from(found[at]) - wanted).abs();
        let size = found.iter().map(|g| g.abs()).fold(0.0, f32::max);
        assert!(
            error < 1e-3 * f64::from(size),
            "pixel {at}: {} {wanted}",
            found[at]
        );
    }
}

#[test]
fn gradient_equals_the_twins_differences() {
    let layers = small_vgg(3);
    let stack = stack(&layers);
    for (height, width) in [(8, 8), (9, 11)] {
        let image = numbers(4, height * width * 3, 0.0..1.0);
        let (out, tape) = perceptual::forward(&stack, &image, height, width);
        let grad = numbers(5, out.len(), -1.0..1.0);
        let expected = differences(&image, |image| {
            dot64(&twin(&layers, image, height, width).0, &grad)
        });
        let what = format!("{width}×{height}");
        assert_close(&what, &perceptual::backward(&tape, &grad), &expected, 1e-4);
    }
}

#[test]
fn operation_has_the_gradient_of_central_differences() {
    let (height, width) = (4, 6);
    let (layers, image) = (0..2000)
        .map(|seed| {
            let layers = random_stack(seed, &[4, 5], &[1], &[0, 1]);
            (layers, numbers(seed + 7, height * width * 3, 0.0..1.0))
        })
        .find(|(layers, image)| twin(layers, &wide(image), height, width).1 > 0.012)
        .expect("one of the seeds stays off the kinks");
    check_operation(stack(&layers), &image, [height, width]);
}

#[test]
fn the_smallest_image_is_one_pixel_of_content() {
    let stack = stack(&small_vgg(6));
    assert_eq!(stack.smallest(), 8);
    assert_eq!(stack.content_shape(8, 8), [1, 1, 5]);
    let image = numbers(7, 8 * 8 * 3, 0.0..1.0);
    let (out, tape) = perceptual::forward(&stack, &image, 8, 8);
    assert_eq!(out.len(), 5 + stack.statistics_len());
    // One pixel deviates from its mean by nothing.
    let deviations = &out[out.len() - 5..];
    assert!(
        deviations.iter().all(|s| (s - 1e-5f32.sqrt()).abs() < 1e-7),
        "{deviations:?}"
    );
    let grad = perceptual::backward(&tape, &vec![1.0; out.len()]);
    assert!(grad.iter().all(|g| g.is_finite()) && grad.iter().any(|g| *g != 0.0));
}

#[test]
#[should_panic(expected = "image of 7×8 is too small for the perceptual stack")]
fn refuses_an_image_one_pixel_too_narrow() {
    let image = tensor(&numbers(8, 8 * 7 * 3, 0.0..1.0), [8, 7, 3]);
    let _ = ops::perceptual(image, Arc::new(stack(&small_vgg(6))));
}

#[test]
#[should_panic(expected = "channels of neighbouring convolutions")]
fn refuses_layers_that_do_not_fit() {
    let mut layers = small_vgg(6);
    layers.remove(1);
    let _ = stack(&layers);
}

#[test]
fn features_without_variance_have_finite_gradients() {
    // Only the middle tap: a constant image stays constant up to its border.
    let mut layers = random_stack(9, &[4, 4], &[1], &[0, 1]);
    for layer in &mut layers {
        for (i, weight) in layer.weight.iter_mut().enumerate() {
            *weight = if i % 9 == 4 { weight.abs() } else { 0.0 };
        }
        layer.bias.iter_mut().for_each(|b| *b = b.abs() + 3.0);
    }
    let stack = Arc::new(stack(&layers));
    let image = leaf(&[0.5; 10 * 12 * 3], [10, 12, 3]);
    let out = ops::perceptual(image.clone(), stack);
    let features = values(out.clone());
    let deviations = &features[features.len() - 4..];
    assert!(
        deviations.iter().all(|s| (s - 1e-5f32.sqrt()).abs() < 1e-6),
        "{deviations:?}"
    );
    let grad = gradient(&image, &backward(out, &vec![1.0; features.len()]));
    assert!(grad.iter().all(|g| g.is_finite()) && grad.iter().any(|g| *g != 0.0));
}

#[test]
fn a_poisoned_pixel_shows_and_stays_in_its_neighbourhood() {
    let layers = random_stack(10, &[4, 5, 6], &[1], &[1]);
    let stack = stack(&layers);
    let (height, width) = (40, 30);
    let mut image = numbers(11, height * width * 3, 0.0..1.0);
    let (clean, _) = perceptual::forward(&stack, &image, height, width);
    image[(9 * width + 12) * 3 + 1] = f32::NAN;
    let (out, _) = perceptual::forward(&stack, &image, height, width);
    let [rows, columns, channels] = stack.content_shape(height, width);
    let content = rows * columns * channels;
    assert!(
        out[content..].iter().all(|v| v.is_nan()),
        "statistics hide the NaN"
    );
    let mut spoiled = 0;
    for y in 0..rows {
        for x in 0..columns {
            let own = (y * columns + x) * channels..(y * columns + x + 1) * channels;
            if y.abs_diff(4) <= 3 && x.abs_diff(6) <= 3 {
                spoiled += usize::from(out[own].iter().all(|v| v.is_nan()));
            } else {
                assert_same("a far pixel", &out[own.clone()], &clean[own]);
            }
        }
    }
    assert!(spoiled >= 25, "only {spoiled} pixels show the NaN");
}

#[test]
fn does_not_depend_on_threads() {
    for layers in [small_vgg(12), wide_stack(12)] {
        let stack = stack(&layers);
        let (height, width) = (67, 81);
        let image = numbers(13, height * width * 3, 0.0..1.0);
        assert_deterministic("features and gradient", || {
            let (out, tape) = perceptual::forward(&stack, &image, height, width);
            let grad = perceptual::backward(&tape, &numbers(14, out.len(), -1.0..1.0));
            [out, grad].concat()
        });
    }
}

#[test]
fn takes_images_stored_channels_first() {
    let stack = Arc::new(stack(&small_vgg(15)));
    let planes = numbers(16, 3 * 9 * 10, 0.0..1.0);
    let image = channels_last(&planes, 9, 10);
    let (expected, _) = perceptual::forward(&stack, &image, 9, 10);
    let out = ops::perceptual(tensor(&planes, [3, 9, 10]).permute([1, 2, 0]), stack);
    assert_same("a permuted view", &values(out), &expected);
}

/// Turns planes into pixels.
fn channels_last(planes: &[f32], height: usize, width: usize) -> Vec<f32> {
    let (pixels, channels) = (height * width, planes.len() / (height * width));
    (0..planes.len())
        .map(|i| planes[i % channels * pixels + i / channels])
        .collect()
}

/// VGG-16 to relu4_1 from the repository's weights. They take BGR in 0..255 minus a mean.
fn vgg16() -> PerceptualStack {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let file = Golden::open(&assets.join("vgg16_conv1_1_to_conv4_1_f16.safetensors"));
    let names = ["1_1", "1_2", "2_1", "2_2", "3_1", "3_2", "3_3", "4_1"];
    let layers = names.map(|name| {
        let mut weight = file.f16(&format!("conv{name}.weight"));
        if name == "1_1" {
            for filter in weight.chunks_exact_mut(27) {
                let (blue, rest) = filter.split_at_mut(9);
                blue.swap_with_slice(&mut rest[9..]);
            }
        }
        let bias = file.f16(&format!("conv{name}.bias"));
        let first_of_block = name.ends_with("_1");
        ConvLayer::new(
            &weight,
            bias,
            first_of_block && name != "1_1",
            first_of_block,
        )
    });
    PerceptualStack::new(layers.into(), 255.0, [123.68, 116.779, 103.939])
}

/// The file's statistics of the style image, in the order of the stack.
fn golden_style_statistics(golden: &Golden) -> Vec<f32> {
    let of = |kind: &str, layer| golden.f32(&format!("{kind}.style.relu{layer}_1"));
    (1..=4)
        .flat_map(|layer| [of("mean", layer), of("std", layer)].concat())
        .collect()
}

#[test]
fn reproduces_the_golden_features() {
    let golden = golden("perceptual_vgg16");
    let stack = vgg16();
    let style = channels_last(&golden.f32("style"), 128, 128);
    let (out, _) = perceptual::forward(&stack, &style, 128, 128);
    let statistics = golden_style_statistics(&golden);
    let own = &out[out.len() - stack.statistics_len()..];
    assert_close("the style's statistics", own, &wide(&statistics), 1e-5);

    let image = channels_last(&golden.f32("output"), 67, 81);
    let (out, _) = perceptual::forward(&stack, &image, 67, 81);
    let expected = channels_last(&golden.f32("features.output.relu4_1"), 8, 10);
    assert_eq!(stack.content_shape(67, 81), [8, 10, 512]);
    let (content, own) = out.split_at(expected.len());
    assert_close("relu4_1", content, &wide(&expected), 1e-5);
    let mut expected = Vec::new();
    for layer in 1..=4 {
        let name = format!("features.output.relu{layer}_1");
        let shape = golden.shape(&name);
        let [height, width, channels] = [shape[2], shape[3], shape[1]];
        let data = wide(&channels_last(&golden.f32(&name), height, width));
        let features = Image {
            height,
            width,
            channels,
            data,
        };
        let pairs: Vec<_> = (0..channels).map(|c| features.statistics(c)).collect();
        expected.extend(pairs.iter().map(|p| p.0));
        expected.extend(pairs.iter().map(|p| p.1));
    }
    assert_close("the image's statistics", own, &expected, 1e-5);
}

#[test]
fn reproduces_the_golden_losses_and_gradient() {
    let golden = golden("perceptual_vgg16");
    let stack = Arc::new(vgg16());
    let image = |name: &str| channels_last(&golden.f32(name), 67, 81);
    let features = |image: Tensor<3>| {
        let all = ops::perceptual(image, Arc::clone(&stack));
        let content = all.dims()[0] - stack.statistics_len();
        let end = all.dims()[0];
        (all.clone().slice(0..content), all.slice(content..end))
    };
    let square = |a: Tensor<1>, b: Tensor<1>| (a - b).powf_scalar(2.0).mean();

    let photo = features(tensor(&image("content"), [67, 81, 3])).0;
    let statistics = golden_style_statistics(&golden);
    let target = tensor(&statistics, [statistics.len()]);
    let tracked = leaf(&image("output"), [67, 81, 3]);
    let (content, own) = features(tracked.clone());
    let content_loss = square(content, photo);
    let style_loss = square(own, target);
    for (name, loss) in [
        ("content_loss", &content_loss),
        ("style_loss_concatenated", &style_loss),
    ] {
        assert_close(name, &values(loss.clone()), &wide(&golden.f32(name)), 1e-5);
    }
    let grads = (content_loss + style_loss * 15.0).backward();
    let expected = channels_last(&golden.f32("grad.output"), 67, 81);
    assert_close(
        "gradient",
        &gradient(&tracked, &grads),
        &wide(&expected),
        1e-4,
    );
}

#[test]
#[should_panic(expected = "sees the image itself")]
fn a_pool_before_the_first_layer_is_refused() {
    let layer = ConvLayer::new(&[0.0; 27], vec![0.0], true, true);
    PerceptualStack::new(vec![layer], 1.0, [0.0; 3]);
}
