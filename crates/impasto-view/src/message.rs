//! What page and server say to each other over the socket.

use impasto_model::{StyleLayerSpec, StyleLayers};
use impasto_scene::Camera;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::path::check_size;

/// Largest message of a page, in bytes.
pub(crate) const LARGEST: usize = 64 << 10;
/// Longest problem that is told, in characters.
const LONGEST_PROBLEM: usize = 500;

#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum Raw {
    View {
        id: u32,
        camera_to_world: [f64; 16],
        fov: f64,
        size: [u32; 2],
        #[serde(default)]
        moving: bool,
    },
    Coats {
        id: u32,
        coats: Vec<StyleLayerSpec>,
    },
    Ack {
        frame: u32,
    },
    Pick {
        id: u32,
        x: f64,
        y: f64,
    },
    Watch {
        on: bool,
    },
}

/// What a page wants.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Message {
    View(ViewMessage),
    StyleLayers(u32, Box<StyleLayers>),
    Ack(u32),
    Pick(PickMessage),
    Watch(bool),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ViewMessage {
    pub(crate) id: u32,
    pub(crate) camera: Camera,
    pub(crate) moving: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PickMessage {
    pub(crate) id: u32,
    pub(crate) x: f64,
    pub(crate) y: f64,
}

impl Message {
    /// Reads a message, or says what is wrong with it in a message of its own.
    pub(crate) fn read(text: &str) -> Result<Self, String> {
        let value: Value = serde_json::from_str(text)
            .map_err(|e| problem(&format!("the message is not JSON ({e})"), None))?;
        let id = value.get("id").and_then(Value::as_u64);
        Self::of(value).map_err(|reason| problem(&reason, id))
    }

    fn of(value: Value) -> Result<Self, String> {
        let raw = serde_json::from_value(value)
            .map_err(|e| format!("the message is not understood ({e}); see docs/studio.md"))?;
        Ok(match raw {
            Raw::View {
                id,
                camera_to_world,
                fov,
                size,
                moving,
            } => Self::View(ViewMessage {
                id,
                camera: Camera::viewpoint(&camera_to_world, fov, check_size(size)?)?,
                moving,
            }),
            Raw::Coats { id, coats } => Self::StyleLayers(id, Box::new(checked(coats)?)),
            Raw::Ack { frame } => Self::Ack(frame),
            Raw::Pick { id, x, y } => {
                let inside = 0.0..=1.0;
                if !(inside.contains(&x) && inside.contains(&y)) {
                    return Err(format!("({x}, {y}) is not in the picture; give 0 to 1"));
                }
                Self::Pick(PickMessage { id, x, y })
            }
            Raw::Watch { on } => Self::Watch(on),
        })
    }
}

/// Coats that make sense and are not too many.
pub(crate) fn checked(coats: Vec<StyleLayerSpec>) -> Result<StyleLayers, String> {
    let coats = StyleLayers { coats };
    coats.check().map_err(|e| e.to_string())?;
    Ok(coats)
}

pub(crate) fn problem(message: &str, id: Option<u64>) -> String {
    // What a page sends wrong is quoted, but not all of it.
    let message: String = message.chars().take(LONGEST_PROBLEM).collect();
    let mut said = json!({"type": "problem", "message": message});
    if let Some(id) = id {
        said["id"] = id.into();
    }
    said.to_string()
}

pub(crate) fn painted(id: u32, seconds: f64) -> String {
    json!({"type": "painted", "id": id, "seconds": seconds}).to_string()
}

pub(crate) fn picked(id: u32, found: &Picked) -> String {
    json!({
        "type": "picked",
        "id": id,
        "point": found.point,
        "depth": found.depth,
        "colour": found.colour,
    })
    .to_string()
}

/// What is at a place of a view.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Picked {
    pub(crate) point: Option<[f64; 3]>,
    pub(crate) depth: Option<f64>,
    pub(crate) colour: [f64; 3],
}

/// An answer of the interface as a message of the socket.
pub(crate) fn typed(kind: &str, mut facts: Value) -> String {
    facts["type"] = kind.into();
    facts.to_string()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    const POSE: &str = "[1,0,0,0, 0,1,0,0, 0,0,1,0, 0.1,0.2,0.3,1]";

    fn view(size: &str, fov: &str) -> String {
        format!(
            r#"{{"type":"view","id":7,"camera_to_world":{POSE},"fov":{fov},"size":{size},"moving":true}}"#
        )
    }

    #[test]
    fn a_view_is_a_camera() {
        let Message::View(read) = Message::read(&view("[64, 48]", "50")).unwrap() else {
            panic!("a view");
        };
        assert!(read.id == 7 && read.moving);
        assert_eq!(read.camera.centre().to_array(), [0.1, 0.2, 0.3]);
        assert_eq!(read.camera.intrinsics.width, 64);
    }

    #[test]
    fn what_is_wrong_is_said_with_the_id() {
        let said = |text: &str| -> Value {
            serde_json::from_str(&Message::read(text).unwrap_err()).unwrap()
        };
        for (size, fov, word) in [
            ("[0, 48]", "50", "0×48"),
            ("[64, 5000]", "50", "64×5000"),
            ("[64, -1]", "50", "not understood"),
            ("[64, 48]", "0.5", "field of view"),
            ("[64, 48]", "\"wide\"", "not understood"),
        ] {
            let said = said(&view(size, fov));
            assert_eq!((&said["type"], &said["id"]), (&"problem".into(), &7.into()));
            assert!(said["message"].as_str().unwrap().contains(word), "{said}");
        }
        let message = |text| said(text)["message"].as_str().unwrap().to_owned();
        assert!(message("{").contains("not JSON"));
        assert!(message("[]").contains("not understood"));
        assert!(message(r#"{"type":"sing"}"#).contains("sing"));
        assert!(message(r#"{"type":"pick","id":1,"x":1.5,"y":0}"#).contains("not in the picture"));
        assert!(said("3").get("id").is_none());
    }
}
