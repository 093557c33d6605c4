//! A studio with a painter that needs no model, and pages that talk with it.

#![allow(
    dead_code,
    clippy::unwrap_used,
    missing_docs,
    reason = "each test file uses a part; a failure here is a failed test"
)]

use std::io::{Cursor, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use image::{ImageFormat, Rgb, RgbImage};
use impasto_model::{ModelPhoto, Stop, StyleLayers};
use impasto_scene::{Camera, Normalisation, Split};
use impasto_view::{
    ExportOrder, FilmOrder, Formats, Limits, Made, Opening, Painter, Pictures, Progress,
    SceneFacts, Server, ViewGeometry, ViewOptions, Workshop,
};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::protocol::Message;
use tokio_tungstenite::tungstenite::{self, WebSocket};

/// Longer than anything here takes, however busy the machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// How often the painter was asked, and how long it takes for a view.
#[derive(Debug, Default)]
pub struct Asked {
    pub views: AtomicUsize,
    pub paints: AtomicUsize,
    pub mixes: AtomicUsize,
    pub milliseconds: AtomicU64,
}

/// Paints gradients, or the mean colour of the first painting.
pub struct StandIn {
    pub asked: Arc<Asked>,
    pub name: &'static str,
}

/// A workshop that makes nothing.
pub struct NoWorkshop;

impl Workshop for NoWorkshop {
    fn formats(&self) -> Formats {
        Formats::default()
    }

    fn film(&mut self, _: &FilmOrder, _: Progress<'_>, _: &Stop) -> Made {
        Err("films cannot be made here".into())
    }

    fn export(&mut self, _: &ExportOrder, _: Progress<'_>, _: &Stop) -> Made {
        Err("exports cannot be made here".into())
    }
}

pub struct Flat {
    size: (u32, u32),
    depth: Vec<f32>,
}

impl ViewGeometry for Flat {
    fn depth(&self) -> &[f32] {
        &self.depth
    }

    fn bytes(&self) -> usize {
        4 * self.depth.len()
    }
}

pub fn identity() -> [f64; 16] {
    std::array::from_fn(|i| f64::from(u8::from(i % 5 == 0)))
}

impl Painter for StandIn {
    type Geometry = Flat;
    type Paint = Rgb<u8>;

    fn facts(&self) -> SceneFacts {
        let camera = Camera::viewpoint(&identity(), 50.0, (64, 48)).unwrap();
        SceneFacts {
            name: self.name.into(),
            synthetic: true,
            styled: true,
            normalisation: Normalisation::IDENTITY,
            photos: vec![ModelPhoto {
                name: "0.png".into(),
                split: Split::Train,
                camera,
            }],
        }
    }

    fn view(&self, camera: &Camera) -> Flat {
        self.asked.views.fetch_add(1, Ordering::SeqCst);
        let milliseconds = self.asked.milliseconds.load(Ordering::SeqCst);
        std::thread::sleep(Duration::from_millis(milliseconds));
        let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
        // The upper half is sky.
        let depth = (0..height).flat_map(|row| {
            let ray = camera.ray(0.5, f64::from(row) + 0.5);
            let depth = if ray.direction.y < 0.0 {
                f32::INFINITY
            } else {
                2.0
            };
            (0..width).map(move |_| depth)
        });
        Flat {
            size: (width, height),
            depth: depth.collect(),
        }
    }

    fn paint(&self, view: &Flat, paint: Option<&Rgb<u8>>) -> Vec<f32> {
        self.asked.paints.fetch_add(1, Ordering::SeqCst);
        let (width, height) = view.size;
        let colour = |x: u32, y: u32| match paint {
            Some(rgb) => rgb.0.map(|c| f32::from(c) / 255.0),
            // What compresses badly, for those who count bytes.
            None if width > 1000 => {
                let noise = (x * x * 31 + y * y * 57 + x * y) % 251;
                [noise as f32 / 250.0; 3]
            }
            None => [x as f32 / width as f32, y as f32 / height as f32, 0.5],
        };
        (0..height)
            .flat_map(|y| (0..width).flat_map(move |x| colour(x, y)))
            .collect()
    }

    fn mix(&mut self, coats: &StyleLayers, pictures: Pictures<'_>) -> Result<Rgb<u8>, String> {
        self.asked.mixes.fetch_add(1, Ordering::SeqCst);
        let painting = &coats.coats[0].paintings[0].painting;
        Ok(*pictures(painting)?.get_pixel(0, 0))
    }
}

/// An open studio; closed when it is dropped.
pub struct Studio {
    pub address: SocketAddr,
    pub link: String,
    pub asked: Arc<Asked>,
    pub model: TempDir,
    pub scratch: TempDir,
    stop: Stop,
    thread: Option<JoinHandle<()>>,
}

/// What a studio is opened with.
pub struct Setup {
    pub limits: Limits,
    pub token: bool,
    pub styles: Option<PathBuf>,
    pub workshop: Box<dyn Workshop>,
    pub waiting: bool,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            limits: Limits::default(),
            token: false,
            styles: None,
            workshop: Box::new(NoWorkshop),
            waiting: false,
        }
    }
}

