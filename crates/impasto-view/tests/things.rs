//! Paintings, favourites, paths, films.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::io::Write;
use std::time::Duration;

use common::{Setup, Studio, identity, png};
use impasto_model::Stop;
use impasto_view::{ExportOrder, FilmOrder, Formats, Limits, Made, Progress, Workshop};
use serde_json::{Value, json};

fn ids(list: &Value) -> Vec<&str> {
    let list = list.as_array().unwrap().iter();
    list.map(|painting| painting["id"].as_str().unwrap())
        .collect()
}

#[test]
fn paintings_come_from_a_folder_from_pages_and_from_chance() {
    let styles = tempfile::tempdir().unwrap();
    std::fs::create_dir(styles.path().join("sub")).unwrap();
    std::fs::write(styles.path().join("b ü.png"), png([9, 99, 199], 400, 200)).unwrap();
    std::fs::write(styles.path().join("sub/a.png"), png([1, 2, 3], 5, 5)).unwrap();
    std::fs::write(styles.path().join("notes.txt"), "none").unwrap();
    let studio = Studio::with(Setup {
        styles: Some(styles.path().to_owned()),
        ..Setup::default()
    });
    let list = studio.ask("GET", "/api/paintings", &[]).json();
    assert_eq!(ids(&list), ["b ü.png", "sub/a.png"]);
    let small = studio.ask("GET", list[0]["thumbnail"].as_str().unwrap(), &[]);
    assert_eq!(small.status, 200);
    let small = image::load_from_memory(&small.body).unwrap().into_rgb8();
    assert_eq!(small.dimensions(), (160, 80));
    assert!(small.get_pixel(80, 40)[2].abs_diff(199) < 4);

    let upload = studio.upload([7, 8, 9]);
    assert!(
        upload.starts_with("upload:") && upload.len() == 23,
        "{upload}"
    );
    // The same again is the same.
    assert_eq!(studio.upload([7, 8, 9]), upload);
    let random = studio.ask("POST", "/api/paintings/random", &[]).json();
    let seed: u64 = random["id"].as_str().unwrap()[7..].parse().unwrap();
    assert!(random["name"].as_str().unwrap().contains("synthetic"));
    assert!(seed < 100_000);
    let list = studio.ask("GET", "/api/paintings", &[]).json();
    assert_eq!(list.as_array().unwrap().len(), 4);
    for painting in list.as_array().unwrap() {
        let small = studio.ask("GET", painting["thumbnail"].as_str().unwrap(), &[]);
        assert!(image::load_from_memory(&small.body).is_ok(), "{painting}");
    }
    for id in [
        "upload:0000000000000000",
        "random:x",
        "saved:../x",
        "../b",
        "%2e%2e/b",
        "",
    ] {
        let answer = studio.ask("GET", &format!("/api/thumbnail?id={id}"), &[]);
        assert!(answer.error().contains("no painting"), "{id}");
    }
    assert_eq!(studio.ask("GET", "/api/thumbnail", &[]).status, 400);
}

/// A PNG of a few kilobytes that says that it has 20,000 × 20,000 pixels.
fn bomb() -> Vec<u8> {
    let mut bytes = png([0; 3], 1000, 1000);
    bytes[16..20].copy_from_slice(&20_000u32.to_be_bytes());
    bytes[20..24].copy_from_slice(&20_000u32.to_be_bytes());
    let sum = crc(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&sum.to_be_bytes());
    bytes
}

fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xEDB8_8320 & 0u32.wrapping_sub(crc & 1))
        })
    })
}

