//! Numbered frames with their cameras, in one file.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use super::folder::{CAMERAS, cameras, name};
use super::zip::ZipWriter;
use super::{Frame, Layout, Sink, Staging, View, parent, picture};
use crate::cli::CliError;

/// What a folder of frames holds, as a ZIP.
pub struct Archive {
    path: PathBuf,
    layout: Layout,
    synthetic: bool,
    views: Vec<View>,
    zip: ZipWriter<BufWriter<File>>,
    staging: Staging,
}

impl Archive {
    /// Begins a file that will be at `path`.
    pub fn new(path: &Path, layout: Layout, synthetic: bool) -> Result<Self, CliError> {
        let mut staging = Staging::new(&parent(path))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let file = File::create(staging.file(&name)?).map_err(CliError::write(path))?;
        Ok(Self {
            path: path.to_owned(),
            layout,
            synthetic,
            views: Vec::new(),
            zip: ZipWriter::new(BufWriter::new(file)),
            staging,
        })
    }

    /// Adds a file of one variant, which lies in a sub-folder where there are several.
    fn put(&mut self, variant: usize, name: &str, bytes: &[u8]) -> Result<(), CliError> {
        let name = match self.layout.variants() {
            [] | [_] => name.to_owned(),
            several => format!("{}/{name}", several[variant]),
        };
        let added = self.zip.add(&name, bytes);
        added.map_err(|error| failed(&self.path, error))
    }
}

fn failed(path: &Path, error: io::Error) -> CliError {
    match error.kind() {
        io::ErrorKind::FileTooLarge => CliError::Refused(format!(
            "{}: these frames are more than a .zip can hold (4 GiB); give a folder",
            path.display()
        )),
        _ => CliError::write(path)(error),
    }
}

impl Sink for Archive {
    fn add(&mut self, frame: Frame<'_>) -> Result<(), CliError> {
        let name = name(self.views.len());
        for (variant, picture) in frame.pictures.iter().enumerate() {
            let bytes = picture::png(picture).map_err(CliError::encode(&self.path))?;
            self.put(variant, &name, &bytes)?;
        }
        self.views.push(frame.view.clone());
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<Vec<PathBuf>, CliError> {
        let text = cameras(&self.views, &self.layout, false, self.synthetic);
        for variant in 0..self.layout.variants().len().max(1) {
            self.put(variant, CAMERAS, text.as_bytes())?;
        }
        let finished = self.zip.finish();
        finished.map_err(|error| failed(&self.path, error))?;
        self.staging.commit()?;
        Ok(vec![self.path])
    }
}
