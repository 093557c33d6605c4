//! Methods to compare with, and what they need: shared by the commands that compare.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use impasto::eval::methods::{AdaIn, Stylizer, Wct};
use impasto::{Device, Model, read_paintings};
use impasto_train::Paintings;

use super::CliError;

/// Which methods to compare with.
#[derive(Debug, Args)]
pub struct MethodArgs {
    /// Methods to compare with: adain, wct; photo, the unstylised render, is always there
    #[arg(long, value_name = "METHODS", value_delimiter = ',', value_enum)]
    against: Vec<Against>,
    /// Networks of wct, distilled to a 16th, as a safetensors file
    #[arg(long, value_name = "FILE", required_if_eq("against", "wct"))]
    wct_weights: Option<PathBuf>,
    /// Decoder of adain, as `impasto train-baseline adain` writes it [default: the built-in one]
    #[arg(long, value_name = "FILE")]
    adain_weights: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Against {
    /// The unstylised render
    Photo,
    /// Adaptive instance normalisation, frame by frame, and as a video
    Adain,
    /// Whitening and colouring at four levels, frame by frame, and as a video
    Wct,
}

/// A model, and paintings to judge it by.
#[derive(Debug, Args)]
pub struct JudgedArgs {
    /// A model folder
    pub model: PathBuf,
    /// Folder of paintings, sub-folders included, best ones that the model was not trained on
    #[arg(long, value_name = "DIR")]
    pub styles: PathBuf,
}

impl JudgedArgs {
    /// Reads both.
    pub fn load(&self, device: &Device) -> Result<(Model, Paintings), CliError> {
        let model = Model::load_on(&self.model, device)?;
        let paintings = read_paintings(&self.styles).map_err(CliError::read(&self.styles))?;
        Ok((model, paintings))
    }
}

impl MethodArgs {
    /// Whether no method was asked for that paints.
    pub fn is_empty(&self) -> bool {
        !self.against.iter().any(|method| *method != Against::Photo)
    }

    /// Reads the networks of the methods that were asked for, each once.
    pub fn open(&self) -> Result<Vec<Box<dyn Stylizer>>, CliError> {
        let mut opened: Vec<Box<dyn Stylizer>> = Vec::new();
        if self.against.contains(&Against::Adain) {
            opened.push(Box::new(match &self.adain_weights {
                Some(file) => AdaIn::open(file)?,
                None => AdaIn::shipped()?,
            }));
        }
        if let (Some(file), true) = (&self.wct_weights, self.against.contains(&Against::Wct)) {
            opened.push(Box::new(Wct::open(file)?));
        }
        Ok(opened)
    }
}