impl Studio {
    pub fn open() -> Self {
        Self::with(Setup::default())
    }

    pub fn limited(limits: Limits) -> Self {
        Self::with(Setup {
            limits,
            ..Setup::default()
        })
    }

    pub fn with(setup: Setup) -> Self {
        let model = tempfile::tempdir().unwrap();
        let scratch = tempfile::tempdir().unwrap();
        let server = Server::bind(ViewOptions {
            address: Ipv4Addr::LOCALHOST.into(),
            port: 0,
            token: setup.token,
            styles: setup.styles,
            model: model.path().to_owned(),
            scratch: scratch.path().to_owned(),
            limits: setup.limits,
        })
        .unwrap();
        let (address, link) = (server.address(), server.link());
        let asked = Arc::new(Asked::default());
        let stand_in = |name| {
            let asked = asked.clone();
            move || StandIn {
                asked: asked.clone(),
                name,
            }
        };
        let again = stand_in("again");
        let opening = Opening {
            first: (!setup.waiting).then(stand_in("stand-in")),
            again: Box::new(move || Ok(again())),
        };
        let stop = Stop::default();
        let stopped = stop.clone();
        let workshop = setup.workshop;
        let thread = std::thread::spawn(move || server.run(opening, workshop, &stopped).unwrap());
        Self {
            address,
            link,
            asked,
            model,
            scratch,
            stop,
            thread: Some(thread),
        }
    }

    /// Asks something and reads the whole answer.
    pub fn ask(&self, method: &str, path: &str, body: &[u8]) -> Answer {
        self.ask_with(method, path, &[], body)
    }

    pub fn ask_with(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: &[u8],
    ) -> Answer {
        let own = format!("127.0.0.1:{}", self.address.port());
        let host = headers.iter().find(|(name, _)| *name == "Host");
        let host = host.map_or(own.as_str(), |(_, host)| host);
        let length = body.len();
        let mut head = format!(
            "{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\nContent-Length: {length}\r\n"
        );
        for (name, value) in headers.iter().filter(|(name, _)| *name != "Host") {
            head += &format!("{name}: {value}\r\n");
        }
        head += "\r\n";
        let mut stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.write_all(head.as_bytes()).unwrap();
        // A refusal may come before the body is taken.
        let _ = stream.write_all(body);
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        Answer::of(&bytes)
    }

    /// Uploads a picture of one colour; its id.
    pub fn upload(&self, colour: [u8; 3]) -> String {
        let answer = self.ask("POST", "/api/paintings?name=a.png", &png(colour, 8, 8));
        assert_eq!(answer.status, 200, "{}", answer.text());
        answer.json()["id"].as_str().unwrap().to_owned()
    }

    pub fn page(&self) -> Page {
        Page::open(self.address, &[]).unwrap()
    }
}

impl Drop for Studio {
    fn drop(&mut self) {
        self.stop.request();
        let closed = self.thread.take().unwrap().join();
        if !std::thread::panicking() {
            closed.unwrap();
        }
    }
}

/// An answer of the server.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    fn of(bytes: &[u8]) -> Self {
        let end = bytes.windows(4).position(|four| four == b"\r\n\r\n");
        let end = end.unwrap_or_else(|| panic!("no head in {} bytes", bytes.len()));
        let head = String::from_utf8_lossy(&bytes[..end]).to_lowercase();
        Self {
            status: head.split(' ').nth(1).unwrap().parse().unwrap(),
            head,
            body: bytes[end + 4..].to_vec(),
        }
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }

    /// The refusal's sentence.
    pub fn error(&self) -> String {
        assert!(self.status >= 400, "{self:?}");
        self.json()["error"].as_str().unwrap().to_owned()
    }
}

pub fn png(colour: [u8; 3], width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    RgbImage::from_pixel(width, height, Rgb(colour))
        .write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png)
        .unwrap();
    bytes
}

/// Something that a page heard.
#[derive(Debug)]
pub enum Heard {
    Frame(Frame),
    Text(Value),
    Closed(Option<u16>),
}

