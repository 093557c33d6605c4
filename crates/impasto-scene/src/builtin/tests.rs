use super::trace::Thing;
use super::*;

fn small() -> BuiltinOptions {
    BuiltinOptions {
        width: 96,
        height: 72,
        ..BuiltinOptions::default()
    }
}

/// What the pixel's centre shows.
fn meet<'a>(world: &'a World, camera: &Camera, x: f64, y: f64) -> (Thing<'a>, f64) {
    let aim = Aim::new(camera, x, y);
    let (thing, t) = world.meet(aim.origin, aim.direction);
    (thing, f64::from(t) / aim.length)
}

#[test]
fn rendering_twice_gives_the_same_pixels() {
    let camera = cameras(&small())[7];
    let (a, b) = (render(&camera), render(&camera));
    assert_eq!(a.pixels, b.pixels);
    assert_eq!(a.depth, b.depth);
    assert_eq!(a.depth.len(), 96 * 72);
    assert_eq!(depth(&camera), a.depth, "the same without colours");
}

#[test]
fn its_own_capture_is_recognised_whatever_the_lens() {
    let poses = |photos| -> Vec<DMat4> {
        let options = BuiltinOptions { photos, ..small() };
        let cameras = cameras(&options).into_iter();
        cameras.map(|camera| camera.camera_to_world).collect()
    };
    assert!(is_capture(&poses(40)) && is_capture(&poses(3)));
    // Another place, another order, none at all.
    let mut moved = poses(5);
    moved[4].w_axis.x += 1e-3;
    assert!(!is_capture(&moved));
    moved = poses(5);
    moved.swap(1, 2);
    assert!(!is_capture(&moved) && !is_capture(&poses(40)[..39]) && !is_capture(&[]));
}

#[test]
fn cameras_are_rigid_and_keep_their_distance() {
    let all = cameras(&BuiltinOptions::default());
    assert_eq!(all.len(), 40);
    assert!(all[0].intrinsics.height >= 256);
    for camera in &all {
        let r = DMat3::from_mat4(camera.camera_to_world);
        assert!((r * r.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-12));
        assert!((r.determinant() - 1.0).abs() < 1e-12);
        let distance = camera.centre().truncate().length();
        assert!((4.5..8.0).contains(&distance), "{distance}");
        assert!(camera.centre().z > 0.8);
    }
}

/// A surface point of one view lies on the same surface in another, or behind something nearer.
#[test]
fn depth_agrees_between_views() {
    let all = cameras(&small());
    let (view, other) = (render(&all[3]), &all[5]);
    let (mut seen, mut hidden) = (0, 0);
    for y in 0..72u32 {
        for x in 0..96u32 {
            let depth = f64::from(view.depth[(y * 96 + x) as usize]);
            if !depth.is_finite() {
                continue;
            }
            let ray = view.camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let point = ray.origin + ray.direction * depth;
            let Some((at, expected)) = other.project(point) else {
                continue;
            };
            let (_, met) = meet(world(), other, at.x, at.y);
            // A ray that grazes a surface may slip past it by the accuracy of f32.
            if (met - expected).abs() < 2e-3 * expected {
                seen += 1;
            } else if met < expected {
                hidden += 1;
            } else {
                let (_, beside) = meet(world(), other, at.x + 0.02, at.y);
                let (_, before) = meet(world(), other, at.x - 0.02, at.y);
                assert!(
                    beside.min(before) < expected * 1.02,
                    "pixel {x},{y}: {met} instead of {expected}"
                );
            }
        }
    }
    assert!(
        seen > 3 * hidden && seen > 3000,
        "{seen} seen, {hidden} hidden"
    );
}

/// Reprojecting colours with the exact depth reproduces the other photo.
#[test]
fn colours_agree_between_views() {
    let all = cameras(&BuiltinOptions {
        width: 192,
        height: 144,
        ..small()
    });
    let (view, other) = (render(&all[10]), render(&all[11]));
    let mut differences = Vec::new();
    for (index, &depth) in view.depth.iter().enumerate().filter(|(_, d)| d.is_finite()) {
        let (x, y) = (index as u32 % 192, index as u32 / 192);
        let ray = view.camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let Some((at, expected)) = other
            .camera
            .project(ray.origin + ray.direction * f64::from(depth))
        else {
            continue;
        };
        if at.x < 0.0 || at.y < 0.0 || at.x >= 192.0 || at.y >= 144.0 {
            continue;
        }
        let (u, v) = (at.x as u32, at.y as u32);
        if (f64::from(other.depth[(v * 192 + u) as usize]) - expected).abs() > 0.02 * expected {
            continue;
        }
        let (a, b) = (view.pixels.get_pixel(x, y), other.pixels.get_pixel(u, v));
        differences.push(
            (0..3)
                .map(|c| i32::from(a[c]).abs_diff(i32::from(b[c])))
                .sum::<u32>(),
        );
    }
    differences.sort_unstable();
    assert!(differences.len() > 8000, "{}", differences.len());
    let median = differences[differences.len() / 2];
    assert!(
        median <= 24,
        "median difference of the three channels together: {median}"
    );
}