#[test]
fn what_is_no_painting_is_refused() {
    let studio = Studio::open();
    let upload = |bytes: &[u8]| studio.ask("POST", "/api/paintings?name=x.png", bytes);
    let cut = &png([5, 6, 7], 300, 300)[..60];
    for (bytes, word) in [
        (&b"<svg onload=alert(1)>"[..], "no JPEG"),
        (b"", "empty"),
        (cut, "not a usable painting"),
        (&bomb(), "20000×20000"),
        (&[0xFF; 5000], "no JPEG"),
    ] {
        let answer = upload(bytes);
        assert_eq!(answer.status, 415, "{}", answer.text());
        assert!(answer.error().contains(word), "{}", answer.text());
    }
    assert_eq!(studio.ask("GET", "/api/paintings", &[]).json(), json!([]));
    // A name is only shown, never a path.
    let answer = studio.ask(
        "POST",
        "/api/paintings?name=../../a%2Fb.png",
        &png([1; 3], 4, 4),
    );
    assert_eq!(answer.json()["name"], "b.png");
}

#[test]
fn uploads_have_limits() {
    let studio = Studio::limited(Limits {
        upload: 10_000,
        uploads: 3,
        body: Duration::from_millis(300),
        ..Limits::default()
    });
    // By what is announced.
    let answer = studio.ask("POST", "/api/paintings", &vec![0; 10_001]);
    assert_eq!(answer.status, 413);
    assert!(answer.error().contains("9 KiB"), "{}", answer.text());
    // By what comes.
    let mut chunked = std::net::TcpStream::connect(studio.address).unwrap();
    let head =
        "POST /api/paintings HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n";
    chunked.write_all(head.as_bytes()).unwrap();
    for _ in 0..3 {
        // May be refused while it is written.
        let _ = chunked.write_all(format!("1000\r\n{}\r\n", "x".repeat(4096)).as_bytes());
    }
    assert!(first_line(&mut chunked).contains("413"));
    // By time.
    let mut slow = std::net::TcpStream::connect(studio.address).unwrap();
    let head = "POST /api/paintings HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nx";
    slow.write_all(head.as_bytes()).unwrap();
    assert!(first_line(&mut slow).contains("408"));
    // By number.
    for shade in 0..3 {
        studio.upload([shade; 3]);
    }
    let answer = studio.ask("POST", "/api/paintings", &png([9; 3], 8, 8));
    assert_eq!(answer.status, 507);
    assert!(answer.error().contains("no room"));
    assert_eq!(studio.ask("GET", "/api/scene", &[]).status, 200);
}

fn first_line(stream: &mut std::net::TcpStream) -> String {
    use std::io::{BufRead, BufReader};
    stream
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line).unwrap();
    line
}

#[test]
fn favourites_are_saved_with_their_paintings() {
    let studio = Studio::open();
    let upload = studio.upload([200, 30, 40]);
    let coats = json!({"coats": [{
        "paintings": [{"painting": upload, "weight": 1.0}, {"painting": "random:7", "weight": 0.5}],
        "strength": 0.5, "keep": "luminance",
    }]});
    let saved = studio.ask(
        "PUT",
        "/api/favourites/Red%20evening",
        coats.to_string().as_bytes(),
    );
    assert_eq!(saved.status, 200, "{}", saved.text());
    let folder = studio.model.path().join("favourites");
    let text = std::fs::read_to_string(folder.join("Red evening.json")).unwrap();
    let file: Value = serde_json::from_str(&text).unwrap();
    let path = file["coats"][0]["paintings"][0]["painting"]
        .as_str()
        .unwrap();
    assert!(
        path.starts_with("paintings/") && path.ends_with("-a.png"),
        "{path}"
    );
    assert!(folder.join(path).is_file());
    assert_eq!(file["coats"][0]["paintings"][1]["painting"], "random:7");

    let list = studio.ask("GET", "/api/favourites", &[]).json();
    assert_eq!(list[0]["name"], "Red evening");
    let id = list[0]["coats"][0]["paintings"][0]["painting"]
        .as_str()
        .unwrap();
    assert!(id.starts_with("saved:"), "{id}");
    // What is saved can be painted with, and saved again.
    let mut page = studio.page();
    page.coat(4, id);
    assert_eq!(page.told("painted")["id"], 4);
    let again = json!({"coats": list[0]["coats"]}).to_string();
    assert_eq!(
        studio
            .ask("PUT", "/api/favourites/b", again.as_bytes())
            .status,
        200
    );
    assert_eq!(
        std::fs::read_dir(folder.join("paintings")).unwrap().count(),
        1
    );

    assert_eq!(
        studio
            .ask("DELETE", "/api/favourites/Red%20evening", &[])
            .status,
        200
    );
    assert_eq!(
        studio
            .ask("DELETE", "/api/favourites/Red%20evening", &[])
            .status,
        404
    );
    let list = studio.ask("GET", "/api/favourites", &[]).json();
    assert_eq!(list.as_array().unwrap().len(), 1);
}