#[derive(Debug)]
pub struct Frame {
    pub number: u32,
    pub view: u32,
    pub coats: u32,
    /// x, y, width, height, in the view's pixels.
    pub place: [u16; 4],
    pub size: [u16; 2],
    pub level: u8,
    pub last: bool,
    pub picture: RgbImage,
}

impl Frame {
    fn of(bytes: &[u8]) -> Self {
        let long = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let short = |at: usize| u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap());
        Self {
            number: long(0),
            view: long(4),
            coats: long(8),
            place: [12, 14, 16, 18].map(short),
            size: [20, 22].map(short),
            level: bytes[24],
            last: bytes[25] == 1,
            picture: image::load_from_memory(&bytes[32..]).unwrap().into_rgb8(),
        }
    }
}

/// A page's side of the socket.
pub struct Page {
    pub socket: WebSocket<TcpStream>,
}

impl Page {
    pub fn open(
        address: SocketAddr,
        headers: &[(&'static str, &str)],
    ) -> Result<Self, Box<tungstenite::Error>> {
        let mut request = format!("ws://127.0.0.1:{}/api/stream", address.port())
            .into_client_request()
            .unwrap();
        for (name, value) in headers {
            request.headers_mut().insert(*name, value.parse().unwrap());
        }
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.set_write_timeout(Some(PATIENCE)).unwrap();
        match tungstenite::client(request, stream) {
            Ok((socket, _)) => Ok(Self { socket }),
            Err(tungstenite::HandshakeError::Failure(error)) => Err(Box::new(error)),
            Err(tungstenite::HandshakeError::Interrupted(_)) => {
                panic!("the handshake took too long")
            }
        }
    }

    pub fn say(&mut self, message: &Value) {
        self.say_text(&message.to_string());
    }

    pub fn say_text(&mut self, text: &str) {
        self.socket.send(Message::text(text)).unwrap();
    }

    /// Looks from a place that `id` decides.
    pub fn look(&mut self, id: u32, size: [u32; 2], moving: bool) {
        let mut pose = identity();
        pose[12] = f64::from(id) * 0.01;
        self.look_from(id, pose, size, moving);
    }

    pub fn look_from(&mut self, id: u32, pose: [f64; 16], size: [u32; 2], moving: bool) {
        self.say(&json!({
            "type": "view", "id": id, "camera_to_world": pose, "fov": 50.0, "size": size,
            "moving": moving,
        }));
    }

    pub fn coat(&mut self, id: u32, painting: &str) {
        self.say(&json!({
            "type": "coats", "id": id, "coats": [{"paintings": [{"painting": painting}]}],
        }));
    }

    /// What comes next; a frame is not acknowledged.
    pub fn hear(&mut self) -> Heard {
        loop {
            match self.socket.read() {
                Ok(Message::Binary(bytes)) => return Heard::Frame(Frame::of(&bytes)),
                Ok(Message::Text(text)) => {
                    return Heard::Text(serde_json::from_str(&text).unwrap());
                }
                Ok(Message::Close(frame)) => {
                    return Heard::Closed(frame.map(|frame| frame.code.into()));
                }
                Ok(_) => {}
                Err(tungstenite::Error::Io(error))
                    if error.kind() == std::io::ErrorKind::WouldBlock =>
                {
                    panic!("nothing was said");
                }
                Err(_) => return Heard::Closed(None),
            }
        }
    }

    /// The next frame, acknowledged.
    pub fn frame(&mut self) -> Frame {
        loop {
            if let Heard::Frame(frame) = self.hear() {
                self.acknowledge(frame.number);
                return frame;
            }
        }
    }

    pub fn acknowledge(&mut self, frame: u32) {
        self.say(&json!({"type": "ack", "frame": frame}));
    }

    /// All frames up to the last one of a view.
    pub fn frames(&mut self, view: u32) -> Vec<Frame> {
        let mut frames = Vec::new();
        while frames
            .last()
            .is_none_or(|frame: &Frame| !(frame.last && frame.view == view))
        {
            frames.push(self.frame());
        }
        frames
    }

    /// The next message of a type; frames are acknowledged.
    pub fn told(&mut self, kind: &str) -> Value {
        loop {
            match self.hear() {
                Heard::Text(text) if text["type"] == kind => return text,
                Heard::Text(_) => {}
                Heard::Frame(frame) => self.acknowledge(frame.number),
                Heard::Closed(code) => panic!("closed with {code:?}"),
            }
        }
    }

    /// Waits for the end.
    pub fn end(&mut self) -> Option<u16> {
        loop {
            if let Heard::Closed(code) = self.hear() {
                return code;
            }
        }
    }
}
