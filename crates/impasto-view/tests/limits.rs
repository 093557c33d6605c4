//! What clients may not do.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::Ordering;
use std::time::Duration;

use common::{Heard, Page, Setup, Studio, identity};
use impasto_view::Limits;
use serde_json::json;

const SIZE: [u32; 2] = [64, 48];

#[test]
fn a_hundred_pages_at_once_leave_the_studio_standing() {
    let studio = Studio::open();
    let pages: Vec<_> = std::thread::scope(|scope| {
        let pages: Vec<_> = (0..100).map(|_| scope.spawn(|| studio.page())).collect();
        pages.into_iter().map(|page| page.join().unwrap()).collect()
    });
    let (mut served, mut refused) = (Vec::new(), 0);
    for mut page in pages {
        // The refused ones are told so without asking; a write to one that is closed may fail.
        let asked = json!({
            "type": "view", "id": 1, "camera_to_world": identity(), "fov": 50.0, "size": SIZE,
            "moving": false,
        });
        let asked = tokio_tungstenite::tungstenite::Message::text(asked.to_string());
        let _ = page.socket.send(asked);
        match page.hear() {
            Heard::Frame(frame) => {
                assert_eq!(frame.view, 1);
                served.push(page);
            }
            Heard::Text(said) => {
                assert_eq!(said["type"], "problem");
                assert!(
                    said["message"].as_str().unwrap().contains("64 pages"),
                    "{said}"
                );
                assert_eq!(page.end(), Some(1013));
                refused += 1;
            }
            Heard::Closed(code) => panic!("closed without a word: {code:?}"),
        }
    }
    assert_eq!((served.len(), refused), (64, 36));
    assert_eq!(studio.ask("GET", "/api/scene", &[]).status, 200);
    // A place that is free again is given again.
    drop(served.pop());
    let again = (0..200).any(|_| {
        std::thread::sleep(Duration::from_millis(20));
        let mut page = studio.page();
        page.look(2, SIZE, true);
        matches!(page.hear(), Heard::Frame(_))
    });
    assert!(again);
}

#[test]
fn a_page_that_does_not_acknowledge_gets_two_frames_and_no_more() {
    let studio = Studio::open();
    let mut lazy = studio.page();
    let mut other = studio.page();
    for id in 1..50 {
        lazy.look(id, SIZE, true);
        // Others are served meanwhile.
        other.look(id, SIZE, true);
        assert_eq!(other.frame().view, id);
    }
    lazy.say(&json!({"type": "pick", "id": 1, "x": 0.5, "y": 0.9}));
    let mut frames = 0;
    loop {
        match lazy.hear() {
            Heard::Frame(_) => frames += 1,
            Heard::Text(said) => {
                assert_eq!(said["type"], "picked");
                break;
            }
            Heard::Closed(code) => panic!("closed: {code:?}"),
        }
    }
    assert_eq!(frames, 2);
    // It wants the newest view still, and gets it when there is room.
    lazy.acknowledge(2);
    assert_eq!(lazy.frames(49).len(), 1);
    lazy.acknowledge(77);
    assert!(
        lazy.told("problem")["message"]
            .as_str()
            .unwrap()
            .contains("77")
    );
}

