//! The studio as its users open it: the command, a page, a socket, and Ctrl-C.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use common::{capture, command, impasto};
use serde_json::{Value, json};

/// Longer than anything here takes, however busy the machine.
const PATIENCE: Duration = Duration::from_secs(120);
const HEAD: usize = 32;

/// A capture and a model of it that trains in a second.
fn model() -> tempfile::TempDir {
    let folder = capture();
    let trained = impasto(
        folder.path(),
        "train scene -o model --stage geometry --steps 2 --device cpu --set geometry.samples=20000",
    );
    assert!(trained.status.success(), "{trained:?}");
    folder
}

/// A running studio; killed when it is dropped.
struct Studio {
    child: Child,
    address: String,
}

impl Studio {
    fn open(folder: &Path, arguments: &str) -> Self {
        let mut child = command(folder, arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut told = BufReader::new(child.stderr.as_mut().unwrap());
        let mut line = String::new();
        while !line.contains("http://") {
            line.clear();
            assert!(told.read_line(&mut line).unwrap() > 0, "no address");
        }
        let address = line.split("http://").nth(1).unwrap();
        Self {
            address: address.split('/').next().unwrap().to_owned(),
            child,
        }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    fn get(&self, path: &str) -> Value {
        let mut stream = self.connect();
        let host = &self.address;
        let asked = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        stream.write_all(asked.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        assert!(head.starts_with("HTTP/1.1 200"), "{head}");
        serde_json::from_str(body).unwrap()
    }

    /// Sends one message over a socket and returns the first binary one that comes back.
    fn frame(&self, message: &Value) -> Vec<u8> {
        let mut stream = self.connect();
        let host = &self.address;
        let asked = format!(
            "GET /api/stream HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\n\
             Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
        );
        stream.write_all(asked.as_bytes()).unwrap();
        let mut stream = BufReader::new(stream);
        let mut line = String::new();
        stream.read_line(&mut line).unwrap();
        assert!(line.contains("101"), "{line}");
        while !line.trim().is_empty() {
            line.clear();
            stream.read_line(&mut line).unwrap();
        }
        // Text, masked with zeros, its length in two bytes.
        let text = message.to_string();
        let mut bytes = vec![0x81, 0x80 | 126];
        bytes.extend(u16::try_from(text.len()).unwrap().to_be_bytes());
        bytes.extend([0; 4]);
        bytes.extend(text.as_bytes());
        stream.get_mut().write_all(&bytes).unwrap();
        loop {
            let mut head = [0; 2];
            stream.read_exact(&mut head).unwrap();
            let mut long = [0; 8];
            let extra = match head[1] {
                126 => 2,
                127 => 8,
                _ => 0,
            };
            stream.read_exact(&mut long[8 - extra..]).unwrap();
            let length = match extra {
                0 => u64::from(head[1]),
                _ => u64::from_be_bytes(long),
            };
            let mut body = vec![0; usize::try_from(length).unwrap()];
            stream.read_exact(&mut body).unwrap();
            if head[0] == 0x82 {
                return body;
            }
        }
    }
}

impl Drop for Studio {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_model_is_shown_until_the_studio_is_closed() {
    let folder = model();
    let folder = folder.path();
    let mut studio = Studio::open(folder, "view model --port 0 --device cpu --json");
    let scene = studio.get("/api/scene");
    assert_eq!(
        (&scene["synthetic"], &scene["styled"]),
        (&json!(true), &json!(true))
    );
    let photo = &scene["photos"][0];
    let frame = studio.frame(&json!({
        "type": "view", "id": 3, "camera_to_world": photo["camera_to_world"], "fov": photo["fov"],
        "size": [40, 30], "moving": true,
    }));
    assert_eq!(frame[4..8], 3u32.to_le_bytes());
    assert_eq!(frame[24..26], [u8::from(frame[24] != 0) * 2, 1]);
    let picture = image::load_from_memory(&frame[HEAD..]).unwrap();
    assert!(picture.width() >= 1 && picture.width() <= 40);

    // The port is taken now.
    let port = studio.address.rsplit(':').next().unwrap();
    let second = impasto(folder, &format!("view model --device cpu --port {port}"));
    assert_eq!(second.status.code(), Some(1));
    let said = String::from_utf8_lossy(&second.stderr).into_owned();
    assert!(
        said.contains("is taken") && said.contains("--port"),
        "{said}"
    );

    #[cfg(unix)]
    {
        let number = studio.child.id().to_string();
        let interrupted = Command::new("kill").args(["-INT", &number]).status();
        assert!(interrupted.unwrap().success());
        let status = studio.child.wait().unwrap();
        assert!(status.success(), "{status}");
        let mut result = String::new();
        let mut stdout = studio.child.stdout.take().unwrap();
        stdout.read_to_string(&mut result).unwrap();
        let result: Value = serde_json::from_str(&result).unwrap();
        assert_eq!(result["address"], studio.address.as_str());
    }
}

#[test]
fn what_cannot_be_shown_is_refused_and_what_is_coming_is_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir(folder.join("model")).unwrap();
    let refused = |arguments: &str, word: &str| {
        let output = impasto(folder, arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(word), "{said}");
    };
    refused("view nowhere --device cpu", "nowhere");
    refused("view model --device cpu", "no model");
    std::fs::write(folder.join("model/log.jsonl"), "").unwrap();
    refused(
        "view model --device cpu --port 0 --styles none",
        "style folder none",
    );
    // An address of documentation, which no machine has.
    refused(
        "view model --device cpu --port 0 --host 192.0.2.1",
        "cannot listen on 192.0.2.1",
    );
    let studio = Studio::open(folder, "view model --device cpu --port 0");
    assert_eq!(
        studio.get("/api/scene"),
        json!({"waiting": true, "name": "model"})
    );
}
