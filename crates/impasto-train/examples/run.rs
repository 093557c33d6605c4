#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]
use impasto_train::*;
#[global_allocator]
static A: mimalloc::MiMalloc = mimalloc::MiMalloc;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let mut config = TrainConfig::fast();
    for s in &a[6..] {
        let (k, v) = s.split_once('=').unwrap();
        let mut j = serde_json::to_value(&config).unwrap();
        *j.pointer_mut(&format!("/{}", k.replace('.', "/"))).unwrap() = serde_json::from_str(v).unwrap();
        config = serde_json::from_value(j).unwrap();
    }
    let o = TrainOptions { scene: a[1].clone().into(), output: a[2].clone().into(), styles: Some("../shared/data/styles/train".into()),
        stages: match a[3].as_str() { "all" => Stages::All, "geometry" => Stages::Geometry, _ => Stages::Style },
        config, budget: Budget::Time(std::time::Duration::from_secs_f64(a[4].parse().unwrap())), downscale: a[5].parse().unwrap(), format: None, seed: 1 };
    let mut last = std::time::Instant::now();
    let s = train(&o, &mut |e| {
        let is_step = matches!(e, Event::Step { .. });
        if !is_step || last.elapsed().as_secs() >= 15 { println!("{}", serde_json::to_string(e).unwrap()); last = std::time::Instant::now(); }
    }).unwrap();
    let m = Model::load(&o.output).unwrap();
    println!("occupancy {} {}", m.file.grids.inner.occupancy(), m.file.grids.outer.occupancy());
    println!("{}", serde_json::to_string(&s).unwrap());
}