#[test]
fn a_page_that_reads_nothing_is_closed() {
    let studio = Studio::limited(Limits {
        reading: Duration::from_millis(300),
        ..Limits::default()
    });
    let mut deaf = studio.page();
    // Large frames, acknowledged unseen, until the system's buffers are full.
    let mut closed = false;
    for id in 1..2000u32 {
        let mut pose = identity();
        pose[12] = f64::from(id) * 0.0001;
        let messages = [
            json!({
                "type": "view", "id": id, "camera_to_world": pose, "fov": 50.0,
                "size": [2048, 2048], "moving": true,
            }),
            json!({"type": "ack", "frame": id / 20}),
        ];
        let sent = messages.iter().all(|message| {
            let message = tokio_tungstenite::tungstenite::Message::text(message.to_string());
            deaf.socket.send(message).is_ok()
        });
        if !sent {
            closed = true;
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(closed, "it was served for ever");
    let mut page = studio.page();
    page.look(1, SIZE, true);
    assert_eq!(page.frame().view, 1);
}

#[test]
fn malformed_messages_are_problems_and_at_last_the_end() {
    let studio = Studio::open();
    let mut page = studio.page();
    for (i, text) in ["", "{", "[]", "null", "{\"type\":\"view\",\"id\":3}"]
        .iter()
        .enumerate()
    {
        page.say_text(text);
        let said = page.told("problem");
        assert!(said["message"].as_str().unwrap().len() > 10);
        assert_eq!(said["id"].as_u64(), (i == 4).then_some(3));
    }
    for (key, value, word) in [
        ("size", json!([0, 0]), "0×0"),
        ("size", json!([5000, 5000]), "5000×5000"),
        ("fov", json!(171), "171"),
        ("fov", json!(1e300), "field of view"),
        ("camera_to_world", json!(vec![0.5; 16]), "pose"),
        ("camera_to_world", json!([1]), "not understood"),
    ] {
        let mut view = json!({
            "type": "view", "id": 4, "camera_to_world": identity(), "fov": 50.0, "size": SIZE,
            "moving": false,
        });
        view[key] = value;
        page.say(&view);
        let said = page.told("problem");
        assert!(said["message"].as_str().unwrap().contains(word), "{said}");
    }
    // A good one is heard, and forgives.
    page.look(5, SIZE, true);
    assert_eq!(page.frame().view, 5);
    for _ in 0..20 {
        page.say_text("nonsense");
    }
    assert_eq!(page.end(), Some(1008));
    assert_eq!(studio.asked.views.load(Ordering::SeqCst), 1);
}

#[test]
fn a_message_that_is_too_large_ends_the_talk() {
    let studio = Studio::open();
    let mut page = studio.page();
    page.say_text(&"x".repeat(70 << 10));
    assert!(
        page.told("problem")["message"]
            .as_str()
            .unwrap()
            .contains("64 KiB")
    );
    assert_eq!(page.end(), Some(1009));
}

#[test]
fn other_pages_and_other_names_are_refused() {
    let studio = Studio::open();
    let own = format!("http://127.0.0.1:{}", studio.address.port());
    let post = |origin: &str| {
        let headers = [("Origin", origin)];
        studio.ask_with("POST", "/api/paintings/random", &headers, &[])
    };
    assert_eq!(post(&own).status, 200);
    for origin in [
        "http://evil.example",
        "null",
        "http://127.0.0.1:1",
        "https://127.0.0.1",
    ] {
        let answer = post(origin);
        assert_eq!(answer.status, 403, "{origin}");
        assert!(answer.error().contains("another page"));
        assert!(Page::open(studio.address, &[("origin", origin)]).is_err());
    }
    assert!(Page::open(studio.address, &[("origin", &own)]).is_ok());
    for host in ["evil.example", "evil.example:80", "192.168.1.1"] {
        let answer = studio.ask_with("GET", "/api/scene", &[("Host", host)], &[]);
        assert_eq!(answer.status, 403, "{host}");
        assert!(answer.error().contains("name"));
    }
    let local = studio.ask_with("GET", "/api/scene", &[("Host", "localhost")], &[]);
    assert_eq!(local.status, 200);
}

#[test]
fn a_token_is_needed_where_others_can_come() {
    let studio = Studio::with(Setup {
        token: true,
        ..Setup::default()
    });
    let (_, token) = studio.link.split_once("?token=").unwrap();
    for path in ["/", "/api/scene", "/api/scene?token=wrong", "/?token="] {
        let answer = studio.ask("GET", path, &[]);
        assert_eq!(answer.status, 401, "{path}");
        assert!(answer.error().contains("token"));
    }
    assert!(Page::open(studio.address, &[]).is_err());
    // The address that is printed leads to the page, and leaves a cookie.
    let answer = studio.ask("GET", &format!("/?token={token}"), &[]);
    assert_eq!(answer.status, 303);
    let cookie = answer.head.split("set-cookie: ").nth(1).unwrap();
    let cookie = cookie.lines().next().unwrap().to_owned();
    assert!(cookie.contains("httponly") && cookie.contains("samesite=strict"));
    let cookie = cookie.split(';').next().unwrap().to_owned();
    let page = studio.ask_with("GET", "/", &[("Cookie", &cookie)], &[]);
    assert_eq!(page.status, 200);
    assert!(!page.head.contains("set-cookie"));
    assert!(Page::open(studio.address, &[("cookie", &cookie)]).is_ok());
    let bearer = format!("Bearer {token}");
    let answer = studio.ask_with("GET", "/api/scene", &[("Authorization", &bearer)], &[]);
    assert_eq!(answer.status, 200);
}

#[test]
fn a_page_may_load_nothing_from_elsewhere() {
    let studio = Studio::open();
    let page = studio.ask("GET", "/", &[]);
    assert!(page.head.contains("content-type: text/html"));
    assert!(page.head.contains("default-src 'self'"), "{}", page.head);
    assert!(!page.head.contains("unsafe"), "{}", page.head);
    for path in ["/api/scene", "/nothing"] {
        let answer = studio.ask("GET", path, &[]);
        assert!(answer.head.contains("x-content-type-options: nosniff"));
    }
    assert!(
        studio
            .ask("GET", "/api/scene", &[])
            .head
            .contains("no-store")
    );
    for file in ["/studio.js", "/studio.css"] {
        assert_eq!(studio.ask("GET", file, &[]).status, 200);
        assert_eq!(studio.ask("POST", file, &[]).status, 405);
    }
    assert_eq!(studio.ask("GET", "/../Cargo.toml", &[]).status, 404);
    assert!(
        studio
            .ask("DELETE", "/api/scene", &[])
            .error()
            .contains("docs/studio.md")
    );
    assert!(
        studio
            .ask("GET", "/api/stream", &[])
            .error()
            .contains("WebSocket")
    );
}

#[test]
fn connections_that_only_wait_are_closed() {
    let studio = Studio::limited(Limits {
        connections: 4,
        head: Duration::from_millis(400),
        ..Limits::default()
    });
    let mut slow: Vec<TcpStream> = (0..4)
        .map(|_| TcpStream::connect(studio.address).unwrap())
        .collect();
    for stream in &mut slow {
        stream.write_all(b"GET /api/scene HTTP/1.1\r\nHos").unwrap();
    }
    // All places are taken, until they are taken away.
    assert_eq!(studio.ask("GET", "/api/scene", &[]).status, 200);
    for stream in &mut slow {
        stream
            .set_read_timeout(Some(Duration::from_secs(60)))
            .unwrap();
        let mut rest = Vec::new();
        // The end, or a reset: not the time that runs out here.
        let timed_out = |e: &std::io::Error| e.kind() == std::io::ErrorKind::WouldBlock;
        assert!(!stream.read_to_end(&mut rest).is_err_and(|e| timed_out(&e)));
    }
}
