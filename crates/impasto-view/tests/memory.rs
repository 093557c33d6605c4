//! Memory while a hundred clients take files and give none of it back: a test of its own process, whose
//! memory is looked at.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use common::{Setup, Studio, png};
use impasto_model::Stop;
use impasto_view::{ExportOrder, FilmOrder, Formats, Made, Progress, Workshop};
use serde_json::{Value, json};
use std::fs::File;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Bytes of the film.
const FILM: u64 = 1 << 28;
const CLIENTS: usize = 100;
/// Bytes that a hundred of them may cost.
const MOST: u64 = 1 << 27;

/// Makes one film, a long one that takes no place on the disk.
struct LongFilm;

impl Workshop for LongFilm {
    fn formats(&self) -> Formats {
        Formats {
            films: vec!["mp4".into()],
            exports: Vec::new(),
        }
    }

    fn film(&mut self, order: &FilmOrder, _: Progress<'_>, _: &Stop) -> Made {
        let path = order.folder.join("film.mp4");
        File::create(&path).unwrap().set_len(FILM).unwrap();
        Ok(path)
    }

    fn export(&mut self, _: &ExportOrder, _: Progress<'_>, _: &Stop) -> Made {
        Err("there is nothing to export".into())
    }
}

/// Bytes of this process that are in memory.
fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    let kibibytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kibibytes << 10)
}

fn film(studio: &Studio) -> String {
    let keyframe = json!({"camera_to_world": common::identity(), "fov": 50.0});
    let path = json!({
        "keyframes": [keyframe, keyframe], "seconds": 1.0, "fps": 10, "closed": false,
        "size": [32, 32],
    });
    let order = json!({
        "path": path, "size": [32, 32], "format": "mp4", "side_by_side": false, "coats": [],
    });
    let answer = studio.ask("POST", "/api/films", order.to_string().as_bytes());
    assert_eq!(answer.status, 200, "{}", answer.text());
    let job = answer.json()["job"].clone();
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(60) {
        let state: Value = studio.ask("GET", &format!("/api/jobs/{job}"), &[]).json();
        if state["state"] == "done" {
            return state["file"].as_str().unwrap().to_owned();
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("the film is never done");
}

/// Asks for a file and takes in its first bytes.
fn begin(studio: &Studio, file: &str) -> TcpStream {
    let mut stream = TcpStream::connect(studio.address).unwrap();
    let patience = Some(Duration::from_secs(60));
    stream.set_read_timeout(patience).unwrap();
    let host = studio.address;
    let request = format!("GET {file} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let mut head = [0; 1024];
    stream.read_exact(&mut head).unwrap();
    let head = String::from_utf8_lossy(&head).to_lowercase();
    assert!(head.starts_with("http/1.1 200"), "{head}");
    assert!(head.contains(&format!("content-length: {FILM}")), "{head}");
    stream
}

#[test]
fn a_hundred_slow_readers_of_a_large_file_take_little_memory() {
    let bomb = png([9, 9, 9], 8000, 8000);
    let Some(before) = resident() else {
        println!("skipped: this system does not say how much memory a process takes");
        return;
    };
    let studio = Studio::with(Setup {
        workshop: Box::new(LongFilm),
        ..Setup::default()
    });
    let file = film(&studio);
    let mut clients: Vec<TcpStream> = (0..CLIENTS).map(|_| begin(&studio, &file)).collect();
    // Others are served meanwhile, and what they send in vain is not kept either.
    for _ in 0..20 {
        let refused = studio.ask("POST", "/api/paintings?name=a.png", &bomb);
        assert!(refused.status >= 400, "{}", refused.status);
    }
    let most = resident().unwrap();
    assert!(
        most < before + MOST,
        "{CLIENTS} downloads took {} MiB",
        (most - before) >> 20
    );
    // Who reads on gets all of it.
    let mut last = clients.pop().unwrap();
    let (mut read, mut piece) = (0, vec![0; 1 << 16]);
    while let Ok(count) = last.read(&mut piece) {
        read += count as u64;
        // The head's bytes are among the first thousand.
        if count == 0 || read >= FILM {
            break;
        }
    }
    assert!(read > FILM - 1024, "{read} of {FILM} bytes");
}
