//! The perceptual stack with mirrored borders, and with pools that keep odd ends.

mod common;

use common::convnet::*;
use common::on::perceptual;
use common::*;
use impasto_kernels::{Border, OddEnd, PerceptualStack, ops};
use std::sync::Arc;

/// All but the default, which has its own file of tests.
const MODES: [(Border, OddEnd); 3] = [
    (Border::Mirrored, OddEnd::Kept),
    (Border::Mirrored, OddEnd::Dropped),
    (Border::Zeros, OddEnd::Kept),
];

fn stack_with((border, odd_end): (Border, OddEnd), layers: &[Conv]) -> PerceptualStack {
    stack(layers).bordered(border).ending(odd_end)
}

#[test]
fn equals_its_twin_at_every_parity() {
    let layers = small_vgg(1);
    for modes in MODES {
        let stack = stack_with(modes, &layers);
        for (height, width) in [(16, 16), (17, 16), (18, 23), (31, 17), (45, 38)] {
            let image = numbers(2, height * width * 3, 0.0..1.0);
            let (out, _) = perceptual::forward(&stack, &image, height, width);
            let (expected, _) = twin_with(modes, &layers, &wide(&image), [height, width]);
            let content: usize = stack.content_shape(height, width).iter().product();
            let what = format!("{modes:?}, {width}×{height}");
            assert_eq!(out.len(), content + stack.statistics_len(), "{what}");
            assert_close(&what, &out, &expected, 1e-5);
        }
    }
}

#[test]
fn gradient_equals_the_twins_differences() {
    let layers = small_vgg(3);
    for modes in MODES {
        let stack = stack_with(modes, &layers);
        for (height, width) in [(16, 16), (17, 19)] {
            let image = numbers(4, height * width * 3, 0.0..1.0);
            let (out, tape) = perceptual::forward(&stack, &image, height, width);
            let grad = numbers(5, out.len(), -1.0..1.0);
            let expected = differences(&image, |image| {
                dot64(&twin_with(modes, &layers, image, [height, width]).0, &grad)
            });
            let what = format!("{modes:?}, {width}×{height}");
            assert_close(&what, &perceptual::backward(&tape, &grad), &expected, 1e-4);
        }
    }
}

/// Sizes and channels for which images are filtered in patches, with odd and even sides.
#[test]
fn many_channels_equal_the_twin_forward_and_backward() {
    let layers = wide_stack(21);
    let modes = MODES[0];
    let stack = stack_with(modes, &layers);
    for (height, width) in [(17, 20), (18, 15)] {
        let image = numbers(22, height * width * 3, 0.0..1.0);
        let (out, tape) = perceptual::forward(&stack, &image, height, width);
        let (expected, _) = twin_with(modes, &layers, &wide(&image), [height, width]);
        assert_close("features", &out, &expected, 1e-5);
        let grad = numbers(23, out.len(), -1.0..1.0);
        let found = perceptual::backward(&tape, &grad);
        let size = found.iter().map(|g| g.abs()).fold(0.0, f32::max);
        let loss =
            |image: &[f64]| dot64(&twin_with(modes, &layers, image, [height, width]).0, &grad);
        // The twin is too slow for every pixel; corners and edges gather the most.
        for at in [0, 4, 3 * width + 4, image.len() / 2, image.len() - 4] {
            let moved = |by: f64| {
                let mut image = wide(&image);
                image[at] += by;
                loss(&image)
            };
            let wanted = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!(
                (f64::from(found[at]) - wanted).abs() < 1e-3 * f64::from(size),
                "{width}×{height}, number {at}: {} {wanted}",
                found[at]
            );
        }
    }
}

#[test]
fn operation_has_the_gradient_of_central_differences() {
    let (height, width) = (5, 7);
    let (layers, image) = (0..4000)
        .map(|seed| {
            let layers = random_stack(seed, &[4, 5], &[1], &[0, 1]);
            (layers, numbers(seed + 7, height * width * 3, 0.0..1.0))
        })
        .find(|(layers, image)| twin_with(MODES[0], layers, &wide(image), [height, width]).1 > 0.01)
        .expect("one of the seeds stays off the kinks");
    check_operation(stack_with(MODES[0], &layers), &image, [height, width]);
}

#[test]
fn the_smallest_image_is_what_every_convolution_can_mirror() {
    for (modes, least) in MODES.into_iter().zip([9, 16, 1]) {
        let stack = stack_with(modes, &small_vgg(6));
        assert_eq!(stack.smallest(), least, "{modes:?}");
        let image = numbers(7, least * least * 3, 0.0..1.0);
        let (out, tape) = perceptual::forward(&stack, &image, least, least);
        let (expected, _) = twin_with(modes, &small_vgg(6), &wide(&image), [least, least]);
        assert_close(&format!("{modes:?}"), &out, &expected, 1e-5);
        let grad = perceptual::backward(&tape, &vec![1.0; out.len()]);
        assert!(grad.iter().all(|g| g.is_finite()) && grad.iter().any(|g| *g != 0.0));
    }
    assert_eq!(
        stack_with(MODES[0], &small_vgg(6)).content_shape(9, 17),
        [2, 3, 5]
    );
}

#[test]
#[should_panic(expected = "image of 8×9 is too small for the perceptual stack")]
fn refuses_an_image_one_pixel_too_narrow() {
    let image = tensor(&numbers(8, 9 * 8 * 3, 0.0..1.0), [9, 8, 3]);
    let _ = ops::perceptual(image, Arc::new(stack_with(MODES[0], &small_vgg(6))));
}

#[test]
fn a_poisoned_pixel_shows_and_stays_in_its_neighbourhood() {
    let layers = random_stack(10, &[4, 5, 6], &[1], &[1]);
    let stack = stack_with(MODES[0], &layers);
    let (height, width) = (39, 31);
    let mut image = numbers(11, height * width * 3, 0.0..1.0);
    let (clean, _) = perceptual::forward(&stack, &image, height, width);
    // In a corner, from where borders are mirrored.
    image[0] = f32::NAN;
    let (out, tape) = perceptual::forward(&stack, &image, height, width);
    let [rows, columns, channels] = stack.content_shape(height, width);
    let content = rows * columns * channels;
    assert!(out[content..].iter().all(|v| v.is_nan()));
    assert!(out[..channels].iter().all(|v| v.is_nan()));
    for y in 0..rows {
        for x in 0..columns {
            if y > 3 || x > 3 {
                let own = (y * columns + x) * channels..(y * columns + x + 1) * channels;
                assert_same("a far pixel", &out[own.clone()], &clean[own]);
            }
        }
    }
    let grad = perceptual::backward(&tape, &vec![1.0; out.len()]);
    assert!(grad.iter().any(|g| g.is_nan()), "gradients hide the NaN");
}

#[test]
fn does_not_depend_on_threads() {
    for layers in [small_vgg(12), wide_stack(12)] {
        let stack = stack_with(MODES[0], &layers);
        let (height, width) = (67, 81);
        let image = numbers(13, height * width * 3, 0.0..1.0);
        assert_deterministic("features and gradient", || {
            let (out, tape) = perceptual::forward(&stack, &image, height, width);
            let grad = perceptual::backward(&tape, &numbers(14, out.len(), -1.0..1.0));
            [out, grad].concat()
        });
    }
}