#[test]
fn favourites_stay_in_their_folder() {
    let studio = Studio::open();
    let good = json!({"coats": []}).to_string();
    for name in [
        "..%2Fx",
        "%2E%2E",
        "a%2Fb",
        "a%5Cb",
        "x.json",
        "%00",
        &"x".repeat(65),
    ] {
        let answer = studio.ask("PUT", &format!("/api/favourites/{name}"), good.as_bytes());
        assert_eq!(answer.status, 400, "{name}: {}", answer.text());
        assert!(answer.error().contains("cannot be called"), "{name}");
        let answer = studio.ask("DELETE", &format!("/api/favourites/{name}"), &[]);
        assert_eq!(answer.status, 400, "{name}");
    }
    for (body, word) in [
        ("{", "not understood"),
        (r#"{"coats": [{"paintings": []}]}"#, "paintings"),
        (
            r#"{"coats": [{"paintings": [{"painting": "x"}], "strength": 2}]}"#,
            "strength",
        ),
        (
            r#"{"coats": [{"paintings": [{"painting": "../../etc/passwd"}]}]}"#,
            "no painting",
        ),
    ] {
        let answer = studio.ask("PUT", "/api/favourites/a", body.as_bytes());
        assert_eq!(answer.status, 400, "{body}");
        assert!(answer.error().contains(word), "{body}: {}", answer.text());
    }
    assert!(!studio.model.path().join("favourites/a.json").exists());
    assert_eq!(
        std::fs::read_dir(studio.model.path().parent().unwrap())
            .unwrap()
            .flatten()
            .filter(|entry| entry.file_name() == "x.json")
            .count(),
        0
    );
}

fn keyframes(seconds: f64) -> Value {
    let key = |i: u32| {
        let mut pose = identity();
        pose[12] = f64::from(i);
        json!({"camera_to_world": pose, "fov": 50.0})
    };
    json!({
        "keyframes": (0..3).map(key).collect::<Vec<_>>(), "seconds": seconds, "fps": 10,
        "closed": false, "size": [64, 48],
    })
}

#[test]
fn keyframes_become_a_camera_path() {
    let studio = Studio::open();
    let answer = studio.ask("POST", "/api/path", keyframes(2.0).to_string().as_bytes());
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert!(
        answer
            .head
            .contains("attachment; filename=\"camera_path.json\"")
    );
    let path = answer.json();
    assert_eq!(path["camera_path"].as_array().unwrap().len(), 20);
    assert_eq!(path["keyframes"].as_array().unwrap().len(), 3);
    assert_eq!(path["render_width"], 64);
    // Row by row, OpenGL axes.
    let last = &path["camera_path"][19]["camera_to_world"];
    assert!((last[3].as_f64().unwrap() - 2.0).abs() < 1e-6, "{last}");
    assert!((last[5].as_f64().unwrap() + 1.0).abs() < 1e-6, "{last}");
    for (seconds, word) in [(0.0, "no film"), (1e9, "no film"), (-1.0, "no film")] {
        let answer = studio.ask(
            "POST",
            "/api/path",
            keyframes(seconds).to_string().as_bytes(),
        );
        assert!(answer.error().contains(word), "{}", answer.text());
    }
}

/// Makes files of one line, as long as it is let.
struct Bench;

impl Workshop for Bench {
    fn formats(&self) -> Formats {
        Formats {
            films: vec!["gif".into(), "png".into()],
            exports: vec!["points".into()],
        }
    }

    fn film(&mut self, order: &FilmOrder, progress: Progress<'_>, stop: &Stop) -> Made {
        // `png` never ends by itself.
        while order.format == "png" && !stop.is_requested() {
            progress(0.5);
            std::thread::sleep(Duration::from_millis(5));
        }
        let path = order.folder.join("film.gif");
        let (name, picture) = &order.paint.paintings[0];
        let said = format!("{} {name} {}", order.cameras.len(), picture.width());
        std::fs::write(&path, said).unwrap();
        Ok(path)
    }

    fn export(&mut self, _: &ExportOrder, _: Progress<'_>, _: &Stop) -> Made {
        Err("no surface was found".into())
    }
}

fn wait(studio: &Studio, job: &Value, wanted: &str) -> Value {
    for _ in 0..3000 {
        let state = studio.ask("GET", &format!("/api/jobs/{job}"), &[]).json();
        if state["state"] == wanted {
            return state;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("job {job} is never {wanted}");
}

#[test]
#[allow(clippy::too_many_lines, reason = "one story, step by step")]
fn films_are_made_one_after_the_other() {
    let studio = Studio::with(Setup {
        workshop: Box::new(Bench),
        ..Setup::default()
    });
    let formats = studio.ask("GET", "/api/formats", &[]).json();
    assert_eq!(
        formats,
        json!({"films": ["gif", "png"], "exports": ["points"]})
    );
    let upload = studio.upload([1, 2, 3]);
    let order = |format: &str| {
        let order = json!({
            "path": keyframes(1.0), "size": [32, 32], "format": format, "side_by_side": true,
            "coats": [{"paintings": [{"painting": upload}]}],
        });
        studio.ask("POST", "/api/films", order.to_string().as_bytes())
    };
    let job = order("gif").json()["job"].clone();
    let done = wait(&studio, &job, "done");
    let file = studio.ask("GET", done["file"].as_str().unwrap(), &[]);
    assert_eq!(file.text(), format!("10 {upload} 8"));
    assert!(
        file.head.contains("attachment; filename=\"film.gif\""),
        "{}",
        file.head
    );

    let endless = order("png").json()["job"].clone();
    wait(&studio, &endless, "running");
    let waiting: Vec<Value> = (0..8).map(|_| order("gif").json()["job"].clone()).collect();
    let refused = order("gif");
    assert!(
        refused.error().contains("waiting already"),
        "{}",
        refused.text()
    );
    assert_eq!(wait(&studio, &waiting[7], "waiting")["progress"], 0.0);
    // Whoever looks is served meanwhile.
    let mut page = studio.page();
    page.look(1, [64, 48], false);
    page.frames(1);
    assert_eq!(
        studio
            .ask("DELETE", &format!("/api/jobs/{endless}"), &[])
            .status,
        200
    );
    assert_eq!(
        studio
            .ask("GET", &format!("/api/jobs/{endless}"), &[])
            .status,
        404
    );
    wait(&studio, &waiting[7], "done");

    assert!(order("mkv").error().contains("gif, png"));
    let export = json!({"coats": [], "kind": "points"}).to_string();
    let job = studio.ask("POST", "/api/exports", export.as_bytes()).json()["job"].clone();
    let failed = wait(&studio, &job, "failed");
    assert_eq!(failed["error"], "no surface was found");
    for path in [
        "/api/jobs/99",
        "/api/jobs/x",
        "/api/jobs/..%2F1",
        "/api/jobs/99/file",
    ] {
        assert_eq!(studio.ask("GET", path, &[]).status, 404, "{path}");
    }
}
