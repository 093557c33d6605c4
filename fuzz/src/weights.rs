//! impasto-style's readers of weight files, compiled from their sources: they need no tensor
//! library, whose instrumented build would take many minutes.

#[path = "../../crates/impasto-style/src/weights/file.rs"]
pub mod file;
#[path = "../../crates/impasto-style/src/weights/number.rs"]
mod number;
#[path = "../../crates/impasto-style/src/weights/pickle/mod.rs"]
mod pickle;
#[path = "../../crates/impasto-style/src/weights/source.rs"]
mod source;
#[path = "../../crates/impasto-style/src/tensors.rs"]
pub mod tensors;
#[path = "../../crates/impasto-style/src/weights/torch.rs"]
mod torch;
#[path = "../../crates/impasto-style/src/weights/zip.rs"]
mod zip;
