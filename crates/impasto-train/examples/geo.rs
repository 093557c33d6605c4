use impasto_train::{budget::*, config::*, geometry_stage::*, rays::CameraRays};
use std::time::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let scene = impasto_scene::load(std::path::Path::new(&a[1]), &impasto_scene::LoadOptions { downscale: a[2].parse().unwrap(), ..Default::default() }).unwrap();
    let mut config = TrainConfig::fast();
    for s in &a[4..] {
        let (k, v) = s.split_once('=').unwrap();
        let mut j = serde_json::to_value(&config).unwrap();
        *j.pointer_mut(&k.replace('.', "/").replacen("", "/", 1)).unwrap() = serde_json::from_str(v).unwrap();
        config = serde_json::from_value(j).unwrap();
    }
    let t0 = Instant::now();
    let mut stage = GeometryStage::new(&scene, &config, 1, &burn::tensor::Device::flex());
    println!("init {:?} photos {} points {}", t0.elapsed(), scene.photos.len(), scene.points.len());
    let mut clock = Clock::start(Budget::Time(Duration::from_secs_f64(a[3].parse().unwrap())));
    let (mut ema, mut rays, mut last) = (0.0, 0, Instant::now());
    while !clock.is_over() {
        let r = stage.step(&clock);
        clock.steps += 1; rays += r.rays;
        ema = if clock.steps == 1 { r.loss } else { 0.95 * ema + 0.05 * r.loss };
        if last.elapsed().as_secs_f32() > 10.0 {
            let (_, g, _) = stage.snapshot();
            println!("{:6.1}s step {} psnr {:.2} rays/step {} rays/s {:.0} occ {:.3} {:.3}", clock.seconds(), clock.steps, -10.0 * ema.log10(), r.rays, rays as f64 / clock.seconds(), g.inner.occupancy(), g.outer.occupancy());
            last = Instant::now();
        }
    }
    let mut sum = 0.0; let mut n = 0;
    for (i, p) in scene.test() {
        let rays = CameraRays::new(&p.camera, None);
        let t = Instant::now();
        let px = render_photo(&stage, &rays.all());
        let mse: f64 = px.iter().zip(p.pixels.as_raw()).map(|(a, b)| (*a as f64 - *b as f64 / 255.0).powi(2)).sum::<f64>() / px.len() as f64;
        println!("{} psnr {:.2} {:?}", p.name, -10.0 * mse.log10(), t.elapsed());
        sum += -10.0 * mse.log10(); n += 1;
        let (w, h) = rays.size();
        let mut img = image::RgbImage::new(w as u32 * 2, h as u32);
        for y in 0..h { for x in 0..w { for c in 0..3 {
            img.get_pixel_mut(x as u32, y as u32)[c] = (px[(y * w + x) * 3 + c] * 255.0 + 0.5) as u8;
            img.get_pixel_mut((x + w) as u32, y as u32)[c] = p.pixels.get_pixel(x as u32, y as u32)[c];
        }}}
        img.save(format!("/tmp/geo_{i}.png")).unwrap();
    }
    println!("mean {:.3}", sum / n as f64);
}
