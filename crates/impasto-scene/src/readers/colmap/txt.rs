//! COLMAP's text files.

use std::path::Path;
use std::str::FromStr;

use glam::DVec2;

use super::model::{Image, Lenses, Point, lens};
use crate::error::{SceneError, read_text};

/// The fields of one line; every failure names the file and the line.
struct Fields<'a> {
    path: &'a Path,
    line: usize,
    /// What is left, without white space at either end.
    rest: &'a str,
}

impl<'a> Fields<'a> {
    fn new(path: &'a Path, line: usize, text: &'a str) -> Self {
        Self {
            path,
            line,
            rest: text.trim(),
        }
    }

    fn error(&self, problem: String) -> SceneError {
        SceneError::malformed(self.path, format!("line {}", self.line), problem)
    }

    fn word(&mut self, what: &str) -> Result<&'a str, SceneError> {
        if self.rest.is_empty() {
            return Err(self.error(format!("the {what} is missing; export the model again")));
        }
        let (word, rest) = self
            .rest
            .split_once(|c: char| c.is_ascii_whitespace())
            .unwrap_or((self.rest, ""));
        self.rest = rest.trim_start();
        Ok(word)
    }

    fn next<T: FromStr>(&mut self, what: &str) -> Result<T, SceneError> {
        let word = self.word(what)?;
        word.parse().map_err(|_| {
            let problem = format!("\"{word}\" is not a valid {what}; export the model again");
            self.error(problem)
        })
    }

    fn several<T: FromStr + Copy + Default, const N: usize>(
        &mut self,
        what: &str,
    ) -> Result<[T; N], SceneError> {
        let mut values = [T::default(); N];
        for value in &mut values {
            *value = self.next(what)?;
        }
        Ok(values)
    }

    /// Everything up to the end of the line, spaces included.
    fn remainder(&mut self, what: &str) -> Result<&'a str, SceneError> {
        let remainder = self.rest;
        self.word(what)?;
        Ok(remainder)
    }

    fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }
}

/// Lines with their numbers, comments left out. Empty lines stay: an image without features has
/// one.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line.trim()))
        .filter(|(_, line)| !line.starts_with('#'))
}

/// Reads `cameras.txt`.
pub(super) fn cameras(path: &Path) -> Result<Lenses, SceneError> {
    let text = read_text(path)?;
    let mut lenses = Lenses::new();
    for (line, content) in lines(&text).filter(|(_, content)| !content.is_empty()) {
        let mut fields = Fields::new(path, line, content);
        let id = fields.next("camera id")?;
        let model = fields.word("lens model")?;
        let size = (fields.next("width")?, fields.next("height")?);
        let mut values = Vec::new();
        while !fields.is_empty() {
            values.push(fields.next("lens parameter")?);
        }
        let place = format!("camera {id}");
        lenses.insert(id, lens(model, size, &values, path, &place)?);
    }
    Ok(lenses)
}

/// Reads `images.txt`: two lines for each image, the second one empty when it has no features.
pub(super) fn images(path: &Path) -> Result<Vec<Image>, SceneError> {
    let text = read_text(path)?;
    let mut lines = lines(&text);
    let mut images = Vec::new();
    while let Some((line, content)) = lines.find(|(_, content)| !content.is_empty()) {
        let mut fields = Fields::new(path, line, content);
        let id = fields.next("image id")?;
        let rotation = fields.several("quaternion")?;
        let translation = fields.several("translation")?;
        let camera = fields.next("camera id")?;
        let name = fields.remainder("image name")?.to_owned();
        let (line, content) = lines.next().unwrap_or((line + 1, ""));
        let mut fields = Fields::new(path, line, content);
        let mut features = Vec::new();
        while !fields.is_empty() {
            let [x, y] = fields.several("feature position")?;
            features.push(DVec2::new(x, y));
            fields.next::<i64>("point id")?;
        }
        images.push(Image {
            id,
            rotation,
            translation,
            camera,
            name,
            features,
        });
    }
    Ok(images)
}

/// Reads `points3D.txt`.
pub(super) fn points(path: &Path) -> Result<Vec<Point>, SceneError> {
    let text = read_text(path)?;
    let mut points = Vec::new();
    for (line, content) in lines(&text).filter(|(_, content)| !content.is_empty()) {
        let mut fields = Fields::new(path, line, content);
        fields.next::<u64>("point id")?;
        let position = fields.several("position")?;
        let colour = fields.several("colour")?;
        let error = fields.next("error")?;
        let mut track = Vec::new();
        while !fields.is_empty() {
            track.push((fields.next("image id")?, fields.next("feature index")?));
        }
        points.push(Point {
            position,
            colour,
            error,
            track,
        });
    }
    Ok(points)
}
