//! Folders of paintings, their statistics, and the cache of those.

mod cache;
mod folder;
pub(crate) mod measure;
mod set;
mod windows;

pub use cache::cache_folder;
pub use folder::painting_folder;
pub use set::{
    CROPS, FIRST_GENERATED, MOST_STYLES, Paintings, Style, StyleSet, StyleSources, read_paintings,
};

pub(crate) use folder::folder_identity;
pub(crate) use windows::window_statistics;