#[test]
fn every_photo_has_statue_near_far_and_sky() {
    let options = BuiltinOptions {
        width: 64,
        height: 48,
        ..BuiltinOptions::default()
    };
    for (index, camera) in cameras(&options).iter().enumerate() {
        let [mut statue, mut middle, mut near, mut far, mut sky] = [0; 5];
        for y in 0..48 {
            for x in 0..64 {
                let (thing, depth) = meet(world(), camera, f64::from(x) + 0.5, f64::from(y) + 0.5);
                let central = (22..42).contains(&x) && (8..36).contains(&y);
                middle += i32::from(central);
                statue += i32::from(central && (matches!(thing, Thing::Statue) || depth < 7.5));
                near += i32::from(depth < 8.0);
                far += i32::from(depth > 20.0 && depth.is_finite());
                sky += i32::from(depth.is_infinite());
            }
        }
        assert!(
            statue * 10 > middle * 3,
            "photo {index}: {statue} of {middle}"
        );
        assert!(
            near > 300 && far > 100 && sky > 60,
            "photo {index}: {near} {far} {sky}"
        );
    }
}

#[test]
fn lens_distortion_bends_the_picture() {
    let mut camera = cameras(&small())[0];
    let straight = render(&camera).pixels;
    camera.intrinsics.distortion.k1 = -0.2;
    let bent = render(&camera).pixels;
    assert_ne!(straight, bent);
    let off =
        |x, y| (0..3).all(|c| straight.get_pixel(x, y)[c].abs_diff(bent.get_pixel(x, y)[c]) < 24);
    assert!(off(48, 36), "the middle stays");
}

#[test]
fn capture_on_disk_holds_the_cameras() {
    let options = BuiltinOptions {
        photos: 3,
        width: 32,
        height: 24,
        ..BuiltinOptions::default()
    };
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path().join("new/capture");
    write_capture(&root, &options).unwrap();
    let text = std::fs::read_to_string(root.join("transforms.json")).unwrap();
    let file: serde_json::Value = serde_json::from_str(&text).unwrap();
    let written = cameras(&options);
    assert_eq!(file["w"], 32);
    assert_eq!(file["fl_x"].as_f64(), Some(written[0].intrinsics.fl_x));
    assert_eq!(file["frames"].as_array().unwrap().len(), 3);
    for (frame, camera) in file["frames"].as_array().unwrap().iter().zip(&written) {
        let rows: [[f64; 4]; 4] =
            serde_json::from_value(frame["transform_matrix"].clone()).unwrap();
        let m = DMat4::from_cols_array_2d(&rows).transpose();
        let back = DMat4::from_cols(m.x_axis, -m.y_axis, -m.z_axis, m.w_axis);
        assert_eq!(back, camera.camera_to_world);
        let photo = image::open(root.join(frame["file_path"].as_str().unwrap()))
            .unwrap()
            .to_rgb8();
        let view = render(camera);
        assert_eq!(photo, view.pixels);
        let npy = std::fs::read(root.join(frame["depth_file_path"].as_str().unwrap())).unwrap();
        assert_eq!(&npy[..6], b"\x93NUMPY");
        let start = 10 + usize::from(u16::from_le_bytes([npy[8], npy[9]]));
        assert_eq!(start % 64, 0);
        let depth: Vec<f32> = npy[start..]
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect();
        assert_eq!(depth, view.depth);
    }
    assert!(
        std::fs::read_to_string(root.join("README.txt"))
            .unwrap()
            .contains("SYNTHETIC")
    );
}

#[test]
fn unwritable_folder_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("occupied");
    std::fs::write(&file, "x").unwrap();
    let message = write_capture(&file, &small()).unwrap_err().to_string();
    assert!(message.contains("occupied"), "{message}");
}

/// The demo goes through the same reader as a real capture, and is known to be synthetic there.
#[test]
fn capture_is_read_like_any_other() {
    let options = BuiltinOptions {
        photos: 9,
        ..small()
    };
    let dir = tempfile::tempdir().unwrap();
    write_capture(dir.path(), &options).unwrap();
    let scene = crate::load(dir.path(), &crate::LoadOptions::default()).unwrap();
    assert_eq!((scene.photos.len(), scene.test().count()), (9, 2));
    assert!(scene.synthetic);
    for (photo, camera) in scene.photos.iter().zip(cameras(&options)) {
        let pose = scene
            .normalisation
            .pose_to_capture(photo.camera.camera_to_world);
        assert!(pose.abs_diff_eq(camera.camera_to_world, 1e-9));
        assert_eq!(photo.camera.intrinsics, camera.intrinsics);
    }
}
