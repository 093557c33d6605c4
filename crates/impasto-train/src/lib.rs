//! The two training stages.
pub mod budget;
pub mod config;
pub mod event;
pub mod geometry_stage;
pub mod rays;
